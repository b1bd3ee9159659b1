//! Action code, which agents write for the mindcraft framework, run against stand-ins that record what it places and
//! removes (`docs/rules.md#formats`).
//!
//! The code is not trusted. Each script runs in its own process (`child`), which the operating system confines
//! (`confine`) and which is taken from a few ready ones (`pool`). `engine` runs the script there; `prelude.js` holds
//! the stand-ins.

pub mod child;
mod confine;
mod engine;
mod integers;
mod memory;
pub mod pool;
mod script;
pub mod turn_replay;

use serde::{Deserialize, Serialize};

use plumbline_engine::voxel::cell;

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
    /// Maximum number of distinct materials.
    pub materials: usize,
    /// Maximum length of a material's name, in characters.
    pub material_chars: usize,
}

/// Limits in force. Those on events and materials are also the limits of a log.
pub const ACTION_LIMITS: ActionLimits = ActionLimits {
    code_bytes: 512 << 10,
    events: 400_000,
    cpu_ms: 2_000,
    wall_ms: 10_000,
    memory_bytes: 64 << 20,
    materials: 4_096,
    material_chars: 128,
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
}

impl Replayed {
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

impl std::fmt::Display for LimitReached {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.limit.as_str() {
            CRASHED => write!(f, "stopped: {}", self.detail),
            limit => write!(f, "stopped at a limit ({limit}): {}", self.detail),
        }
    }
}
