//! The bodies that open an episode and make a step.

use serde_json::Value;

use crate::app::body::values::Json;
use crate::app::body::{name, request_body};
use crate::app::hidden::answer::hash;
use crate::app::limits::LIMITS;
use crate::app::task_ref::{TaskRef, TaskShape};
use crate::pictures::isometric::Corner;
use plumbline_engine::intake::schema::{ActionCode, NewEvent};
use plumbline_engine::intake::tolerant::{Integer, Texts};
use plumbline_engine::intake::{Faults, MAX_FILES, TurnEvents};
use plumbline_engine::voxel::BlockLog;

request_body! {
    /// Body that opens an episode: an attempt at a task, alone or for a run, or at a hidden instance.
    #[schema(example = json!({ "task": "walls/5x1x5-raise" }))]
    pub struct NewEpisode: "an object with \"task\" or \"instance\"" {
        /// The task: its id, or its number in the suite.
        #[schema(value_type = Option<TaskRef>)]
        task: TaskRef = work(|faults| TaskShape { faults }),
        /// Hidden instance, by its id.
        #[schema(format = Uuid)]
        instance: String = work(name),
        /// Suite of the task, if the episode belongs to no run: name, or name@version.
        #[schema(min_length = 1)]
        suite: String = optional(name),
        /// Run that the submission will belong to.
        #[schema(format = Uuid)]
        run: String = optional(name),
    }
    unknown: |_| "unknown field; an episode has task, suite and run, or instance"
}

request_body! {
    /// Body of a step: code to run, or events to apply, in the world as it stands.
    #[schema(example = json!({ "step": 1, "action_code": "await skills.placeBlock(bot, 'stone', 0, 0, 0);" }))]
    pub struct NewStep: "an object with \"action_code\" or \"events\"" {
        /// Answer of a model as it came, or code; a list if there are several files, which run in order.
        #[schema(value_type = Option<ActionCode>)]
        action_code: Vec<String> = work(|faults| Texts { faults, most: MAX_FILES }),
        /// Events to apply instead.
        #[schema(value_type = Option<Vec<NewEvent>>)]
        events: BlockLog = work(|faults| TurnEvents { faults, limits: LIMITS.log() }),
        /// Number of this step, from 1. With it the request may be repeated: the same step is made once, and its answer
        /// is given again.
        #[schema(value_type = Option<i64>, minimum = 1)]
        step: i64 = optional(step_number),
        /// Box of the world to show after the step.
        view: Region = optional(|faults| Json { faults, read: read_region }),
        /// Corner from which to draw what was built, for agents that see: `south-east`, `south-west`, `north-west` or
        /// `north-east`.
        picture: Corner = optional(|faults| Json { faults, read: read_corner }),
    }
    unknown: |_| "unknown field; a step has action_code or events, step, view and picture"
}

request_body! {
    /// Body that goes on to the next turn.
    #[derive(Default)]
    #[schema(example = json!({ "step": 2 }))]
    pub struct NextTurn: "an object with \"step\"" {
        /// Number of this step, from 1. With it the request may be repeated.
        #[schema(value_type = Option<i64>, minimum = 1)]
        step: i64 = optional(step_number),
    }
    unknown: |_| "unknown field; only step is known"
}

request_body! {
    /// Body that submits an episode.
    #[derive(Default)]
    #[schema(example = json!({ "transcript_sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08" }))]
    pub struct SubmitEpisode: "an object with \"transcript_sha256\"" {
        /// SHA-256 of the agent's transcript, which must be shown on request; only for a hidden instance.
        #[schema(pattern = "^[0-9a-fA-F]{64}$")]
        transcript_sha256: String = optional(hash),
    }
    unknown: |_| "unknown field; only transcript_sha256 is known"
}

fn step_number(faults: &mut Faults) -> Integer<'_> {
    Integer { faults, min: 1, max: i64::MAX }
}

/// A box of cells, with both corners in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, utoipa::ToSchema)]
pub struct Region {
    /// One corner.
    #[schema(example = json!([-2, -1, -2]))]
    pub from: [i32; 3],
    /// The opposite corner.
    #[schema(example = json!([6, 4, 6]))]
    pub to: [i32; 3],
}

impl Region {
    /// Creates the box between two corners, with `from` as the least one.
    ///
    /// # Errors
    /// Returns the reason if it has more cells than may be shown.
    pub fn between(a: [i32; 3], b: [i32; 3]) -> Result<Self, String> {
        let from = std::array::from_fn(|axis| a[axis].min(b[axis]));
        let to: [i32; 3] = std::array::from_fn(|axis| a[axis].max(b[axis]));
        let cells = (0..3).map(|axis| u64::from(a[axis].abs_diff(b[axis])) + 1).try_fold(1u64, u64::checked_mul);
        match cells.filter(|cells| *cells <= LIMITS.episode_view_cells) {
            Some(_) => Ok(Self { from, to }),
            None => Err(format!("more than {} cells", LIMITS.episode_view_cells)),
        }
    }
}

fn read_corner(value: &Value, faults: &mut Faults) -> Option<Corner> {
    let corner = serde_json::from_value(value.clone()).ok();
    if corner.is_none() {
        faults.add("expected \"south-east\", \"south-west\", \"north-west\" or \"north-east\"");
    }
    corner
}

fn read_region(value: &Value, faults: &mut Faults) -> Option<Region> {
    let corner = |name: &str| -> Option<[i32; 3]> { serde_json::from_value(value.get(name)?.clone()).ok() };
    let (Some(from), Some(to)) = (corner("from"), corner("to")) else {
        faults.add("expected {\"from\": [x, y, z], \"to\": [x, y, z]}");
        return None;
    };
    Region::between(from, to).map_err(|why| faults.add(why)).ok()
}
