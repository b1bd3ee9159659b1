//! Steps of workers: claims, renewals, reports, failures.

use std::time::Duration;

use plumbline::store::claims::Claimed;
use plumbline::store::db::query_scalar;
use plumbline::store::jobs::Claim;
use plumbline::store::queue::Lane;
use plumbline::store::reports::PackedReport;
use plumbline::store::states::SubmissionState;
use plumbline_engine::grading::ProblemScores;

use super::Scene;
use super::model::{Lease, Submission};
use crate::support::database::is_postgres;

/// A lease that does not end during the test, and one that ends at once.
const LONG_MS: i64 = 3_600_000;
const SHORT_MS: i64 = 1;
/// Greatest number of jobs that are claimed at once.
const MAX: usize = 4;

impl Scene {
    /// Claims jobs, for long or as a worker that dies at once.
    pub(super) async fn claim_from(&mut self, lanes: &[Lane]) {
        let dies = self.below(4) == 0;
        let mut lease = if dies { SHORT_MS } else { LONG_MS };
        let mut found = self.claim_for(lanes, lease).await;
        let claimable = self.model.claimable(lanes);
        if is_postgres() && matches!(found, Claimed::Nothing) && !claimable.is_empty() {
            // Jobs that were left behind are looked for only from time to time, by the length of the lease.
            lease = SHORT_MS;
            found = self.claim_for(lanes, lease).await;
        }
        let held = if lease == SHORT_MS { Lease::Short } else { Lease::Long };
        match found {
            Claimed::Nothing => assert!(claimable.is_empty(), "these jobs are not found: {claimable:?}"),
            Claimed::GivenUp => {
                let mut given_up = Vec::new();
                for id in claimable {
                    if self.state_of(&id).await == SubmissionState::GraderError {
                        given_up.push(id);
                    }
                }
                assert_eq!(given_up.len(), 1, "one submission is given up at a time");
                self.model.give_up(&given_up[0]);
            }
            Claimed::Jobs(claims) => {
                let taken: Vec<(&str, i64)> =
                    claims.iter().map(|claim| (claim.submission_id.as_str(), claim.attempt)).collect();
                self.model.claim(lanes, &taken, held, MAX, !is_postgres() || held == Lease::Short);
                self.claims.extend(claims);
            }
        }
        if held == Lease::Short {
            tokio::time::sleep(Duration::from_millis(3)).await;
        }
    }

    async fn claim_for(&self, lanes: &[Lane], lease_ms: i64) -> Claimed {
        if is_postgres() && lease_ms == SHORT_MS {
            // A look at all jobs is due once the length of the lease has passed since the last one.
            tokio::time::sleep(Duration::from_millis(3)).await;
        }
        self.store.claim(lanes, lease_ms, MAX).await.unwrap()
    }

    pub(super) async fn state_of(&self, id: &str) -> SubmissionState {
        if self.model.submissions.get(id).is_some_and(|own| own.instance.is_some()) {
            // The store tells nobody how the grading of a hidden instance goes.
            assert!(self.store.submission(id).await.unwrap().is_none());
            let state = query_scalar("SELECT state FROM submissions WHERE id = $1").bind(id);
            return state.fetch_one(&self.behind).await.unwrap();
        }
        self.store.submission(id).await.unwrap().unwrap().state
    }

    /// Takes a claim out of those that workers hold, or believe to hold.
    fn some_claim(&mut self) -> Option<Claim> {
        let count = self.claims.len();
        (count > 0).then(|| self.claims.swap_remove(self.random.next_u64() as usize % count))
    }

    pub(super) async fn renew(&mut self) {
        let Some(claim) = self.some_claim() else { return };
        let (lease, ms) = if self.below(3) == 0 { (Lease::Short, SHORT_MS) } else { (Lease::Long, LONG_MS) };
        let expected = self.model.renew(&claim.submission_id, claim.attempt, lease);
        assert_eq!(self.store.renew(&claim, ms).await.unwrap(), expected);
        self.claims.push(claim);
        tokio::time::sleep(Duration::from_millis(3)).await;
    }

