//! `/healthz` and `/readyz`.

use std::time::{Duration, Instant};

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use tokio::sync::Mutex;

use crate::app::error::{AppError, AppResult, Kind};
use crate::clock::now_ms;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::Store;

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

/// How long what was found holds: probes that come more often cost nothing.
const HOLDS_FOR: Duration = Duration::from_secs(1);
/// How long the database may take.
const PATIENCE: Duration = Duration::from_secs(4);

/// Whether the database could be written and read lately. One request looks, and the others wait for what it finds.
#[derive(Debug, Default)]
pub struct Readiness(Mutex<Option<(Instant, Result<(), &'static str>)>>);

impl Readiness {
    async fn look(&self, store: &Store) -> Result<(), &'static str> {
        let mut found = self.0.lock().await;
        if let Some((at, found)) = *found
            && at.elapsed() < HOLDS_FOR
        {
            return found;
        }
        let new = match tokio::time::timeout(PATIENCE, store.probe(now_ms())).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => {
                tracing::error!(%error, "not ready");
                Err("The database cannot be written or read; the service's log says why.")
            }
            Err(_late) => {
                tracing::error!(seconds = PATIENCE.as_secs(), "not ready: the database could not be written in time");
                Err("The database could not be written in time: something else may be holding it.")
            }
        };
        *found = Some((Instant::now(), new));
        new
    }
}

/// Whether the service can take work: a transaction was written durably and every table can be read, now or in the second before.
#[utoipa::path(
    get, path = "/readyz", operation_id = "get_readiness", tag = "service", summary = "Ready?",
    responses(
        (status = 200, description = "It is", body = Health, example = json!({ "status": "ok", "version": "0.1.0" })),
        (status = 503, description = "It is not", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_readiness(State(state): State<AppState>) -> AppResult<Json<Health>> {
    let found = state.readiness.look(&state.store).await;
    let not_ready = |detail| AppError::new(Kind::NotReady, detail);
    found.map_err(|detail| not_ready(detail).retry_after(1))?;
    Ok(Json(OK))
}
