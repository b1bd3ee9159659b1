//! Moving a SQLite file into an empty PostgreSQL database: every row, compared afterwards.

use std::path::Path;

use sha2::{Digest as _, Sha256};
use sqlx::AssertSqlSafe;

use super::db::{Builder, Row, RowValues, Tx, Value, query, query_as, query_scalar};
use super::location::{Location, Server};
use super::serving::Serving;
use super::{StoreError, StoreResult, postgres, schema, sqlite};
use plumbline_engine::hidden::canonical::{Hash, unhex};
use plumbline_engine::hidden::receipts::{FIRST_LINK, link};

/// Table to move: its name, and the columns that order its rows. Each table comes after those that it refers to.
const TABLES: [(&str, &str); 30] = [
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
const PENDING: (&str, &str) = ("pending_receipts", "hash");
/// Tables whose rows keep the numbers that the database gave them.
const NUMBERED: [&str; 4] = ["results", "events", "board_actions", "quota_entries"];
/// Number of rows that one statement inserts.
const AT_ONCE: usize = 100;

/// Rows of a table, and the SHA-256 over all of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Moved {
    /// Name of the table.
    pub table: &'static str,
    /// Number of rows.
    pub rows: u64,
    /// SHA-256 over the rows in order, in hex.
    pub sha256: String,
}

/// Type of a column.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Bool,
    Int,
    Float,
    Text,
    Bytes,
}

/// Copies all rows of a file into an empty database, in one transaction, and compares both. Either all of it is moved
/// or nothing. No service may use the file meanwhile: what it writes would be missing.
///
/// # Errors
/// Returns an error if the file is not up to date, if the database is not empty, or if the copy differs from the file.
pub async fn move_to(file: &Path, server: &Server) -> StoreResult<Vec<Moved>> {
    let from = Location::File(file.to_owned());
    if Serving::of(file).is_ok_and(|serving| serving.is_shared) {
        return Err(StoreError::OnlyFiles(
            "a service uses the file: stop it first, or what it writes would be missing",
        ));
    }
    schema::state(&from).await?.must_be_current(&from)?;
    let source = sqlite::open_reading(file).await?;
    let target = postgres::open(server, true).await?;
    let mut reading = source.begin_reading().await?;
    let mut tx = target.begin_writing().await?;
    let held: i64 =
        query_scalar("SELECT (SELECT COUNT(*) FROM suites) + (SELECT COUNT(*) FROM keys)").fetch_one(&mut tx).await?;
    if held > 0 {
        return Err(StoreError::OnlyFiles(
            "the database is not empty: make a new one with `createdb`, and move into that",
        ));
    }
    query("DELETE FROM lanes").execute(&mut tx).await?;
    let mut moved = Vec::with_capacity(TABLES.len() + 1);
    for (table, order) in TABLES.into_iter().chain([PENDING]) {
        let columns = columns_of(&mut tx, table).await?;
        copy(&mut reading, &mut tx, table, order, &columns).await?;
        let (before, after) =
            (digest(&mut reading, table, order, &columns).await?, digest(&mut tx, table, order, &columns).await?);
        if before != after {
            return Err(StoreError::corrupt(table, format!("the copy differs: {before:?}, and then {after:?}")));
        }
        moved.push(after);
    }
    must_chain(&mut tx).await?;
    // Nodes go on with the key that signed last.
    query("INSERT INTO agreed (name, value) SELECT 'receipt key', public_key FROM receipts ORDER BY seq DESC LIMIT 1")
        .execute(&mut tx)
        .await?;
    for table in NUMBERED {
        let next = format!(
            "SELECT setval(pg_get_serial_sequence('{table}', 'id'), COALESCE(MAX(id), 0) + 1, FALSE) FROM {table}"
        );
        query(AssertSqlSafe(next)).execute(&mut tx).await?;
    }
    tx.commit().await?;
    drop(reading);
    source.close().await;
    target.close().await;
    Ok(moved)
}

