//! A step of an episode: code that runs, or events that apply, in the world as it stands.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::body::NewStep;
use super::state::{Episode, LastStep};
use super::view::{View, picture, seen};
use crate::actions::Replayed;
use crate::actions::job::{Job, TurnInput};
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::blocking::blocking;
use crate::app::error::{AppError, AppResult};
use crate::app::event_budget::EventBudget;
use crate::app::limits::LIMITS;
use crate::app::replay::{ReplayedEvent, events_of, replay, take_events, told};
use plumbline_engine::game::Look;
use plumbline_engine::game::coordinates::{MAX_Y, MIN_Y};
use plumbline_engine::game::world::is_in_world;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::hex;
use plumbline_engine::voxel::blocks::GAME_VERSION;
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
    /// The picture that was asked for: a PNG in Base64.
    #[schema(content_encoding = "base64", content_media_type = "image/png")]
    pub picture: Option<String>,
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
    let mut episode = Episode::to_act_on(app, caller, id).await?;
    let Some(new) = draft.filter(|_| faults.is_empty()) else { return Err(AppError::faulty(faults)) };
    let hash = hash_of("step", bytes);
    if let Some(answer) = episode.repeated(new.step, &hash) {
        return Ok(answer.clone());
    }
    episode.must_take(new.step)?;
    let (input, given) = match (new.action_code, new.events) {
        (Some(files), _) => (TurnInput::Code(files), None),
        (None, Some(events)) => {
            let events = in_world(&events)?;
            (TurnInput::Events(events_of(&events, 0)), Some(Replayed::of_log(&events)))
        }
        (None, None) => return Err(AppError::faulty(faults)),
    };
    let world = std::mem::take(&mut episode.stored.world);
    let job = Job { profile: Profile::Mindcraft, start: Some(world), turns: vec![input], is_compared: false };
    let answer = replay(app, caller.who(), &job).await?;
    let (Some(done), Some(end)) = (answer.turns.into_iter().next(), answer.end) else {
        return Err(AppError::internal(&"a job of one turn ended without its world"));
    };
    let (view, corner, limits) = (new.view, new.picture, app.limits);
    // As many pictures are drawn at once as at their own route.
    let slot = if corner.is_some() { Some(app.file_slots.take(caller.who()).await) } else { None };
    let stepped = blocking(move || {
        let _slot = slot;
        let (member, done) = given.map_or(("action_code", done), |given| ("events", given));
        let mut log = episode.stored.log()?;
        let mut faults = Faults::new();
        let turn = log.turns.len() - 1;
        take_events(&limits, &mut log, (member, turn), &done, &mut EventBudget::whole(&limits), &mut faults);
        let blocks = end.standing().count();
        if blocks > episode.most_blocks {
            let most = episode.most_blocks;
            faults.add_at(member, format!("{blocks} blocks would stand; at most {most} are allowed"));
        }
        if !faults.is_empty() {
            return Err(AppError::faulty(faults));
        }
        let all = done.events.len();
        let stepped = StepDone {
            step: episode.row.step + 1,
            turn: episode.stored.turn,
            events: told(&done).take(LIMITS.episode_events).collect(),
            events_left_out: all.saturating_sub(LIMITS.episode_events),
            code: (member == "action_code").then(|| TurnReplay::of(episode.stored.turn, done)),
            position: end.position,
            blocks,
            view: view.map(|region| seen(&end, region)),
            picture: corner.map(|corner| picture(&end, corner)).transpose()?.map(|png| BASE64_STANDARD.encode(png)),
        };
        episode.stored.set_log(&log);
        episode.stored.world = end;
        if let Some(told) = &stepped.code {
            episode.stored.tell(told.clone());
        }
        let answer = serde_json::to_value(stepped).map_err(|error| AppError::internal(&error))?;
        Ok((episode, answer))
    });
    let (episode, answer) = stepped.await?;
    keep_step(app, caller, episode, new.step, LastStep { hash, answer }).await
}

/// Stores the next step of an episode, and returns its answer. `sent` is the number of the step in the request.
pub(super) async fn keep_step(
    app: &App,
    caller: &Caller,
    mut episode: Episode,
    sent: Option<i64>,
    last: LastStep,
) -> AppResult<Value> {
    let (id, step) = (episode.row.id.clone(), episode.row.step + 1);
    let (hash, answer) = (last.hash.clone(), last.answer.clone());
    episode.stored.last = Some(last);
    let state = blocking(move || episode.stored.packed()).await?;
    if app.store.advance_episode(&id, step, &state).await? {
        return Ok(answer);
    }
    // The same request may have been sent twice at the same time.
    let now = Episode::of_caller(app, caller, &id).await?;
    match now.repeated(sent, &hash) {
        Some(answer) => Ok(answer.clone()),
        None => Err(AppError::conflict("other-step", "another request made this step or submits the episode; read it")),
    }
}

/// Returns events as the world takes them: blocks by their ids alone, and air as a removal.
///
/// # Errors
/// Returns a fault for each block that the game does not have, and each cell that is outside of its world.
fn in_world(log: &BlockLog) -> AppResult<BlockLog> {
    let blocks: Vec<Option<Look>> = log.palette.names().map(|name| Look::read(name).ok()).collect();
    let mut faults = Faults::new();
    faults.enter_key("events");
    let mut taken = BlockLog { turns: vec![Vec::new()], ..BlockLog::default() };
    for (at, event) in log.turns.iter().flatten().enumerate() {
        faults.enter_index(at);
        let cell = event.cell();
        if !is_in_world(cell) {
            faults.add_at("y", format!("{}; the world reaches from {MIN_Y} to {MAX_Y}", cell.y));
        }
        match *event {
            Event::Remove { cell } => taken.remove(cell),
            Event::Place { cell, material } => match blocks[material as usize] {
                Some(look) if look.state.is_air() => taken.remove(cell),
                Some(look) => taken.place(cell, look.state.block().name),
                None => {
                    let name = log.palette.name(material);
                    faults.add_at("material", format!("{name:?} is not a block of Minecraft {GAME_VERSION}"));
                }
            },
        }
        faults.leave();
    }
    if faults.is_empty() { Ok(taken) } else { Err(AppError::faulty(faults)) }
}

/// Returns the SHA-256 of an operation and a body, in hex.
pub(super) fn hash_of(operation: &str, body: &[u8]) -> String {
    hex(&Sha256::new().chain_update(operation).chain_update([0]).chain_update(body).finalize())
}
