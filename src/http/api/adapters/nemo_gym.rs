//! NeMo Gym's resources server: `POST /verify`, and the session call before it, which needs nothing here.
//!
//! The request is that of `nemo_gym.base_resources_server`: `responses_create_params` and `response` (an OpenAI Responses
//! object), with what the dataset adds. The task is named by `task`, `suite` and `reward_scheme`, at the top or under
//! `verifier_metadata`. The answer repeats the request and adds `reward`, `reward_components` and `mask_sample`.

use axum::Json;
use axum::extract::State;
use serde_json::{Map, Value, json};

use super::super::super::body::JsonBody;
use super::super::super::caller::Caller;
use super::super::super::problem::{ApiError, ApiResult, Problem};
use super::super::super::state::AppState;
use super::{Judged, judge};
use crate::store::keys::Scope;
use crate::voxel::Faults;

/// Begin a session: nothing is kept between calls, so the answer is empty.
#[utoipa::path(
    post, path = "/seed_session", operation_id = "seed_session", tag = "rewards", summary = "NeMo Gym: begin a session",
    request_body(content = Object, content_type = "application/json"),
    responses(
        (status = 200, description = "An empty object", body = Object, example = json!({})),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn seed_session(caller: Caller) -> ApiResult<Json<Value>> {
    caller.require(Scope::Grade)?;
    Ok(Json(json!({})))
}

/// Grade what a model answered, as NeMo Gym asks a resources server. The block log is looked for in the last text of the
/// response: JSON, alone, in a code fence or among words. An answer without one that fits the task has reward 0; a failure of
/// ours is a problem, never a reward.
#[utoipa::path(
    post, path = "/verify", operation_id = "verify", tag = "rewards", summary = "NeMo Gym: verify a response",
    request_body(content = Object, content_type = "application/json", example = json!({
        "task": "walls/5x1x5-raise", "responses_create_params": { "input": "Raise a wall." },
        "response": { "output": [{ "type": "message", "role": "assistant",
            "content": [{ "type": "output_text", "text": "{\"events\": []}" }] }] } })),
    responses(
        (status = 200, description = "The request with its reward", body = Object,
         example = json!({ "reward": 1.0, "reward_components": { "overall": 1.0, "material": 1.0 }, "mask_sample": false })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not JSON by its type", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "No task, or none of this name", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
        (status = 504, description = "The deadline passed", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn verify(State(state): State<AppState>, caller: Caller, body: JsonBody) -> ApiResult<Json<Value>> {
    caller.require(Scope::Grade)?;
    let place = state.grader.admit().map_err(ApiError::without_reward)?;
    let catalogue = state.store.catalogue();
    let work = tokio::task::spawn_blocking(move || {
        let _place = place;
        let mut request = object(&body.bytes)?;
        let judged = judge(&state, &catalogue, &naming(&request), &answer_text(&request))?;
        request.insert("reward".to_owned(), judged.reward().into());
        request.insert("mask_sample".to_owned(), false.into());
        let components = match judged {
            Judged::Graded(graded) => serde_json::to_value(&graded.components),
            Judged::Unreadable(why) => {
                request.insert("failure_reason".to_owned(), why.into());
                Ok(json!({ "overall": 0.0 }))
            }
        };
        request.insert("reward_components".to_owned(), components.map_err(|error| ApiError::internal(&error))?);
        Ok(Json(Value::Object(request)))
    });
    work.await.map_err(|error| ApiError::internal(&error))?
}

fn object(text: &[u8]) -> ApiResult<Map<String, Value>> {
    let mut faults = Faults::new();
    match serde_json::from_slice(text) {
        Ok(Value::Object(request)) => Ok(request),
        Ok(_) => {
            faults.add("expected an object with response and task");
            Err(ApiError::faulty(faults))
        }
        Err(error) => {
            faults.add(error.to_string());
            Err(ApiError::malformed(faults))
        }
    }
}

/// How the task is named, at the top or among what the dataset keeps for the verifier.
fn naming(request: &Map<String, Value>) -> Value {
    let kept = request.get("verifier_metadata");
    let find = |key: &str| request.get(key).or_else(|| kept.and_then(|kept| kept.get(key))).cloned();
    json!({ "task": find("task"), "suite": find("suite"), "reward": find("reward_scheme") })
}

/// The text of the response's last message.
fn answer_text(request: &Map<String, Value>) -> String {
    let output = request.get("response").and_then(|response| response.get("output")).and_then(Value::as_array);
    let mut messages = output.into_iter().flatten().filter(|item| item["type"] == "message");
    let content = messages.next_back().and_then(|message| message["content"].as_array());
    content.into_iter().flatten().filter_map(|part| part["text"].as_str()).collect()
}
