//! NeMo Gym's resources server: `POST /verify`, and the calls around it, for which the service keeps no state.
//!
//! Requests are those of `nemo_gym.base_resources_server` up to 0.7: flat (`responses_create_params`, `response` and
//! the dataset's members), or nested (`episode_id`, `task_id`, `verification_input`). The members `task`, `suite` and
//! `reward_scheme` name the task, at the top level or under `verifier_metadata`, `task_data` or `verification_input`.
//! The response to a flat request repeats the request.

use std::time::Instant;

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use serde::de::DeserializeSeed as _;
use serde_json::value::RawValue;
use serde_json::{Map, Value, json};

use super::nemo_naming::{Naming, is_told, naming};
use crate::actions::turn_replay::TurnReplay;
use crate::app::access::Caller;
use crate::app::body::free::{FreeJson, Room};
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::rewards::judge::judge;
use crate::app::rewards::scheme::SchemeBody;
use crate::app::task_ref::TaskRef;
use crate::http::extract::body::JsonBody;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::grading::reward::RewardComponents;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::not_json::why_not_json;
use plumbline_engine::voxel::Profile;

/// Members of a response that the framework reads, next to the members of the request.
#[derive(Debug, serde::Serialize, utoipa::ToSchema)]
pub struct VerifyAnswer {
    /// Reward.
    #[schema(minimum = 0, maximum = 1)]
    reward: f64,
    /// Whether to leave the sample out, because the generation of the response failed, was cancelled or is not over. A
    /// failure of the service is reported as a problem instead.
    mask_sample: bool,
    /// Components of the reward.
    reward_components: RewardComponents,
    /// Results of the action code, if the model wrote any.
    action_code: Option<Vec<TurnReplay>>,
    /// Reason why nothing could be graded.
    failure_reason: Option<String>,
}

/// A request to verify, with the members that are read.
// For the contract only: a request has members of its dataset as well, and its response repeats them all, so it stays
// the object that was sent.
#[derive(Debug, utoipa::ToSchema)]
pub struct VerifyRequest {
    /// The task: its id or its number. It may also be under `verifier_metadata`.
    pub task: Option<TaskRef>,
    /// Suite of the task.
    pub suite: Option<String>,
    /// Rules under which the answer becomes a build. They may also be under `verifier_metadata`.
    pub profile: Option<Profile>,
    /// Reward scheme.
    pub reward_scheme: Option<SchemeBody>,
    /// Data that the dataset holds for the verifier.
    #[schema(value_type = Option<Object>)]
    pub verifier_metadata: Option<Value>,
    /// Request to the model.
    #[schema(value_type = Option<Object>)]
    pub responses_create_params: Option<Value>,
    /// Response of the model: an object of the Responses API.
    #[schema(value_type = Option<Object>)]
    pub response: Option<Value>,
}

/// A request that begins or ends a session, with the member that is read.
#[derive(Debug, utoipa::ToSchema)]
pub struct SessionRequest {
    /// Identifier of the session, which newer versions of the framework send.
    pub resources_session_id: Option<String>,
}

impl SessionRequest {
    /// Reads the member from a body, which may be empty, and keeps nothing else of it. An identifier that is not text
    /// counts as absent.
    fn read(text: &[u8]) -> AppResult<Self> {
        #[derive(Deserialize)]
        struct Members<'a> {
            #[serde(borrow)]
            resources_session_id: Option<&'a RawValue>,
        }
        let mut faults = Faults::new();
        if !text.is_empty() && !text.trim_ascii_start().starts_with(b"{") {
            faults.add("expected an object");
            return Err(AppError::faulty(faults));
        }
        let read =
            if text.is_empty() { Ok(Members { resources_session_id: None }) } else { serde_json::from_slice(text) };
        match read {
            Ok(Members { resources_session_id: id }) => {
                let id = id.and_then(|id| serde_json::from_str(id.get()).ok());
                Ok(Self { resources_session_id: id })
            }
            Err(error) => {
                faults.add(why_not_json(text, &error));
                Err(AppError::malformed(faults))
            }
        }
    }
}

/// Response to a request that begins or ends a session.
#[derive(Debug, serde::Serialize, utoipa::ToSchema)]
pub struct SessionAnswer {
    /// Identifier of the session, if the request had one.
    resources_session_id: Option<String>,
}

