//! Entries to an epoch: registered before any instance is issued, and finalized once.

use super::db::{Row, Tx, query, query_as};
use super::locks::Lock;
use super::order_of_steps::{StepsOf, not_before};
use super::rows::from_row;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::grading::ProblemScores;
use plumbline_engine::hidden::feedback::Tier;

/// Row of an entry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EntryRow {
    /// Identifier of the entry.
    pub id: String,
    /// Identifier of its epoch.
    pub epoch_id: String,
    /// Owner who registered it; empty if the service was open to everyone.
    pub owner: String,
    /// Name of the agent under evaluation.
    pub agent: String,
    /// SHA-256 of the agent's configuration, in hex.
    pub configuration_hash: String,
    /// Tier of the entry.
    pub tier: Tier,
    /// Number of registered runs.
    pub runs: u32,
    /// Time of registration, in milliseconds since 1970.
    pub registered_at_ms: i64,
    /// Time at which the entrant finalized it.
    pub finalized_at_ms: Option<i64>,
    /// Time at which it was completed: finalized, and all answers graded.
    pub completed_at_ms: Option<i64>,
}

/// Outcome of an instance, as boards need it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "a row, as the query gives it")]
pub struct BoardOutcome {
    /// Identifier of the entry.
    pub entry_id: String,
    /// Salt of the instance.
    pub salt: String,
    /// Name of its family.
    pub family: String,
    /// Number of its run within the entry, from 1.
    pub run: i64,
    /// Index of its specification in the pool, from 0; siblings follow the pool.
    pub leaf: i64,
    /// Whether the answer passes.
    pub passes: bool,
    /// Whether the instance has an answer.
    pub is_answered: bool,
    /// Whether the entrant promised a transcript with the answer.
    pub has_transcript: bool,
    /// Whether the promised transcript was shown.
    pub is_checked: bool,
}

from_row!(BoardOutcome { entry_id, salt, family, run, leaf, passes, is_answered, has_transcript, is_checked });

macro_rules! select_entry {
    ($rest:literal) => {
        concat!(
            "SELECT id, epoch_id, owner, agent, configuration_hash, tier, runs, registered_at_ms, finalized_at_ms,
                    completed_at_ms FROM entries ",
            $rest
        )
    };
}

/// Reads a row of `select_entry`.
fn read(row: &Row) -> StoreResult<EntryRow> {
    let tier: &str = row.get("tier")?;
    let known = Tier::ALL.into_iter().find(|own| own.name() == tier);
    Ok(EntryRow {
        id: row.get("id")?,
        epoch_id: row.get("epoch_id")?,
        owner: row.get("owner")?,
        agent: row.get("agent")?,
        configuration_hash: row.get("configuration_hash")?,
        tier: known.ok_or_else(|| StoreError::corrupt("entries", format!("tier {tier:?}")))?,
        runs: row.get("runs")?,
        registered_at_ms: row.get("registered_at_ms")?,
        finalized_at_ms: row.get("finalized_at_ms")?,
        completed_at_ms: row.get("completed_at_ms")?,
    })
}

/// Reads an entry within the transaction.
pub(super) async fn entry_in(tx: &mut Tx, id: &str) -> StoreResult<Option<EntryRow>> {
    let row = query(select_entry!("WHERE id = $1")).bind(id).fetch_optional(tx).await?;
    row.as_ref().map(read).transpose()
}

/// Reads an owner's entries to a tier within the transaction, in order of registration.
pub(super) async fn own_entries_in(tx: &mut Tx, epoch_id: &str, tier: Tier, owner: &str) -> StoreResult<Vec<EntryRow>> {
    let rows = query(select_entry!("WHERE epoch_id = $1 AND tier = $2 AND owner = $3 ORDER BY registered_at_ms, id"))
        .bind(epoch_id)
        .bind(tier.name())
        .bind(owner)
        .fetch_all(tx)
        .await?;
    rows.iter().map(read).collect()
}

