//! HTTP: routes, extractors, a folder for each domain, and pages. A handler extracts, calls a use case, and answers.

pub mod accounts;
pub mod boards;
pub mod catalogue;
pub mod extract;
pub mod hidden;
pub mod middleware;
pub mod pages;
pub mod problem;
pub mod rewards;
pub mod router;
pub mod runs;
pub mod server;
pub mod service;
pub mod state;
pub mod submissions;

use std::sync::Arc;

use axum::Router;
use metrics_exporter_prometheus::PrometheusHandle;
use tokio_util::sync::CancellationToken;

use crate::actions::pool::Pool;
use crate::app::App;
use crate::app::access::{Keys, Openness};
use crate::app::boards::Boards;
use crate::app::limits::{LIMITS, Limits};
use crate::app::load::Connections;
use crate::app::rewards::grader::Grader;
use crate::app::stress::StressFields;
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
    pub open: Openness,
    /// The share of a suite that a run must have answered, or skipped on purpose, to be compared on its board.
    pub least_coverage: f64,
    /// Whether metrics and administration have a listener of their own.
    pub has_admin_listener: bool,
    /// How many requests a second.
    pub rates: middleware::rates::RateSettings,
}

/// Parts of the service that HTTP is built from.
#[derive(Debug)]
pub struct HttpParts {
    /// The database.
    pub store: Store,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// How many connections are open.
    pub connections: Connections,
    /// Counts requests.
    pub rates: Arc<middleware::rates::Rates>,
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
    HttpParts { store, metrics, connections, rates, actions, signer, stop }: HttpParts,
    settings: &HttpSettings,
) -> anyhow::Result<Routers> {
    let (routes, mut openapi) = router::routes().split_for_parts();
    router::complete(&mut openapi);
    let limits = Limits {
        requests_per_second_per_key: settings.rates.per_key,
        requests_per_second_per_address: settings.rates.per_address,
        grade_cache_bytes: settings.grade_cache_bytes,
        connections_per_address: settings.rates.connections_per_address,
        ..LIMITS
    };
    let event_feed = accounts::event_feed::EventFeed::start(store.clone(), stop.clone(), accounts::events::written);
    let app = App {
        store,
        grader: Arc::new(Grader::new(settings.grade_cache_bytes, &connections, stop.clone())?),
        keys: Keys::new(settings.open),
        least_coverage: settings.least_coverage,
        boards: Boards::default(),
        stress: StressFields::new()?,
        limits,
        actions,
        action_requests: Places::new(limits.action_requests, limits.action_requests_per_sender),
        signer,
        stop,
    };
    let state = AppState::new(Shared {
        app,
        event_feed,
        reveals: quick_cache::sync::Cache::new(REVEALS),
        bodies: Arc::new(extract::body::budget()),
        documents: extract::conditional::Documents::default(),
        in_flight: Arc::default(),
        event_streams: Places::new(limits.event_streams, limits.event_streams_per_sender),
        rates,
        readiness: service::health::Readiness::default(),
        metrics,
        openapi: openapi.to_json().expect("the document is JSON").into(),
    });
    let routes = routes.merge(pages::routes()).merge(router::trainers_elsewhere());
    let router = routes.with_state(state.clone()).merge(router::reference());
    if !settings.has_admin_listener {
        return Ok(Routers { public: middleware::layers::around(router, state), admin: None });
    }
    let admin = middleware::layers::around(router.clone(), state.clone());
    let public = router.layer(axum::middleware::from_fn(middleware::layers::without_administration));
    Ok(Routers { public: middleware::layers::around(public, state), admin: Some(admin) })
}
