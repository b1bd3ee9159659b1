//! Hidden instances: shows their prompts, accepts one log as the answer, and tells of its grade when that is allowed.

use bytes::Bytes;
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::acceptance::decide_answer;
use super::answer::{PostedAnswer, read_answer};
use super::entries::{require_entrant, require_owner};
use super::epochs::{not_open, stored_epoch};
use super::receipts::given;
use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::replay::complete_log;
use crate::app::submissions::decision::decide_all;
use crate::app::submissions::log_size::check_against_prompts;
use crate::app::submissions::posted::Format;
use crate::clock::steady::steady_now_ms;
use crate::clock::{now_ms, rfc3339};
use crate::store::entries::EntryRow;
use crate::store::epochs::HIDDEN_SUITE;
use crate::store::hidden_answers::{AnswerRefusal, Answered, NewAnswer};
use crate::store::instances::InstanceRow;
use crate::store::keys::Scope;
use crate::store::queue::Lane;
use crate::store::reports::ReportRow;
use crate::store::submissions::{NewSubmission, PackedLog};
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::ReceiptFile;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::not_json::why_not_json;
use plumbline_engine::tasks::{Task, hex};
use plumbline_engine::voxel::BlockLog;

/// An instance as its entrant sees it: the prompts, without the checks.
#[derive(Debug)]
pub struct IssuedInstance {
    /// Stored instance.
    pub row: InstanceRow,
    /// Instructions, one per turn.
    pub prompts: Vec<String>,
}

/// Accepted answer.
#[derive(Debug)]
pub struct AcceptedAnswer {
    /// SHA-256 of the log's canonical JSON, in hex.
    pub log_sha256: String,
    /// Whether the same log had already answered the instance.
    pub is_repeated: bool,
    /// Signed receipt of the answer; none for answers that are older than these receipts.
    pub receipt: Option<GivenReceipt>,
    /// Results of the action code of its turns.
    pub action_code: Vec<TurnReplay>,
}

/// Revealed grade of an instance.
#[derive(Debug)]
pub struct RevealedGrade {
    /// The task with its checks.
    pub task: Task,
    /// Report on the answer.
    pub report: ReportRow,
}

/// Adds the prompts to an instance.
///
/// # Errors
/// Returns an error if the database fails.
pub(super) async fn with_prompts(app: &App, row: InstanceRow) -> AppResult<IssuedInstance> {
    let task = app.store.task(&row.task_hash).await?;
    Ok(IssuedInstance { row, prompts: task.turns.into_iter().map(|turn| turn.prompt).collect() })
}

fn no_instance(id: &str) -> AppError {
    AppError::not_found(format!("there is no instance {id:?}"))
}

/// Decides whether a caller may do something with what belongs to the owner of an entry.
type Require = fn(&Caller, &EntryRow, &str) -> AppResult<()>;

/// Returns the instance if the caller may do with it what `require` allows.
async fn own_instance(app: &App, caller: &Caller, id: &str, require: Require) -> AppResult<InstanceRow> {
    let row = app.store.instance(id).await?.ok_or_else(|| no_instance(id))?;
    let entry = app.store.entry(&row.entry_id).await?.ok_or_else(|| no_instance(id))?;
    require(caller, &entry, "instance")?;
    Ok(row)
}

/// Returns an instance to its owner.
///
/// # Errors
/// Returns an error if there is no such instance, or if the caller may not act on it.
pub async fn instance(app: &App, caller: &Caller, id: &str) -> AppResult<IssuedInstance> {
    caller.require(Scope::Submit)?;
    let row = own_instance(app, caller, id, require_owner).await?;
    with_prompts(app, row).await
}

/// Returns an instance to its entrant, who alone may act on it.
///
/// # Errors
/// Returns 404 if there is no such instance, and 403 if it belongs to another owner.
pub async fn instance_to_act_on(app: &App, caller: &Caller, id: &str) -> AppResult<IssuedInstance> {
    caller.require(Scope::Submit)?;
    let row = own_instance(app, caller, id, require_entrant).await?;
    with_prompts(app, row).await
}

/// Returns an instance to its entrant if it can still be answered.
///
/// # Errors
/// Returns the errors of [`instance_to_act_on`], and 409 if the instance was answered or has expired, or if its entry or
/// epoch takes no more answers.
pub async fn unanswered(app: &App, caller: &Caller, id: &str) -> AppResult<InstanceRow> {
    let row = own_instance(app, caller, id, require_entrant).await?;
    if row.submission_id.is_some() {
        return Err(AppError::conflict("already-answered", "the instance has its answer"));
    }
    let entry = app.store.entry(&row.entry_id).await?;
    let is_finalized = entry.is_none_or(|entry| entry.finalized_at_ms.is_some());
    let epoch = stored_epoch(app, &row.epoch_id).await?;
    if is_finalized || !epoch.is_open(now_ms()) {
        return Err(refused(app, AnswerRefusal::Closed, &row).await?);
    }
    if row.expires_at_ms <= now_ms() {
        return Err(refused(app, AnswerRefusal::Expired, &row).await?);
    }
    Ok(row)
}

