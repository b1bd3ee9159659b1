//! Episodes: attempts whose world the service keeps from step to step.

use super::compression::{compress, decompress};
use super::db::{Row, query, query_scalar};
use super::locks::Lock;
use super::{Store, StoreError, StoreResult, commit};

/// Days for which an episode is kept after it expired.
pub const KEPT_DAYS: i64 = 7;
/// The same time in milliseconds.
pub const KEPT_MS: i64 = KEPT_DAYS * 24 * 60 * 60 * 1_000;

/// What an episode is an attempt at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Attempt {
    /// Task of a suite, as part of a run or alone.
    Task {
        /// `name@version` of the suite.
        suite_id: String,
        /// Number of the task.
        number: u32,
        /// Identifier of the run.
        run_id: Option<String>,
    },
    /// Hidden instance, by its identifier.
    Instance(String),
}

/// Row of an episode.
#[derive(Debug, Clone)]
pub struct EpisodeRow {
    /// Identifier of the episode.
    pub id: String,
    /// Owner of the key that opened it.
    pub owner: Option<String>,
    /// What it is an attempt at.
    pub attempt: Attempt,
    /// Time at which it was opened, in milliseconds since 1970.
    pub created_at_ms: i64,
    /// Time from which it takes no more steps.
    pub expires_at_ms: i64,
    /// Number of its last step, from 1; 0 before the first.
    pub step: i64,
    /// State, packed by [`pack`].
    pub state: Vec<u8>,
    /// Time from which it takes no more steps because it is being submitted.
    pub submitting_at_ms: Option<i64>,
    /// Time at which it was submitted.
    pub submitted_at_ms: Option<i64>,
    /// Submission that it became; none for a hidden instance.
    pub submission_id: Option<String>,
}

/// Packs the state of an episode for storage.
///
/// # Errors
/// Returns an error if it cannot be packed.
pub fn pack(state: &[u8]) -> StoreResult<Vec<u8>> {
    compress(state)
}

/// Unpacks the state of an episode.
///
/// # Errors
/// Returns an error if the stored bytes are damaged.
pub fn unpack(state: &[u8]) -> StoreResult<Vec<u8>> {
    decompress("episodes", state)
}

impl EpisodeRow {
    fn read(row: &Row) -> StoreResult<Self> {
        let corrupt = |why: &str| StoreError::corrupt("episodes", why);
        let number: Option<i64> = row.get("task_number")?;
        let (suite_id, instance_id): (Option<String>, Option<String>) = (row.get("suite_id")?, row.get("instance_id")?);
        let attempt = match (suite_id, number, instance_id) {
            (Some(suite_id), Some(number), None) => {
                let number = u32::try_from(number).map_err(|_| corrupt("task_number"))?;
                Attempt::Task { suite_id, number, run_id: row.get("run_id")? }
            }
            (None, None, Some(instance)) => Attempt::Instance(instance),
            _ => return Err(corrupt("neither a task nor an instance")),
        };
        Ok(Self {
            id: row.get("id")?,
            owner: row.get("owner")?,
            attempt,
            created_at_ms: row.get("created_at_ms")?,
            expires_at_ms: row.get("expires_at_ms")?,
            step: row.get("step")?,
            state: row.get("state")?,
            submitting_at_ms: row.get("submitting_at_ms")?,
            submitted_at_ms: row.get("submitted_at_ms")?,
            submission_id: row.get("submission_id")?,
        })
    }
}