/// Returns the columns that are copied, with their types. Numbers that PostgreSQL gives by itself are left out.
async fn columns_of(tx: &mut Tx, table: &str) -> StoreResult<Vec<(String, Kind)>> {
    let found: Vec<(String, String)> = query_as(
        "SELECT column_name::TEXT, data_type::TEXT FROM information_schema.columns
         WHERE table_schema = current_schema() AND table_name = $1
           AND (table_name, column_name) NOT IN (('runs', 'seq'), ('pending_receipts', 'id'))
         ORDER BY ordinal_position",
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
    found.into_iter().map(kind).collect()
}

fn select(table: &str, order: &str, columns: &[(String, Kind)]) -> AssertSqlSafe<String> {
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    AssertSqlSafe(format!("SELECT {} FROM {table} ORDER BY {order}", names.join(", ")))
}

fn value(row: &Row, index: usize, kind: Kind) -> StoreResult<Value> {
    Ok(match kind {
        Kind::Bool => Value::Bool(row.get(index)?),
        Kind::Int => Value::Int(row.get(index)?),
        Kind::Float => Value::Float(row.get(index)?),
        Kind::Text => Value::Text(row.get(index)?),
        Kind::Bytes => Value::Bytes(row.get(index)?),
    })
}

/// Copies the rows of a table, some at a time, so that large logs fit into memory.
async fn copy(
    from: &mut Tx,
    to: &mut Tx,
    table: &'static str,
    order: &str,
    columns: &[(String, Kind)],
) -> StoreResult<()> {
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let keeps_numbers = if NUMBERED.contains(&table) { " OVERRIDING SYSTEM VALUE" } else { "" };
    let mut begun = 0;
    loop {
        let AssertSqlSafe(all) = select(table, order, columns);
        let part = AssertSqlSafe(format!("{all} LIMIT {AT_ONCE} OFFSET {begun}"));
        let rows: Vec<Row> = query(part).fetch_all(&mut *from).await?;
        if rows.is_empty() {
            return Ok(());
        }
        begun += rows.len();
        let mut values = Vec::with_capacity(rows.len());
        for row in &rows {
            let row: StoreResult<Vec<Value>> =
                columns.iter().enumerate().map(|(index, (_, kind))| value(row, index, *kind)).collect();
            values.push(row?);
        }
        let mut insert = Builder::new_checked(format!("INSERT INTO {table} ({}){keeps_numbers} ", names.join(", ")));
        insert.push_values(values, |row: &mut RowValues<'_>, values| {
            for value in values {
                row.push_bind(value);
            }
        });
        insert.build().execute(&mut *to).await?;
    }
}

/// Counts the rows of a table, and hashes them in order.
async fn digest(tx: &mut Tx, table: &'static str, order: &str, columns: &[(String, Kind)]) -> StoreResult<Moved> {
    let (mut rows, mut hash) = (0, Sha256::new());
    let each = async |row: Row| {
        rows += 1;
        for (index, (_, kind)) in columns.iter().enumerate() {
            // Debug output tells null, types and lengths apart.
            let text = format!("{:?}\n", value(&row, index, *kind)?);
            hash.update(text.as_bytes());
        }
        Ok(())
    };
    query(select(table, order, columns)).for_each(tx, each).await?;
    Ok(Moved { table, rows, sha256: plumbline_engine::tasks::hex(&hash.finalize()) })
}

/// Checks that the moved receipts are linked to each other without a gap.
async fn must_chain(tx: &mut Tx) -> StoreResult<()> {
    let mut before: (i64, Hash) = (0, FIRST_LINK);
    let each = async |(seq, hash, previous, next): (i64, String, String, String)| {
        let broken = || StoreError::corrupt("receipts", format!("the log breaks at {seq}"));
        let hash: Hash = unhex(&hash).ok_or_else(broken)?;
        let expected = link(&before.1, &hash);
        if seq != before.0 + 1 || unhex(&previous) != Some(before.1) || unhex(&next) != Some(expected) {
            return Err(broken());
        }
        before = (seq, expected);
        Ok(())
    };
    query_as("SELECT seq, hash, previous, link FROM receipts ORDER BY seq").for_each(tx, each).await
}
