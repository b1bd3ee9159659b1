//! Grading within the request: one log, or many whose results stream back.

use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderName, HeaderValue};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::super::body::{Format, JsonBody};
use super::super::caller::Caller;
use super::super::grader::{GivenTask, Graded};
use super::super::problem::{ApiError, ApiResult, Problem};
use super::super::state::AppState;
use super::grade_body::{Detail, GradeRequest, GradeShape, NamedTask};
use super::submission_body::check_against_task;
use super::submission_schema::{NewTurn, TaskName};
use crate::checks::{CHECKS_VERSION, Criterion};
use crate::grading::Report;
use crate::grading::report::CriterionReport;
use crate::grading::reward::RewardComponents;
use crate::store::keys::Scope;
use crate::tasks::catalogue::Catalogue;
use crate::tasks::embedded::FULL;
use crate::tasks::hex;
use crate::voxel::tolerant::read_document;
use crate::voxel::{BlockLog, Faults};

/// A log to grade at once.
#[derive(Debug, serde::Deserialize, utoipa::ToSchema)]
#[schema(example = json!({
    "task": "walls/5x1x5-raise", "reward": "mean",
    "turns": [{ "events": [{ "action": "place", "x": 0, "y": 0, "z": 0, "material": "stone" }] }]
}))]
#[expect(dead_code, reason = "describes the body that GradeShape reads")]
pub struct NewGrade {
    /// The task: its id, its number, or a whole task: an object with `turns`, each with `checks` of `fn` and `args`.
    #[schema(value_type = TaskName)]
    task: Value,
    /// Suite of the task, where it is named: name, or name@version.
    suite: Option<String>,
    /// What was done in each turn; as many as the task has.
    turns: Vec<NewTurn>,
    /// `strict` (1 where the problem passes, else 0; the default), `mean` (of the criteria that apply), or
    /// `{"weights": {"material": 1, …}}`.
    #[schema(value_type = Option<Object>)]
    reward: Option<Value>,
    /// `scores` (the default) or `report`: with the whole report.
    detail: Option<String>,
    /// Milliseconds that grading may take; default and maximum are in `/v1/limits`.
    deadline_ms: Option<u64>,
}

/// The score of one check.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct CheckScore {
    /// Turn, from 1.
    pub turn: u32,
    /// Name.
    #[serde(rename = "fn")]
    pub name: String,
    /// The criterion it counts for.
    pub criterion: Criterion,
    /// In [0, 1].
    pub score: f64,
}

/// How long it took, in microseconds. All else in an answer depends on log, task and checks alone.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct Timings {
    /// Reading the request.
    pub read_us: u64,
    /// Grading, or finding the result that was kept.
    pub grade_us: u64,
}

/// A graded log.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct GradeBody {
    /// The task's id.
    pub task: String,
    /// SHA-256 of the task, in hex.
    pub task_hash: String,
    /// SHA-256 of the log's canonical JSON, in hex.
    pub log_hash: String,
    /// Version of the rules that scored it.
    pub checks_version: u32,
    /// The reward, in [0, 1].
    pub reward: f64,
    /// The scheme that made it.
    #[schema(example = "strict")]
    pub scheme: &'static str,
    /// Whether the problem passes.
    pub overall: bool,
    /// Whether its accuracy passes, where it applies.
    pub accuracy: Option<bool>,
    /// What rewards are made of.
    pub components: RewardComponents,
    /// The criteria that apply.
    pub criteria: Vec<CriterionReport>,
    /// A score per check.
    pub checks: Vec<CheckScore>,
    /// The whole report, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Report>)]
    pub report: Option<Arc<Report>>,
    /// How long it took.
    pub timings: Timings,
}

/// A request that was read and whose task was found.
#[derive(Debug)]
pub struct Prepared {
    request: GradeRequest,
    given: GivenTask,
    log_hash: String,
    begun: Instant,
    read_us: u64,
}

/// Reads a request and finds its task among the suites held.
///
/// # Errors
/// 400 where it is not JSON, 422 with all its faults.
pub fn prepare(text: &[u8], catalogue: &Catalogue) -> ApiResult<Prepared> {
    prepare_with(text, None, catalogue)
}

/// The same, with a log that was found elsewhere in place of the request's own.
///
/// # Errors
/// The same.
pub fn prepare_with(text: &[u8], log: Option<BlockLog>, catalogue: &Catalogue) -> ApiResult<Prepared> {
    let begun = Instant::now();
    let mut faults = Faults::new();
    let mut request = match read_document(text, GradeShape { faults: &mut faults }) {
        Ok(request) => request,
        Err(error) => {
            faults.add(error.to_string());
            return Err(ApiError::malformed(faults));
        }
    };
    if let (Some(request), Some(log)) = (&mut request, log) {
        request.log = log;
    }
    let given = request.as_ref().and_then(|request| find(request, catalogue, &mut faults));
    if let (Some(request), Some(given)) = (&request, &given) {
        check_against_task(&request.log, given.task()?.0, &mut faults);
    }
    let (Some(request), Some(given), true) = (request, given, faults.is_empty()) else {
        return Err(ApiError::faulty(faults));
    };
    let log_hash = hex(&Sha256::digest(request.log.canonical_json()));
    Ok(Prepared { request, given, log_hash, begun, read_us: micros(begun) })
}

