//! Check of a whole database: every row is read as the service would read it, and compared with its hashes and
//! signatures.

use std::collections::BTreeSet;

use sha2::{Digest as _, Sha256};

use super::blobs::Blobs;
use super::db::{Dialect, Pool, Row, Text, Tx, query, query_scalar};
use super::location::Location;
use super::secrets::Secrets;
use super::snapshot::{begin_snapshot, name_of, open_reading};
use super::transfer_tables::{KINDS, Kind};
use super::{StoreResult, receipts, schema};
use plumbline_engine::hidden::receipts::{ReceiptFile, verify, verify_chain};
use plumbline_engine::tasks::{Task, hex};
use plumbline_engine::voxel::BlockLog;

/// Something that is damaged or missing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Row or file.
    pub place: String,
    /// Description of the damage.
    pub detail: String,
}

/// A check under way.
struct Check<'t> {
    pool: Pool,
    blobs: Blobs,
    moment: Tx,
    tell: &'t mut dyn FnMut(Damage),
}

/// Reads everything in a database, in one consistent snapshot, and tells what is damaged. Nothing is changed. Returns the
/// number of rows that were read of each kind.
///
/// # Errors
/// Returns an error if the database cannot be opened.
pub async fn check(
    database: &Location,
    secrets: &Secrets,
    tell: &mut dyn FnMut(Damage),
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
    counts.push(("reports", check.reports().await));
    counts.push(("receipts", check.receipts().await));
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
        let found = query_scalar("PRAGMA integrity_check(100)").fetch_all(&mut self.moment).await;
        let found: Vec<String> = found.unwrap_or_else(|error| vec![error.to_string()]);
        for detail in found.into_iter().filter(|found| found != "ok") {
            (self.tell)(Damage { place: "the file".to_owned(), detail });
        }
        let dangling = query_scalar("SELECT \"table\" || ' ' || COALESCE(rowid, '') FROM pragma_foreign_key_check");
        let dangling: StoreResult<Vec<String>> = dangling.fetch_all(&mut self.moment).await;
        match dangling {
            Ok(rows) => {
                for place in rows {
                    (self.tell)(Damage { place, detail: "it refers to a row that is not there".to_owned() });
                }
            }
            Err(error) => (self.tell)(Damage { place: "the file".to_owned(), detail: error.to_string() }),
        }
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
            let found = look(&row, pool, blobs).await.unwrap_or_else(|error| Some(error.to_string()));
            if let Some(detail) = found {
                tell(Damage { place: format!("{table} {}", name_of(&row)), detail });
            }
            Ok(())
        };
        if let Err(error) = query(sql).for_each(moment, each).await {
            tell(Damage { place: table.to_owned(), detail: format!("after {count} rows: {error}") });
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

    async fn reports(&mut self) -> u64 {
        let sql = "SELECT submission_id, attempt, body, scores FROM reports ORDER BY submission_id, attempt";
        self.rows("reports", sql, async |row, pool, blobs| {
            let json = blobs.unpack(pool, "reports", row.get(2)?).await?;
            let scores: &str = row.get(3)?;
            let is_json = |text: &[u8]| serde_json::from_slice::<serde::de::IgnoredAny>(text);
            Ok(is_json(&json).and(is_json(scores.as_bytes())).err().map(|error| error.to_string()))
        })
        .await
    }

    /// Verifies the hash and the signature of each receipt, and the chain that they form.
    async fn receipts(&mut self) -> u64 {
        let mut last: Option<ReceiptFile> = None;
        let count = self
            .rows("receipts", receipts::SELECT_ALL, async |row, _, _| {
                let file = receipts::read_whole(row)?;
                let sound = verify(&file, &[&file.public_key]);
                let sound = sound.and_then(|()| verify_chain(last.iter().chain([&file])).map(drop));
                let is_first = last.is_none() && file.seq != 1;
                last = Some(file);
                Ok(match sound {
                    Err(fault) => Some(fault.to_string()),
                    Ok(()) if is_first => Some("those before it are missing".to_owned()),
                    Ok(()) => None,
                })
            })
            .await;
        count
    }

    /// Tells which keys are not in the folder of secrets.
    async fn keys(&mut self, secrets: &Secrets) {
        let place = secrets.folder().display().to_string();
        let epochs = query_scalar("SELECT id FROM epochs ORDER BY id").fetch_all(&mut self.moment).await;
        let epochs: Vec<String> = epochs.unwrap_or_default();
        for id in epochs.iter().filter(|id| !secrets.has_epoch(id)) {
            (self.tell)(Damage { place: place.clone(), detail: format!("the key of epoch {id} is not there") });
        }
        let used = query_scalar("SELECT public_key FROM receipts ORDER BY seq DESC LIMIT 1");
        let used: Vec<String> = used.fetch_all(&mut self.moment).await.unwrap_or_default();
        let own = match secrets.has_signer() {
            Ok(true) => secrets.signer().map(|signer| Some(signer.public_key())),
            Ok(false) => Ok(None),
            Err(error) => Err(error),
        };
        let own: BTreeSet<String> = match own {
            Ok(own) => own.into_iter().collect(),
            Err(error) => {
                (self.tell)(Damage { place, detail: error.to_string() });
                return;
            }
        };
        for key in used.iter().filter(|key| !own.contains(*key)) {
            let detail = format!("receipts.key is not there, or is another than {key}, which signed the last receipt");
            (self.tell)(Damage { place: place.clone(), detail });
        }
    }
}
