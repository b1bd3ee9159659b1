//! Grades: reports, the scores and the verdict beside them, and the receipts that were signed for them.

use serde_json::Value;

use super::{Check, Found, FoundKind};
use crate::store::StoreResult;
use crate::store::db::{Row, query_scalar};
use plumbline_engine::grading::{ProblemScores, Report};
use plumbline_engine::hidden::canonical::canonical_json;
use plumbline_engine::hidden::receipts::{Graded, receipt};

impl Check<'_> {
    pub(super) async fn reports(&mut self) -> u64 {
        let why = "it is graded, and its report is missing";
        self.submissions_that(
            "SELECT id FROM submissions s WHERE state = 'graded'
             AND NOT EXISTS (SELECT 1 FROM reports r WHERE r.submission_id = s.id) ORDER BY id",
            why,
        )
        .await;
        let why = "it waits to be graded, and its job is missing";
        self.submissions_that(
            "SELECT id FROM submissions s WHERE ended_at_ms IS NULL
             AND NOT EXISTS (SELECT 1 FROM jobs j WHERE j.submission_id = s.id) ORDER BY id",
            why,
        )
        .await;
        let mut without_receipt = 0_u64;
        let count = self
            .rows(
                "reports",
                "SELECT r.submission_id, r.body, r.scores, r.overall, r.accuracy, r.attempt, r.grader, r.graded_at_ms,
                        s.suite_id, s.log_hash, s.task_hash, COALESCE(k.body, p.body) AS receipt
                 FROM reports r JOIN submissions s ON s.id = r.submission_id
                 LEFT JOIN receipts k ON k.submission_id = r.submission_id AND k.attempt = r.attempt
                 LEFT JOIN pending_receipts p ON p.submission_id = r.submission_id AND p.attempt = r.attempt
                 ORDER BY r.submission_id, r.attempt",
                async |row, pool, blobs| {
                    let json = blobs.unpack(pool, "reports", row.get(1)?).await?;
                    let receipt: Option<&str> = row.get("receipt")?;
                    without_receipt += u64::from(receipt.is_none());
                    let report = match serde_json::from_slice::<Report>(&json) {
                        Err(error) => return Ok(Some(error.to_string())),
                        Ok(report) => report,
                    };
                    if let Some(fault) = fault_of_scores(&report, row)? {
                        return Ok(Some(fault));
                    }
                    if row.get::<&str>("task_hash")? != report.task_hash {
                        return Ok(Some("it is of another task than its submission".to_owned()));
                    }
                    receipt.map_or(Ok(None), |signed| fault_of_receipt(&report, row, signed))
                },
            )
            .await;
        if without_receipt > 0 {
            let detail = format!("{without_receipt} have no receipt; those of imports and regrades need none");
            (self.tell)(Found { kind: FoundKind::Noted, place: "reports".to_owned(), detail });
        }
        count
    }

    pub(super) async fn regraded(&mut self) -> u64 {
        let sql = "SELECT submission_id, body, scores, overall, accuracy FROM regraded ORDER BY submission_id";
        self.rows("regraded", sql, async |row, pool, blobs| {
            let json = blobs.unpack(pool, "regraded", row.get(1)?).await?;
            match serde_json::from_slice::<Report>(&json) {
                Err(error) => Ok(Some(error.to_string())),
                Ok(report) => fault_of_scores(&report, row),
            }
        })
        .await
    }

    /// Tells of each submission that a query returns.
    async fn submissions_that(&mut self, sql: &'static str, why: &str) {
        let found: StoreResult<Vec<String>> = query_scalar(sql).fetch_all(&mut self.moment).await;
        match found {
            Ok(ids) => {
                for id in ids {
                    (self.tell)(Found::damaged(format!("submissions {id}"), why.to_owned()));
                }
            }
            Err(error) => (self.tell)(Found::of("submissions".to_owned(), &error)),
        }
    }
}

/// Compares a report with the scores and the verdict in its row.
fn fault_of_scores(report: &Report, row: &Row) -> StoreResult<Option<String>> {
    let scores = report.scores();
    let noted = match serde_json::from_str::<ProblemScores>(row.get("scores")?) {
        Err(error) => return Ok(Some(error.to_string())),
        Ok(noted) => noted,
    };
    let verdict: (bool, Option<bool>) = (row.get("overall")?, row.get("accuracy")?);
    Ok(if scores != noted {
        Some("it has other scores than were noted".to_owned())
    } else if (report.overall, report.accuracy) != verdict || scores.overall() != verdict.0 {
        Some("it has another verdict than was noted".to_owned())
    } else {
        None
    })
}

/// Compares a report and its submission with the receipt that was signed for them.
fn fault_of_receipt(report: &Report, row: &Row, signed: &str) -> StoreResult<Option<String>> {
    let graded = Graded {
        submission: row.get("submission_id")?,
        attempt: row.get("attempt")?,
        suite: row.get("suite_id")?,
        log_hash: row.get("log_hash")?,
        grader: row.get("grader")?,
        graded_at_ms: row.get("graded_at_ms")?,
        hidden: None,
    };
    let signed: Value = match serde_json::from_str(signed) {
        Err(error) => return Ok(Some(format!("its receipt: {error}"))),
        Ok(signed) => signed,
    };
    let due = receipt(&graded, report);
    // An older program may have signed fewer facts. The row has the time of its own storing.
    let mut facts = due.as_object().into_iter().flatten().filter(|(name, _)| *name != "graded_at_ms");
    let is_other = |signed: &Value, fact: &Value| canonical_json(signed) != canonical_json(fact);
    let other = facts.find(|(name, fact)| signed.get(*name).is_some_and(|signed| is_other(signed, fact)));
    Ok(other.map(|(name, _)| format!("its signed receipt says otherwise: {name}")))
}