/// Begins a session.
///
/// Nothing is kept between calls, so the response only repeats the session's id, if the request has one.
#[utoipa::path(
    post, path = "/seed_session", operation_id = "seed_session", tag = "rewards", summary = "NeMo Gym: begin a session",
    request_body(content = SessionRequest, content_type = "application/json"),
    responses(
        (status = 200, description = "The session's id, or an empty object", body = SessionAnswer, example = json!({})),
    )
)]
pub async fn seed_session(caller: Caller, body: JsonBody) -> AppResult<Response> {
    caller.require(Scope::Grade)?;
    session(&body)
}

/// Ends a session.
///
/// Nothing was kept, so it may end more than once, or without having begun.
#[utoipa::path(
    post, path = "/close_session", operation_id = "close_session", tag = "rewards", summary = "NeMo Gym: end a session",
    request_body(content = SessionRequest, content_type = "application/json"),
    responses(
        (status = 200, description = "The session's id, or an empty object", body = SessionAnswer, example = json!({})),
    )
)]
pub async fn close_session(caller: Caller, body: JsonBody) -> AppResult<Response> {
    caller.require(Scope::Grade)?;
    session(&body)
}

fn session(body: &JsonBody) -> AppResult<Response> {
    let SessionRequest { resources_session_id: Some(id) } = SessionRequest::read(&body.bytes)? else {
        return Ok(Json(json!({})).into_response());
    };
    // The framework requires a cookie; its value is not used.
    let cookie = [(header::SET_COOKIE, "plumbline_session=stateless; Path=/; HttpOnly; SameSite=Lax")];
    Ok((cookie, Json(json!({ "resources_session_id": id }))).into_response())
}

/// Returns whether a response may be verified again.
///
/// A response may be verified again, with the same result.
#[utoipa::path(
    get, path = "/reverify_mode", operation_id = "reverify_mode", tag = "rewards", summary = "NeMo Gym: get reverification mode",
    responses(
        (status = 200, description = "The mode", body = String, content_type = "application/json", example = json!("stateless")),
    )
)]
pub async fn reverify_mode() -> Json<&'static str> {
    Json("stateless")
}