    pub(super) async fn record(&mut self) {
        let (mut graded, mut variants) = (Vec::new(), Vec::new());
        for _ in 0..=self.below(MAX) {
            let Some(claim) = self.some_claim() else { break };
            // A worker does not bring a submission twice at once.
            if graded.iter().any(|(other, _): &(Claim, _)| other.submission_id == claim.submission_id) {
                self.claims.push(claim);
                break;
            }
            let variant = self.below(2);
            variants.push(variant);
            let report = self.report_on(&claim, variant);
            graded.push((claim, report));
        }
        if graded.is_empty() {
            return;
        }
        let brought = graded.iter().zip(variants);
        let brought = brought.map(|((claim, _), variant)| (claim.submission_id.as_str(), claim.attempt, variant));
        let expected = self.model.record(brought);
        assert_eq!(self.store.record(&mut graded, self.now_ms).await.unwrap(), expected);
    }

    pub(super) fn report(&self, task: u32, variant: usize) -> PackedReport {
        self.reports[task as usize - 1][variant].clone()
    }

    /// A report on a job; on hidden instances it is that of the first task.
    fn report_on(&self, claim: &Claim, variant: usize) -> PackedReport {
        self.report(if claim.hidden.is_some() { 1 } else { claim.task_number }, variant)
    }

    /// Which of a task's two reports has these scores.
    pub(super) fn variant_of(&self, task: u32, scores: &ProblemScores) -> usize {
        let of_task = &self.scores[task as usize - 1];
        of_task.iter().position(|own| own == scores).expect("scores of one of the two reports")
    }

    /// Compares the report in force, and the number of all, with what the model says of a submission.
    pub(super) async fn compare_reports(&self, id: &str, expected: &Submission) {
        let count = query_scalar("SELECT COUNT(*) FROM reports WHERE submission_id = $1").bind(id);
        let count: i64 = count.fetch_one(&self.behind).await.unwrap();
        assert_eq!(count, expected.reports, "{id}: {expected:?}");
        let report = self.store.report(id, None).await.unwrap();
        let variant = report.map(|row| self.variant_of(expected.task, &row.report.scores()));
        // The store shows nobody a report on a hidden instance.
        assert_eq!(variant, expected.variant.filter(|_| expected.instance.is_none()), "{id}: {expected:?}");
    }

    pub(super) async fn give_back(&mut self) {
        let Some(claim) = self.some_claim() else { return };
        let counts = self.below(2) == 0;
        self.store.give_back(&claim, counts).await.unwrap();
        self.model.give_back(&claim.submission_id, claim.attempt, counts);
    }

    pub(super) async fn fail(&mut self) {
        let Some(claim) = self.some_claim() else { return };
        let may_be_rejected = claim.hidden.is_none() && self.below(2) == 0;
        let state = if may_be_rejected { SubmissionState::Rejected } else { SubmissionState::GraderError };
        self.store.fail(&claim, state, "it failed", self.now_ms).await.unwrap();
        self.model.fail(&claim.submission_id, claim.attempt, state);
    }

    /// Grades everything that still waits.
    pub(super) async fn drain(&mut self, lanes: &[Lane]) {
        loop {
            tokio::time::sleep(Duration::from_millis(3)).await;
            match self.store.claim(lanes, SHORT_MS, MAX).await.unwrap() {
                Claimed::Nothing => break,
                Claimed::GivenUp => {}
                Claimed::Jobs(claims) => {
                    let graded = claims.into_iter().map(|claim| (self.report_on(&claim, 0), claim));
                    let mut graded: Vec<_> = graded.map(|(report, claim)| (claim, report)).collect();
                    self.store.record(&mut graded, self.now_ms).await.unwrap();
                }
            }
        }
    }
}
