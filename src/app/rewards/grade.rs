//! Grading of one request: reads it, prepares its log and grades it. Shared by single requests, batches and adapters.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sha2::{Digest as _, Sha256};

use super::given_task::GivenTask;
use super::grader::{Deadline, Graded, Until};
use super::in_time::{GRADED_WITHIN, code_in_time, graded_in_time};
use super::model_text::{AnswerBody, log_in_texts};
use super::reading::read_request;
use super::request::{Detail, GivenWork, GradeRequest};
use super::results::{Outcome, Work};
use super::task_member::NamedTask;
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::blocking::blocking;
use crate::app::catalogue::suites::no_suite;
use crate::app::error::{AppError, AppResult};
use crate::app::event_budget::EventBudget;
use crate::app::limits::LIMITS;
use crate::app::replay::{complete_log_within, take_permit};
use crate::app::rewards::score::{CheckScore, GradeBody, Timings, UnmeasuredCheck};
use crate::app::structure_files::{ORDER_IS_CHECKED, open_files};
use crate::app::submissions::log_size::{check_against_task, most_blocks, most_blocks_of_model};
use plumbline_engine::checks::{CHECKS_VERSION, Dimension};
use plumbline_engine::grading::cost::{Cost, cost};
use plumbline_engine::grading::reward::{RewardComponents, Scheme};
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::code::SentLog;
use plumbline_engine::intake::not_json::{on_its_line, why_not_json};
use plumbline_engine::tasks::catalogue::Catalogue;
use plumbline_engine::tasks::embedded::FULL;
use plumbline_engine::tasks::{Task, hex};
use plumbline_engine::voxel::BlockLog;

/// Request that was read and whose task was found.
#[derive(Debug)]
pub struct ReadRequest {
    request: GradeRequest,
    given: GivenTask,
    begun: Instant,
}

/// Request whose log was found, but whose action code has not run yet.
#[derive(Debug)]
pub struct Found {
    request: GradeRequest,
    given: GivenTask,
    sent: SentLog,
    answer: Option<AnswerBody>,
    not_measured: Vec<UnmeasuredCheck>,
    begun: Instant,
}

/// Request whose log is complete, or known to be unreadable.
#[derive(Debug)]
pub struct Prepared {
    request: GradeRequest,
    work: Arc<Work>,
    replays: Vec<TurnReplay>,
    answer: Option<AnswerBody>,
    not_measured: Vec<UnmeasuredCheck>,
    begun: Instant,
    read_us: u64,
}

impl ReadRequest {
    /// Reads a request and finds its task in the loaded suites.
    ///
    /// # Errors
    /// Returns 400 if the body is not JSON, and 422 with all its faults if it has any.
    pub fn read(text: &[u8], catalogue: &Catalogue) -> AppResult<Self> {
        Self::read_with(text, catalogue, Faults::new(), why_not_json)
    }

    /// Reads a request that is a line of an NDJSON body, and finds its task in the loaded suites. The faults are those of
    /// that line, counted from 1.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::read`].
    pub fn read_line(text: &[u8], line: u64, catalogue: &Catalogue) -> AppResult<Self> {
        let mut faults = Faults::new();
        faults.enter_line(line);
        Self::read_with(text, catalogue, faults, on_its_line)
    }

    fn read_with(
        text: &[u8],
        catalogue: &Catalogue,
        mut faults: Faults,
        why: fn(&[u8], &serde_json::Error) -> String,
    ) -> AppResult<Self> {
        let begun = Instant::now();
        let request = match read_request(text, &mut faults) {
            Ok(request) => request,
            Err(error) => {
                faults.add(why(text, &error));
                return Err(AppError::malformed(faults));
            }
        };
        let given = request.as_ref().and_then(|request| find(request, catalogue, &mut faults));
        let (Some(request), Some(given), true) = (request, given, faults.is_empty()) else {
            return Err(AppError::faulty(faults));
        };
        Ok(Self { request, given, begun })
    }

    /// Replaces the log of the request by texts that a model wrote.
    #[must_use]
    pub fn about(mut self, texts: Vec<String>) -> Self {
        self.request.work = GivenWork::Answer(texts);
        self
    }

