//! Export to JSON Lines files, and import into an empty database: all data behind the public boards, in an open format.
//!
//! One list of tables and columns serves both directions. Hidden evaluation, receipts, keys and events are not
//! exported; a backup contains everything.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::Serialize;
use serde::ser::SerializeMap as _;
use serde_json::value::{RawValue, to_raw_value};
use sha2::{Digest as _, Sha256};
use sqlx::AssertSqlSafe;

use super::blobs::Blobs;
use super::compression::compress;
use super::db::{Dialect, Pool, Row, Tx, query, query_as, query_scalar};
use super::location::Location;
use super::locks::Lock;
use super::moving_tables::number_after_rows;
use super::queue::{Lane, NewJob, enter};
use super::snapshot::{begin_snapshot, name_of, open_reading};
use super::submissions::stored_log;
use super::transfer_tables::{Form, KINDS, Kind, PUBLIC};
use super::{Store, StoreError, StoreResult, commit, schema};
use plumbline_engine::tasks::{Task, content_hash_of, hex};
use plumbline_engine::voxel::BlockLog;

/// Line of an export: the columns of a row in their order, and for submissions the id of the task.
pub(super) struct Line(Vec<(&'static str, Box<RawValue>)>);

impl Serialize for Line {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in &self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

impl Kind {
    /// Returns a row as a line. What is an object is a part of the line, as everything else is.
    pub(super) async fn line(&self, row: &Row, pool: &Pool, blobs: &Blobs) -> StoreResult<Line> {
        let corrupt = |error: serde_json::Error| StoreError::corrupt(self.table, error);
        let mut line = Vec::with_capacity(self.columns.len() + 1);
        for (i, (_, name, form)) in self.columns.iter().enumerate() {
            let value = match form {
                Form::Text => to_raw_value(&row.get::<Option<String>>(i)?),
                Form::Number => to_raw_value(&row.get::<Option<i64>>(i)?),
                Form::Flag => to_raw_value(&row.get::<Option<bool>>(i)?),
                Form::Json => match row.get::<Option<String>>(i)? {
                    None => to_raw_value(&()),
                    Some(json) => RawValue::from_string(json),
                },
                Form::Packed => {
                    let json = blobs.unpack(pool, self.table, row.get(i)?).await?;
                    let json = String::from_utf8(json).map_err(|error| StoreError::corrupt(self.table, error))?;
                    RawValue::from_string(json)
                }
                Form::Bytes => {
                    let bytes: Option<Vec<u8>> = row.get(i)?;
                    to_raw_value(&bytes.map(|bytes| BASE64_STANDARD.encode(bytes)))
                }
            };
            line.push((*name, value.map_err(corrupt)?));
        }
        if self.table == "submissions" {
            let task: Option<String> = row.get(self.columns.len())?;
            line.push(("task", to_raw_value(&task).map_err(corrupt)?));
        }
        Ok(Line(line))
    }

    pub(super) fn select(&self) -> String {
        let columns: Vec<&str> = self.columns.iter().map(|(column, ..)| *column).collect();
        let task = match self.table {
            "submissions" => ", (SELECT t.id FROM tasks t WHERE t.hash = task_hash) AS named_task",
            _ => "",
        };
        format!("SELECT {}{task} FROM {} {}", columns.join(", "), self.table, self.rest.replace("PUBLIC", PUBLIC))
    }

    /// Inserts the row of a line.
    async fn enter(&self, tx: &mut Tx, line: &str) -> StoreResult<()> {
        let bad = |what: String| StoreError::corrupt(self.table, what);
        let members: std::collections::HashMap<String, Box<RawValue>> =
            serde_json::from_str(line).map_err(|error| bad(error.to_string()))?;
        if self.table == "tasks" {
            must_be_task(&members).map_err(bad)?;
        }
        let columns: Vec<&str> = self.columns.iter().map(|(column, ..)| *column).collect();
        let places: Vec<String> = (1..=columns.len()).map(|i| format!("${i}")).collect();
        let conflict = if self.may_be_there { " ON CONFLICT DO NOTHING" } else { "" };
        // The names come from the list of tables, not from the line.
        let sql =
            format!("INSERT INTO {} ({}) VALUES ({}){conflict}", self.table, columns.join(", "), places.join(", "));
        let mut query = query(AssertSqlSafe(sql));
        let null = RawValue::NULL;
        for (_, name, form) in self.columns {
            let raw = members.get(*name).map_or(null, |value| &**value);
            let read = |error: serde_json::Error| bad(format!("{name}: {error}"));
            let is_null = raw.get() == "null";
            query = match form {
                Form::Text => query.bind(serde_json::from_str::<Option<String>>(raw.get()).map_err(read)?),
                Form::Number => query.bind(serde_json::from_str::<Option<i64>>(raw.get()).map_err(read)?),
                Form::Flag => query.bind(serde_json::from_str::<Option<bool>>(raw.get()).map_err(read)?),
                Form::Json => query.bind((!is_null).then(|| raw.get().to_owned())),
                Form::Packed => {
                    if *name == "log" {
                        let wanted = members.get("log_hash").map(|hash| hash.get().trim_matches('"').to_owned());
                        let found = hex(&Sha256::digest(raw.get()));
                        if wanted.as_deref() != Some(found.as_str()) {
                            return Err(bad(format!("log: its SHA-256 is {found}, which differs from log_hash")));
                        }
                    }
                    query.bind(compress(raw.get().as_bytes())?)
                }
                Form::Bytes => {
                    let text: Option<String> = serde_json::from_str(raw.get()).map_err(read)?;
                    let bytes = text.map(|text| BASE64_STANDARD.decode(text)).transpose();
                    query.bind(bytes.map_err(|error| bad(format!("{name}: {error}")))?)
                }
            };
        }
        query.execute(tx).await?;
        Ok(())
    }
}

/// Passes every row of every kind to `write` as a line of JSON, from one consistent snapshot.
///
/// # Errors
/// Returns an error if the database fails, a row cannot be read, or `write` fails.
pub async fn export(
    database: &Location,
    mut write: impl FnMut(&'static Kind, &str) -> std::io::Result<()>,
) -> StoreResult<()> {
    schema::state(database).await?.must_be_current(database)?;
    let pool = open_reading(database).await?;
    let blobs = Blobs::open(&pool).await?;
    let mut moment = begin_snapshot(&pool).await?;
    for kind in KINDS {
        let each = async |row: Row| {
            let line =
                kind.line(&row, &pool, &blobs).await.map_err(|error| error.in_row(kind.table, &name_of(&row)))?;
            let line = serde_json::to_string(&line).map_err(|e| StoreError::corrupt(kind.table, e))?;
            write(kind, &line).map_err(StoreError::Export)
        };
        query(AssertSqlSafe(kind.select())).for_each(&mut moment, each).await?;
    }
    drop(moment);
    pool.close().await;
    Ok(())
}

/// Reasons why an import fails.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The database already has runs, submissions or quotas.
    #[error("the database holds {0} runs, submissions and quotas already; an import needs an empty one")]
    NotEmpty(i64),
    /// A suite of the same name and version has different content.
    #[error("the database holds a different {0} than the export, so the runs cannot be imported")]
    OtherSuite(String),
    /// Tasks of a suite are missing.
    #[error("the export lacks tasks of {0}: its files are incomplete")]
    Cut(String),
    /// A line cannot be imported.
    #[error("{file}, line {line}: {error}")]
    Line {
        /// Name of the file.
        file: String,
        /// Number of the line, from 1.
        line: usize,
        /// Error of the line.
        error: StoreError,
    },
    /// The database or a file failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl Store {
    /// Imports an export into this database, which must be empty except for suites. Either all of it is imported, or
    /// nothing. Submissions that were not graded are queued, each for its owner and in the lane that `lane_of` decides
    /// on.
    /// `lines` returns the lines of a file, or none if the file does not exist.
    ///
    /// # Errors
    /// Returns an error if the database is not empty, a suite differs or is incomplete, a line cannot be imported, or
    /// the database fails.
    pub async fn import<I: Iterator<Item = std::io::Result<String>>>(
        &self,
        mut lines: impl FnMut(&'static Kind) -> std::io::Result<Option<I>>,
        lane_of: fn(&Task, &BlockLog) -> Lane,
    ) -> Result<Vec<(&'static str, usize)>, ImportError> {
        let io = |error: std::io::Error| StoreError::Database(sqlx::Error::Io(error));
        let mut tx = self.begin().await?;
        tx.lock([Lock::Suites, Lock::Boards, Lock::Order]).await?;
        let held: i64 = query_scalar(
            "SELECT (SELECT COUNT(*) FROM runs) + (SELECT COUNT(*) FROM submissions) + (SELECT COUNT(*) FROM quotas)",
        )
        .fetch_one(&mut tx)
        .await?;
        if held > 0 {
            return Err(ImportError::NotEmpty(held));
        }
        let mut counts = Vec::new();
        for kind in KINDS {
            let mut count = 0;
            for line in lines(kind).map_err(io)?.into_iter().flatten() {
                let line = line.map_err(io)?;
                count += 1;
                if kind.table == "suites" {
                    must_not_differ(&mut tx, &line).await?;
                }
                let place = |error| ImportError::Line { file: format!("{}.ndjson", kind.name), line: count, error };
                kind.enter(&mut tx, &line).await.map_err(place)?;
            }
            counts.push((kind.name, count));
        }
        must_be_whole(&mut tx).await?;
        enqueue_unfinished(&mut tx, lane_of).await?;
        if tx.dialect() == Dialect::Postgres {
            // Rows kept their numbers; new ones come after them.
            number_after_rows(&mut tx, &["results", "board_actions", "quota_entries"]).await?;
        }
        commit(tx, "import").await?;
        self.refresh_catalogue().await?;
        Ok(counts)
    }
}

/// Queues the imported submissions that have not ended, in the order in which they were accepted.
async fn enqueue_unfinished(tx: &mut Tx, lane_of: fn(&Task, &BlockLog) -> Lane) -> StoreResult<()> {
    query("UPDATE submissions SET state = 'queued' WHERE state = 'grading'").execute(&mut *tx).await?;
    let unfinished: Vec<(String, Option<String>, i64)> = query_as(
        "SELECT id, owner, created_at_ms FROM submissions WHERE ended_at_ms IS NULL ORDER BY created_at_ms, id",
    )
    .fetch_all(&mut *tx)
    .await?;
    for (id, owner, created_at_ms) in unfinished {
        // Reads one log at a time: all of them together might not fit into memory.
        let (task, log): (String, Vec<u8>) =
            query_as("SELECT t.body, s.log FROM submissions s JOIN tasks t ON t.hash = s.task_hash WHERE s.id = $1")
                .bind(&id)
                .fetch_one(&mut *tx)
                .await?;
        let task: Task = serde_json::from_str(&task).map_err(|error| StoreError::corrupt("tasks", error))?;
        let log = stored_log(&log)?;
        let job = NewJob { submission_id: &id };
        enter(tx, lane_of(&task, &log), owner.as_deref().unwrap_or_default(), &[job], created_at_ms).await?;
    }
    // The export contains no answers to hidden instances, so their reservations are dropped.
    query(
        "UPDATE quotas SET reserved =
             (SELECT COUNT(*) FROM submissions s WHERE s.owner = quotas.owner AND s.ended_at_ms IS NULL)",
    )
    .execute(tx)
    .await?;
    Ok(())
}

/// Refuses a task that this program cannot read, or whose hash is not the stated one.
fn must_be_task(members: &std::collections::HashMap<String, Box<RawValue>>) -> Result<(), String> {
    let raw = |name: &str| members.get(name).map_or("null", |value| value.get());
    let task: Task = serde_json::from_str(raw("task")).map_err(|error| format!("task: {error}"))?;
    if raw("hash").trim_matches('"') != task.content_hash() {
        return Err(format!("task: its hash is {}, which differs from hash", task.content_hash()));
    }
    Ok(())
}

/// Refuses suites of which tasks are missing.
async fn must_be_whole(tx: &mut Tx) -> Result<(), ImportError> {
    let suites: Vec<(String, String, Option<String>)> =
        query_as("SELECT id, content_hash, preamble FROM suites WHERE task_count > 0").fetch_all(&mut *tx).await?;
    for (id, stored, preamble) in suites {
        let hashes: Vec<String> = query_scalar("SELECT task_hash FROM suite_tasks WHERE suite_id = $1 ORDER BY number")
            .bind(&id)
            .fetch_all(&mut *tx)
            .await?;
        if content_hash_of(&hashes, preamble.as_deref()) != stored {
            return Err(ImportError::Cut(id));
        }
    }
    Ok(())
}

async fn must_not_differ(tx: &mut Tx, line: &str) -> Result<(), ImportError> {
    let suite: serde_json::Value = serde_json::from_str(line).map_err(|error| StoreError::corrupt("suites", error))?;
    let id = suite["id"].as_str().unwrap_or_default();
    let own: Option<String> =
        query_scalar("SELECT content_hash FROM suites WHERE id = $1").bind(id).fetch_optional(tx).await?;
    match own {
        Some(own) if suite["content_hash"] != own.as_str() => Err(ImportError::OtherSuite(id.to_owned())),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::store::acceptance::Decision;
    use crate::store::submissions::{NewSubmission, PackedLog};
    use plumbline_engine::tasks::embedded;
    use plumbline_engine::voxel::{Cell, Profile};

    fn by_blocks(_task: &Task, log: &BlockLog) -> Lane {
        if log.event_count() > 1 { Lane::Long } else { Lane::Quick }
    }

    #[tokio::test]
    async fn an_imported_job_has_its_lane_and_its_owner() {
        let folder = tempfile::tempdir().unwrap();
        let suite = embedded::lite(&embedded::latest().unwrap(), embedded::LITE_SEED);
        let given = Store::open(&folder.path().join("given.db").into(), None).await.unwrap();
        given.put_suite(&suite, 0).await.unwrap();
        let task = &suite.tasks[0];
        let submission = |id: &str, owner: Option<&str>, blocks: i32| {
            let mut log = BlockLog { turns: vec![Vec::new()], ..BlockLog::default() };
            (0..blocks).for_each(|x| log.add_event(0, Cell::new(x, 0, 0), Some("stone")));
            let json = log.canonical_json();
            NewSubmission {
                id: id.to_owned(),
                run_id: None,
                suite_id: suite.id(),
                task_hash: task.content_hash(),
                task_number: task.number,
                log_hash: hex(&Sha256::digest(&json)),
                log: PackedLog::of(&json).unwrap(),
                turns: 1,
                events: log.event_count(),
                owner: owner.map(str::to_owned),
                lane: Lane::Long,
                replays: None,
                profile: Profile::Published,
            }
        };
        let all = [("1", Some("a"), 1), ("2", Some("a"), 1), ("3", Some("b"), 2), ("4", None, 1)];
        let all = all.map(|(id, owner, blocks)| submission(id, owner, blocks));
        given
            .accept(all.into(), None, |all, _| all.iter().map(|_| Decision::Store { supersedes: None }).collect(), 1)
            .await
            .unwrap();
        let mut exported: HashMap<&str, Vec<String>> = HashMap::new();
        let write = |kind: &'static Kind, line: &str| {
            exported.entry(kind.name).or_default().push(line.to_owned());
            Ok(())
        };
        export(&folder.path().join("given.db").into(), write).await.unwrap();
        given.close().await;

        let taken = Store::open(&folder.path().join("taken.db").into(), None).await.unwrap();
        let lines = |kind: &'static Kind| Ok(exported.remove(kind.name).map(|lines| lines.into_iter().map(Ok)));
        taken.import(lines, by_blocks).await.unwrap();
        let mut tx = taken.begin().await.unwrap();
        let jobs: Vec<(String, String, String, i64)> =
            query_as("SELECT submission_id, owner, lane, turn FROM jobs ORDER BY submission_id")
                .fetch_all(&mut tx)
                .await
                .unwrap();
        let wanted = [("1", "a", "quick", 0), ("2", "a", "quick", 1), ("3", "b", "long", 0), ("4", "", "quick", 0)];
        assert_eq!(
            jobs,
            wanted.map(|(id, owner, lane, turn)| (id.to_owned(), owner.to_owned(), lane.to_owned(), turn))
        );
    }
}
