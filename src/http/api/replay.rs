//! Action code in, events out: `/v1/replay`, and the turns of submissions that bring code.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};

use super::submission_body::PostedSubmission;
use super::submission_schema::EventAction;
use crate::actions::{CodeError, Dropped, Replayed};
use crate::fair::Place;
use crate::http::body::{JsonBody, read_json};
use crate::http::caller::Caller;
use crate::http::problem::{ApiError, ApiResult, Problem};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::{SentLog, without_fences};
use plumbline_engine::voxel::{BlockLog, Cell};

/// Bytes of an event in an answer, about, without the material's name.
const EVENT_BYTES: usize = 60;
/// Bytes of an answer at most.
const ANSWER_BYTES: usize = 32 << 20;

/// Code to replay.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "action_code": "(async (bot) => { await skills.placeBlock(bot, 'stone', 0, 0, 0); })" }))]
pub struct NewReplay {
    /// JavaScript as agents of the mindcraft framework write it.
    action_code: String,
}

/// An event that code recorded.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReplayedEvent {
    /// `place` or `remove`.
    #[schema(value_type = EventAction, example = "place")]
    pub action: &'static str,
    /// East.
    pub x: i32,
    /// Up.
    pub y: i32,
    /// South.
    pub z: i32,
    /// The material, where one is placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
}

/// What code did.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReplayBody {
    /// What it placed and removed, in order.
    pub events: Vec<ReplayedEvent>,
    /// Calls that recorded nothing, by reason.
    pub dropped: Vec<Dropped>,
    /// The error that ended it, or that nobody waited for; what came before it counts.
    pub error: Option<CodeError>,
    /// What its author may want to know although nothing failed, such as that a function was defined and never called.
    pub notes: Vec<String>,
}

/// What the code of a submission's turn did.
#[derive(Debug, Clone, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TurnReplay {
    /// The turn, from 1.
    pub turn: usize,
    /// Events that it recorded.
    pub events: usize,
    /// Calls that recorded nothing, by reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// The error that ended it, or that nobody waited for; what came before it counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<CodeError>,
    /// What its author may want to know although nothing failed, such as that a function was defined and never called.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Whether the code is not JavaScript, so that none of it was run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unreadable: bool,
}

/// A place among the requests whose code runs or waits.
///
/// # Errors
/// 429 where there is none.
pub fn place(state: &AppState, who: &Arc<str>) -> ApiResult<Place> {
    state
        .action_requests
        .take(who)
        .map_err(|_| ApiError::too_many("much action code is waiting to be run; come back in a moment"))
}

async fn replayed(state: &AppState, who: &Arc<str>, code: &str) -> ApiResult<Replayed> {
    state.actions.run(code, who).await.map_err(|error| ApiError::internal(&error))
}

/// The events of a script as they are told.
pub fn told(done: &Replayed) -> impl Iterator<Item = ReplayedEvent> {
    done.events.iter().map(|event| {
        let [x, y, z] = event.cell;
        let material = event.material.and_then(|index| done.palette.get(index as usize)).cloned();
        ReplayedEvent { action: if material.is_some() { "place" } else { "remove" }, x, y, z, material }
    })
}

fn add_too_long(code: &str, state: &AppState, faults: &mut Faults) -> bool {
    let most = state.limits.action_code_bytes;
    let is_too_long = code.len() > most;
    if is_too_long {
        faults.add_at("action_code", format!("{} bytes; at most {most} are allowed", code.len()));
    }
    is_too_long
}

fn add_stopped(replayed: &Replayed, faults: &mut Faults) -> bool {
    if let Some(stopped) = &replayed.stopped {
        faults.add_at("action_code", format!("stopped at a limit ({}): {}", stopped.limit, stopped.detail));
    }
    replayed.stopped.is_some()
}

