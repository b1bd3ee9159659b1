//! The HTTP layer: routes, extractors, middleware, pages, and a module for each domain.
//!
//! A handler extracts its arguments, calls a use case and turns the result into a response.

pub mod accounts;
pub mod boards;
mod bounds;
pub mod catalogue;
pub mod episodes;
mod error_page;
pub mod extract;
pub mod hidden;
pub mod middleware;
pub mod pages;
pub mod problem;
pub mod rewards;
pub mod role;
pub mod router;
pub mod runs;
pub mod server;
pub mod service;
pub mod state;
pub mod submissions;

use std::sync::Arc;

use metrics_exporter_prometheus::PrometheusHandle;

use crate::app::App;
use crate::fair::PermitPool;
use middleware::front::Front;
use role::Role;
use state::{AppState, Shared};

/// Components of the service that the HTTP layer needs.
#[derive(Debug)]
pub struct HttpParts {
    /// Use cases and the state that they share.
    pub app: Arc<App>,
    /// Renderer of the Prometheus metrics.
    pub metrics: PrometheusHandle,
    /// Rate limiter for requests.
    pub rates: Arc<middleware::rates::Rates>,
    /// Role of the node.
    pub role: Role,
}

/// The service as its listeners see it.
#[derive(Debug)]
pub struct Fronts {
    /// What the public listener serves. Without an admin listener, that includes metrics and operator actions.
    pub public: Front,
    /// What the admin listener serves, which is everything; if there is one, the public listener has no metrics or
    /// operator actions.
    pub admin: Option<Front>,
}

/// Number of epoch reveals kept in memory.
const REVEALS: usize = 4;

/// Builds the whole service.
pub fn fronts(HttpParts { app, metrics, rates, role }: HttpParts, has_admin_listener: bool) -> Fronts {
    let (routes, mut openapi) = router::routes().split_for_parts();
    router::complete(&mut openapi);
    openapi.paths.paths.retain(|path, _| role.serves(path));
    let event_feed = accounts::event_feed::EventFeed::start(Arc::clone(&app), accounts::events::written);
    let limits = app.limits;
    let state = AppState::new(Shared {
        app,
        event_feed,
        reveals: quick_cache::sync::Cache::new(REVEALS),
        bodies: Arc::new(extract::body::budget()),
        free_json: extract::room::GrowingRoom::default(),
        documents: extract::conditional::Documents::default(),
        in_flight: Arc::default(),
        event_streams: PermitPool::new(limits.event_streams, limits.event_streams_per_sender),
        rates,
        metrics,
        parameterless: middleware::queries::Parameterless::of(&openapi),
        openapi: openapi.to_json().expect("the document is JSON").into(),
    });
    let routes = routes.merge(pages::routes()).merge(hidden::log::routes()).merge(router::trainers_elsewhere());
    let whole = Front::new(routes.with_state(state.clone()), state, role);
    if has_admin_listener {
        return Fronts { public: whole.without_administration(), admin: Some(whole) };
    }
    Fronts { public: whole, admin: None }
}