fn find(request: &GradeRequest, catalogue: &Catalogue, faults: &mut Faults) -> Option<GivenTask> {
    let task = match &request.task {
        NamedTask::Inline(task) => return Some(GivenTask::inline((**task).clone())),
        NamedTask::Listed(task) => task,
    };
    let name = request.suite.as_deref().unwrap_or(FULL);
    let Some(entry) = catalogue.suite(name) else {
        faults.add_at("suite", format!("there is no suite {name:?}; /v1/suites lists them"));
        return None;
    };
    task.number_in(entry, faults).map(|number| GivenTask::Listed(Arc::clone(entry), number))
}

fn micros(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_micros()).unwrap_or(u64::MAX)
}

impl Prepared {
    /// Grades it, and says whether the result was kept from before.
    ///
    /// # Errors
    /// As [`super::super::grader::Grader::grade`]; 422 where no criterion that applies has a weight.
    pub async fn grade(self, state: &AppState) -> ApiResult<(GradeBody, bool)> {
        let Self { request: GradeRequest { log, scheme, detail, deadline, .. }, given, log_hash, begun, read_us } =
            self;
        let graded = state.grader.grade(given, log, &log_hash, deadline).await.map_err(ApiError::without_reward)?;
        let is_cached = graded.is_cached;
        Ok((answer(graded, &scheme, detail, log_hash, begun, read_us)?, is_cached))
    }

    /// The same on this thread.
    ///
    /// # Errors
    /// The same.
    pub fn grade_here(self, state: &AppState) -> ApiResult<GradeBody> {
        let Self { request: GradeRequest { log, scheme, detail, deadline, .. }, given, log_hash, begun, read_us } =
            self;
        let graded = state.grader.grade_here(&given, &log, &log_hash, deadline).map_err(ApiError::without_reward)?;
        answer(graded, &scheme, detail, log_hash, begun, read_us)
    }
}

fn answer(
    graded: Graded,
    scheme: &crate::grading::reward::Scheme,
    detail: Detail,
    log_hash: String,
    begun: Instant,
    read_us: u64,
) -> ApiResult<GradeBody> {
    let report = graded.report;
    let Some(reward) = scheme.reward(&report) else {
        let mut faults = Faults::new();
        faults.enter_key("reward");
        faults.add_at("weights", "none of these criteria applies to the task");
        return Err(ApiError::faulty(faults));
    };
    let checks = report.turns.iter().flat_map(|turn| turn.checks.iter().map(|check| (turn.turn, check)));
    Ok(GradeBody {
        task: report.task.clone(),
        task_hash: report.task_hash.clone(),
        log_hash,
        checks_version: CHECKS_VERSION,
        reward,
        scheme: scheme.name(),
        overall: report.overall,
        accuracy: report.accuracy,
        components: RewardComponents::of(&report),
        criteria: report.criteria.clone(),
        checks: checks
            .map(|(turn, check)| CheckScore {
                turn,
                name: check.name.clone(),
                criterion: check.criterion,
                score: check.finding.score,
            })
            .collect(),
        report: (detail == Detail::Report).then(|| Arc::clone(&report)),
        timings: Timings { read_us, grade_us: micros(begun).saturating_sub(read_us) },
    })
}

/// Header that tells whether a result was computed or kept from before.
pub const CACHE_HEADER: HeaderName = HeaderName::from_static("x-plumbline-cache");

/// Bodies up to this size are read where they arrive; larger ones on a thread of their own.
const QUICK_BYTES: usize = 128 << 10;

/// Grade a log at once: the answer has the scores and a reward. Nothing is stored and nothing comes onto a board. A failure
/// of ours is a problem whose `reward` is null, never a score; `retryable` says that the same request may succeed later.
#[utoipa::path(
    post, path = "/v1/grade", operation_id = "grade", tag = "rewards", summary = "Grade a log at once",
    request_body(content = NewGrade, content_type = "application/json"),
    responses(
        (status = 200, description = "Scores and reward", body = GradeBody,
         headers(("x-plumbline-cache" = String, description = "`hit` where the result was kept from before, else `miss`")),
         example = json!({ "task": "walls/5x1x5-raise", "reward": 1.0, "scheme": "strict", "overall": true, "accuracy": true,
                           "criteria": [], "checks": [], "timings": { "read_us": 20, "grade_us": 30 } })),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 408, description = "Too slow", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not JSON by its type", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Faults, all of them", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too much to do; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Busy or stopping; come back", body = Problem, content_type = "application/problem+json"),
        (status = 504, description = "The deadline passed", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn grade(State(state): State<AppState>, caller: Caller, body: JsonBody) -> ApiResult<Response> {
    caller.require(Scope::Grade)?;
    let JsonBody { bytes, format, share: _share } = body;
    if format == Format::NdJson {
        return Err(ApiError::not_ndjson("many logs go to /v1/grade:batch"));
    }
    let _place = state.grader.admit().map_err(ApiError::without_reward)?;
    let catalogue = state.store.catalogue();
    let prepared = if bytes.len() <= QUICK_BYTES {
        prepare(&bytes, &catalogue)?
    } else {
        let reading = tokio::task::spawn_blocking(move || prepare(&bytes, &catalogue));
        reading.await.map_err(|error| ApiError::internal(&error))??
    };
    let (graded, is_cached) = prepared.grade(&state).await?;
    let outcome = HeaderValue::from_static(if is_cached { "hit" } else { "miss" });
    Ok(([(CACHE_HEADER, outcome)], Json(graded)).into_response())
}
