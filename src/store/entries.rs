//! Entries to an epoch: registered before anything is seen, finalized once, complete when all answers are graded.

use sqlx::{Row as _, SqliteConnection};

use super::epochs::{BUDGET_SPENT, EpochRow, close_in, epoch_in};
use super::idempotency::{Before, Once};
use super::{Store, StoreError, StoreResult, commit, quota};
use crate::epochs::feedback::{Outcome, Tier, released_bits};

/// A stored entry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EntryRow {
    /// Its id.
    pub id: String,
    /// Its epoch.
    pub epoch_id: String,
    /// Who registered it; empty where the service was open to everybody.
    pub owner: String,
    /// Who is evaluated.
    pub agent: String,
    /// SHA-256 of the configuration.
    pub configuration_hash: String,
    /// Its tier.
    pub tier: Tier,
    /// Runs registered.
    pub runs: i64,
    /// When it was registered.
    pub registered_at_ms: i64,
    /// When it was finalized.
    pub finalized_at_ms: Option<i64>,
    /// When all answers were graded after that.
    pub completed_at_ms: Option<i64>,
}

/// An entry to register.
#[derive(Debug, Clone, Copy)]
pub struct NewEntry<'a> {
    /// Its id.
    pub id: &'a str,
    /// Its epoch.
    pub epoch_id: &'a str,
    /// Who registers it.
    pub owner: &'a str,
    /// Who is evaluated.
    pub agent: &'a str,
    /// SHA-256 of the configuration.
    pub configuration_hash: &'a str,
    /// Its tier.
    pub tier: Tier,
    /// Runs.
    pub runs: u32,
}

/// What a board needs of an instance.
#[derive(Debug, Clone, PartialEq, Eq, sqlx::FromRow)]
#[expect(clippy::struct_excessive_bools, reason = "a row, as the query gives it")]
pub struct BoardOutcome {
    /// Its entry.
    pub entry_id: String,
    /// The instance's salt.
    pub salt: String,
    /// Whether its answer passes.
    pub passes: bool,
    /// Whether it has one.
    pub is_answered: bool,
    /// Whether a transcript was promised with it.
    pub has_transcript: bool,
    /// Whether that was shown.
    pub is_checked: bool,
}

/// What came of registering.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Registered {
    /// It is registered.
    New,
    /// The same request registered it before, under this id.
    Before(String),
    /// The request's key was used for another one.
    KeyUsedOtherwise,
    /// The epoch is not open.
    NotOpen,
    /// The owner has as many entries of this tier as are allowed.
    TooMany(i64),
    /// The epoch has not so many specifications left.
    PoolUsedUp,
    /// The owner's official entries are of another agent or configuration, named here.
    OtherConfiguration(String),
}

macro_rules! select_entry {
    ($rest:literal) => {
        concat!(
            "SELECT id, epoch_id, owner, agent, configuration_hash, tier, runs, registered_at_ms, finalized_at_ms,
                    completed_at_ms FROM entries ",
            $rest
        )
    };
}

fn read(row: &sqlx::sqlite::SqliteRow) -> StoreResult<EntryRow> {
    let tier: &str = row.try_get(5)?;
    let known = Tier::ALL.into_iter().find(|own| own.name() == tier);
    Ok(EntryRow {
        id: row.try_get(0)?,
        epoch_id: row.try_get(1)?,
        owner: row.try_get(2)?,
        agent: row.try_get(3)?,
        configuration_hash: row.try_get(4)?,
        tier: known.ok_or_else(|| StoreError::corrupt("entries", format!("tier {tier:?}")))?,
        runs: row.try_get(6)?,
        registered_at_ms: row.try_get(7)?,
        finalized_at_ms: row.try_get(8)?,
        completed_at_ms: row.try_get(9)?,
    })
}

/// The entry as the transaction sees it.
pub(super) async fn entry_in(tx: &mut SqliteConnection, id: &str) -> StoreResult<Option<EntryRow>> {
    let row = sqlx::query(select_entry!("WHERE id = $1")).bind(id).fetch_optional(tx).await?;
    row.as_ref().map(read).transpose()
}

