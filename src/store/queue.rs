//! The queue: assigns each job to a lane and a round.
//!
//! Owners in a lane are served round-robin: each job has a round (column `turn`), and lower rounds are served first.
//! Jobs of one owner get consecutive rounds, and none below the greatest round already served in the lane. An owner who
//! comes late is therefore served next, and not after all jobs that another owner has queued. The greatest round never
//! decreases, even when the lane is empty, and all processes on a database share it.

use super::StoreResult;
use super::db::{Builder, Tx, query, query_scalar};
use super::states::text_column;

/// Maximum number of jobs that one statement inserts.
const AT_ONCE: usize = 500;

/// Lane of the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lane {
    /// Jobs that take next to no time. One worker is reserved for them.
    Quick,
    /// All other jobs.
    Long,
    /// Answers to hidden instances: kept apart, so that nobody can tell how long they take.
    Hidden,
}

impl Lane {
    const ALL: [Self; 3] = [Self::Quick, Self::Long, Self::Hidden];

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

text_column!(Lane);

/// Job to enqueue.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewJob<'a> {
    pub submission_id: &'a str,
}

/// Enqueues jobs of one owner in the owner's next rounds.
pub(super) async fn enter(tx: &mut Tx, lane: Lane, owner: &str, jobs: &[NewJob<'_>], now_ms: i64) -> StoreResult<()> {
    let served: i64 = query_scalar("SELECT turn FROM lanes WHERE name = $1").bind(lane).fetch_one(&mut *tx).await?;
    let own: Option<i64> = query_scalar("SELECT MAX(turn) FROM jobs WHERE lane = $1 AND owner = $2")
        .bind(lane)
        .bind(owner)
        .fetch_one(&mut *tx)
        .await?;
    let first = served.max(own.map_or(0, |own| own + 1));
    for (part, jobs) in jobs.chunks(AT_ONCE).enumerate() {
        let first = first + (part * AT_ONCE) as i64;
        let mut insert = Builder::new("INSERT INTO jobs (submission_id, queued_at_ms, lane, owner, turn) ");
        insert.push_values((first..).zip(jobs), |row, (turn, job)| {
            row.push_bind(job.submission_id).push_bind(now_ms).push_bind(lane).push_bind(owner).push_bind(turn);
        });
        insert.build().execute(&mut *tx).await?;
    }
    Ok(())
}

/// Records that a job of this round was taken.
pub(super) async fn note_taken(tx: &mut Tx, lane: Lane, turn: i64) -> StoreResult<()> {
    query("UPDATE lanes SET turn = $2 WHERE name = $1 AND turn < $2").bind(lane).bind(turn).execute(tx).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;
    use crate::store::db::query_as;

    async fn turns(tx: &mut Tx) -> Vec<(String, i64)> {
        query_as("SELECT owner, turn FROM jobs ORDER BY queued_at_ms").fetch_all(tx).await.unwrap()
    }

    async fn enter_for(tx: &mut Tx, owner: &str, lane: Lane, at: i64) {
        let id = format!("{owner}{at}");
        enter(tx, lane, owner, &[NewJob { submission_id: &id }], at).await.unwrap();
    }

    #[tokio::test]
    async fn owners_take_turns_and_turns_never_fall() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(&folder.path().join("p.db").into(), None).await.unwrap();
        let mut tx = store.begin().await.unwrap();
        // The jobs here belong to no submission; only their order matters.
        query("PRAGMA defer_foreign_keys = ON").execute(&mut tx).await.unwrap();
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
        query("DELETE FROM jobs").execute(&mut tx).await.unwrap();
        note_taken(&mut tx, Lane::Long, 0).await.unwrap();
        enter_for(&mut tx, "d", Lane::Long, 7).await;
        assert_eq!(turns(&mut tx).await, [("d".to_owned(), 1)]);
    }
}
