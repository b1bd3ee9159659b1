//! What is moved from a SQLite file into PostgreSQL: every table that both databases have, with all its columns.

use std::collections::BTreeSet;

use sqlx::AssertSqlSafe;

use super::db::{Tx, query, query_as};
use super::{StoreError, StoreResult};

/// Table to move: its name, and the columns that order its rows. Each table comes after those that it refers to.
pub(super) const TABLES: [(&str, &str); 30] = [
    ("suites", "id"),
    ("tasks", "hash"),
    ("suite_tasks", "suite_id, number"),
    // Boards count the runs that were begun in this order.
    ("runs", "created_at_ms, id"),
    ("skipped_tasks", "run_id, task_number"),
    ("embargoes", "run_id"),
    ("epochs", "id"),
    ("cosignatures", "witness"),
    ("entries", "id"),
    ("cards", "id"),
    ("instances", "id"),
    ("episodes", "id"),
    ("submissions", "id"),
    ("jobs", "submission_id"),
    ("lanes", "name"),
    ("reports", "submission_id, attempt"),
    ("results", "id"),
    ("events", "id"),
    ("board_actions", "id"),
    ("regrades", "id"),
    ("regraded", "regrade_id, submission_id"),
    ("members", "owner, name"),
    ("keys", "id"),
    ("webhooks", "id"),
    ("deliveries", "id"),
    ("idempotency", "owner, key"),
    ("quotas", "owner"),
    ("quota_entries", "id"),
    ("receipts", "seq"),
    ("agreed", "name"),
];
/// Table that follows the others; its rows have no order but their number, which PostgreSQL gives anew.
pub(super) const PENDING: (&str, &str) = ("pending_receipts", "hash");
/// Tables whose rows keep the numbers that the database gave them.
pub(super) const NUMBERED: [&str; 4] = ["results", "events", "board_actions", "quota_entries"];
/// Tables that stay behind: what nodes of the moment tell each other, and what sqlx notes of migrations.
const LEFT: [&str; 3] = ["leases", "readiness", "_sqlx_migrations"];
/// Columns whose numbers PostgreSQL gives by itself.
const GIVEN: [(&str, &str); 2] = [("runs", "seq"), ("pending_receipts", "id")];

/// Type of a column.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Bool,
    Int,
    Float,
    Text,
    Bytes,
}

/// Checks that nothing is forgotten: each table of both databases is moved or stays behind on purpose, and a table has the
/// same columns in both.
pub(super) async fn must_be_complete(file: &mut Tx, server: &mut Tx) -> StoreResult<()> {
    let of_file: Vec<(String, String)> = query_as(
        "SELECT tables.name, columns.name FROM sqlite_master tables, pragma_table_info(tables.name) columns
         WHERE tables.type = 'table' AND tables.name NOT LIKE 'sqlite%'",
    )
    .fetch_all(file)
    .await?;
    let of_server: Vec<(String, String)> = query_as(
        "SELECT table_name::TEXT, column_name::TEXT
         FROM information_schema.columns JOIN information_schema.tables USING (table_schema, table_name)
         WHERE table_schema = current_schema() AND table_type = 'BASE TABLE'",
    )
    .fetch_all(server)
    .await?;
    let moves = |table: &str| TABLES.iter().chain([&PENDING]).any(|(name, _)| *name == table);
    let is_forgotten = |(table, _): &&(String, String)| !moves(table) && !LEFT.contains(&table.as_str());
    if let Some((table, _)) = of_file.iter().chain(&of_server).find(is_forgotten) {
        return Err(StoreError::corrupt("tables", format!("this program does not say whether {table} is moved")));
    }
    let moved = |all: Vec<(String, String)>| -> BTreeSet<(String, String)> {
        let is_moved =
            |(table, column): &(String, String)| moves(table) && !GIVEN.contains(&(table.as_str(), column.as_str()));
        all.into_iter().filter(is_moved).collect()
    };
    let (of_file, of_server) = (moved(of_file), moved(of_server));
    if let Some((table, column)) = of_file.symmetric_difference(&of_server).next() {
        return Err(StoreError::corrupt("columns", format!("only one of both databases has {table}.{column}")));
    }
    Ok(())
}

/// Lets PostgreSQL number new rows of these tables after those that they have. No rollback takes that back.
pub(super) async fn number_after_rows(tx: &mut Tx, tables: &[&str]) -> StoreResult<()> {
    for table in tables {
        let next = format!(
            "SELECT setval(pg_get_serial_sequence('{table}', 'id'), COALESCE(MAX(id), 0) + 1, FALSE) FROM {table}"
        );
        query(AssertSqlSafe(next)).execute(&mut *tx).await?;
    }
    Ok(())
}

/// Returns the columns that are copied, with their types. Numbers that PostgreSQL gives by itself are left out.
pub(super) async fn columns_of(tx: &mut Tx, table: &str) -> StoreResult<Vec<(String, Kind)>> {
    let found: Vec<(String, String)> = query_as(
        "SELECT column_name::TEXT, data_type::TEXT FROM information_schema.columns
         WHERE table_schema = current_schema() AND table_name = $1 ORDER BY ordinal_position",
    )
    .bind(table)
    .fetch_all(tx)
    .await?;
    let kind = |(name, text): (String, String)| {
        let kind = match text.as_str() {
            "boolean" => Kind::Bool,
            "bigint" => Kind::Int,
            "double precision" => Kind::Float,
            "text" => Kind::Text,
            "bytea" => Kind::Bytes,
            other => return Err(StoreError::corrupt("columns", format!("{name} is {other}"))),
        };
        Ok((name, kind))
    };
    found.into_iter().filter(|(name, _)| !GIVEN.contains(&(table, name.as_str()))).map(kind).collect()
}
