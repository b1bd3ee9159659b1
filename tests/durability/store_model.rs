//! Random sequences of what is done with the store, against a plain model of it, on both databases.
//!
//! `PLUMBLINE_MODEL_STEPS` sets the number of steps, and `PLUMBLINE_MODEL_SEED` the sequence.

mod hidden;
mod hidden_model;
mod model;
mod quota_model;
mod regrades;
mod workers;

use std::sync::Arc;

use plumbline::app::hidden::completion::settle_epochs;
use plumbline::app::submissions::decision::decide_all;
use plumbline::store::Store;
use plumbline::store::acceptance::Acceptability;
use plumbline::store::db::Pool;
use plumbline::store::jobs::Claim;
use plumbline::store::location::Location;
use plumbline::store::queue::Lane;
use plumbline::store::reports::PackedReport;
use plumbline::store::run_rows::Skip;
use plumbline::store::runs::NewRun;
use plumbline::store::secrets::EpochSecret;
use plumbline::store::states::RunState;
use plumbline::store::submissions::{NewSubmission, PackedLog};
use plumbline_engine::builders::build;
use plumbline_engine::elasticity::Control;
use plumbline_engine::grading::{ProblemScores, Report, grade_hashed};
use plumbline_engine::tasks::{Suite, Task, Track, embedded};
use plumbline_engine::voxel::{BlockLog, Profile, Turn};
use rand_mt::Mt64;

use crate::support::audit::audit;
use crate::support::database::{is_postgres, pool, url};
use model::{Model, OWNERS};

/// Number of steps by default.
const STEPS: usize = 4_000;
/// Number of tasks of the suite: few, so that runs end.
const TASKS: usize = 3;

/// The store and its model, in step.
struct Scene {
    store: Store,
    location: Location,
    /// Connections behind the store's back.
    behind: Pool,
    folder: tempfile::TempDir,
    suite: Suite,
    logs: Vec<PackedLog>,
    /// For each task, a report on a build that solves it, and one on an empty log.
    reports: Vec<[PackedReport; 2]>,
    /// The scores of these reports.
    scores: Vec<[ProblemScores; 2]>,
    /// What all epochs draw from.
    secret: Arc<EpochSecret>,
    model: Model,
    /// Claims that workers hold, or believe to hold.
    claims: Vec<Claim>,
    random: Mt64,
    now_ms: i64,
}

impl Scene {
    async fn new(seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("p.db");
        let location: Location = if is_postgres() { url(&file).parse().unwrap() } else { Location::File(file.clone()) };
        let store = Store::open(&location, Some(folder.path().join("secrets"))).await.unwrap();
        let behind = pool(&file).await;
        // A service makes it when it starts.
        store.secrets().signer().unwrap();
        let mut suite = embedded::suite(2).unwrap();
        suite.tasks.truncate(TASKS);
        store.put_suite(&suite, 0).await.unwrap();
        let built: Vec<BlockLog> = suite.tasks.iter().map(|task| build(task).unwrap()).collect();
        let logs = built.iter().map(|log| PackedLog::of(&log.canonical_json()).unwrap()).collect();
        let graded: Vec<[Report; 2]> = suite.tasks.iter().zip(&built).map(|(task, log)| both(task, log)).collect();
        let scores = graded.iter().map(|reports| reports.each_ref().map(Report::scores)).collect();
        let packed = |reports: &[Report; 2]| reports.each_ref().map(|report| PackedReport::of(report, 1).unwrap());
        let reports = graded.iter().map(packed).collect();
        let (model, claims, random) = (Model::new(TASKS), Vec::new(), Mt64::new(seed));
        let secret = Arc::new(hidden::secret());
        Self {
            store,
            location,
            behind,
            folder,
            suite,
            logs,
            reports,
            scores,
            secret,
            model,
            claims,
            random,
            now_ms: 1_000,
        }
    }

    fn below(&mut self, count: usize) -> usize {
        (self.random.next_u64() % count as u64) as usize
    }

    /// Does one thing, on the store and in the model, and compares what both answer.
    async fn step(&mut self) {
        self.now_ms += 1;
        match self.below(140) {
            100..110 => self.regrade_step().await,
            110.. => self.hidden_step().await,
            0..5 => self.create_run().await,
            5..35 => self.accept().await,
            35..55 => self.claim_from(&[Lane::Quick, Lane::Long]).await,
            55..60 => self.renew().await,
            60..75 => self.record().await,
            75..80 => self.give_back().await,
            80..84 => self.fail().await,
            84..88 => self.cancel().await,
            88..92 => self.change_quota().await,
            92..95 => self.finish().await,
            95..97 => self.delete().await,
            97 => self.reopen().await,
            _ => self.compare().await,
        }
    }

    async fn create_run(&mut self) {
        let (id, owner) = (uuid::Uuid::now_v7().to_string(), OWNERS[self.below(OWNERS.len())]);
        let (suite_id, metadata) = (self.suite.id(), serde_json::json!({}));
        let run = NewRun {
            id: &id,
            agent: "agent",
            suite_id: &suite_id,
            metadata: &metadata,
            owner,
            provenance: "posted",
            track: Track::Specified,
            card: None,
            embargo: None,
        };
        self.store.create_run(&run, None, self.now_ms).await.unwrap();
        self.model.create_run(id, owner);
    }

