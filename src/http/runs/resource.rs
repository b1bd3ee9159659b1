//! Runs.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use uuid::Uuid;

use super::body::{NewRunBody, NewRunShape, RunProvenance};
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::accept::key_reused;
use crate::app::submissions::posted::Format;
use crate::clock::{milliseconds, now_ms, rfc3339};
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::body::JsonBody;
use crate::http::extract::idempotency;
use crate::http::extract::params::{Params, wrong};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::http::submissions::schema::SubmissionBody;
use crate::store::idempotency::Before;
use crate::store::keys::Scope;
use crate::store::runs::{NewRun, RunRow, RunState, RunsWanted};
use plumbline_engine::grading::Summary;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{read_document, why_not_json};

/// A run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunBody {
    /// Its id.
    #[schema(format = Uuid)]
    pub id: String,
    /// Who builds.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite: String,
    /// What its owner said about it.
    #[schema(value_type = Object)]
    pub metadata: Value,
    /// How far it is.
    pub state: RunState,
    /// Tasks of its suite.
    #[schema(minimum = 0)]
    pub tasks: i64,
    /// Submissions queued or being graded.
    #[schema(minimum = 0)]
    pub pending: i64,
    /// Submissions graded.
    #[schema(minimum = 0)]
    pub graded: i64,
    /// Submissions ended by a failure of ours. Post their tasks again; the run does not finish before.
    #[schema(minimum = 0)]
    pub grader_errors: i64,
    /// When it was made.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// When it finished.
    #[schema(format = DateTime)]
    pub finished_at: Option<String>,
    /// Its summary, once finished.
    pub summary: Option<Summary>,
    /// Whose key began it; null where the service is open to everybody.
    pub owner: Option<String>,
    /// How its logs come about.
    #[schema(value_type = RunProvenance)]
    pub provenance: String,
    /// Tasks that it skips on purpose; they count as failed.
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
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    if body.format == Format::NdJson {
        return Err(AppError::not_ndjson("a run is begun alone"));
    }
    let underway = state.in_flight.begin(&headers, &caller, "create_run", &body.bytes)?;
    let mut faults = Faults::new();
    let parsed = match read_document(&body.bytes, NewRunShape { faults: &mut faults }) {
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
    let (metadata, owner) = (&parsed.metadata, caller.owner());
    let new = NewRun { id: &id, agent: &agent, suite_id: &suite_id, metadata, owner, provenance: provenance.name() };
    let once = underway.as_ref().map(|underway| &underway.once);
    let (id, is_replayed) = match state.store.create_run(&new, once, now_ms()).await? {
        Before::Never => (id, false),
        Before::Done(id) => (id, true),
        Before::OtherBody => return Err(key_reused()),
    };
    let run = run_body(&state, &id).await?;
    // As it was when it was made, also where the answer is repeated.
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

/// A run as the API shows it.
///
/// # Errors
/// 404 where there is none.
pub async fn run_body(state: &AppState, id: &str) -> AppResult<RunBody> {
    let run = state.store.run(id).await?;
    run.map(RunBody::from).ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))
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
pub async fn get_run(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<RunBody>> {
    Ok(Json(run_body(&state, &id).await?))
}

/// Which runs.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RunsQuery {
    /// Only runs in this state. Deleted ones are listed only so.
    #[param(inline)]
    state: Option<RunState>,
    /// Only of this suite: name@version, or a name for all its versions.
    suite: Option<String>,
    /// Only agents whose names hold this text, in whatever case.
    agent: Option<String>,
    /// Only runs of the key's owner.
    #[serde(default)]
    mine: bool,
    /// Only runs begun at this time or after (RFC 3339).
    #[param(format = DateTime)]
    since: Option<String>,
    /// Only runs begun before this time (RFC 3339).
    #[param(format = DateTime)]
    until: Option<String>,
    /// Only runs begun before this one: the page after.
    #[param(format = Uuid)]
    after: Option<String>,
    /// Runs on a page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
}

/// A page of runs.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunPage {
    /// The latest first, without their summaries.
    pub runs: Vec<RunBody>,
    /// `after` of the next page; null on the last.
    #[schema(format = Uuid)]
    pub next_after: Option<String>,
}

/// The runs, the latest first, filtered and in pages. `mine=true` lists those of the owner whose key is sent.
#[utoipa::path(
    get, path = "/v1/runs", operation_id = "list_runs", tag = "runs", summary = "List runs",
    params(RunsQuery),
    responses(
        (status = 200, description = "A page of runs", body = RunPage, example = json!({ "runs": [], "next_after": null })),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 401, description = "Whose are mine? No key was sent", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
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
        Some(owner.ok_or_else(|| wrong("mine", "no key was sent that tells whose they are"))?)
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
