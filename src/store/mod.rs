//! The store: all persistent data, in one SQLite file. This module contains all SQL, in one file per table.
//!
//! One connection writes, in one transaction per change of state; a few others read. A write is durable before its
//! function returns (WAL, synchronous=FULL).

pub mod boards;
pub mod copies;
mod crash_points;
pub mod entries;
pub mod epochs;
pub mod events;
mod evidence;
mod group_commit;
pub mod hidden_answers;
pub mod idempotency;
pub mod instances;
pub mod job_ends;
pub mod jobs;
pub mod keys;
mod migrations;
mod pace;
pub mod queue;
pub mod quota;
pub mod readiness;
mod receipt_keys;
pub mod receipts;
pub mod registration;
pub mod regrades;
pub mod reports;
mod reservations;
mod results;
mod rows;
mod run_ends;
pub mod run_rows;
pub mod runs;
pub mod schema;
pub mod secrets;
pub mod serving;
mod settling;
pub mod states;
pub mod submissions;
pub mod suites;
pub mod transfer;
pub mod transfer_tables;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock, RwLock};
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection as _, Sqlite, SqlitePool, Transaction};
use tokio::sync::Notify;

use epochs::SecretsRead;
use group_commit::Acceptances;
use migrations::MIGRATOR;
use pace::Pace;
use plumbline_engine::hidden::receipts::Signer;
use plumbline_engine::tasks::catalogue::Catalogue;
use secrets::Secrets;

/// Write transaction.
pub type Tx = Transaction<'static, Sqlite>;

/// Number of connections that read.
const READERS: u32 = 4;
/// Time for which a statement waits for another process that writes.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// Errors of the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database failed, refused a statement, or holds a value that it should not.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// The schema of the file could not be migrated.
    #[error("migration: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// The file does not exist.
    #[error("there is no database {}; `plumbline serve` and `plumbline migrate --create` create one", .0.display())]
    Missing(std::path::PathBuf),
    /// The file was written by a newer version of the program.
    #[error(
        "the database {} was written by a newer plumbline (schema {found}, this one knows up to {known}): use the \
         newer program or an older backup",
        file.display()
    )]
    Newer {
        /// Path of the database file.
        file: std::path::PathBuf,
        /// Version of the file's last migration.
        found: i64,
        /// Version of this program's last migration.
        known: i64,
    },
    /// The schema of the file is older than that of this program.
    #[error(
        "the database {} has schema {found}, but this plumbline needs {known}: `plumbline migrate` brings it up to \
         date (with --dry-run it only shows what it would do), and so does `plumbline serve`",
        file.display()
    )]
    Older {
        /// Path of the database file.
        file: std::path::PathBuf,
        /// Version of the file's last migration.
        found: i64,
        /// Version of this program's last migration.
        known: i64,
    },
    /// The SQLite library that the program was built with is too old.
    #[error("SQLite {0} may corrupt a database with a write-ahead log; 3.51.3 or newer is needed")]
    OldSqlite(String),
    /// The file is a database of another program.
    #[error("the file holds tables of another program")]
    Foreign,
    /// A file of secrets cannot be read or written.
    #[error("{}: {detail}", path.display())]
    Secret {
        /// Path of the file.
        path: std::path::PathBuf,
        /// Description of the fault.
        detail: String,
    },
    /// A stored row cannot be read, or holds invalid data.
    #[error("row of {table}: {detail}")]
    Corrupt {
        /// Table of the row.
        table: &'static str,
        /// Description of the fault.
        detail: String,
    },
}

impl StoreError {
    /// Returns whether the database was only busy, so that the same operation may succeed in a moment.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        match self {
            Self::Database(sqlx::Error::PoolTimedOut) => true,
            Self::Database(sqlx::Error::Database(error)) => error.code().is_some_and(|code| is_busy_code(&code)),
            _ => false,
        }
    }

    /// Creates the error for a stored row that cannot be read.
    pub fn corrupt(table: &'static str, detail: impl std::fmt::Display) -> Self {
        Self::Corrupt { table, detail: detail.to_string() }
    }
}

/// Returns whether a result code of SQLite says that another connection holds a lock. The low byte is the primary code; the
/// rest says why.
fn is_busy_code(code: &str) -> bool {
    const SQLITE_BUSY: i32 = 5;
    const SQLITE_LOCKED: i32 = 6;
    code.parse::<i32>().is_ok_and(|code| matches!(code & 0xff, SQLITE_BUSY | SQLITE_LOCKED))
}

/// Result of a store function.
pub type StoreResult<T> = Result<T, StoreError>;

/// Handle to the database; clones share its connections.
#[derive(Debug, Clone)]
pub struct Store {
    writer: SqlitePool,
    readers: SqlitePool,
    acceptances: Acceptances,
    runs_ended: Arc<AtomicU64>,
    ends: Arc<Notify>,
    queued: Arc<Notify>,
    pace: Arc<Pace>,
    catalogue: Arc<RwLock<Arc<Catalogue>>>,
    file: Arc<Path>,
    secrets: Secrets,
    signer: Arc<OnceLock<Arc<Signer>>>,
    secrets_read: Arc<SecretsRead>,
}

