//! `/v1/quota`: what the caller may submit and has submitted.

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};

use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::clock::rfc3339;
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::params::Params;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::keys::Scope;
use crate::store::quota::QuotaEntry;

/// Which part of whose ledger.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct QuotaQuery {
    /// Another owner's, for keys with the scope admin.
    owner: Option<String>,
    /// Only entries with a smaller id: the page after.
    before: Option<i64>,
    /// Entries on a page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
}

/// A quota, in submissions, with the latest of its ledger.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct QuotaBody {
    /// Whose; null where the service is open and no key was sent: then nothing is counted.
    pub owner: Option<String>,
    /// Granted in all; null: as much as they like.
    pub granted: Option<i64>,
    /// Reserved or charged before the first grant, which begins to count then.
    pub used_before_first_grant: i64,
    /// Waiting or being graded. Becomes charged or is given back.
    #[schema(minimum = 0)]
    pub reserved: i64,
    /// Graded and released.
    #[schema(minimum = 0)]
    pub charged: i64,
    /// What may still be submitted; null: as much as they like.
    #[schema(minimum = 0)]
    pub left: Option<i64>,
    /// The ledger, the newest first.
    pub entries: Vec<QuotaEntryBody>,
    /// `before` of the next page; null on the last.
    pub next_before: Option<i64>,
}

/// What a row of the ledger is.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LedgerKind {
    /// More may be submitted, or less.
    Grant,
    /// A submission was accepted.
    Reserve,
    /// Its report was released.
    Charge,
    /// It ended without one.
    Refund,
}

/// A row of the ledger.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct QuotaEntryBody {
    /// Its id.
    pub id: i64,
    /// `grant`, `reserve`, `charge` or `refund`.
    #[schema(value_type = LedgerKind, example = "charge")]
    pub kind: String,
    /// How many submissions.
    pub units: i64,
    /// The submission; null for a grant.
    #[schema(format = Uuid)]
    pub submission: Option<String>,
    /// Why.
    #[schema(example = "graded, and the report released")]
    pub reason: String,
    /// When.
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

/// What the caller's owner may submit and has submitted, as a ledger: a submission is reserved when it is accepted, charged
/// when its report is released, and given back where it ends without one, by whatever failure or because it was cancelled.
/// `/v1/grade` and `/v1/validate` are not counted.
#[utoipa::path(
    get, path = "/v1/quota", operation_id = "get_quota", tag = "service", summary = "Quota",
    security(("key" = [])),
    params(QuotaQuery),
    responses(
        (status = 200, description = "The quota", body = QuotaBody,
         example = json!({ "owner": "lab", "granted": 10_000, "used_before_first_grant": 0, "reserved": 2, "charged": 723, "left": 9_275,
                           "entries": [], "next_before": null })),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 401, description = "No key, or none that is live", body = Problem, content_type = "application/problem+json"),
        (status = 403, description = "Another owner's", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_quota(
    State(state): State<AppState>,
    caller: Caller,
    Params(query): Params<QuotaQuery>,
) -> AppResult<Json<QuotaBody>> {
    let items = page_items(query.limit, 100)?;
    let own = caller.owner().map(str::to_owned);
    if query.owner.is_some() && query.owner != own {
        caller.require(Scope::Admin)?;
    }
    let Some(owner) = query.owner.or(own) else {
        let nothing = QuotaBody {
            owner: None,
            granted: None,
            used_before_first_grant: 0,
            reserved: 0,
            charged: 0,
            left: None,
            entries: Vec::new(),
            next_before: None,
        };
        return Ok(Json(nothing));
    };
    let quota = state.store.quota(&owner).await?;
    let before = query.before.unwrap_or(i64::MAX);
    let mut entries = state.store.quota_entries(&owner, before, items as i64 + 1).await?;
    let has_more = entries.len() > items;
    entries.truncate(items);
    let next_before = entries.last().filter(|_| has_more).map(|entry| entry.id);
    let left = quota.left();
    Ok(Json(QuotaBody {
        owner: Some(quota.owner),
        granted: quota.granted,
        used_before_first_grant: quota.used_before,
        reserved: quota.reserved,
        charged: quota.charged,
        left,
        entries: entries.into_iter().map(QuotaEntryBody::from).collect(),
        next_before,
    }))
}
