//! State that the request handlers share.

use std::sync::Arc;

use bytes::Bytes;
use metrics_exporter_prometheus::PrometheusHandle;
use quick_cache::sync::Cache;
use tokio::sync::Semaphore;

use super::accounts::event_feed::EventFeed;
use super::extract::conditional::Documents;
use super::extract::idempotency::InFlight;
use super::extract::room::GrowingRoom;
use super::middleware::queries::Parameterless;
use super::middleware::rates::Rates;
use crate::app::App;
use crate::fair::PermitPool;

/// A handle to the state that handlers share. It is a single pointer, because every request clones it several times.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

impl AppState {
    /// Creates a handle to the shared state.
    #[must_use]
    pub fn new(shared: Shared) -> Self {
        Self(Arc::new(shared))
    }
}

impl std::ops::Deref for AppState {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.0
    }
}

/// State that the request handlers share.
#[derive(Debug)]
pub struct Shared {
    /// State that the use cases share.
    pub app: Arc<App>,
    /// Memory budget for request bodies.
    pub bodies: Arc<Semaphore>,
    /// Memory budget for what free JSON grows into.
    pub free_json: GrowingRoom,
    /// Requests with an `Idempotency-Key` that are in progress.
    pub in_flight: Arc<InFlight>,
    /// Cache of documents.
    pub documents: Documents,
    /// Slots for event streams.
    pub event_streams: Arc<PermitPool>,
    /// Cache of the reveals of settled epochs, as they are sent.
    pub reveals: Cache<String, Bytes>,
    /// Feed that reads new events once for all streams.
    pub event_feed: EventFeed,
    /// Rate limiter for requests.
    pub rates: Arc<Rates>,
    /// Renderer of the Prometheus metrics.
    pub metrics: PrometheusHandle,
    /// Operations that take no parameters in the query string.
    pub parameterless: Parameterless,
    /// The OpenAPI document, as JSON.
    pub openapi: Arc<str>,
}

impl std::ops::Deref for Shared {
    type Target = App;

    fn deref(&self) -> &App {
        &self.app
    }
}