/// Grades a model's response, as NeMo Gym requests it from a resources server.
///
/// The last complete answer in the assistant's messages counts: a block log as JSON, or action code. If the task has
/// several turns, the last messages with an answer give one turn each. An answer that cannot be graded has reward 0
/// and a `failure_reason`; a failure of the service is a problem, never a reward. The criteria are also at the top
/// level (`reward_material`, …), where the framework averages them.
#[utoipa::path(
    post, path = "/verify", operation_id = "verify", tag = "rewards", summary = "NeMo Gym: verify a response",
    request_body(content = VerifyRequest, content_type = "application/json", example = json!({
        "task": "walls/5x1x5-raise", "responses_create_params": { "input": "Raise a wall." },
        "response": { "output": [{ "type": "message", "role": "assistant",
            "content": [{ "type": "output_text", "text": "{\"events\": []}" }] }] } })),
    responses(
        (status = 200, description = "The request with its reward; a nested request is not repeated", body = VerifyAnswer,
         example = json!({ "reward": 1.0, "reward_components": { "overall": 1.0, "material": 1.0 }, "reward_overall": 1.0,
                           "reward_material": 1.0, "mask_sample": false })),
        (status = 504, description = "The deadline passed"),
    )
)]
pub async fn verify(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Json<Value>> {
    caller.require(Scope::Grade)?;
    let (begun, who) = (Instant::now(), caller.who());
    let permit = state.grader.admit(who).map_err(AppError::without_reward)?;
    let room = state.free_json.wait_for(body.bytes.clone(), who, begun).await?;
    let reading = tokio::task::spawn_blocking(move || {
        // Held until the work ends, also if the sender no longer waits.
        let held = (permit, room);
        let request = object(&body.bytes)?;
        let (naming, why_none) = (naming(&request)?, why_none(&request));
        let texts = if why_none.is_some() { vec![String::new()] } else { texts(&request)? };
        AppResult::Ok((request, naming, texts, why_none, (body.share, held)))
    });
    let (request, naming, texts, why_none, _held) = reading.await.map_err(|error| AppError::internal(&error))??;
    let Naming { members: naming, places } = naming;
    if let Some(suite) = naming.get("suite").and_then(Value::as_str) {
        // Another process may have added it.
        state.find_suite(suite).await?;
    }
    let places: Vec<(&str, &str)> = places.iter().map(|(inner, outer)| (inner.as_str(), outer.as_str())).collect();
    let graded = judge(&state, who, &state.catalogue(), naming, texts).await;
    let graded = graded.map_err(|error| error.named(&places))?;
    // A nested request is not repeated, because there the framework refuses members that it does not know.
    let mut answer = if request.contains_key("verification_input") { Map::new() } else { request };
    // What an earlier response said does not hold for this one.
    answer.retain(|key, _| !is_told(key));
    answer.insert("reward".to_owned(), graded.reward.into());
    answer.insert("mask_sample".to_owned(), why_none.is_some().into());
    let components = serde_json::to_value(&graded.components).map_err(|error| AppError::internal(&error))?;
    for (name, value) in components.as_object().into_iter().flatten() {
        answer.insert(format!("reward_{name}"), value.clone());
    }
    answer.insert("reward_components".to_owned(), components);
    if !graded.action_code.is_empty() {
        let told = serde_json::to_value(&graded.action_code).map_err(|error| AppError::internal(&error))?;
        answer.insert("action_code".to_owned(), told);
    }
    if let Some(why) = why_none.or_else(|| graded.answer.and_then(|found| found.why)) {
        answer.insert("failure_reason".to_owned(), why.into());
    }
    Ok(Json(Value::Object(answer)))
}

pub(super) fn object(text: &[u8]) -> AppResult<Map<String, Value>> {
    let (mut faults, mut room) = (Faults::new(), Room::of_body());
    let mut document = serde_json::Deserializer::from_slice(text);
    let read = FreeJson(&mut room).deserialize(&mut document);
    match read.and_then(|value| document.end().map(|()| value)) {
        Ok(Value::Object(request)) if room.fault().is_none() => Ok(request),
        Ok(_) => {
            faults.add(room.fault().unwrap_or_else(|| "expected an object".to_owned()));
            Err(AppError::faulty(faults))
        }
        Err(error) => {
            faults.add(why_not_json(text, &error));
            Err(AppError::malformed(faults))
        }
    }
}

/// Returns why a response is none that a model gave: its generation failed, was cancelled or is not over. What is cut
/// off because it is too long is `incomplete`, and graded.
fn why_none(request: &Map<String, Value>) -> Option<String> {
    let response = request.get("response").or_else(|| request.get("verification_input")?.get("response"))?;
    let status = response.get("status")?.as_str()?;
    if !["failed", "cancelled", "in_progress", "queued"].contains(&status) {
        return None;
    }
    let code = response.get("error").and_then(|error| error.get("code")).and_then(Value::as_str);
    let code = code.map(|code| format!(" ({})", code.chars().take(LIMITS.material_chars).collect::<String>()));
    let code = code.unwrap_or_default();
    Some(format!("the model gave no response: its status is {status}{code}, so the sample is to be left out"))
}

/// Returns the texts of the assistant's messages, in order, from a Responses object or a chat completion.
///
/// # Errors
/// Returns an error (422) if no texts can be read: then the trainer is misconfigured, and the model is not to blame.
fn texts(request: &Map<String, Value>) -> AppResult<Vec<String>> {
    let response = request.get("response").or_else(|| request.get("verification_input")?.get("response"));
    let wrong = |place: &str, what: &str| {
        let mut faults = Faults::new();
        faults.enter_key("response");
        if place.is_empty() {
            faults.add(what);
        } else {
            faults.add_at(place, what);
        }
        AppError::faulty(faults)
    };
    let Some(response) = response.filter(|response| response.is_object()) else {
        return Err(wrong("", "expected the model's response: an object of the Responses API, with an array output"));
    };
    if let Some(choices) = response.get("choices").and_then(Value::as_array) {
        return Ok(choices.iter().take(1).map(|choice| content_of(&choice["message"])).collect());
    }
    let Some(output) = response.get("output").and_then(Value::as_array) else {
        let text = response.get("output_text").and_then(Value::as_str);
        return text.map(|text| vec![text.to_owned()]).ok_or_else(|| wrong("output", "expected an array of items"));
    };
    let is_said = |item: &&Value| {
        let kind = item.get("type").and_then(Value::as_str);
        let role = item.get("role").and_then(Value::as_str);
        kind.is_none_or(|kind| kind == "message") && role.is_none_or(|role| role == "assistant")
    };
    let texts: Vec<String> = output.iter().filter(is_said).map(content_of).collect();
    // A model may end without a message, after tool calls or reasoning.
    Ok(if texts.is_empty() { vec![String::new()] } else { texts })
}

/// Returns the text of a message, whose content is a string or a list of parts.
fn content_of(message: &Value) -> String {
    match &message["content"] {
        Value::String(text) => text.clone(),
        parts => parts.as_array().into_iter().flatten().filter_map(|part| part["text"].as_str()).collect(),
    }
}
