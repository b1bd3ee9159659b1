//! Confidence intervals of rates.
//!
//! These are Wilson's score intervals (Wilson 1927; method 3 of Newcombe, Statistics in Medicine 17, 1998, 857-872). If
//! answers depend on each other, as those to several wordings of one problem do, the intervals use the effective number
//! of problems: their number divided by the design effect (Kish 1965), which is the variance of the rate between
//! clusters divided by that of independent answers.

use serde::{Deserialize, Serialize};

/// Quantile of the normal distribution for a two-sided interval of 95 %.
pub(crate) const Z: f64 = 1.959_963_984_540_054;

/// Bounds of the 95 % confidence interval of a rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Interval {
    /// Lower bound.
    #[schema(minimum = 0, maximum = 1, example = 0.36)]
    pub low: f64,
    /// Upper bound.
    #[schema(minimum = 0, maximum = 1, example = 0.43)]
    pub high: f64,
}

/// Returns Wilson's 95 % interval of a rate found in `trials` independent trials, or `None` without trials.
#[must_use]
pub fn wilson(rate: f64, trials: f64) -> Option<Interval> {
    if trials <= 0.0 {
        return None;
    }
    let square = Z * Z;
    let centre = rate + square / (2.0 * trials);
    let half = Z * (rate * (1.0 - rate) / trials + square / (4.0 * trials * trials)).sqrt();
    let scale = 1.0 + square / trials;
    // At 0 and 1 the bound is the rate itself, which rounding would miss.
    let low = if rate <= 0.0 { 0.0 } else { ((centre - half) / scale).max(0.0) };
    let high = if rate >= 1.0 { 1.0 } else { ((centre + half) / scale).min(1.0) };
    Some(Interval { low, high })
}

/// Returns the 95 % interval of a rate from clusters, each with its sum of passes and its number of trials.
///
/// If all pass or none does, the clusters do not show how much answers depend on each other, and each counts as one.
#[must_use]
pub fn clustered(clusters: &[(f64, u32)]) -> Option<Interval> {
    let pass: f64 = clusters.iter().map(|(pass, _)| pass).sum();
    let of: f64 = clusters.iter().map(|(_, of)| f64::from(*of)).sum();
    if of <= 0.0 {
        return None;
    }
    let rate = pass / of;
    wilson(rate, of / design_effect(clusters, rate, of))
}

fn design_effect(clusters: &[(f64, u32)], rate: f64, of: f64) -> f64 {
    let count = clusters.iter().filter(|(_, of)| *of > 0).count() as f64;
    let independent = rate * (1.0 - rate) * of;
    if independent <= 0.0 || count < 2.0 {
        return clusters.iter().map(|(_, of)| f64::from(*of).powi(2)).sum::<f64>() / of;
    }
    let between: f64 = clusters.iter().map(|(pass, of)| (pass - rate * f64::from(*of)).powi(2)).sum();
    // Both variances are corrected for the mean, which is estimated from the same data.
    let effect = (between * count / (count - 1.0)) / (independent * of / (of - 1.0));
    effect.max(1.0)
}