/// Answers an instance with one log.
///
/// # Errors
/// Returns all faults of the body, a conflict if the instance takes no such answer, and a refusal if the caller may not
/// act on it or has used up the quota.
pub async fn answer_instance(
    app: &App,
    caller: &Caller,
    id: &str,
    body: Bytes,
    format: Format,
) -> AppResult<AcceptedAnswer> {
    answer_replayed(app, caller, id, body, format, Vec::new()).await
}

/// Answers an instance as [`answer_instance`] does. The action code has already run, in an episode: the body has the
/// resulting events, and `replays` has the results of the code.
///
/// # Errors
/// Returns the same errors as [`answer_instance`].
pub async fn answer_replayed(
    app: &App,
    caller: &Caller,
    id: &str,
    body: Bytes,
    format: Format,
    replays: Vec<TurnReplay>,
) -> AppResult<AcceptedAnswer> {
    caller.require(Scope::Submit)?;
    if format == Format::NdJson {
        return Err(AppError::not_ndjson("send one answer per request"));
    }
    let instance = own_instance(app, caller, id, require_entrant).await?;
    let task = app.store.task(&instance.task_hash).await?;
    let PostedAnswer { mut sent, profile, transcript_sha256 } = read_posted(body).await?;
    let rules = stored_epoch(app, &instance.epoch_id).await?.commitment.rules;
    sent.choose_profile(profile, rules.map(|rules| rules.profile));
    let mut faults = Faults::new();
    if !sent.structures.is_empty() {
        // Whether the task checks the order is not told before the epoch ends.
        faults.add_at(
            "turns",
            "answers to hidden instances take no structure files, which do not tell the order of blocks",
        );
        return Err(AppError::faulty(faults));
    }
    let mut action_code = complete_log(app, caller.who(), &mut sent, &mut faults).await?;
    if !replays.is_empty() {
        action_code = replays;
    }
    let told = (!action_code.is_empty())
        .then(|| serde_json::to_string(&action_code).expect("replays are strings and numbers"));
    let (issued, by) = (instance.clone(), caller.clone());
    let prepared = tokio::task::spawn_blocking(move || {
        check_against_prompts(&sent.log, task.turns.len(), &mut faults);
        if !faults.is_empty() {
            return Err(AppError::faulty(faults));
        }
        new_submission(&sent.log, &task, &issued, &by, told)
    });
    let submission = prepared.await.map_err(|error| AppError::internal(&error))??;
    let new = NewAnswer { instance_id: id, submission: &submission, transcript_hash: transcript_sha256.as_deref() };
    let (receipt, is_repeated) =
        match app.store.answer_instance(&new, decide_answer, decide_all, steady_now_ms()).await? {
            Answered::New(receipt) => (Some(receipt), false),
            Answered::Same(receipt) => (receipt, true),
            Answered::Refused(refusal) => return Err(refused(app, refusal, &instance).await?),
        };
    let receipt = given(receipt.as_deref())?;
    Ok(AcceptedAnswer { log_sha256: submission.log_hash, is_repeated, receipt, action_code })
}

/// Reads an answer, collecting all its faults.
async fn read_posted(body: Bytes) -> AppResult<PostedAnswer> {
    let text = body.clone();
    let read = tokio::task::spawn_blocking(move || {
        let mut faults = Faults::new();
        let posted = read_answer(&body, &mut faults);
        (posted, faults)
    });
    let (posted, mut faults) = read.await.map_err(|error| AppError::internal(&error))?;
    match posted {
        Ok(posted) => posted.filter(|_| faults.is_empty()).ok_or_else(|| AppError::faulty(faults)),
        Err(error) => {
            faults.add(why_not_json(&text, &error));
            Err(AppError::malformed(faults))
        }
    }
}