    /// Returns whether preparing it takes next to no time.
    fn is_small(&self) -> bool {
        matches!(&self.request.work, GivenWork::Log(sent) if sent.log.event_count() <= INSTANT_EVENTS)
    }

    /// Finds the log in the texts of a model, runs action code, and checks the log against its task.
    ///
    /// # Errors
    /// Returns 422 if the log does not fit the task or its code reached a limit, 429 if too much code waits, 503 or 504 if
    /// code waits and runs too long, and 500 if code cannot be run. A faulty text of a model is no error, but earns a reward of 0.
    pub async fn prepare(self, app: &App, who: &Arc<str>) -> AppResult<Prepared> {
        let found = if self.is_small() { self.find_log()? } else { blocking(move || self.find_log()).await? };
        if !found.has_code() {
            return found.prepare(app, who).await;
        }
        let _permit = take_permit(app, who)?;
        // Most requests have no code, and need not carry the room for it.
        Box::pin(code_in_time(found.request.for_code, found.prepare(app, who))).await
    }

    /// Prepares one of many requests, which share a permit.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::prepare`], except 429.
    pub async fn prepare_in_turn(self, app: &App, who: &Arc<str>) -> AppResult<Prepared> {
        blocking(move || self.find_log()).await?.prepare(app, who).await
    }

    /// Finds the log in the texts of a model, or takes the log that was sent.
    ///
    /// # Errors
    /// Returns 500 if the task no longer exists.
    pub fn find_log(mut self) -> AppResult<Found> {
        let task = self.given.task()?.0;
        let work = std::mem::replace(&mut self.request.work, GivenWork::Answer(Vec::new()));
        let of_code = self.given.profile();
        let reads_code = self.request.profile.unwrap_or(of_code);
        let (mut sent, answer) = match work {
            GivenWork::Log(sent) => (sent, None),
            GivenWork::Answer(texts) => match log_in_texts(&texts, task.turns.len(), reads_code) {
                Ok((sent, answer)) => (sent, Some(answer)),
                Err(why) => (nothing(task), Some(AnswerBody { why: Some(why), ..AnswerBody::default() })),
            },
        };
        sent.choose_profile(self.request.profile, Some(of_code));
        let Self { request, given, begun } = self;
        Ok(Found { request, given, sent, answer, not_measured: Vec::new(), begun })
    }
}

/// Maximum number of events of a log that is processed on the thread that serves its request.
const INSTANT_EVENTS: usize = 2_000;

impl Found {
    /// Returns whether its log is not complete yet: it has action code to run, or structure files to read.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        self.has_code() || !self.sent.structures.is_empty()
    }

    fn has_code(&self) -> bool {
        !self.sent.codes.is_empty()
    }

    /// Reads structure files, runs action code, for which the caller holds a permit, and checks the log against its task.
    ///
    /// # Errors
    /// Returns the same errors as [`ReadRequest::prepare_in_turn`].
    pub async fn prepare(mut self, app: &App, who: &Arc<str>) -> AppResult<Prepared> {
        let (mut faults, mut replays) = (Faults::new(), Vec::new());
        if !self.sent.structures.is_empty() {
            (self.given, self.not_measured) = self.given.without_order()?;
            if self.given.task()?.0.checks().next().is_none() {
                faults.add_at("turns", ORDER_IS_CHECKED);
            }
            open_files(app, who, &mut self.sent, &mut EventBudget::whole(&app.limits), &mut faults).await?;
        }
        if self.has_code() && faults.is_empty() {
            let GradeRequest { deadline, for_code, .. } = &mut self.request;
            replays = complete_log_within(app, who, &mut self.sent, for_code, &mut faults).await?;
            // What the code took is taken from the time for grading.
            *deadline = for_code.map_or(*deadline, |left| left.min(*deadline));
        }
        if self.sent.log.event_count() <= INSTANT_EVENTS {
            return self.finish(replays, faults);
        }
        blocking(move || self.finish(replays, faults)).await
    }

    /// Checks the log against its task.
    ///
    /// # Errors
    /// Returns 422 if it does not fit.
    pub fn finish(self, replays: Vec<TurnReplay>, mut faults: Faults) -> AppResult<Prepared> {
        let Self { request, given, mut sent, mut answer, not_measured, begun } = self;
        let task = given.task()?.0;
        let is_by_model = answer.is_some() || !replays.is_empty();
        let most = if is_by_model { most_blocks_of_model(task) } else { most_blocks(task) };
        check_against_task(&sent.log, task, most, &mut faults);
        // Code that is not JavaScript counts as no answer if nothing else was built.
        let unreadable = replays.iter().find_map(unreadable_code).filter(|_| sent.log.event_count() == 0);
        if let (Some(answer), Some(why)) = (&mut answer, unreadable) {
            answer.why = Some(why);
        }
        if !faults.is_empty() {
            // A log that a model wrote is the model's own responsibility; the trainer has done nothing wrong.
            let Some(answer) = &mut answer else { return Err(AppError::faulty(faults)) };
            answer.why = faults.list().first().map(ToString::to_string);
            sent = nothing(task);
        }
        let (log_hash, detail) = (hash(&sent.log), request.detail);
        let work = Arc::new(Work { given, log: sent.log, log_hash, detail });
        Ok(Prepared { request, work, replays, answer, not_measured, begun, read_us: micros(begun) })
    }
}

