//! Acceptance of submissions: checks the whole body, and accepts all of its submissions or none.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use bytes::Bytes;
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::decision::{answers, decide_all, lane_of};
use super::log_size::{check_against_task, most_blocks};
use super::posted::{Format, Posted, PostedSubmission, read_submissions};
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::catalogue::suites::no_suite;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::replay::complete_logs;
use crate::app::structure_files::{ORDER_IS_CHECKED, checks_order};
use crate::clock::now_ms;
use crate::store::StoreError;
use crate::store::acceptance::{Acceptability, Accepted};
use crate::store::idempotency::IdempotencyKey;
use crate::store::keys::Scope;
use crate::store::submissions::{NewSubmission, PackedLog};
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::tasks::embedded::FULL;
use plumbline_engine::tasks::{Task, hex};

/// Accepted submission.
#[derive(Debug)]
pub struct AcceptedSubmission {
    /// Identifier of the submission.
    pub id: String,
    /// Whether the run already held the same log for the task, so that nothing was stored.
    pub repeated: bool,
    /// Results of the action code of its turns.
    pub action_code: Vec<TurnReplay>,
}

/// Result of accepting a body.
#[derive(Debug)]
pub struct Acceptance {
    /// Accepted submissions, in the order of the body.
    pub submissions: Vec<AcceptedSubmission>,
    /// Whether an earlier request with the same `Idempotency-Key` already had the effect.
    pub is_replayed: bool,
}

/// Submissions of a body without faults.
struct Checked {
    submissions: Vec<NewSubmission>,
    lines: Vec<Option<u64>>,
}

/// Accepts the submissions of a body and stores them durably.
///
/// # Errors
/// Returns all faults of the body, a conflict if a run already has another log for the task or accepts no more
/// submissions, and a refusal if the caller may not submit or has used up the quota.
pub async fn accept(
    app: &App,
    caller: &Caller,
    body: Bytes,
    format: Format,
    once: Option<IdempotencyKey>,
) -> AppResult<Acceptance> {
    accept_replayed(app, caller, body, format, once, Vec::new()).await
}

/// Accepts a body as [`accept`] does. Its action code has already run, in an episode: the body has the resulting
/// events, and `replays` has the results of the code.
///
/// # Errors
/// Returns the same errors as [`accept`].
pub async fn accept_replayed(
    app: &App,
    caller: &Caller,
    body: Bytes,
    format: Format,
    once: Option<IdempotencyKey>,
    replays: Vec<TurnReplay>,
) -> AppResult<Acceptance> {
    caller.require(Scope::Submit)?;
    let Checked { submissions, lines } = check(app, caller, body, format, replays).await?;
    let submissions: Arc<[NewSubmission]> = submissions.into();
    match app.store.accept(Arc::clone(&submissions), once, decide_all, now_ms()).await? {
        Acceptability::Decided(answers) => {
            Ok(Acceptance { submissions: decided(&submissions, answers, &lines)?, is_replayed: false })
        }
        Acceptability::KeyUsedOtherwise => Err(key_reused()),
        Acceptability::Replayed(result) => {
            let before: Vec<(String, bool)> =
                serde_json::from_str(&result).map_err(|error| AppError::damaged("idempotency", error))?;
            let accepted = |(id, repeated)| AcceptedSubmission { id, repeated, action_code: Vec::new() };
            Ok(Acceptance { submissions: before.into_iter().map(accepted).collect(), is_replayed: true })
        }
    }
}

/// Checks the submissions of a body as [`accept`] does, without storing anything, and states for each whether it would
/// be a repetition.
///
/// # Errors
/// Returns the same errors as [`accept`].
pub async fn validate(
    app: &App,
    caller: &Caller,
    body: Bytes,
    format: Format,
) -> AppResult<Vec<(NewSubmission, AcceptedSubmission)>> {
    caller.require(Scope::Submit)?;
    let Checked { submissions, lines } = check(app, caller, body, format, Vec::new()).await?;
    let answers = answers(decide_all(&submissions, app.store.accept_facts(&submissions).await?));
    let accepted = decided(&submissions, answers, &lines)?;
    Ok(submissions.into_iter().zip(accepted).collect())
}

