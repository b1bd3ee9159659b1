//! The model: maps, and rules written as plainly as possible.

use std::collections::BTreeMap;

use plumbline::store::acceptance::Accepted;
use plumbline::store::queue::Lane;
use plumbline::store::run_rows::Skip;
use plumbline::store::runs::RunChanged;
use plumbline::store::states::{RunState, SubmissionState};
use plumbline::store::submissions::NewSubmission;

use super::hidden_model::Hidden;
use super::quota_model::Quota;
use super::regrades::Regrade;

/// Owners of runs and submissions; some belong to nobody.
pub const OWNERS: [Option<&str>; 4] = [None, Some("ada"), Some("bea"), Some("cem")];
/// Greatest number of attempts at a job.
const ATTEMPTS: i64 = 3;

/// Who holds a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lease {
    /// Nobody.
    Free,
    /// A worker that died.
    Short,
    /// A worker.
    Long,
}

#[derive(Debug, Clone)]
pub struct Submission {
    pub run: Option<String>,
    pub task: u32,
    pub owner: Option<String>,
    pub log: String,
    pub lane: Lane,
    pub state: SubmissionState,
    pub superseded: bool,
    pub attempt: i64,
    pub lease: Lease,
    /// Instance of a hidden specification that it answers.
    pub instance: Option<String>,
    /// Which of two reports is in force, and how many there are.
    pub variant: Option<usize>,
    pub reports: i64,
}

impl Submission {
    fn has_job(&self) -> bool {
        matches!(self.state, SubmissionState::Queued | SubmissionState::Grading)
    }
}

#[derive(Debug, Clone)]
pub struct Run {
    pub owner: Option<&'static str>,
    pub state: RunState,
}

pub struct Model {
    tasks: usize,
    pub runs: BTreeMap<String, Run>,
    pub submissions: BTreeMap<String, Submission>,
    pub quotas: BTreeMap<String, Quota>,
    pub regrades: BTreeMap<String, Regrade>,
    pub hidden: Hidden,
}

impl Model {
    pub fn new(tasks: usize) -> Self {
        let (runs, submissions, quotas) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Self { tasks, runs, submissions, quotas, regrades: BTreeMap::new(), hidden: Hidden::default() }
    }

    pub fn create_run(&mut self, id: String, owner: Option<&'static str>) {
        self.runs.insert(id, Run { owner, state: RunState::Open });
    }

    pub fn some_run(&self, number: u64) -> Option<String> {
        some(self.runs.keys(), number)
    }

    pub fn some_submission(&self, number: u64) -> Option<String> {
        some(self.submissions.keys(), number)
    }

    /// The submission of a run that counts for a task.
    fn answer(&self, run: &str, task: u32) -> Option<String> {
        let counts = |one: &Submission| one.run.as_deref() == Some(run) && one.task == task && !one.superseded;
        self.submissions.iter().find(|(_, one)| counts(one)).map(|(id, _)| id.clone())
    }

    /// Stores all submissions of a body, or none.
    pub fn accept(&mut self, new: &[NewSubmission]) -> Vec<Accepted> {
        let (submissions, quotas) = (self.submissions.clone(), self.quotas.clone());
        let answers: Vec<Accepted> = new.iter().map(|new| self.accept_one(new)).collect();
        if !answers.iter().all(|answer| matches!(answer, Accepted::New | Accepted::Same(_))) {
            (self.submissions, self.quotas) = (submissions, quotas);
        }
        answers
    }

    fn accept_one(&mut self, new: &NewSubmission) -> Accepted {
        use SubmissionState::{Cancelled, GraderError};
        let mut replaced = None;
        if let Some(run) = &new.run_id {
            let state = self.runs[run].state;
            match self.answer(run, new.task_number) {
                None if state != RunState::Open => return Accepted::RunClosed,
                None => {}
                Some(_) if state == RunState::Deleted => return Accepted::RunClosed,
                Some(id) if matches!(self.submissions[&id].state, GraderError | Cancelled) => {
                    if state == RunState::Finished {
                        return Accepted::RunClosed;
                    }
                    replaced = Some(id);
                }
                Some(id) if self.submissions[&id].log == new.log_hash => return Accepted::Same(id),
                Some(id) => return Accepted::Other(id),
            }
        }
        if !self.reserve(new.owner.as_deref()) {
            return Accepted::QuotaUsedUp;
        }
        if let Some(id) = replaced {
            self.at(&id).superseded = true;
        }
        self.put(new, None);
        Accepted::New
    }

    /// Stores a submission, which waits from now on.
    pub fn put(&mut self, new: &NewSubmission, instance: Option<String>) {
        let submission = Submission {
            run: new.run_id.clone(),
            task: new.task_number,
            owner: new.owner.clone(),
            log: new.log_hash.clone(),
            lane: new.lane,
            state: SubmissionState::Queued,
            superseded: false,
            attempt: 0,
            lease: Lease::Free,
            instance,
            variant: None,
            reports: 0,
        };
        self.submissions.insert(new.id.clone(), submission);
    }

