//! Runs.

use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::de::{IgnoredAny, MapAccess};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use uuid::Uuid;

use super::super::body::{Format, JsonBody};
use super::super::caller::Caller;
use super::super::idempotency;
use super::super::limits::LIMITS;
use super::super::problem::{ApiError, ApiResult, Problem};
use super::super::state::AppState;
use super::submission_schema::SubmissionBody;
use super::tasks::page_items;
use crate::clock::{now_ms, rfc3339};
use crate::grading::Summary;
use crate::store::idempotency::Before;
use crate::store::keys::Scope;
use crate::store::runs::{NewRun, RunRow};
use crate::voxel::Faults;
use crate::voxel::tolerant::{OrNull, Read, Shape, Text, read_document};

/// What makes a run.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[schema(example = json!({ "agent": "my-agent 1.2", "suite": "mineceraft", "metadata": { "model": "m-7b" } }))]
#[expect(dead_code, reason = "describes the body that NewRunShape reads")]
pub struct NewRunBody {
    /// Who builds, as the board shall show it.
    #[schema(min_length = 1, max_length = 100)]
    agent: String,
    /// Suite: name, or name@version.
    suite: String,
    /// Anything else worth keeping; an object.
    #[schema(value_type = Option<Object>)]
    metadata: Option<Value>,
    /// `self-reported`, which is taken where nothing is said; `re-run-by-host` needs the scope admin.
    provenance: Option<String>,
}

/// A run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunBody {
    /// Its id.
    pub id: String,
    /// Who builds.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite: String,
    /// What its owner said about it.
    #[schema(value_type = Object)]
    pub metadata: Value,
    /// `open`: takes submissions; `finishing`: takes no more, some are being graded; `finished`: on the board.
    #[schema(example = "open")]
    pub state: &'static str,
    /// Tasks of its suite.
    pub tasks: i64,
    /// Submissions queued or being graded.
    pub pending: i64,
    /// Submissions graded.
    pub graded: i64,
    /// Submissions ended by a failure of ours. Post their tasks again; the run does not finish before.
    pub grader_errors: i64,
    /// When it was made.
    pub created_at: String,
    /// When it finished.
    pub finished_at: Option<String>,
    /// Its summary, once finished.
    pub summary: Option<Summary>,
    /// Whose key began it; null where the service is open to everybody.
    pub owner: Option<String>,
    /// How its logs come about: `self-reported`, or `re-run-by-host`.
    #[schema(example = "self-reported")]
    pub provenance: String,
}

impl From<RunRow> for RunBody {
    fn from(run: RunRow) -> Self {
        Self {
            id: run.id,
            agent: run.agent,
            suite: run.suite_id,
            metadata: run.metadata,
            state: run.state.name(),
            tasks: run.tasks,
            pending: run.pending,
            graded: run.graded,
            grader_errors: run.grader_errors,
            created_at: rfc3339(run.created_at_ms),
            finished_at: run.finished_at_ms.map(rfc3339),
            summary: run.summary,
            owner: run.owner,
            provenance: run.provenance,
        }
    }
}

#[derive(Debug)]
struct ParsedRun {
    agent: Option<String>,
    suite: Option<String>,
    metadata: Value,
    provenance: Option<String>,
}

/// How the logs of a run may come about: as its owner says, or in a run by whoever runs the service.
const PROVENANCES: [&str; 2] = ["self-reported", "re-run-by-host"];

struct NewRunShape<'f> {
    faults: &'f mut Faults,
}

