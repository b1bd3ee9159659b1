//! Hidden instances: the service issues prompts and accepts one log as the answer.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::entries::{given, not_open};
use super::epochs::stored_epoch;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, Kind};
use crate::app::hidden::answer::{NewAnswerBody, PostedAnswer, read_answer};
use crate::app::limits::LIMITS;
use crate::app::replay::run_code;
use crate::app::submissions::decision::decide;
use crate::app::submissions::posted::Format;
use crate::clock::{now_ms, rfc3339};
use crate::http::extract::body::JsonBody;
use crate::http::state::AppState;
use crate::store::epochs::HIDDEN_SUITE;
use crate::store::hidden_answers::Answered;
use crate::store::instances::InstanceRow;
use crate::store::keys::Scope;
use crate::store::queue::Lane;
use crate::store::submissions::{NewSubmission, PackedLog};
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::ReceiptFile;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::why_not_json;
use plumbline_engine::tasks::{Task, hex};
use plumbline_engine::voxel::BlockLog;
use plumbline_engine::voxel::replay::Replay;

/// An instance as its entrant sees it: the prompts, without the checks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct InstanceBody {
    /// Identifier of the instance.
    #[schema(format = Uuid)]
    pub id: String,
    /// Identifier of the entry.
    #[schema(format = Uuid)]
    pub entry: String,
    /// Number of the run within the entry, from 1.
    pub run: u32,
    /// Instructions, one per turn.
    pub prompts: Vec<String>,
    /// Time of issue.
    #[schema(format = DateTime)]
    pub issued_at: String,
    /// Deadline for the answer.
    #[schema(format = DateTime)]
    pub expires_at: String,
    /// Whether the instance has an answer.
    pub answered: bool,
    /// SHA-256 of the log that answered the instance.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_sha256: Option<String>,
    /// SHA-256 of the agent's transcript, as promised with the answer.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub transcript_sha256: Option<String>,
    /// Time at which a transcript with that hash was shown.
    #[schema(format = DateTime)]
    pub transcript_checked_at: Option<String>,
}

impl InstanceBody {
    /// Builds the representation of a stored instance.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn of(state: &AppState, row: InstanceRow) -> AppResult<Self> {
        let task = state.store.task(&row.task_hash).await?;
        Ok(Self {
            id: row.id,
            entry: row.entry_id,
            run: row.run,
            prompts: task.turns.into_iter().map(|turn| turn.prompt).collect(),
            issued_at: rfc3339(row.issued_at_ms),
            expires_at: rfc3339(row.expires_at_ms),
            answered: row.submission_id.is_some(),
            log_sha256: row.log_hash,
            transcript_sha256: row.transcript_hash,
            transcript_checked_at: row.transcript_checked_ms.map(rfc3339),
        })
    }
}

/// Returns the instance if the caller may act on it.
async fn own_instance(state: &AppState, caller: &Caller, id: &str) -> AppResult<InstanceRow> {
    let missing = || AppError::not_found(format!("there is no instance {id:?}"));
    let row = state.store.instance(id).await?.ok_or_else(missing)?;
    let entry = state.store.entry(&row.entry_id).await?.ok_or_else(missing)?;
    caller.require_own(Some(entry.owner.as_str()).filter(|owner| !owner.is_empty()), "instance")?;
    Ok(row)
}

/// Returns an instance. Requires a key of its owner.
#[utoipa::path(
    get, path = "/v1/instances/{id}", operation_id = "get_instance", tag = "hidden evaluation", summary = "Get an instance",
    params(("id" = String, Path, description = "The instance's id")),
    responses(
        (status = 200, description = "The instance", body = InstanceBody,
         example = json!({ "id": "5f0c…", "prompts": ["You stand at (0, 0, 0) …"], "answered": false })),
        (status = 401, description = "No key"),
        (status = 403, description = "It is another owner's"),
    ),
    security(("key" = []))
)]
pub async fn get_instance(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<InstanceBody>> {
    caller.require(Scope::Submit)?;
    let row = own_instance(&state, &caller, &id).await?;
    Ok(Json(InstanceBody::of(&state, row).await?))
}

/// Confirmation of an accepted answer.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct AnswerTaken {
    /// Identifier of the instance.
    #[schema(format = Uuid)]
    pub instance: String,
    /// SHA-256 of the log's canonical JSON; the receipt contains it.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub log_sha256: String,
    /// Whether the same log had already answered the instance.
    pub repeated: bool,
    /// Signed receipt of the answer. Keep it: it lets anyone check that the reveal contains this answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receipt: Option<GivenReceipt>,
    /// Results of running the action code, if a turn contains any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub action_code: Vec<crate::actions::turn_replay::TurnReplay>,
}

