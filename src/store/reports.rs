//! Reports: what grading found. Written once, by the attempt that holds the job.

use sqlx::Row as _;

use super::jobs::{Claim, End, holds};
use super::submissions::SubmissionState;
use super::{Store, StoreError, StoreResult, compress, decompress};
use crate::grading::Report;

/// A stored report with where it came from.
#[derive(Debug, Clone)]
pub struct ReportRow {
    /// The report.
    pub report: Report,
    /// Attempt that made it.
    pub attempt: i64,
    /// Program and version that made it.
    pub grader: String,
    /// When.
    pub graded_at_ms: i64,
    /// How long grading took, in microseconds.
    pub grading_us: i64,
}

impl Store {
    /// Stores a report and ends its submission, if the claim's attempt still holds the job. False where it does not:
    /// the report is then dropped, because another attempt's counts.
    ///
    /// # Errors
    /// Where the database fails; nothing is stored then.
    pub async fn record(&self, claim: &Claim, report: &Report, grading_us: i64, now_ms: i64) -> StoreResult<bool> {
        let json = |error: serde_json::Error| StoreError::corrupt("reports", error);
        let body = compress(&serde_json::to_vec(report).map_err(json)?)?;
        let scores = serde_json::to_string(&report.scores()).map_err(json)?;
        let mut tx = self.begin().await?;
        if !holds(&mut tx, claim).await? {
            return Ok(false);
        }
        sqlx::query(
            "INSERT INTO reports (submission_id, attempt, checks_version, grader, overall, accuracy, scores, body,
                                  graded_at_ms, grading_us)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)",
        )
        .bind(&claim.submission_id)
        .bind(claim.attempt)
        .bind(i64::from(report.checks_version))
        .bind(GRADER)
        .bind(report.overall)
        .bind(report.accuracy)
        .bind(scores)
        .bind(body)
        .bind(now_ms)
        .bind(grading_us)
        .execute(&mut *tx)
        .await?;
        let run_id = claim.run_id.as_deref();
        let end = End { submission_id: &claim.submission_id, run_id, state: SubmissionState::Graded };
        end.record(&mut tx, None, &claim.suite_id, now_ms).await?;
        tx.commit().await?;
        Ok(true)
    }

    /// The latest report on a submission.
    ///
    /// # Errors
    /// Where the database fails or the report does not read back.
    pub async fn report(&self, submission_id: &str) -> StoreResult<Option<ReportRow>> {
        let row = sqlx::query(
            "SELECT attempt, grader, graded_at_ms, grading_us, body FROM reports WHERE submission_id = $1
             ORDER BY attempt DESC LIMIT 1",
        )
        .bind(submission_id)
        .fetch_optional(&self.readers)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let body = decompress("reports", row.try_get(4)?)?;
        Ok(Some(ReportRow {
            report: serde_json::from_slice(&body).map_err(|error| StoreError::corrupt("reports", error))?,
            attempt: row.try_get(0)?,
            grader: row.try_get(1)?,
            graded_at_ms: row.try_get(2)?,
            grading_us: row.try_get(3)?,
        }))
    }
}

/// Name and version of this program, stored with each report.
pub const GRADER: &str = concat!("plumbline ", env!("CARGO_PKG_VERSION"));
