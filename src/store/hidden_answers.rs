//! Answers to hidden instances: one log each, accepted once, with the facts that decide on it.

use super::acceptance::{Accepted, Decide, Decision, Facts, ToStore, store_all, supersede};
use super::db::{Tx, query, query_as};
use super::entries::{EntryRow, entry_in};
use super::epochs::{EpochRow, epoch_in};
use super::evidence::witness;
use super::instances::{InstanceRow, instance_in};
use super::locks::Lock;
use super::order_of_steps::{StepsOf, not_before};
use super::postgres::notices::Notice;
use super::states::SubmissionState;
use super::submissions::NewSubmission;
use super::{Store, StoreError, StoreResult, commit};
use plumbline_engine::hidden::evidence::{AnswerFact, Fact};

/// Reason why an answer is not stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AnswerRefusal {
    /// The instance was already answered with the same log, but with a different promised transcript or none; holds the
    /// stored hash.
    OtherTranscript(Option<String>),
    /// The instance was already answered with a different log.
    OtherLog,
    /// The time to answer the instance has passed.
    Expired,
    /// The entry is finalized, or its epoch is over.
    Closed,
    /// The owner's quota is used up.
    QuotaUsedUp,
}

/// Outcome of posting an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answered {
    /// The answer is stored and queued; holds its receipt as JSON.
    New(String),
    /// The instance was already answered with the same log; holds the receipt of that answer.
    Same(Option<String>),
    /// The answer is not stored, for this reason.
    Refused(AnswerRefusal),
}

/// Answer to store.
#[derive(Debug, Clone, Copy)]
pub struct NewAnswer<'a> {
    /// Identifier of the instance.
    pub instance_id: &'a str,
    /// Submission that carries the log.
    pub submission: &'a NewSubmission,
    /// SHA-256 of the transcript that the entrant promises to show.
    pub transcript_hash: Option<&'a str>,
}

/// Answer that an instance already has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredAnswer {
    /// Identifier of its submission.
    pub submission_id: String,
    /// SHA-256 of its log's canonical JSON, in hex.
    pub log_hash: String,
    /// State of its submission.
    pub state: SubmissionState,
    /// Receipt of the answer, as JSON; none for answers that are older than these receipts.
    pub receipt: Option<String>,
}

/// Stored facts that decide whether an answer may be stored.
#[derive(Debug, Clone)]
pub struct AnswerFacts {
    /// The instance.
    pub instance: InstanceRow,
    /// Answer that it already has.
    pub before: Option<StoredAnswer>,
    /// Entry of the instance.
    pub entry: EntryRow,
    /// Epoch of the entry.
    pub epoch: EpochRow,
    /// Time of the decision, in milliseconds since 1970.
    pub now_ms: i64,
}

/// Decision on an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AnswerDecision {
    /// The answer is stored. An earlier one with the same log, whose grading failed, no longer counts.
    Store {
        /// Earlier answer that no longer counts.
        supersedes: Option<StoredAnswer>,
    },
    /// The instance was already answered with the same log; nothing changes.
    Repeat,
    /// The answer is not stored, for this reason.
    Refuse(AnswerRefusal),
}

