//! Ranges of ranks that runs may have, as far as the data tell.
//!
//! All pairs of runs on a board are compared. Of these comparisons Holm's procedure (Scandinavian Journal of Statistics
//! 6, 1979, 65-70) keeps those that show a difference, with a risk of at most 5 % that any of them is wrong. A run
//! ranks below the runs shown to be better and above those shown to be worse; among the rest it may have any rank.

use serde::Serialize;

use super::ALPHA;
use super::comparison::McNemar;

/// Range of ranks that a run may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct RankRange {
    /// Best rank, from 1.
    #[schema(example = 1)]
    pub first: usize,
    /// Worst rank.
    #[schema(example = 3)]
    pub last: usize,
}

/// Returns the greatest p-value that Holm's procedure keeps out of `comparisons` comparisons, or -1 if it keeps none.
/// `values` holds each p-value with its number of comparisons, the smallest p-value first.
fn greatest_kept(comparisons: u64, values: impl Iterator<Item = (f64, u64)>) -> f64 {
    let (mut kept, mut greatest) = (0, -1.0);
    for (p, number) in values.filter(|(_, number)| *number > 0) {
        // Of equal p-values the first has the strictest bound.
        if p > ALPHA / (comparisons - kept) as f64 {
            break;
        }
        kept += number;
        greatest = p;
    }
    greatest
}

/// Returns the greatest of these p-values that Holm's procedure keeps, or -1 if it keeps none.
#[must_use]
pub fn threshold(mut p_values: Vec<f64>) -> f64 {
    p_values.sort_by(f64::total_cmp);
    greatest_kept(p_values.len() as u64, p_values.into_iter().map(|p| (p, 1)))
}

/// Returns the range of ranks of a run that was compared with each other run. A comparison says whether the other run
/// is better, and gives the p-value, which shows a difference if it is at most `threshold`.
#[must_use]
pub fn range(comparisons: impl Iterator<Item = (bool, f64)>, threshold: f64) -> RankRange {
    let (mut others, mut better, mut worse) = (0, 0, 0);
    for (is_better, p) in comparisons {
        others += 1;
        if p <= threshold {
            better += usize::from(is_better);
            worse += usize::from(!is_better);
        }
    }
    RankRange { first: 1 + better, last: 1 + others - worse }
}

/// Counts how often each p-value results from comparing the runs of a board, so that a new run costs one comparison
/// with each other run instead of comparing all pairs again.
#[derive(Debug, Clone, Default)]
pub struct Comparisons {
    all: u64,
    /// Number of comparisons that result in each p-value, by its index in the test.
    numbers: Vec<u32>,
}

impl Comparisons {
    /// Adds a comparison, or takes it back if `is_new` is false.
    pub fn count(&mut self, test: &McNemar, one: usize, other: usize, is_new: bool) {
        self.numbers.resize(test.distinct(), 0);
        let number = &mut self.numbers[test.number_of(one, other)];
        if is_new {
            (self.all, *number) = (self.all + 1, *number + 1);
        } else {
            (self.all, *number) = (self.all - 1, *number - 1);
        }
    }

    /// Returns the greatest p-value that Holm's procedure keeps, or -1 if it keeps none.
    #[must_use]
    pub fn threshold(&self, test: &McNemar) -> f64 {
        if self.all == 0 {
            return -1.0;
        }
        greatest_kept(self.all, test.ascending().map(|(p, number)| (p, u64::from(self.numbers[number]))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 0.01, 0.04, 0.03, 0.005 at 5 %, with bounds 0.05/4, 0.05/3, 0.05/2, 0.05: 0.005 and 0.01 are kept, and 0.03 >
    /// 0.025 ends it, although 0.04 < 0.05 (the worked example of Wikipedia's article on the procedure).
    #[test]
    fn holms_procedure_ends_at_the_first_that_is_too_large() {
        assert_eq!(threshold(vec![0.01, 0.04, 0.03, 0.005]), 0.01);
        assert_eq!(threshold(vec![0.5, 0.05]), -1.0);
        assert_eq!(threshold(vec![]), -1.0);
        let comparisons = [(true, 0.01), (false, 0.04), (true, 0.03), (false, 0.005)];
        assert_eq!(range(comparisons.into_iter(), 0.01), RankRange { first: 2, last: 4 });
        assert_eq!(range([].into_iter(), -1.0), RankRange { first: 1, last: 1 });
    }

    #[test]
    fn counted_p_values_give_the_same_threshold() {
        let test = McNemar::up_to(100);
        let splits = [(0, 30), (2, 30), (5, 20), (10, 14), (8, 1), (0, 30), (12, 3)];
        let mut counted = Comparisons::default();
        for (one, other) in splits {
            counted.count(&test, one, other, true);
        }
        let plainly = |splits: &[(usize, usize)]| threshold(splits.iter().map(|(a, b)| test.p_value(*a, *b)).collect());
        assert_eq!(counted.threshold(&test), plainly(&splits));
        counted.count(&test, 2, 30, false);
        assert_eq!(counted.threshold(&test), plainly(&[&splits[..1], &splits[2..]].concat()));
        assert!(counted.threshold(&test) > 0.0);
    }
}
