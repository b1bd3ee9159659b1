//! `/openapi.json` and `/metrics`.

use std::time::Duration;

use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;

use crate::app::error::AppResult;
use crate::app::readiness;
use crate::app::submissions::read::{Backlog, backlog};
use crate::http::state::AppState;

/// Returns the OpenAPI document of this service.
#[utoipa::path(
    get, path = "/openapi.json", operation_id = "get_openapi", tag = "service", summary = "Get the OpenAPI document",
    responses((status = 200, description = "The OpenAPI document", body = Object, content_type = "application/json",
               example = json!({ "openapi": "3.1.0", "info": { "title": "plumbline" } })))
)]
pub async fn get_openapi(State(state): State<AppState>) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], state.openapi.to_string())
}

/// Time that the database may take for its metrics; Prometheus waits ten seconds for all.
const PATIENCE: Duration = Duration::from_secs(2);

/// Returns the metrics.
///
/// The metrics are in the Prometheus text format.
#[utoipa::path(
    get, path = "/metrics", operation_id = "get_metrics", tag = "service", summary = "Get the metrics",
    responses(
        (status = 200, description = "Metrics as Prometheus text", body = String, content_type = "text/plain",
         example = "plumbline_graded_total 747"),
    )
)]
pub async fn get_metrics(State(state): State<AppState>) -> AppResult<impl IntoResponse> {
    // Figures that the process counts itself are served even while the database is unreachable. Figures that only the
    // database has are NaN then.
    let (found, ready) =
        tokio::join!(tokio::time::timeout(PATIENCE, backlog(&state)), readiness::check_within(&state.app, PATIENCE));
    if let Ok(Err(error)) = &found {
        tracing::warn!(detail = error.detail(), "the metrics lack what the database knows");
    }
    let found = found.ok().and_then(Result::ok);
    let [open, oldest_s] =
        found.map_or([f64::NAN; 2], |Backlog { open, oldest_ms }| [open as f64, oldest_ms as f64 / 1_000.0]);
    metrics::gauge!("plumbline_ready").set(if ready.is_some() { 1.0 } else { 0.0 });
    metrics::gauge!("plumbline_lacks").set(ready.map_or(f64::NAN, |lacks| lacks.len() as f64));
    metrics::gauge!("plumbline_database_up").set(if open.is_nan() { 0.0 } else { 1.0 });
    metrics::gauge!("plumbline_submissions_not_ended").set(open);
    metrics::gauge!("plumbline_oldest_submission_not_ended_seconds").set(oldest_s);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], state.metrics.render()))
}
