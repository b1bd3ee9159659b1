//! A step of an episode: code that runs, or events that apply, in the world as it stands.

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::body::NewStep;
use super::state::{Episode, LastStep};
use super::view::{View, seen};
use crate::actions::Replayed;
use crate::actions::job::{Job, TurnInput};
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::replay::{EventBudget, ReplayedEvent, replay, take_events, told};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::hex;
use plumbline_engine::voxel::{BlockLog, Event, Profile};

/// Result of a step.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StepDone {
    /// Number of the step, from 1.
    #[schema(minimum = 1)]
    pub step: i64,
    /// Number of the turn, from 1.
    #[schema(minimum = 1)]
    pub turn: usize,
    /// Blocks that were placed and removed, in order; the first `episode_events` of `/v1/limits`.
    pub events: Vec<ReplayedEvent>,
    /// Number of events that are not listed.
    pub events_left_out: usize,
    /// What is told of the code: errors, notes and what it printed. Null for a step of events.
    pub code: Option<TurnReplay>,
    /// Position of the body: x, y and z.
    pub position: [f64; 3],
    /// Number of blocks that stand and were not there before the episode.
    pub blocks: usize,
    /// The box that was asked for.
    pub view: Option<View>,
}

/// Makes a step, which is durable when this returns. A step that reaches a limit changes nothing.
///
/// # Errors
/// Returns all faults of the body, 409 if the episode has ended or its next step has another number, and 429 if too
/// much code waits.
pub async fn make_step(
    app: &App,
    caller: &Caller,
    id: &str,
    bytes: &[u8],
    (draft, faults): (Option<NewStep>, Faults),
) -> AppResult<Value> {
    let mut episode = Episode::of_caller(app, caller, id).await?;
    let Some(new) = draft.filter(|_| faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let hash = hash_of("step", bytes);
    if let Some(answer) = episode.repeated(new.step, &hash) {
        return Ok(answer.clone());
    }
    episode.must_take(new.step)?;
    if episode.row.step >= LIMITS.episode_steps {
        let detail = format!("the episode has made {} steps; submit it", LIMITS.episode_steps);
        return Err(AppError::conflict("episode-over", detail));
    }
    let mut log = episode.stored.log()?;
    let turn = log.turns.len() - 1;
    let code = new.action_code.is_some();
    let input = match (new.action_code, &new.events) {
        (Some(files), _) => TurnInput::Code(files),
        (None, Some(events)) => TurnInput::Events(as_input(events)),
        (None, None) => return Err(AppError::faulty(faults)),
    };
    let world = std::mem::take(&mut episode.stored.world);
    let job = Job { profile: Profile::Mindcraft, start: Some(world), turns: vec![input] };
    let answer = replay(app, caller.who(), &job).await?;
    let (Some(mut done), Some(end)) = (answer.turns.into_iter().next(), answer.end) else {
        return Err(AppError::internal(&"a job of one turn ended without its world"));
    };
    if let Some(events) = &new.events {
        done = as_recorded(events);
    }
    let mut faults = Faults::new();
    take_events(app, &mut log, turn, &done, &mut EventBudget::whole(app), &mut faults);
    let blocks = end.standing().count();
    if blocks > LIMITS.blocks {
        faults.add(format!("{blocks} blocks would stand; at most {} are allowed", LIMITS.blocks));
    }
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let all = done.events.len();
    let done = StepDone {
        step: episode.row.step + 1,
        turn: episode.stored.turn,
        events: told(&done).take(LIMITS.episode_events).collect(),
        events_left_out: all.saturating_sub(LIMITS.episode_events),
        code: code.then(|| TurnReplay::of(episode.stored.turn, done)),
        position: end.position,
        blocks,
        view: new.view.map(|region| seen(&end, region)),
    };
    episode.stored.set_log(&log);
    episode.stored.world = end;
    keep_step(app, &mut episode, hash, &done).await
}

/// Stores the next step of an episode with its answer, and returns the answer.
pub(super) async fn keep_step(
    app: &App,
    episode: &mut Episode,
    hash: String,
    answer: &impl Serialize,
) -> AppResult<Value> {
    let answer = serde_json::to_value(answer).map_err(|error| AppError::internal(&error))?;
    episode.stored.last = Some(LastStep { hash, answer: answer.clone() });
    let state = episode.stored.json();
    if state.len() > LIMITS.episode_bytes {
        let mut faults = Faults::new();
        faults.add(format!("the episode would take more than {} bytes; submit it", LIMITS.episode_bytes));
        return Err(AppError::faulty(faults));
    }
    let step = episode.row.step + 1;
    if !app.store.advance_episode(&episode.row.id, step, &state).await? {
        return Err(AppError::conflict("other-step", "another request made this step; read the episode"));
    }
    episode.row.step = step;
    Ok(answer)
}

/// Returns the SHA-256 of an operation and a body, in hex.
pub(super) fn hash_of(operation: &str, body: &[u8]) -> String {
    hex(&Sha256::new().chain_update(operation).chain_update([0]).chain_update(body).finalize())
}

/// Returns the events of a log of one turn as a job takes them.
fn as_input(log: &BlockLog) -> Vec<([i32; 3], Option<String>)> {
    let input = log.turns.iter().flatten().map(|event| match *event {
        Event::Place { cell, material } => (cell.into(), Some(log.palette.name(material).to_owned())),
        Event::Remove { cell } => (cell.into(), None),
    });
    input.collect()
}

/// Returns the events of a log of one turn as code records them.
fn as_recorded(log: &BlockLog) -> Replayed {
    Replayed::of_events(as_input(log))
}
