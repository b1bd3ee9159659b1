//! The contamination gauge: how much better an agent solves public siblings than the hidden instances beside them.
//!
//! Each hidden instance of an official run is paired with a sibling of its family. The gap is the difference of the two shares, with
//! the interval of Agresti and Min for matched pairs (Statistics in Medicine 24, 2005, 729-740).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Quantile of the normal distribution for a two-sided interval of 95 %.
const Z: f64 = 1.959_963_984_540_054;

/// The gap between public siblings and hidden instances of an agent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Gauge {
    /// Number of pairs: drawn instances, each with a sibling of its family. What was not answered counts as failed.
    pub pairs: u32,
    /// Number of siblings that pass.
    pub public_passed: u32,
    /// Number of hidden instances that pass.
    pub hidden_passed: u32,
    /// Share of siblings that pass minus share of hidden instances that pass.
    #[schema(minimum = -1, maximum = 1)]
    pub gap: f64,
    /// 95 % confidence interval of the gap.
    pub interval: GapInterval,
}

/// Bounds of the 95 % confidence interval of a gap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct GapInterval {
    /// Lower bound. Above 0, the agent solves public builds better than hidden ones.
    #[schema(minimum = -1, maximum = 1, example = 0.08)]
    pub low: f64,
    /// Upper bound.
    #[schema(minimum = -1, maximum = 1, example = 0.49)]
    pub high: f64,
}

/// Where an outcome belongs: two of the same place make a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place<'a> {
    /// Identifier of the entry.
    pub entry: &'a str,
    /// Number of the run within the entry, from 1.
    pub run: u32,
    /// Name of the family.
    pub family: &'a str,
}

/// Outcomes of the hidden instances and siblings of one family in one run.
#[derive(Debug, Default)]
struct Family {
    hidden: Vec<bool>,
    public: Vec<bool>,
}

impl Gauge {
    /// Computes the gauge from outcomes in the order of issue, each with its place, whether it is a sibling, and whether it passes.
    /// Returns `None` without pairs.
    #[must_use]
    pub fn of<'a>(outcomes: impl IntoIterator<Item = (Place<'a>, bool, bool)>) -> Option<Self> {
        let mut families: BTreeMap<Place<'a>, Family> = BTreeMap::new();
        for (place, is_sibling, passes) in outcomes {
            let own = families.entry(place).or_default();
            if is_sibling { own.public.push(passes) } else { own.hidden.push(passes) }
        }
        let pairs: Vec<(bool, bool)> =
            families.into_values().flat_map(|own| own.public.into_iter().zip(own.hidden)).collect();
        Self::of_pairs(&pairs)
    }

    /// Computes the gauge from pairs: whether the sibling passes, and whether the hidden instance does.
    #[must_use]
    pub fn of_pairs(pairs: &[(bool, bool)]) -> Option<Self> {
        let count =
            |of: &dyn Fn(bool, bool) -> bool| pairs.iter().filter(|(public, hidden)| of(*public, *hidden)).count();
        if pairs.is_empty() {
            return None;
        }
        let (public_passed, hidden_passed) = (count(&|public, _| public), count(&|_, hidden| hidden));
        let only_public = count(&|public, hidden| public && !hidden) as f64;
        let only_hidden = count(&|public, hidden| hidden && !public) as f64;
        let of = pairs.len() as f64;
        let gap = (only_public - only_hidden) / of;
        // Half a pair is added to each of the four cells, which keeps the interval honest where pairs are few.
        let (of, sum, difference) = (of + 2.0, only_public + only_hidden + 1.0, only_public - only_hidden);
        let half = Z * (sum - difference * difference / of).sqrt() / of;
        let interval = GapInterval { low: (difference / of - half).max(-1.0), high: (difference / of + half).min(1.0) };
        Some(Self {
            pairs: pairs.len() as u32,
            public_passed: public_passed as u32,
            hidden_passed: hidden_passed as u32,
            gap,
            interval,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_the_four_cells_with_half_a_pair_each() {
        // 10 pass both, 12 the sibling alone, 1 the hidden one alone, 3 neither: 26 pairs. By hand, with 28, 12.5 and 1.5.
        let cells = [((true, true), 10), ((true, false), 12), ((false, true), 1), ((false, false), 3)];
        let pairs: Vec<(bool, bool)> = cells.iter().flat_map(|(pair, count)| vec![*pair; *count]).collect();
        let found = Gauge::of_pairs(&pairs).unwrap();
        assert_eq!((found.pairs, found.public_passed, found.hidden_passed), (26, 22, 11));
        assert!((found.gap - 11.0 / 26.0).abs() < 1e-12);
        let half = 1.959_964 * ((14.0_f64 - 121.0 / 28.0).sqrt() / 28.0);
        assert!((found.interval.low - (11.0 / 28.0 - half)).abs() < 1e-6);
        assert!((found.interval.high - (11.0 / 28.0 + half)).abs() < 1e-6);
    }

    #[test]
    fn instances_are_paired_within_run_and_family() {
        let place = |run, family| Place { entry: "e", run, family };
        let outcomes = [
            (place(1, "slabs"), false, true),
            (place(1, "slabs"), true, true),
            (place(1, "domes"), false, false),
            (place(1, "domes"), true, true),
            // Without a sibling there is no pair.
            (place(2, "slabs"), false, true),
        ];
        let found = Gauge::of(outcomes).unwrap();
        assert_eq!((found.pairs, found.public_passed, found.hidden_passed), (2, 2, 1));
        assert_eq!(Gauge::of([]), None);
    }
}
