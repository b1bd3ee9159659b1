//! Exact tests of whether two runs differ: on the same problems (McNemar 1947), or by their rates alone (Fisher 1935).

use super::ALPHA;

/// Natural logarithms of factorials: `of[n]` is ln n!.
#[derive(Debug, Clone)]
struct LogFactorials {
    of: Vec<f64>,
}

impl LogFactorials {
    fn up_to(most: usize) -> Self {
        let mut of = Vec::with_capacity(most + 1);
        let mut sum = 0.0;
        of.push(sum);
        for n in 1..=most {
            sum += (n as f64).ln();
            of.push(sum);
        }
        Self { of }
    }

    fn choose(&self, n: usize, k: usize) -> f64 {
        self.of[n] - self.of[k] - self.of[n - k]
    }
}

/// McNemar's exact test of whether problems that only one of two runs solves are equally often solved by either run.
#[derive(Debug, Clone)]
pub struct McNemar {
    /// P-values, by the number of such problems, then by the smaller of the two shares.
    p: Vec<f64>,
    /// Index of the first p-value of each number of problems.
    begin: Vec<usize>,
    /// Indices of the p-values that may show a difference, the smallest p-value first.
    ascending: Vec<u32>,
}

impl McNemar {
    /// Computes the p-values for runs over at most `problems` problems.
    #[must_use]
    pub fn up_to(problems: usize) -> Self {
        let logs = LogFactorials::up_to(problems);
        let row = |n: usize| {
            let mut tail = 0.0;
            let p = |k: usize| {
                tail += (logs.choose(n, k) - n as f64 * std::f64::consts::LN_2).exp();
                // Two-sided; if both shares are equal, the sides overlap.
                f64::min(2.0 * tail, 1.0)
            };
            (0..=n / 2).map(p).collect::<Vec<f64>>()
        };
        let (mut p, mut begin) = (Vec::new(), Vec::with_capacity(problems + 1));
        for n in 0..=problems {
            begin.push(p.len());
            p.extend(row(n));
        }
        let mut ascending: Vec<u32> = (0..).zip(&p).filter(|(_, p)| **p <= ALPHA).map(|(i, _)| i).collect();
        ascending.sort_by(|a, b| p[*a as usize].total_cmp(&p[*b as usize]));
        Self { p, begin, ascending }
    }

    /// Returns the two-sided p-value if only the one run solves `one` problems and only the other solves `other`.
    #[must_use]
    pub fn p_value(&self, one: usize, other: usize) -> f64 {
        self.p[self.number_of(one, other)]
    }

    /// Returns the index of that p-value among all.
    #[must_use]
    pub fn number_of(&self, one: usize, other: usize) -> usize {
        self.begin[one + other] + one.min(other)
    }

    /// Returns the number of p-values.
    #[must_use]
    pub fn distinct(&self) -> usize {
        self.p.len()
    }

    /// Returns the p-values that may show a difference, with their indices, the smallest first.
    pub fn ascending(&self) -> impl Iterator<Item = (f64, usize)> {
        self.ascending.iter().map(|number| (self.p[*number as usize], *number as usize))
    }
}

/// Returns the two-sided p-value of Fisher's exact test for the rates `pass` of `of` and `other_pass` of `other_of`.
#[must_use]
pub fn fisher(pass: usize, of: usize, other_pass: usize, other_of: usize) -> f64 {
    /// Tolerance for rounding within which log-likelihoods count as equal.
    const SAME: f64 = 1e-9;
    let logs = LogFactorials::up_to(of + other_of);
    let all = pass + other_pass;
    let likelihood = |x: usize| logs.choose(of, x) + logs.choose(other_of, all - x) - logs.choose(of + other_of, all);
    let own = likelihood(pass);
    let tables = all.saturating_sub(other_of)..=all.min(of);
    let sum: f64 = tables.map(likelihood).filter(|l| *l <= own + SAME).map(f64::exp).sum();
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64) -> bool {
        (found / wanted - 1.0).abs() < 1e-9
    }

    /// Values from exact fractions (Python's `fractions` and `math.comb`). 86 and 150 are the approval ratings of
    /// Agresti, Categorical Data Analysis, 1990, page 350.
    #[test]
    fn mcnemar_is_the_exact_binomial_test() {
        let test = McNemar::up_to(723);
        let known = [
            (86, 150, 3.715_936_139_571_442e-5),
            (6, 16, 0.052_478_790_283_203_125),
            (0, 5, 0.0625),
            (10, 10, 1.0),
            (1, 8, 0.039_062_5),
            (40, 31, 0.342_470_998_419_867_9),
            (0, 0, 1.0),
        ];
        for (one, other, p) in known {
            assert!(near(test.p_value(one, other), p) && near(test.p_value(other, one), p), "{one} {other}");
        }
    }

    /// The paper's models (table "Overall problem-level accuracy"); values from exact fractions as well.
    #[test]
    fn the_papers_first_two_are_not_separated_and_its_others_are() {
        assert!(near(fisher(286, 723, 277, 723), 0.666_152_476_257_335_3));
        assert!(near(fisher(192, 723, 277, 723), 2.268_323_778_211_829e-6));
        assert!(near(fisher(3, 723, 192, 723), 3.181_564_128_276_667e-59));
        assert!(near(fisher(8, 10, 1, 10), 0.005_477_494_641_581_329));
        assert!(near(fisher(0, 5, 5, 5), 0.007_936_507_936_507_936));
    }
}
