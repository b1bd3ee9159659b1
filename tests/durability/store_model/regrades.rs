//! Steps of regrades: begun, filled, kept or not, applied or discarded.

use std::collections::BTreeMap;

use plumbline::store::states::{RunState, SubmissionState};

use super::Scene;
use super::model::{Model, some};

/// Greatest number of submissions that are graded again at a time.
const AT_ONCE: usize = 6;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    Computing,
    Ready,
    Applied,
    Discarded,
}

#[derive(Debug)]
pub struct Regrade {
    state: State,
    /// The report of each submission that was graded again.
    graded: BTreeMap<String, usize>,
}

impl Regrade {
    /// Whether it may still change what is stored about a submission.
    pub fn concerns(&self, id: &str) -> bool {
        self.graded.contains_key(id) && matches!(self.state, State::Computing | State::Ready)
    }
}

impl Model {
    /// Puts the reports of a regrade in force, and returns the number of finished runs that change.
    fn apply(&mut self, id: &str) -> usize {
        let regrade = self.regrades.get_mut(id).expect("the regrade is known");
        regrade.state = State::Applied;
        let mut changed = std::collections::BTreeSet::new();
        for (id, variant) in std::mem::take(&mut regrade.graded) {
            let one = self.submissions.get_mut(&id).expect("what a regrade concerns is not forgotten");
            if one.variant == Some(variant) {
                continue;
            }
            (one.variant, one.reports) = (Some(variant), one.reports + 1);
            let run = one.run.clone().filter(|run| !one.superseded && self.runs[run].state == RunState::Finished);
            changed.extend(run);
        }
        changed.len()
    }
}

impl Scene {
    /// Does one thing with a regrade.
    pub(super) async fn regrade_step(&mut self) {
        let number = self.random.next_u64();
        match (some(self.model.regrades.keys(), number), self.below(10)) {
            (Some(id), 1..6) => self.grade_again(&id).await,
            (Some(id), 6) => self.end_computing(&id, true).await,
            (Some(id), 7) => self.end_computing(&id, false).await,
            (Some(id), 8..) => self.apply(&id).await,
            _ => self.begin_regrade().await,
        }
    }

    async fn begin_regrade(&mut self) {
        let id = uuid::Uuid::now_v7().to_string();
        self.store.begin_regrade(&id, &self.suite.id(), "for the test", "ada", self.now_ms).await.unwrap();
        if self.model.regrades.len() > 4 {
            self.model.regrades.pop_first();
        }
        self.model.regrades.insert(id, Regrade { state: State::Computing, graded: BTreeMap::new() });
    }

    async fn grade_again(&mut self, id: &str) {
        let is_graded = |own: &super::model::Submission| own.state == SubmissionState::Graded && own.instance.is_none();
        let known: Vec<(String, u32)> = self
            .model
            .submissions
            .iter()
            .filter(|(_, own)| is_graded(own))
            .map(|(id, own)| (id.clone(), own.task))
            .collect();
        let mut graded = BTreeMap::new();
        for _ in 0..self.below(AT_ONCE) {
            let number = self.below(known.len().max(1));
            let Some((submission, task)) = known.get(number) else { break };
            if !self.model.regrades[id].graded.contains_key(submission) {
                graded.insert(submission.clone(), (*task, self.below(2)));
            }
        }
        if graded.is_empty() {
            return;
        }
        let regrade = self.model.regrades.get_mut(id).expect("the regrade is known");
        let expected = regrade.state == State::Computing;
        if expected {
            regrade.graded.extend(graded.iter().map(|(id, (_, variant))| (id.clone(), *variant)));
        }
        let reports = graded.into_iter().map(|(id, (task, variant))| (id, self.report(task, variant))).collect();
        assert_eq!(self.store.put_regraded(id, reports).await.unwrap(), expected);
    }

    async fn end_computing(&mut self, id: &str, is_kept: bool) {
        let regrade = self.model.regrades.get_mut(id).expect("the regrade is known");
        let expected = match regrade.state {
            State::Computing => true,
            State::Ready => !is_kept,
            _ => false,
        };
        if expected {
            regrade.state = if is_kept { State::Ready } else { State::Discarded };
        }
        let ended = if is_kept { self.store.mark_ready(id).await } else { self.store.discard(id, self.now_ms).await };
        assert_eq!(ended.unwrap(), expected);
    }

    async fn apply(&mut self, id: &str) {
        let expected = (self.model.regrades[id].state == State::Ready).then(|| self.model.apply(id));
        let found = self.store.apply_regrade(id, &self.suite.tasks, self.now_ms).await.unwrap();
        assert_eq!(found, expected);
    }
}
