//! OpenRLHF's remote reward model: `query`, `prompts` and `labels` in, `rewards`, `scores` and `extra_logs` out.
//!
//! Each text of `query` holds a prompt and the answer to it. A label names the task: its id, its number, or JSON with
//! `task`, `suite` and `reward`. The trainer turns the response into tensors, so every list has a number for every
//! sample, even for one that could not be graded.

use std::time::Instant;

use axum::Json;
use axum::extract::State;
use futures_util::{StreamExt as _, TryStreamExt as _, stream};
use serde::de::{DeserializeSeed as _, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use super::add_misspelt;
use super::prompt::without_prompt;
use crate::actions::turn_replay::TurnReplay;
use crate::app::access::Caller;
use crate::app::body::free::{FreeJson, Room};
use crate::app::error::{AppError, AppResult, FaultBody, Kind};
use crate::app::limits::LIMITS;
use crate::app::rewards::in_time::graded_in_time;
use crate::app::rewards::judge::judge;
use crate::app::rewards::score::GradeBody;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::surrogates::without_lone_surrogates;
use plumbline_engine::intake::text::thinking::{opened_at_the_end, with_opening};
use plumbline_engine::text::{agreeing, counted};

/// Members of a label that are read.
const OPTIONS: [&str; 4] = ["task", "suite", "reward", "profile"];
/// Number of samples of a request that are graded or wait at the same time.
const AT_ONCE: usize = 8;

/// Request from OpenRLHF.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(example = json!({ "query": ["Raise a wall.{\"events\": []}"], "prompts": ["Raise a wall."], "labels": ["walls/5x1x5-raise"] }))]
pub struct RewardQuery {
    /// Prompt and answer of each sample; null is an empty answer.
    pub query: Vec<Option<String>>,
    /// Prompt of each sample, which is removed from the query.
    #[serde(default)]
    pub prompts: Option<Vec<Option<String>>>,
    /// The task of each sample: its id, its number, or JSON with `task`, `suite`, `reward` and `profile`, as an object
    /// or as text.
    #[schema(value_type = Vec<LabelBody>)]
    #[serde(deserialize_with = "labels")]
    pub labels: Vec<Value>,
}

/// Reads the labels of a request.
fn labels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Value>, D::Error> {
    let mut room = Room::of_body();
    let labels = FreeJson(&mut room).deserialize(deserializer)?;
    match (labels, room.fault()) {
        (_, Some(why)) => Err(D::Error::custom(why)),
        (Value::Array(labels), None) => Ok(labels),
        _ => Err(D::Error::custom("expected an array of labels")),
    }
}

/// Label of a sample, which names its task.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum LabelBody {
    /// Identifier of the task, or JSON as text.
    Text(String),
    /// Number of the task.
    Number(u32),
    /// Task, suite, reward and profile, as `/v1/grade` accepts them.
    #[schema(value_type = Object)]
    Whole(Map<String, Value>),
}

/// Response to OpenRLHF.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
pub struct Rewards {
    /// Reward of each sample; 0 if it could not be graded.
    pub rewards: Vec<f64>,
    /// 1 if the sample passes, else 0; for filtering.
    pub scores: Vec<f64>,
    /// Values to log, one per sample.
    pub extra_logs: ExtraLogs,
    /// Samples that could not be graded, and those whose code ended with an error or built nothing, with the reason.
    pub problems: Vec<SampleProblem>,
}

/// Values to log for each sample.
#[derive(Debug, Default, Serialize, utoipa::ToSchema)]
pub struct ExtraLogs {
    /// 1 if the problem passes, else 0.
    pub overall: Vec<f64>,
    /// Mean over the criteria that apply; 0 if there is no log.
    pub criteria_mean: Vec<f64>,
    /// 1 if the answer has a log or code that fits the task, else 0.
    pub readable: Vec<f64>,
    /// 1 if the label is faulty, for example names no task: a fault of the dataset, not of the model; else 0.
    pub mislabelled: Vec<f64>,
}

