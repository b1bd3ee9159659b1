//! The board of the dev tier: the parameter-free Ladder of Blum and Hardt ("The Ladder: a reliable leaderboard for machine
//! learning competitions", 2015), with draws that are fresh for every entry.
//!
//! The Ladder moves a board only where an entry beats the best before it by more than the standard error of the difference, so
//! that small luck tells nothing. Here luck cannot accumulate either: half of an entry's instances, picked by secret
//! salts that the epoch's key gives them, decide whether it moves the board, and the other half is what the board then shows. What is shown was not
//! looked at to choose, so the best of many entries shows no better than it is.

use sha2::{Digest as _, Sha256};

/// Whether the instance with this salt decides; the others are shown. Nobody knows salts before the epoch is over, so nobody
/// can answer the one half better than the other.
#[must_use]
pub fn decides(salt: &str) -> bool {
    Sha256::digest(salt)[0] & 1 == 0
}

/// Instances that pass, of so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// That pass.
    pub passed: u32,
    /// In all.
    pub of: u32,
}

impl Tally {
    /// One more.
    pub const fn add(&mut self, passes: bool) {
        self.passed += passes as u32;
        self.of += 1;
    }

    /// The share that passes; 0 of none.
    #[must_use]
    pub fn rate(self) -> f64 {
        if self.of == 0 { 0.0 } else { f64::from(self.passed) / f64::from(self.of) }
    }

    /// Variance of the share, estimated from it.
    fn variance(self) -> f64 {
        let rate = self.rate();
        if self.of == 0 { 0.0 } else { rate * (1.0 - rate) / f64::from(self.of) }
    }
}

/// An entry as the Ladder sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attempt<'a> {
    /// What was evaluated: entries of one configuration may be taken together.
    pub configuration: &'a str,
    /// Instances that decide.
    pub deciding: Tally,
    /// Instances that are shown.
    pub shown: Tally,
}

impl<'a> Attempt<'a> {
    /// Of an entry's instances: salts, and whether each passes.
    #[must_use]
    pub fn of<'i>(configuration: &'a str, outcomes: impl IntoIterator<Item = (&'i str, bool)>) -> Self {
        let (mut deciding, mut shown) = (Tally::default(), Tally::default());
        for (salt, passes) in outcomes {
            if decides(salt) { deciding.add(passes) } else { shown.add(passes) }
        }
        Self { configuration, deciding, shown }
    }
}

/// Where a board stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rung {
    /// The attempt that moved it last, counted from 0.
    pub attempt: usize,
    /// What it shows: the shown halves of that attempt and of later ones of the same configuration.
    pub shown: Tally,
    deciding: Tally,
}

/// The rung after all attempts of one owner, in the order in which they ended; none without attempts.
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
        // The standard error of the difference of 50 and 55 of 100 each is 7 points.
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
