//! HTTP: routes, bodies, problems and pages. Meets the workers only through the store.

pub mod api;
pub mod body;
pub mod caller;
mod conditional;
pub mod grader;
pub mod idempotency;
pub mod layers;
pub mod limits;
pub mod pages;
pub mod problem;
pub mod server;
pub mod state;

use std::sync::Arc;

use axum::Router;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

use crate::store::Store;
use state::AppState;

/// What the one who starts the service decides.
#[derive(Debug, Clone, Copy)]
pub struct HttpSettings {
    /// Bytes of memory for results of `/v1/grade`; 0 for none.
    pub grade_cache_bytes: usize,
    /// Whether everybody may write without a key.
    pub is_open: bool,
}

/// The whole service as a router.
pub fn router(
    store: &Store,
    wake: &Arc<Notify>,
    metrics: PrometheusHandle,
    settings: &HttpSettings,
    stop: CancellationToken,
) -> Router {
    let (routes, mut openapi) = api::routes().split_for_parts();
    api::complete(&mut openapi);
    let state = AppState {
        store: store.clone(),
        wake: Arc::clone(wake),
        bodies: Arc::new(body::budget()),
        grader: Arc::new(grader::Grader::new(settings.grade_cache_bytes, stop.clone())),
        boards: Arc::default(),
        in_flight: Arc::default(),
        keys: Arc::new(caller::Keys::new(settings.is_open)),
        stress_turns: Arc::new(api::stress::StressTurns::default()),
        stop,
        metrics,
        openapi: openapi.to_json().unwrap_or_default().into(),
    };
    let router = routes.merge(pages::routes()).with_state(state).merge(api::reference());
    layers::around(router)
}
