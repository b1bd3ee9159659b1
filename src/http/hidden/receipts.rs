//! Receipts: the public log of grades, and the keys that verify it.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use crate::app::error::AppResult;
use crate::app::hidden::receipts::{self, VerifyingKeys};
use crate::app::paging::page_items;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::hidden::receipts::{LogPage, ReceiptFile};

/// Query of the log of receipts.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LogQuery {
    /// Only receipts after this position in the log, for paging.
    #[param(minimum = 0)]
    after: Option<i64>,
    /// Maximum number of receipts on the page.
    #[param(minimum = 1)]
    limit: Option<u32>,
}

/// Lists the public log of receipts in order.
///
/// For hidden instances of open epochs, only hash and link are shown.
#[utoipa::path(
    get, path = "/v1/receipts", operation_id = "list_receipts", tag = "receipts", summary = "List receipts",
    params(LogQuery),
    responses(
        (status = 200, description = "A page of the log", body = LogPage, example = json!({ "receipts": [], "next_after": null, "head": null })),
    )
)]
pub async fn list_receipts(State(state): State<AppState>, Params(query): Params<LogQuery>) -> AppResult<Json<LogPage>> {
    let items = page_items(query.limit, 100)?;
    Ok(Json(receipts::log_page(&state, query.after.unwrap_or(0), items).await?))
}

/// Returns the receipt of a submission's grade.
///
/// The receipt is that of the latest grade by a worker; a regrade creates no receipt. Check it offline with `plumbline
/// verify-receipt`.
#[utoipa::path(
    get, path = "/v1/submissions/{id}/receipt", operation_id = "get_receipt", tag = "receipts", summary = "Get a submission's receipt",
    params(("id" = String, Path, description = "The submission's id")),
    responses(
        (status = 200, description = "The receipt", body = ReceiptFile,
         example = json!({ "seq": 1, "receipt": { "overall": true }, "hash": "2c26b46b…", "signature": "b5bb9d80…" })),
    )
)]
pub async fn get_receipt(State(state): State<AppState>, Path(id): Path<String>) -> AppResult<Json<ReceiptFile>> {
    Ok(Json(receipts::receipt_of_submission(&state, &id).await?))
}

/// Public keys that verify receipts, in hex.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct ReceiptKeys {
    /// Ed25519 key in use.
    pub public_key: String,
    /// Keys of all receipts in the log and the key in use, in the order of first use.
    pub all: Vec<String>,
}

/// Returns the public keys of receipts.
///
/// The keys verify the receipts of this service.
#[utoipa::path(
    get, path = "/.well-known/plumbline-receipts.json", operation_id = "get_receipt_keys", tag = "receipts",
    summary = "Get the public keys of receipts",
    responses(
        (status = 200, description = "The keys", body = ReceiptKeys, example = json!({ "public_key": "d75a9801…", "all": ["d75a9801…"] })),
    )
)]
pub async fn get_receipt_keys(State(state): State<AppState>) -> AppResult<Json<ReceiptKeys>> {
    let VerifyingKeys { in_use, all } = receipts::verifying_keys(&state).await?;
    Ok(Json(ReceiptKeys { public_key: in_use, all }))
}
