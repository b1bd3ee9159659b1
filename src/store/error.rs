//! Errors of the store.

use std::path::PathBuf;
use std::sync::Arc;

use super::location::Location;

/// Beginning of what is said of an object that is gone or damaged.
pub const LOST: &str = "a blob is lost";

/// Errors of the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database failed, refused a statement, or holds a value that it should not.
    #[error("database: {0}{hint}", hint = remedy(.0))]
    Database(#[from] sqlx::Error),
    /// The schema of the database could not be migrated.
    #[error("migration: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// The database does not exist.
    #[error("there is no database {0}; `plumbline serve` and `plumbline migrate --create` create one")]
    Missing(Location),
    /// The database on a server has no tables.
    #[error("the database {0} has no tables yet; `plumbline serve` and `plumbline migrate --create` make them")]
    Empty(Location),
    /// The database is not named in a way that can be read. Says nothing of the name: it may hold a password.
    #[error("--database: {0}")]
    Unreadable(String),
    /// The database was written by a newer version of the program.
    #[error(
        "the database {database} was written by a newer plumbline (schema {found}, this one knows up to {known}): use \
         the newer program or an older backup"
    )]
    Newer {
        /// The database.
        database: Location,
        /// Version of its last migration.
        found: i64,
        /// Version of this program's last migration.
        known: i64,
    },
    /// The schema of the database is older than that of this program.
    #[error(
        "the database {database} has schema {found}, but this plumbline needs {known}: `plumbline migrate` brings it up \
         to date (with --dry-run it only shows what it would do), and so does `plumbline serve`"
    )]
    Older {
        /// The database.
        database: Location,
        /// Version of its last migration.
        found: i64,
        /// Version of this program's last migration.
        known: i64,
    },
    /// The SQLite library that the program was built with is too old.
    #[error("SQLite {0} may corrupt a database with a write-ahead log; 3.51.3 or newer is needed")]
    OldSqlite(String),
    /// The PostgreSQL server is too old.
    #[error(
        "the server {database} is PostgreSQL {found}, but plumbline needs {needed} or newer: upgrade it (`pg_upgrade`), or \
         give the URL of a newer server"
    )]
    OldServer {
        /// The database.
        database: Location,
        /// Version of the server.
        found: String,
        /// First version that serves.
        needed: u32,
    },
    /// The PostgreSQL server cannot be reached, or refuses the connection.
    #[error("cannot connect to {database}: {detail}; {remedy}")]
    Unreachable {
        /// The database.
        database: Location,
        /// Words of the server or the operating system.
        detail: String,
        /// What the operator can do.
        remedy: &'static str,
    },
    /// The role may not do what the service needs.
    #[error(
        "the role may not do what plumbline needs in {database} ({detail}): make it the owner of the database and of its \
         tables, or grant it CREATE on the schema and ALL on the tables in it"
    )]
    NoRights {
        /// The database.
        database: Location,
        /// Words of the server.
        detail: String,
    },
    /// The database file is not where it was when it was opened.
    #[error(
        "the database file {file} was deleted, moved or replaced while the service runs, so nothing is stored any more. Stop \
         the service, then put the file back with its -wal (a file that was deleted: copy both from /proc/PID/fd before), or \
         move both away and restore a backup", file = .0.display()
    )]
    LostFile(PathBuf),
    /// The command works on files only.
    #[error("{0}")]
    OnlyFiles(&'static str),
    /// The database belongs to another program.
    #[error(
        "the database holds tables of another program: give plumbline one of its own (another file, or what `createdb` makes)"
    )]
    Foreign,
    /// A file of secrets cannot be read or written.
    #[error("{}: {detail}", path.display())]
    Secret {
        /// Path of the file.
        path: PathBuf,
        /// Description of the fault.
        detail: String,
    },
    /// The node lacks the secrets of the service.
    #[error("this node lacks the secrets of the service: there is no receipts.key in {}", .0.display())]
    NoSecrets(PathBuf),
    /// A place of blobs that cannot be used as asked for.
    #[error("--blobs: {0}")]
    BlobPlace(String),
    /// The place of blobs cannot be reached, or refuses a request.
    #[error("cannot reach the blobs in {place}: {detail}")]
    Blobs {
        /// The place.
        place: String,
        /// Words of its server or of the operating system.
        detail: String,
    },
    /// A transaction failed that stored this request together with others.
    #[error(transparent)]
    Group(Arc<StoreError>),
    /// A line of an export cannot be written.
    #[error("cannot write the export: {0}")]
    Export(std::io::Error),
    /// The operating system provides no random bytes.
    #[error("the operating system provides no random bytes: {0}")]
    NoRandom(getrandom::Error),
    /// An object that a row refers to is gone or damaged.
    #[error("{LOST}: {0}")]
    BlobLost(String),
    /// The program failed at something that has nothing to do with what is stored.
    #[error("{what}: {detail}")]
    Failed {
        /// What was done.
        what: &'static str,
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
            Self::Group(error) => error.is_busy(),
            Self::Database(sqlx::Error::PoolTimedOut | sqlx::Error::Io(_) | sqlx::Error::BeginFailed) => true,
            Self::Database(sqlx::Error::Database(error)) => error.code().is_some_and(|code| is_busy_code(&code)),
            _ => false,
        }
    }

    /// Returns whether the disk of the database is full, so that the same operation may succeed once there is room.
    #[must_use]
    pub fn is_full(&self) -> bool {
        match self {
            Self::Group(error) => error.is_full(),
            Self::Database(sqlx::Error::Database(error)) => error.code().is_some_and(|code| is_full_code(&code)),
            _ => false,
        }
    }

    /// Returns whether a statement before has ended the transaction.
    #[must_use]
    pub fn has_ended_transaction(&self) -> bool {
        const POSTGRES: &str = "25P02";
        matches!(self, Self::Database(sqlx::Error::Database(error)) if error.code().is_some_and(|code| code == POSTGRES))
    }

    /// Returns whether stored data is damaged, so that the same operation fails again.
    #[must_use]
    pub fn is_damage(&self) -> bool {
        match self {
            Self::Corrupt { .. } | Self::BlobLost(_) => true,
            Self::Database(sqlx::Error::Database(error)) => error.code().is_some_and(|code| is_damage_code(&code)),
            _ => false,
        }
    }

    /// Names the row in an error about damage.
    #[must_use]
    pub fn in_row(self, table: &'static str, row: &str) -> Self {
        match self {
            Self::Corrupt { detail, .. } => Self::corrupt(table, format!("{row}: {detail}")),
            Self::BlobLost(detail) => Self::BlobLost(format!("{detail}, which {table} {row} refers to")),
            other => other,
        }
    }

    /// Creates the error for a failure of the program.
    pub fn failed(what: &'static str, detail: impl std::fmt::Display) -> Self {
        Self::Failed { what, detail: detail.to_string() }
    }

    /// Creates the error for a stored row that cannot be read.
    pub fn corrupt(table: &'static str, detail: impl std::fmt::Display) -> Self {
        Self::Corrupt { table, detail: detail.to_string() }
    }
}

