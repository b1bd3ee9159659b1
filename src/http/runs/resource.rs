//! Creating, reading and listing runs.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use uuid::Uuid;

use super::body::{NewRunBody, RunProvenance};
use crate::app::access::Caller;
use crate::app::body::read_body;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::accept::key_reused;
use crate::app::submissions::posted::Format;
use crate::clock::{milliseconds, now_ms, rfc3339};
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::body::JsonBody;
use crate::http::extract::idempotency;
use crate::http::extract::params::{Params, wrong};
use crate::http::state::AppState;
use crate::http::submissions::schema::SubmissionBody;
use crate::store::idempotency::PriorRequest;
use crate::store::keys::Scope;
use crate::store::run_rows::RunRow;
use crate::store::runs::{NewRun, RunsWanted};
use crate::store::states::RunState;
use plumbline_engine::grading::Summary;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::why_not_json;

/// A run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunBody {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub id: String,
    /// Name of the agent.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite: String,
    /// Metadata from its owner.
    #[schema(value_type = Object)]
    pub metadata: Value,
    /// State of the run.
    pub state: RunState,
    /// Number of tasks in its suite.
    #[schema(minimum = 0)]
    pub tasks: i64,
    /// Number of submissions that are queued or being graded.
    #[schema(minimum = 0)]
    pub pending: i64,
    /// Number of graded submissions.
    #[schema(minimum = 0)]
    pub graded: i64,
    /// Number of submissions that ended by a failure of the service. The run does not finish until their tasks are
    /// posted again.
    #[schema(minimum = 0)]
    pub grader_errors: i64,
    /// Time at which it was created (RFC 3339).
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Time at which it finished (RFC 3339).
    #[schema(format = DateTime)]
    pub finished_at: Option<String>,
    /// Summary of the run, once finished.
    pub summary: Option<Summary>,
    /// Owner of the key that created it; null if it was created without a key.
    pub owner: Option<String>,
    /// Origin of its logs.
    #[schema(value_type = RunProvenance)]
    pub provenance: String,
    /// Number of tasks that it skips on purpose; they count as failed.
    #[schema(minimum = 0)]
    pub skipped: i64,
}

impl From<RunRow> for RunBody {
    fn from(run: RunRow) -> Self {
        Self {
            id: run.id,
            agent: run.agent,
            suite: run.suite_id,
            metadata: run.metadata,
            state: run.state,
            tasks: run.tasks,
            pending: run.pending,
            graded: run.graded,
            grader_errors: run.grader_errors,
            created_at: rfc3339(run.created_at_ms),
            finished_at: run.finished_at_ms.map(rfc3339),
            summary: run.summary,
            owner: run.owner,
            provenance: run.provenance,
            skipped: run.skipped,
        }
    }
}

/// Creates a run: one attempt of an agent at a suite. It finishes by itself when every task has been graded.
#[utoipa::path(
    post, path = "/v1/runs", operation_id = "create_run", tag = "runs", summary = "Create a run",
    params(("Idempotency-Key" = Option<String>, Header, description = "A request that is repeated with the same key within 24 hours is carried out only once, and its response is repeated")),
    request_body(content = NewRunBody, content_type = "application/json"),
    responses(
        (status = 201, description = "The run", body = RunBody, headers(("Location" = String, description = "Its URL")),
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "agent": "my-agent 1.2", "suite": "mineceraft@1",
                           "state": "open", "tasks": 723, "pending": 0, "graded": 0, "grader_errors": 0 })),
    )
)]
pub async fn create_run(
    State(state): State<AppState>,
    caller: Caller,
    headers: HeaderMap,
    body: JsonBody,
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    if body.format == Format::NdJson {
        return Err(AppError::not_ndjson("create one run per request"));
    }
    let underway = state.in_flight.begin(&headers, &caller, "create_run", &body.bytes)?;
    let mut faults = Faults::new();
    let parsed = match read_body::<NewRunBody>(&body.bytes, &mut faults) {
        Ok(parsed) => parsed,
        Err(error) => {
            faults.add(why_not_json(&body.bytes, &error));
            return Err(AppError::malformed(faults));
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
        return Err(AppError::faulty(faults));
    };
    let id = Uuid::now_v7().to_string();
    let provenance = parsed.provenance.unwrap_or(RunProvenance::SelfReported);
    if provenance == RunProvenance::ReRunByHost {
        caller.require(Scope::Admin)?;
    }
    let metadata = parsed.metadata.unwrap_or_else(|| serde_json::json!({}));
    let owner = caller.owner();
    let new = NewRun {
        id: &id,
        agent: &agent,
        suite_id: &suite_id,
        metadata: &metadata,
        owner,
        provenance: provenance.name(),
    };
    let once = underway.as_ref().map(|underway| &underway.once);
    let (id, is_replayed) = match state.store.create_run(&new, once, now_ms()).await? {
        PriorRequest::Never => (id, false),
        PriorRequest::Done(id) => (id, true),
        PriorRequest::OtherBody => return Err(key_reused()),
    };
    let run = run_body(&state, &id).await?;
    // The run as it was at its creation, even if the response is repeated later.
    let run = RunBody {
        state: RunState::Open,
        pending: 0,
        graded: 0,
        grader_errors: 0,
        skipped: 0,
        finished_at: None,
        summary: None,
        ..run
    };
    let mut response = (StatusCode::CREATED, [(header::LOCATION, format!("/v1/runs/{id}"))], Json(run)).into_response();
    if is_replayed {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

/// Returns the body of a run.
///
/// # Errors
/// Returns an error (404) if there is no such run.
pub async fn run_body(state: &AppState, id: &str) -> AppResult<RunBody> {
    let run = state.store.run(id).await?;
    run.map(RunBody::from).ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))
}

/// Returns a run with its progress and, once finished, its summary.
#[utoipa::path(
    get, path = "/v1/runs/{id}", operation_id = "get_run", tag = "runs", summary = "Get a run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finished", "tasks": 723, "graded": 723 })),
    )
)]
pub async fn get_run(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<RunBody>> {
    Ok(Json(run_body(&state, &id).await?))
}

/// Query parameters that filter runs.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RunsQuery {
    /// Only runs in this state. Deleted runs are listed only with `state=deleted`.
    #[param(inline)]
    state: Option<RunState>,
    /// Only runs of this suite: name@version, or the name alone for all versions.
    suite: Option<String>,
    /// Only runs of agents whose names contain this text, ignoring the case of ASCII letters.
    agent: Option<String>,
    /// Only runs of the key's owner.
    #[serde(default)]
    mine: bool,
    /// Only runs created at this time or later (RFC 3339).
    #[param(format = DateTime)]
    since: Option<String>,
    /// Only runs created before this time (RFC 3339).
    #[param(format = DateTime)]
    until: Option<String>,
    /// Only runs created before the run with this id, for the next page.
    #[param(format = Uuid)]
    after: Option<String>,
    /// Maximum number of runs on a page; 100 by default.
    #[param(minimum = 1)]
    limit: Option<u32>,
}