    pub fn at(&mut self, id: &str) -> &mut Submission {
        self.submissions.get_mut(id).expect("the submission is known")
    }

    /// The jobs that a worker of these lanes may take.
    pub fn claimable(&self, lanes: &[Lane]) -> Vec<String> {
        let is_free = |one: &Submission| one.has_job() && one.lease != Lease::Long && lanes.contains(&one.lane);
        self.submissions.iter().filter(|(_, one)| is_free(one)).map(|(id, _)| id.clone()).collect()
    }

    /// Takes jobs that the store gave out, with their attempts, after it is sure that it might. If the store looked only
    /// for jobs of the current rounds, it may have passed over others.
    pub fn claim(&mut self, lanes: &[Lane], taken: &[(&str, i64)], lease: Lease, most: usize, is_thorough: bool) {
        let claimable = self.claimable(lanes);
        let quick = claimable.iter().filter(|id| self.submissions[*id].lane == Lane::Quick);
        let (quick, new) = (quick.clone().count(), quick.filter(|id| self.submissions[*id].attempt == 0).count());
        let (first, attempt) = taken[0];
        let is_quick = self.submissions[first].lane == Lane::Quick;
        assert!(is_quick == (quick > 0) || !is_thorough, "quick jobs come first");
        let expected = if is_quick && attempt == 1 { most.min(new) } else { 1 };
        assert!(taken.len() == expected || (taken.len() < expected && !is_thorough), "{taken:?}, not {expected}");
        for (i, (id, attempt)) in taken.iter().enumerate() {
            assert!(claimable.iter().any(|one| one == id) && taken[..i].iter().all(|(other, _)| other != id), "{id}");
            let one = self.at(id);
            one.attempt += 1;
            assert_eq!((one.attempt, one.lane == Lane::Quick), (*attempt, is_quick), "{id}");
            assert!(*attempt <= ATTEMPTS, "{id} was begun {attempt} times");
            (one.state, one.lease) = (SubmissionState::Grading, lease);
        }
    }

    /// Ends a submission whose job had no attempts left.
    pub fn give_up(&mut self, id: &str) {
        assert_eq!(self.submissions[id].attempt, ATTEMPTS);
        self.end(id, SubmissionState::GraderError);
    }

    fn holds(&self, id: &str, attempt: i64) -> bool {
        self.submissions.get(id).is_some_and(|one| one.has_job() && one.attempt == attempt)
    }

    pub fn renew(&mut self, id: &str, attempt: i64, lease: Lease) -> bool {
        let holds = self.holds(id, attempt);
        if holds {
            self.at(id).lease = lease;
        }
        holds
    }

