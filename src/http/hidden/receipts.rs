//! Receipts: the public log of grades, and the key that verifies it.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use crate::app::error::{AppError, AppResult};
use crate::clock::now_ms;
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::params::Params;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use plumbline_engine::hidden::receipts::{LogHead, LogPage, ReceiptFile};

/// Which receipts.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LogQuery {
    /// Only receipts after this place in the log: the page after.
    #[param(minimum = 0)]
    after: Option<i64>,
    /// Receipts on a page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
}

/// The public log of receipts, from the first. Of hidden instances of open epochs hash and link alone are told.
#[utoipa::path(
    get, path = "/v1/receipts", operation_id = "list_receipts", tag = "receipts", summary = "Read the log of receipts",
    params(LogQuery),
    responses(
        (status = 200, description = "A page of the log", body = LogPage, example = json!({ "receipts": [], "next_after": null, "head": null })),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn list_receipts(State(state): State<AppState>, Params(query): Params<LogQuery>) -> AppResult<Json<LogPage>> {
    let items = page_items(query.limit, 100)?;
    // The end first: what is entered in between is on the next page.
    let (size, link) = state.store.log_end().await?;
    let mut receipts = state.store.receipts(query.after.unwrap_or(0), items as i64 + 1).await?;
    receipts.retain(|receipt| receipt.seq <= size);
    let has_more = receipts.len() > items;
    receipts.truncate(items);
    let next_after = receipts.last().filter(|_| has_more).map(|last| last.seq);
    let head = Some(LogHead::signed(size, link, now_ms(), &state.signer));
    Ok(Json(LogPage { receipts, next_after, head }))
}

/// The receipt of a submission's latest grade by a worker (a regrade makes none): `plumbline verify-receipt` checks it without the service.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/receipt", operation_id = "get_receipt", tag = "receipts", summary = "Get a submission's receipt",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The receipt", body = ReceiptFile,
         example = json!({ "seq": 1, "receipt": { "overall": true }, "hash": "2c26b46b…", "signature": "b5bb9d80…" })),
        (status = 404, description = "There is no such submission, or it has no receipt yet", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_receipt(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<ReceiptFile>> {
    crate::http::submissions::state::stored(&state, &id).await?;
    let receipt = state.store.receipt_of(&id).await?.map(|receipt| receipt.with_place(&state.signer));
    let missing =
        || AppError::not_found("the submission has no receipt: it is not graded, or was before receipts were kept");
    Ok(Json(receipt.ok_or_else(missing)?))
}

/// The keys that verify receipts, in hexadecimal.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReceiptKeys {
    /// The one in use: Ed25519.
    pub public_key: String,
    /// All that receipts in the log were signed with, the first first.
    pub all: Vec<String>,
}

/// The public keys of this service's receipts.
#[utoipa::path(
    get, path = "/.well-known/plumbline-receipts.json", operation_id = "get_receipt_keys", tag = "receipts",
    summary = "Public keys of receipts",
    responses(
        (status = 200, description = "The keys", body = ReceiptKeys, example = json!({ "public_key": "d75a9801…", "all": ["d75a9801…"] })),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_receipt_keys(State(state): State<AppState>) -> AppResult<Json<ReceiptKeys>> {
    let mut all = state.store.receipt_keys().await?;
    let public_key = state.signer.public_key();
    if !all.contains(&public_key) {
        all.push(public_key.clone());
    }
    Ok(Json(ReceiptKeys { public_key, all }))
}
