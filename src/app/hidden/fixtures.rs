//! Rows with which the unit tests of the rules begin.

use crate::store::entries::EntryRow;
use crate::store::epochs::{EpochRow, EpochRules};
use crate::store::holdings::Holding;
use plumbline_engine::hidden::commitment::Commitment;
use plumbline_engine::hidden::feedback::{Feedback, Tier};

/// Time at which the epoch opens.
pub const OPENS_AT_MS: i64 = 1_000;
/// Time at which the epoch closes.
pub const CLOSES_AT_MS: i64 = 100_000;

/// Returns an epoch with 8 specifications for each instance, in which an owner may hold 5 runs, each reserved for 500
/// ms.
pub fn epoch() -> EpochRow {
    EpochRow {
        commitment: Commitment {
            epoch: "epoch".to_owned(),
            opens_at_ms: OPENS_AT_MS,
            closes_at_ms: CLOSES_AT_MS,
            generator_version: 1,
            checks_version: 1,
            key_hash: String::new(),
            draw_key: Some(String::new()),
            root: None,
            beacon: None,
            per_instance: 8,
            specifications: 24,
            instances_per_run: 3,
            dev_feedback: Feedback::ScoreOnly,
            rules: None,
            siblings: None,
        },
        rules: EpochRules {
            instance_ms: 10_000,
            dev_entries: 3,
            official_entries: 2,
            budget_bits: 10.0,
            owner_runs: Some(5),
            reservation_ms: Some(500),
        },
        released_bits: 0.0,
        created_at_ms: 0,
        closed: None,
        pool: None,
        settled_at_ms: None,
    }
}

/// Returns an entry of two runs that `owner` has registered when the epoch opened.
pub fn entry(id: &str, owner: &str, tier: Tier) -> EntryRow {
    EntryRow {
        id: id.to_owned(),
        epoch_id: "epoch".to_owned(),
        owner: owner.to_owned(),
        agent: "agent".to_owned(),
        configuration_hash: "configuration".to_owned(),
        tier,
        runs: 2,
        registered_at_ms: OPENS_AT_MS,
        finalized_at_ms: None,
        completed_at_ms: None,
    }
}

/// Returns the runs that an entry holds that was registered when the epoch opened.
pub fn holding(entry_id: &str, owner: &str, tier: Tier, runs: i64, drawn: i64) -> Holding {
    Holding {
        entry_id: entry_id.to_owned(),
        owner: owner.to_owned(),
        is_dev: tier == Tier::Dev,
        runs,
        drawn,
        registered_at_ms: OPENS_AT_MS,
        is_finalized: false,
    }
}