/// Run action code against stand-ins and get what it places and removes. Nothing is graded or stored. A script that reaches a limit
/// is refused, with what it reached.
#[utoipa::path(
    post, path = "/v1/replay", operation_id = "replay_action_code", tag = "submissions", summary = "Run action code",
    request_body(content = NewReplay, content_type = "application/json"),
    responses(
        (status = 200, description = "What it did", body = ReplayBody,
         example = json!({ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }], "dropped": [],
                           "error": null, "notes": [] })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not JSON by its type", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A fault, or a limit that the code reached", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn replay_action_code(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> ApiResult<Json<ReplayBody>> {
    if caller.require(Scope::Grade).is_err() {
        caller.require(Scope::Submit)?;
    }
    let new: NewReplay = read_json(&body)?;
    let mut faults = Faults::new();
    if add_too_long(&new.action_code, &state, &mut faults) {
        return Err(ApiError::faulty(faults));
    }
    let _place = place(&state, caller.who())?;
    let done = replayed(&state, caller.who(), &without_fences(&new.action_code)).await?;
    if add_stopped(&done, &mut faults) {
        return Err(ApiError::faulty(faults));
    }
    // Names are repeated with every event: an answer may be much larger than what was recorded.
    let name = |event: &crate::actions::RecordedEvent| event.material.and_then(|i| done.palette.get(i as usize));
    let bytes: usize = done.events.iter().map(|event| EVENT_BYTES + name(event).map_or(0, String::len)).sum();
    if bytes > ANSWER_BYTES {
        faults.add_at("action_code", format!("its events take more than {ANSWER_BYTES} bytes to tell"));
        return Err(ApiError::faulty(faults));
    }
    Ok(Json(ReplayBody { events: told(&done).collect(), dropped: done.dropped, error: done.error, notes: done.notes }))
}

/// Events that the code of one body may still record.
#[derive(Debug)]
pub struct EventBudget {
    left: usize,
}

impl EventBudget {
    /// All of them.
    #[must_use]
    pub fn whole(state: &AppState) -> Self {
        Self { left: state.limits.action_body_events }
    }
}

/// Runs the code of submissions, and puts what it recorded into their logs. What reaches a limit is a fault.
///
/// # Errors
/// 429 where too much waits; 500 where code cannot be run.
pub async fn run_codes(
    state: &AppState,
    who: &Arc<str>,
    posted: &mut [PostedSubmission],
    faults: &mut Faults,
) -> ApiResult<()> {
    if posted.iter().all(|submission| submission.sent.codes.is_empty()) {
        return Ok(());
    }
    let _place = place(state, who)?;
    let mut budget = EventBudget::whole(state);
    for submission in posted {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        submission.replays = run_sent(state, who, &mut submission.sent, &mut budget, faults).await?;
        if !faults.is_empty() {
            break;
        }
    }
    Ok(())
}

/// Runs the code of one log, and puts what it recorded into it. Nothing more is run after a fault.
///
/// # Errors
/// 500 where code cannot be run.
pub async fn run_sent(
    state: &AppState,
    who: &Arc<str>,
    sent: &mut SentLog,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> ApiResult<Vec<TurnReplay>> {
    let codes = std::mem::take(&mut sent.codes);
    let mut replays = Vec::with_capacity(codes.len());
    faults.enter_key("turns");
    let mut is_too_long = false;
    for code in &codes {
        faults.enter_index(code.turn);
        is_too_long |= add_too_long(&code.code, state, faults);
        faults.leave();
    }
    if !is_too_long {
        // One after another: what all of them record at the same time might not fit into memory.
        for code in &codes {
            let done = replayed(state, who, &code.code).await?;
            faults.enter_index(code.turn);
            let is_taken = take_events(state, &mut sent.log, code.turn, &done, budget, faults);
            faults.leave();
            if !is_taken {
                break;
            }
            let Replayed { events, dropped, error, notes, unreadable, .. } = done;
            let (turn, events) = (code.turn + 1, events.len());
            replays.push(TurnReplay { turn, events, dropped, error, notes, unreadable });
        }
    }
    faults.leave();
    Ok(replays)
}

/// Puts what a script recorded into its turn. False where it reached a limit, which is a fault.
fn take_events(
    state: &AppState,
    log: &mut BlockLog,
    turn: usize,
    done: &Replayed,
    budget: &mut EventBudget,
    faults: &mut Faults,
) -> bool {
    if add_stopped(done, faults) {
        return false;
    }
    let (events, limits) = (done.events.len(), &state.limits);
    if log.event_count() + events > limits.events {
        faults.add_at("action_code", format!("more than {} events in the log", limits.events));
        return false;
    }
    if events > budget.left {
        let most = limits.action_body_events;
        let detail = format!("the code of this body recorded more than {most} events; send it in parts");
        faults.add_at("action_code", detail);
        return false;
    }
    budget.left -= events;
    for event in &done.events {
        let [x, y, z] = event.cell;
        let material = event.material.and_then(|index| done.palette.get(index as usize));
        log.add_event(turn, Cell { x, y, z }, material.map(String::as_str));
    }
    if log.palette.len() > limits.materials {
        faults.add_at("action_code", format!("more than {} different materials in the log", limits.materials));
        return false;
    }
    true
}
