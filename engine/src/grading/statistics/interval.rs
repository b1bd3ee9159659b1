//! Confidence intervals of rates.
//!
//! These are Wilson's score intervals (Wilson 1927; method 3 of Newcombe, Statistics in Medicine 17, 1998, 857-872). If
//! answers depend on each other, as those to several wordings of one problem do, the intervals use the effective number
//! of problems: their number divided by the design effect (Kish 1965), which is the variance of the rate between
//! clusters divided by that of independent answers.

use serde::{Deserialize, Serialize};

/// Quantile of the normal distribution for a two-sided interval of 95 %.
const Z: f64 = 1.959_963_984_540_054;

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

    #[test]
    fn clusters_widen_the_interval_as_much_as_their_answers_agree() {
        let single: Vec<(f64, u32)> = (0..60).map(|i| (f64::from(u8::from(i % 3 == 0)), 1)).collect();
        assert_eq!(clustered(&single), wilson(20.0 / 60.0, 60.0), "clusters of one are independent answers");
        // The same answers three times: as many trials as there are clusters, but for the correction (60/59 to 180/179).
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
