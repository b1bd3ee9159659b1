//! Statements with their values, and their execution.

use std::marker::PhantomData;

use futures_util::TryStreamExt as _;
use sqlx::postgres::PgQueryResult;
use sqlx::sqlite::SqliteQueryResult;
use sqlx::{AssertSqlSafe, PgConnection, PgPool, SqlSafeStr, SqlStr, SqliteConnection, SqlitePool};

use super::pool::{Pool, Tx};
use super::row::{Column, FromRow, Row};
use super::value::Value;
use crate::store::StoreResult;
use crate::store::postgres::silence::answer;

/// Text of a statement that differs between the databases. A value that one of the texts does not name is ignored
/// there.
#[derive(Debug, Clone, Copy)]
pub struct Each {
    /// Text for SQLite.
    pub sqlite: &'static str,
    /// Text for PostgreSQL.
    pub postgres: &'static str,
}

/// Text of a statement, the same for both databases or one for each.
#[derive(Debug, Clone)]
pub struct Text {
    sqlite: SqlStr,
    postgres: SqlStr,
}

impl Text {
    /// Returns the text that a [`Builder`](super::Builder) put together.
    pub(super) fn built(sqlite: String, postgres: String) -> Self {
        Self { sqlite: AssertSqlSafe(sqlite).into_sql_str(), postgres: AssertSqlSafe(postgres).into_sql_str() }
    }
}

impl From<&'static str> for Text {
    fn from(text: &'static str) -> Self {
        Self { sqlite: text.into_sql_str(), postgres: text.into_sql_str() }
    }
}

impl From<Each> for Text {
    fn from(each: Each) -> Self {
        Self { sqlite: each.sqlite.into_sql_str(), postgres: each.postgres.into_sql_str() }
    }
}

impl From<AssertSqlSafe<String>> for Text {
    fn from(text: AssertSqlSafe<String>) -> Self {
        let text = text.into_sql_str();
        Self { sqlite: text.clone(), postgres: text }
    }
}

