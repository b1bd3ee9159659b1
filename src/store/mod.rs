//! The store: all persistent data, in a SQLite file or a PostgreSQL database. All SQL is here, in one file per table.
//!
//! Each change of state is one transaction, and is durable before its function returns. On SQLite one connection
//! writes and a few others read (WAL, synchronous=FULL). On PostgreSQL transactions take locks where they check before
//! they write (`locks.rs`).

pub mod acceptance;
pub mod blobs;
pub mod board_actions;
pub mod boards;
pub mod cards;
pub mod checking;
pub mod claims;
pub mod completion;
mod compression;
pub mod cosignatures;
mod crash_points;
pub mod db;
pub mod deliveries;
pub mod draws;
pub mod embargoes;
pub mod entries;
pub mod episodes;
pub mod epochs;
mod error;
pub mod events;
mod evidence;
pub mod failures;
mod group_commit;
pub mod hidden_answers;
pub mod holdings;
pub mod idempotency;
pub mod instances;
pub mod job_ends;
pub mod jobs;
pub mod keys;
mod leadership;
pub mod location;
mod locks;
pub mod members;
mod migrations;
pub mod moving;
mod moving_tables;
pub mod opened_file;
mod order_of_steps;
pub mod overview;
mod pace;
mod padding;
mod pending;
mod postgres;
pub mod queue;
pub mod quota;
pub mod readiness;
mod receipt_keys;
pub mod receipts;
pub mod registration;
pub mod regrades;
pub mod reports;
mod results;
mod rows;
mod run_ends;
pub mod run_rows;
pub mod runs;
pub mod schema;
pub mod secrets;
pub mod serving;
mod settling;
mod snapshot;
pub mod sqlite;
pub mod states;
pub mod submissions;
pub mod suites;
pub mod transfer;
pub mod transfer_tables;
pub mod webhooks;

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock, RwLock};

use tokio::sync::Notify;

use blobs::Blobs;
use claims::Looks;
use db::{Each, Pool, Tx, query_scalar};
use epochs::SecretsRead;
pub use error::{LOST, StoreError, StoreResult};
use group_commit::Acceptances;
use location::Location;
use opened_file::OpenedFile;
use pace::Pace;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::tasks::catalogue::Catalogue;
use secrets::{Secrets, random_key};

/// Handle to the database; clones share its connections.
#[derive(Debug, Clone)]
pub struct Store {
    writer: Pool,
    readers: Pool,
    acceptances: Acceptances,
    runs_ended: Arc<AtomicU64>,
    ends: Arc<Notify>,
    queued: Arc<Notify>,
    pace: Arc<Pace>,
    looks: Arc<[Looks; 3]>,
    catalogue: Arc<RwLock<Arc<Catalogue>>>,
    location: Arc<Location>,
    secrets: Secrets,
    signer: Arc<OnceLock<Arc<Signer>>>,
    secrets_read: Arc<SecretsRead>,
    blobs: Blobs,
}

impl Store {
    /// Opens a database, creates a file that does not exist, and brings the schema up to date. Secrets are in this
    /// folder, or in the default one of the location.
    ///
    /// # Errors
    /// Returns an error if the database cannot be opened or migrated, or was written by a newer program.
    pub async fn open(location: &Location, secrets: Option<PathBuf>) -> StoreResult<Self> {
        Self::open_as(location, secrets, true).await
    }

    /// Opens an existing database that has the schema of this program. Never creates or migrates one.
    ///
    /// # Errors
    /// Returns an error if the database does not exist, has a different schema, or cannot be opened.
    pub async fn open_existing(location: &Location, secrets: Option<PathBuf>) -> StoreResult<Self> {
        schema::state(location).await?.must_be_current(location)?;
        Self::open_as(location, secrets, false).await
    }

    /// Brings the schema of a database up to date, and does nothing else.
    async fn migrate_only(location: &Location) -> StoreResult<()> {
        let (writer, readers) = pools(location, true).await?;
        writer.close().await;
        readers.close().await;
        Ok(())
    }

    async fn open_as(location: &Location, secrets: Option<PathBuf>, may_change: bool) -> StoreResult<Self> {
        let (writer, readers) = pools(location, may_change).await?;
        let blobs = Blobs::open(&readers).await?;
        let queued = Arc::<Notify>::default();
        let store = Self {
            acceptances: Acceptances::start(writer.clone(), Arc::clone(&queued)),
            writer,
            readers,
            runs_ended: Arc::default(),
            ends: Arc::default(),
            queued,
            pace: Arc::default(),
            looks: Arc::default(),
            catalogue: Arc::default(),
            secrets: Secrets::in_folder(secrets.unwrap_or_else(|| location.default_secrets())),
            location: Arc::new(location.clone()),
            signer: Arc::default(),
            secrets_read: Arc::default(),
            blobs,
        };
        store.refresh_catalogue().await?;
        Ok(store)
    }

