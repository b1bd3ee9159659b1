//! Replay of action code (`/v1/replay`): runs a script and returns the events that it records.

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};

use crate::actions::{CodeError, Dropped};
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::replay::{ReplayedEvent, replay, told};
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// Approximate size of an event in the response, in bytes, without the material's name.
const EVENT_BYTES: usize = 60;
/// Maximum size of a response, in bytes.
const ANSWER_BYTES: usize = 32 << 20;

/// Action code to run.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "action_code": "(async (bot) => { await skills.placeBlock(bot, 'stone', 0, 0, 0); })" }))]
pub struct NewReplay {
    /// JavaScript as agents of the mindcraft framework write it.
    action_code: String,
}

/// Result of running action code.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReplayBody {
    /// Blocks that the code placed and removed, in order.
    pub events: Vec<ReplayedEvent>,
    /// Calls that recorded nothing, by reason.
    pub dropped: Vec<Dropped>,
    /// Error that ended the code, or a rejection that nothing handled; events recorded before it count.
    pub error: Option<CodeError>,
    /// Notes for the author although nothing failed, for example that a function was defined but never called.
    pub notes: Vec<String>,
}

/// Runs action code against stand-ins and returns the blocks that it places and removes. Nothing is graded or stored. A
/// script that reaches a limit is refused, and the fault names the limit.
#[utoipa::path(
    post, path = "/v1/replay", operation_id = "replay_action_code", tag = "submissions", summary = "Run action code",
    request_body(content = NewReplay, content_type = "application/json"),
    responses(
        (status = 200, description = "The recorded events", body = ReplayBody,
         example = json!({ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }], "dropped": [],
                           "error": null, "notes": [] })),
    )
)]
pub async fn replay_action_code(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> AppResult<Json<ReplayBody>> {
    if caller.require(Scope::Grade).is_err() {
        caller.require(Scope::Submit)?;
    }
    let new: NewReplay = read_json(&body)?;
    let done = replay(&state, caller.who(), &new.action_code).await?;
    // Every event repeats its material's name, so the response may be much larger than the recording.
    let name = |event: &crate::actions::RecordedEvent| event.material.and_then(|i| done.palette.get(i as usize));
    let bytes: usize = done.events.iter().map(|event| EVENT_BYTES + name(event).map_or(0, String::len)).sum();
    if bytes > ANSWER_BYTES {
        let mut faults = Faults::new();
        faults.add_at("action_code", format!("its events take more than {ANSWER_BYTES} bytes in the response"));
        return Err(AppError::faulty(faults));
    }
    Ok(Json(ReplayBody { events: told(&done).collect(), dropped: done.dropped, error: done.error, notes: done.notes }))
}