/// Answers an instance with one log. Format errors are reported in full and cost nothing. Once a log is accepted, a
/// different log is rejected.
#[utoipa::path(
    post, path = "/v1/instances/{id}/answer", operation_id = "answer_instance", tag = "hidden evaluation",
    summary = "Answer an instance",
    params(("id" = String, Path, description = "The instance's id")),
    request_body(content = NewAnswerBody, content_type = "application/json"),
    responses(
        (status = 202, description = "The answer is stored durably and will be graded", body = AnswerTaken,
         example = json!({ "instance": "5f0c…", "log_sha256": "9f86d081…", "repeated": false })),
        (status = 409, description = "Answered by another log, expired, or closed"),
    )
)]
pub async fn answer_instance(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Response> {
    caller.require(Scope::Submit)?;
    if body.format == Format::NdJson {
        return Err(AppError::not_ndjson("send one answer per request"));
    }
    let instance = own_instance(&state, &caller, &id).await?;
    let task = state.store.task(&instance.task_hash).await?;
    let JsonBody { bytes, share: _share, .. } = body;
    let text = bytes.clone();
    let read = tokio::task::spawn_blocking(move || {
        let mut faults = Faults::new();
        let posted = read_answer(&bytes, &mut faults);
        (posted, faults)
    });
    let (posted, mut faults) = read.await.map_err(|error| AppError::internal(&error))?;
    let posted = match posted {
        Ok(posted) => posted,
        Err(error) => {
            faults.add(why_not_json(&text, &error));
            return Err(AppError::malformed(faults));
        }
    };
    let Some(PostedAnswer { mut sent, transcript_sha256 }) = posted.filter(|_| faults.is_empty()) else {
        return Err(AppError::faulty(faults));
    };
    let replays = run_code(&state, caller.who(), &mut sent, &mut faults).await?;
    let told = (!replays.is_empty()).then(|| serde_json::to_string(&replays).expect("replays are strings and numbers"));
    let (issued, by) = (instance.clone(), caller.clone());
    let prepared = tokio::task::spawn_blocking(move || {
        check_form(&sent.log, &task, &mut faults);
        if !faults.is_empty() {
            return Err(AppError::faulty(faults));
        }
        new_submission(&sent.log, &task, &issued, &by, told)
    });
    let new = prepared.await.map_err(|error| AppError::internal(&error))??;
    let answered = state.store.answer_instance(&id, &new, transcript_sha256.as_deref(), decide, now_ms()).await?;
    let is_repeated = matches!(answered, Answered::Same(_));
    let receipt = match answered {
        Answered::New(receipt) => Some(receipt),
        Answered::Same(receipt) => receipt,
        Answered::OtherTranscript(promised) => {
            let before = promised.map_or_else(|| "none".to_owned(), |hash| format!("another one, {hash}"));
            let detail = format!(
                "the instance was answered with this log and {before} as transcript_sha256; the promise cannot \
                 change after the first answer"
            );
            return Err(AppError::conflict("another-transcript", detail));
        }
        Answered::Other => {
            return Err(AppError::conflict("already-answered", "the instance was already answered, with another log"));
        }
        Answered::Expired => {
            let detail = format!("the instance expired at {}", rfc3339(instance.expires_at_ms));
            return Err(AppError::conflict("expired", detail));
        }
        Answered::Closed => {
            let epoch = stored_epoch(&state, &instance.epoch_id).await?;
            let is_over = epoch.is_over(now_ms());
            return Err(if is_over {
                not_open(&epoch)
            } else {
                AppError::conflict("finalized", "the entry is finalized")
            });
        }
        Answered::QuotaUsedUp => {
            let detail = "the quota is used up; GET /v1/quota lists what it was used for";
            return Err(AppError::new(Kind::QuotaUsedUp, detail));
        }
    };
    let receipt = given(receipt.as_deref())?;
    let taken =
        AnswerTaken { instance: id, log_sha256: new.log_hash, repeated: is_repeated, receipt, action_code: replays };
    Ok((StatusCode::ACCEPTED, Json(taken)).into_response())
}

/// Adds the faults in the form of a log. They depend only on the log and the number of turns, so they reveal nothing
/// about the checks.
fn check_form(log: &BlockLog, task: &Task, faults: &mut Faults) {
    if log.turns.len() != task.turns.len() {
        let (found, wanted) = (log.turns.len(), task.turns.len());
        faults.add_at("turns", format!("found {found} turns; expected {wanted}, one for each prompt"));
        return;
    }
    let most = LIMITS.blocks_with_stress;
    if log.event_count() > most
        && let Some(blocks) = Replay::new(log).map(|structure| structure.len()).find(|blocks| *blocks > most)
    {
        faults.add_at("turns", format!("{blocks} blocks stand after a turn; at most {most} are allowed"));
    }
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
    })
}

