//! Results of runs.

use super::db::{Tx, query};
use super::locks::Lock;
use super::{StoreError, StoreResult};
use plumbline_engine::grading::ProblemScores;
use plumbline_engine::grading::fingerprints::Fingerprint;
use plumbline_engine::grading::outcomes::Outcomes;

/// Records the result of a run, valid from now on.
pub(super) async fn enter_result(
    tx: &mut Tx,
    run_id: &str,
    summary: &str,
    outcomes: &Outcomes,
    fingerprint: &Fingerprint,
    now_ms: i64,
) -> StoreResult<()> {
    tx.lock([Lock::Order]).await?;
    query("INSERT INTO results (run_id, since_ms, summary, outcomes, fingerprint) VALUES ($1, $2, $3, $4, $5)")
        .bind(run_id)
        .bind(now_ms)
        .bind(summary)
        .bind(outcomes.to_bytes())
        .bind(fingerprint.to_bytes())
        .execute(tx)
        .await?;
    Ok(())
}

/// Returns the scores of a run's reports, the latest of each submission.
pub(super) async fn problems_of(tx: &mut Tx, id: &str) -> StoreResult<Vec<ProblemScores>> {
    let rows = query(
        "SELECT s.task_number, r.scores
         FROM submissions s JOIN latest_reports r ON r.submission_id = s.id
         WHERE s.run_id = $1 AND s.state = 'graded' AND s.superseded = FALSE
         ORDER BY s.task_number",
    )
    .bind(id)
    .fetch_all(&mut *tx)
    .await?;
    let mut problems = Vec::with_capacity(rows.len());
    for row in &rows {
        let scores: ProblemScores =
            serde_json::from_str(row.get("scores")?).map_err(|error| StoreError::corrupt("reports", error))?;
        problems.push(scores);
    }
    Ok(problems)
}
