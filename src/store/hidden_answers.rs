//! Answers to hidden instances: one log each, accepted once.

use super::acceptance::{Accepted, Decide, Decision, Facts, ToStore, store_all};
use super::db::{query, query_as};
use super::entries::entry_in;
use super::epochs::epoch_in;
use super::evidence::witness;
use super::instances::instance_in;
use super::submissions::NewSubmission;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{AnswerFact, Fact};

/// Outcome of posting an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answered {
    /// The answer is stored and queued; holds its receipt as JSON.
    New(String),
    /// The instance was already answered with the same log; holds the receipt of that answer.
    Same(Option<String>),
    /// The instance was already answered with the same log, but with a different promised transcript or none; holds the
    /// stored hash.
    OtherTranscript(Option<String>),
    /// The instance was already answered with a different log.
    Other,
    /// The time to answer the instance has passed.
    Expired,
    /// The entry is finalized, or its epoch is over.
    Closed,
    /// The owner's quota is used up.
    QuotaUsedUp,
}

impl Store {
    /// Stores the answer to an instance: one log, once. The same log again counts as the same answer.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is stored.
    pub async fn answer_instance(
        &self,
        instance_id: &str,
        new: &NewSubmission,
        transcript_hash: Option<&str>,
        decide: Decide,
        now_ms: i64,
    ) -> StoreResult<Answered> {
        let mut tx = self.begin().await?;
        let instance = instance_in(&mut tx, instance_id).await?;
        let before: Option<(String, String, String, Option<String>)> = query_as(
            "SELECT s.id, s.log_hash, s.state, i.receipt FROM submissions s JOIN instances i ON i.id = s.instance_id
             WHERE s.instance_id = $1 AND s.superseded = FALSE",
        )
        .bind(instance_id)
        .fetch_optional(&mut tx)
        .await?;
        match &before {
            Some((_, log_hash, _, _)) if *log_hash != new.log_hash => return Ok(Answered::Other),
            Some(_) if transcript_hash.is_some() && transcript_hash != instance.transcript_hash.as_deref() => {
                return Ok(Answered::OtherTranscript(instance.transcript_hash));
            }
            // An answer whose grading failed on our side is graded again if the same log is posted again.
            Some((_, _, state, receipt)) if state != "grader_error" => return Ok(Answered::Same(receipt.clone())),
            _ => {}
        }
        let entry = entry_in(&mut tx, &instance.entry_id).await?;
        let epoch = epoch_in(&mut tx, &instance.epoch_id).await?;
        // A complete entry may have been revealed, so it must not change.
        if entry.as_ref().is_none_or(|entry| entry.completed_at_ms.is_some()) {
            return Ok(Answered::Closed);
        }
        if before.is_none() {
            let is_finalized = entry.is_none_or(|entry| entry.finalized_at_ms.is_some());
            if is_finalized || epoch.is_none_or(|epoch| epoch.is_over(now_ms)) {
                return Ok(Answered::Closed);
            }
            if now_ms >= instance.expires_at_ms {
                return Ok(Answered::Expired);
            }
        }
        if let Some((id, _, _, _)) = &before {
            query("UPDATE submissions SET superseded = TRUE WHERE id = $1").bind(id).execute(&mut tx).await?;
        }
        // An answer that is graded again is charged already; charging it no further does not reveal that grading
        // failed.
        let earlier = before.as_ref().map(|(id, _, _, _)| id.as_str());
        let submission = std::slice::from_ref(new);
        let mut facts = Facts::read(&mut tx, submission.iter()).await?.about(submission);
        if earlier.is_some() {
            facts.iter_mut().for_each(|facts| facts.quota_left = None);
        }
        match decide(submission, facts).pop() {
            Some(Decision::Answer(Accepted::QuotaUsedUp)) => return Ok(Answered::QuotaUsedUp),
            Some(Decision::Store { supersedes }) => {
                store_all(&mut tx, &[ToStore { new, supersedes, takes_over: earlier }], now_ms).await?;
            }
            other => return Err(StoreError::corrupt("submissions", format!("{other:?} on an answer without a run"))),
        }
        query("UPDATE submissions SET instance_id = $2 WHERE id = $1")
            .bind(&new.id)
            .bind(instance_id)
            .execute(&mut tx)
            .await?;
        // An answer that is graded again after a failure of ours looks like any repeated answer.
        if let Some((_, _, _, receipt)) = before {
            commit(tx, "answer_instance").await?;
            self.queued.notify_waiters();
            return Ok(Answered::Same(receipt));
        }
        let answer = AnswerFact {
            instance: instance_id.to_owned(),
            entry: instance.entry_id,
            log_sha256: new.log_hash.clone(),
            transcript_sha256: transcript_hash.map(str::to_owned),
            answered_at_ms: now_ms,
        };
        let receipt = witness(&mut tx, &*self.signer()?, &instance.epoch_id, &Fact::Answer(answer)).await?;
        let receipt = serde_json::to_string(&receipt).map_err(|error| StoreError::corrupt("instances", error))?;
        query("UPDATE instances SET transcript_hash = $2, receipt = $3 WHERE id = $1")
            .bind(instance_id)
            .bind(transcript_hash)
            .bind(&receipt)
            .execute(&mut tx)
            .await?;
        commit(tx, "answer_instance").await?;
        self.queued.notify_waiters();
        Ok(Answered::New(receipt))
    }
}
