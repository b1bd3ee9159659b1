//! Data of boards: results of finished runs and actions on their rows, read incrementally.

use super::db::{Each, Row, Tx, query, query_as};
use super::results::problems_of;
use super::rows::from_row;
use super::{Store, StoreError, StoreResult};
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::grading::outcomes::Outcomes;
use plumbline_engine::grading::standings::Finished;
use plumbline_engine::tasks::{Task, Track};
use plumbline_engine::voxel::Profile;

/// Position up to which a reader has read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BoardCursor {
    /// Number of the last result.
    pub result: i64,
    /// Number of the last action.
    pub action: i64,
    /// Number of the last run that was begun.
    pub run: i64,
}

/// Action on a row of a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ActionRow {
    /// Number of the action; increases with each action.
    pub id: i64,
    /// Identifier of the run.
    pub run_id: String,
    /// `hide`, `restore`, `regrade`, `withdraw` or `reveal`.
    pub action: String,
    /// Name of whoever acted.
    pub actor: String,
    /// Reason that the actor gave.
    pub reason: String,
    /// Time of the action, in milliseconds since 1970.
    pub at_ms: i64,
}

from_row!(ActionRow { id, run_id, action, actor, reason, at_ms });

/// Changes of a board since a reader's last position.
#[derive(Debug, Default)]
pub struct BoardUpdate {
    /// New results, in order.
    pub results: Vec<Finished>,
    /// New actions, in order.
    pub actions: Vec<ActionRow>,
    /// Agents of the runs that were begun, one entry per run.
    pub begun: Vec<String>,
    /// Runs begun before whose embargoes were lifted.
    pub revealed: Vec<Revealed>,
    /// Position after these changes.
    pub read: BoardCursor,
}

/// Run whose embargo was lifted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Revealed {
    /// Identifier of the run.
    pub run_id: String,
    /// Name that it showed for its agent.
    pub alias: String,
    /// Name of its agent.
    pub agent: String,
}

from_row!(Revealed { run_id, alias, agent });

