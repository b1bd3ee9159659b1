//! What operators see of the whole service: the queue, keys and quotas.

use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::AppResult;
use crate::clock::now_ms;
use crate::store::keys::{KeyRow, Scope};
use crate::store::overview::QueueRow;
use crate::store::quota::QuotaRow;

/// Greatest number of rows of each list.
pub const MAX_LISTED: usize = 200;

/// Overview of the service.
#[derive(Debug)]
pub struct Overview {
    /// What waits and runs, by lane and owner, without answers to hidden instances.
    pub queue: Vec<QueueRow>,
    /// Keys that may be used now, the latest used first.
    pub keys: Vec<KeyRow>,
    /// Number of all keys that may be used now.
    pub live_keys: usize,
    /// Quotas, those in use first.
    pub quotas: Vec<QuotaRow>,
}

/// Returns the overview of the service for an operator.
///
/// # Errors
/// Returns an error if the caller is no operator, or if the database fails.
pub async fn overview(app: &App, caller: &Caller) -> AppResult<Overview> {
    caller.require(Scope::Admin)?;
    let now = now_ms();
    let mut keys: Vec<KeyRow> = app.store.keys().await?.into_iter().filter(|key| key.is_live(now)).collect();
    keys.sort_by_key(|key| std::cmp::Reverse((key.last_used_at_ms, key.created_at_ms)));
    let live_keys = keys.len();
    keys.truncate(MAX_LISTED);
    let (queue, quotas) =
        (app.store.queue_by_owner(now, MAX_LISTED as i64).await?, app.store.quotas(MAX_LISTED as i64).await?);
    Ok(Overview { queue, keys, live_keys, quotas })
}
