//! Episodes: attempts whose world the service keeps from step to step.

use super::db::{Row, query, query_scalar};
use super::{Store, StoreError, StoreResult, commit, compress, decompress};

/// Time for which an episode is kept after it expired, in milliseconds.
pub const KEPT_MS: i64 = 7 * 24 * 60 * 60 * 1_000;

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
    /// State as JSON.
    pub state: Vec<u8>,
    /// Time at which it was submitted.
    pub submitted_at_ms: Option<i64>,
    /// Submission that it became; none for a hidden instance.
    pub submission_id: Option<String>,
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
        let state: Vec<u8> = row.get("state")?;
        Ok(Self {
            id: row.get("id")?,
            owner: row.get("owner")?,
            attempt,
            created_at_ms: row.get("created_at_ms")?,
            expires_at_ms: row.get("expires_at_ms")?,
            step: row.get("step")?,
            state: decompress("episodes", &state)?,
            submitted_at_ms: row.get("submitted_at_ms")?,
            submission_id: row.get("submission_id")?,
        })
    }
}

impl Store {
    /// Stores a new episode, unless its owner has `most` open ones; returns whether it was stored. Two requests at the
    /// same time may exceed the number by one.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn open_episode(&self, new: &EpisodeRow, most: i64) -> StoreResult<bool> {
        const OPEN: &str = "SELECT COUNT(*) FROM episodes
             WHERE (owner = $1 OR (owner IS NULL AND $1 IS NULL)) AND submitted_at_ms IS NULL AND expires_at_ms > $2";
        let state = compress(&new.state)?;
        let mut tx = self.begin().await?;
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
        .bind(state)
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
                    submitted_at_ms, submission_id
             FROM episodes WHERE id = $1",
        )
        .bind(id)
        .fetch_optional(&self.readers)
        .await?;
        row.as_ref().map(EpisodeRow::read).transpose()
    }

    /// Stores the next step of an episode; returns false if another request made this step, or submitted the episode,
    /// in the meantime.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn advance_episode(&self, id: &str, step: i64, state: &[u8]) -> StoreResult<bool> {
        let state = compress(state)?;
        let mut tx = self.begin().await?;
        let changed =
            query("UPDATE episodes SET step = $1, state = $2 WHERE id = $3 AND step = $4 AND submitted_at_ms IS NULL")
                .bind(step)
                .bind(state)
                .bind(id)
                .bind(step - 1)
                .execute(&mut tx)
                .await?;
        commit(tx, "advance_episode").await?;
        Ok(changed == 1)
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
