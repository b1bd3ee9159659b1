//! Connections: pools, and transactions on one connection.

use std::sync::Arc;

use sqlx::{PgPool, Postgres, Sqlite, SqlitePool, Transaction};

use crate::store::StoreResult;
use crate::store::opened_file::OpenedFile;
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
    /// Connections to a SQLite database.
    Sqlite {
        /// The connections.
        pool: SqlitePool,
        /// The file, if the connections write to one: what is written where it no longer is would be lost.
        file: Option<Arc<OpenedFile>>,
    },
    /// Connections to a PostgreSQL server.
    Postgres(PgPool),
}

impl Pool {
    /// Returns the kind of the database.
    #[must_use]
    pub const fn dialect(&self) -> Dialect {
        match self {
            Self::Sqlite { .. } => Dialect::Sqlite,
            Self::Postgres(_) => Dialect::Postgres,
        }
    }

    /// Begins a transaction that reads one consistent snapshot.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn begin_reading(&self) -> StoreResult<Tx> {
        Ok(match self {
            Self::Sqlite { pool, .. } => Tx::Sqlite { tx: pool.begin().await?, file: None },
            Self::Postgres(pool) => {
                Tx::Postgres(answer(pool.begin_with("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY")).await?)
            }
        })
    }

    /// Begins a transaction that writes. On SQLite it waits for the writer before it.
    ///
    /// # Errors
    /// Returns an error if the database fails, or its file is not where it was.
    pub async fn begin_writing(&self) -> StoreResult<Tx> {
        Ok(match self {
            Self::Sqlite { pool, file } => {
                must_be_in_place(file.as_deref())?;
                let tx = pool.begin_with("BEGIN IMMEDIATE").await?;
                Tx::Sqlite { tx, file: file.clone() }
            }
            Self::Postgres(pool) => {
                Tx::Postgres(answer(pool.begin_with("BEGIN ISOLATION LEVEL READ COMMITTED")).await?)
            }
        })
    }

    /// Closes all connections. One that does not answer is given up after a moment.
    pub async fn close(&self) {
        match self {
            Self::Sqlite { pool, .. } => pool.close().await,
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
    Sqlite {
        /// The transaction.
        tx: Transaction<'static, Sqlite>,
        /// The file, if the transaction writes to one.
        file: Option<Arc<OpenedFile>>,
    },
    /// Transaction of PostgreSQL.
    Postgres(Transaction<'static, Postgres>),
}

impl Tx {
    /// Returns the kind of the database.
    #[must_use]
    pub const fn dialect(&self) -> Dialect {
        match self {
            Self::Sqlite { .. } => Dialect::Sqlite,
            Self::Postgres(_) => Dialect::Postgres,
        }
    }

    /// Makes the changes durable.
    ///
    /// # Errors
    /// Returns an error if the database fails, or its file is not where it was; then the changes may not be durable.
    pub async fn commit(self) -> StoreResult<()> {
        match self {
            Self::Sqlite { tx, file } => {
                // The transaction may have waited for the writer before it, and the file may go while it commits.
                must_be_in_place(file.as_deref())?;
                tx.commit().await?;
                must_be_in_place(file.as_deref())?;
            }
            Self::Postgres(tx) => answer(tx.commit()).await?,
        }
        Ok(())
    }
}

fn must_be_in_place(file: Option<&OpenedFile>) -> StoreResult<()> {
    file.map_or(Ok(()), OpenedFile::must_be_in_place)
}