/// Outcome of an instance of an entry.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceOutcome {
    /// Identifier of the instance.
    pub instance: String,
    /// Salt of the instance.
    pub salt: String,
    /// Index of its specification in the pool, from 0; siblings follow the pool.
    pub leaf: i64,
    /// Scores of the checks; none without a graded answer.
    pub scores: Option<ProblemScores>,
}

/// Returns the outcome of each instance of an entry, in order of issue.
async fn outcomes_in(connection: &mut Tx, entry_id: &str) -> StoreResult<Vec<InstanceOutcome>> {
    let rows: Vec<(String, String, i64, Option<String>)> = query_as(
        "SELECT i.id, i.salt, i.leaf, r.scores FROM instances i
         LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
         LEFT JOIN latest_reports r ON r.submission_id = s.id
         WHERE i.entry_id = $1 ORDER BY i.ordinal",
    )
    .bind(entry_id)
    .fetch_all(connection)
    .await?;
    let outcome = |(instance, salt, leaf, scores): (String, String, i64, Option<String>)| {
        let scores = scores.as_deref().map(serde_json::from_str).transpose();
        Ok(InstanceOutcome {
            instance,
            salt,
            leaf,
            scores: scores.map_err(|error| StoreError::corrupt("reports", error))?,
        })
    };
    rows.into_iter().map(outcome).collect()
}

impl Store {
    /// Returns the entry with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn entry(&self, id: &str) -> StoreResult<Option<EntryRow>> {
        let row = query(select_entry!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read).transpose()
    }

    /// Returns the entries of an epoch, in order of registration.
    ///
    /// # Errors
    /// Returns an error if the database fails or a row cannot be read.
    pub async fn entries(&self, epoch_id: &str) -> StoreResult<Vec<EntryRow>> {
        let rows = query(select_entry!("WHERE epoch_id = $1 ORDER BY registered_at_ms, id"))
            .bind(epoch_id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Finalizes an entry: no more answers are accepted. Returns false if it was finalized before or does not exist. It
    /// is completed by the next [`Store::publish_hidden`] after its answers are graded, so that nobody can tell how
    /// long either took.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn finalize_entry(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let Some(entry) = entry_in(&mut tx, id).await? else { return Ok(false) };
        tx.lock([Lock::Epoch(&entry.epoch_id)]).await?;
        let now_ms = not_before(&mut tx, StepsOf::Entry(id), now_ms).await?;
        let finalized = query("UPDATE entries SET finalized_at_ms = $2 WHERE id = $1 AND finalized_at_ms IS NULL")
            .bind(id)
            .bind(now_ms)
            .execute(&mut tx)
            .await?;
        commit(tx, "finalize_entry").await?;
        Ok(finalized > 0)
    }

    /// Returns the outcomes of an entry's instances, in order of issue. Instances of runs that were never drawn are
    /// missing.
    ///
    /// # Errors
    /// Returns an error if the database fails or scores cannot be read.
    pub async fn outcomes_of_entry(&self, id: &str) -> StoreResult<Vec<InstanceOutcome>> {
        outcomes_in(&mut self.readers.begin_reading().await?, id).await
    }

    /// Returns the outcomes of the instances of a tier's complete entries for boards, in order of issue.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn board_outcomes(&self, epoch_id: &str, tier: Tier) -> StoreResult<Vec<BoardOutcome>> {
        query_as(
            "SELECT e.id AS entry_id, i.salt, i.family, i.run, i.leaf, COALESCE(r.overall, FALSE) AS passes, s.id IS NOT NULL AS is_answered,
                    i.transcript_hash IS NOT NULL AS has_transcript, i.transcript_checked_ms IS NOT NULL AS is_checked
             FROM entries e JOIN instances i ON i.entry_id = e.id
             LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
             LEFT JOIN latest_reports r ON r.submission_id = s.id
             WHERE e.epoch_id = $1 AND e.tier = $2 AND e.completed_at_ms IS NOT NULL ORDER BY i.ordinal",
        )
        .bind(epoch_id)
        .bind(tier.name())
        .fetch_all(&self.readers)
        .await
    }
}
