//! What handlers share.

use std::sync::Arc;

use bytes::Bytes;
use metrics_exporter_prometheus::PrometheusHandle;
use quick_cache::sync::Cache;
use tokio::sync::{Notify, Semaphore};
use tokio_util::sync::CancellationToken;

use crate::actions::pool::Pool;
use crate::store::Store;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::tasks::catalogue::Entry;

use super::api::health::Readiness;
use super::api::stress::StressFields;
use super::boards::Boards;
use super::caller::Keys;
use super::conditional::Documents;
use super::event_feed::EventFeed;
use super::grader::Grader;
use super::idempotency::InFlight;
use super::limits::Limits;
use super::problem::{ApiError, ApiResult};
use super::rates::Rates;
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
    /// The database.
    pub store: Store,
    /// Tells the workers that there is work.
    pub wake: Arc<Notify>,
    /// Memory for request bodies.
    pub bodies: Arc<Semaphore>,
    /// Grades logs for requests that wait.
    pub grader: Arc<Grader>,
    /// Keys that were used lately.
    pub keys: Keys,
    /// Requests with an `Idempotency-Key` that are being carried out.
    pub in_flight: Arc<InFlight>,
    /// The share of a suite that a run must cover to be compared on its board.
    pub least_coverage: f64,
    /// Boards in memory.
    pub boards: Boards,
    /// Documents that were made.
    pub documents: Documents,
    /// Computes stress fields, and keeps them.
    pub stress: StressFields,
    /// Places for those who follow events.
    pub event_streams: Arc<Places>,
    /// Reveals of epochs that are settled, as they are sent.
    pub reveals: Cache<String, Bytes>,
    /// Reads events for all who follow them.
    pub event_feed: EventFeed,
    /// The limits in force.
    pub limits: Limits,
    /// Counts requests.
    pub rates: Arc<Rates>,
    /// Runs action code.
    pub actions: Pool,
    /// Signs receipts.
    pub signer: Arc<Signer>,
    /// Places for requests whose action code runs or waits.
    pub action_requests: Arc<Places>,
    /// Whether the database could be written and read lately.
    pub readiness: Readiness,
    /// Cancelled when the service stops.
    pub stop: CancellationToken,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// The OpenAPI document, as JSON.
    pub openapi: Arc<str>,
}

impl Shared {
    /// The suite of this name, or name and version, if there is one; one that another process added is found too.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn find_suite(&self, name: &str) -> ApiResult<Option<Arc<Entry>>> {
        // What is held is looked at again every few seconds, so a version that another process adds is soon the latest.
        if let Some(entry) = self.store.catalogue().suite(name) {
            return Ok(Some(Arc::clone(entry)));
        }
        Ok(self.store.current_catalogue().await?.suite(name).cloned())
    }

    /// The suite of this name, or name and version.
    ///
    /// # Errors
    /// 404 where there is none.
    pub async fn suite(&self, name: &str) -> ApiResult<Arc<Entry>> {
        self.find_suite(name).await?.ok_or_else(|| ApiError::not_found(format!("there is no suite {name:?}")))
    }
}
