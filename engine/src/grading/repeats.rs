//! Repeats: several runs of one configuration, taken together.

use super::standings::{Field, Standing};
use super::statistics::interval::Interval;

/// Figures of several runs of one configuration.
///
/// With *c* of *n* runs that solve a problem, the chance that *k* runs drawn from them all solve it is
/// C(*c*, *k*) / C(*n*, *k*). `pass_all` has the means over the problems (pass^k: Yao et al. 2024, arXiv:2406.12045).
#[derive(Debug, Clone, PartialEq)]
pub struct Repeats {
    /// Mean of the runs' rates.
    pub mean: f64,
    /// 95 % interval of the mean over problems of this kind.
    pub interval: Option<Interval>,
    /// Sample standard deviation of the runs' rates.
    pub deviation: f64,
    /// Least rate of a run.
    pub least: f64,
    /// Greatest rate of a run.
    pub most: f64,
    /// Rates of problems that `k` runs all solve, for `k` from 1 to the number of runs.
    pub pass_all: Vec<PassAll>,
}

/// Rate of problems that a number of runs all solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassAll {
    /// Number of runs.
    pub k: usize,
    /// Rate of problems.
    pub rate: f64,
    /// 95 % interval of the rate over problems of this kind.
    pub interval: Option<Interval>,
}

impl Repeats {
    /// Computes the figures of runs of one suite, or returns `None` for fewer than two runs or without problems.
    #[must_use]
    pub fn of(runs: &[&Standing], field: &Field) -> Option<Self> {
        let problems = runs.first()?.outcomes.len();
        if runs.len() < 2 || problems == 0 {
            return None;
        }
        let count = runs.len() as f64;
        let solved = |place| runs.iter().filter(|run| run.outcomes.is_solved(place)).count();
        let solved: Vec<usize> = (0..problems).map(solved).collect();
        let pass_all = (1..=runs.len()).map(|k| {
            let chances: Vec<f64> = solved.iter().map(|solved| chance(*solved, runs.len(), k)).collect();
            PassAll {
                k,
                rate: chances.iter().sum::<f64>() / problems as f64,
                interval: field.interval_of_mean(&chances),
            }
        });
        let pass_all: Vec<PassAll> = pass_all.collect();
        let rate = |run: &&Standing| (0..problems).filter(|place| run.outcomes.is_solved(*place)).count() as f64;
        let rates: Vec<f64> = runs.iter().map(|run| rate(run) / problems as f64).collect();
        let mean = rates.iter().sum::<f64>() / count;
        let squares: f64 = rates.iter().map(|rate| (rate - mean).powi(2)).sum();
        Some(Self {
            mean,
            interval: pass_all[0].interval,
            deviation: (squares / (count - 1.0)).sqrt(),
            least: rates.iter().copied().fold(f64::INFINITY, f64::min),
            most: rates.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            pass_all,
        })
    }
}

/// Returns the chance that `k` runs drawn from `runs` all solve a problem that `solved` of them solve.
fn chance(solved: usize, runs: usize, k: usize) -> f64 {
    if solved < k {
        return 0.0;
    }
    (0..k).map(|drawn| (solved - drawn) as f64 / (runs - drawn) as f64).product()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chance_is_that_of_drawing_without_returning() {
        // 3 of 4 runs solve it: 3/4, then 3/4 · 2/3, then 3/4 · 2/3 · 1/2.
        let found: Vec<f64> = (1..=4).map(|k| chance(3, 4, k)).collect();
        for (found, wanted) in found.iter().zip([0.75, 0.5, 0.25, 0.0]) {
            assert!((found - wanted).abs() < 1e-12, "{found} {wanted}");
        }
        assert!((chance(4, 4, 4) - 1.0).abs() < 1e-12);
    }
}