/// Describes the fault of code that is not JavaScript and was therefore not run, with what was noted when it was read.
fn unreadable_code(replay: &TurnReplay) -> Option<String> {
    let error = replay.error.as_ref().filter(|_| replay.unreadable)?;
    let place = error.line.map(|line| format!(" in line {line}")).unwrap_or_default();
    let told = format!("the code is not JavaScript: {}{place}", error.message);
    Some(replay.notes.iter().fold(told, |told, note| told + "; " + note))
}

/// Returns a log without events, with as many turns as the task.
fn nothing(task: &Task) -> SentLog {
    BlockLog { turns: vec![Vec::new(); task.turns.len()], ..BlockLog::default() }.into()
}

fn find(request: &GradeRequest, catalogue: &Catalogue, faults: &mut Faults) -> Option<GivenTask> {
    let task = match &request.task {
        NamedTask::Inline(task) => return Some(GivenTask::inline((**task).clone())),
        NamedTask::Listed(task) => task,
    };
    let name = request.suite.as_deref().unwrap_or(FULL);
    let Some(entry) = catalogue.suite(name) else {
        faults.add_at("suite", no_suite(catalogue, name));
        return None;
    };
    task.number_in(entry, faults).map(|number| GivenTask::Listed(Arc::clone(entry), number))
}

fn micros(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_micros()).unwrap_or(u64::MAX)
}

impl Prepared {
    /// Grades it, and returns whether the result came from the cache.
    ///
    /// # Errors
    /// Returns the errors of [`super::grader::Grader::grade`], 422 if no criterion that applies has a weight, and 503 if
    /// the request would run out of time.
    pub async fn grade(self, app: &App, who: &Arc<str>) -> AppResult<(GradeBody, bool)> {
        // Only a deadline that the sender set includes waiting.
        let wait = self.request.for_code.is_none().then_some(GRADED_WITHIN);
        let (begun, deadline) = (self.begun, Deadline { work: self.request.deadline, wait });
        graded_in_time(begun, self.grade_within(app, who, deadline)).await
    }

    /// Grades one of many requests. The time that it waits does not count as time for grading.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::grade`].
    pub async fn grade_in_turn(self, app: &App, who: &Arc<str>) -> AppResult<GradeBody> {
        let wait = Some(Duration::from_secs(LIMITS.grade_batch_wait_seconds));
        let deadline = Deadline { work: self.request.deadline, wait };
        Ok(self.grade_within(app, who, deadline).await?.0)
    }

    async fn grade_within(self, app: &App, who: &Arc<str>, deadline: Deadline) -> AppResult<(GradeBody, bool)> {
        if self.is_unreadable() {
            return Ok((self.unreadable()?, false));
        }
        let begun = Instant::now();
        let graded = app.grader.grade(&self.work, deadline, who).await.map_err(AppError::without_reward)?;
        let is_cached = graded.is_cached;
        let deadline = deadline.after(begun.elapsed());
        if self.request.scheme == Scheme::Shaped {
            app.grader.know_baseline(&self.work.given, deadline, who).await.map_err(AppError::without_reward)?;
        }
        Ok((self.answer(app, graded)?, is_cached))
    }

