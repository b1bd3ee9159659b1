//! Runs: attempts of an agent at a suite.
//!
//! A run ends by itself when every task of its suite has been graded, or when its owner has finished it and nothing is
//! pending. A failure of ours keeps it from ending until the task is posted again.

use super::cards::{self, CardOf, NewCard};
use super::db::{Builder, query, query_scalar};
use super::embargoes::{NewEmbargo, enter_embargo};
use super::events::{self, NewEvent};
use super::idempotency::{IdempotencyKey, PriorRequest};
use super::job_ends::End;
use super::locks::Lock;
use super::postgres::notices::Notice;
use super::run_ends::{all_have_failed, end_if_complete, skip_tasks};
use super::run_rows::{RunRow, Skip, read_run, run_in, select_run};
use super::states::RunState;
use super::states::SubmissionState;
use super::{Store, StoreResult, commit};
use plumbline_engine::tasks::Track;

/// Filter for listing runs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunsWanted {
    /// State of the runs; if none, all but deleted runs.
    pub state: Option<RunState>,
    /// Suite of the runs, as `name@version`, or as a name for all versions.
    pub suite_id: Option<String>,
    /// Part of the agent's name, case-insensitive.
    pub agent: Option<String>,
    /// The agent's whole name.
    pub exact_agent: Option<String>,
    /// Owner of the runs.
    pub owner: Option<String>,
    /// Earliest time of beginning, inclusive, in milliseconds since 1970.
    pub since_ms: Option<i64>,
    /// Latest time of beginning, exclusive, in milliseconds since 1970.
    pub until_ms: Option<i64>,
    /// Identifier of a run; only runs begun before it are listed.
    pub after: Option<String>,
}

/// Outcome of finishing or deleting a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunChanged {
    /// The change was made.
    Done,
    /// The run does not exist.
    NoSuchRun,
    /// The run is not open any more; holds its state.
    NotOpen(RunState),
    /// These tasks were answered and therefore cannot be skipped.
    Answered(Vec<u32>),
}

/// Run to store.
#[derive(Debug, Clone, Copy)]
pub struct NewRun<'a> {
    /// Identifier of the run.
    pub id: &'a str,
    /// Name of the agent.
    pub agent: &'a str,
    /// `name@version` of its suite.
    pub suite_id: &'a str,
    /// Metadata that its owner provides, as JSON.
    pub metadata: &'a serde_json::Value,
    /// Owner of the key that begins it.
    pub owner: Option<&'a str>,
    /// Provenance of its logs.
    pub provenance: &'a str,
    /// Track of its prompts.
    pub track: Track,
    /// First version of its card.
    pub card: Option<NewCard<'a>>,
    /// Embargo that begins with it.
    pub embargo: Option<NewEmbargo<'a>>,
}

