//! Notes the route of each request, and refuses parameters that its operation does not take.

use std::convert::Infallible;
use std::future::{Ready, ready};
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll};

use axum::extract::{MatchedPath, Request};
use axum::response::{IntoResponse as _, Response};
use axum::routing::Route;
use axum::routing::future::RouteFuture;
use futures_util::future::Either;
use tower::Service;

use crate::http::state::AppState;

/// A slot for the route of a request. The router fills it; metrics and the log line read it.
#[derive(Debug, Clone, Default)]
pub(super) struct RouteSlot(Arc<OnceLock<MatchedPath>>);

impl RouteSlot {
    /// Returns the route, or `None` if the request matches none or did not reach the router.
    pub(super) fn get(&self) -> Option<&MatchedPath> {
        self.0.get()
    }
}

/// Marks a request that only asks for its route: no handler sees it, and its response is empty.
#[derive(Debug, Clone, Copy)]
pub(super) struct OnlyRoute;

/// A route that fills the slot of each request, and passes on what its operation takes.
#[derive(Debug, Clone)]
pub(super) struct CheckedRoute {
    route: Route,
    state: AppState,
}

impl CheckedRoute {
    pub(super) const fn new(route: Route, state: AppState) -> Self {
        Self { route, state }
    }
}

impl Service<Request> for CheckedRoute {
    type Response = Response;
    type Error = Infallible;
    type Future = Either<RouteFuture<Infallible>, Ready<Result<Response, Infallible>>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Service::<Request>::poll_ready(&mut self.route, context)
    }

    fn call(&mut self, request: Request) -> Self::Future {
        let extensions = request.extensions();
        if let (Some(slot), Some(route)) = (extensions.get::<RouteSlot>(), extensions.get::<MatchedPath>()) {
            // This fails only if a route was noted before, and a request has one route.
            let _ = slot.0.set(route.clone());
        }
        if extensions.get::<OnlyRoute>().is_some() {
            return Either::Right(ready(Ok(Response::default())));
        }
        match self.state.parameterless.check(&request) {
            Ok(()) => Either::Left(self.route.call(request)),
            Err(refused) => Either::Right(ready(Ok(refused.into_response()))),
        }
    }
}