impl Store {
    /// Returns what is new on the board of a suite with these tasks.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn board_update(&self, suite_id: &str, tasks: &[Task], read: BoardCursor) -> StoreResult<BoardUpdate> {
        let mut connection = self.readers.begin_reading().await?;
        // Start from the new rows, never from all runs of the suite: the unary plus keeps the planner off the index on
        // suite_id.
        let rows: Vec<Row> = query(Each {
            sqlite: "SELECT s.id, s.run_id, r.agent, r.finished_at_ms, s.since_ms, s.summary, s.outcomes, r.owner,
                            r.provenance, r.profile, r.track, s.fingerprint, e.until_ms
                     FROM results s CROSS JOIN runs r ON r.id = s.run_id
                     LEFT JOIN embargoes e ON e.run_id = r.id AND e.lifted_at_ms IS NULL
                     WHERE s.id > $1 AND +r.suite_id = $2 ORDER BY s.id",
            postgres: "SELECT s.id, s.run_id, r.agent, r.finished_at_ms, s.since_ms, s.summary, s.outcomes, r.owner,
                              r.provenance, r.profile, r.track, s.fingerprint, e.until_ms
                       FROM results s JOIN runs r ON r.id = s.run_id
                       LEFT JOIN embargoes e ON e.run_id = r.id AND e.lifted_at_ms IS NULL
                       WHERE s.id > $1 AND r.suite_id = $2 ORDER BY s.id",
        })
        .bind(read.result)
        .bind(suite_id)
        .fetch_all(&mut connection)
        .await?;
        let mut news = BoardUpdate { read, ..BoardUpdate::default() };
        for row in &rows {
            news.read.result = row.get("id")?;
            match read_result(&mut connection, row, tasks).await {
                Ok(result) => news.results.push(result),
                // A damaged row must not take the board down.
                Err(StoreError::Corrupt { table, detail }) => {
                    tracing::error!(table, detail, "a finished run cannot be read and is missing from its board");
                    metrics::counter!("plumbline_corrupt_rows_total").increment(1);
                }
                Err(error) => return Err(error),
            }
        }
        news.actions = query_as(Each {
            sqlite: "SELECT a.id, a.run_id, a.action, a.actor, a.reason, a.at_ms
                     FROM board_actions a CROSS JOIN runs r ON r.id = a.run_id
                     WHERE a.id > $1 AND +r.suite_id = $2 ORDER BY a.id",
            postgres: "SELECT a.id, a.run_id, a.action, a.actor, a.reason, a.at_ms
                       FROM board_actions a JOIN runs r ON r.id = a.run_id
                       WHERE a.id > $1 AND r.suite_id = $2 ORDER BY a.id",
        })
        .bind(read.action)
        .bind(suite_id)
        .fetch_all(&mut connection)
        .await?;
        if news.actions.iter().any(|action| action.action == "reveal") {
            // A run that this reader has not met yet has the name of its agent already.
            news.revealed = query_as(Each {
                sqlite: "SELECT a.run_id, e.alias, e.agent
                         FROM board_actions a JOIN runs r ON r.id = a.run_id JOIN embargoes e ON e.run_id = r.id
                         WHERE a.id > $1 AND a.action = 'reveal' AND r.suite_id = $2 AND r.rowid <= $3 ORDER BY a.id",
                postgres: "SELECT a.run_id, e.alias, e.agent
                           FROM board_actions a JOIN runs r ON r.id = a.run_id JOIN embargoes e ON e.run_id = r.id
                           WHERE a.id > $1 AND a.action = 'reveal' AND r.suite_id = $2 AND r.seq <= $3 ORDER BY a.id",
            })
            .bind(read.action)
            .bind(suite_id)
            .bind(read.run)
            .fetch_all(&mut connection)
            .await?;
        }
        news.read.action = news.actions.last().map_or(read.action, |last| last.id);
        let begun: Vec<(i64, String)> = query_as(Each {
            sqlite: "SELECT rowid, agent FROM runs WHERE rowid > $1 AND +suite_id = $2 ORDER BY rowid",
            postgres: "SELECT seq, agent FROM runs WHERE seq > $1 AND suite_id = $2 ORDER BY seq",
        })
        .bind(read.run)
        .bind(suite_id)
        .fetch_all(&mut connection)
        .await?;
        news.read.run = begun.last().map_or(read.run, |(last, _)| *last);
        news.begun = begun.into_iter().map(|(_, agent)| agent).collect();
        Ok(news)
    }
}

async fn read_result(connection: &mut Tx, row: &Row, tasks: &[Task]) -> StoreResult<Finished> {
    let run_id: String = row.get("run_id")?;
    let summary: &str = row.get("summary")?;
    let stored: Option<&[u8]> = row.get("outcomes")?;
    let outcomes = match stored {
        Some(bytes) => Outcomes::from_bytes(bytes, tasks.len())
            .ok_or_else(|| StoreError::corrupt("results", format!("outcomes of {run_id}")))?,
        // The run finished before outcomes were stored.
        None => Outcomes::of(tasks, &problems_of(connection, &run_id).await?, &[]),
    };
    let sketch: Option<&[u8]> = row.get("fingerprint")?;
    Ok(Finished {
        owner: row.get("owner")?,
        provenance: row.get("provenance")?,
        profile: row.get::<Option<String>>("profile")?.unwrap_or_else(|| Profile::Published.name().to_owned()),
        track: row.get::<Option<Track>>("track")?.unwrap_or_default(),
        anonymous_until_ms: row.get("until_ms")?,
        fingerprint: sketch.and_then(Fingerprint::from_bytes),
        agent: row.get("agent")?,
        finished_at_ms: row.get("finished_at_ms")?,
        since_ms: row.get("since_ms")?,
        summary: serde_json::from_str(summary)
            .map_err(|error| StoreError::corrupt("results", format!("run {run_id}: {error}")))?,
        outcomes,
        run: run_id,
    })
}
