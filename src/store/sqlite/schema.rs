//! Schema of a SQLite file: which migrations it has, and migration on request.

use std::path::{Path, PathBuf};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _, SqlitePool};

use super::copies;
use crate::clock::now_ms;
use crate::store::migrations::SQLITE;
use crate::store::schema::SchemaState;
use crate::store::{StoreError, StoreResult};

const TABLES: &str =
    "SELECT COUNT(*), COALESCE(SUM(name = '_sqlx_migrations'), 0) FROM sqlite_master WHERE type = 'table'";

/// Returns whether the database has tables of which none is ours.
pub(super) async fn holds_something_else(pool: &SqlitePool) -> StoreResult<bool> {
    let (tables, ours): (i64, i64) = sqlx::query_as(TABLES).fetch_one(pool).await?;
    Ok(tables > 0 && ours == 0)
}

/// Reads the schema state of a file without changing the file.
pub(in crate::store) async fn state(file: &Path) -> StoreResult<SchemaState> {
    if !file.exists() {
        return Ok(SchemaState::of(&SQLITE, None));
    }
    let mut connection = SqliteConnectOptions::new().filename(file).read_only(true).connect().await?;
    let (tables, ours): (i64, i64) = sqlx::query_as(TABLES).fetch_one(&mut connection).await?;
    if tables > 0 && ours == 0 {
        return Err(StoreError::Foreign);
    }
    let had: Vec<i64> = if ours == 0 {
        Vec::new()
    } else {
        sqlx::query_scalar("SELECT version FROM _sqlx_migrations WHERE success").fetch_all(&mut connection).await?
    };
    connection.close().await?;
    Ok(SchemaState::of(&SQLITE, Some(&had)))
}

/// Copies a file to another beside it, before a migration, and returns the path of the copy.
pub(in crate::store) async fn keep_copy(file: &Path, found: i64) -> StoreResult<PathBuf> {
    let mut copy = PathBuf::from(format!("{}.schema-{found}", file.display()));
    if copy.exists() {
        // The copy is from an earlier migration and must not be overwritten.
        copy = PathBuf::from(format!("{}.{}", copy.display(), now_ms()));
    }
    copies::copy(file, &copy).await?;
    Ok(copy)
}
