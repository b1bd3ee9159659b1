//! What handlers share.

use std::sync::Arc;

use metrics_exporter_prometheus::PrometheusHandle;
use tokio::sync::{Notify, Semaphore};

use crate::store::Store;
use crate::tasks::catalogue::Entry;

use super::problem::{ApiError, ApiResult};

/// What handlers share; clones are handles.
#[derive(Debug, Clone)]
pub struct AppState {
    /// The database.
    pub store: Store,
    /// Tells the workers that there is work.
    pub wake: Arc<Notify>,
    /// Memory for request bodies.
    pub bodies: Arc<Semaphore>,
    /// Renders the metrics.
    pub metrics: PrometheusHandle,
    /// The OpenAPI document, as JSON.
    pub openapi: Arc<str>,
}

impl AppState {
    /// The suite of this name, or name and version; one that another process added is found too.
    ///
    /// # Errors
    /// 404 where there is none.
    pub async fn suite(&self, name: &str) -> ApiResult<Arc<Entry>> {
        if let Some(entry) = self.store.catalogue().suite(name) {
            return Ok(Arc::clone(entry));
        }
        let catalogue = self.store.refresh_catalogue().await?;
        catalogue.suite(name).cloned().ok_or_else(|| ApiError::not_found(format!("there is no suite {name:?}")))
    }
}
