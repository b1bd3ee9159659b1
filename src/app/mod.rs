//! Use cases: one function for each thing that the service does, whoever calls it.
//!
//! The API, pages, adapters, workers and commands call the same functions. A use case authorises, validates and
//! decides. It calls the store, and depends on neither axum nor SQL.

pub mod access;
pub mod accounts;
mod blocking;
pub mod boards;
pub mod body;
pub mod cards;
pub mod catalogue;
pub mod episodes;
pub mod error;
pub mod event_budget;
pub mod grading;
pub mod guide;
pub mod hidden;
pub mod limits;
pub mod load;
pub mod operator;
pub mod paging;
pub mod readiness;
pub mod replay;
pub mod rewards;
pub mod runs;
pub mod search;
pub mod signing;
pub mod stress;
pub mod structure_files;
pub mod submissions;
pub mod task_ref;
pub mod webhooks;

use std::sync::Arc;

use tokio_util::sync::CancellationToken;

use crate::actions::pool::Pool;
use crate::fair::{FairSlots, PermitPool};
use crate::store::{Store, StoreResult};
use access::Keys;
use boards::cache::Boards;
use error::{AppError, AppResult};
use hidden::log::TransparencyLog;
use limits::Limits;
use operator::Operator;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::hidden::tlog::cosignature::Witness;
use plumbline_engine::tasks::catalogue::{Catalogue, Entry};
use readiness::Readiness;
use rewards::grader::Grader;
use stress::StressFields;
use webhooks::WebhookSettings;

/// State that the use cases share.
#[derive(Debug)]
pub struct App {
    /// The database, which only use cases read and write.
    pub(in crate::app) store: Store,
    /// Grader of the logs of requests that wait for the result.
    pub grader: Arc<Grader>,
    /// Recently used keys.
    pub keys: Keys,
    /// Share of a suite that a run must cover to be compared on its board.
    least_coverage: f64,
    /// Boards in memory.
    boards: Boards,
    log: TransparencyLog,
    /// Latest result of probing the database.
    readiness: Readiness,
    /// Computes and caches stress fields.
    pub stress: StressFields,
    /// Limits in force: the defaults, with what `serve` sets.
    pub limits: Limits,
    /// Runs action code.
    pub actions: Pool,
    /// Slots for structure files that are unpacked.
    pub file_slots: Arc<FairSlots>,
    /// Permits for requests whose action code runs or waits.
    pub action_requests: Arc<PermitPool>,
    /// Signs receipts; none on a node that lacks the secrets.
    pub signer: Option<Arc<Signer>>,
    /// Public key that verifies what the service signs.
    pub receipt_key: String,
    /// Witnesses of the log whose cosignatures are taken.
    pub witnesses: Vec<Witness>,
    /// Settings of webhooks.
    pub webhooks: WebhookSettings,
    /// Who runs the service.
    pub operator: Operator,
    /// Cancelled when the service stops.
    pub stop: CancellationToken,
}

/// Parts from which the use cases are put together.
#[derive(Debug)]
pub struct AppParts {
    /// The database.
    pub store: Store,
    /// Grader of the logs of requests that wait for the result.
    pub grader: Grader,
    /// Recently used keys.
    pub keys: Keys,
    /// Share of a suite that a run must cover to be compared on its board.
    pub least_coverage: f64,
    /// Limits in force: the defaults, with what `serve` sets.
    pub limits: Limits,
    /// Runs action code.
    pub actions: Pool,
    /// Signs receipts; none on a node that lacks the secrets.
    pub signer: Option<Arc<Signer>>,
    /// Public key that verifies what the service signs.
    pub receipt_key: String,
    /// Witnesses of the log whose cosignatures are taken.
    pub witnesses: Vec<Witness>,
    /// Settings of webhooks.
    pub webhooks: WebhookSettings,
    /// Who runs the service.
    pub operator: Operator,
    /// Cancelled when the service stops.
    pub stop: CancellationToken,
}

impl App {
    /// Puts the use cases together.
    ///
    /// # Errors
    /// Returns an error if the threads that compute stress fields cannot be started.
    pub fn new(parts: AppParts) -> anyhow::Result<Self> {
        let AppParts {
            store,
            grader,
            keys,
            least_coverage,
            limits,
            actions,
            signer,
            receipt_key,
            witnesses,
            webhooks,
            operator,
            stop,
        } = parts;
        Ok(Self {
            store,
            grader: Arc::new(grader),
            keys,
            least_coverage,
            boards: Boards::default(),
            log: TransparencyLog::default(),
            readiness: Readiness::default(),
            stress: StressFields::new()?,
            limits,
            actions,
            file_slots: FairSlots::new(limits.structures_at_once, 1),
            action_requests: PermitPool::new(limits.action_requests, limits.action_requests_per_sender),
            signer,
            receipt_key,
            witnesses,
            webhooks,
            operator,
            stop,
        })
    }

    /// Returns the suites as last read. The catalogue is read again every few seconds.
    #[must_use]
    pub fn catalogue(&self) -> Arc<Catalogue> {
        self.store.catalogue()
    }

    /// Returns the suites as they are now, with those that another process has added.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn current_catalogue(&self) -> StoreResult<Arc<Catalogue>> {
        self.store.current_catalogue().await
    }

    /// Reads a request with the suites at hand, and once more if it names a suite or task that is not among them and
    /// another process has added some.
    ///
    /// # Errors
    /// Returns the error of the last reading, or an error if the database fails.
    pub async fn with_catalogue<T, F: Future<Output = AppResult<T>>>(
        &self,
        read: impl Fn(Arc<Catalogue>) -> F,
    ) -> AppResult<T> {
        let names_one =
            |error: &AppError| error.faults().iter().any(|fault| matches!(fault.pointer.as_str(), "/suite" | "/task"));
        let held = self.catalogue();
        let done = read(Arc::clone(&held)).await;
        if !done.as_ref().is_err_and(names_one) {
            return done;
        }
        let current = self.current_catalogue().await?;
        if Arc::ptr_eq(&held, &current) { done } else { read(current).await }
    }

    /// Finds a suite by its name, or by name and version, even if another process has added it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn find_suite(&self, name: &str) -> AppResult<Option<Arc<Entry>>> {
        // The catalogue is read again every few seconds, so a version that another process adds soon becomes the
        // latest.
        if let Some(entry) = self.catalogue().suite(name) {
            return Ok(Some(Arc::clone(entry)));
        }
        Ok(self.current_catalogue().await?.suite(name).cloned())
    }

    /// Returns a suite by its name, or by name and version.
    ///
    /// # Errors
    /// Returns an error if there is no such suite, or if the database fails.
    pub async fn suite(&self, name: &str) -> AppResult<Arc<Entry>> {
        let found = self.find_suite(name).await?;
        found.ok_or_else(|| AppError::not_found(catalogue::suites::no_suite(&self.catalogue(), name)))
    }
}