/// Creates the refusal of an `Idempotency-Key` that another request used.
#[must_use]
pub fn key_reused() -> AppError {
    let detail = "this Idempotency-Key was used for another request within 24 hours; use a new one";
    AppError::new(Kind::IdempotencyKeyReused, detail)
}

/// Reads a body and checks all of it, except for what only the transaction that stores it can decide.
async fn check(
    app: &App,
    caller: &Caller,
    body: Bytes,
    format: Format,
    replays: Vec<TurnReplay>,
) -> AppResult<Checked> {
    let read = tokio::task::spawn_blocking(move || {
        let mut faults = Faults::new();
        let posted = read_submissions(&body, format, &mut faults);
        (posted, faults)
    });
    let (Posted { mut submissions, is_malformed }, mut faults) =
        read.await.map_err(|error| AppError::internal(&error))?;
    let lines: Vec<Option<u64>> = submissions.iter().map(|submission| submission.line).collect();
    let found = resolve_all(app, caller, &submissions, &mut faults).await?;
    // Do not run the code of a body that already has faults.
    if faults.is_empty() {
        for (submission, found) in submissions.iter_mut().zip(&found) {
            submission.choose_profile(found.as_ref().map(|(entry, _)| entry.suite.profile()));
            let task = found.as_ref().and_then(|(entry, number)| entry.task_numbered(*number));
            if !submission.sent.structures.is_empty() && task.is_some_and(|(task, _)| checks_order(task)) {
                if let Some(line) = submission.line {
                    faults.enter_line(line);
                }
                faults.add_at("turns", ORDER_IS_CHECKED);
            }
        }
    }
    if faults.is_empty() {
        complete_logs(app, caller.who(), &mut submissions, &mut faults).await?;
    }
    if let [one] = submissions.as_mut_slice()
        && !replays.is_empty()
    {
        one.replays = replays;
    }
    let owner = caller.owner().map(str::to_owned);
    let prepare = tokio::task::spawn_blocking(move || {
        let prepared = prepare(submissions, &found, owner.as_deref(), &mut faults);
        (prepared, faults)
    });
    let (prepared, faults) = prepare.await.map_err(|error| AppError::internal(&error))?;
    if is_malformed {
        return Err(AppError::malformed(faults));
    }
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    Ok(Checked { submissions: prepared?, lines })
}

/// Suite of a posted submission, and the number of its task in it.
type FoundTask = (Arc<Entry>, u32);

/// Looks up run, suite and task of each submission. Entries with faults are `None`.
async fn resolve_all(
    app: &App,
    caller: &Caller,
    posted: &[PostedSubmission],
    faults: &mut Faults,
) -> AppResult<Vec<Option<FoundTask>>> {
    let mut suite_of_run: HashMap<&str, Option<String>> = HashMap::new();
    let mut suites: HashMap<String, Option<Arc<Entry>>> = HashMap::new();
    let mut places = Vec::with_capacity(posted.len());
    for submission in posted {
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        let suite = match &submission.run {
            Some(run) => {
                if !suite_of_run.contains_key(run.as_str()) {
                    let found = app.store.run(run).await?;
                    if let Some(row) = &found {
                        caller.require_own(row.owner.as_deref(), "run")?;
                    }
                    suite_of_run.insert(run, found.map(|row| row.suite_id));
                }
                let suite = suite_of_run.get(run.as_str()).cloned().flatten();
                if suite.is_none() {
                    faults.add_at("run", format!("there is no run {run:?}"));
                }
                if submission.suite.is_some() {
                    faults.add_at("suite", "a submission to a run takes the run's suite; leave it out");
                }
                suite
            }
            None => Some(submission.suite.clone().unwrap_or_else(|| FULL.to_owned())),
        };
        let Some(suite) = suite else {
            places.push(None);
            continue;
        };
        let Some(entry) = find_once(app, &suite, &mut suites).await? else {
            faults.add_at("suite", no_suite(&app.catalogue(), &suite));
            places.push(None);
            continue;
        };
        let number = submission.task.number_in(&entry, faults);
        places.push(number.map(|number| (entry, number)));
    }
    Ok(places)
}

