//! Schema of a PostgreSQL database: which migrations it has.

use sqlx::PgPool;

use super::connect;
use crate::store::location::Server;
use crate::store::migrations::POSTGRES;
use crate::store::schema::SchemaState;
use crate::store::{StoreError, StoreResult};

/// Reads the schema state of a database without changing it.
pub(in crate::store) async fn state(server: &Server) -> StoreResult<SchemaState> {
    let pool = connect(server, 1).await?;
    let state = state_of(&pool).await;
    pool.close().await;
    state
}

pub(super) async fn state_of(pool: &PgPool) -> StoreResult<SchemaState> {
    let (tables, ours): (i64, i64) = sqlx::query_as(
        "SELECT COUNT(*), COUNT(*) FILTER (WHERE tablename = '_sqlx_migrations') FROM pg_tables
         WHERE schemaname = current_schema()",
    )
    .fetch_one(pool)
    .await?;
    if ours == 0 {
        return if tables > 0 { Err(StoreError::Foreign) } else { Ok(SchemaState::of(&POSTGRES, None)) };
    }
    let had: Vec<i64> =
        sqlx::query_scalar("SELECT version FROM _sqlx_migrations WHERE success").fetch_all(pool).await?;
    Ok(SchemaState::of(&POSTGRES, Some(&had)))
}
