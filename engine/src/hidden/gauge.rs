//! The contamination gauge: how much better an agent solves public siblings than the hidden instances beside them.
//!
//! Each hidden instance of an official run is paired with a sibling of its family. The gap is the difference of the two
//! shares, with the interval of Agresti and Min for matched pairs (Statistics in Medicine 24, 2005, 729-740).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::grading::statistics::interval::Z;

/// The gap between public siblings and hidden instances of an agent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Gauge {
    /// Number of pairs: drawn instances, each with a sibling of its family. What was not answered counts as failed.
    pub pairs: u32,
    /// Number of siblings that were answered.
    pub public_answered: u32,
    /// Number of hidden instances that were answered.
    pub hidden_answered: u32,
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
    /// Lower bound. Above 0, the agent solves siblings better than hidden instances.
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

/// The outcome of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tried {
    /// Whether it is a sibling.
    pub is_sibling: bool,
    /// Whether it has an answer.
    pub is_answered: bool,
    /// Whether the answer passes.
    pub passes: bool,
}

impl Gauge {
    /// Computes the gauge from outcomes in the order of issue, each with its place. Returns `None` without pairs.
    #[must_use]
    pub fn of<'a>(outcomes: impl IntoIterator<Item = (Place<'a>, Tried)>) -> Option<Self> {
        let mut families: BTreeMap<Place<'a>, (Vec<Tried>, Vec<Tried>)> = BTreeMap::new();
        for (place, tried) in outcomes {
            let (public, hidden) = families.entry(place).or_default();
            if tried.is_sibling { public.push(tried) } else { hidden.push(tried) }
        }
        let pairs = || families.values().flat_map(|(public, hidden)| public.iter().zip(hidden));
        let passes: Vec<(bool, bool)> = pairs().map(|(public, hidden)| (public.passes, hidden.passes)).collect();
        let gauge = Self::of_pairs(&passes)?;
        let public_answered = pairs().filter(|(public, _)| public.is_answered).count() as u32;
        let hidden_answered = pairs().filter(|(_, hidden)| hidden.is_answered).count() as u32;
        Some(Self { public_answered, hidden_answered, ..gauge })
    }

    /// Computes the gauge from pairs that are all answered: whether the sibling passes, and whether the hidden instance
    /// does.
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
            public_answered: pairs.len() as u32,
            hidden_answered: pairs.len() as u32,
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
        // 10 pass both, 12 the sibling alone, 1 the hidden one alone, 3 neither: 26 pairs. By hand, with 28, 12.5 and
        // 1.5.
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
        let tried = |is_sibling, passes| Tried { is_sibling, is_answered: true, passes };
        let outcomes = [
            (place(1, "slabs"), tried(false, true)),
            (place(1, "slabs"), tried(true, true)),
            (place(1, "domes"), Tried { is_answered: false, ..tried(false, false) }),
            (place(1, "domes"), tried(true, true)),
            // Without a sibling there is no pair.
            (place(2, "slabs"), tried(false, true)),
        ];
        let found = Gauge::of(outcomes).unwrap();
        assert_eq!((found.pairs, found.public_passed, found.hidden_passed), (2, 2, 1));
        assert_eq!((found.public_answered, found.hidden_answered), (2, 1));
        assert_eq!(Gauge::of([]), None);
    }
}
