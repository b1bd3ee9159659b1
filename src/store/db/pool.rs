//! Connections: pools, and transactions on one connection.

use sqlx::{PgPool, Postgres, Sqlite, SqlitePool, Transaction};

use crate::store::StoreResult;
use crate::store::postgres::silence::{SIGN, answer};

/// Kind of a database.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// SQLite: one file, one writer.
    Sqlite,
    /// PostgreSQL: a server that many processes write to.
    Postgres,
}

/// Pool of connections to one database.
#[derive(Debug, Clone)]
pub enum Pool {
    /// Connections to a SQLite file.
    Sqlite(SqlitePool),
    /// Connections to a PostgreSQL server.
    Postgres(PgPool),
}

impl Pool {
    /// Returns the kind of the database.
    #[must_use]
    pub const fn dialect(&self) -> Dialect {
        match self {
            Self::Sqlite(_) => Dialect::Sqlite,
            Self::Postgres(_) => Dialect::Postgres,
        }
    }

    /// Begins a transaction that reads one consistent snapshot.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn begin_reading(&self) -> StoreResult<Tx> {
        Ok(match self {
            Self::Sqlite(pool) => Tx::Sqlite(pool.begin().await?),
            Self::Postgres(pool) => {
                Tx::Postgres(answer(pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY")).await?)
            }
        })
    }

    /// Begins a transaction that writes. On SQLite it waits for the writer before it.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn begin_writing(&self) -> StoreResult<Tx> {
        Ok(match self {
            Self::Sqlite(pool) => Tx::Sqlite(pool.begin_with("BEGIN IMMEDIATE").await?),
            Self::Postgres(pool) => {
                Tx::Postgres(answer(pool.begin_with("BEGIN ISOLATION LEVEL READ COMMITTED")).await?)
            }
        })
    }

    /// Closes all connections. One that does not answer is given up after a moment.
    pub async fn close(&self) {
        match self {
            Self::Sqlite(pool) => pool.close().await,
            Self::Postgres(pool) => {
                if tokio::time::timeout(SIGN, pool.close()).await.is_err() {
                    tracing::warn!("a connection to the server does not answer; it is given up");
                }
            }
        }
    }
}

/// Transaction on one connection. It is rolled back when it is dropped without a commit.
#[derive(Debug)]
pub enum Tx {
    /// Transaction of SQLite.
    Sqlite(Transaction<'static, Sqlite>),
    /// Transaction of PostgreSQL.
    Postgres(Transaction<'static, Postgres>),
}

impl Tx {
    /// Returns the kind of the database.
    #[must_use]
    pub const fn dialect(&self) -> Dialect {
        match self {
            Self::Sqlite(_) => Dialect::Sqlite,
            Self::Postgres(_) => Dialect::Postgres,
        }
    }

    /// Makes the changes durable.
    ///
    /// # Errors
    /// Returns an error if the database fails; then the changes may not be durable.
    pub async fn commit(self) -> StoreResult<()> {
        match self {
            Self::Sqlite(tx) => tx.commit().await?,
            Self::Postgres(tx) => answer(tx.commit()).await?,
        }
        Ok(())
    }
}