/// Creates the failure for an answer that is not stored.
async fn refused(app: &App, refusal: AnswerRefusal, instance: &InstanceRow) -> AppResult<AppError> {
    Ok(match refusal {
        AnswerRefusal::OtherTranscript(promised) => {
            let before = promised.map_or_else(|| "none".to_owned(), |hash| format!("another one, {hash}"));
            let detail = format!(
                "the instance was answered with this log and {before} as transcript_sha256; the promise cannot \
                 change after the first answer"
            );
            AppError::conflict("another-transcript", detail)
        }
        AnswerRefusal::OtherLog => {
            AppError::conflict("already-answered", "the instance was already answered, with another log")
        }
        AnswerRefusal::Expired => {
            let detail = format!("the instance expired at {}", rfc3339(instance.expires_at_ms));
            AppError::conflict("expired", detail)
        }
        AnswerRefusal::Closed => {
            let epoch = stored_epoch(app, &instance.epoch_id).await?;
            let entry = app.store.entry(&instance.entry_id).await?;
            let is_finalized = entry.is_none_or(|entry| entry.finalized_at_ms.is_some());
            if is_finalized && !epoch.is_over(steady_now_ms()) {
                AppError::conflict("finalized", "the entry is finalized")
            } else {
                not_open(&epoch)
            }
        }
        AnswerRefusal::QuotaUsedUp => {
            let detail = "the quota is used up; GET /v1/quota lists what it was used for";
            AppError::new(Kind::QuotaUsedUp, detail)
        }
    })
}

fn new_submission(
    log: &BlockLog,
    task: &Task,
    instance: &InstanceRow,
    caller: &Caller,
    replays: Option<String>,
) -> AppResult<NewSubmission> {
    let json = log.canonical_json();
    Ok(NewSubmission {
        id: Uuid::now_v7().to_string(),
        run_id: None,
        suite_id: HIDDEN_SUITE.to_owned(),
        task_hash: instance.task_hash.clone(),
        task_number: task.number,
        log_hash: hex(&Sha256::digest(&json)),
        turns: log.turns.len(),
        events: log.event_count(),
        owner: caller.owner().map(str::to_owned),
        lane: Lane::Hidden,
        log: PackedLog::of(&json)?,
        replays,
        profile: log.profile,
    })
}

/// Checks the transcript that was promised with an answer, while the epoch is open. Compares its SHA-256 and stores
/// nothing of it.
///
/// # Errors
/// Returns a conflict if none was promised, or another, or if the epoch is over, and a refusal if the caller may not
/// act on the instance.
pub async fn check_transcript(app: &App, caller: &Caller, id: &str, transcript: &[u8]) -> AppResult<IssuedInstance> {
    caller.require(Scope::Submit)?;
    let instance = own_instance(app, caller, id, require_entrant).await?;
    let found = hex(&Sha256::digest(transcript));
    match &instance.transcript_hash {
        None => return Err(AppError::conflict("no-transcript-promised", "the answer had no transcript_sha256")),
        Some(promised) if *promised != found => {
            let detail = format!("the SHA-256 of the body is {found}; the promised one is {promised}");
            return Err(AppError::conflict("another-transcript", detail));
        }
        Some(_) => {}
    }
    if !app.store.note_transcript(id, now_ms()).await? {
        let detail = "the epoch is over, and its reveal no longer changes; transcripts must be shown before that";
        return Err(AppError::conflict("epoch-over", detail));
    }
    let row = own_instance(app, caller, id, require_owner).await?;
    with_prompts(app, row).await
}

/// Returns the specification and the report of an instance, after its epoch is over.
///
/// # Errors
/// Returns an error if there is no such instance, if it has no graded answer, or if its epoch is not over.
pub async fn revealed_grade(app: &App, id: &str) -> AppResult<RevealedGrade> {
    let row = app.store.instance(id).await?.ok_or_else(|| no_instance(id))?;
    let epoch = stored_epoch(app, &row.epoch_id).await?;
    if epoch.closed.is_none() {
        let detail = format!("reports are released at the epoch's end, {}", rfc3339(epoch.commitment.closes_at_ms));
        return Err(AppError::conflict("epoch-not-over", detail));
    }
    let task = app.store.task(&row.task_hash).await?;
    let report = app.store.report_of_instance(id).await?;
    let report = report.ok_or_else(|| AppError::not_found("the instance has no graded answer"))?;
    Ok(RevealedGrade { task, report })
}

/// Returns the receipt of an instance's grade, with as much of it as is released.
///
/// # Errors
/// Returns an error (404) until the epoch is over; in epochs of the first protocol until the entry is complete.
pub async fn receipt_of_instance(app: &App, id: &str) -> AppResult<ReceiptFile> {
    let missing = || AppError::not_found(format!("the instance {id:?} has no receipt yet"));
    let row = app.store.instance(id).await?.ok_or_else(missing)?;
    // Its place in the log tells when the instance was graded.
    let epoch = stored_epoch(app, &row.epoch_id).await?;
    if epoch.commitment.protocol() >= 2 && epoch.settled_at_ms.is_none() {
        return Err(missing());
    }
    let entry = app.store.entry(&row.entry_id).await?.filter(|entry| entry.completed_at_ms.is_some());
    let submission = entry.and(row.submission_id).ok_or_else(missing)?;
    Ok(app.store.receipt_of(&submission).await?.ok_or_else(missing)?.with_place(app.signer.as_deref()))
}
