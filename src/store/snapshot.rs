//! Reading a whole database from one consistent snapshot: for exports and checks.

use sqlx::AssertSqlSafe;

use super::db::{Dialect, Pool, Row, Tx, query};
use super::location::Location;
use super::{StoreError, StoreResult, postgres, sqlite};

/// Opens a database to read it.
pub(super) async fn open_reading(database: &Location) -> StoreResult<Pool> {
    match database {
        Location::Memory => Err(StoreError::Missing(Location::Memory)),
        Location::Unreadable(why) => Err(StoreError::Unreadable(why.clone())),
        Location::File(file) => sqlite::open_reading(file).await,
        Location::Server(server) => postgres::open(server, false).await,
    }
}

/// Begins a transaction that reads whole tables from one consistent snapshot.
pub(super) async fn begin_snapshot(pool: &Pool) -> StoreResult<Tx> {
    let mut moment = pool.begin_reading().await?;
    if moment.dialect() == Dialect::Postgres {
        // A table is one statement, and may take longer than those of requests. The server waits while its rows are used.
        for setting in ["statement_timeout", "idle_in_transaction_session_timeout"] {
            query(AssertSqlSafe(format!("SET LOCAL {setting} = 0"))).execute(&mut moment).await?;
        }
    }
    Ok(moment)
}

/// Returns what names a row of a table: its first column.
pub(super) fn name_of(row: &Row) -> String {
    let text = row.get::<Option<String>>(0).ok().flatten();
    text.or_else(|| row.get::<Option<i64>>(0).ok().flatten().map(|number| number.to_string())).unwrap_or_default()
}