/// Looks up a suite at most once per body.
async fn find_once(
    app: &App,
    name: &str,
    found: &mut HashMap<String, Option<Arc<Entry>>>,
) -> AppResult<Option<Arc<Entry>>> {
    if let Some(entry) = found.get(name) {
        return Ok(entry.clone());
    }
    let entry = app.find_suite(name).await?;
    found.insert(name.to_owned(), entry.clone());
    Ok(entry)
}

/// Checks each log against its task, and packs the logs for storage if none has a fault.
fn prepare(
    posted: Vec<PostedSubmission>,
    places: &[Option<FoundTask>],
    owner: Option<&str>,
    faults: &mut Faults,
) -> Result<Vec<NewSubmission>, StoreError> {
    let mut placed = Vec::with_capacity(posted.len());
    for (submission, place) in posted.into_iter().zip(places) {
        let Some((entry, number)) = place else { continue };
        let Some((task, hash)) = entry.task_numbered(*number) else { continue };
        if let Some(line) = submission.line {
            faults.enter_line(line);
        }
        check_against_task(&submission.sent.log, task, most_blocks(task), faults);
        placed.push((submission, entry.id.clone(), task, hash));
    }
    if !faults.is_empty() {
        return Ok(Vec::new());
    }
    let pack = |(submission, suite_id, task, hash): (PostedSubmission, String, &Task, &str)| {
        let log = &submission.sent.log;
        let json = log.canonical_json();
        Ok(NewSubmission {
            id: Uuid::now_v7().to_string(),
            run_id: submission.run,
            suite_id,
            task_hash: hash.to_owned(),
            task_number: task.number,
            log_hash: hex(&Sha256::digest(&json)),
            turns: log.turns.len(),
            events: log.event_count(),
            owner: owner.map(str::to_owned),
            lane: lane_of(task, log),
            log: PackedLog::of(&json)?,
            replays: (!submission.replays.is_empty())
                .then(|| serde_json::to_string(&submission.replays).expect("replays are strings and numbers")),
            profile: log.profile,
        })
    };
    placed.into_iter().map(pack).collect()
}

fn as_accepted(id: String, repeated: bool, submission: &NewSubmission) -> AcceptedSubmission {
    let action_code =
        submission.replays.as_deref().map(|json| serde_json::from_str(json).expect("it was just written"));
    AcceptedSubmission { id, repeated, action_code: action_code.unwrap_or_default() }
}

/// Returns the identifiers of the accepted submissions; 409 if any was not accepted, in which case none was.
fn decided(
    submissions: &[NewSubmission],
    answers: Vec<Accepted>,
    lines: &[Option<u64>],
) -> AppResult<Vec<AcceptedSubmission>> {
    let mut conflicts = Faults::new();
    let (mut closed, mut is_used_up) = (false, false);
    let mut accepted = Vec::with_capacity(submissions.len());
    // Identifiers created for this body; if it is refused, they refer to nothing.
    let own: HashSet<String> = submissions.iter().map(|submission| submission.id.clone()).collect();
    for ((submission, answer), line) in submissions.iter().zip(answers).zip(lines) {
        if let Some(line) = line {
            conflicts.enter_line(*line);
        }
        match answer {
            Accepted::New => accepted.push(as_accepted(submission.id.clone(), false, submission)),
            Accepted::Same(id) => accepted.push(as_accepted(id, true, submission)),
            Accepted::Other(id) if own.contains(&id) => {
                conflicts.add_at("task", "another line of this body has a different log for the same task");
            }
            Accepted::Other(id) => {
                conflicts.add_at("task", format!("the run already has a different log for this task: submission {id}"));
            }
            Accepted::QuotaUsedUp => is_used_up = true,
            Accepted::RunClosed => {
                closed = true;
                conflicts.add_at("run", "the run accepts no more submissions");
            }
        }
    }
    if is_used_up {
        let detail = "the quota is used up: GET /v1/quota shows how it was used; nothing in this request was accepted";
        return Err(AppError::new(Kind::QuotaUsedUp, detail));
    }
    if conflicts.is_empty() {
        return Ok(accepted);
    }
    let detail = conflicts.list().first().map(|fault| fault.detail.clone()).unwrap_or_default();
    let conflict =
        if closed { AppError::conflict("run-closed", detail) } else { AppError::conflict("already-submitted", detail) };
    Err(conflict.with_faults(conflicts))
}