    /// Grades what is still held, and returns how many that are.
    pub fn record<'a>(&mut self, brought: impl Iterator<Item = (&'a str, i64, usize)>) -> usize {
        let held: Vec<(&str, i64, usize)> = brought.filter(|(id, attempt, _)| self.holds(id, *attempt)).collect();
        for (id, _, variant) in &held {
            let one = self.at(id);
            (one.state, one.variant, one.reports) = (SubmissionState::Graded, Some(*variant), 1);
            if one.instance.is_none() {
                let owner = one.owner.clone();
                self.settle_unit(owner.as_deref(), true);
            }
        }
        for (id, ..) in &held {
            self.end_run_of(id);
        }
        held.len()
    }

    pub fn give_back(&mut self, id: &str, attempt: i64, counts: bool) {
        if self.holds(id, attempt) {
            let one = self.at(id);
            (one.state, one.lease) = (SubmissionState::Queued, Lease::Free);
            one.attempt -= i64::from(!counts);
        }
    }

    pub fn fail(&mut self, id: &str, attempt: i64, state: SubmissionState) {
        if self.holds(id, attempt) {
            self.end(id, state);
        }
    }

    pub fn cancel(&mut self, id: &str) -> bool {
        let can_end = self.submissions[id].has_job() && self.submissions[id].instance.is_none();
        if can_end {
            self.end(id, SubmissionState::Cancelled);
        }
        can_end
    }

    /// Ends a submission without a grade.
    fn end(&mut self, id: &str, state: SubmissionState) {
        self.at(id).state = state;
        // The quota of answers to hidden instances is settled when their entry is completed.
        if self.submissions[id].instance.is_none() {
            let owner = self.submissions[id].owner.clone();
            self.settle_unit(owner.as_deref(), false);
        }
        self.end_run_of(id);
    }

    fn end_run_of(&mut self, id: &str) {
        if let Some(run) = self.submissions[id].run.clone() {
            self.end_if_complete(&run);
        }
    }

    /// Ends a run whose tasks are all graded, or that was finished, unless something waits or failed.
    fn end_if_complete(&mut self, id: &str) {
        let (pending, graded, errors) = self.counts(id);
        let tasks = self.tasks as i64;
        let run = self.runs.get_mut(id).expect("the run is known");
        let may_end = run.state == RunState::Finishing || (run.state == RunState::Open && graded >= tasks);
        if may_end && pending == 0 && errors == 0 {
            run.state = RunState::Finished;
        }
    }

    /// The submissions of a run that wait, are graded, and failed because of us and still count.
    pub fn counts(&self, id: &str) -> (i64, i64, i64) {
        let own = || self.submissions.values().filter(|one| one.run.as_deref() == Some(id));
        let is_error = |one: &&Submission| one.state == SubmissionState::GraderError && !one.superseded;
        let is_graded = |one: &&Submission| one.state == SubmissionState::Graded;
        (
            own().filter(|one| one.has_job()).count() as i64,
            own().filter(is_graded).count() as i64,
            own().filter(is_error).count() as i64,
        )
    }

    pub fn finish(&mut self, id: &str, skip: Option<&Skip>) -> RunChanged {
        use SubmissionState::{Graded, Grading, Queued};
        let state = self.runs[id].state;
        let state_of = |model: &Self, task: u32| model.answer(id, task).map(|id| model.submissions[&id].state);
        let has_failed = |model: &Self, task: u32| state_of(model, task) == Some(SubmissionState::GraderError);
        let may_skip = match (state, skip) {
            (RunState::Open, _) | (_, None) => true,
            (RunState::Finishing, Some(Skip::Tasks(tasks))) => tasks.iter().all(|task| has_failed(self, *task)),
            _ => false,
        };
        if state == RunState::Deleted || !may_skip {
            return RunChanged::NotOpen(state);
        }
        let is_answered = |model: &Self, task: u32| matches!(state_of(model, task), Some(Queued | Grading | Graded));
        let skipped: Vec<u32> = match skip {
            None => Vec::new(),
            Some(Skip::Tasks(tasks)) => tasks.clone(),
            Some(Skip::Unanswered) => {
                (1..=self.tasks as u32).filter(|task| !is_answered(self, *task) && !has_failed(self, *task)).collect()
            }
        };
        let answered: Vec<u32> = skipped.iter().copied().filter(|task| is_answered(self, *task)).collect();
        if !answered.is_empty() {
            return RunChanged::Answered(answered);
        }
        for task in skipped {
            let failed = self.answer(id, task).filter(|id| self.submissions[id].state == SubmissionState::GraderError);
            if let Some(failed) = failed {
                self.at(&failed).superseded = true;
            }
        }
        if state == RunState::Open {
            self.runs.get_mut(id).expect("the run is known").state = RunState::Finishing;
        }
        if state == RunState::Open || skip.is_some() {
            self.end_if_complete(id);
        }
        RunChanged::Done
    }

    pub fn delete(&mut self, id: &str) -> RunChanged {
        let state = self.runs[id].state;
        if state != RunState::Open {
            return RunChanged::NotOpen(state);
        }
        self.runs.get_mut(id).expect("the run is known").state = RunState::Deleted;
        let waits = |one: &Submission| one.run.as_deref() == Some(id) && one.has_job();
        let waiting: Vec<String> =
            self.submissions.iter().filter(|(_, one)| waits(one)).map(|(id, _)| id.clone()).collect();
        for id in waiting {
            self.end(&id, SubmissionState::Cancelled);
        }
        RunChanged::Done
    }

    /// Counts the answers of a run that solve their task, counted in its result once it has finished.
    pub fn solved(&self, run: &str) -> u64 {
        let is_solved =
            |one: &&Submission| one.run.as_deref() == Some(run) && !one.superseded && one.variant == Some(0);
        self.submissions.values().filter(is_solved).count() as u64
    }

    /// The report on the answer to an instance, if it is graded.
    pub fn graded_answer(&self, instance: &str) -> Option<usize> {
        self.submissions.values().find(|one| one.instance.as_deref() == Some(instance) && !one.superseded)?.variant
    }

    /// Forgets answers to hidden instances, whose epoch is settled.
    pub fn forget_instances(&mut self) {
        self.submissions.retain(|_, one| one.instance.is_none());
    }

    /// Forgets submissions without a run that have ended, and all but a few runs that have, unless a regrade may still
    /// change them.
    pub fn forget(&mut self) {
        let Self { submissions, regrades, .. } = self;
        let is_concerned = |id: &str| regrades.values().any(|regrade| regrade.concerns(id));
        submissions.retain(|id, one| one.run.is_some() || one.instance.is_some() || one.has_job() || is_concerned(id));
        let is_free =
            |run: &str| !submissions.iter().any(|(id, one)| one.run.as_deref() == Some(run) && is_concerned(id));
        let is_over = |run: &Run| matches!(run.state, RunState::Finished | RunState::Deleted);
        let over = self.runs.iter().filter(|(id, run)| is_over(run) && is_free(id));
        let over: Vec<String> = over.map(|(id, _)| id.clone()).skip(2).collect();
        for id in over {
            self.runs.remove(&id);
            self.submissions.retain(|_, one| one.run.as_ref() != Some(&id));
        }
    }
}

/// Chooses one by a random number.
pub fn some<'a>(all: impl ExactSizeIterator<Item = &'a String>, number: u64) -> Option<String> {
    let count = all.len() as u64;
    let mut all = all;
    (count > 0).then(|| all.nth((number % count) as usize)).flatten().cloned()
}
