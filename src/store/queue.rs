//! The queue: assigns each job to a lane and a round.
//!
//! Owners in a lane are served round-robin: each job has a round (column `turn`), and lower rounds are served first.
//! Jobs of one owner get consecutive rounds, and none below the greatest round already served in the lane. An owner who
//! comes late is therefore served next, and not after all jobs that another owner has queued. The greatest round never
//! decreases, even when the lane is empty, and all processes on a database share it.

use sqlx::SqliteConnection;

use super::StoreResult;

/// Lane of the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lane {
    /// Jobs that take next to no time. One worker is reserved for them.
    Quick,
    /// All other jobs.
    Long,
    /// Answers to hidden instances: kept apart, so that nobody can tell how long they take.
    Hidden,
}

impl Lane {
    /// Returns the name of the lane in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Long => "long",
            Self::Hidden => "hidden",
        }
    }
}

/// Job to enqueue.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewJob<'a> {
    pub submission_id: &'a str,
    pub owner: Option<&'a str>,
    pub lane: Lane,
}

/// Enqueues a job in its owner's next round.
pub(super) async fn enter(tx: &mut SqliteConnection, job: &NewJob<'_>, now_ms: i64) -> StoreResult<()> {
    sqlx::query(
        "INSERT INTO jobs (submission_id, queued_at_ms, lane, owner, turn)
         SELECT $1, $2, l.name, $4,
                MAX(l.turn, COALESCE((SELECT MAX(j.turn) + 1 FROM jobs j WHERE j.lane = l.name AND j.owner = $4), 0))
         FROM lanes l WHERE l.name = $3",
    )
    .bind(job.submission_id)
    .bind(now_ms)
    .bind(job.lane.name())
    .bind(job.owner.unwrap_or_default())
    .execute(tx)
    .await?;
    Ok(())
}

/// Records that a job of this round was taken.
pub(super) async fn note_taken(tx: &mut SqliteConnection, lane: Lane, turn: i64) -> StoreResult<()> {
    sqlx::query("UPDATE lanes SET turn = $2 WHERE name = $1 AND turn < $2")
        .bind(lane.name())
        .bind(turn)
        .execute(tx)
        .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;

    async fn turns(tx: &mut SqliteConnection) -> Vec<(String, i64)> {
        sqlx::query_as("SELECT owner, turn FROM jobs ORDER BY queued_at_ms").fetch_all(tx).await.unwrap()
    }

    async fn enter_for(tx: &mut SqliteConnection, owner: &str, lane: Lane, at: i64) {
        let id = format!("{owner}{at}");
        enter(tx, &NewJob { submission_id: &id, owner: Some(owner), lane }, at).await.unwrap();
    }

    #[tokio::test]
    async fn owners_take_turns_and_turns_never_fall() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("p.db")).await.unwrap();
        let mut tx = store.begin().await.unwrap();
        // The jobs here belong to no submission; only their order matters.
        sqlx::query("PRAGMA defer_foreign_keys = ON").execute(&mut *tx).await.unwrap();
        for at in 0..4 {
            enter_for(&mut tx, "a", Lane::Long, at).await;
        }
        note_taken(&mut tx, Lane::Long, 1).await.unwrap();
        enter_for(&mut tx, "b", Lane::Long, 4).await;
        enter_for(&mut tx, "b", Lane::Long, 5).await;
        enter_for(&mut tx, "c", Lane::Hidden, 6).await;
        let found = turns(&mut tx).await;
        let wanted = [("a", 0), ("a", 1), ("a", 2), ("a", 3), ("b", 1), ("b", 2), ("c", 0)];
        assert_eq!(found, wanted.map(|(owner, turn)| (owner.to_owned(), turn)));
        // An owner who comes to an empty lane gets no round below those already served.
        sqlx::query("DELETE FROM jobs").execute(&mut *tx).await.unwrap();
        note_taken(&mut tx, Lane::Long, 0).await.unwrap();
        enter_for(&mut tx, "d", Lane::Long, 7).await;
        assert_eq!(turns(&mut tx).await, [("d".to_owned(), 1)]);
    }
}
