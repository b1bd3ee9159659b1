//! Creating, reading and listing runs.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::app::access::Caller;
use crate::app::cards::card::Card;
use crate::app::error::{AppError, AppResult};
use crate::app::runs::body::{NewRunBody, RunProfile, RunProvenance};
use crate::app::runs::create::{CreatedRun, create};
use crate::app::runs::read::{self, RunFilter, SubmissionsOfRun};
use crate::clock::rfc3339;
use crate::http::extract::body::{JsonBody, read_draft};
use crate::http::extract::idempotency;
use crate::http::extract::params::{Params, SoundParams};
use crate::http::state::AppState;
use crate::http::submissions::body::SubmissionBody;
use crate::store::embargoes::Embargo;
use crate::store::keys::Scope;
use crate::store::run_rows::RunRow;
use crate::store::states::RunState;
use plumbline_engine::grading::Summary;
use plumbline_engine::tasks::Track;

/// A run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RunBody {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub id: String,
    /// Name of the agent; an alias while the run is under embargo.
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
    /// Owner of the key that created it; null if it was created without a key, or while it is under embargo.
    pub owner: Option<String>,
    /// Origin of its logs.
    #[schema(value_type = RunProvenance)]
    pub provenance: String,
    /// Number of tasks that it skips on purpose; they count as failed.
    #[schema(minimum = 0)]
    pub skipped: i64,
    /// Profile of its submissions: `published`, `mindcraft`, or `mixed`; null before the first.
    #[schema(value_type = Option<RunProfile>)]
    pub profile: Option<String>,
    /// Track of its prompts.
    pub track: Track,
    /// What the run was, as its owner declares it; absent if there is no card.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Card>)]
    pub card: Option<Value>,
    /// Embargo that holds for the run; absent if none does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub embargo: Option<EmbargoBody>,
    /// Withdrawal of the run by its owner; absent if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub withdrawn: Option<Withdrawal>,
}

/// Embargo of a run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EmbargoBody {
    /// End of the embargo.
    #[schema(format = DateTime)]
    pub until: String,
    /// Name of the agent; only its owner sees it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub agent: Option<String>,
}

/// Withdrawal of a run by its owner.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Withdrawal {
    /// Time of the withdrawal.
    #[schema(format = DateTime)]
    pub at: String,
    /// Reason that the owner gave.
    pub reason: String,
}

impl RunBody {
    /// Builds the body of a run as a caller may see it: of a run under embargo, only its owner sees agent, owner, card
    /// and metadata.
    #[must_use]
    pub fn seen_by(caller: Option<&Caller>, run: RunRow) -> Self {
        let is_seen = |embargo: &Embargo| {
            caller.is_some_and(|caller| caller.sees_all_of(run.owner.as_deref())).then(|| embargo.agent.clone())
        };
        let embargo = run
            .embargo
            .as_ref()
            .map(|embargo| EmbargoBody { until: rfc3339(embargo.until_ms), agent: is_seen(embargo) });
        let is_anonymous = embargo.as_ref().is_some_and(|embargo| embargo.agent.is_none());
        let metadata = match run.embargo {
            Some(embargo) if !is_anonymous => embargo.metadata,
            _ => run.metadata,
        };
        Self {
            id: run.id,
            agent: run.agent,
            suite: run.suite_id,
            metadata,
            state: run.state,
            tasks: run.tasks,
            pending: run.pending,
            graded: run.graded,
            grader_errors: run.grader_errors,
            created_at: rfc3339(run.created_at_ms),
            finished_at: run.finished_at_ms.map(rfc3339),
            summary: run.summary,
            owner: run.owner.filter(|_| !is_anonymous),
            provenance: run.provenance,
            skipped: run.skipped,
            profile: run.profile,
            track: run.track,
            card: run.card.filter(|_| !is_anonymous),
            embargo,
            withdrawn: run.withdrawn.map(|(at_ms, reason)| Withdrawal { at: rfc3339(at_ms), reason }),
        }
    }
}

/// Creates a run.
///
/// A run is one attempt of an agent at a suite. It finishes by itself when every task has been graded.
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
    let underway = state.in_flight.begin(&headers, &caller, "create_run", &body.bytes)?;
    let (draft, faults) = read_draft::<NewRunBody>(&body, "create one run per request")?;
    let once = underway.as_ref().map(|underway| &underway.once);
    let CreatedRun { run, is_replayed } = create(&state, &caller, draft, faults, once).await?;
    let location = [(header::LOCATION, format!("/v1/runs/{}", run.id))];
    let mut response = (StatusCode::CREATED, location, Json(RunBody::seen_by(Some(&caller), run))).into_response();
    if is_replayed {
        response.headers_mut().extend([idempotency::REPLAYED]);
    }
    Ok(response)
}

/// Returns a run.
///
/// A run has its progress and, once finished, its summary. A run under embargo shows an alias; its owner, with a key
/// that may submit, sees all of it.
#[utoipa::path(
    get, path = "/v1/runs/{id}", operation_id = "get_run", tag = "runs", summary = "Get a run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finished", "tasks": 723, "graded": 723 })),
    )
)]
pub async fn get_run(
    State(state): State<AppState>,
    caller: AppResult<Caller>,
    Path(id): Path<String>,
) -> AppResult<Json<RunBody>> {
    Ok(Json(RunBody::seen_by(caller.ok().as_ref(), read::stored(&state, &id).await?)))
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

impl From<RunsQuery> for RunFilter {
    fn from(query: RunsQuery) -> Self {
        let RunsQuery { state, suite, agent, mine, since, until, after, limit } = query;
        Self { state, suite, agent, mine, since, until, after, limit }
    }
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

/// Returns a page of runs.
///
/// The latest comes first. `mine=true` selects the runs of the key's owner.
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
    SoundParams(query, faults): SoundParams<RunsQuery>,
) -> AppResult<Json<RunPage>> {
    let seen_by = caller.as_ref().ok().cloned();
    let page = read::list(&state, caller, query.into(), faults).await?;
    let next_after = page.next(|last| last.id.clone());
    let body = |row| RunBody { summary: None, ..RunBody::seen_by(seen_by.as_ref(), row) };
    let runs = page.items.into_iter().map(body).collect();
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

/// Returns a page of a run's submissions.
///
/// Submissions are ordered by task number.
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
    let SubmissionsOfRun { entry, page } = read::submissions(&state, &id, query.after, query.limit).await?;
    let next_after = page.next(|last| last.task_number);
    let submissions = page.items.into_iter().map(|row| SubmissionBody::of(row, &entry)).collect::<AppResult<_>>()?;
    Ok(Json(SubmissionPage { submissions, next_after }))
}
