//! Quotas of submissions, and their ledgers.

use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::app::paging::{Page, page_items};
use crate::store::keys::Scope;
use crate::store::quota::{QuotaEntry, QuotaRow};

/// A quota with a page of its ledger.
#[derive(Debug)]
pub struct QuotaPage {
    /// Quota and use.
    pub quota: QuotaRow,
    /// Entries of the ledger, newest first.
    pub entries: Page<QuotaEntry>,
}

/// Returns the quota of an owner, by default the caller's, with the entries before entry `before`. There is none if the
/// service is open and no key was sent, in which case nothing is counted.
///
/// # Errors
/// Returns an error if `limit` is out of range, if the quota is another owner's and the caller is no operator, or if
/// the database fails.
pub async fn quota(
    app: &App,
    caller: &Caller,
    owner: Option<String>,
    before: Option<i64>,
    limit: Option<u32>,
) -> AppResult<Option<QuotaPage>> {
    let items = page_items(limit, 100)?;
    let own = caller.owner().map(str::to_owned);
    if owner.is_some() && owner != own {
        caller.require(Scope::Admin)?;
    }
    let Some(owner) = owner.or(own) else { return Ok(None) };
    let quota = app.store.quota(&owner).await?;
    let entries = app.store.quota_entries(&owner, before.unwrap_or(i64::MAX), items as i64 + 1).await?;
    Ok(Some(QuotaPage { quota, entries: Page::of(entries, items) }))
}
