//! Hidden instances: the service issues prompts and accepts one log as the answer.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use serde_json::Value;

use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::hidden::answer::NewAnswerBody;
use crate::app::hidden::instances::{self, AcceptedAnswer, IssuedInstance, RevealedGrade};
use crate::clock::rfc3339;
use crate::http::extract::body::JsonBody;
use crate::http::state::AppState;
use plumbline_engine::hidden::evidence::GivenReceipt;
use plumbline_engine::hidden::receipts::ReceiptFile;

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

impl From<IssuedInstance> for InstanceBody {
    fn from(IssuedInstance { row, prompts }: IssuedInstance) -> Self {
        Self {
            id: row.id,
            entry: row.entry_id,
            run: row.run,
            prompts,
            issued_at: rfc3339(row.issued_at_ms),
            expires_at: rfc3339(row.expires_at_ms),
            answered: row.submission_id.is_some(),
            log_sha256: row.log_hash,
            transcript_sha256: row.transcript_hash,
            transcript_checked_at: row.transcript_checked_ms.map(rfc3339),
        }
    }
}

/// Returns an instance.
///
/// Only a key of the instance's owner may read it.
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
    Ok(Json(instances::instance(&state, &caller, &id).await?.into()))
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

impl AnswerTaken {
    /// Tells the answer to an instance.
    #[must_use]
    pub fn of(instance: String, answer: AcceptedAnswer) -> Self {
        let AcceptedAnswer { log_sha256, is_repeated, receipt, action_code } = answer;
        Self { instance, log_sha256, repeated: is_repeated, receipt, action_code }
    }
}

/// Answers an instance.
///
/// One log is the answer. Format errors are reported in full and cost nothing. Once a log is accepted, a different log
/// is rejected.
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
    let JsonBody { bytes, format, share: _share } = body;
    let answer = instances::answer_instance(&state, &caller, &id, bytes, format).await?;
    Ok((StatusCode::ACCEPTED, Json(AnswerTaken::of(id, answer))).into_response())
}

/// Checks a promised transcript.
///
/// The transcript was promised with an answer, and can be shown while the epoch is open. The service compares its
/// SHA-256 and stores nothing of it.
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
    Ok(Json(instances::check_transcript(&state, &caller, &id, &body.bytes).await?.into()))
}

/// Returns the report of a revealed instance.
///
/// The specification comes with it, after the epoch is over.
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
    let RevealedGrade { task, report } = instances::revealed_grade(&state, &id).await?;
    Ok(Json(serde_json::json!({ "task": task, "report": report.report, "grader": report.grader,
                                "graded_at": rfc3339(report.graded_at_ms) })))
}

/// Returns the receipt of an instance's grade.
///
/// While the epoch is open, only its hash and its position in the log are shown, and the whole receipt afterwards.
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
    Ok(Json(instances::receipt_of_instance(&state, &id).await?))
}
