//! Use cases: one function for each thing that the service does, whoever calls it.
//!
//! The API, pages, adapters, workers and commands call the same functions. A use case authorizes, validates and
//! decides. It calls the store, and depends on neither axum nor SQL.

pub mod access;
pub mod boards;
pub mod body;
pub mod error;
pub mod grading;
pub mod hidden;
pub mod limits;
pub mod load;
pub mod readiness;
pub mod replay;
pub mod rewards;
pub mod stress;
pub mod submissions;

use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use crate::actions::pool::Pool;
use crate::fair::PermitPool;
use crate::store::Store;
use access::Keys;
use boards::Boards;
use error::{AppError, AppResult};
use limits::Limits;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::tasks::catalogue::Entry;
use rewards::grader::Grader;
use stress::StressFields;

/// State that the use cases share.
#[derive(Debug)]
pub struct App {
    /// The database.
    pub store: Store,
    /// Grader of the logs of requests that wait for the result.
    pub grader: Arc<Grader>,
    /// Recently used keys.
    pub keys: Keys,
    /// Share of a suite that a run must cover to be compared on its board.
    pub least_coverage: f64,
    /// Boards in memory.
    pub boards: Boards,
    /// Computes and caches stress fields.
    pub stress: StressFields,
    /// Limits in force.
    pub limits: Limits,
    /// Runs action code.
    pub actions: Pool,
    /// Slots for requests whose action code runs or waits.
    pub action_requests: Arc<PermitPool>,
    /// Signs receipts.
    pub signer: Arc<Signer>,
    /// Cancelled when the service stops.
    pub stop: CancellationToken,
}

impl App {
    /// Finds a suite by its name, or by name and version, even if another process has added it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn find_suite(&self, name: &str) -> AppResult<Option<Arc<Entry>>> {
        // The catalogue is read again every few seconds, so a version that another process adds soon becomes the latest.
        if let Some(entry) = self.store.catalogue().suite(name) {
            return Ok(Some(Arc::clone(entry)));
        }
        Ok(self.store.current_catalogue().await?.suite(name).cloned())
    }

    /// Returns a suite by its name, or by name and version.
    ///
    /// # Errors
    /// Returns an error if there is no such suite, or if the database fails.
    pub async fn suite(&self, name: &str) -> AppResult<Arc<Entry>> {
        self.find_suite(name).await?.ok_or_else(|| AppError::not_found(format!("there is no suite {name:?}")))
    }
}
