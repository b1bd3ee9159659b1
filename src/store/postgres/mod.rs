//! PostgreSQL: a server that several nodes share.

pub(super) mod notices;
pub(super) mod schema;
pub(super) mod silence;

use std::sync::LazyLock;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::{ConnectOptions as _, Connection as _, PgPool};

use super::db::Pool;
use super::location::{Location, Server};
use super::migrations::POSTGRES;
use super::{StoreError, StoreResult};

/// First version of PostgreSQL that serves.
const OLDEST: u32 = 15;
/// Number of connections of a node.
const CONNECTIONS: u32 = 12;
/// Time for which a request waits for a connection. While the server is away, requests fail after it.
const ACQUIRE: Duration = Duration::from_secs(5);

/// Session settings: a node that freezes within a transaction must not hold its locks for ever, and a statement that
/// waits for a lock ends before its request does.
const SETTINGS: [(&str, &str); 3] =
    [("idle_in_transaction_session_timeout", "5s"), ("lock_timeout", "20s"), ("statement_timeout", "60s")];

/// Opens a database and brings its schema up to date if `may_change` is set.
pub(super) async fn open(server: &Server, may_change: bool) -> StoreResult<Pool> {
    let location = || Location::Server(Box::new(server.clone()));
    let pool = connect(server, CONNECTIONS).await?;
    let state = schema::state_of(&pool).await.map_err(|error| match error {
        StoreError::Database(error) if code_of(&error).as_deref() == Some("42501") => {
            StoreError::NoRights { database: location(), detail: error.to_string() }
        }
        error => error,
    })?;
    state.must_not_be_newer(&location())?;
    if may_change && !state.lacking.is_empty() {
        // An index of a large table takes longer than a statement of a request may.
        let mut connection = pool.acquire().await?.detach();
        sqlx::query("SET statement_timeout = 0").execute(&mut connection).await?;
        POSTGRES.run(&mut connection).await.map_err(|error| explain_migration(error, location()))?;
        connection.close().await?;
    }
    Ok(Pool::Postgres(pool))
}

/// Returns the name of this process at a server, by which nodes tell each other apart.
fn application_name() -> &'static str {
    static NAME: LazyLock<String> = LazyLock::new(|| format!("plumbline {}", uuid::Uuid::new_v4().simple()));
    &NAME
}

/// Connects to a server and checks its version.
async fn connect(server: &Server, connections: u32) -> StoreResult<PgPool> {
    let options: PgConnectOptions = server.options.clone().application_name(application_name()).options(SETTINGS);
    let unreachable = |error: sqlx::Error| explain(&error, Location::Server(Box::new(server.clone())));
    // A pool would try again for seconds, and then not say why it failed.
    let first = silence::broken_after(ACQUIRE, options.connect()).await.map_err(unreachable)?;
    silence::broken_after(ACQUIRE, first.close()).await.map_err(unreachable)?;
    let pool = PgPoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(ACQUIRE)
        .test_before_acquire(false)
        .after_release(|connection, _| Box::pin(silence::still_answers(connection)))
        .connect_with(options)
        .await
        .map_err(unreachable)?;
    let found: String = sqlx::query_scalar("SHOW server_version").fetch_one(&pool).await?;
    let major: u32 = found.split(|c: char| !c.is_ascii_digit()).next().and_then(|n| n.parse().ok()).unwrap_or(0);
    if major < OLDEST {
        return Err(StoreError::OldServer {
            database: Location::Server(Box::new(server.clone())),
            found,
            needed: OLDEST,
        });
    }
    Ok(pool)
}

/// Returns the code of an error of the server.
fn code_of(error: &sqlx::Error) -> Option<String> {
    error.as_database_error().and_then(sqlx::error::DatabaseError::code).map(std::borrow::Cow::into_owned)
}

/// Says what the operator can do about a failed connection.
fn explain(error: &sqlx::Error, database: Location) -> StoreError {
    let code = code_of(error);
    let remedy = match code.as_deref() {
        Some("3D000") => "create it with `createdb`, or mend the name at the end of the URL",
        Some("28P01" | "28000") => "check the user and the password of the URL, and the server's pg_hba.conf",
        Some("53300") => "the server has no connection left: raise its max_connections or put a pooler in front",
        Some("57P03") => "the server is starting or stopping: try again in a moment",
        _ => "check that the server runs, and the host and port of the URL",
    };
    StoreError::Unreachable { database, detail: error.to_string(), remedy }
}

/// Tells a lack of rights from other failures of a migration.
fn explain_migration(error: sqlx::migrate::MigrateError, database: Location) -> StoreError {
    let source = match &error {
        sqlx::migrate::MigrateError::Execute(source) | sqlx::migrate::MigrateError::ExecuteMigration(source, _) => {
            Some(source)
        }
        _ => None,
    };
    let code = source.and_then(|source| source.as_database_error()).and_then(sqlx::error::DatabaseError::code);
    if code.as_deref() == Some("42501") {
        return StoreError::NoRights { database, detail: error.to_string() };
    }
    error.into()
}