/// Returns an interval of a rate that holds at every look at once: whoever watches a board after each answer, and stops
/// when they like, is misled with a probability of at most `error` over all looks together.
///
/// It is the confidence sequence of the beta-binomial mixture (Robbins 1970, with a uniform prior), outward to a ten
/// thousandth. It is wider than [`wilson`], which holds for one look. Returns `None` without trials.
#[must_use]
pub fn anytime(passed: u32, of: u32, error: f64) -> Option<Interval> {
    const STEPS: u32 = 10_000;
    if of == 0 {
        return None;
    }
    let (pass, fail) = (f64::from(passed), f64::from(of - passed));
    let logarithms = |to: u32| (1..=to).map(|i| f64::from(i).ln()).sum::<f64>();
    let mixture = logarithms(passed) + logarithms(of - passed) - logarithms(of + 1);
    // A count of 0 contributes nothing, whatever the probability: 0 times the logarithm of 0 counts as 0.
    let term = |count: f64, of: f64| if count > 0.0 { count * of.ln() } else { 0.0 };
    let is_possible = |step: u32| {
        let rate = f64::from(step) / f64::from(STEPS);
        mixture - term(pass, rate) - term(fail, 1.0 - rate) < (1.0 / error).ln()
    };
    // The rate itself is possible, and the further from it, the less so.
    let middle = (u64::from(STEPS) * u64::from(passed) / u64::from(of)) as u32;
    let first = |mut impossible: u32, mut possible: u32| {
        while impossible.abs_diff(possible) > 1 {
            let between = u32::midpoint(impossible, possible);
            *(if is_possible(between) { &mut possible } else { &mut impossible }) = between;
        }
        f64::from(impossible) / f64::from(STEPS)
    };
    let low = if is_possible(0) { 0.0 } else { first(0, middle) };
    let high = if is_possible(STEPS) { 1.0 } else { first(STEPS, (middle + 1).min(STEPS)) };
    Some(Interval { low, high })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Newcombe 1998, table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    #[test]
    fn wilson_is_newcombes_method_3() {
        let published =
            [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)];
        for (pass, of, low, high) in published {
            let found = wilson(f64::from(pass) / f64::from(of), f64::from(of)).unwrap();
            assert!((found.low - low).abs() < 5e-5 && (found.high - high).abs() < 5e-5, "{pass}/{of}: {found:?}");
        }
        assert_eq!(wilson(0.0, 0.0), None);
    }

    /// By hand: all of 3 pass, the mixture is 1/4, and p³ must be more than 1/80: p > 0.2321.
    #[test]
    fn an_interval_for_every_look_is_that_of_the_mixture() {
        assert_eq!(anytime(3, 3, 0.05), Some(Interval { low: 0.2320, high: 1.0 }));
        assert_eq!(anytime(0, 3, 0.05), Some(Interval { low: 0.0, high: 0.7680 }));
        assert_eq!(anytime(0, 0, 0.05), None);
        let (few, many) = (anytime(6, 10, 0.05).unwrap(), anytime(600, 1_000, 0.05).unwrap());
        assert!(few.low < many.low && many.low < 0.6 && 0.6 < many.high && many.high < few.high, "{few:?} {many:?}");
        let one = wilson(0.6, 1_000.0).unwrap();
        assert!(many.low < one.low && one.high < many.high, "wider than for one look");
    }

    /// Watching after each of 2,000 answers: some look is misleading in 1 of 20 series at most, with Wilson's in far
    /// more.
    #[test]
    fn no_stopping_rule_beats_an_interval_for_every_look() {
        let mut state = 20_261_123_u64;
        let mut passes = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) < 0.6
        };
        let (mut misled, mut misled_by_wilson) = (0, 0);
        for _ in 0..200 {
            let (mut passed, mut always, mut once) = (0, false, false);
            for of in 1..=2_000_u32 {
                passed += u32::from(passes());
                if of % 10 == 0 {
                    always |= anytime(passed, of, 0.05).is_some_and(|own| own.low > 0.6);
                    once |= wilson(f64::from(passed) / f64::from(of), f64::from(of)).is_some_and(|own| own.low > 0.6);
                }
            }
            misled += i32::from(always);
            misled_by_wilson += i32::from(once);
        }
        assert!(misled <= 5 && misled_by_wilson >= 20, "{misled} and {misled_by_wilson} of 200");
    }

    #[test]
    fn clusters_widen_the_interval_as_much_as_their_answers_agree() {
        let single: Vec<(f64, u32)> = (0..60).map(|i| (f64::from(u8::from(i % 3 == 0)), 1)).collect();
        assert_eq!(clustered(&single), wilson(20.0 / 60.0, 60.0), "clusters of one are independent answers");
        // The same answers three times: as many trials as there are clusters, but for the correction (60/59 to
        // 180/179).
        let thrice: Vec<(f64, u32)> = single.iter().map(|(pass, of)| (3.0 * pass, 3 * of)).collect();
        let trials = 60.0 * (59.0 * 180.0) / (60.0 * 179.0);
        let (found, wanted) = (clustered(&thrice).unwrap(), wilson(1.0 / 3.0, trials).unwrap());
        assert!((found.low - wanted.low).abs() < 1e-12 && (found.high - wanted.high).abs() < 1e-12);
        // Answers that differ within clusters more than between them do not narrow it.
        assert_eq!(clustered(&[(1.0, 2); 3]), wilson(0.5, 6.0));
        assert_eq!(clustered(&[(3.0, 3); 20]), wilson(1.0, 20.0));
        assert_eq!(clustered(&[]), None);
    }
}
