//! Leaderboards: the finished runs of a suite.

use sqlx::sqlite::SqliteRow;

use super::runs::{RunRow, read_run, select_run};
use super::{Store, StoreResult};

impl Store {
    /// Finished runs of a suite, the earliest first, without those whose rows are damaged.
    ///
    /// # Errors
    /// Where the database fails.
    pub async fn finished_runs(&self, suite_id: &str) -> StoreResult<Vec<RunRow>> {
        let rows =
            sqlx::query(select_run!("WHERE r.suite_id = $1 AND r.state = 'finished' ORDER BY r.finished_at_ms, r.id"))
                .bind(suite_id)
                .fetch_all(&self.readers)
                .await?;
        Ok(rows.iter().filter_map(whole).collect())
    }
}

/// The run of a row; none where the row is damaged, which is noted: one such row must not take all boards down.
fn whole(row: &SqliteRow) -> Option<RunRow> {
    match read_run(row) {
        Ok(run) => Some(run),
        Err(error) => {
            tracing::error!(%error, "a finished run does not read back, and is not on its board");
            metrics::counter!("plumbline_corrupt_rows_total").increment(1);
            None
        }
    }
}