    async fn accept(&mut self) {
        let run = (self.below(4) > 0).then(|| self.model.some_run(self.random.next_u64())).flatten();
        let owner = match &run {
            Some(run) => self.model.runs[run].owner,
            None => OWNERS[self.below(OWNERS.len())],
        };
        let new: Vec<NewSubmission> = (0..=self.below(3)).map(|_| self.submission(run.clone(), owner)).collect();
        let expected = self.model.accept(&new);
        let found = self.store.accept(new.into(), None, decide_all, self.now_ms).await.unwrap();
        assert_eq!(found, Acceptability::Decided(expected));
    }

    fn submission(&mut self, run_id: Option<String>, owner: Option<&'static str>) -> NewSubmission {
        let task = self.below(TASKS);
        NewSubmission {
            id: uuid::Uuid::now_v7().to_string(),
            run_id,
            suite_id: self.suite.id(),
            task_hash: self.suite.tasks[task].content_hash(),
            task_number: self.suite.tasks[task].number,
            log_hash: ["one", "other"][self.below(2)].to_owned(),
            log: self.logs[task].clone(),
            turns: 1,
            events: 1,
            owner: owner.map(str::to_owned),
            lane: if self.below(4) == 0 { Lane::Long } else { Lane::Quick },
            replays: None,
            profile: Profile::Published,
        }
    }

    async fn cancel(&mut self) {
        let Some(id) = self.model.some_submission(self.random.next_u64()) else { return };
        let expected = self.model.cancel(&id);
        assert_eq!(self.store.cancel(&id, self.now_ms).await.unwrap(), expected);
    }

    async fn change_quota(&mut self) {
        let Some(owner) = OWNERS[self.below(OWNERS.len())] else { return };
        if self.below(4) == 0 {
            let lifted = self.store.lift_quota(owner, "for the test", self.now_ms).await.unwrap();
            assert_eq!(lifted, self.model.lift(owner));
        } else {
            let units = self.below(40) as i64 - 5;
            self.store.grant(owner, units, "for the test", self.now_ms).await.unwrap();
            self.model.grant(owner, units);
        }
    }

    async fn finish(&mut self) {
        let Some(run) = self.model.some_run(self.random.next_u64()) else { return };
        let skip = match self.below(3) {
            0 => None,
            1 => Some(Skip::Unanswered),
            _ => Some(Skip::Tasks(vec![1 + self.below(TASKS) as u32])),
        };
        let expected = self.model.finish(&run, skip.as_ref());
        assert_eq!(self.store.finish_run(&run, skip.as_ref(), self.now_ms).await.unwrap(), expected);
    }

    async fn delete(&mut self) {
        let Some(run) = self.model.some_run(self.random.next_u64()) else { return };
        let expected = self.model.delete(&run);
        assert_eq!(self.store.delete_run(&run, self.now_ms).await.unwrap(), expected);
    }

    async fn reopen(&mut self) {
        self.store.close().await;
        self.store = Store::open(&self.location, Some(self.folder.path().join("secrets"))).await.unwrap();
    }

    /// Compares everything that the model still knows, and forgets what cannot change any more.
    async fn compare(&mut self) {
        for (id, expected) in &self.model.submissions {
            assert_eq!(self.state_of(id).await, expected.state, "{id}: {expected:?}");
            self.compare_reports(id, expected).await;
        }
        for (id, expected) in &self.model.runs {
            let run = self.store.run(id).await.unwrap().unwrap();
            let found = (run.state, run.pending, run.graded, run.grader_errors);
            let (pending, graded, errors) = self.model.counts(id);
            assert_eq!(found, (expected.state, pending, graded, errors), "{id}");
            let solved = run.summary.map(|summary| summary.problem_level.overall.pass);
            let is_over = expected.state == RunState::Finished;
            assert_eq!(solved, is_over.then(|| self.model.solved(id)), "{id}: {expected:?}");
        }
        for owner in OWNERS.into_iter().flatten() {
            let found = self.store.quota(owner).await.unwrap();
            let expected = self.model.quotas.get(owner).copied().unwrap_or_default();
            let found = (found.granted, found.reserved, found.charged, found.used_before);
            assert_eq!(found, (expected.granted, expected.reserved, expected.charged, expected.used_before), "{owner}");
        }
        self.compare_hidden().await;
        self.model.forget();
    }
}

/// Grades a log, and an empty one of as many turns.
fn both(task: &Task, log: &BlockLog) -> [Report; 2] {
    let empty = BlockLog { turns: vec![Turn::default(); log.turns.len()], ..log.clone() };
    let graded = |log| grade_hashed(task, &task.content_hash(), log, &Control::unhurried()).unwrap();
    [graded(log), graded(&empty)]
}

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| value.parse().unwrap())
}

#[tokio::test]
async fn the_store_does_what_a_plain_model_does() {
    let seed = setting("PLUMBLINE_MODEL_SEED", 1);
    let steps = setting("PLUMBLINE_MODEL_STEPS", STEPS as u64);
    let mut scene = Scene::new(seed).await;
    for step in 0..steps {
        let done = std::panic::AssertUnwindSafe(scene.step());
        let outcome = futures_util::FutureExt::catch_unwind(done).await;
        assert!(outcome.is_ok(), "step {step} of seed {seed}");
    }
    scene.compare().await;
    // What the model holds for ever would be claimed by nobody else.
    for claim in std::mem::take(&mut scene.claims) {
        scene.store.give_back(&claim, true).await.unwrap();
    }
    scene.end_epoch().await;
    scene.drain(&[Lane::Quick, Lane::Long]).await;
    scene.drain(&[Lane::Hidden]).await;
    settle_epochs(&scene.store, scene.now_ms).await.unwrap();
    let database = scene.folder.path().join("p.db");
    scene.store.close().await;
    scene.behind.close().await;
    audit(&database, &[], "the model").await;
}
