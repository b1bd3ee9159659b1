//! Check of a whole database: every row is read as the service would read it, and compared with its hashes and
//! signatures.

mod grades;
mod keys;
mod log;

use sha2::{Digest as _, Sha256};

use super::blobs::Blobs;
use super::db::{Dialect, Pool, Row, Text, Tx, query, query_scalar};
use super::location::Location;
use super::secrets::Secrets;
use super::snapshot::{begin_snapshot, name_of, open_reading};
use super::transfer_tables::{KINDS, Kind};
use super::{StoreError, StoreResult, receipts, schema, sqlite};
use plumbline_engine::grading::Summary;
use plumbline_engine::hidden::canonical::unhex;
use plumbline_engine::hidden::receipts::{FIRST_LINK, ReceiptFault, ReceiptFile, link, verify, verify_chain};
use plumbline_engine::tasks::{Task, hex};
use plumbline_engine::voxel::BlockLog;

/// Something that a check found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Kind of what was found.
    pub kind: FoundKind,
    /// Row or file.
    pub place: String,
    /// Description.
    pub detail: String,
}

/// Kind of what a check found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FoundKind {
    /// Data is damaged or lost.
    Damaged,
    /// Data cannot be read now, for example because its place cannot be reached.
    Unreached,
    /// Something that need not be damage, such as reports without receipts.
    Noted,
    /// A key is elsewhere, for example because a backup was made without keys or before the key changed.
    Missing,
}

impl Found {
    const fn damaged(place: String, detail: String) -> Self {
        Self { kind: FoundKind::Damaged, place, detail }
    }

    fn unreached(place: String, error: &StoreError) -> Self {
        Self { kind: FoundKind::Unreached, place, detail: error.to_string() }
    }

    /// Describes an error of reading: damage, unless the data could not be reached.
    fn of(place: String, error: &StoreError) -> Self {
        let is_elsewhere = matches!(error, StoreError::Blobs { .. } | StoreError::BlobPlace(_));
        if is_elsewhere || error.is_busy() || error.has_ended_transaction() {
            return Self::unreached(place, error);
        }
        Self::damaged(place, error.to_string())
    }
}

/// A check under way.
struct Check<'t> {
    pool: Pool,
    blobs: Blobs,
    moment: Tx,
    tell: &'t mut dyn FnMut(Found),
}

/// Reads everything in a database, in one consistent snapshot, and tells what is damaged. Nothing is changed. Returns the
/// number of rows that were read of each kind.
///
/// # Errors
/// Returns an error if the database cannot be opened.
pub async fn check(
    database: &Location,
    secrets: &Secrets,
    tell: &mut dyn FnMut(Found),
) -> StoreResult<Vec<(&'static str, u64)>> {
    schema::state(database).await?.must_be_current(database)?;
    let pool = open_reading(database).await?;
    let blobs = Blobs::open(&pool).await?;
    let moment = begin_snapshot(&pool).await?;
    let mut check = Check { pool, blobs, moment, tell };
    check.file().await;
    let mut counts = Vec::new();
    // Logs and reports of hidden instances are in the same tables, and are checked with the others.
    for kind in KINDS.iter().filter(|kind| !["submissions", "reports", "tasks"].contains(&kind.name)) {
        counts.push((kind.name, check.lines(kind).await));
    }
    counts.push(("tasks", check.tasks().await));
    counts.push(("submissions", check.submissions().await));
    check.summaries("runs", "SELECT id, summary FROM runs WHERE summary IS NOT NULL ORDER BY id").await;
    check.summaries("results", "SELECT id, summary FROM results ORDER BY id").await;
    counts.push(("reports", check.reports().await));
    counts.push(("regraded", check.regraded().await));
    counts.push(("receipts", check.receipts().await));
    counts.push(("pending receipts", check.pending_receipts().await));
    check.log().await;
    check.keys(secrets).await;
    let Check { pool, moment, .. } = check;
    drop(moment);
    pool.close().await;
    Ok(counts)
}

