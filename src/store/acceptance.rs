//! Acceptance of submissions: the facts that decide, and the rows that are written, for many submissions at once.
//!
//! Requests that arrive together share a transaction, so their facts are read together, and what one request stores
//! counts for the next.

use std::collections::{BTreeMap, BTreeSet};

use super::db::{Builder, Tx, query};
use super::idempotency::IdempotencyKey;
use super::locks::Lock;
use super::queue::{self, Lane, NewJob};
use super::quota;
use super::run_rows::{count, states_of};
use super::states::{RunState, SubmissionState};
use super::submissions::NewSubmission;
use super::{Store, StoreResult};
use plumbline_engine::voxel::Profile;

/// Maximum number of rows that one statement inserts.
const AT_ONCE: usize = 500;

/// Outcome of storing a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Accepted {
    /// The submission is new and queued.
    New,
    /// The run already has the same log for this task, under this identifier.
    Same(String),
    /// The run already has a different log for this task, under this identifier.
    Other(String),
    /// The run accepts no more submissions.
    RunClosed,
    /// The owner's quota is used up.
    QuotaUsedUp,
}

/// Answer that a run already has for a task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EarlierAnswer {
    /// Identifier of the submission.
    pub id: String,
    /// SHA-256 of its log's canonical JSON, in hex.
    pub log_hash: String,
    /// State of the submission.
    pub state: SubmissionState,
}

/// Stored facts that decide whether a submission may be stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AcceptFacts {
    /// State of its run; `None` if it belongs to none, or to one that does not exist.
    pub run: Option<RunState>,
    /// Answer that its run already has for the same task.
    pub earlier: Option<EarlierAnswer>,
    /// Submissions that its owner may still post; `None` without a limit.
    pub quota_left: Option<i64>,
}

/// Decision on a submission.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decision {
    /// The submission is stored. An earlier answer, which ended without a grade, no longer counts.
    Store {
        /// Earlier answer that no longer counts.
        supersedes: Option<EarlierAnswer>,
    },
    /// The submission is not stored, for this reason.
    Answer(Accepted),
}

/// Decides on the submissions of a request from stored facts, as if each were stored before the next. The use cases own
/// the rule.
pub type Decide = fn(&[NewSubmission], Vec<AcceptFacts>) -> Vec<Decision>;

/// Outcome of a request to store submissions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Acceptability {
    /// The outcome of each submission, in the order given. If all are [`Accepted::New`] or [`Accepted::Same`], they are
    /// durable; otherwise none was stored.
    Decided(Vec<Accepted>),
    /// The same request was carried out before; holds the identifiers, and whether each existed even then, as JSON.
    Replayed(String),
    /// The idempotency key was used for a different request.
    KeyUsedOtherwise,
}

/// Submission to write, as decided.
#[derive(Debug)]
pub(super) struct ToStore<'a> {
    pub new: &'a NewSubmission,
    /// Earlier answer of its run that no longer counts.
    pub supersedes: Option<EarlierAnswer>,
    /// Submission whose reservation of the quota it takes over.
    pub takes_over: Option<&'a str>,
}

/// Facts about the runs, answers and owners of a group of requests. Storing a request changes them for the next.
#[derive(Debug, Default)]
pub(super) struct Facts {
    runs: BTreeMap<String, RunState>,
    answers: BTreeMap<(String, u32), EarlierAnswer>,
    quotas: BTreeMap<String, i64>,
}

impl Facts {
    /// Reads the facts about these submissions.
    pub async fn read<'a>(tx: &mut Tx, all: impl Iterator<Item = &'a NewSubmission> + Clone) -> StoreResult<Self> {
        let mut facts = Self::default();
        let runs: BTreeSet<&str> = all.clone().filter_map(|new| new.run_id.as_deref()).collect();
        if !runs.is_empty() {
            facts.runs = states_of(tx, &runs).await?;
            facts.answers = answers_of(tx, all.clone()).await?;
        }
        let owners: BTreeSet<&str> = all.filter_map(|new| new.owner.as_deref()).collect();
        if !owners.is_empty() {
            facts.quotas = quota::left_of(tx, &owners).await?;
        }
        Ok(facts)
    }

    /// Returns the facts about each of these submissions.
    pub fn about(&self, submissions: &[NewSubmission]) -> Vec<AcceptFacts> {
        let about = |new: &NewSubmission| {
            let task = new.run_id.as_ref().map(|run| (run.clone(), new.task_number));
            AcceptFacts {
                run: new.run_id.as_ref().and_then(|run| self.runs.get(run).copied()),
                earlier: task.and_then(|task| self.answers.get(&task).cloned()),
                quota_left: new.owner.as_ref().and_then(|owner| self.quotas.get(owner).copied()),
            }
        };
        submissions.iter().map(about).collect()
    }

    /// Notes that a submission is stored.
    pub fn note(&mut self, new: &NewSubmission) {
        if let Some(run) = &new.run_id {
            let (id, log_hash) = (new.id.clone(), new.log_hash.clone());
            let answer = EarlierAnswer { id, log_hash, state: SubmissionState::Queued };
            self.answers.insert((run.clone(), new.task_number), answer);
        }
        if let Some(left) = new.owner.as_ref().and_then(|owner| self.quotas.get_mut(owner)) {
            *left -= 1;
        }
    }
}

