//! The rules that decide whether a submission is stored, and in which lane it waits. They are the same for posting, for
//! validating and for importing.

use std::collections::HashMap;

use crate::store::acceptance::{AcceptFacts, Accepted, Decision, EarlierAnswer};
use crate::store::queue::Lane;
use crate::store::states::RunState;
use crate::store::states::SubmissionState;
use crate::store::submissions::NewSubmission;
use plumbline_engine::grading::cost::{Cost, cost};
use plumbline_engine::tasks::Task;
use plumbline_engine::voxel::BlockLog;

/// Decides on a submission. A run accepts one answer for each task: the same log again counts as the same submission, a
/// different log is refused, and an answer that ended without a grade may be replaced.
#[must_use]
fn decide(new: &NewSubmission, facts: &AcceptFacts) -> Decision {
    let mut supersedes = None;
    if new.run_id.is_some() {
        match &facts.earlier {
            Some(earlier) if matches!(earlier.state, SubmissionState::GraderError | SubmissionState::Cancelled) => {
                if facts.run.is_none_or(|run| matches!(run, RunState::Finished | RunState::Deleted)) {
                    return Decision::Answer(Accepted::RunClosed);
                }
                supersedes = Some(earlier.clone());
            }
            Some(_) if facts.run == Some(RunState::Deleted) => return Decision::Answer(Accepted::RunClosed),
            Some(earlier) if earlier.log_hash == new.log_hash => {
                return Decision::Answer(Accepted::Same(earlier.id.clone()));
            }
            Some(earlier) => return Decision::Answer(Accepted::Other(earlier.id.clone())),
            None if facts.run != Some(RunState::Open) => return Decision::Answer(Accepted::RunClosed),
            None => {}
        }
    }
    if facts.quota_left.is_some_and(|left| left <= 0) {
        return Decision::Answer(Accepted::QuotaUsedUp);
    }
    Decision::Store { supersedes }
}

/// Decides in which lane the grading of a log waits.
#[must_use]
pub fn lane_of(task: &Task, log: &BlockLog) -> Lane {
    if cost(task, log) == Cost::Immediate { Lane::Quick } else { Lane::Long }
}

/// Decides on all submissions of a body as if each were stored before the next.
#[must_use]
pub fn decide_all(submissions: &[NewSubmission], facts: Vec<AcceptFacts>) -> Vec<Decision> {
    let mut answered: HashMap<(&str, u32), EarlierAnswer> = HashMap::new();
    let mut used: HashMap<Option<&str>, i64> = HashMap::new();
    let mut decisions = Vec::with_capacity(submissions.len());
    for (new, mut facts) in submissions.iter().zip(facts) {
        let task = new.run_id.as_deref().map(|run| (run, new.task_number));
        if let Some(earlier) = task.and_then(|task| answered.get(&task)) {
            facts.earlier = Some(earlier.clone());
        }
        let used = used.entry(new.owner.as_deref()).or_default();
        facts.quota_left = facts.quota_left.map(|left| left - *used);
        let decision = decide(new, &facts);
        if matches!(decision, Decision::Store { .. }) {
            *used += 1;
            let (id, log_hash) = (new.id.clone(), new.log_hash.clone());
            let answer = EarlierAnswer { id, log_hash, state: SubmissionState::Queued };
            answered.extend(task.map(|task| (task, answer)));
        }
        decisions.push(decision);
    }
    decisions
}

/// Returns what the clients are told if every submission to be stored is stored.
#[must_use]
pub fn answers(decisions: Vec<Decision>) -> Vec<Accepted> {
    let answer = |decision| match decision {
        Decision::Answer(answer) => answer,
        Decision::Store { .. } => Accepted::New,
    };
    decisions.into_iter().map(answer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::submissions::PackedLog;
    use plumbline_engine::voxel::Profile;

    fn submission(id: &str, task_number: u32, log_hash: &str) -> NewSubmission {
        NewSubmission {
            id: id.to_owned(),
            run_id: Some("run".to_owned()),
            suite_id: "suite@1".to_owned(),
            task_hash: String::new(),
            task_number,
            log_hash: log_hash.to_owned(),
            log: PackedLog::of(b"{}").unwrap(),
            turns: 1,
            events: 0,
            owner: Some("owner".to_owned()),
            lane: Lane::Quick,
            replays: None,
            profile: Profile::Published,
        }
    }

    fn facts(run: Option<RunState>, earlier: Option<SubmissionState>, quota_left: Option<i64>) -> AcceptFacts {
        let earlier = earlier.map(|state| EarlierAnswer { id: "before".to_owned(), log_hash: "a".to_owned(), state });
        AcceptFacts { run, earlier, quota_left }
    }

    fn answer(log_hash: &str, facts: &AcceptFacts) -> Option<Accepted> {
        match decide(&submission("new", 1, log_hash), facts) {
            Decision::Answer(answer) => Some(answer),
            Decision::Store { .. } => None,
        }
    }

    #[test]
    fn a_task_takes_one_answer_and_an_ungraded_one_may_be_replaced() {
        use RunState::{Deleted, Finished, Finishing, Open};
        use SubmissionState::{Cancelled, Graded, GraderError, Queued};
        let before = || "before".to_owned();
        for (run, earlier, log_hash, expected) in [
            (Some(Open), None, "a", None),
            (Some(Finishing), None, "a", Some(Accepted::RunClosed)),
            (None, None, "a", Some(Accepted::RunClosed)),
            (Some(Open), Some(Queued), "a", Some(Accepted::Same(before()))),
            (Some(Finished), Some(Graded), "a", Some(Accepted::Same(before()))),
            (Some(Deleted), Some(Graded), "a", Some(Accepted::RunClosed)),
            (Some(Open), Some(Graded), "b", Some(Accepted::Other(before()))),
            (Some(Open), Some(GraderError), "b", None),
            (Some(Finishing), Some(Cancelled), "a", None),
            (Some(Finished), Some(Cancelled), "a", Some(Accepted::RunClosed)),
        ] {
            assert_eq!(answer(log_hash, &facts(run, earlier, None)), expected, "{run:?} {earlier:?} {log_hash}");
        }
        assert_eq!(answer("a", &facts(Some(Open), None, Some(1))), None);
        assert_eq!(answer("a", &facts(Some(Open), None, Some(0))), Some(Accepted::QuotaUsedUp));
    }

    #[test]
    fn lines_of_a_body_count_before_the_next() {
        let lines =
            [submission("1", 1, "a"), submission("2", 1, "a"), submission("3", 1, "b"), submission("4", 2, "a")];
        let open = || facts(Some(RunState::Open), None, Some(1));
        let decided = answers(decide_all(&lines, lines.iter().map(|_| open()).collect()));
        let first = || "1".to_owned();
        assert_eq!(decided, [Accepted::New, Accepted::Same(first()), Accepted::Other(first()), Accepted::QuotaUsedUp]);
    }
}
