//! Action code: what agents write for the mindcraft framework, run against stand-ins that record what it places and removes
//! (SPEC 8).
//!
//! The code is not trusted. It runs in a process of its own (`child`) that the operating system confines (`confine`), one
//! process a script, taken from a few that wait (`pool`). `engine` runs it there; `prelude.js` holds the stand-ins.

pub mod child;
mod confine;
mod engine;
mod integers;
mod memory;
pub mod pool;

use serde::{Deserialize, Serialize};

use plumbline_engine::voxel::cell;

/// What action code may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ActionLimits {
    /// Bytes of the code.
    pub code_bytes: usize,
    /// Events that it may record.
    pub events: usize,
    /// Milliseconds that it may take on the processor.
    pub cpu_ms: u64,
    /// Milliseconds after which its process is ended, whatever it does: much more than it may take on the processor, so that it
    /// only happens where the machine has no time for it.
    pub wall_ms: u64,
    /// Bytes of memory for its objects.
    pub memory_bytes: usize,
    /// Distinct materials.
    pub materials: usize,
    /// Characters of a material's name.
    pub material_chars: usize,
}

/// The limits in force, but for those that a log has too.
pub const ACTION_LIMITS: ActionLimits = ActionLimits {
    code_bytes: 512 << 10,
    events: 400_000,
    cpu_ms: 2_000,
    wall_ms: 10_000,
    memory_bytes: 64 << 20,
    materials: 4_096,
    material_chars: 128,
};

/// What a script did.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Replayed {
    /// Names of materials.
    pub palette: Vec<String>,
    /// Events in order.
    pub events: Vec<RecordedEvent>,
    /// Calls that recorded nothing, by reason.
    pub dropped: Vec<Dropped>,
    /// The error that ended the script or that nobody waited for.
    pub error: Option<CodeError>,
    /// What its author may want to know although nothing failed, such as that a function was defined and never called.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Whether the code is not JavaScript, so that none of it was run.
    #[serde(default)]
    pub unreadable: bool,
    /// The limit at which it was stopped; then its events are not all that it would have recorded.
    pub stopped: Option<LimitReached>,
}

impl Replayed {
    /// Whether its events are such as can be: cells of the world, materials of the palette.
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

/// A place or remove event: cell, and the material's place in the palette where one is placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedEvent {
    /// The cell.
    pub cell: [i32; 3],
    /// The material; none where the block is removed.
    pub material: Option<u32>,
}

/// Calls that recorded nothing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Dropped {
    /// Why.
    #[schema(example = "a coordinate is not an integer")]
    pub reason: String,
    /// How many.
    pub count: u64,
}

/// An error of the script.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CodeError {
    /// What it says.
    #[schema(example = "TypeError: not a function")]
    pub message: String,
    /// Line in the code, from 1, where it is known.
    pub line: Option<u32>,
    /// Column in that line, from 1.
    pub column: Option<u32>,
}

/// A limit that a script reached.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LimitReached {
    /// `time`, `memory` or `events`.
    #[schema(example = "time")]
    pub limit: String,
    /// What was reached, in words.
    #[schema(example = "more than 2000 ms on the processor; 1 event recorded before")]
    pub detail: String,
}
