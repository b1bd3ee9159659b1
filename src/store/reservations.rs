//! Shares of an epoch's pool: runs that were drawn, and runs that are reserved for a limited time.

use super::StoreResult;
use super::db::{Tx, query_as};
use super::epochs::EpochRow;
use super::rows::from_row;
use plumbline_engine::hidden::feedback::Tier;

/// Share of the pool that an entry holds, in runs.
#[derive(Debug)]
struct Held {
    id: String,
    owner: String,
    is_dev: bool,
    drawn: i64,
    reserved: i64,
}

from_row!(Held { id, owner, is_dev, drawn, reserved });

/// Shares of all entries of an epoch.
#[derive(Debug)]
pub(super) struct Holdings(Vec<Held>);

/// Result of checking whether there is room for more runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Room {
    Enough,
    PoolUsedUp,
    /// The runs would exceed the maximum number that one owner may hold, which is given.
    ShareUsedUp(i64),
}

/// Returns the shares that the entries of an epoch hold now. A run that is not drawn is reserved until the entry is
/// finalized or the reservation ends.
pub(super) async fn held_in(tx: &mut Tx, epoch: &EpochRow, now_ms: i64) -> StoreResult<Holdings> {
    let rows = query_as(
        "SELECT e.id, e.owner, e.tier = 'dev' AS is_dev, d.drawn,
                CASE WHEN e.finalized_at_ms IS NULL AND ($2 IS NULL OR e.registered_at_ms + $2 > $3) THEN e.runs - d.drawn ELSE 0 END
                    AS reserved
         FROM entries e JOIN (SELECT n.id, COUNT(DISTINCT i.run) AS drawn
                              FROM entries n LEFT JOIN instances i ON i.entry_id = n.id
                              WHERE n.epoch_id = $1 GROUP BY n.id) d ON d.id = e.id",
    )
    .bind(epoch.id())
    .bind(epoch.rules.reservation_ms)
    .bind(now_ms)
    .fetch_all(tx)
    .await?;
    Ok(Holdings(rows))
}

impl Holdings {
    fn sum(&self, counts: impl Fn(&Held) -> bool) -> i64 {
        self.0.iter().filter(|held| counts(held)).map(|held| held.drawn + held.reserved).sum()
    }

    /// Checks whether this many more runs fit into the pool, half of which is kept for the official tier, and into the
    /// owner's share.
    pub fn room_for(&self, owner: &str, tier: Tier, runs: i64, epoch: &EpochRow) -> Room {
        let all = i64::from(epoch.commitment.per_instance);
        if let Some(most) = epoch.rules.owner_runs
            && self.sum(|held| held.owner == owner) + runs > most
        {
            return Room::ShareUsedUp(most);
        }
        let is_dev_full = tier == Tier::Dev && self.sum(|held| held.is_dev) + runs > all - all / 2;
        if is_dev_full || self.sum(|_| true) + runs > all { Room::PoolUsedUp } else { Room::Enough }
    }

    /// Returns whether an entry still has a reserved run.
    pub fn has_reserved(&self, entry_id: &str) -> bool {
        self.0.iter().any(|held| held.id == entry_id && held.reserved > 0)
    }
}
