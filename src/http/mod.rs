//! HTTP: routes, bodies, problems and pages. Meets the workers only through the store.

pub mod api;
pub mod boards;
pub mod body;
pub mod caller;
pub mod conditional;
pub mod event_feed;
pub mod grader;
pub mod idempotency;
pub mod impatient;
pub mod layers;
pub mod limits;
mod observe;
pub mod pages;
pub mod params;
pub mod problem;
pub mod rates;
pub mod server;
pub mod state;

use std::sync::Arc;

use axum::Router;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

use crate::actions::pool::Pool;
use crate::fair::Places;
use crate::store::Store;
use plumbline_engine::hidden::receipts::Signer;
use state::{AppState, Shared};

/// What the one who starts the service decides.
#[derive(Debug, Clone, Copy)]
pub struct HttpSettings {
    /// Bytes of memory for results of `/v1/grade`; 0 for none.
    pub grade_cache_bytes: usize,
    /// What needs no key.
    pub open: caller::Openness,
    /// The share of a suite that a run must have answered, or skipped on purpose, to be compared on its board.
    pub least_coverage: f64,
    /// Whether metrics and administration have a listener of their own.
    pub has_admin_listener: bool,
    /// How many requests a second.
    pub rates: rates::RateSettings,
}

/// What HTTP has around it.
#[derive(Debug)]
pub struct Around {
    /// The database.
    pub store: Store,
    /// Tells the workers that there is work.
    pub wake: Arc<Notify>,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// How many connections are open.
    pub connections: server::Connections,
    /// Counts requests.
    pub rates: Arc<rates::Rates>,
    /// Runs action code.
    pub actions: Pool,
    /// Signs receipts.
    pub signer: Arc<Signer>,
    /// Cancelled when the service stops.
    pub stop: CancellationToken,
}

/// The routers of a service.
#[derive(Debug)]
pub struct Routers {
    /// What everybody may ask for.
    pub public: Router,
    /// Everything, for a listener of its own; then metrics and what operators do are not on the public one.
    pub admin: Option<Router>,
}

/// Reveals of epochs kept in memory.
const REVEALS: usize = 4;

/// The whole service as routers.
///
/// # Errors
/// Where there are no threads to be had.
pub fn routers(
    Around { store, wake, metrics, connections, rates, actions, signer, stop }: Around,
    settings: &HttpSettings,
) -> anyhow::Result<Routers> {
    let (routes, mut openapi) = api::routes().split_for_parts();
    api::complete(&mut openapi);
    let limits = limits::Limits {
        requests_per_second_per_key: settings.rates.per_key,
        requests_per_second_per_address: settings.rates.per_address,
        grade_cache_bytes: settings.grade_cache_bytes,
        connections_per_address: settings.rates.connections_per_address,
        ..limits::LIMITS
    };
    let event_feed = event_feed::EventFeed::start(store.clone(), stop.clone(), api::events::written);
    let state = AppState::new(Shared {
        event_feed,
        reveals: quick_cache::sync::Cache::new(REVEALS),
        store,
        wake,
        bodies: Arc::new(body::budget()),
        grader: Arc::new(grader::Grader::new(settings.grade_cache_bytes, &connections, stop.clone())?),
        least_coverage: settings.least_coverage,
        boards: boards::Boards::default(),
        documents: conditional::Documents::default(),
        in_flight: Arc::default(),
        keys: caller::Keys::new(settings.open),
        stress: api::stress::StressFields::new()?,
        actions,
        action_requests: Places::new(limits.action_requests, limits.action_requests_per_sender),
        event_streams: Places::new(limits.event_streams, limits.event_streams_per_sender),
        limits,
        rates,
        signer,
        readiness: api::health::Readiness::default(),
        stop,
        metrics,
        openapi: openapi.to_json().unwrap_or_default().into(),
    });
    let routes = routes.merge(pages::routes()).merge(api::trainers_elsewhere());
    let router = routes.with_state(state.clone()).merge(api::reference());
    if !settings.has_admin_listener {
        return Ok(Routers { public: layers::around(router, state), admin: None });
    }
    let admin = layers::around(router.clone(), state.clone());
    let public = router.layer(axum::middleware::from_fn(layers::without_administration));
    Ok(Routers { public: layers::around(public, state), admin: Some(admin) })
}
