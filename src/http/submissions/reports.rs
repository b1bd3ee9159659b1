//! Reports and logs of submissions.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};

use crate::app::error::AppResult;
use crate::app::submissions::read;
use crate::clock::rfc3339;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::grading::Report;
use plumbline_engine::intake::schema::StoredLogBody;

/// A report with its provenance.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReportBody {
    /// Identifier of the submission.
    #[schema(format = Uuid)]
    pub submission: String,
    /// Scores and evidence.
    #[serde(flatten)]
    pub report: Report,
    /// Provenance of the report: what was graded, by which program, and when.
    pub provenance: Provenance,
}

/// Provenance of a report.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Provenance {
    /// SHA-256 of the log's canonical JSON, in hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_hash: String,
    /// `name@version` of the task's suite.
    pub suite: String,
    /// Program and version that graded the log.
    #[schema(example = "plumbline 0.1.0")]
    pub grader: String,
    /// Number of the grading attempt that made the report.
    #[schema(minimum = 1)]
    pub attempt: i64,
    /// Time of grading (RFC 3339).
    #[schema(format = DateTime)]
    pub graded_at: String,
    /// Duration of grading, in microseconds.
    #[schema(minimum = 0)]
    pub grading_us: i64,
}

/// Query parameters that select a report.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ReportQuery {
    /// Number of the grading attempt whose report to return; by default the latest. Regrading adds a report and keeps
    /// the old one.
    #[param(minimum = 1)]
    attempt: Option<i64>,
}

/// Returns a report.
///
/// The report says what was measured and what was required for each turn, check and criterion, with the cells that
/// show it.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/report", operation_id = "get_report", tag = "submissions", summary = "Get a report",
    params(("id" = String, Path, description = "The submission's id"), ReportQuery),
    responses(
        (status = 200, description = "The report", body = ReportBody,
         example = json!({ "submission": "0198c0de-0000-7000-8000-000000000001", "overall": true, "accuracy": true,
                           "criteria": [], "turns": [], "advisories": [] })),
        (status = 409, description = "It is not graded, not yet or not at all"),
    )
)]
pub async fn get_report(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Params(query): Params<ReportQuery>,
) -> AppResult<Json<ReportBody>> {
    let (row, stored) = read::report(&state, &id, query.attempt).await?;
    Ok(Json(ReportBody {
        submission: row.id,
        report: stored.report,
        provenance: Provenance {
            log_hash: row.log_hash,
            suite: row.suite_id,
            grader: stored.grader,
            attempt: stored.attempt,
            graded_at: rfc3339(stored.graded_at_ms),
            grading_us: stored.grading_us,
        },
    }))
}

/// Returns the log as stored.
///
/// The log is canonical JSON, whose SHA-256 is the log hash.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/log", operation_id = "get_log", tag = "submissions", summary = "Get a log",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The log: one palette, and rows `[x, y, z, i]` or `[x, y, z]` for each turn. The member `log` of a submission takes the same form", body = StoredLogBody,
         example = json!({ "palette": ["stone"], "turns": [[[0, 0, 0, 0]]] })),
    )
)]
pub async fn get_log(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Response> {
    let log = read::log(&state, &id).await?;
    Ok(([(header::CONTENT_TYPE, "application/json")], log).into_response())
}
