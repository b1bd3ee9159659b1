//! Moving a SQLite file into an empty PostgreSQL database: every row, compared afterwards.

use std::path::Path;

use sha2::{Digest as _, Sha256};
use sqlx::AssertSqlSafe;

use super::db::{Builder, Row, RowValues, Tx, Value, query, query_as, query_scalar};
use super::location::{Location, Server};
use super::moving_tables::{Kind, NUMBERED, PENDING, TABLES, columns_of, must_be_complete, number_after_rows};
use super::serving::Serving;
use super::{StoreError, StoreResult, postgres, schema, sqlite};
use plumbline_engine::hidden::canonical::{Hash, unhex};
use plumbline_engine::hidden::receipts::{FIRST_LINK, link, verify_signature};

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

/// Purpose of a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The rows stay in the database. No service may use the file meanwhile: what it writes would be missing.
    Move,
    /// Everything is done but the commit, and what no rollback takes back. A service may go on using the file.
    Rehearse,
}

/// Copies all rows of a file into an empty database, in one transaction, and compares both. Either all of it is moved
/// or nothing. A rehearsal, too, makes the tables in the database if it has none.
///
/// # Errors
/// Returns an error if the file is not up to date, if the database is not empty, or if the copy differs from the file.
pub async fn move_to(file: &Path, server: &Server, purpose: Purpose) -> StoreResult<Vec<Moved>> {
    let from = Location::File(file.to_owned());
    if purpose == Purpose::Move && Serving::of(file).is_ok_and(|serving| serving.is_shared) {
        return Err(StoreError::OnlyFiles(
            "a service uses the file: stop it first, or what it writes would be missing (--dry-run rehearses beside it)",
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
    postgres::silence::be_patient();
    // A large table takes longer than the statements of requests, and the file is read while the server waits.
    for setting in ["statement_timeout", "idle_in_transaction_session_timeout"] {
        query(AssertSqlSafe(format!("SET LOCAL {setting} = 0"))).execute(&mut tx).await?;
    }
    must_be_complete(&mut reading, &mut tx).await?;
    query("DELETE FROM lanes").execute(&mut tx).await?;
    let mut moved = Vec::with_capacity(TABLES.len() + 1);
    for (table, order) in TABLES.into_iter().chain([PENDING]) {
        let columns = columns_of(&mut tx, table).await?;
        let before = copy(&mut reading, &mut tx, table, order, &columns).await?;
        let after = digest(&mut tx, table, order, &columns).await?;
        if before != after {
            return Err(StoreError::corrupt(table, format!("the copy differs: {before:?}, and then {after:?}")));
        }
        moved.push(after);
    }
    must_verify(&mut tx).await?;
    // Nodes go on with the key that signed last.
    query("INSERT INTO agreed (name, value) SELECT 'receipt key', public_key FROM receipts ORDER BY seq DESC LIMIT 1")
        .execute(&mut tx)
        .await?;
    if purpose == Purpose::Move {
        number_after_rows(&mut tx, &NUMBERED).await?;
        tx.commit().await?;
    } else {
        drop(tx);
    }
    drop(reading);
    source.close().await;
    target.close().await;
    Ok(moved)
}

fn select(table: &str, order: &str, columns: &[(String, Kind)]) -> AssertSqlSafe<String> {
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    AssertSqlSafe(format!("SELECT {} FROM {table} ORDER BY {order}", names.join(", ")))
}

fn values(row: &Row, columns: &[(String, Kind)]) -> StoreResult<Vec<Value>> {
    columns.iter().enumerate().map(|(index, (_, kind))| value(row, index, *kind)).collect()
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

/// Copies the rows of a table, some at a time, so that large logs fit into memory. Counts and hashes what it read.
async fn copy(
    from: &mut Tx,
    to: &mut Tx,
    table: &'static str,
    order: &str,
    columns: &[(String, Kind)],
) -> StoreResult<Moved> {
    let mut read = RowDigest::default();
    let mut waiting = Vec::with_capacity(AT_ONCE);
    let each = async |row: Row| {
        let row = values(&row, columns)?;
        read.add(&row);
        waiting.push(row);
        if waiting.len() == AT_ONCE {
            insert(to, table, columns, std::mem::take(&mut waiting)).await?;
        }
        Ok(())
    };
    query(select(table, order, columns)).for_each(from, each).await?;
    if !waiting.is_empty() {
        insert(to, table, columns, waiting).await?;
    }
    Ok(read.of(table))
}

async fn insert(to: &mut Tx, table: &str, columns: &[(String, Kind)], rows: Vec<Vec<Value>>) -> StoreResult<()> {
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let keeps_numbers = if NUMBERED.contains(&table) { " OVERRIDING SYSTEM VALUE" } else { "" };
    let mut insert = Builder::new_checked(format!("INSERT INTO {table} ({}){keeps_numbers} ", names.join(", ")));
    insert.push_values(rows, |row: &mut RowValues<'_>, values| {
        for value in values {
            row.push_bind(value);
        }
    });
    insert.build().execute(to).await?;
    Ok(())
}

/// Counts the rows of a table, and hashes them in order.
async fn digest(tx: &mut Tx, table: &'static str, order: &str, columns: &[(String, Kind)]) -> StoreResult<Moved> {
    let mut read = RowDigest::default();
    let each = async |row: Row| {
        read.add(&values(&row, columns)?);
        Ok(())
    };
    query(select(table, order, columns)).for_each(tx, each).await?;
    Ok(read.of(table))
}

/// Count and SHA-256 of rows, as they are read.
#[derive(Debug, Default)]
struct RowDigest {
    rows: u64,
    hash: Sha256,
}

impl RowDigest {
    fn add(&mut self, row: &[Value]) {
        self.rows += 1;
        for value in row {
            // Debug output tells null, types and lengths apart.
            self.hash.update(format!("{value:?}\n").as_bytes());
        }
    }

    fn of(self, table: &'static str) -> Moved {
        Moved { table, rows: self.rows, sha256: plumbline_engine::tasks::hex(&self.hash.finalize()) }
    }
}

/// Checks that the moved receipts are linked to each other without a gap, and that each is what its key signed.
async fn must_verify(tx: &mut Tx) -> StoreResult<()> {
    let mut before: (i64, Hash) = (0, FIRST_LINK);
    let each = async |row: ReceiptRow| {
        let (seq, body, hash, signature, public_key, previous, next) = row;
        let broken = |why: &str| StoreError::corrupt("receipts", format!("the log breaks at {seq}: {why}"));
        let found: Hash = Sha256::digest(body.as_bytes()).into();
        if unhex(&hash) != Some(found) {
            return Err(broken("the receipt has another hash than its row"));
        }
        let expected = link(&before.1, &found);
        if seq != before.0 + 1 || unhex(&previous) != Some(before.1) || unhex(&next) != Some(expected) {
            return Err(broken("its link does not follow from the one before"));
        }
        let receipt = serde_json::from_str(&body).map_err(|error| broken(&error.to_string()))?;
        verify_signature(&receipt, &public_key, &signature).map_err(|fault| broken(&fault.to_string()))?;
        before = (seq, expected);
        Ok(())
    };
    query_as("SELECT seq, body, hash, signature, public_key, previous, link FROM receipts ORDER BY seq")
        .for_each(tx, each)
        .await
}

/// Position, body, hash, signature, key, link before and own link of a receipt.
type ReceiptRow = (i64, String, String, String, String, String, String);
