//! The board of the dev tier: the parameter-free Ladder of Blum and Hardt ("The Ladder: a reliable leaderboard for
//! machine learning competitions", 2015), with fresh draws for every entry.
//!
//! The Ladder moves a board only if an entry beats the best entry before it by more than the standard error of the
//! difference, so small random gains reveal nothing. Lucky results cannot accumulate here either. Half of an entry's
//! instances, selected by secret salts derived from the epoch's key, decide whether the entry moves the board; the
//! board then shows the other half. The shown half plays no part in the selection, so the best of many entries is not
//! shown better than it is.

use sha2::{Digest as _, Sha256};

/// Returns whether the instance with this salt belongs to the deciding half; the others are shown. Salts are secret
/// until the epoch is over, so no entrant can answer one half better than the other on purpose.
#[must_use]
pub fn decides(salt: &str) -> bool {
    Sha256::digest(salt)[0] & 1 == 0
}

/// The number of passing instances and their total number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Number of instances that pass.
    pub passed: u32,
    /// Total number of instances.
    pub of: u32,
}

impl Tally {
    /// Counts one more instance.
    pub const fn add(&mut self, passes: bool) {
        self.passed += passes as u32;
        self.of += 1;
    }

    /// Returns the share that passes, or 0 if the tally is empty.
    #[must_use]
    pub fn rate(self) -> f64 {
        if self.of == 0 { 0.0 } else { f64::from(self.passed) / f64::from(self.of) }
    }

    /// Estimates the variance of the share from the share itself.
    fn variance(self) -> f64 {
        let rate = self.rate();
        if self.of == 0 { 0.0 } else { rate * (1.0 - rate) / f64::from(self.of) }
    }
}

/// An entry as an attempt on the Ladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attempt<'a> {
    /// The evaluated configuration; attempts with the same configuration may be pooled.
    pub configuration: &'a str,
    /// Tally of the deciding instances.
    pub deciding: Tally,
    /// Tally of the shown instances.
    pub shown: Tally,
}

impl<'a> Attempt<'a> {
    /// Creates an attempt from the instances of an entry, each given by its salt and whether it passes.
    #[must_use]
    pub fn of<'i>(configuration: &'a str, outcomes: impl IntoIterator<Item = (&'i str, bool)>) -> Self {
        let (mut deciding, mut shown) = (Tally::default(), Tally::default());
        for (salt, passes) in outcomes {
            if decides(salt) { deciding.add(passes) } else { shown.add(passes) }
        }
        Self { configuration, deciding, shown }
    }
}

/// The state of an owner on the Ladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rung {
    /// Index of the attempt that moved the board last, from 0.
    pub attempt: usize,
    /// Tally that the board shows: the shown halves of that attempt and of later ones with the same configuration.
    pub shown: Tally,
    deciding: Tally,
}

/// Returns the rung after all attempts of one owner, in the order of their completion, or `None` without attempts.
#[must_use]
pub fn climb(attempts: &[Attempt<'_>]) -> Option<Rung> {
    let mut rung: Option<Rung> = None;
    for (i, attempt) in attempts.iter().enumerate() {
        let moves = rung.is_none_or(|rung| {
            let step = (attempt.deciding.variance() + rung.deciding.variance()).sqrt();
            attempt.deciding.rate() > rung.deciding.rate() + step
        });
        match &mut rung {
            Some(rung) if !moves => {
                if attempts[rung.attempt].configuration == attempt.configuration {
                    rung.shown.passed += attempt.shown.passed;
                    rung.shown.of += attempt.shown.of;
                }
            }
            _ => rung = Some(Rung { attempt: i, shown: attempt.shown, deciding: attempt.deciding }),
        }
    }
    rung
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attempt(configuration: &str, deciding: u32, shown: u32) -> Attempt<'_> {
        let tally = |passed| Tally { passed, of: 100 };
        Attempt { configuration, deciding: tally(deciding), shown: tally(shown) }
    }

    #[test]
    fn the_board_moves_by_more_than_the_standard_error_only() {
        assert_eq!(climb(&[]), None);
        // The standard error of the difference between 50 of 100 and 55 of 100 is 7 percentage points.
        let rung = climb(&[attempt("a", 50, 40), attempt("b", 55, 90)]).unwrap();
        assert_eq!((rung.attempt, rung.shown), (0, Tally { passed: 40, of: 100 }));
        let rung = climb(&[attempt("a", 50, 40), attempt("b", 60, 52)]).unwrap();
        assert_eq!((rung.attempt, rung.shown), (1, Tally { passed: 52, of: 100 }));
    }

    #[test]
    fn what_was_tried_again_is_taken_together() {
        let rung = climb(&[attempt("a", 50, 60), attempt("a", 50, 40), attempt("b", 50, 99)]).unwrap();
        assert_eq!(rung.shown, Tally { passed: 100, of: 200 });
    }
}
