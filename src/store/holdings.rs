//! Shares of an epoch's pool: the runs that its entries have registered and drawn.

use super::StoreResult;
use super::db::{Tx, query_as};
use super::rows::from_row;

/// Runs of an epoch's pool that one entry has registered and drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holding {
    /// Identifier of the entry.
    pub entry_id: String,
    /// Owner of the entry.
    pub owner: String,
    /// Whether the entry is in the dev tier.
    pub is_dev: bool,
    /// Number of registered runs.
    pub runs: i64,
    /// Number of drawn runs.
    pub drawn: i64,
    /// Time of registration, in milliseconds since 1970.
    pub registered_at_ms: i64,
    /// Whether the entrant has finalized the entry.
    pub is_finalized: bool,
}

from_row!(Holding { entry_id, owner, is_dev, runs, drawn, registered_at_ms, is_finalized });

/// Reads what the entries of an epoch hold, within the transaction.
pub(super) async fn holdings_in(tx: &mut Tx, epoch_id: &str) -> StoreResult<Vec<Holding>> {
    query_as(
        "SELECT e.id AS entry_id, e.owner, e.tier = 'dev' AS is_dev, e.runs, d.drawn, e.registered_at_ms,
                e.finalized_at_ms IS NOT NULL AS is_finalized
         FROM entries e JOIN (SELECT n.id, COUNT(DISTINCT i.run) AS drawn
                              FROM entries n LEFT JOIN instances i ON i.entry_id = n.id
                              WHERE n.epoch_id = $1 GROUP BY n.id) d ON d.id = e.id",
    )
    .bind(epoch_id)
    .fetch_all(tx)
    .await
}
