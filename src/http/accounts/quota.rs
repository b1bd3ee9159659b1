//! `/v1/quota`: the caller's quota of submissions, and its ledger.

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};

use crate::app::access::Caller;
use crate::app::accounts::quota::{QuotaPage, quota};
use crate::app::error::AppResult;
use crate::clock::rfc3339;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::quota::QuotaEntry;

/// Query of a quota.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct QuotaQuery {
    /// Owner of the quota; any owner but the caller requires the scope `admin`.
    owner: Option<String>,
    /// Only entries with a smaller identifier, for paging.
    before: Option<i64>,
    /// Maximum number of entries on the page.
    #[param(minimum = 1)]
    limit: Option<u32>,
}

/// A quota, counted in submissions, with a page of its ledger.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct QuotaBody {
    /// Owner of the quota; null if the service is open and the request had no key, in which case nothing is counted.
    pub owner: Option<String>,
    /// Total number of submissions granted; null for no limit.
    pub granted: Option<i64>,
    /// Submissions reserved or charged before the first grant; they do not count against it.
    pub used_before_first_grant: i64,
    /// Submissions that are queued or being graded; each is later charged or refunded.
    #[schema(minimum = 0)]
    pub reserved: i64,
    /// Submissions whose report was released.
    #[schema(minimum = 0)]
    pub charged: i64,
    /// Number of submissions left; null for no limit.
    #[schema(minimum = 0)]
    pub left: Option<i64>,
    /// Entries of the ledger, newest first.
    pub entries: Vec<QuotaEntryBody>,
    /// Value of `before` for the next page; null on the last page.
    pub next_before: Option<i64>,
}

/// Kind of a ledger entry.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LedgerKind {
    /// The quota was raised or lowered.
    Grant,
    /// A submission was accepted.
    Reserve,
    /// The report of a submission was released.
    Charge,
    /// A submission ended without a report.
    Refund,
}

/// An entry of the ledger.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct QuotaEntryBody {
    /// Identifier of the entry.
    pub id: i64,
    /// Kind of the entry: `grant`, `reserve`, `charge` or `refund`.
    #[schema(value_type = LedgerKind, example = "charge")]
    pub kind: String,
    /// Number of submissions.
    pub units: i64,
    /// Identifier of the submission; null for a grant, and for an answer to a hidden instance until its entry is complete.
    #[schema(format = Uuid)]
    pub submission: Option<String>,
    /// Reason for the entry.
    #[schema(example = "graded")]
    pub reason: String,
    /// Time of the entry.
    #[schema(format = DateTime)]
    pub at: String,
}

impl From<QuotaEntry> for QuotaEntryBody {
    fn from(entry: QuotaEntry) -> Self {
        Self {
            id: entry.id,
            kind: entry.kind,
            units: entry.units,
            submission: entry.submission_id,
            reason: entry.reason,
            at: rfc3339(entry.at_ms),
        }
    }
}

impl QuotaBody {
    /// Body for a caller without an owner, for whom nothing is counted.
    const NOTHING: Self = Self {
        owner: None,
        granted: None,
        used_before_first_grant: 0,
        reserved: 0,
        charged: 0,
        left: None,
        entries: Vec::new(),
        next_before: None,
    };
}

impl From<QuotaPage> for QuotaBody {
    fn from(QuotaPage { quota, entries }: QuotaPage) -> Self {
        Self {
            left: quota.left(),
            owner: Some(quota.owner),
            granted: quota.granted,
            used_before_first_grant: quota.used_before,
            reserved: quota.reserved,
            charged: quota.charged,
            next_before: entries.next(|entry| entry.id),
            entries: entries.items.into_iter().map(QuotaEntryBody::from).collect(),
        }
    }
}

/// Returns the quota of the caller's owner and its ledger.
///
/// A submission is reserved when it is accepted, charged when its report is released, and refunded if it ends without
/// a report because of any failure or a cancellation. `/v1/grade` and `/v1/validate` are not counted.
#[utoipa::path(
    get, path = "/v1/quota", operation_id = "get_quota", tag = "service", summary = "Get a quota",
    security(("key" = [])),
    params(QuotaQuery),
    responses(
        (status = 200, description = "The quota", body = QuotaBody,
         example = json!({ "owner": "lab", "granted": 10_000, "used_before_first_grant": 0, "reserved": 2, "charged": 723, "left": 9_275,
                           "entries": [], "next_before": null })),
        (status = 401, description = "No key, or none that is live"),
        (status = 403, description = "Another owner's"),
    )
)]
pub async fn get_quota(
    State(state): State<AppState>,
    caller: Caller,
    Params(query): Params<QuotaQuery>,
) -> AppResult<Json<QuotaBody>> {
    let QuotaQuery { owner, before, limit } = query;
    Ok(Json(match quota(&state, &caller, owner, before, limit).await? {
        Some(page) => page.into(),
        None => QuotaBody::NOTHING,
    }))
}
