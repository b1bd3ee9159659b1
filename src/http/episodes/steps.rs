//! Steps of episodes, and the way to the next turn.

use axum::Json;
use axum::extract::{Path, State};
use serde_json::Value;

use super::resource::EpisodeBody;
use crate::app::access::Caller;
use crate::app::episodes::body::{NewStep, NextTurn};
use crate::app::episodes::step::{StepDone, make_step};
use crate::app::episodes::turns;
use crate::app::error::AppResult;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;

/// Makes a step.
///
/// The service runs code, or applies events, in the world as it stands, and returns what happened. An error in the
/// code is not an error of the request: what was built before it stays. A step that reaches a limit is refused and
/// changes nothing.
///
/// With `step`, the number of the step, a request may be repeated: the step is made once, and the last response is
/// given again.
#[utoipa::path(
    post, path = "/v1/episodes/{id}/steps", operation_id = "step_episode", tag = "episodes", summary = "Make a step",
    params(("id" = String, Path, description = "The episode's id")),
    request_body(content = NewStep, content_type = "application/json"),
    responses(
        (status = 200, description = "What happened; the step is durable", body = StepDone,
         example = json!({ "step": 1, "turn": 1,
                           "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }],
                           "events_left_out": 0, "code": { "turn": 1, "events": 1 }, "position": [0.0, 0.0, 0.0],
                           "blocks": 1, "view": null, "picture": null })),
        (status = 409, description = "The episode has ended, or its next step has another number"),
    )
)]
pub async fn step_episode(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<Value>> {
    caller.require(Scope::Submit)?;
    let draft = read_draft::<NewStep>(&body, "make one step per request")?;
    Ok(Json(make_step(&state, &caller, &id, &body.bytes, draft).await?))
}

/// Goes on to the next turn.
///
/// The response has its instruction. This counts as a step. The body is optional.
#[utoipa::path(
    post, path = "/v1/episodes/{id}/next-turn", operation_id = "next_turn", tag = "episodes", summary = "Go on to the next turn",
    params(("id" = String, Path, description = "The episode's id")),
    request_body(content = Option<NextTurn>, content_type = "application/json"),
    responses(
        (status = 200, description = "The episode, in the next turn", body = EpisodeBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000004", "state": "open", "turn": 2, "turns": 3, "step": 2,
                           "prompt": "Build …" })),
        (status = 409, description = "The episode has ended, is in its last turn, or its next step has another number"),
    )
)]
pub async fn next_turn(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: Option<JsonBody>,
) -> AppResult<Json<EpisodeBody>> {
    caller.require(Scope::Submit)?;
    let draft = match &body {
        Some(body) if !body.is_null() => read_draft::<NextTurn>(body, "go on once per request")?,
        _ => (Some(NextTurn::default()), Faults::new()),
    };
    let bytes = body.as_ref().map(|body| &body.bytes[..]).unwrap_or_default();
    Ok(Json(turns::next_turn(&state, &caller, &id, bytes, draft).await?.into()))
}