    /// Returns whether it may be graded on a thread of the short lane.
    #[must_use]
    pub fn is_short(&self, app: &App) -> bool {
        let is_shaped = self.request.scheme == Scheme::Shaped;
        self.work.task().is_ok_and(|(task, _)| cost(task, &self.work.log) != Cost::Long)
            && (!is_shaped || app.grader.knows_baseline(&self.work.given))
    }

    /// Grades it on this thread.
    ///
    /// # Errors
    /// Returns the same errors as [`Self::grade`].
    pub fn grade_here(self, app: &App, until: &Until) -> AppResult<GradeBody> {
        if self.is_unreadable() {
            return self.unreadable();
        }
        let until = until.and_within(self.request.deadline);
        let graded = app.grader.grade_here(&self.work, &until);
        self.answer(app, graded.map_err(AppError::without_reward)?)
    }

    fn is_unreadable(&self) -> bool {
        self.answer.as_ref().is_some_and(|answer| answer.why.is_some())
    }

    /// Returns the result for a model that wrote nothing that can be graded: the reward is 0.
    fn unreadable(self) -> AppResult<GradeBody> {
        let (task, task_hash) = self.work.task()?;
        let criteria = task.criteria();
        Ok(GradeBody {
            task: task.id.clone(),
            task_hash: task_hash.to_owned(),
            log_hash: self.work.log_hash.clone(),
            checks_version: CHECKS_VERSION,
            reward: 0.0,
            scheme: self.request.scheme.name(),
            overall: false,
            accuracy: criteria.iter().any(|c| c.dimension() == Dimension::Accuracy).then_some(false),
            components: RewardComponents::none_of(&criteria),
            criteria: Vec::new(),
            checks: Vec::new(),
            not_measured: self.not_measured,
            report: None,
            action_code: self.replays,
            answer: self.answer,
            timings: Timings { read_us: self.read_us, grade_us: 0 },
        })
    }

    fn answer(self, app: &App, graded: Graded) -> AppResult<GradeBody> {
        let ((task, task_hash), scheme) = (self.work.task()?, &self.request.scheme);
        let Outcome { scores, report } = graded.outcome;
        let baseline = match scheme {
            Scheme::Shaped => Some(app.grader.baseline(&self.work.given, &Until::within(self.request.deadline))?),
            _ => None,
        };
        let Some(reward) = scheme.reward(&scores, baseline.as_deref()) else {
            let mut faults = Faults::new();
            faults.enter_key("reward");
            if baseline.is_some() {
                faults.add("an empty log or a single block passes every check of the task: there is nothing to shape");
            } else {
                faults.add_at("weights", "none of these criteria applies to the task");
            }
            return Err(AppError::faulty(faults));
        };
        let turns = scores.turns.iter().zip(1..);
        let checks = turns.flat_map(|(turn, number)| turn.checks.iter().map(move |check| (number, check)));
        Ok(GradeBody {
            task: task.id.clone(),
            task_hash: task_hash.to_owned(),
            log_hash: self.work.log_hash.clone(),
            checks_version: CHECKS_VERSION,
            reward,
            scheme: self.request.scheme.name(),
            overall: scores.overall,
            accuracy: scores.accuracy,
            components: RewardComponents::of(&scores),
            criteria: scores.criteria.clone(),
            checks: checks
                .map(|(turn, check)| CheckScore {
                    turn,
                    name: check.name.clone(),
                    criterion: check.criterion,
                    score: check.score,
                })
                .collect(),
            not_measured: self.not_measured,
            report: report.filter(|_| self.request.detail == Detail::Report),
            action_code: self.replays,
            answer: self.answer,
            timings: Timings { read_us: self.read_us, grade_us: micros(self.begun).saturating_sub(self.read_us) },
        })
    }
}

fn hash(log: &BlockLog) -> String {
    hex(&Sha256::digest(log.canonical_json()))
}