impl Store {
    /// Stores a new episode, unless its owner has `most` open ones; returns whether it was stored.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn open_episode(&self, new: &EpisodeRow, most: i64) -> StoreResult<bool> {
        const OPEN: &str = "SELECT COUNT(*) FROM episodes
             WHERE (owner = $1 OR (owner IS NULL AND $1 IS NULL)) AND submitted_at_ms IS NULL AND expires_at_ms > $2";
        let mut tx = self.begin().await?;
        tx.lock([Lock::Owner(new.owner.as_deref().unwrap_or_default())]).await?;
        let open: i64 = query_scalar(OPEN).bind(&new.owner).bind(new.created_at_ms).fetch_one(&mut tx).await?;
        if open >= most {
            return Ok(false);
        }
        let (suite_id, number, run_id, instance_id) = match &new.attempt {
            Attempt::Task { suite_id, number, run_id } => {
                (Some(suite_id), Some(i64::from(*number)), run_id.as_ref(), None)
            }
            Attempt::Instance(id) => (None, None, None, Some(id)),
        };
        query(
            "INSERT INTO episodes (id, owner, suite_id, task_number, run_id, instance_id, created_at_ms, expires_at_ms, step, state)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, 0, $9)",
        )
        .bind(&new.id)
        .bind(&new.owner)
        .bind(suite_id)
        .bind(number)
        .bind(run_id)
        .bind(instance_id)
        .bind(new.created_at_ms)
        .bind(new.expires_at_ms)
        .bind(&new.state[..])
        .execute(&mut tx)
        .await?;
        commit(tx, "open_episode").await?;
        Ok(true)
    }

    /// Returns the episode with this identifier.
    ///
    /// # Errors
    /// Returns an error if the database fails or the row cannot be read.
    pub async fn episode(&self, id: &str) -> StoreResult<Option<EpisodeRow>> {
        let row = query(
            "SELECT id, owner, suite_id, task_number, run_id, instance_id, created_at_ms, expires_at_ms, step, state,
                    submitting_at_ms, submitted_at_ms, submission_id
             FROM episodes WHERE id = $1",
        )
        .bind(id)
        .fetch_optional(&self.readers)
        .await?;
        row.as_ref().map(EpisodeRow::read).transpose()
    }

    /// Stores the next step of an episode, with its packed state; returns false if another request made this step, or
    /// began to submit the episode, in the meantime.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn advance_episode(&self, id: &str, step: i64, state: &[u8]) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let changed = query(
            "UPDATE episodes SET step = $1, state = $2
             WHERE id = $3 AND step = $4 AND submitting_at_ms IS NULL AND submitted_at_ms IS NULL",
        )
        .bind(step)
        .bind(state)
        .bind(id)
        .bind(step - 1)
        .execute(&mut tx)
        .await?;
        commit(tx, "advance_episode").await?;
        Ok(changed == 1)
    }

    /// Closes an episode for further steps because it is about to be submitted as it stands after a step; returns false
    /// if another request made a step in the meantime.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn close_episode(&self, id: &str, step: i64, now_ms: i64) -> StoreResult<bool> {
        let mut tx = self.begin().await?;
        let changed =
            query("UPDATE episodes SET submitting_at_ms = COALESCE(submitting_at_ms, $1) WHERE id = $2 AND step = $3")
                .bind(now_ms)
                .bind(id)
                .bind(step)
                .execute(&mut tx)
                .await?;
        commit(tx, "close_episode").await?;
        Ok(changed == 1)
    }

    /// Opens an episode again whose submission was refused.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn reopen_episode(&self, id: &str) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query("UPDATE episodes SET submitting_at_ms = NULL WHERE id = $1 AND submitted_at_ms IS NULL")
            .bind(id)
            .execute(&mut tx)
            .await?;
        commit(tx, "reopen_episode").await
    }

    /// Notes that an episode was submitted, and as which submission. Only the first note counts.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn end_episode(&self, id: &str, submission_id: Option<&str>, now_ms: i64) -> StoreResult<()> {
        let mut tx = self.begin().await?;
        query("UPDATE episodes SET submitted_at_ms = $1, submission_id = $2 WHERE id = $3 AND submitted_at_ms IS NULL")
            .bind(now_ms)
            .bind(submission_id)
            .bind(id)
            .execute(&mut tx)
            .await?;
        commit(tx, "end_episode").await
    }

    /// Deletes episodes that expired a while ago.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn forget_old_episodes(&self, now_ms: i64) -> StoreResult<()> {
        const ARE_THERE: &str = "SELECT EXISTS (SELECT 1 FROM episodes WHERE expires_at_ms <= $1)";
        let before_ms = now_ms - KEPT_MS;
        let are_there: bool = query_scalar(ARE_THERE).bind(before_ms).fetch_one(&self.readers).await?;
        if !are_there {
            return Ok(());
        }
        let mut tx = self.begin().await?;
        query("DELETE FROM episodes WHERE expires_at_ms <= $1").bind(before_ms).execute(&mut tx).await?;
        commit(tx, "forget_old_episodes").await
    }
}
