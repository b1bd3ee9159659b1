//! SQLite: one file beside the service. One connection writes; a few others read.

pub mod copies;
pub(super) mod schema;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection as _, SqlitePool};

use super::db::Pool;
use super::migrations::SQLITE;
use super::opened_file::OpenedFile;
use super::{StoreError, StoreResult};

/// Number of connections that read.
const READERS: u32 = 4;
/// Time for which a statement waits for another process that writes.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// Opens a file, and returns the pools that write and read. Creates the file and brings its schema up to date if
/// `may_change` is set.
pub(super) async fn open(file: &Path, may_change: bool) -> StoreResult<(Pool, Pool)> {
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
        // A failed commit or rollback, as on a full disk, leaves a connection that counts as in a transaction for ever.
        .before_acquire(|connection, _| {
            let is_sound = !connection.is_in_transaction();
            Box::pin(async move { Ok(is_sound) })
        })
        .idle_timeout(None)
        .max_lifetime(None)
        .connect_with(options.clone())
        .await?;
    if schema::holds_something_else(&writer).await? {
        return Err(StoreError::Foreign);
    }
    must_be_sound(&writer).await?;
    if may_change {
        schema::state(file).await?.must_not_be_newer(&file.to_owned().into())?;
        SQLITE.run(&writer).await?;
        keep_to_owner(file);
    }
    let readers = SqlitePoolOptions::new()
        .max_connections(READERS)
        .test_before_acquire(false)
        .idle_timeout(None)
        .max_lifetime(None)
        .connect_with(options.read_only(true))
        .await?;
    let file = OpenedFile::opened(file).map(Arc::new);
    Ok((Pool::Sqlite { pool: writer, file }, Pool::Sqlite { pool: readers, file: None }))
}

/// Opens an empty database in memory, with one connection that writes and reads.
pub(super) async fn open_in_memory() -> StoreResult<(Pool, Pool)> {
    let pool = SqlitePoolOptions::new()
        .max_connections(1)
        .min_connections(1)
        .idle_timeout(None)
        .max_lifetime(None)
        .connect_with(SqliteConnectOptions::new().in_memory(true).foreign_keys(true))
        .await?;
    SQLITE.run(&pool).await?;
    let both = Pool::Sqlite { pool, file: None };
    Ok((both.clone(), both))
}

/// Opens an existing file for reading alone.
pub(super) async fn open_reading(file: &Path) -> StoreResult<Pool> {
    let options = SqliteConnectOptions::new().filename(file).read_only(true);
    // One reads a snapshot, the other looks up where large logs are.
    let pool = SqlitePoolOptions::new().max_connections(2).connect_with(options).await?;
    Ok(Pool::Sqlite { pool, file: None })
}

/// Returns the size of a file and its write-ahead log, in bytes.
pub(super) fn file_bytes(file: &Path) -> u64 {
    let mut log = file.as_os_str().to_owned();
    log.push("-wal");
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |data| data.len());
    size(file) + size(Path::new(&log))
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
