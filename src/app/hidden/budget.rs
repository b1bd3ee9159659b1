//! The budget of released information: what the result of an entry costs, and when the budget closes an epoch.

use crate::store::epochs::EpochRow;
use plumbline_engine::hidden::feedback::{Tier, released_bits};

/// Published reason for closing an epoch whose budget is spent.
pub const BUDGET_SPENT: &str = "the budget of released information is spent";

/// Returns the bits that the result of an entry releases while its epoch is open.
#[must_use]
pub fn bits_of(epoch: &EpochRow, tier: Tier, answered: usize) -> f64 {
    released_bits(tier.feedback(epoch.commitment.dev_feedback), answered)
}

/// Returns whether releasing so many more bits spends the budget of the epoch. A result that releases nothing never
/// does.
#[must_use]
pub fn is_spent_by(epoch: &EpochRow, bits: f64) -> bool {
    bits > 0.0 && epoch.released_bits + bits >= epoch.rules.budget_bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::hidden::fixtures::epoch;
    use plumbline_engine::hidden::feedback::Feedback;

    #[test]
    fn only_what_is_told_before_the_end_costs_bits() {
        for (tier, dev_feedback, answered, is_free) in [
            (Tier::Official, Feedback::ScoreOnly, 10, true),
            (Tier::Dev, Feedback::AfterEpoch, 10, true),
            (Tier::Dev, Feedback::ScoreOnly, 0, true),
            (Tier::Dev, Feedback::ScoreOnly, 10, false),
            (Tier::Dev, Feedback::Criteria, 10, false),
        ] {
            let mut epoch = epoch();
            epoch.commitment.dev_feedback = dev_feedback;
            assert_eq!(bits_of(&epoch, tier, answered) == 0.0, is_free, "{tier:?} {dev_feedback:?} {answered}");
        }
    }

    #[test]
    fn the_epoch_closes_when_its_budget_is_reached() {
        // The budget is 10 bits.
        for (released_bits, bits, is_spent) in [
            (0.0, 9.9, false),
            (0.0, 10.0, true),
            (6.0, 3.9, false),
            (6.0, 4.0, true),
            (9.9, 0.0, false),
            // An epoch that is over its budget is not closed again by a result that releases nothing.
            (11.0, 0.0, false),
        ] {
            let epoch = EpochRow { released_bits, ..epoch() };
            assert_eq!(is_spent_by(&epoch, bits), is_spent, "{released_bits} {bits}");
        }
    }
}
