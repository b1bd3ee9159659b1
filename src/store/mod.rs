//! The store: everything that is kept, in one SQLite file. All SQL is in this room, one file per table.
//!
//! One connection writes, in one transaction per change of state; a few read. A write is durable before its function
//! returns (WAL, synchronous=FULL).

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
mod job_ends;
pub mod jobs;
pub mod keys;
mod migrations;
mod pace;
pub mod queue;
pub mod quota;
pub mod readiness;
pub mod receipts;
pub mod registration;
pub mod regrades;
pub mod reports;
mod reservations;
mod rows;
mod run_ends;
pub mod runs;
pub mod schema;
pub mod secrets;
mod settling;
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

/// A write transaction.
pub type Tx = Transaction<'static, Sqlite>;

/// Connections that read at the same time.
const READERS: u32 = 4;
/// How long a statement waits for another process that writes.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// What can go wrong in the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database refused, failed, or holds something that it should not.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// The file's schema could not be brought up to date.
    #[error("migration: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// There is no such file.
    #[error("there is no database {}; `plumbline serve` makes one, and so does `plumbline migrate --create`", .0.display())]
    Missing(std::path::PathBuf),
    /// The file was written by a newer program.
    #[error(
        "the database {} was written by a newer plumbline (schema {found}, this one knows up to {known}): use that program, \
         or a backup from before",
        file.display()
    )]
    Newer {
        /// The file.
        file: std::path::PathBuf,
        /// Its last migration.
        found: i64,
        /// The last one of this program.
        known: i64,
    },
    /// The file's schema is older than this program's.
    #[error(
        "the database {} has schema {found}, and this plumbline needs {known}: `plumbline migrate` brings it up to date \
         (with --dry-run it only says what it would do), and so does `plumbline serve`",
        file.display()
    )]
    Older {
        /// The file.
        file: std::path::PathBuf,
        /// Its last migration.
        found: i64,
        /// The last one of this program.
        known: i64,
    },
    /// The library that the program was built with is too old.
    #[error("SQLite {0} may corrupt a database with a write-ahead log; 3.51.3 or newer is needed")]
    OldSqlite(String),
    /// The file is a database of another program.
    #[error("the file holds tables of another program")]
    Foreign,
    /// A file of secrets cannot be read or written.
    #[error("{}: {detail}", path.display())]
    Secret {
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong with it.
        detail: String,
    },
    /// A stored row does not read back as what was written.
    #[error("row of {table}: {detail}")]
    Corrupt {
        /// Table of the row.
        table: &'static str,
        /// What is wrong with it.
        detail: String,
    },
}

impl StoreError {
    /// Whether the database was only busy: the same may succeed in a moment.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        match self {
            Self::Database(sqlx::Error::PoolTimedOut) => true,
            Self::Database(sqlx::Error::Database(error)) => error.message().contains("database is locked"),
            _ => false,
        }
    }

    /// A stored row that does not read back.
    pub fn corrupt(table: &'static str, detail: impl std::fmt::Display) -> Self {
        Self::Corrupt { table, detail: detail.to_string() }
    }
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
    /// Opens the file, creates it where it is missing, and brings its schema up to date.
    ///
    /// # Errors
    /// Where the file cannot be opened or migrated; where it was written by a newer program.
    pub async fn open(file: &Path) -> StoreResult<Self> {
        Self::open_as(file, true).await
    }

    /// Opens a file that is there and has the schema of this program. Neither makes nor changes one.
    ///
    /// # Errors
    /// Where there is no such file, its schema is another, or it cannot be opened.
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
            // A commit or rollback that failed, as on a full disk, leaves a connection that counts as in a transaction for ever.
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

    /// Bytes of the file and of its write-ahead log.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        let mut log = self.file.as_os_str().to_owned();
        log.push("-wal");
        let size = |path: &Path| std::fs::metadata(path).map_or(0, |data| data.len());
        size(&self.file) + size(Path::new(&log))
    }

    /// Secrets beside the database.
    #[must_use]
    pub const fn secrets(&self) -> &Secrets {
        &self.secrets
    }

    /// The key that signs receipts, read or made when it is first needed.
    ///
    /// # Errors
    /// Where it cannot be read or made.
    pub fn signer(&self) -> StoreResult<Arc<Signer>> {
        if let Some(signer) = self.signer.get() {
            return Ok(Arc::clone(signer));
        }
        let signer = Arc::new(self.secrets.signer()?);
        Ok(Arc::clone(self.signer.get_or_init(|| signer)))
    }

    /// Begins a write transaction; waits for the one before it.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn begin(&self) -> StoreResult<Tx> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// Counts the runs that this process has ended: where it has not moved, neither has any board, but for what other
    /// processes on the same file did.
    #[must_use]
    pub fn runs_ended(&self) -> u64 {
        self.runs_ended.load(Ordering::Acquire)
    }

    /// Returns what is notified when this process has queued jobs, once that is durable.
    #[must_use]
    pub fn queued(&self) -> &Notify {
        &self.queued
    }

    /// Is notified when submissions have ended in this process.
    #[must_use]
    pub fn ends(&self) -> &Notify {
        &self.ends
    }

    /// Says that submissions or runs have ended, once that is durable.
    fn note_ends(&self, has_run_ended: bool) {
        if has_run_ended {
            self.runs_ended.fetch_add(1, Ordering::AcqRel);
        }
        self.ends.notify_waiters();
    }

    /// Notes that jobs were graded, for the estimate of how long others wait.
    pub fn note_graded(&self, jobs: usize) {
        self.pace.note(jobs);
    }

    /// Seconds between the ends of two jobs, lately; none where none ended lately.
    #[must_use]
    pub fn seconds_a_job(&self) -> Option<f64> {
        self.pace.seconds_a_job()
    }

    /// Closes all connections, so that the file is whole without its WAL.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// Commits a transaction; what it is called tells tests where to end the process.
async fn commit(tx: Tx, what: &'static str) -> StoreResult<()> {
    crash_points::pass("before", what);
    tx.commit().await?;
    crash_points::pass("after", what);
    Ok(())
}

/// Takes a file of an older program from all but its owner: grades that are not told yet are in it.
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

/// Refuses an SQLite in which a writer and a checkpoint may corrupt the file (the WAL-reset bug that 3.51.3 mends).
async fn must_be_sound(pool: &SqlitePool) -> StoreResult<()> {
    const LEAST: [u32; 3] = [3, 51, 3];
    let version: String = sqlx::query_scalar("SELECT sqlite_version()").fetch_one(pool).await?;
    let parts: Vec<u32> = version.split('.').filter_map(|part| part.parse().ok()).collect();
    if parts.as_slice() >= LEAST.as_slice() { Ok(()) } else { Err(StoreError::OldSqlite(version)) }
}

/// Whether the database has tables, and none of them is ours.
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

/// Reads a compressed body back.
fn decompress(table: &'static str, bytes: &[u8]) -> StoreResult<Vec<u8>> {
    zstd::stream::decode_all(bytes).map_err(|error| StoreError::corrupt(table, error))
}