/// A page of runs.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunPage {
    /// The runs, latest first, without their summaries.
    pub runs: Vec<RunBody>,
    /// Value of `after` for the next page; null on the last page.
    #[schema(format = Uuid)]
    pub next_after: Option<String>,
}

/// Returns a page of runs, latest first. `mine=true` selects the runs of the key's owner.
#[utoipa::path(
    get, path = "/v1/runs", operation_id = "list_runs", tag = "runs", summary = "List runs",
    params(RunsQuery),
    responses(
        (status = 200, description = "A page of runs", body = RunPage, example = json!({ "runs": [], "next_after": null })),
        (status = 401, description = "Whose are mine? No key was sent"),
    )
)]
pub async fn list_runs(
    State(state): State<AppState>,
    caller: Result<Caller, AppError>,
    Params(query): Params<RunsQuery>,
) -> AppResult<Json<RunPage>> {
    let items = page_items(query.limit, 100)?;
    let time = |name: &str, text: Option<&String>| {
        let read = |text: &String| {
            milliseconds(text)
                .ok_or_else(|| wrong(name, format!("{text:?} is not a time (RFC 3339, such as 2026-11-22T00:00:00Z)")))
        };
        text.map(read).transpose()
    };
    let owner = if query.mine {
        let caller = caller?;
        let owner = caller.owner().map(str::to_owned);
        Some(owner.ok_or_else(|| wrong("mine", "no key was sent, so the owner is unknown"))?)
    } else {
        None
    };
    if let Some(suite) = query.suite.as_deref()
        && state.find_suite(suite).await?.is_none()
    {
        return Err(wrong("suite", format!("there is no suite {suite:?}; /v1/suites lists them")));
    }
    if let Some(after) = query.after.as_deref()
        && state.store.run(after).await?.is_none()
    {
        return Err(wrong("after", format!("there is no run {after:?}")));
    }
    let (since_ms, until_ms) = (time("since", query.since.as_ref())?, time("until", query.until.as_ref())?);
    let wanted = RunsWanted {
        state: query.state,
        suite_id: query.suite,
        agent: query.agent,
        owner,
        since_ms,
        until_ms,
        after: query.after,
    };
    let mut rows = state.store.runs(&wanted, items as i64 + 1).await?;
    let has_more = rows.len() > items;
    rows.truncate(items);
    let next_after = rows.last().filter(|_| has_more).map(|last| last.id.clone());
    let runs = rows.into_iter().map(|row| RunBody { summary: None, ..RunBody::from(row) }).collect();
    Ok(Json(RunPage { runs, next_after }))
}

/// Query parameters that select a page of submissions.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// Only tasks with a greater number, for the next page.
    after: Option<u32>,
    /// Maximum number of submissions on a page; 100 by default.
    #[param(minimum = 1)]
    limit: Option<u32>,
}

/// A page of a run's submissions.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SubmissionPage {
    /// The submissions, ordered by task number.
    pub submissions: Vec<SubmissionBody>,
    /// Value of `after` for the next page; null on the last page.
    pub next_after: Option<u32>,
}

/// Returns a page of a run's submissions, ordered by task number.
#[utoipa::path(
    get, path = "/v1/runs/{id}/submissions", operation_id = "list_run_submissions", tag = "runs",
    summary = "List a run's submissions",
    params(("id" = String, Path, description = "The run's id"), PageQuery),
    responses(
        (status = 200, description = "A page of submissions", body = SubmissionPage,
         example = json!({ "submissions": [], "next_after": null })),
    )
)]
pub async fn list_run_submissions(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Params(query): Params<PageQuery>,
) -> AppResult<Json<SubmissionPage>> {
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