impl Check<'_> {
    /// Checks the pages of a SQLite file, and that rows refer to rows that are there.
    async fn file(&mut self) {
        if self.moment.dialect() == Dialect::Postgres {
            return;
        }
        for table in self.missing_tables().await {
            (self.tell)(Found::damaged(table, "the table is missing".to_owned()));
        }
        let found = query_scalar("PRAGMA integrity_check(100)").fetch_all(&mut self.moment).await;
        let found: Vec<String> = found.unwrap_or_else(|error| vec![error.to_string()]);
        for detail in found.into_iter().filter(|found| found != "ok") {
            (self.tell)(Found::damaged("the file".to_owned(), detail));
        }
        let dangling = query_scalar("SELECT \"table\" || ' ' || COALESCE(rowid, '') FROM pragma_foreign_key_check");
        let dangling: StoreResult<Vec<String>> = dangling.fetch_all(&mut self.moment).await;
        match dangling {
            Ok(rows) => {
                for place in rows {
                    (self.tell)(Found::damaged(place, "it refers to a row that is not there".to_owned()));
                }
            }
            Err(error) => (self.tell)(Found::of("the file".to_owned(), &error)),
        }
    }

    /// Returns the tables of the schema that a file lacks.
    async fn missing_tables(&mut self) -> Vec<String> {
        const TABLES: &str = "SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name";
        let Ok((empty, _)) = sqlite::open_in_memory().await else { return Vec::new() };
        let whole: Vec<String> = query_scalar(TABLES).fetch_all(&empty).await.unwrap_or_default();
        empty.close().await;
        let here: StoreResult<Vec<String>> = query_scalar(TABLES).fetch_all(&mut self.moment).await;
        let Ok(here) = here else { return Vec::new() };
        whole.into_iter().filter(|table| !here.contains(table)).collect()
    }

    /// Reads the rows of a table, tells what `look` finds wrong, and returns their number.
    async fn rows(
        &mut self,
        table: &'static str,
        sql: impl Into<Text>,
        mut look: impl AsyncFnMut(&Row, &Pool, &Blobs) -> StoreResult<Option<String>>,
    ) -> u64 {
        let Self { pool, blobs, moment, tell } = self;
        let mut count = 0;
        let each = async |row: Row| {
            count += 1;
            let place = || format!("{table} {}", name_of(&row));
            match look(&row, pool, blobs).await {
                Ok(None) => {}
                Ok(Some(detail)) => tell(Found::damaged(place(), detail)),
                Err(error) => tell(Found::of(place(), &error)),
            }
            Ok(())
        };
        if let Err(error) = query(sql).for_each(moment, each).await {
            tell(Found::of(format!("{table}, after {count} rows"), &error));
        }
        count
    }

    /// Reads the rows of a kind as an export does.
    async fn lines(&mut self, kind: &'static Kind) -> u64 {
        let sql = sqlx::AssertSqlSafe(kind.select());
        self.rows(kind.table, sql, async |row, pool, blobs| kind.line(row, pool, blobs).await.map(|_line| None)).await
    }

    async fn tasks(&mut self) -> u64 {
        self.rows("tasks", "SELECT hash, body FROM tasks ORDER BY hash", async |row, _, _| {
            let (hash, body): (&str, &str) = (row.get(0)?, row.get(1)?);
            Ok(match serde_json::from_str::<Task>(body) {
                Err(error) => Some(error.to_string()),
                Ok(task) if task.content_hash() != hash => Some("its content has another hash".to_owned()),
                Ok(_) => None,
            })
        })
        .await
    }

    async fn submissions(&mut self) -> u64 {
        let sql = "SELECT id, log_hash, log FROM submissions ORDER BY id";
        self.rows("submissions", sql, async |row, pool, blobs| {
            let json = blobs.unpack(pool, "submissions", row.get(2)?).await?;
            let hash: &str = row.get(1)?;
            if hex(&Sha256::digest(&json)) != hash {
                return Ok(Some("its log has another SHA-256 than was noted".to_owned()));
            }
            Ok(BlockLog::from_canonical_json(&json).err().map(|error| error.to_string()))
        })
        .await
    }

    /// Reads what finished runs came to.
    async fn summaries(&mut self, table: &'static str, sql: &'static str) {
        self.rows(table, sql, async |row, _, _| {
            Ok(serde_json::from_str::<Summary>(row.get(1)?).err().map(|error| error.to_string()))
        })
        .await;
    }

    /// Verifies the hash and the signature of each receipt, and the chain that they form.
    async fn receipts(&mut self) -> u64 {
        let mut last: Option<ReceiptFile> = None;
        self.rows("receipts", receipts::SELECT_ALL, async |row, _, _| {
            let file = receipts::read_whole(row)?;
            let sound = verify(&file, &[&file.public_key]);
            let sound = sound.and_then(|()| verify_chain(last.iter().chain([&file])).map(drop));
            let is_first = last.is_none() && file.seq != 1;
            last = Some(file);
            Ok(match sound {
                Err(ReceiptFault::Gap { from, to }) => Some(format!("receipts {from} to {to} are missing before it")),
                Err(fault) => Some(fault.to_string()),
                Ok(()) if is_first => Some("those before it are missing".to_owned()),
                Ok(()) => None,
            })
        })
        .await
    }

    /// Verifies the hash and the signature of each receipt that is not in the log yet.
    async fn pending_receipts(&mut self) -> u64 {
        let sql = "SELECT id, body, hash, signature, public_key FROM pending_receipts ORDER BY id";
        self.rows("pending_receipts", sql, async |row, _, _| {
            let body: &str = row.get(1)?;
            let receipt = serde_json::from_str(body).map_err(|error| StoreError::corrupt("pending_receipts", error))?;
            let hash: String = row.get(2)?;
            let Some(bytes) = unhex(&hash) else { return Ok(Some("its hash is not a SHA-256".to_owned())) };
            // It has no place yet, so it follows nothing.
            let file = ReceiptFile {
                seq: 1,
                receipt: Some(receipt),
                signature: Some(row.get(3)?),
                public_key: row.get(4)?,
                previous: hex(&FIRST_LINK),
                link: hex(&link(&FIRST_LINK, &bytes)),
                place_signature: None,
                inclusion: None,
                hash,
            };
            Ok(verify(&file, &[&file.public_key]).err().map(|fault| fault.to_string()))
        })
        .await
    }
}
