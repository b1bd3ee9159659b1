//! What a child process is asked to replay, and what it answers.

use serde::{Deserialize, Serialize};

use super::{ActionLimits, CRASHED, LimitReached, Profile, Replayed};
use plumbline_engine::voxel::cell;

/// Turns to replay.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Job {
    /// Rules of the replay.
    pub profile: Profile,
    /// The world before the first turn; only used by profiles that have one.
    pub start: Option<WorldState>,
    /// The turns, in order.
    pub turns: Vec<TurnInput>,
    /// Whether to tell, under `mindcraft`, when `published` would have built otherwise.
    #[serde(default)]
    pub is_compared: bool,
}

/// Input of a turn.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TurnInput {
    /// Answers or files of action code, which run one after another.
    Code(Vec<String>),
    /// Events of a turn that was sent without code: cells with the name of the block, or none if it was removed.
    Events(Vec<([i32; 3], Option<String>)>),
}

impl Job {
    /// Creates a job of one file.
    #[must_use]
    pub fn of_code(profile: Profile, code: String) -> Self {
        Self { profile, turns: vec![TurnInput::Code(vec![code])], ..Self::default() }
    }
}

/// A job with its limits, as it is sent to the child.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Order {
    /// What to replay.
    pub job: Job,
    /// Limits on the whole job.
    pub limits: ActionLimits,
}

/// Result of a job.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Answer {
    /// Results of the turns that hold code; empty ones for turns of events. A job that is stopped at a limit ends with
    /// the turn in which that happened.
    pub turns: Vec<Replayed>,
    /// The world after the last turn; none for profiles without one.
    pub end: Option<WorldState>,
    /// Processor time that the job took, in milliseconds, as its process tells.
    #[serde(default)]
    pub cpu_ms: u64,
}

impl Answer {
    /// Answers for code that made its process fail.
    pub(super) fn crashed() -> Self {
        let detail = "the code broke the objects that it was given".to_owned();
        let stopped = Some(LimitReached { limit: CRASHED.to_owned(), detail });
        Self { turns: vec![Replayed { stopped, ..Replayed::default() }], ..Self::default() }
    }

    /// Returns the limit at which the job was stopped.
    #[must_use]
    pub fn stopped(&self) -> Option<&LimitReached> {
        self.turns.iter().find_map(|turn| turn.stopped.as_ref())
    }
}

/// A world with the body in it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct WorldState {
    /// Blocks that occur, with their states, such as `oak_door[half=upper]`.
    pub palette: Vec<String>,
    /// Cells that differ from the natural world, by y, x and z, each with the index of its block.
    pub blocks: Vec<([i32; 3], u32)>,
    /// Position of the body.
    pub position: [f64; 3],
    /// Direction of its view in degrees: yaw and pitch.
    pub view: [f64; 2],
    /// Virtual time in milliseconds.
    pub now_ms: u64,
    /// For each entry of the palette the number of its state, and which of its properties were named.
    pub looks: Vec<(u16, u16)>,
    /// Number of blocks that `/fill` and `/clone` may change, if a game rule set it.
    pub block_limit: Option<i32>,
    /// Name of the item in the body's hand.
    #[serde(default)]
    pub held: Option<String>,
}

impl WorldState {
    /// Returns whether it can be a world: cells within it, blocks of the palette, and finite numbers.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let side = -cell::MAX_HORIZONTAL..=cell::MAX_HORIZONTAL;
        let is_within =
            |[x, y, z]: [i32; 3]| side.contains(&x) && side.contains(&z) && (cell::MIN_Y..=cell::MAX_Y).contains(&y);
        self.looks.len() == self.palette.len()
            && self.blocks.iter().all(|(at, index)| is_within(*at) && (*index as usize) < self.palette.len())
            && self.position.iter().chain(&self.view).all(|number| number.is_finite())
    }

    /// Returns the cells of the ground that were dug out.
    pub fn dug(&self) -> impl Iterator<Item = [i32; 3]> {
        let is_air = |index: u32| self.palette[index as usize] == "air";
        self.blocks.iter().filter(move |(_, index)| is_air(*index)).map(|(cell, _)| *cell)
    }

    /// Returns the blocks that stand, by y, x and z. Cells whose ground was removed are left out.
    pub fn standing(&self) -> impl Iterator<Item = ([i32; 3], &str)> {
        let named = self.blocks.iter().map(|(cell, index)| (*cell, self.palette[*index as usize].as_str()));
        named.filter(|(_, look)| *look != "air")
    }
}