/// Checks the transcript that was promised with an answer, while the epoch is open. The service compares its SHA-256
/// and stores nothing of it.
#[utoipa::path(
    post, path = "/v1/instances/{id}/transcript", operation_id = "check_transcript", tag = "hidden evaluation",
    summary = "Show a promised transcript",
    params(("id" = String, Path, description = "The instance's id")),
    request_body(content = Object, content_type = "application/json", description = "The transcript, with exactly the bytes that were hashed"),
    responses(
        (status = 200, description = "The transcript matches the promised hash", body = InstanceBody,
         example = json!({ "id": "5f0c…", "transcript_checked_at": "2026-11-22T10:00:00.000Z" })),
        (status = 409, description = "None was promised, or another, or the epoch is over"),
    )
)]
pub async fn check_transcript(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: JsonBody,
) -> AppResult<Json<InstanceBody>> {
    caller.require(Scope::Submit)?;
    let instance = own_instance(&state, &caller, &id).await?;
    let found = hex(&Sha256::digest(&body.bytes));
    match &instance.transcript_hash {
        None => return Err(AppError::conflict("no-transcript-promised", "the answer had no transcript_sha256")),
        Some(promised) if *promised != found => {
            let detail = format!("the SHA-256 of the body is {found}; the promised one is {promised}");
            return Err(AppError::conflict("another-transcript", detail));
        }
        Some(_) => {}
    }
    if !state.store.note_transcript(&id, now_ms()).await? {
        let detail = "the epoch is over, and its reveal no longer changes; transcripts must be shown before that";
        return Err(AppError::conflict("epoch-over", detail));
    }
    let row = own_instance(&state, &caller, &id).await?;
    Ok(Json(InstanceBody::of(&state, row).await?))
}

/// Returns the specification and the report of an instance, after its epoch is over.
#[utoipa::path(
    get, path = "/v1/instances/{id}/report", operation_id = "get_instance_report", tag = "hidden evaluation",
    summary = "Get a revealed instance's report",
    params(("id" = String, Path, description = "The instance's id")),
    responses(
        (status = 200, description = "The task and the report", body = Object,
         example = json!({ "task": { "id": "slabs/00017" }, "report": { "overall": true } })),
        (status = 409, description = "Its epoch is not over"),
    )
)]
pub async fn get_instance_report(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<Value>> {
    let missing = || AppError::not_found(format!("there is no instance {id:?}"));
    let row = state.store.instance(&id).await?.ok_or_else(missing)?;
    let epoch = stored_epoch(&state, &row.epoch_id).await?;
    if epoch.closed.is_none() {
        let detail = format!("reports are released at the epoch's end, {}", rfc3339(epoch.commitment.closes_at_ms));
        return Err(AppError::conflict("epoch-not-over", detail));
    }
    let task = state.store.task(&row.task_hash).await?;
    let graded = state.store.report_of_instance(&id).await?;
    let graded = graded.ok_or_else(|| AppError::not_found("the instance has no graded answer"))?;
    Ok(Json(serde_json::json!({ "task": task, "report": graded.report, "grader": graded.grader,
                                "graded_at": rfc3339(graded.graded_at_ms) })))
}

/// Returns the receipt of an instance's grade: at first its hash and its position in the log, and the whole receipt
/// when the epoch is over.
#[utoipa::path(
    get, path = "/v1/instances/{id}/receipt", operation_id = "get_instance_receipt", tag = "hidden evaluation",
    summary = "Get an instance's receipt",
    params(("id" = String, Path, description = "The instance's id")),
    responses(
        (status = 200, description = "The receipt", body = ReceiptFile,
         example = json!({ "seq": 12, "receipt": null, "hash": "2c26b46b…", "link": "fcde2b2e…" })),
    )
)]
pub async fn get_instance_receipt(
    State(state): State<AppState>,
    Path(id): Path<String>,
) -> AppResult<Json<ReceiptFile>> {
    let missing = || AppError::not_found(format!("the instance {id:?} has no receipt yet"));
    let row = state.store.instance(&id).await?.ok_or_else(missing)?;
    // The receipt would reveal when the instance was graded, so it is withheld until the entry is complete.
    let entry = state.store.entry(&row.entry_id).await?.filter(|entry| entry.completed_at_ms.is_some());
    let submission = entry.and(row.submission_id).ok_or_else(missing)?;
    Ok(Json(state.store.receipt_of(&submission).await?.ok_or_else(missing)?.with_place(&state.signer)))
}