/// Reads the answers that count of the runs and tasks of these submissions.
async fn answers_of<'a>(
    tx: &mut Tx,
    all: impl Iterator<Item = &'a NewSubmission>,
) -> StoreResult<BTreeMap<(String, u32), EarlierAnswer>> {
    let mut of_run: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
    for new in all {
        if let Some(run) = &new.run_id {
            of_run.entry(run).or_default().insert(new.task_number);
        }
    }
    let mut answers = BTreeMap::new();
    for (run, numbers) in of_run {
        let mut select = Builder::new("SELECT task_number, id, log_hash, state FROM submissions WHERE run_id = ");
        select.push_bind(run).push(" AND superseded = FALSE AND task_number IN ").push_list(numbers);
        let found: Vec<(u32, String, String, SubmissionState)> = select.build_as().fetch_all(&mut *tx).await?;
        for (number, id, log_hash, state) in found {
            answers.insert((run.to_owned(), number), EarlierAnswer { id, log_hash, state });
        }
    }
    Ok(answers)
}

/// Returns the locks that accepting these submissions takes.
pub(super) fn locks_of<'a>(
    all: impl Iterator<Item = &'a NewSubmission>,
    once: impl Iterator<Item = &'a IdempotencyKey>,
) -> Vec<Lock<'a>> {
    let mut locks: Vec<Lock<'a>> = once.map(IdempotencyKey::lock).collect();
    for new in all {
        locks.extend(new.run_id.as_deref().map(Lock::Run));
        locks.push(Lock::Owner(new.owner.as_deref().unwrap_or_default()));
    }
    locks
}

/// Stores submissions with their jobs and reservations.
pub(super) async fn store_all(tx: &mut Tx, all: &[ToStore<'_>], now_ms: i64) -> StoreResult<()> {
    if all.is_empty() {
        return Ok(());
    }
    for one in all {
        if let Some(earlier) = &one.supersedes {
            supersede(tx, &earlier.id, &one.new.id).await?;
        }
    }
    let mut runs: BTreeMap<&str, (i64, i64)> = BTreeMap::new();
    for one in all {
        if let Some(run) = &one.new.run_id {
            let (pending, errors) = runs.entry(run).or_default();
            *pending += 1;
            let was_error = |answer: &EarlierAnswer| answer.state == SubmissionState::GraderError;
            *errors -= i64::from(one.supersedes.as_ref().is_some_and(was_error));
        }
    }
    for (run, (pending, errors)) in runs {
        count(tx, run, pending, 0, errors).await?;
    }
    let profiles: BTreeSet<(&str, Profile)> =
        all.iter().filter_map(|one| Some((one.new.run_id.as_deref()?, one.new.profile))).collect();
    for (run, profile) in profiles {
        note_profile(tx, run, profile).await?;
    }
    for part in all.chunks(AT_ONCE) {
        insert(tx, part, now_ms).await?;
    }
    let mut jobs: BTreeMap<(Lane, &str), Vec<NewJob<'_>>> = BTreeMap::new();
    for one in all {
        let owner = one.new.owner.as_deref().unwrap_or_default();
        jobs.entry((one.new.lane, owner)).or_default().push(NewJob { submission_id: &one.new.id });
    }
    for ((lane, owner), jobs) in jobs {
        queue::enter(tx, lane, owner, &jobs, now_ms).await?;
    }
    let reserved: Vec<(&str, &str)> = all
        .iter()
        .filter(|one| one.takes_over.is_none())
        .filter_map(|one| Some((one.new.owner.as_deref()?, one.new.id.as_str())))
        .collect();
    quota::reserve(tx, &reserved, now_ms).await?;
    for one in all {
        if let Some(earlier) = one.takes_over {
            quota::hand_over(tx, earlier, &one.new.id).await?;
        }
    }
    Ok(())
}

/// Notes that a submission takes the place of an earlier one, which counts no more.
pub(super) async fn supersede(tx: &mut Tx, earlier: &str, successor: &str) -> StoreResult<()> {
    query("UPDATE submissions SET superseded = TRUE, superseded_by = $2 WHERE id = $1")
        .bind(earlier)
        .bind(successor)
        .execute(tx)
        .await?;
    Ok(())
}

/// Notes the profile of a submission with its run.
async fn note_profile(tx: &mut Tx, run: &str, profile: Profile) -> StoreResult<()> {
    query(
        "UPDATE runs SET profile = CASE WHEN profile IS NULL THEN $2 ELSE 'mixed' END
         WHERE id = $1 AND (profile IS NULL OR profile NOT IN ($2, 'mixed'))",
    )
    .bind(run)
    .bind(profile)
    .execute(tx)
    .await?;
    Ok(())
}

async fn insert(tx: &mut Tx, part: &[ToStore<'_>], now_ms: i64) -> StoreResult<()> {
    let mut insert = Builder::new(
        "INSERT INTO submissions (id, run_id, suite_id, task_hash, task_number, log_hash, log, log_bytes, turns, events,
                                  state, created_at_ms, owner, replays, profile) ",
    );
    insert.push_values(part, |row, one| {
        let new = one.new;
        row.push_bind(&new.id)
            .push_bind(&new.run_id)
            .push_bind(&new.suite_id)
            .push_bind(&new.task_hash)
            .push_bind(new.task_number)
            .push_bind(&new.log_hash)
            .push_bind(new.log.zstd())
            .push_bind(new.log.json_bytes() as i64)
            .push_bind(new.turns as i64)
            .push_bind(new.events as i64)
            .push_bind(SubmissionState::Queued)
            .push_bind(now_ms)
            .push_bind(&new.owner)
            .push_bind(&new.replays)
            .push_bind(new.profile);
    });
    insert.build().execute(tx).await?;
    Ok(())
}

impl Store {
    /// Reads the facts that decide whether each submission may be stored, without waiting for a writer.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn accept_facts(&self, submissions: &[NewSubmission]) -> StoreResult<Vec<AcceptFacts>> {
        let mut reading = self.readers.begin_reading().await?;
        Ok(Facts::read(&mut reading, submissions.iter()).await?.about(submissions))
    }
}