/// Connection, or pool of connections, on which a statement runs.
#[derive(Debug)]
pub enum On<'c> {
    /// Any connection of a pool.
    SqlitePool(&'c SqlitePool),
    /// The connection of a transaction.
    Sqlite(&'c mut SqliteConnection),
    /// Any connection of a pool.
    PostgresPool(&'c PgPool),
    /// The connection of a transaction.
    Postgres(&'c mut PgConnection),
}

impl<'c> From<&'c Pool> for On<'c> {
    fn from(pool: &'c Pool) -> Self {
        match pool {
            Pool::Sqlite { pool, .. } => On::SqlitePool(pool),
            Pool::Postgres(pool) => On::PostgresPool(pool),
        }
    }
}

impl<'c> From<&'c mut Tx> for On<'c> {
    fn from(tx: &'c mut Tx) -> Self {
        match tx {
            Tx::Sqlite { tx, .. } => On::Sqlite(tx),
            Tx::Postgres(tx) => On::Postgres(tx),
        }
    }
}

/// Statement whose rows are read as `T`.
#[derive(Debug)]
pub struct Query<T> {
    text: Text,
    values: Vec<Value>,
    rows: PhantomData<fn() -> T>,
}

/// Whole row, as the reader of a statement.
#[derive(Debug)]
pub struct Whole;
/// First column of a row, as the reader of a statement.
#[derive(Debug)]
pub struct Scalar;
/// All columns of a row, as the reader of a statement.
#[derive(Debug)]
pub struct Columns;

/// Reader of rows.
pub trait Reads<T> {
    /// Reads a row.
    ///
    /// # Errors
    /// Returns an error if the row does not have this form.
    fn read(row: Row) -> StoreResult<T>;
}

impl Reads<Row> for Whole {
    fn read(row: Row) -> StoreResult<Row> {
        Ok(row)
    }
}

impl<T: for<'r> Column<'r>> Reads<T> for Scalar {
    fn read(row: Row) -> StoreResult<T> {
        row.get(0)
    }
}

impl<T: FromRow> Reads<T> for Columns {
    fn read(row: Row) -> StoreResult<T> {
        T::from_row(&row)
    }
}

/// Creates a statement that returns whole rows.
#[must_use]
pub fn query(text: impl Into<Text>) -> Query<Whole> {
    Query::new(text.into(), Vec::new())
}

/// Creates a statement whose rows are read as tuples or structs.
#[must_use]
pub fn query_as(text: impl Into<Text>) -> Query<Columns> {
    Query::new(text.into(), Vec::new())
}

/// Creates a statement whose rows have one column.
#[must_use]
pub fn query_scalar(text: impl Into<Text>) -> Query<Scalar> {
    Query::new(text.into(), Vec::new())
}

/// Runs a method of sqlx on whichever connection is given, and wraps what it returns.
macro_rules! on_each {
    ($query:expr, $on:expr, $fetch:ident, $sqlite:expr, $postgres:expr) => {{
        let Query { text, values, .. } = $query;
        match $on.into() {
            On::SqlitePool(pool) => sqlite(text.sqlite, values).$fetch(pool).await.map($sqlite),
            On::Sqlite(connection) => sqlite(text.sqlite, values).$fetch(connection).await.map($sqlite),
            On::PostgresPool(pool) => answer(postgres(text.postgres, values).$fetch(pool)).await.map($postgres),
            On::Postgres(connection) => answer(postgres(text.postgres, values).$fetch(connection)).await.map($postgres),
        }
    }};
}

impl<R> Query<R> {
    pub(super) fn new(text: Text, values: Vec<Value>) -> Self {
        Self { text, values, rows: PhantomData }
    }

    /// Binds the next value.
    #[must_use]
    pub fn bind(mut self, value: impl Into<Value>) -> Self {
        self.values.push(value.into());
        self
    }

    /// Executes the statement, and returns the number of rows that it changed.
    ///
    /// # Errors
    /// Returns an error if the database fails or refuses the statement.
    pub async fn execute<'c>(self, on: impl Into<On<'c>>) -> StoreResult<u64> {
        let changed =
            on_each!(self, on, execute, |done: SqliteQueryResult| done.rows_affected(), |done: PgQueryResult| done
                .rows_affected());
        Ok(changed?)
    }

    /// Returns all rows.
    ///
    /// # Errors
    /// Returns an error if the database fails, or if a row cannot be read.
    pub async fn fetch_all<'c, T>(self, on: impl Into<On<'c>>) -> StoreResult<Vec<T>>
    where
        R: Reads<T>,
    {
        let rows: Result<Vec<Row>, sqlx::Error> =
            on_each!(self, on, fetch_all, |rows: Vec<_>| rows.into_iter().map(Row::Sqlite).collect(), |rows: Vec<
                _,
            >| {
                rows.into_iter().map(Row::Postgres).collect()
            });
        rows?.into_iter().map(R::read).collect()
    }

    /// Passes all rows to `each`, one after another, without holding them all.
    ///
    /// # Errors
    /// Returns an error if the database fails, if a row cannot be read, or if `each` fails.
    pub async fn for_each<T>(self, tx: &mut Tx, mut each: impl AsyncFnMut(T) -> StoreResult<()>) -> StoreResult<()>
    where
        R: Reads<T>,
    {
        match tx {
            Tx::Sqlite { tx, .. } => {
                let mut rows = sqlite(self.text.sqlite, self.values).fetch(&mut **tx);
                while let Some(row) = rows.try_next().await? {
                    each(R::read(Row::Sqlite(row))?).await?;
                }
            }
            Tx::Postgres(tx) => {
                let mut rows = postgres(self.text.postgres, self.values).fetch(&mut **tx);
                while let Some(row) = answer(rows.try_next()).await? {
                    each(R::read(Row::Postgres(row))?).await?;
                }
            }
        }
        Ok(())
    }

    /// Returns the first row, if there is one.
    ///
    /// # Errors
    /// Returns an error if the database fails, or if the row cannot be read.
    pub async fn fetch_optional<'c, T>(self, on: impl Into<On<'c>>) -> StoreResult<Option<T>>
    where
        R: Reads<T>,
    {
        let row: Result<Option<Row>, sqlx::Error> =
            on_each!(self, on, fetch_optional, |row: Option<_>| row.map(Row::Sqlite), |row: Option<_>| row
                .map(Row::Postgres));
        row?.map(R::read).transpose()
    }

    /// Returns the first row.
    ///
    /// # Errors
    /// Returns an error if there is no row, if the database fails, or if the row cannot be read.
    pub async fn fetch_one<'c, T>(self, on: impl Into<On<'c>>) -> StoreResult<T>
    where
        R: Reads<T>,
    {
        self.fetch_optional(on).await?.ok_or_else(|| sqlx::Error::RowNotFound.into())
    }
}

type SqliteQuery = sqlx::query::Query<'static, sqlx::Sqlite, <sqlx::Sqlite as sqlx::Database>::Arguments>;
type PostgresQuery = sqlx::query::Query<'static, sqlx::Postgres, <sqlx::Postgres as sqlx::Database>::Arguments>;

fn sqlite(text: SqlStr, values: Vec<Value>) -> SqliteQuery {
    values.into_iter().fold(sqlx::query(text), |query, value| match value {
        Value::Bool(value) => query.bind(value),
        Value::Int(value) => query.bind(value),
        Value::Float(value) => query.bind(value),
        Value::Text(value) => query.bind(value),
        Value::Bytes(value) => query.bind(value),
    })
}

fn postgres(text: SqlStr, values: Vec<Value>) -> PostgresQuery {
    values.into_iter().fold(sqlx::query(text), |query, value| match value {
        Value::Bool(value) => query.bind(value),
        Value::Int(value) => query.bind(value),
        Value::Float(value) => query.bind(value),
        Value::Text(value) => query.bind(value),
        Value::Bytes(value) => query.bind(value),
    })
}