/// Reason why a sample could not be graded, the error that ended its code, or the reason why its code built nothing.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct SampleProblem {
    /// Index of the sample, from 0.
    pub index: usize,
    /// Description of the problem.
    pub detail: String,
    /// Faults of the label.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultBody>,
}

/// Grades a model's answers, as OpenRLHF requests it from a remote reward model.
///
/// An answer that cannot be graded has reward 0, and so has a sample whose label names no task; `problems` gives the
/// reason. If all labels are wrong, the request is refused. If the service fails to grade one of the samples, the
/// whole request fails with a retryable problem, never a reward.
#[utoipa::path(
    post, path = "/get_reward", operation_id = "get_reward", tag = "rewards", summary = "OpenRLHF: reward samples",
    request_body(content = RewardQuery, content_type = "application/json"),
    responses(
        (status = 200, description = "Rewards in the order of the samples", body = Rewards,
         example = json!({ "rewards": [1.0], "scores": [1.0],
                           "extra_logs": { "overall": [1.0], "criteria_mean": [1.0], "readable": [1.0], "mislabelled": [0.0] },
                           "problems": [] })),
        (status = 504, description = "A deadline passed"),
    )
)]
pub async fn get_reward(State(state): State<AppState>, caller: Caller, body: JsonBody) -> AppResult<Json<Rewards>> {
    caller.require(Scope::Grade)?;
    let (begun, who) = (Instant::now(), caller.who());
    let catalogue = state.current_catalogue().await?;
    let room = state.free_json.wait_for(body.bytes.clone(), who, begun).await?;
    let reading = tokio::task::spawn_blocking(move || read(&body).map(|query| (query, (body.share, room))));
    let (query, _held) = reading.await.map_err(|error| AppError::internal(&error))??;
    // The trainer sends each sample by itself, all of a step at once, and gives up after a few refusals.
    let is_small = query.query.len() <= AT_ONCE;
    let permit = if is_small { state.grader.admit(who) } else { state.grader.admit_batch(who) };
    let _permit = permit.map_err(AppError::without_reward)?;
    let judge_one = async |i: usize| {
        let prompt = query.prompts.as_ref().and_then(|prompts| prompts.get(i)?.as_deref());
        let whole = query.query[i].as_deref().unwrap_or_default();
        let answer = without_prompt(whole, prompt.unwrap_or_default());
        let is_whole =
            prompt.is_some_and(|prompt| !prompt.is_empty()) && !whole.is_empty() && answer.len() == whole.len();
        // Templates of thinking models open the thought in the prompt, and an answer that is cut off never closes it.
        let opened = prompt.and_then(opened_at_the_end).filter(|_| !is_whole).unwrap_or_default();
        let answer = with_opening(opened, answer);
        let graded = match naming(&query.labels[i]) {
            Ok(naming) => judge(&state, who, &catalogue, naming, vec![answer]).await,
            Err(error) => Err(error),
        };
        match graded {
            Ok(graded) => Ok(Ok((graded, is_whole))),
            Err(error) if !error.is_ours() => Ok(Err(error.at(&format!("/labels/{i}")))),
            Err(error) => Err(error),
        }
    };
    // If the client disconnects, or the service fails on one sample, the work on the others ends with this request.
    let judging = stream::iter(0..query.query.len()).map(judge_one).buffered(AT_ONCE).try_collect();
    let judged: Vec<Judged> = graded_in_time(begun, judging).await.map_err(AppError::without_reward_where_ours)?;
    answer(judged)
}

/// Added to the problem of an answer that may hold its prompt.
const NOT_THE_PROMPT: &str = "; the query does not begin with its prompt, so all of it was read as the answer";

/// Grade of a sample, and whether its prompt could not be told from its answer; or the error in its label.
type Judged = Result<(GradeBody, bool), AppError>;

