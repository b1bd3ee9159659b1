//! Probes of liveness (`/healthz`) and readiness (`/readyz`).

use axum::Json;
use axum::extract::State;
use serde::Serialize;

use crate::app::error::AppResult;
use crate::app::readiness::check;
use crate::http::state::AppState;

/// Status of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Health {
    /// Always `ok`; a failure is a problem.
    #[schema(example = "ok")]
    pub status: &'static str,
    /// Version of the program.
    #[schema(example = "0.1.0")]
    pub version: &'static str,
    /// What the node lacks: `secrets`, without which it grades no submissions and issues no hidden instances (other
    /// nodes do), `key of epoch NAME`, without which it draws none of that epoch, `folder of large logs and reports`,
    /// without which it refuses these, or `intact log of receipts`, which is damaged then and needs its operator.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lacks: Vec<String>,
}

const OK: Health = Health { status: "ok", version: env!("CARGO_PKG_VERSION"), lacks: Vec::new() };

/// Reports that the process is alive.
#[utoipa::path(
    get, path = "/healthz", operation_id = "get_health", tag = "service", summary = "Check liveness",
    responses((status = 200, description = "Alive", body = Health, example = json!({ "status": "ok", "version": "0.1.0" })))
)]
pub async fn get_health() -> Json<Health> {
    Json(OK)
}

/// Reports whether the service can take work.
///
/// The service can take work if, within the last second, a transaction was written durably and every table was read.
#[utoipa::path(
    get, path = "/readyz", operation_id = "get_readiness", tag = "service", summary = "Check readiness",
    responses(
        (status = 200, description = "Ready", body = Health, example = json!({ "status": "ok", "version": "0.1.0" })),
        (status = 503, description = "It is not"),
    )
)]
pub async fn get_readiness(State(state): State<AppState>) -> AppResult<Json<Health>> {
    Ok(Json(Health { lacks: check(&state.app).await?, ..OK }))
}
