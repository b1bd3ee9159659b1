//! Rows of runs, and their counters.

use std::collections::{BTreeMap, BTreeSet};

use super::db::{Builder, Row, Tx, query};
use super::embargoes::Embargo;
use super::states::RunState;
use super::{StoreError, StoreResult};
use plumbline_engine::grading::Summary;
use plumbline_engine::tasks::Track;

/// Tasks that a run leaves out on purpose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Skip {
    /// All tasks without an answer.
    Unanswered,
    /// Tasks with these numbers.
    Tasks(Vec<u32>),
}

/// Row of a run.
#[derive(Debug, Clone)]
pub struct RunRow {
    /// Identifier of the run.
    pub id: String,
    /// Name of the agent.
    pub agent: String,
    /// `name@version` of its suite.
    pub suite_id: String,
    /// Metadata that its owner provided, as JSON.
    pub metadata: serde_json::Value,
    /// State of the run.
    pub state: RunState,
    /// Number of submissions that are queued or being graded.
    pub pending: i64,
    /// Number of graded submissions.
    pub graded: i64,
    /// Number of submissions that ended because of a failure of ours and were not posted again.
    pub grader_errors: i64,
    /// Number of tasks in its suite.
    pub tasks: i64,
    /// Time of creation, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time at which it ended, in milliseconds since 1970.
    pub finished_at_ms: Option<i64>,
    /// Summary, once it has ended.
    pub summary: Option<Summary>,
    /// Owner who began it; none if the service was open to everyone.
    pub owner: Option<String>,
    /// Provenance of its logs.
    pub provenance: String,
    /// Number of tasks that it skips.
    pub skipped: i64,
    /// Profile of its submissions: its name, or `mixed`; none before the first.
    pub profile: Option<String>,
    /// Track of its prompts.
    pub track: Track,
    /// Latest version of its card, without the text of the system prompt; none also where a transaction that writes
    /// reads the run.
    pub card: Option<serde_json::Value>,
    /// Embargo that holds for it: `agent` is an alias, and `metadata` is empty.
    pub embargo: Option<Embargo>,
    /// Time at which its owner withdrew it, in milliseconds since 1970, and the reason.
    pub withdrawn: Option<(i64, String)>,
}

/// Query with the columns of a run, for every query that reads one. `for writing` is for transactions that write: they
/// hold up others, and look at neither card, embargo nor withdrawal.
macro_rules! select_run {
    ($rest:literal) => {
        select_run!(
            "(SELECT c.card FROM cards c WHERE c.run_id = r.id ORDER BY c.version DESC LIMIT 1) AS card,
             e.agent AS embargo_agent, e.metadata AS embargo_metadata, e.until_ms AS embargo_until_ms,
             w.at_ms AS withdrawn_at_ms, w.reason AS withdrawn_reason",
            "LEFT JOIN embargoes e ON e.run_id = r.id AND e.lifted_at_ms IS NULL
             LEFT JOIN board_actions w ON w.run_id = r.id AND w.action = 'withdraw' ",
            $rest
        )
    };
    (for writing, $rest:literal) => {
        select_run!(
            "CAST(NULL AS TEXT) AS card, CAST(NULL AS TEXT) AS embargo_agent, CAST(NULL AS BIGINT) AS withdrawn_at_ms",
            "",
            $rest
        )
    };
    ($more:literal, $joins:literal, $rest:literal) => {
        concat!(
            "SELECT r.id, r.agent, r.suite_id, r.metadata, r.state, r.pending, r.graded, r.grader_errors,
                    s.task_count AS tasks, r.created_at_ms, r.finished_at_ms, r.summary, r.owner, r.provenance,
                    r.profile, r.track, r.deleted_at_ms, (SELECT COUNT(*) FROM skipped_tasks k WHERE k.run_id = r.id) AS skipped,
                    ",
            $more,
            " FROM runs r JOIN suites s ON s.id = r.suite_id ",
            $joins,
            $rest
        )
    };
}

pub(super) fn read_run(row: &Row) -> StoreResult<RunRow> {
    let (id, summary): (String, Option<&str>) = (row.get("id")?, row.get("summary")?);
    let corrupt = |error: serde_json::Error| StoreError::corrupt("runs", format!("{id}: {error}"));
    Ok(RunRow {
        id: id.clone(),
        agent: row.get("agent")?,
        suite_id: row.get("suite_id")?,
        metadata: serde_json::from_str(row.get("metadata")?).map_err(corrupt)?,
        state: match row.get::<Option<i64>>("deleted_at_ms")? {
            Some(_) => RunState::Deleted,
            None => row.get("state")?,
        },
        pending: row.get("pending")?,
        graded: row.get("graded")?,
        grader_errors: row.get("grader_errors")?,
        tasks: row.get("tasks")?,
        created_at_ms: row.get("created_at_ms")?,
        finished_at_ms: row.get("finished_at_ms")?,
        summary: summary.map(serde_json::from_str).transpose().map_err(corrupt)?,
        owner: row.get("owner")?,
        provenance: row.get("provenance")?,
        skipped: row.get("skipped")?,
        profile: row.get("profile")?,
        track: row.get::<Option<Track>>("track")?.unwrap_or_default(),
        embargo: match row.get::<Option<String>>("embargo_agent")? {
            None => None,
            Some(agent) => Some(Embargo {
                agent,
                metadata: serde_json::from_str(row.get("embargo_metadata")?).map_err(corrupt)?,
                until_ms: row.get("embargo_until_ms")?,
            }),
        },
        withdrawn: match row.get::<Option<i64>>("withdrawn_at_ms")? {
            None => None,
            Some(at_ms) => Some((at_ms, row.get("withdrawn_reason")?)),
        },
        card: row.get::<Option<&str>>("card")?.map(serde_json::from_str).transpose().map_err(corrupt)?,
    })
}

pub(super) use select_run;

/// Reads a run within the transaction, without card, embargo and withdrawal.
pub(super) async fn run_in(tx: &mut Tx, id: &str) -> StoreResult<Option<RunRow>> {
    let row = query(select_run!(for writing, "WHERE r.id = $1")).bind(id).fetch_optional(&mut *tx).await?;
    row.as_ref().map(read_run).transpose()
}

/// Adds to a run's counters.
pub(super) async fn count(tx: &mut Tx, id: &str, pending: i64, graded: i64, grader_errors: i64) -> StoreResult<()> {
    query(
        "UPDATE runs SET pending = pending + $2, graded = graded + $3, grader_errors = grader_errors + $4 WHERE id = $1",
    )
    .bind(id)
    .bind(pending)
    .bind(graded)
    .bind(grader_errors)
    .execute(&mut *tx)
    .await?;
    Ok(())
}

/// Returns the states of runs; runs that do not exist are left out.
pub(super) async fn states_of(tx: &mut Tx, ids: &BTreeSet<&str>) -> StoreResult<BTreeMap<String, RunState>> {
    let mut select = Builder::new("SELECT id, state, deleted_at_ms IS NOT NULL FROM runs WHERE id IN ");
    select.push_list(ids.iter().copied());
    let found: Vec<(String, RunState, bool)> = select.build_as().fetch_all(tx).await?;
    let state = |(id, state, is_deleted)| (id, if is_deleted { RunState::Deleted } else { state });
    Ok(found.into_iter().map(state).collect())
}
