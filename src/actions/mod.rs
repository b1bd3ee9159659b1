//! Action code, which agents write for the mindcraft framework: runs it, and records what it places and removes
//! (`docs/rules.md#formats`).
//!
//! The code is not trusted. It runs in a process of its own (`child`), which the operating system confines (`confine`)
//! and in which `sandbox` limits the JavaScript engine. `replayer` processes fork one for each script, and `pool` keeps
//! them ready. The profile decides what code can call and what a call does: `published` records calls as the published
//! pipeline does, `mindcraft` carries them out in a world.

pub mod child;
mod compared;
mod confine;
mod endless;
pub mod functions;
pub mod job;
mod memory;
mod mindcraft;
pub mod pool;
mod published;
mod replayer;
mod sandbox;
pub mod turn_replay;

pub use mindcraft::{AFTERWARDS_MS, MAX_ERRORS, MAX_NOTES, NOTE_CHARS, STACK_BYTES};

use serde::{Deserialize, Serialize};

pub use plumbline_engine::voxel::Profile;
use plumbline_engine::voxel::{BlockLog, Event, cell};

/// Limits on action code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActionLimits {
    /// Maximum size of the code, in bytes.
    pub code_bytes: usize,
    /// Maximum number of events that it may record.
    pub events: usize,
    /// Processor time that it may use, in milliseconds.
    pub cpu_ms: u64,
    /// Wall-clock time in milliseconds after which its process is killed: much longer than `cpu_ms`, so that it only
    /// runs out if the machine is overloaded.
    pub wall_ms: u64,
    /// Memory for its objects, in bytes.
    pub memory_bytes: usize,
    /// Stack of the engine, in bytes.
    pub stack_bytes: usize,
    /// Maximum number of distinct materials.
    pub materials: usize,
    /// Maximum length of a material's name, in characters.
    pub material_chars: usize,
    /// Lines of its log that are kept.
    pub log_lines: usize,
    /// Bytes of its log that are kept.
    pub log_bytes: usize,
    /// Virtual time that may pass, in milliseconds, under the profile `mindcraft`.
    pub virtual_ms: u64,
}

/// Limits in force. Those on events and materials are also the limits of a log.
pub const ACTION_LIMITS: ActionLimits = ActionLimits {
    code_bytes: 512 << 10,
    events: 400_000,
    cpu_ms: 2_000,
    wall_ms: 10_000,
    memory_bytes: 64 << 20,
    stack_bytes: 512 << 10,
    materials: 4_096,
    material_chars: 128,
    log_lines: 500,
    log_bytes: 32 << 10,
    virtual_ms: 86_400_000,
};

/// Name of the limit of a script that made its process crash.
const CRASHED: &str = "process";

/// Result of running a script.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Replayed {
    /// Names of the materials in the events.
    pub palette: Vec<String>,
    /// Recorded events, in order.
    pub events: Vec<RecordedEvent>,
    /// Calls that recorded nothing, by reason.
    pub dropped: Vec<Dropped>,
    /// Error that ended the script, or of a rejected promise without a handler.
    pub error: Option<CodeError>,
    /// Hints for the author although nothing failed, such as a function that was defined and never called.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Whether the code is not JavaScript, in which case none of it was run.
    #[serde(default)]
    pub unreadable: bool,
    /// Limit at which the script was stopped, in which case its events are incomplete.
    pub stopped: Option<LimitReached>,
    /// Further errors: of other files of the turn, and of promises that nothing handled.
    #[serde(default)]
    pub more_errors: Vec<CodeError>,
    /// Whether the palette names states too, such as `oak_door[half=upper]`.
    #[serde(default)]
    pub has_states: bool,
    /// What the code printed, a line each.
    #[serde(default)]
    pub log: Vec<String>,
}

/// Note on code with a null character.
fn null_noted(code: &str) -> Option<&'static str> {
    code.contains('\0').then_some("the code has a null character (U+0000), which is read as U+FFFD")
}

/// Replaces null characters, with which the engine takes no text.
fn without_null(code: &str) -> String {
    code.replace('\0', "\u{fffd}")
}

/// Returns a note with the number of the file of the turn that it is about.
fn in_file(number: usize, note: &str) -> String {
    format!("file {number}: {note}")
}

impl Replayed {
    /// Creates the recording of the events of a log.
    #[must_use]
    pub fn of_log(log: &BlockLog) -> Self {
        let recorded = |event: &Event| match *event {
            Event::Place { cell, material } => RecordedEvent { cell: cell.into(), material: Some(material) },
            Event::Remove { cell } => RecordedEvent { cell: cell.into(), material: None },
        };
        Self {
            palette: log.palette.names().map(str::to_owned).collect(),
            events: log.turns.iter().flatten().map(recorded).collect(),
            ..Self::default()
        }
    }

    /// Returns the block that an event placed, with its state if that is known.
    #[must_use]
    pub fn block(&self, event: &RecordedEvent) -> Option<&str> {
        self.palette.get(event.material? as usize).map(String::as_str)
    }

