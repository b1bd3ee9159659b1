//! What handlers share.

use std::sync::Arc;

use bytes::Bytes;
use metrics_exporter_prometheus::PrometheusHandle;
use quick_cache::sync::Cache;
use tokio::sync::Semaphore;

use super::accounts::event_feed::EventFeed;
use super::extract::conditional::Documents;
use super::extract::idempotency::InFlight;
use super::middleware::rates::Rates;
use super::service::health::Readiness;
use crate::app::App;
use crate::fair::Places;

/// A handle to what handlers share. One pointer, as every request clones it several times.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Shared>);

impl AppState {
    /// A handle to this.
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

/// What handlers share.
#[derive(Debug)]
pub struct Shared {
    /// What use cases share.
    pub app: Arc<App>,
    /// Memory for request bodies.
    pub bodies: Arc<Semaphore>,
    /// Requests with an `Idempotency-Key` that are being carried out.
    pub in_flight: Arc<InFlight>,
    /// Documents that were made.
    pub documents: Documents,
    /// Places for those who follow events.
    pub event_streams: Arc<Places>,
    /// Reveals of epochs that are settled, as they are sent.
    pub reveals: Cache<String, Bytes>,
    /// Reads events for all who follow them.
    pub event_feed: EventFeed,
    /// Counts requests.
    pub rates: Arc<Rates>,
    /// Whether the database could be written and read lately.
    pub readiness: Readiness,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// The OpenAPI document, as JSON.
    pub openapi: Arc<str>,
}

impl std::ops::Deref for Shared {
    type Target = App;

    fn deref(&self) -> &App {
        &self.app
    }
}
