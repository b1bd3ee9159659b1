//! The rule that decides whether an instance accepts an answer.

use crate::store::hidden_answers::{AnswerDecision, AnswerFacts, AnswerRefusal, NewAnswer};
use crate::store::states::SubmissionState;

/// Decides on an answer. An instance takes one log, once: the same log again counts as the same answer, and is graded
/// again if its grading failed on our side.
#[must_use]
pub fn decide_answer(new: &NewAnswer<'_>, facts: &AnswerFacts) -> AnswerDecision {
    let AnswerFacts { instance, before, entry, epoch, now_ms } = facts;
    if let Some(before) = before {
        if before.log_hash != new.submission.log_hash {
            return AnswerDecision::Refuse(AnswerRefusal::OtherLog);
        }
        if new.transcript_hash.is_some() && new.transcript_hash != instance.transcript_hash.as_deref() {
            return AnswerDecision::Refuse(AnswerRefusal::OtherTranscript(instance.transcript_hash.clone()));
        }
        if before.state != SubmissionState::GraderError {
            return AnswerDecision::Repeat;
        }
    }
    // A complete entry may have been revealed, so it must not change.
    if entry.completed_at_ms.is_some() {
        return AnswerDecision::Refuse(AnswerRefusal::Closed);
    }
    if before.is_none() {
        if entry.finalized_at_ms.is_some() || epoch.is_over(*now_ms) {
            return AnswerDecision::Refuse(AnswerRefusal::Closed);
        }
        if *now_ms >= instance.expires_at_ms {
            return AnswerDecision::Refuse(AnswerRefusal::Expired);
        }
    }
    AnswerDecision::Store { supersedes: before.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::{CLOSES_AT_MS, OPENS_AT_MS, entry, epoch};
    use crate::store::epochs::HIDDEN_SUITE;
    use crate::store::hidden_answers::StoredAnswer;
    use crate::store::instances::InstanceRow;
    use crate::store::queue::Lane;
    use crate::store::submissions::{NewSubmission, PackedLog};
    use SubmissionState::{Graded, GraderError, Queued};
    use plumbline_engine::hidden::feedback::Tier;
    use plumbline_engine::voxel::Profile;

    const EXPIRES_AT_MS: i64 = OPENS_AT_MS + 10;

    fn instance() -> InstanceRow {
        InstanceRow {
            id: "instance".to_owned(),
            entry_id: "own".to_owned(),
            epoch_id: "epoch".to_owned(),
            ordinal: 1,
            run: 1,
            family: "slabs".to_owned(),
            family_index: 0,
            nonce: "nonce".to_owned(),
            leaf: 0,
            task_hash: String::new(),
            issued_at_ms: OPENS_AT_MS,
            expires_at_ms: EXPIRES_AT_MS,
            transcript_hash: Some("promised".to_owned()),
            transcript_checked_ms: None,
            submission_id: None,
            log_hash: None,
        }
    }

    fn submission() -> NewSubmission {
        NewSubmission {
            id: "new".to_owned(),
            run_id: None,
            suite_id: HIDDEN_SUITE.to_owned(),
            task_hash: String::new(),
            task_number: 1,
            log_hash: "log".to_owned(),
            log: PackedLog::of(b"{}").unwrap(),
            turns: 1,
            events: 0,
            owner: Some("a".to_owned()),
            lane: Lane::Hidden,
            replays: None,
            profile: Profile::Published,
        }
    }

    fn before(log_hash: &str, state: SubmissionState) -> StoredAnswer {
        let receipt = Some("receipt".to_owned());
        StoredAnswer { submission_id: "before".to_owned(), log_hash: log_hash.to_owned(), state, receipt }
    }

    fn facts(before: Option<StoredAnswer>) -> AnswerFacts {
        let (entry, epoch) = (entry("own", "a", Tier::Dev), epoch());
        AnswerFacts { instance: instance(), before, entry, epoch, now_ms: OPENS_AT_MS }
    }

    fn decide(transcript_hash: Option<&str>, facts: &AnswerFacts) -> AnswerDecision {
        decide_answer(&NewAnswer { instance_id: "instance", submission: &submission(), transcript_hash }, facts)
    }

    #[test]
    fn an_instance_takes_one_log_and_keeps_its_promise() {
        let failed = before("log", GraderError);
        for (earlier, transcript_hash, expected) in [
            (None, None, AnswerDecision::Store { supersedes: None }),
            (None, Some("any"), AnswerDecision::Store { supersedes: None }),
            (Some(before("log", Queued)), None, AnswerDecision::Repeat),
            (Some(before("log", Graded)), Some("promised"), AnswerDecision::Repeat),
            (
                Some(before("log", Graded)),
                Some("another"),
                AnswerDecision::Refuse(AnswerRefusal::OtherTranscript(Some("promised".to_owned()))),
            ),
            (Some(before("another", Graded)), None, AnswerDecision::Refuse(AnswerRefusal::OtherLog)),
            // An answer whose grading failed on our side is graded again, and only that log.
            (Some(failed.clone()), None, AnswerDecision::Store { supersedes: Some(failed) }),
            (Some(before("another", GraderError)), None, AnswerDecision::Refuse(AnswerRefusal::OtherLog)),
        ] {
            let facts = facts(earlier);
            assert_eq!(decide(transcript_hash, &facts), expected, "{:?} {transcript_hash:?}", facts.before);
        }
    }

    #[test]
    fn a_first_answer_comes_in_time_and_a_repetition_before_the_entry_is_complete() {
        use AnswerRefusal::{Closed, Expired};
        for (has_failed, is_finalized, is_completed, now_ms, refused) in [
            (false, false, false, EXPIRES_AT_MS - 1, None),
            (false, false, false, EXPIRES_AT_MS, Some(Expired)),
            (false, false, false, CLOSES_AT_MS, Some(Closed)),
            (false, true, false, OPENS_AT_MS, Some(Closed)),
            (true, true, false, CLOSES_AT_MS, None),
            (true, true, true, CLOSES_AT_MS, Some(Closed)),
        ] {
            let mut facts = AnswerFacts { now_ms, ..facts(has_failed.then(|| before("log", GraderError))) };
            facts.entry.finalized_at_ms = is_finalized.then_some(OPENS_AT_MS);
            facts.entry.completed_at_ms = is_completed.then_some(OPENS_AT_MS);
            let expected = match refused {
                Some(refused) => AnswerDecision::Refuse(refused),
                None => AnswerDecision::Store { supersedes: facts.before.clone() },
            };
            assert_eq!(decide(None, &facts), expected, "{has_failed} {is_finalized} {is_completed} {now_ms}");
        }
    }
}