    /// Follows the notices of other nodes, which wake this one. Does nothing on SQLite.
    pub fn follow_notices(&self) {
        if let Pool::Postgres(pool) = &self.readers {
            let (queued, ends) = (Arc::clone(&self.queued), Arc::clone(&self.ends));
            postgres::notices::follow(pool.clone(), queued, ends, Arc::clone(&self.runs_ended));
        }
    }

    /// Returns the size of the database in bytes: of the file and its write-ahead log, or as the server tells it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn bytes(&self) -> StoreResult<u64> {
        if let Some(file) = self.location.file() {
            return Ok(sqlite::file_bytes(file));
        }
        let bytes: i64 = query_scalar(Each {
            sqlite: "SELECT page_count * page_size FROM pragma_page_count(), pragma_page_size()",
            postgres: "SELECT pg_database_size(current_database())",
        })
        .fetch_one(&self.readers)
        .await?;
        Ok(bytes.unsigned_abs())
    }

    /// Returns where the database is.
    #[must_use]
    pub fn location(&self) -> &Location {
        &self.location
    }

    /// Returns the folder of the secrets.
    #[must_use]
    pub const fn secrets(&self) -> &Secrets {
        &self.secrets
    }

    /// Returns the key that signs receipts. It is read, or created, when it is first needed.
    ///
    /// # Errors
    /// Returns an error if the key cannot be read or created.
    pub fn signer(&self) -> StoreResult<Arc<Signer>> {
        if let Some(signer) = self.signer.get() {
            return Ok(Arc::clone(signer));
        }
        // Nodes of one server share a key; making one here would be another.
        if matches!(*self.location, Location::Server(_)) && !self.secrets.has_signer()? {
            return Err(StoreError::NoSecrets(self.secrets.folder().to_owned()));
        }
        let signer = Arc::new(match *self.location {
            // Nothing is signed here that anybody could ask for later.
            Location::Memory => Signer::new(&random_key()?),
            _ => self.secrets.signer()?,
        });
        Ok(Arc::clone(self.signer.get_or_init(|| signer)))
    }

    /// Returns the database file as it was opened; `None` if the database is not a file.
    #[must_use]
    pub fn file(&self) -> Option<&OpenedFile> {
        match &self.writer {
            Pool::Sqlite { file, .. } => file.as_deref(),
            Pool::Postgres(_) => None,
        }
    }

    /// Begins a write transaction; on SQLite after the previous one has ended.
    ///
    /// # Errors
    /// Returns an error if the database fails, or its file is not where it was.
    pub async fn begin(&self) -> StoreResult<Tx> {
        self.writer.begin_writing().await
    }

    /// Returns the number of changes of boards that this process knows of, such as ended runs: its own, and those that
    /// other nodes told. While it is unchanged, only processes that tell nothing may have changed a board.
    #[must_use]
    pub fn runs_ended(&self) -> u64 {
        self.runs_ended.load(Ordering::Acquire)
    }

    /// Returns the notifier that fires after this process has durably queued jobs.
    #[must_use]
    pub fn queued(&self) -> &Notify {
        &self.queued
    }

    /// Returns the notifier that fires after submissions have ended in this process.
    #[must_use]
    pub fn ends(&self) -> &Notify {
        &self.ends
    }

    /// Announces that submissions or runs have ended. Call it only after the commit.
    fn note_ends(&self, has_run_ended: bool) {
        if has_run_ended {
            self.runs_ended.fetch_add(1, Ordering::AcqRel);
        }
        self.ends.notify_waiters();
    }

    /// Records that jobs were graded, for the estimate of waiting times.
    pub fn note_graded(&self, jobs: usize) {
        self.pace.note(jobs);
    }

    /// Returns the recent mean time between the ends of two jobs, in seconds; none if no estimate exists yet.
    #[must_use]
    pub fn seconds_a_job(&self) -> Option<f64> {
        self.pace.seconds_a_job()
    }

    /// Closes all connections, so that a file is complete without its WAL.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// Commits a transaction; `what` names the crash point at which tests can end the process.
async fn commit(tx: Tx, what: &'static str) -> StoreResult<()> {
    crash_points::pass("before", what);
    tx.commit().await?;
    crash_points::pass("after", what);
    Ok(())
}

/// Opens the pools of a database that write and read.
async fn pools(location: &Location, may_change: bool) -> StoreResult<(Pool, Pool)> {
    match location {
        Location::Memory => sqlite::open_in_memory().await,
        Location::Unreadable(why) => Err(StoreError::Unreadable(why.clone())),
        Location::File(file) => sqlite::open(file, may_change).await,
        Location::Server(server) => {
            let pool = postgres::open(server, may_change).await?;
            Ok((pool.clone(), pool))
        }
    }
}