/// Decides on an answer from stored facts; the use cases own the rule.
pub type DecideAnswer = fn(&NewAnswer<'_>, &AnswerFacts) -> AnswerDecision;

impl Store {
    /// Stores the answer to an instance, if `decide` allows it, and if `accept` allows its submission.
    ///
    /// # Errors
    /// Returns an error if the database fails; then nothing is stored.
    pub async fn answer_instance(
        &self,
        new: &NewAnswer<'_>,
        decide: DecideAnswer,
        accept: Decide,
        now_ms: i64,
    ) -> StoreResult<Answered> {
        let NewAnswer { instance_id, submission, transcript_hash } = *new;
        let kept = self.keep_logs([submission.clone()].into()).await?;
        let mut tx = self.begin().await?;
        let epoch_id = instance_in(&mut tx, instance_id).await?.epoch_id;
        tx.lock([Lock::Epoch(&epoch_id), Lock::Owner(submission.owner.as_deref().unwrap_or_default())]).await?;
        let facts = facts_of(&mut tx, instance_id, now_ms).await?;
        let now_ms = not_before(&mut tx, StepsOf::Instance(instance_id), now_ms).await?;
        let before = match decide(new, &facts) {
            AnswerDecision::Store { supersedes } => supersedes,
            AnswerDecision::Repeat => return Ok(Answered::Same(facts.before.and_then(|before| before.receipt))),
            AnswerDecision::Refuse(refusal) => return Ok(Answered::Refused(refusal)),
        };
        let earlier = before.as_ref().map(|before| before.submission_id.as_str());
        if let Some(id) = earlier {
            supersede(&mut tx, id, &submission.id).await?;
        }
        // An answer that is graded again is charged already; charging it no further does not reveal that grading
        // failed.
        let submissions = std::slice::from_ref(submission);
        let mut accept_facts = Facts::read(&mut tx, submissions.iter()).await?.about(submissions);
        if earlier.is_some() {
            for facts in &mut accept_facts {
                facts.quota_left = None;
            }
        }
        match accept(submissions, accept_facts).pop() {
            Some(Decision::Answer(Accepted::QuotaUsedUp)) => {
                return Ok(Answered::Refused(AnswerRefusal::QuotaUsedUp));
            }
            Some(Decision::Store { supersedes }) => {
                store_all(&mut tx, &[ToStore { new: &kept[0], supersedes, takes_over: earlier }], now_ms).await?;
            }
            other => return Err(StoreError::corrupt("submissions", format!("{other:?} on an answer without a run"))),
        }
        query("UPDATE submissions SET instance_id = $2 WHERE id = $1")
            .bind(&submission.id)
            .bind(instance_id)
            .execute(&mut tx)
            .await?;
        // An answer that is graded again after a failure of ours looks like any repeated answer.
        if let Some(before) = before {
            tx.notify(Notice::Queued).await?;
            commit(tx, "answer_instance").await?;
            self.queued.notify_waiters();
            return Ok(Answered::Same(before.receipt));
        }
        let answer = AnswerFact {
            instance: instance_id.to_owned(),
            entry: facts.entry.id,
            log_sha256: submission.log_hash.clone(),
            transcript_sha256: transcript_hash.map(str::to_owned),
            answered_at_ms: now_ms,
        };
        let receipt = witness(&mut tx, &*self.signer()?, facts.epoch.id(), &Fact::Answer(answer)).await?;
        let receipt = serde_json::to_string(&receipt).map_err(|error| StoreError::corrupt("instances", error))?;
        query("UPDATE instances SET transcript_hash = $2, receipt = $3 WHERE id = $1")
            .bind(instance_id)
            .bind(transcript_hash)
            .bind(&receipt)
            .execute(&mut tx)
            .await?;
        tx.notify(Notice::Queued).await?;
        commit(tx, "answer_instance").await?;
        self.queued.notify_waiters();
        Ok(Answered::New(receipt))
    }
}

/// Reads the facts that decide whether an answer may be stored.
async fn facts_of(tx: &mut Tx, instance_id: &str, now_ms: i64) -> StoreResult<AnswerFacts> {
    let instance = instance_in(tx, instance_id).await?;
    let found: Option<(String, String, SubmissionState, Option<String>)> = query_as(
        "SELECT s.id, s.log_hash, s.state, i.receipt FROM submissions s JOIN instances i ON i.id = s.instance_id
         WHERE s.instance_id = $1 AND s.superseded = FALSE",
    )
    .bind(instance_id)
    .fetch_optional(&mut *tx)
    .await?;
    let before =
        found.map(|(submission_id, log_hash, state, receipt)| StoredAnswer { submission_id, log_hash, state, receipt });
    let entry = entry_in(tx, &instance.entry_id).await?.ok_or_else(|| StoreError::corrupt("entries", "gone"))?;
    let epoch = epoch_in(tx, &instance.epoch_id).await?.ok_or_else(|| StoreError::corrupt("epochs", "gone"))?;
    Ok(AnswerFacts { instance, before, entry, epoch, now_ms })
}
