//! Submissions and their reports.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use sha2::{Digest as _, Sha256};
use tokio::sync::OwnedSemaphorePermit;
use uuid::Uuid;

use super::replay::run_codes;
use super::submission_body::{Posted, PostedSubmission, check_against_task, read_submissions};
use super::submission_schema::{
    AcceptedAnswer, AcceptedBody, AcceptedList, NewSubmissionBody, Validated, ValidatedList,
};
use crate::clock::now_ms;
use crate::http::body::{Format, JsonBody};
use crate::http::caller::Caller;
use crate::http::idempotency;
use crate::http::problem::{ApiError, ApiResult, Problem};
use crate::http::state::AppState;
use crate::store::StoreError;
use crate::store::keys::Scope;
use crate::store::queue::Lane;
use crate::store::submissions::{Acceptability, Accepted, NewSubmission, PackedLog};
use plumbline_engine::grading::cost::{Cost, cost};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::tasks::embedded::FULL;
use plumbline_engine::tasks::{Task, hex};

/// Post what an agent did for a task: events per turn. The answer comes when it is durable; grading follows.
///
/// With `Content-Type: application/x-ndjson`, one submission a line: all are accepted in one transaction, or none.
/// Within a run a task is answered once; posting the same log again gives the same submission.
#[utoipa::path(
    post, path = "/v1/submissions", operation_id = "create_submission", tag = "submissions", summary = "Post a submission",
    params(("Idempotency-Key" = Option<String>, Header, description = "The same request with the same key is carried out once, for 24 hours: its answer is repeated")),
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 202, description = "Accepted; for NDJSON a list in the order of the lines", body = AcceptedAnswer,
         headers(("Location" = String, description = "The submission; only for a JSON body")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000001", "repeated": false })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The task was answered otherwise, or the run takes no more", body = Problem,
         content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much action code waits; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_submission(
    State(state): State<AppState>,
    caller: Caller,
    headers: HeaderMap,
    body: JsonBody,
) -> ApiResult<Response> {
    caller.require(Scope::Submit)?;
    let underway = state.in_flight.begin(&headers, &caller, "create_submission", &body.bytes)?;
    let Checked { submissions, lines, format, share: _share } = check(&state, &caller, body).await?;
    let submissions: Arc<[NewSubmission]> = submissions.into();
    let once = underway.as_ref().map(|underway| underway.once.clone());
    match state.store.accept(Arc::clone(&submissions), once, now_ms()).await? {
        Acceptability::Decided(answers) => {
            let accepted = accepted_bodies(&submissions, answers, &lines)?;
            state.wake.notify_waiters();
            accepted_answer(accepted, format)
        }
        Acceptability::KeyUsedOtherwise => Err(idempotency::other_body()),
        Acceptability::Replayed(result) => {
            let before: Vec<(String, bool)> =
                serde_json::from_str(&result).map_err(|error| ApiError::internal(&error))?;
            let accepted = before
                .into_iter()
                .map(|(id, repeated)| AcceptedBody { id, repeated, action_code: Vec::new() })
                .collect();
            let mut response = accepted_answer(accepted, format)?;
            response.headers_mut().extend([idempotency::REPLAYED]);
            Ok(response)
        }
    }
}

fn accepted_answer(accepted: Vec<AcceptedBody>, format: Format) -> ApiResult<Response> {
    if format == Format::NdJson {
        return Ok((StatusCode::ACCEPTED, Json(AcceptedList { submissions: accepted })).into_response());
    }
    let Some(one) = accepted.into_iter().next() else {
        return Err(ApiError::internal(&"a body without faults held no submission"));
    };
    let mut headers = HeaderMap::new();
    headers.insert(header::LOCATION, location(&one.id));
    Ok((StatusCode::ACCEPTED, headers, Json(one)).into_response())
}

/// Check a submission, or many, without submitting: everything that posting checks, with all faults at once. Nothing is
/// stored or graded, and it costs nothing.
#[utoipa::path(
    post, path = "/v1/validate", operation_id = "validate_submission", tag = "submissions",
    summary = "Check a submission without submitting",
    request_body(content((NewSubmissionBody = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 200, description = "All of it would be accepted", body = ValidatedList,
         example = json!({ "submissions": [{ "suite": "mineceraft@2", "number": 113, "turns": 1, "events": 25,
                                            "log_hash": "9f86d081884c7d65…", "repeated": false }] })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The task was answered otherwise, or the run takes no more", body = Problem,
         content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much action code waits; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn validate_submission(
    State(state): State<AppState>,
    caller: Caller,
    body: JsonBody,
) -> ApiResult<Json<ValidatedList>> {
    caller.require(Scope::Submit)?;
    let Checked { submissions, lines, share: _share, .. } = check(&state, &caller, body).await?;
    let answers = state.store.would_accept(&submissions).await?;
    let valid: Vec<Validated> = submissions.iter().map(Validated::of).collect();
    let accepted = accepted_bodies(&submissions, answers, &lines)?;
    let told =
        valid.into_iter().zip(accepted).map(|(valid, accepted)| Validated { repeated: accepted.repeated, ..valid });
    Ok(Json(ValidatedList { submissions: told.collect() }))
}

/// Submissions of a body in which nothing is wrong.
struct Checked {
    submissions: Vec<NewSubmission>,
    lines: Vec<Option<u64>>,
    format: Format,
    /// The share of memory is held until the answer: what the bytes became is in memory as long.
    share: Option<OwnedSemaphorePermit>,
}

/// Reads a body and checks all of it, but for what only the transaction that stores it can tell.
async fn check(state: &AppState, caller: &Caller, body: JsonBody) -> ApiResult<Checked> {
    let JsonBody { bytes, format, share } = body;
    let read = tokio::task::spawn_blocking(move || {
        let mut faults = Faults::new();
        let posted = read_submissions(&bytes, format, &mut faults);
        (posted, faults)
    });
    let (Posted { mut submissions, is_malformed }, mut faults) =
        read.await.map_err(|error| ApiError::internal(&error))?;
    // What is wrong anyway need not be run.
    if faults.is_empty() {
        run_codes(state, caller.who(), &mut submissions, &mut faults).await?;
    }
    let lines: Vec<Option<u64>> = submissions.iter().map(|submission| submission.line).collect();
    let places = resolve_all(state, caller, &submissions, &mut faults).await?;
    let owner = caller.owner().map(str::to_owned);
    let prepare = tokio::task::spawn_blocking(move || {
        let prepared = prepare(submissions, &places, owner.as_deref(), &mut faults);
        (prepared, faults)
    });
    let (prepared, faults) = prepare.await.map_err(|error| ApiError::internal(&error))?;
    if is_malformed {
        return Err(ApiError::malformed(faults));
    }
    if !faults.is_empty() {
        return Err(ApiError::faulty(faults));
    }
    Ok(Checked { submissions: prepared?, lines, format, share })
}

fn location(id: &str) -> HeaderValue {
    HeaderValue::from_str(&format!("/v1/submissions/{id}")).unwrap_or(HeaderValue::from_static("/v1/submissions"))
}

/// Suite of a posted submission, and the number of its task in it.
type Place = (Arc<Entry>, u32);

/// Looks up run, suite and task of each submission. Faults leave `None`.
async fn resolve_all(
    state: &AppState,
    caller: &Caller,
    posted: &[PostedSubmission],
    faults: &mut Faults,
) -> ApiResult<Vec<Option<Place>>> {
    let mut suite_of_run: HashMap<&str, Option<String>> = HashMap::new();
    let mut suites: HashMap<String, Option<Arc<Entry>>> = HashMap::new();
    let mut places = Vec::with_capacity(posted.len());
    for submission in posted {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        let suite = match &submission.run {
            Some(run) => {
                if !suite_of_run.contains_key(run.as_str()) {
                    let found = state.store.run(run).await?;
                    if let Some(row) = &found {
                        caller.require_own(row.owner.as_deref(), "run")?;
                    }
                    suite_of_run.insert(run, found.map(|row| row.suite_id));
                }
                let suite = suite_of_run.get(run.as_str()).cloned().flatten();
                if suite.is_none() {
                    faults.add_at("run", format!("there is no run {run:?}"));
                }
                if submission.suite.is_some() {
                    faults.add_at("suite", "a submission to a run takes the run's suite; leave it out");
                }
                suite
            }
            None => Some(submission.suite.clone().unwrap_or_else(|| FULL.to_owned())),
        };
        let Some(suite) = suite else {
            places.push(None);
            continue;
        };
        let Some(entry) = find_once(state, &suite, &mut suites).await? else {
            faults.add_at("suite", format!("there is no suite {suite:?}; /v1/suites lists them"));
            places.push(None);
            continue;
        };
        let number = submission.task.number_in(&entry, faults);
        places.push(number.map(|number| (entry, number)));
    }
    Ok(places)
}

/// A suite, looked up once a body.
async fn find_once(
    state: &AppState,
    name: &str,
    found: &mut HashMap<String, Option<Arc<Entry>>>,
) -> ApiResult<Option<Arc<Entry>>> {
    if let Some(entry) = found.get(name) {
        return Ok(entry.clone());
    }
    let entry = state.find_suite(name).await?;
    found.insert(name.to_owned(), entry.clone());
    Ok(entry)
}

/// Checks each log against its task, and packs the logs for storage where nothing is wrong with any.
fn prepare(
    posted: Vec<PostedSubmission>,
    places: &[Option<Place>],
    owner: Option<&str>,
    faults: &mut Faults,
) -> Result<Vec<NewSubmission>, StoreError> {
    let mut placed = Vec::with_capacity(posted.len());
    for (submission, place) in posted.into_iter().zip(places) {
        let Some((entry, number)) = place else { continue };
        let Some((task, hash)) = entry.task_numbered(*number) else { continue };
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        check_against_task(&submission.sent.log, task, faults);
        placed.push((submission, entry.suite.id(), task, hash));
    }
    if !faults.is_empty() {
        return Ok(Vec::new());
    }
    let pack = |(submission, suite_id, task, hash): (PostedSubmission, String, &Task, &str)| {
        let log = &submission.sent.log;
        let json = log.canonical_json();
        Ok(NewSubmission {
            id: Uuid::now_v7().to_string(),
            run_id: submission.run,
            suite_id,
            task_hash: hash.to_owned(),
            task_number: task.number,
            log_hash: hex(&Sha256::digest(&json)),
            turns: log.turns.len(),
            events: log.event_count(),
            owner: owner.map(str::to_owned),
            lane: if cost(task, log) == Cost::Immediate { Lane::Quick } else { Lane::Long },
            log: PackedLog::of(&json)?,
            replays: (!submission.replays.is_empty())
                .then(|| serde_json::to_string(&submission.replays).unwrap_or_default()),
        })
    };
    placed.into_iter().map(pack).collect()
}

fn accepted_body(id: String, repeated: bool, submission: &NewSubmission) -> AcceptedBody {
    let told = submission.replays.as_ref().and_then(|json| serde_json::from_str(json).ok());
    AcceptedBody { id, repeated, action_code: told.unwrap_or_default() }
}

/// The ids under which submissions were accepted; 409 where any was not, and then none was.
fn accepted_bodies(
    submissions: &[NewSubmission],
    answers: Vec<Accepted>,
    lines: &[Option<u64>],
) -> ApiResult<Vec<AcceptedBody>> {
    let mut conflicts = Faults::new();
    let (mut closed, mut is_used_up) = (false, false);
    let mut accepted = Vec::with_capacity(submissions.len());
    // Ids that would have been given in this very body; where it is refused they stand for nothing.
    let own: HashSet<String> = submissions.iter().map(|submission| submission.id.clone()).collect();
    for ((submission, answer), line) in submissions.iter().zip(answers).zip(lines) {
        if let Some(line) = line {
            conflicts.enter_line(*line);
        }
        match answer {
            Accepted::New => accepted.push(accepted_body(submission.id.clone(), false, submission)),
            Accepted::Same(id) => accepted.push(accepted_body(id, true, submission)),
            Accepted::Other(id) if own.contains(&id) => {
                conflicts.add_at("task", "another line of this body has another log for the same task");
            }
            Accepted::Other(id) => {
                conflicts.add_at("task", format!("the run answered this task with another log, as submission {id}"));
            }
            Accepted::QuotaUsedUp => is_used_up = true,
            Accepted::RunClosed => {
                closed = true;
                conflicts.add_at("run", "the run takes no more submissions");
            }
        }
    }
    if is_used_up {
        let detail = "the quota is used up: GET /v1/quota tells what it went to; nothing of this request was accepted";
        return Err(ApiError::new(StatusCode::FORBIDDEN, "quota-used-up", "The quota is used up", detail));
    }
    if conflicts.is_empty() {
        return Ok(accepted);
    }
    let kind = if closed { "run-closed" } else { "already-submitted" };
    let detail = conflicts.list().first().map(|fault| fault.detail.clone()).unwrap_or_default();
    Err(ApiError::conflict(kind, detail).with_faults(conflicts))
}
