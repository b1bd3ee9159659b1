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

use axum::Router;
use metrics_exporter_prometheus::PrometheusHandle;

use crate::app::App;
use crate::fair::PermitPool;
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

/// Routers of the service, one for each listener.
#[derive(Debug)]
pub struct Routers {
    /// Router of the public listener. Without an admin router, it serves metrics and operator actions as well.
    pub public: Router,
    /// Router of the admin listener, with all routes; if there is one, the public router has no metrics or operator
    /// actions.
    pub admin: Option<Router>,
}

/// Number of epoch reveals kept in memory.
const REVEALS: usize = 4;

/// Builds the routers of the whole service.
pub fn routers(HttpParts { app, metrics, rates, role }: HttpParts, has_admin_listener: bool) -> Routers {
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
        documents: extract::conditional::Documents::default(),
        in_flight: Arc::default(),
        event_streams: PermitPool::new(limits.event_streams, limits.event_streams_per_sender),
        rates,
        metrics,
        parameterless: middleware::queries::Parameterless::of(&openapi),
        openapi: openapi.to_json().expect("the document is JSON").into(),
    });
    let routes = routes.merge(pages::routes()).merge(hidden::log::routes()).merge(router::trainers_elsewhere());
    let mut router = routes.with_state(state.clone());
    if role != Role::Whole {
        let rest = axum::routing::any(|| async { axum::http::StatusCode::NOT_FOUND });
        router = router.fallback(rest).layer(axum::middleware::from_fn_with_state(role, role::keep_to_role));
    }
    if !has_admin_listener {
        return Routers { public: middleware::layers::around(router, state), admin: None };
    }
    let admin = middleware::layers::around(router.clone(), state.clone());
    let public = router.layer(axum::middleware::from_fn(middleware::layers::without_administration));
    Routers { public: middleware::layers::around(public, state), admin: Some(admin) }
}
