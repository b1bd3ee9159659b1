//! Schema of a database: which migrations it has, and migration on request.

use std::path::PathBuf;

use sqlx::migrate::Migrator;

use super::location::Location;
use super::migrations::SQLITE;
use super::{Store, StoreError, StoreResult, postgres, sqlite};

/// Migrations that a database has and lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SchemaState {
    /// Version of the database's last migration; 0 if it is missing or empty.
    pub found: i64,
    /// Version of this program's last migration.
    pub known: i64,
    /// Migrations that the database lacks, as number and name.
    pub lacking: Vec<(i64, String)>,
    /// Whether the database exists and has tables.
    pub is_there: bool,
}

impl SchemaState {
    /// Compares the migrations that a database had with those of the program; none if there is no database.
    pub(super) fn of(migrator: &Migrator, had: Option<&[i64]>) -> Self {
        let known = migrator.iter().map(|migration| migration.version).max().unwrap_or(0);
        let is_lacking = |version: i64| had.is_none_or(|had| !had.contains(&version));
        let lacking = migrator.iter().map(|migration| (migration.version, migration.description.to_string()));
        Self {
            found: had.and_then(|had| had.iter().copied().max()).unwrap_or(0),
            known,
            lacking: lacking.filter(|(version, _)| is_lacking(*version)).collect(),
            is_there: had.is_some(),
        }
    }

    /// Checks that the database was not written by a newer program.
    ///
    /// # Errors
    /// Returns an error if it was.
    pub fn must_not_be_newer(&self, database: &Location) -> StoreResult<()> {
        if self.found <= self.known {
            return Ok(());
        }
        Err(StoreError::Newer { database: database.clone(), found: self.found, known: self.known })
    }

    /// Checks that the database exists, was not written by a newer program, and is up to date.
    ///
    /// # Errors
    /// Returns an error if one of these does not hold.
    pub fn must_be_current(&self, database: &Location) -> StoreResult<()> {
        if !self.is_there {
            return Err(missing(database));
        }
        self.must_not_be_newer(database)?;
        if self.lacking.is_empty() {
            return Ok(());
        }
        Err(StoreError::Older { database: database.clone(), found: self.found, known: self.known })
    }
}

fn missing(database: &Location) -> StoreError {
    match database {
        Location::Server(_) => StoreError::Empty(database.clone()),
        _ => StoreError::Missing(database.clone()),
    }
}

/// Reads the schema state of a database without changing it.
///
/// # Errors
/// Returns an error if the database cannot be read, or belongs to another program.
pub async fn state(database: &Location) -> StoreResult<SchemaState> {
    match database {
        Location::Memory => Ok(SchemaState::of(&SQLITE, None)),
        Location::Unreadable(why) => Err(StoreError::Unreadable(why.clone())),
        Location::File(file) => sqlite::schema::state(file).await,
        Location::Server(server) => postgres::schema::state(server).await,
    }
}

/// Brings a database up to date. A file is copied first, and the path of the copy is returned. A database that is up to
/// date is not changed or copied.
///
/// # Errors
/// Returns an error if the database is missing, was written by a newer program, or cannot be copied or migrated.
pub async fn migrate(database: &Location) -> StoreResult<Option<PathBuf>> {
    let before = state(database).await?;
    if !before.is_there {
        return Err(missing(database));
    }
    before.must_not_be_newer(database)?;
    if before.lacking.is_empty() {
        return Ok(None);
    }
    let copy = match database {
        Location::File(file) => Some(sqlite::schema::keep_copy(file, before.found).await?),
        Location::Memory | Location::Unreadable(_) | Location::Server(_) => None,
    };
    Store::migrate_only(database).await?;
    Ok(copy)
}
