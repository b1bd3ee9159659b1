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

use crate::app::App;
use crate::fair::Places;
use state::{AppState, Shared};

/// Parts of the service that HTTP is built from.
#[derive(Debug)]
pub struct HttpParts {
    /// Use cases and what they share.
    pub app: Arc<App>,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// Counts requests.
    pub rates: Arc<middleware::rates::Rates>,
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
pub fn routers(HttpParts { app, metrics, rates }: HttpParts, has_admin_listener: bool) -> anyhow::Result<Routers> {
    let (routes, mut openapi) = router::routes().split_for_parts();
    router::complete(&mut openapi);
    let event_feed =
        accounts::event_feed::EventFeed::start(app.store.clone(), app.stop.clone(), accounts::events::written);
    let limits = app.limits;
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
    if !has_admin_listener {
        return Ok(Routers { public: middleware::layers::around(router, state), admin: None });
    }
    let admin = middleware::layers::around(router.clone(), state.clone());
    let public = router.layer(axum::middleware::from_fn(middleware::layers::without_administration));
    Ok(Routers { public: middleware::layers::around(public, state), admin: Some(admin) })
}
