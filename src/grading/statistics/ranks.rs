//! Places that a run may have, as far as the data tell.
//!
//! A run is compared with every other one; of these comparisons Holm's procedure (Scandinavian Journal of Statistics 6, 1979,
//! 65-70) keeps those that show a difference, with at most 5 % risk that any of them is wrong. Those shown to be better come
//! before it, those shown to be worse after it, and among the rest it may have any place (Mogstad, Romano, Shaikh and Wilhelm,
//! Inference for Ranks, Review of Economic Studies 91, 2024).

use serde::Serialize;

use super::ALPHA;

/// First and last place that a run may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct RankRange {
    /// The best place, from 1.
    #[schema(example = 1)]
    pub first: usize,
    /// The worst.
    #[schema(example = 3)]
    pub last: usize,
}

/// The places of a run that was compared with each other one: whether that one is better, and the p-value.
#[must_use]
pub fn range(comparisons: impl ExactSizeIterator<Item = (bool, f64)>) -> RankRange {
    let others = comparisons.len();
    // Beyond the level none can be kept.
    let mut small: Vec<(f64, bool)> = comparisons.filter(|(_, p)| *p <= ALPHA).map(|(better, p)| (p, better)).collect();
    small.sort_by(|a, b| a.0.total_cmp(&b.0));
    let kept = small.iter().enumerate().take_while(|(k, (p, _))| *p <= ALPHA / (others - k) as f64).count();
    let better = small[..kept].iter().filter(|(_, better)| *better).count();
    RankRange { first: 1 + better, last: 1 + others - (kept - better) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 0.01, 0.04, 0.03, 0.005 at 5 %, with bounds 0.05/4, 0.05/3, 0.05/2, 0.05: 0.005 and 0.01 are kept, and 0.03 > 0.025
    /// ends it, though 0.04 < 0.05 (the worked example of Wikipedia's article on the procedure).
    #[test]
    fn holms_procedure_ends_at_the_first_that_is_too_large() {
        let comparisons = [(true, 0.01), (false, 0.04), (true, 0.03), (false, 0.005)];
        assert_eq!(range(comparisons.into_iter()), RankRange { first: 2, last: 4 });
    }

    #[test]
    fn without_differences_any_place_is_possible() {
        assert_eq!(range([(true, 0.5), (false, 0.05)].into_iter()), RankRange { first: 1, last: 3 });
        assert_eq!(range([].into_iter()), RankRange { first: 1, last: 1 });
        assert_eq!(range([(true, 1e-9), (true, 1e-9)].into_iter()), RankRange { first: 3, last: 3 });
    }
}