impl Store {
    /// Opens the file, creates it if it does not exist, and brings its schema up to date.
    ///
    /// # Errors
    /// Returns an error if the file cannot be opened or migrated, or was written by a newer program.
    pub async fn open(file: &Path) -> StoreResult<Self> {
        Self::open_as(file, true).await
    }

    /// Opens an existing file that has the schema of this program. Never creates or migrates a file.
    ///
    /// # Errors
    /// Returns an error if the file does not exist, has a different schema, or cannot be opened.
    pub async fn open_existing(file: &Path) -> StoreResult<Self> {
        let state = schema::state(file).await?;
        state.must_be_current(file)?;
        Self::open_as(file, false).await
    }

    async fn open_as(file: &Path, may_change: bool) -> StoreResult<Self> {
        let options = SqliteConnectOptions::new()
            .filename(file)
            .create_if_missing(may_change)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT);
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .test_before_acquire(false)
            // A failed commit or rollback, as on a full disk, leaves a connection that counts as in a transaction for
            // ever.
            .before_acquire(|connection, _| {
                let is_sound = !connection.is_in_transaction();
                Box::pin(async move { Ok(is_sound) })
            })
            .idle_timeout(None)
            .max_lifetime(None)
            .connect_with(options.clone())
            .await?;
        if holds_something_else(&writer).await? {
            return Err(StoreError::Foreign);
        }
        must_be_sound(&writer).await?;
        if may_change {
            schema::state(file).await?.must_not_be_newer(file)?;
            MIGRATOR.run(&writer).await?;
            keep_to_owner(file);
        }
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .test_before_acquire(false)
            .idle_timeout(None)
            .max_lifetime(None)
            .connect_with(options.read_only(true))
            .await?;
        let queued = Arc::<Notify>::default();
        let acceptances = Acceptances::start(writer.clone(), Arc::clone(&queued));
        let store = Self {
            writer,
            readers,
            acceptances,
            runs_ended: Arc::default(),
            ends: Arc::default(),
            queued,
            pace: Arc::default(),
            catalogue: Arc::default(),
            file: file.into(),
            secrets: Secrets::beside(file),
            signer: Arc::default(),
            secrets_read: Arc::default(),
        };
        store.refresh_catalogue().await?;
        Ok(store)
    }

    /// Returns the size of the file and its write-ahead log, in bytes.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        let mut log = self.file.as_os_str().to_owned();
        log.push("-wal");
        let size = |path: &Path| std::fs::metadata(path).map_or(0, |data| data.len());
        size(&self.file) + size(Path::new(&log))
    }

    /// Returns the secrets in the files beside the database.
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
        let signer = Arc::new(self.secrets.signer()?);
        Ok(Arc::clone(self.signer.get_or_init(|| signer)))
    }

    /// Begins a write transaction, after waiting for the previous one to end.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn begin(&self) -> StoreResult<Tx> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// Returns the number of changes of boards in this process, such as ended runs. While it is unchanged, only other
    /// processes on the same file may have changed a board.
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

    /// Closes all connections, so that the file is complete without its WAL.
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

/// Restricts a file of an older program to its owner, because it contains grades that are not public yet.
fn keep_to_owner(file: &Path) {
    use std::os::unix::fs::PermissionsExt as _;
    for ending in ["", "-wal", "-shm"] {
        let mut name = file.as_os_str().to_owned();
        name.push(ending);
        let Ok(found) = std::fs::metadata(&name) else { continue };
        let mode = found.permissions().mode();
        if mode & 0o077 != 0
            && let Err(error) = std::fs::set_permissions(&name, std::fs::Permissions::from_mode(mode & 0o700))
        {
            tracing::warn!(%error, file = %file.display(), "others can read the database, and this process cannot change that");
        }
    }
}

/// Refuses SQLite versions in which a writer and a checkpoint may corrupt the file (the WAL-reset bug fixed in 3.51.3).
async fn must_be_sound(pool: &SqlitePool) -> StoreResult<()> {
    const LEAST: [u32; 3] = [3, 51, 3];
    let version: String = sqlx::query_scalar("SELECT sqlite_version()").fetch_one(pool).await?;
    let parts: Vec<u32> = version.split('.').filter_map(|part| part.parse().ok()).collect();
    if parts.as_slice() >= LEAST.as_slice() { Ok(()) } else { Err(StoreError::OldSqlite(version)) }
}

/// Returns whether the database has tables of which none is ours.
async fn holds_something_else(pool: &SqlitePool) -> StoreResult<bool> {
    let (tables, ours): (i64, i64) = sqlx::query_as(
        "SELECT COUNT(*), COALESCE(SUM(name = '_sqlx_migrations'), 0) FROM sqlite_master WHERE type = 'table'",
    )
    .fetch_one(pool)
    .await?;
    Ok(tables > 0 && ours == 0)
}

/// Compresses a body for storage.
fn compress(bytes: &[u8]) -> StoreResult<Vec<u8>> {
    zstd::bulk::compress(bytes, 3).map_err(|error| StoreError::corrupt("compression", error))
}

/// Decompresses a stored body.
fn decompress(table: &'static str, bytes: &[u8]) -> StoreResult<Vec<u8>> {
    zstd::stream::decode_all(bytes).map_err(|error| StoreError::corrupt(table, error))
}
