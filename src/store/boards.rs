//! Leaderboards: the finished runs of a suite.

use super::runs::{RunRow, read_run, select_run};
use super::{Store, StoreResult};

impl Store {
    /// Finished runs of a suite, the earliest first.
    ///
    /// # Errors
    /// Where the database fails or a row does not read back.
    pub async fn finished_runs(&self, suite_id: &str) -> StoreResult<Vec<RunRow>> {
        let rows =
            sqlx::query(select_run!("WHERE r.suite_id = $1 AND r.state = 'finished' ORDER BY r.finished_at_ms, r.id"))
                .bind(suite_id)
                .fetch_all(&self.readers)
                .await?;
        rows.iter().map(read_run).collect()
    }
}