/// Says what the operator can do about a file that cannot be opened, of which SQLite says no more than that.
fn remedy(error: &sqlx::Error) -> &'static str {
    const POSTGRES_READ_ONLY: &str = "25006";
    const SQLITE_READONLY: i32 = 8;
    const SQLITE_CORRUPT: i32 = 11;
    const SQLITE_NOTADB: i32 = 26;
    const SQLITE_CANTOPEN: i32 = 14;
    let code = error.as_database_error().and_then(sqlx::error::DatabaseError::code);
    if code.as_deref() == Some(POSTGRES_READ_ONLY) {
        return "; the server takes no writes: it is a standby, or default_transaction_read_only is on";
    }
    match code.and_then(|code| code.parse::<i32>().ok()) {
        Some(code) if code & 0xff == SQLITE_CANTOPEN => {
            "; check that its folder exists, and that this user may read and write the file and create others beside it"
        }
        Some(code) if code & 0xff == SQLITE_CORRUPT => {
            "; the file is damaged: keep it, and restore the last backup (plumbline restore)"
        }
        Some(code) if code & 0xff == SQLITE_NOTADB => "; the file is no SQLite database, or its beginning is damaged",
        Some(code) if code & 0xff == SQLITE_READONLY => {
            "; check that this user may write the database file and create others beside it, and that the disk is not \
             mounted read-only"
        }
        _ => "",
    }
}

/// Returns whether a code of the database says that the same operation may succeed in a moment.
///
/// SQLite gives numbers, whose low byte is the primary code. PostgreSQL gives five characters (appendix A of its
/// manual): serialization failures, deadlocks, locks that are not available, a server that starts or stops, and one that
/// takes no writes, as a standby after a failover.
fn is_busy_code(code: &str) -> bool {
    const SQLITE_BUSY: i32 = 5;
    const SQLITE_LOCKED: i32 = 6;
    const POSTGRES: [&str; 10] =
        ["25006", "40001", "40P01", "55P03", "57014", "57P01", "57P02", "57P03", "25P03", "53300"];
    if code.len() == 5 {
        return POSTGRES.contains(&code) || code.starts_with("08");
    }
    code.parse::<i32>().is_ok_and(|code| matches!(code & 0xff, SQLITE_BUSY | SQLITE_LOCKED))
}

/// Returns whether a code of the database says that its files are damaged.
fn is_damage_code(code: &str) -> bool {
    const SQLITE_CORRUPT: i32 = 11;
    const SQLITE_NOTADB: i32 = 26;
    const POSTGRES: [&str; 2] = ["XX001", "XX002"];
    if code.len() == 5 {
        return POSTGRES.contains(&code);
    }
    code.parse::<i32>().is_ok_and(|code| matches!(code & 0xff, SQLITE_CORRUPT | SQLITE_NOTADB))
}

/// Returns whether a code of the database says that its disk is full.
fn is_full_code(code: &str) -> bool {
    const SQLITE_FULL: &str = "13";
    const POSTGRES: &str = "53100";
    code == SQLITE_FULL || code == POSTGRES
}

/// Result of a store function.
pub type StoreResult<T> = Result<T, StoreError>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn busy_is_told_from_the_code() {
        for code in ["5", "6", "261", "517", "40001", "40P01", "57P03", "08006"] {
            assert!(is_busy_code(code), "{code}");
        }
        for code in ["1", "11", "2067", "23505", "42P01"] {
            assert!(!is_busy_code(code), "{code}");
        }
    }

    #[test]
    fn a_full_disk_is_told_from_the_code() {
        for code in ["13", "53100"] {
            assert!(is_full_code(code), "{code}");
        }
        // Out of memory, a disk that fails, and PostgreSQL's other resources.
        for code in ["7", "10", "778", "53000", "53200", "53300"] {
            assert!(!is_full_code(code), "{code}");
        }
    }
}
