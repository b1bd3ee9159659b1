//! Entries to an epoch: registered before any instance is issued, finalized once, complete when all answers are graded.

use super::db::{Row, Tx, query, query_as, query_scalar};
use super::epochs::{BUDGET_SPENT, close_in, epoch_in};
use super::evidence::{publish, witness};
use super::rows::from_row;
use super::{Store, StoreError, StoreResult, commit, quota};
use plumbline_engine::hidden::evidence::{CompletedFact, Fact};
use plumbline_engine::hidden::feedback::{Outcome, Tier, released_bits};
use plumbline_engine::hidden::receipts::Signer;

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
    /// Whether the answer passes.
    pub passes: bool,
    /// Whether the instance has an answer.
    pub is_answered: bool,
    /// Whether the entrant promised a transcript with the answer.
    pub has_transcript: bool,
    /// Whether the promised transcript was shown.
    pub is_checked: bool,
}

from_row!(BoardOutcome { entry_id, salt, passes, is_answered, has_transcript, is_checked });

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

/// Returns the outcome of each instance of an entry, in order of issue.
async fn outcomes_in(connection: &mut Tx, entry_id: &str) -> StoreResult<Vec<Outcome>> {
    let rows: Vec<(String, Option<String>)> = query_as(
        "SELECT i.id, r.scores FROM instances i
         LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE
         LEFT JOIN latest_reports r ON r.submission_id = s.id
         WHERE i.entry_id = $1 ORDER BY i.ordinal",
    )
    .bind(entry_id)
    .fetch_all(connection)
    .await?;
    let outcome = |(instance, scores): (String, Option<String>)| {
        let scores = scores.as_deref().map(serde_json::from_str).transpose();
        Ok(Outcome { instance, scores: scores.map_err(|error| StoreError::corrupt("reports", error))? })
    };
    rows.into_iter().map(outcome).collect()
}

/// Completes a finalized entry whose answers are all graded, and counts the bits released to its owner. Closes the
/// epoch if its budget of released information is spent.
pub(super) async fn complete_if_graded(tx: &mut Tx, signer: &Signer, entry_id: &str, now_ms: i64) -> StoreResult<()> {
    let Some(entry) = entry_in(tx, entry_id).await? else { return Ok(()) };
    let Some(epoch) = epoch_in(tx, &entry.epoch_id).await? else { return Ok(()) };
    // An answer whose grading failed on our side may be given again until the epoch is over; after that it counts as
    // failed.
    let (answered, ungraded): (i64, i64) = query_as(
        "SELECT COUNT(*), COUNT(*) FILTER (WHERE s.state != 'graded' AND NOT ($2 AND s.state = 'grader_error'))
         FROM instances i JOIN submissions s ON s.instance_id = i.id AND s.superseded = FALSE WHERE i.entry_id = $1",
    )
    .bind(entry_id)
    .bind(epoch.is_over(now_ms))
    .fetch_one(&mut *tx)
    .await?;
    let completed = query(
        "UPDATE entries SET completed_at_ms = $2
         WHERE id = $1 AND finalized_at_ms IS NOT NULL AND completed_at_ms IS NULL AND $3 = 0",
    )
    .bind(entry_id)
    .bind(now_ms)
    .bind(ungraded)
    .execute(&mut *tx)
    .await?;
    if completed == 0 {
        return Ok(());
    }
    settle_quota(tx, entry_id, now_ms).await?;
    let finalized_at_ms =
        entry.finalized_at_ms.ok_or_else(|| StoreError::corrupt("entries", "complete, not finalized"))?;
    let completed = CompletedFact { entry: entry_id.to_owned(), finalized_at_ms, completed_at_ms: now_ms };
    witness(tx, signer, epoch.id(), &Fact::Completed(completed)).await?;
    let bits = released_bits(entry.tier.feedback(epoch.commitment.dev_feedback), answered as usize);
    query("UPDATE epochs SET released_bits = released_bits + $2 WHERE id = $1")
        .bind(epoch.id())
        .bind(bits)
        .execute(&mut *tx)
        .await?;
    if bits > 0.0 && epoch.released_bits + bits >= epoch.rules.budget_bits {
        close_in(tx, epoch.id(), BUDGET_SPENT, now_ms).await?;
    }
    Ok(())
}

/// Charges the graded answers of an entry and refunds the others. This happens only when the entry is completed, so
/// that the ledger does not reveal when an answer was graded, or how.
async fn settle_quota(tx: &mut Tx, entry_id: &str, now_ms: i64) -> StoreResult<()> {
    let rows: Vec<(String, String, bool)> = query_as(
        "SELECT s.id, s.owner, s.state = 'graded'
         FROM submissions s JOIN instances i ON i.id = s.instance_id
         WHERE i.entry_id = $1 AND s.owner IS NOT NULL AND s.superseded = FALSE ORDER BY s.id",
    )
    .bind(entry_id)
    .fetch_all(&mut *tx)
    .await?;
    let charged: Vec<(&str, &str)> =
        rows.iter().filter(|(_, _, graded)| *graded).map(|(id, owner, _)| (owner.as_str(), id.as_str())).collect();
    quota::charge(tx, &charged, now_ms).await?;
    for (id, owner, _) in rows.iter().filter(|(_, _, graded)| !graded) {
        quota::refund(tx, owner, id, "not graded", now_ms).await?;
    }
    Ok(())
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
    pub async fn outcomes_of_entry(&self, id: &str) -> StoreResult<Vec<Outcome>> {
        outcomes_in(&mut self.readers.begin_reading().await?, id).await
    }

    /// Returns the outcomes of the instances of a tier's complete entries for boards, in order of issue.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn board_outcomes(&self, epoch_id: &str, tier: Tier) -> StoreResult<Vec<BoardOutcome>> {
        query_as(
            "SELECT e.id AS entry_id, i.salt, COALESCE(r.overall, FALSE) AS passes, s.id IS NOT NULL AS is_answered,
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

    /// Completes the finalized entries whose answers are graded, and publishes the pending receipts in the log, in one
    /// transaction.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn publish_hidden(&self, now_ms: i64) -> StoreResult<()> {
        const WAITING: &str =
            "SELECT id FROM entries WHERE finalized_at_ms IS NOT NULL AND completed_at_ms IS NULL ORDER BY id";
        let waiting: Vec<String> = query_scalar(WAITING).fetch_all(&self.readers).await?;
        if waiting.is_empty() && !self.has_pending_receipts().await? {
            return Ok(());
        }
        let signer = self.signer()?;
        let mut tx = self.begin().await?;
        for entry in &waiting {
            complete_if_graded(&mut tx, &signer, entry, now_ms).await?;
        }
        publish(&mut tx, None).await?;
        commit(tx, "publish_hidden").await
    }
}