    /// Returns the material of the block that an event placed.
    #[must_use]
    pub fn material(&self, event: &RecordedEvent) -> Option<&str> {
        let block = self.block(event)?;
        Some(if self.has_states { block.split('[').next().unwrap_or(block) } else { block })
    }

    /// Returns whether the code ended before its end: by an error or at a limit.
    #[must_use]
    pub fn ended_early(&self) -> bool {
        self.error.is_some() || self.stopped.is_some()
    }

    /// Marks the error as that of a file of the turn.
    fn of_file(mut self, number: usize) -> Self {
        for error in self.error.iter_mut().chain(&mut self.more_errors) {
            error.file = Some(number);
        }
        for note in &mut self.notes {
            *note = in_file(number, note);
        }
        self
    }

    /// Appends what another file of the same turn did.
    fn append(&mut self, other: Self) {
        let Self { palette, events, dropped, error, notes, unreadable, stopped, more_errors, has_states, log } = other;
        let ids: Vec<u32> = palette.into_iter().map(|name| self.index_of(name)).collect();
        let renumbered = |event: RecordedEvent| RecordedEvent {
            material: event.material.and_then(|index| ids.get(index as usize).copied()),
            ..event
        };
        self.events.extend(events.into_iter().map(renumbered));
        for Dropped { reason, count } in dropped {
            match self.dropped.iter_mut().find(|known| known.reason == reason) {
                Some(known) => known.count += count,
                None => self.dropped.push(Dropped { reason, count }),
            }
        }
        let mut errors = error.into_iter().chain(more_errors);
        if self.error.is_none() {
            self.error = errors.next();
        }
        self.more_errors.extend(errors);
        self.notes.extend(notes);
        self.log.extend(log);
        self.unreadable &= unreadable;
        self.has_states |= has_states;
        self.stopped = self.stopped.take().or(stopped);
    }

    fn index_of(&mut self, name: String) -> u32 {
        let at = self.palette.iter().position(|known| *known == name).unwrap_or_else(|| {
            self.palette.push(name);
            self.palette.len() - 1
        });
        u32::try_from(at).expect("a palette is short")
    }

    /// Returns whether all events are valid: cells within the world, and materials within the palette.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let is_sound = |event: &RecordedEvent| {
            let [x, y, z] = event.cell;
            (-cell::MAX_HORIZONTAL..=cell::MAX_HORIZONTAL).contains(&x)
                && (-cell::MAX_HORIZONTAL..=cell::MAX_HORIZONTAL).contains(&z)
                && (cell::MIN_Y..=cell::MAX_Y).contains(&y)
                && event.material.is_none_or(|index| (index as usize) < self.palette.len())
        };
        self.events.iter().all(is_sound)
    }
}

/// Event that places or removes a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedEvent {
    /// Cell of the block: x, y and z.
    pub cell: [i32; 3],
    /// Index of the placed material in the palette; `None` if the block is removed.
    pub material: Option<u32>,
}

/// Calls that recorded nothing, for the same reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Dropped {
    /// Reason why the calls recorded nothing.
    #[schema(example = "a coordinate is not an integer")]
    pub reason: String,
    /// Number of such calls.
    pub count: u64,
}

/// Error of a script.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CodeError {
    /// Error message, with the name of the error.
    #[schema(example = "TypeError: not a function")]
    pub message: String,
    /// Line in the code, counted from 1, if known.
    pub line: Option<u32>,
    /// Column in that line, counted from 1.
    pub column: Option<u32>,
    /// Number of the file among those of its turn, counted from 1; absent if there is only one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<usize>,
    /// Number of events of the turn that were recorded when the file with the error ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub events: Option<usize>,
    /// Whether the error was thrown by the code itself, and not by what it called.
    #[serde(skip)]
    #[schema(ignore)]
    pub is_own: bool,
}

/// Limit that a script reached.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LimitReached {
    /// Name of the limit: `time`, `memory` or `events`; `process` if the script made its process crash.
    #[schema(example = "time")]
    pub limit: String,
    /// Description of the limit that was reached.
    #[schema(example = "more than 2000 ms of processor time; 25 events recorded before")]
    pub detail: String,
}

impl LimitReached {
    /// Describes a limit by its name, with what was recorded before.
    fn of(limit: &str, limits: &ActionLimits, recorded: &str) -> Self {
        let detail = match limit {
            "events" => format!("more than {} events", limits.events),
            "memory" => format!("more than {} bytes of memory", limits.memory_bytes),
            _ => format!("more than {} ms of processor time", limits.cpu_ms),
        };
        Self { limit: limit.to_owned(), detail: format!("{detail}; {recorded} recorded before") }
    }
}

impl std::fmt::Display for LimitReached {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.limit.as_str() {
            CRASHED => write!(f, "stopped: {}", self.detail),
            limit => write!(f, "stopped at a limit ({limit}): {}", self.detail),
        }
    }
}
