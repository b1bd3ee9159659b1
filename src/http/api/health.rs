//! `/healthz` and `/readyz`.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;

use super::super::problem::{ApiError, ApiResult, Problem};
use super::super::state::AppState;

/// State of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Health {
    /// `ok`.
    #[schema(example = "ok")]
    pub status: &'static str,
    /// Version of the program.
    #[schema(example = "0.1.0")]
    pub version: &'static str,
}

const OK: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION") };

/// Whether the process is alive.
#[utoipa::path(
    get, path = "/healthz", operation_id = "get_health", tag = "service", summary = "Alive?",
    responses((status = 200, description = "It is", body = Health, example = json!({ "status": "ok", "version": "0.1.0" })))
)]
pub async fn get_health() -> Json<Health> {
    Json(OK)
}

/// Whether the service can take work: its database answers.
#[utoipa::path(
    get, path = "/readyz", operation_id = "get_readiness", tag = "service", summary = "Ready?",
    responses(
        (status = 200, description = "It is", body = Health, example = json!({ "status": "ok", "version": "0.1.0" })),
        (status = 503, description = "It is not", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_readiness(State(state): State<AppState>) -> ApiResult<Json<Health>> {
    state.store.ping().await.map_err(|error| {
        tracing::error!(%error, "not ready");
        let detail = "The database does not answer.";
        ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "not-ready", "Not ready", detail).retry_after(1)
    })?;
    Ok(Json(OK))
}