impl Store {
    /// Stores a new run. If the idempotency key was used before, returns the earlier use instead.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn create_run(
        &self,
        run: &NewRun<'_>,
        once: Option<&IdempotencyKey>,
        now_ms: i64,
    ) -> StoreResult<PriorRequest> {
        let mut tx = self.begin().await?;
        tx.lock(once.map(IdempotencyKey::lock)).await?;
        if let Some(once) = once {
            let before = once.before(&mut tx, now_ms).await?;
            if before != PriorRequest::Never {
                return Ok(before);
            }
            once.keep(&mut tx, run.id, now_ms).await?;
        }
        let metadata = run.metadata.to_string();
        tx.lock([Lock::Order]).await?;
        query(
            "INSERT INTO runs (id, agent, suite_id, metadata, state, created_at_ms, owner, provenance, track)
             VALUES ($1, $2, $3, $4, 'open', $5, $6, $7, $8)",
        )
        .bind(run.id)
        .bind(run.embargo.map_or(run.agent, |embargo| embargo.alias))
        .bind(run.suite_id)
        .bind(if run.embargo.is_some() { "{}" } else { &metadata })
        .bind(now_ms)
        .bind(run.owner)
        .bind(run.provenance)
        .bind(run.track)
        .execute(&mut tx)
        .await?;
        if let Some(card) = &run.card {
            cards::add(&mut tx, CardOf::Run(run.id), card, 1, now_ms).await?;
        }
        if let Some(embargo) = &run.embargo {
            enter_embargo(&mut tx, run.id, run.agent, &metadata, embargo).await?;
        }
        commit(tx, "create_run").await?;
        Ok(PriorRequest::Never)
    }

    /// Returns the run with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn run(&self, id: &str) -> StoreResult<Option<RunRow>> {
        let row = query(select_run!("WHERE r.id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read_run).transpose()
    }

    /// Returns at most `limit` runs that match the filter, latest first.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn runs(&self, wanted: &RunsWanted, limit: i64) -> StoreResult<Vec<RunRow>> {
        let mut query = Builder::new(select_run!("WHERE "));
        match wanted.state {
            None => query.push("r.deleted_at_ms IS NULL"),
            Some(RunState::Deleted) => query.push("r.deleted_at_ms IS NOT NULL"),
            Some(state) => query.push("r.deleted_at_ms IS NULL AND r.state = ").push_bind(state.name()),
        };
        if let Some(suite) = &wanted.suite_id {
            // A name without version matches all versions.
            query.push(" AND (r.suite_id = ").push_bind(suite.clone());
            query.push(" OR s.name = ").push_bind(suite.clone()).push(")");
        }
        if let Some(owner) = &wanted.owner {
            query.push(" AND r.owner = ").push_bind(owner.clone());
        }
        if let Some(agent) = &wanted.agent {
            query
                .push(" AND lower(r.agent) LIKE ")
                .push_bind(anywhere(&agent.to_ascii_lowercase()))
                .push(r" ESCAPE '\'");
        }
        if let Some(agent) = &wanted.exact_agent {
            query.push(" AND r.agent = ").push_bind(agent.clone());
        }
        if let Some(since) = wanted.since_ms {
            query.push(" AND r.created_at_ms >= ").push_bind(since);
        }
        if let Some(until) = wanted.until_ms {
            query.push(" AND r.created_at_ms < ").push_bind(until);
        }
        if let Some(after) = &wanted.after {
            query.push(" AND (r.created_at_ms, r.id) < (SELECT created_at_ms, id FROM runs WHERE id = ");
            query.push_bind(after.clone()).push(")");
        }
        query.push(" ORDER BY r.created_at_ms DESC, r.id DESC LIMIT ").push_bind(limit);
        query.build().fetch_all(&self.readers).await?.iter().map(read_run).collect()
    }

    /// Deletes an open run: cancels its unfinished submissions, and accepts no more.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn delete_run(&self, id: &str, now_ms: i64) -> StoreResult<RunChanged> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Run(id)]).await?;
        let Some(run) = run_in(&mut tx, id).await? else { return Ok(RunChanged::NoSuchRun) };
        // Whoever could post to the run is its owner; the quotas of its submissions change.
        tx.lock([Lock::Owner(run.owner.as_deref().unwrap_or_default())]).await?;
        if run.state != RunState::Open {
            return Ok(RunChanged::NotOpen(run.state));
        }
        query("UPDATE runs SET deleted_at_ms = $2 WHERE id = $1").bind(id).bind(now_ms).execute(&mut tx).await?;
        let waiting: Vec<String> = query_scalar(
            "SELECT s.id FROM submissions s JOIN jobs j ON j.submission_id = s.id WHERE s.run_id = $1 ORDER BY s.id",
        )
        .bind(id)
        .fetch_all(&mut tx)
        .await?;
        for submission_id in &waiting {
            let end = End { submission_id, run_id: Some(id), state: SubmissionState::Cancelled };
            end.record(&mut tx, &*self.signer()?, "its run was deleted by its owner", &run.suite_id, now_ms).await?;
        }
        let ended = NewEvent { run_id: Some(id), submission_id: None, state: RunState::Deleted.name(), overall: None };
        events::enter(&mut tx, &[ended], now_ms).await?;
        tx.notify(Notice::Ended { changes_board: false }).await?;
        commit(tx, "delete_run").await?;
        self.note_ends(false);
        Ok(RunChanged::Done)
    }

    /// Finishes a run: accepts no more submissions, records the tasks to skip, and ends the run if nothing is pending.
    /// Of a run that is finishing, only tasks whose grading failed can be skipped; a run that is finished stays as it is.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn finish_run(&self, id: &str, skip: Option<&Skip>, now_ms: i64) -> StoreResult<RunChanged> {
        let mut tx = self.begin().await?;
        tx.lock([Lock::Run(id)]).await?;
        let Some(run) = run_in(&mut tx, id).await? else { return Ok(RunChanged::NoSuchRun) };
        let may_skip = match (run.state, skip) {
            (RunState::Open, _) | (_, None) => true,
            (RunState::Finishing, Some(Skip::Tasks(tasks))) => all_have_failed(&mut tx, id, tasks).await?,
            _ => false,
        };
        if run.state == RunState::Deleted || !may_skip {
            return Ok(RunChanged::NotOpen(run.state));
        }
        if let Some(skip) = skip {
            let answered = skip_tasks(&mut tx, &run, skip).await?;
            if !answered.is_empty() {
                return Ok(RunChanged::Answered(answered));
            }
        }
        let found = query("UPDATE runs SET state = 'finishing' WHERE id = $1 AND state = 'open'")
            .bind(id)
            .execute(&mut tx)
            .await?;
        let has_ended = (found > 0 || skip.is_some()) && end_if_complete(&mut tx, id, &run.suite_id, now_ms).await?;
        if has_ended {
            tx.notify(Notice::Ended { changes_board: true }).await?;
        }
        commit(tx, "finish_run").await?;
        self.note_ends(has_ended);
        Ok(RunChanged::Done)
    }
}

/// Returns the pattern for LIKE that finds a text anywhere.
fn anywhere(text: &str) -> String {
    let mut pattern = String::with_capacity(text.len() + 2);
    pattern.push('%');
    for c in text.chars() {
        if matches!(c, '%' | '_' | '\\') {
            pattern.push('\\');
        }
        pattern.push(c);
    }
    pattern.push('%');
    pattern
}