fn read(body: &JsonBody) -> AppResult<RewardQuery> {
    let query: RewardQuery = read_json(body)?;
    let mut faults = Faults::new();
    let samples = query.query.len();
    if query.labels.len() != samples {
        faults.add_at("labels", format!("{} for {}", counted(query.labels.len(), "label"), counted(samples, "sample")));
    }
    if let Some(prompts) = &query.prompts
        && !prompts.is_empty()
        && prompts.len() != samples
    {
        faults.add_at("prompts", format!("{} for {}", counted(prompts.len(), "prompt"), counted(samples, "sample")));
    }
    if samples > LIMITS.grade_batch_logs {
        faults.add_at("query", format!("{samples} samples; at most {} are allowed", LIMITS.grade_batch_logs));
    }
    if faults.is_empty() { Ok(query) } else { Err(AppError::faulty(faults)) }
}

/// Reads a label, which is JSON or the bare name of a task, as the members that name the task.
///
/// # Errors
/// Returns an error (422) if the label is empty or an option is misspelt.
fn naming(label: &Value) -> AppResult<Map<String, Value>> {
    let parsed = label.as_str().map(read_label).transpose()?.flatten();
    let mut object = match (label, parsed) {
        (Value::Object(naming), _) => naming.clone(),
        (_, Some(Value::Object(naming))) => naming,
        (_, Some(number @ Value::Number(_))) => [("task".to_owned(), number)].into_iter().collect(),
        (Value::Null, _) => return Err(no_task()),
        (Value::String(text), _) if text.trim().is_empty() => return Err(no_task()),
        (task, _) => [("task".to_owned(), task.clone())].into_iter().collect(),
    };
    // Data sets for other frameworks call the reward's scheme otherwise.
    for other in ["scheme", "reward_scheme"] {
        if object.get("reward").is_none_or(Value::is_null)
            && let Some(scheme) = object.remove(other)
        {
            object.insert("reward".to_owned(), scheme);
        }
    }
    let missing: Vec<&str> = OPTIONS.into_iter().filter(|option| !object.contains_key(*option)).collect();
    let mut faults = Faults::new();
    for key in object.keys().filter(|key| key.starts_with("reward_sche") && *key != "reward_scheme") {
        faults.add_at(key, "unknown; did you mean reward_scheme?");
    }
    for other in ["scheme", "reward_scheme"] {
        let given = object.get(other).filter(|scheme| !scheme.is_null());
        if given.is_some_and(|scheme| object.get("reward") != Some(scheme)) {
            faults.add_at(other, "another scheme than that of reward; give one");
        }
    }
    // Either name of the scheme may be misspelt.
    let schemes: &[&str] = if missing.contains(&"reward") { &["scheme"] } else { &[] };
    let names: Vec<&str> = missing.iter().chain(schemes).copied().collect();
    add_misspelt(&object, &names, &mut faults);
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    // Other members of a label belong to the dataset.
    Ok(object.into_iter().filter(|(key, _)| OPTIONS.contains(&key.as_str())).collect())
}

/// Reads a label that is JSON as text; `None` if it is no JSON.
///
/// # Errors
/// Returns an error (422) if it is too large for a label.
fn read_label(text: &str) -> AppResult<Option<Value>> {
    let mut room = Room::of_member();
    let text = without_lone_surrogates(text.as_bytes());
    let mut document = serde_json::Deserializer::from_slice(&text);
    let read = FreeJson(&mut room).deserialize(&mut document);
    let read = read.and_then(|value| document.end().map(|()| value)).ok();
    match room.fault() {
        None => Ok(read),
        Some(why) => {
            let mut faults = Faults::new();
            faults.add(why);
            Err(AppError::faulty(faults))
        }
    }
}

/// Creates the error (422) for an empty label, which trainers send if their label column is not configured.
fn no_task() -> AppError {
    let mut faults = Faults::new();
    faults.add("empty: a label names a task by its id, by its number, or as JSON with task, suite, reward and profile");
    AppError::faulty(faults)
}