impl<'de> Shape<'de> for NewRunShape<'_> {
    type Out = ParsedRun;

    fn wanted(&self) -> &'static str {
        "an object with \"agent\" and \"suite\""
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn object<A: MapAccess<'de>>(self, mut members: A) -> Result<Option<ParsedRun>, A::Error> {
        let faults = self.faults;
        let (mut agent, mut suite, mut metadata, mut provenance) = (None, None, None, None);
        while let Some(key) = members.next_key::<String>()? {
            faults.enter_key(&key);
            match key.as_str() {
                "agent" if agent.is_none() => {
                    let text = Text { faults, min_chars: 1, max_chars: LIMITS.agent_chars };
                    let name = members.next_value_seed(Read(text))?;
                    if name.as_ref().is_some_and(|name| name.trim().is_empty() && !name.is_empty()) {
                        faults.add("a name of nothing but spaces");
                    }
                    agent = Some(name);
                }
                "suite" if suite.is_none() => {
                    suite = Some(members.next_value_seed(Read(Text { faults, min_chars: 1, max_chars: 100 }))?);
                }
                "metadata" if metadata.is_none() => {
                    let value: Value = members.next_value()?;
                    if !value.is_object() && !value.is_null() {
                        faults.add("expected an object");
                    } else if value.to_string().len() > LIMITS.metadata_bytes {
                        faults.add(format!("larger than {} bytes", LIMITS.metadata_bytes));
                    }
                    metadata = Some(value);
                }
                "provenance" if provenance.is_none() => {
                    let text = Text { faults, min_chars: 1, max_chars: 100 };
                    let named: Option<String> = members.next_value_seed(Read(OrNull(text)))?.flatten().flatten();
                    if named.as_ref().is_some_and(|named| !PROVENANCES.contains(&named.as_str())) {
                        faults.add(format!("expected one of {}", PROVENANCES.join(", ")));
                    }
                    provenance = Some(named);
                }
                "agent" | "suite" | "metadata" | "provenance" => {
                    faults.add("given twice");
                    members.next_value::<IgnoredAny>()?;
                }
                _ => {
                    faults.add("unknown field; a run has agent, suite, metadata and provenance");
                    members.next_value::<IgnoredAny>()?;
                }
            }
            faults.leave();
        }
        for (key, is_missing) in [("agent", agent.is_none()), ("suite", suite.is_none())] {
            if is_missing {
                faults.add_at(key, "missing");
            }
        }
        let metadata = metadata.filter(|value| !value.is_null()).unwrap_or_else(|| serde_json::json!({}));
        let provenance = provenance.flatten();
        Ok(Some(ParsedRun { agent: agent.flatten(), suite: suite.flatten(), metadata, provenance }))
    }
}