/// What grading found of each instance of an entry, in the order of issue.
async fn outcomes_in(connection: &mut SqliteConnection, entry_id: &str) -> StoreResult<Vec<Outcome>> {
    let rows: Vec<(String, Option<String>)> = sqlx::query_as(
        "SELECT i.id, r.scores FROM instances i
         LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = 0
         LEFT JOIN reports r ON r.submission_id = s.id
          AND r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = s.id)
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

/// Ends an entry that was finalized and all of whose answers are graded, and counts what its owner is told; an epoch that has
/// told enough is closed.
pub(super) async fn complete_if_graded(tx: &mut SqliteConnection, entry_id: &str, now_ms: i64) -> StoreResult<()> {
    let Some(entry) = entry_in(tx, entry_id).await? else { return Ok(()) };
    let Some(epoch) = epoch_in(tx, &entry.epoch_id).await? else { return Ok(()) };
    // What a failure of ours ended may be answered again until the epoch is over; then it has failed.
    let (answered, ungraded): (i64, i64) = sqlx::query_as(
        "SELECT COUNT(*), COALESCE(SUM(s.state != 'graded' AND NOT ($2 AND s.state = 'grader_error')), 0)
         FROM instances i JOIN submissions s ON s.instance_id = i.id AND s.superseded = 0 WHERE i.entry_id = $1",
    )
    .bind(entry_id)
    .bind(epoch.is_over(now_ms))
    .fetch_one(&mut *tx)
    .await?;
    let completed = sqlx::query(
        "UPDATE entries SET completed_at_ms = $2
         WHERE id = $1 AND finalized_at_ms IS NOT NULL AND completed_at_ms IS NULL AND $3 = 0",
    )
    .bind(entry_id)
    .bind(now_ms)
    .bind(ungraded)
    .execute(&mut *tx)
    .await?;
    if completed.rows_affected() == 0 {
        return Ok(());
    }
    settle_quota(tx, entry_id, now_ms).await?;
    let bits = released_bits(entry.tier.feedback(epoch.commitment.dev_feedback), answered as usize);
    sqlx::query("UPDATE epochs SET released_bits = released_bits + $2 WHERE id = $1")
        .bind(epoch.id())
        .bind(bits)
        .execute(&mut *tx)
        .await?;
    if bits > 0.0 && epoch.released_bits + bits >= epoch.rules.budget_bits {
        close_in(tx, epoch.id(), BUDGET_SPENT, now_ms).await?;
    }
    Ok(())
}

/// Charges the answers of an entry that were graded, and gives back the others: when the entry ends and not before, so that the
/// ledger does not tell when an answer was graded or how.
async fn settle_quota(tx: &mut SqliteConnection, entry_id: &str, now_ms: i64) -> StoreResult<()> {
    let rows: Vec<(String, String, bool)> = sqlx::query_as(
        "SELECT s.id, s.owner, s.state = 'graded' AND s.superseded = 0
         FROM submissions s JOIN instances i ON i.id = s.instance_id
         WHERE i.entry_id = $1 AND s.owner IS NOT NULL ORDER BY s.id",
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
    /// Registers an entry.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn register_entry(
        &self,
        new: &NewEntry<'_>,
        once: Option<&Once>,
        now_ms: i64,
    ) -> StoreResult<Registered> {
        let mut tx = self.begin().await?;
        if let Some(once) = once {
            match once.before(&mut tx, now_ms).await? {
                Before::Never => once.keep(&mut tx, new.id, now_ms).await?,
                Before::Done(id) => return Ok(Registered::Before(id)),
                Before::OtherBody => return Ok(Registered::KeyUsedOtherwise),
            }
        }
        let epoch = epoch_in(&mut tx, new.epoch_id).await?;
        let Some(epoch) = epoch.filter(|epoch| epoch.is_open(now_ms)) else { return Ok(Registered::NotOpen) };
        let rows = sqlx::query(select_entry!(
            "WHERE epoch_id = $1 AND tier = $2 AND owner = $3 ORDER BY registered_at_ms, id"
        ))
        .bind(new.epoch_id)
        .bind(new.tier.name())
        .bind(new.owner)
        .fetch_all(&mut *tx)
        .await?;
        let own: Vec<EntryRow> = rows.iter().map(read).collect::<StoreResult<_>>()?;
        let most = match new.tier {
            Tier::Dev => epoch.rules.dev_entries,
            Tier::Official => epoch.rules.official_entries,
        };
        if own.len() as i64 >= most {
            return Ok(Registered::TooMany(most));
        }
        // What is registered can be drawn; half of the pool is kept for the official tier.
        let (dev, official): (i64, i64) = sqlx::query_as(
            "SELECT COALESCE(SUM(CASE WHEN tier = 'dev' THEN runs END), 0),
                    COALESCE(SUM(CASE WHEN tier = 'official' THEN runs END), 0)
             FROM entries WHERE epoch_id = $1",
        )
        .bind(new.epoch_id)
        .fetch_one(&mut *tx)
        .await?;
        let (runs, all) = (i64::from(new.runs), i64::from(epoch.commitment.per_instance));
        let is_dev_full = new.tier == Tier::Dev && dev + runs > all - all / 2;
        if dev + official + runs > all || is_dev_full {
            return Ok(Registered::PoolUsedUp);
        }
        if let Some(first) = own.first().filter(|_| new.tier == Tier::Official)
            && (first.agent != new.agent || first.configuration_hash != new.configuration_hash)
        {
            return Ok(Registered::OtherConfiguration(first.agent.clone()));
        }
        sqlx::query(
            "INSERT INTO entries (id, epoch_id, owner, agent, configuration_hash, tier, runs, registered_at_ms)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
        )
        .bind(new.id)
        .bind(new.epoch_id)
        .bind(new.owner)
        .bind(new.agent)
        .bind(new.configuration_hash)
        .bind(new.tier.name())
        .bind(i64::from(new.runs))
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        commit(tx, "register_entry").await?;
        Ok(Registered::New)
    }

    /// The entry with this id.
    ///
    /// # Errors
    /// Where the database fails or the row does not read back.
    pub async fn entry(&self, id: &str) -> StoreResult<Option<EntryRow>> {
        let row = sqlx::query(select_entry!("WHERE id = $1")).bind(id).fetch_optional(&self.readers).await?;
        row.as_ref().map(read).transpose()
    }

    /// The entries of an epoch, in the order in which they were registered.
    ///
    /// # Errors
    /// Where the database fails or a row does not read back.
    pub async fn entries(&self, epoch_id: &str) -> StoreResult<Vec<EntryRow>> {
        let rows = sqlx::query(select_entry!("WHERE epoch_id = $1 ORDER BY registered_at_ms, id"))
            .bind(epoch_id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(read).collect()
    }

    /// Says that no more answers will come. False where that was said before, or there is no such entry.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn finalize_entry(&self, id: &str, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let finalized =
            sqlx::query("UPDATE entries SET finalized_at_ms = $2 WHERE id = $1 AND finalized_at_ms IS NULL")
                .bind(id)
                .bind(now_ms)
                .execute(&mut *tx)
                .await?
                .rows_affected();
        complete_if_graded(&mut tx, id, now_ms).await?;
        commit(tx, "finalize_entry").await?;
        Ok(finalized > 0)
    }

    /// What grading found of an entry's instances, in the order of issue; those of runs that were never drawn are missing.
    ///
    /// # Errors
    /// Where the database fails or scores do not read back.
    pub async fn outcomes_of_entry(&self, id: &str) -> StoreResult<Vec<Outcome>> {
        outcomes_in(&mut *self.readers.acquire().await?, id).await
    }

    /// What boards need of the instances of a tier's complete entries, in the order of issue.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn board_outcomes(&self, epoch_id: &str, tier: Tier) -> StoreResult<Vec<BoardOutcome>> {
        Ok(sqlx::query_as(
            "SELECT e.id AS entry_id, i.salt, COALESCE(r.overall, 0) AS passes, s.id IS NOT NULL AS is_answered,
                    i.transcript_hash IS NOT NULL AS has_transcript, i.transcript_checked_ms IS NOT NULL AS is_checked
             FROM entries e JOIN instances i ON i.entry_id = e.id
             LEFT JOIN submissions s ON s.instance_id = i.id AND s.superseded = 0
             LEFT JOIN reports r ON r.submission_id = s.id
              AND r.attempt = (SELECT MAX(l.attempt) FROM reports l WHERE l.submission_id = s.id)
             WHERE e.epoch_id = $1 AND e.tier = $2 AND e.completed_at_ms IS NOT NULL ORDER BY i.ordinal",
        )
        .bind(epoch_id)
        .bind(tier.name())
        .fetch_all(&self.readers)
        .await?)
    }

    /// Finalizes what is left open of an epoch that is over: unanswered instances count as failed, and those that a failure of
    /// ours ended too. Says whether all is graded.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn finalize_what_is_over(&self, epoch: &EpochRow, now_ms: i64) -> StoreResult<bool> {
        if !epoch.is_over(now_ms) {
            return Ok(false);
        }
        let open: Vec<String> =
            sqlx::query_scalar("SELECT id FROM entries WHERE epoch_id = $1 AND completed_at_ms IS NULL ORDER BY id")
                .bind(epoch.id())
                .fetch_all(&self.readers)
                .await?;
        let mut is_complete = true;
        for entry in open {
            self.finalize_entry(&entry, now_ms).await?;
            is_complete &= self.entry(&entry).await?.is_none_or(|entry| entry.completed_at_ms.is_some());
        }
        Ok(is_complete)
    }
}
