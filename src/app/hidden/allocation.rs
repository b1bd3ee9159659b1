//! Allocation of an epoch's pool: which runs hold a share of it, and whether there is room for more.

use crate::store::epochs::EpochRow;
use crate::store::holdings::Holding;
use plumbline_engine::hidden::feedback::Tier;

/// Pool of an epoch at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Pool<'a> {
    /// The epoch.
    pub epoch: &'a EpochRow,
    /// Runs that its entries have registered and drawn.
    pub holdings: &'a [Holding],
    /// The moment, in milliseconds since 1970.
    pub now_ms: i64,
}

/// Reason why there is no room for more runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoRoom {
    /// The pool has too few specifications left for runs of this tier.
    PoolUsedUp,
    /// The runs would exceed the maximum number that one owner may hold, which is given.
    ShareUsedUp(i64),
}

impl Pool<'_> {
    /// Returns the number of runs for which an entry has a reservation. A run that is not drawn is reserved until the
    /// entry is finalized or the reservation ends.
    fn reserved(&self, holding: &Holding) -> i64 {
        let limit = self.epoch.rules.reservation_ms;
        // What is registered in advance can be drawn from the opening on.
        let EpochRow { commitment, pool, .. } = self.epoch;
        let pool_ms = pool.as_ref().map_or(i64::MIN, |pool| pool.made_at_ms);
        let from_ms = holding.registered_at_ms.max(commitment.opens_at_ms).max(pool_ms);
        let can_draw = commitment.beacon.is_none() || pool.is_some();
        let has_ended = can_draw && limit.is_some_and(|limit| from_ms + limit <= self.now_ms);
        if holding.is_finalized || has_ended { 0 } else { holding.runs - holding.drawn }
    }

    /// Returns the number of runs, drawn or reserved, of the entries that count.
    fn held(&self, counts: impl Fn(&Holding) -> bool) -> i64 {
        self.holdings.iter().filter(|held| counts(held)).map(|held| held.drawn + self.reserved(held)).sum()
    }

    /// Checks whether this many more runs fit into the pool, half of which is kept for the official tier, and into the
    /// owner's share.
    ///
    /// # Errors
    /// Returns the reason if they do not fit.
    pub fn room_for(&self, owner: &str, tier: Tier, runs: u32) -> Result<(), NoRoom> {
        let (all, runs) = (i64::from(self.epoch.commitment.per_instance), i64::from(runs));
        if let Some(most) = self.epoch.rules.owner_runs
            && self.held(|held| held.owner == owner) + runs > most
        {
            return Err(NoRoom::ShareUsedUp(most));
        }
        let is_dev_full = tier == Tier::Dev && self.held(|held| held.is_dev) + runs > all - all / 2;
        if is_dev_full || self.held(|_| true) + runs > all { Err(NoRoom::PoolUsedUp) } else { Ok(()) }
    }

    /// Returns whether an entry still has a reserved run.
    #[must_use]
    pub fn has_reserved(&self, entry_id: &str) -> bool {
        self.holdings.iter().any(|held| held.entry_id == entry_id && self.reserved(held) > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::{OPENS_AT_MS, epoch, holding};
    use Tier::{Dev, Official};

    #[test]
    fn runs_fit_into_the_pool_the_half_of_their_tier_and_the_share_of_their_owner() {
        let used_up = Err(NoRoom::PoolUsedUp);
        for (held, owner, tier, runs, expected) in [
            // A pool of 8 runs, 5 for each owner.
            (vec![], "a", Official, 5, Ok(())),
            (vec![], "a", Official, 6, Err(NoRoom::ShareUsedUp(5))),
            (vec![("a", Official, 3)], "a", Official, 2, Ok(())),
            (vec![("a", Official, 3)], "a", Official, 3, Err(NoRoom::ShareUsedUp(5))),
            (vec![("a", Dev, 3)], "a", Official, 3, Err(NoRoom::ShareUsedUp(5))),
            (vec![("b", Official, 4)], "a", Official, 4, Ok(())),
            (vec![("b", Official, 4)], "a", Official, 5, used_up),
            // Half of the pool is kept for the official tier.
            (vec![], "a", Dev, 4, Ok(())),
            (vec![], "a", Dev, 5, used_up),
            (vec![("b", Dev, 3)], "a", Dev, 1, Ok(())),
            (vec![("b", Dev, 3)], "a", Dev, 2, used_up),
            (vec![("b", Dev, 4)], "a", Official, 4, Ok(())),
            (vec![("b", Official, 5)], "a", Dev, 3, Ok(())),
            (vec![("b", Official, 5)], "a", Dev, 4, used_up),
        ] {
            let holdings: Vec<_> =
                held.iter().map(|(owner, tier, runs)| holding("e", owner, *tier, *runs, 0)).collect();
            let epoch = epoch();
            let pool = Pool { epoch: &epoch, holdings: &holdings, now_ms: OPENS_AT_MS };
            assert_eq!(pool.room_for(owner, tier, runs), expected, "{held:?} {owner} {tier:?} {runs}");
        }
    }

    #[test]
    fn the_official_tier_keeps_the_smaller_half_of_an_odd_pool() {
        let mut epoch = epoch();
        epoch.commitment.per_instance = 7;
        let pool = Pool { epoch: &epoch, holdings: &[], now_ms: OPENS_AT_MS };
        assert_eq!((pool.room_for("a", Dev, 4), pool.room_for("a", Dev, 5)), (Ok(()), Err(NoRoom::PoolUsedUp)));
    }

    #[test]
    fn a_reservation_ends_with_its_time_or_its_entry_and_drawn_runs_stay() {
        for (reservation_ms, passed_ms, is_finalized, drawn, reserved) in [
            (Some(500), 0, false, 0, 3),
            (Some(500), 499, false, 0, 3),
            (Some(500), 500, false, 0, 0),
            (Some(500), 0, true, 0, 0),
            (Some(500), 0, false, 1, 2),
            (Some(500), 500, false, 1, 0),
            (Some(500), 0, false, 3, 0),
            (None, 50_000, false, 1, 2),
            (None, 0, true, 1, 0),
        ] {
            let mut epoch = epoch();
            epoch.rules.reservation_ms = reservation_ms;
            let own = Holding { is_finalized, ..holding("own", "a", Official, 3, drawn) };
            let pool = Pool { epoch: &epoch, holdings: &[own], now_ms: OPENS_AT_MS + passed_ms };
            let case = format!("{reservation_ms:?} {passed_ms} {is_finalized} {drawn}");
            assert_eq!(pool.has_reserved("own"), reserved > 0, "{case}");
            assert_eq!(pool.held(|_| true), drawn + reserved, "{case}");
            assert!(!pool.has_reserved("other"), "{case}");
        }
    }

    #[test]
    fn epochs_older_than_the_rule_have_no_share_of_an_owner() {
        let mut epoch = epoch();
        epoch.rules.owner_runs = None;
        let pool = Pool { epoch: &epoch, holdings: &[], now_ms: OPENS_AT_MS };
        assert_eq!(
            (pool.room_for("a", Official, 8), pool.room_for("a", Official, 9)),
            (Ok(()), Err(NoRoom::PoolUsedUp))
        );
    }
}