/// Begin a run: one attempt of an agent at a suite. It finishes by itself when every task has been graded.
#[utoipa::path(
    post, path = "/v1/runs", operation_id = "create_run", tag = "runs", summary = "Begin a run",
    params(("Idempotency-Key" = Option<String>, Header, description = "The same request with the same key is carried out once, for 24 hours: its answer is repeated")),
    request_body(content = NewRunBody, content_type = "application/json"),
    responses(
        (status = 201, description = "The run", body = RunBody, headers(("Location" = String, description = "The run")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "agent": "my-agent 1.2", "suite": "mineceraft@1",
                           "state": "open", "tasks": 723, "pending": 0, "graded": 0, "grader_errors": 0 })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Neither JSON nor NDJSON", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy; come back", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_run(
    State(state): State<AppState>,
    caller: Caller,
    headers: HeaderMap,
    body: JsonBody,
) -> ApiResult<Response> {
    caller.require(Scope::Submit)?;
    if body.format == Format::NdJson {
        return Err(ApiError::not_ndjson("a run is begun alone"));
    }
    let underway = state.in_flight.begin(&headers, &caller, "create_run", &body.bytes)?;
    let mut faults = Faults::new();
    let parsed = match read_document(&body.bytes, NewRunShape { faults: &mut faults }) {
        Ok(parsed) => parsed,
        Err(error) => {
            faults.add(error.to_string());
            return Err(ApiError::malformed(faults));
        }
    };
    let mut suite_id = None;
    if let Some(name) = parsed.as_ref().and_then(|run| run.suite.as_deref()) {
        match state.find_suite(name).await? {
            Some(entry) => suite_id = Some(entry.suite.id()),
            None => faults.add_at("suite", format!("there is no suite {name:?}; /v1/suites lists them")),
        }
    }
    let agent = parsed.as_ref().and_then(|run| run.agent.clone());
    let (Some(parsed), Some(agent), Some(suite_id), true) = (parsed, agent, suite_id, faults.is_empty()) else {
        return Err(ApiError::faulty(faults));
    };
    let id = Uuid::now_v7().to_string();
    let provenance = parsed.provenance.as_deref().unwrap_or(PROVENANCES[0]);
    if provenance != PROVENANCES[0] {
        caller.require(Scope::Admin)?;
    }
    let (metadata, owner) = (&parsed.metadata, caller.owner());
    let new = NewRun { id: &id, agent: &agent, suite_id: &suite_id, metadata, owner, provenance };
    let once = underway.as_ref().map(|underway| &underway.once);
    let (id, is_replayed) = match state.store.create_run(&new, once, now_ms()).await? {
        Before::Never => (id, false),
        Before::Done(id) => (id, true),
        Before::OtherBody => return Err(idempotency::other_body()),
    };
    let run = run_body(&state, &id).await?;
    // As it was when it was made, also where the answer is repeated.
    let run =
        RunBody { state: "open", pending: 0, graded: 0, grader_errors: 0, finished_at: None, summary: None, ..run };
    let mut response = (StatusCode::CREATED, [(header::LOCATION, format!("/v1/runs/{id}"))], Json(run)).into_response();
    if is_replayed {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

async fn run_body(state: &AppState, id: &str) -> ApiResult<RunBody> {
    let run = state.store.run(id).await?;
    run.map(RunBody::from).ok_or_else(|| ApiError::not_found(format!("there is no run {id:?}")))
}

/// A run with its progress and, once finished, its summary.
#[utoipa::path(
    get, path = "/v1/runs/{id}", operation_id = "get_run", tag = "runs", summary = "Get a run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finished", "tasks": 723, "graded": 723 })),
        (status = 404, description = "There is none with this id", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_run(State(state): State<AppState>, Path(id): Path<String>) -> ApiResult<Json<RunBody>> {
    Ok(Json(run_body(&state, &id).await?))
}

/// Say that no more submissions will come. Tasks without one count as failed. The run finishes when all that was
/// posted has been graded.
#[utoipa::path(
    post, path = "/v1/runs/{id}/finish", operation_id = "finish_run", tag = "runs", summary = "Finish a run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The run; its state is finishing or finished", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finishing", "pending": 2 })),
        (status = 404, description = "There is none with this id", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn finish_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> ApiResult<Json<RunBody>> {
    caller.require(Scope::Submit)?;
    if let Some(run) = state.store.run(&id).await? {
        caller.require_own(run.owner.as_deref(), "run")?;
    }
    state.store.finish_run(&id, now_ms()).await?;
    Ok(Json(run_body(&state, &id).await?))
}

/// Which submissions.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// Only tasks with a greater number: the page after.
    after: Option<u32>,
    /// Submissions on a page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
}

/// A page of a run's submissions.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SubmissionPage {
    /// By task number.
    pub submissions: Vec<SubmissionBody>,
    /// `after` of the next page; null on the last.
    pub next_after: Option<u32>,
}

/// The submissions of a run, by task number, in pages.
#[utoipa::path(
    get, path = "/v1/runs/{id}/submissions", operation_id = "list_run_submissions", tag = "runs",
    summary = "List a run's submissions",
    params(("id" = String, Path, description = "The run's id"), PageQuery),
    responses(
        (status = 200, description = "A page of submissions", body = SubmissionPage,
         example = json!({ "submissions": [], "next_after": null })),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such run", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn list_run_submissions(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Query(query): Query<PageQuery>,
) -> ApiResult<Json<SubmissionPage>> {
    let items = page_items(query.limit, 100)?;
    let run = run_body(&state, &id).await?;
    let entry = state.suite(&run.suite).await?;
    let after = i64::from(query.after.unwrap_or(0));
    let mut rows = state.store.submissions_of_run(&id, after, items as i64 + 1).await?;
    let has_more = rows.len() > items;
    rows.truncate(items);
    let submissions: Vec<SubmissionBody> = rows.into_iter().map(|row| SubmissionBody::of(row, &entry)).collect();
    let next_after = submissions.last().filter(|_| has_more).map(|last| last.number);
    Ok(Json(SubmissionPage { submissions, next_after }))
}
