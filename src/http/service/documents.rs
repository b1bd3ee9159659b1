//! `/openapi.json` and `/metrics`.

use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;

use crate::app::error::AppResult;
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

/// Returns the metrics in the Prometheus text format.
#[utoipa::path(
    get, path = "/metrics", operation_id = "get_metrics", tag = "service", summary = "Get the metrics",
    responses(
        (status = 200, description = "Metrics as Prometheus text", body = String, content_type = "text/plain",
         example = "plumbline_graded_total 747"),
    )
)]
pub async fn get_metrics(State(state): State<AppState>) -> AppResult<impl IntoResponse> {
    let Backlog { open, oldest_ms } = backlog(&state).await?;
    metrics::gauge!("plumbline_submissions_not_ended").set(open as f64);
    metrics::gauge!("plumbline_oldest_submission_not_ended_seconds").set(oldest_ms as f64 / 1_000.0);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], state.metrics.render()))
}