/// Collects the rewards of all samples.
///
/// # Errors
/// Returns the faults of all labels if none of them names a task.
fn answer(judged: Vec<Judged>) -> AppResult<Json<Rewards>> {
    let mut rewards = Rewards::default();
    if !judged.is_empty() && judged.iter().all(Result::is_err) {
        return Err(joined(judged.into_iter().filter_map(Result::err).collect()));
    }
    for (index, one) in judged.into_iter().enumerate() {
        let (reward, overall, mean, is_readable, problem) = match one {
            Ok((graded, is_whole)) => {
                // Starts from 0.0 because the `sum` of nothing is negative zero.
                let sum = graded.criteria.iter().fold(0.0, |sum, criterion| sum + criterion.mean);
                let mean = sum / graded.criteria.len().max(1) as f64;
                let (why, empty) = graded.answer.map_or((None, None), |answer| {
                    let count = answer.empty_turns.len();
                    let first = answer.empty_turns.into_iter().next();
                    (
                        answer.why,
                        first.map(|first| format!("{} empty: {}", agreeing(count, "turn is", "turns are"), first.why)),
                    )
                });
                let is_readable = why.is_none();
                let note = if is_whole { NOT_THE_PROMPT } else { "" };
                let told = why.or_else(|| told_of_code(&graded.action_code)).or(empty);
                let problem = told.map(|detail| SampleProblem { index, detail: detail + note, faults: Vec::new() });
                (graded.reward, f64::from(graded.overall), mean, is_readable, problem)
            }
            Err(error) => {
                let problem = Problem::from(error);
                (0.0, 0.0, 0.0, false, Some(SampleProblem { index, detail: problem.detail, faults: problem.faults }))
            }
        };
        rewards.rewards.push(reward);
        rewards.scores.push(overall);
        rewards.extra_logs.overall.push(overall);
        rewards.extra_logs.criteria_mean.push(mean);
        rewards.extra_logs.readable.push(f64::from(is_readable));
        let is_mislabelled = problem.as_ref().is_some_and(|problem| !problem.faults.is_empty());
        rewards.extra_logs.mislabelled.push(f64::from(is_mislabelled));
        rewards.problems.extend(problem);
    }
    Ok(Json(rewards))
}

/// Says what went wrong with code that was graded for what it did: the error that ended it, or why it built nothing.
fn told_of_code(replays: &[TurnReplay]) -> Option<String> {
    let of_error = |replay: &TurnReplay| {
        let error = replay.error.as_ref()?;
        let line = error.line.map(|line| format!(" (line {line})")).unwrap_or_default();
        Some(format!("{}{line}, after {}", error.message, counted(replay.events, "event")))
    };
    if let Some(error) = replays.iter().find_map(of_error) {
        return Some(error);
    }
    if replays.is_empty() || replays.iter().any(|replay| replay.events > 0) {
        return None;
    }
    let dropped = replays.iter().flat_map(|replay| &replay.dropped);
    let dropped = dropped.map(|dropped| format!("{}: {}", counted(dropped.count, "call"), dropped.reason));
    let reasons: Vec<String> = dropped.chain(replays.iter().flat_map(|replay| replay.notes.clone())).collect();
    let reasons = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join("; ")) };
    Some(format!("the code built nothing{reasons}"))
}

/// Joins the errors of labels into one with the faults of all; if none has faults, returns the first.
fn joined(errors: Vec<AppError>) -> AppError {
    let mut faults: Vec<FaultBody> = errors.iter().flat_map(AppError::faults).cloned().collect();
    let detail = counted(faults.len(), "fault");
    faults.truncate(Faults::KEPT);
    match errors.into_iter().next() {
        Some(first) if faults.is_empty() => first,
        _ => AppError::new(Kind::InvalidBody, detail).with_fault_list(faults),
    }
}
