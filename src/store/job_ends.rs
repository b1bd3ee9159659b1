//! Ends of jobs without a report: cancelled, failed, or given up.

use super::StoreResult;
use super::db::{Tx, query, query_as, query_scalar};
use super::events::{self, NewEvent};
use super::evidence::witness;
use super::quota;
use super::run_ends::end_if_complete;
use super::run_rows::count;
use super::states::SubmissionState;
use plumbline_engine::hidden::evidence::{Fact, FailureFact};
use plumbline_engine::hidden::receipts::Signer;

/// Maximum number of attempts; after that a submission ends as `grader_error`.
pub const MAX_ATTEMPTS: i64 = 3;

/// End of a submission without a report.
pub(super) struct End<'a> {
    pub submission_id: &'a str,
    pub run_id: Option<&'a str>,
    pub state: SubmissionState,
}

impl End<'_> {
    /// Sets the state, deletes the job, updates the run's counters, and ends the run if this was its last submission.
    /// Returns whether the run ended.
    pub async fn record(
        &self,
        tx: &mut Tx,
        signer: &Signer,
        why: &str,
        suite_id: &str,
        now_ms: i64,
    ) -> StoreResult<bool> {
        // The job goes first, as in every transaction that takes one.
        query("DELETE FROM jobs WHERE submission_id = $1").bind(self.submission_id).execute(&mut *tx).await?;
        let (owner, instance): (Option<String>, Option<String>) = query_as(
            "UPDATE submissions SET state = $2, error = $3, ended_at_ms = $4 WHERE id = $1 RETURNING owner, instance_id",
        )
        .bind(self.submission_id)
        .bind(self.state.name())
        .bind(why)
        .bind(now_ms)
        .fetch_one(&mut *tx)
        .await?;
        // The quota for hidden instances is settled when their entry is completed.
        if let Some(owner) = owner.filter(|_| instance.is_none()) {
            quota::refund(tx, &owner, self.submission_id, why, now_ms).await?;
        }
        let ended = NewEvent {
            run_id: self.run_id,
            submission_id: Some(self.submission_id),
            state: self.state.name(),
            overall: None,
        };
        match instance {
            None => events::enter(tx, &[ended], now_ms).await?,
            // The end of a hidden instance is not announced before the epoch is over.
            Some(instance) => {
                let epoch_id: String = query_scalar("SELECT epoch_id FROM instances WHERE id = $1")
                    .bind(&instance)
                    .fetch_one(&mut *tx)
                    .await?;
                let (submission, why) = (self.submission_id.to_owned(), why.to_owned());
                let failure = FailureFact { instance, submission, why, failed_at_ms: now_ms };
                witness(tx, signer, &epoch_id, &Fact::Failure(failure)).await?;
            }
        }
        if let Some(run_id) = self.run_id {
            let errors = i64::from(self.state == SubmissionState::GraderError);
            count(tx, run_id, -1, 0, errors).await?;
            return end_if_complete(tx, run_id, suite_id, now_ms).await;
        }
        Ok(false)
    }
}
