//! The board of the dev tier: the parameter-free Ladder of Blum and Hardt ("The Ladder: a reliable leaderboard for
//! machine learning competitions", 2015), with fresh draws for every entry.
//!
//! The Ladder moves a board only if an entry beats the best entry before it by more than the standard error of the
//! difference, so small random gains reveal nothing. Lucky results cannot accumulate here either: secret salts derived
//! from the epoch's key divide an entry's instances into parts. One part decides whether the entry moves the board, and
//! another is shown. The shown part plays no role in the selection, so the best of many entries is not shown better
//! than it is.
//!
//! Whoever stops at a lucky moment would still keep that luck. So since version 2 of the protocol there are three
//! parts, each of a third on average: the third one is kept, the service tells nobody of it before the epoch is over,
//! and then the board is made of it alone. Version 1 has two parts, and keeps none.

use sha2::{Digest as _, Sha256};

use super::secret::first_number;

/// What the outcome of a dev instance is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// It decides whether the entry moves the board.
    Deciding,
    /// The board shows it while the epoch is open.
    Shown,
    /// It is kept for the final board.
    Kept,
}

impl Part {
    /// Returns the part of the instance with this salt. Salts are secret until the epoch is over, so no entrant can
    /// answer one part better than another on purpose. Version 1 of the protocol keeps none.
    #[must_use]
    pub fn of(protocol: u32, salt: &str) -> Self {
        let hash = Sha256::digest(salt);
        if protocol < 2 {
            return if hash[0] & 1 == 0 { Self::Deciding } else { Self::Shown };
        }
        match first_number(&hash.into()) % 3 {
            0 => Self::Deciding,
            1 => Self::Shown,
            _ => Self::Kept,
        }
    }
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

    /// Counts the instances of another tally as well.
    pub const fn join(&mut self, other: Self) {
        self.passed = self.passed.saturating_add(other.passed);
        self.of = self.of.saturating_add(other.of);
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
    /// Tally of the instances that are kept for the final board; empty in version 1 of the protocol.
    pub kept: Tally,
}

impl<'a> Attempt<'a> {
    /// Creates an attempt from the instances of an entry, each given by its salt and whether it passes. `undrawn` more
    /// instances count as failed, as many in each part as in any other.
    #[must_use]
    pub fn of<'i>(
        protocol: u32,
        configuration: &'a str,
        outcomes: impl IntoIterator<Item = (&'i str, bool)>,
        undrawn: u32,
    ) -> Self {
        let mut own =
            Self { configuration, deciding: Tally::default(), shown: Tally::default(), kept: Tally::default() };
        for (salt, passes) in outcomes {
            own.part(Part::of(protocol, salt)).add(passes);
        }
        let parts = [Part::Deciding, Part::Shown, Part::Kept];
        let parts = if protocol < 2 { &parts[..2] } else { &parts };
        let (each, more) = (undrawn / parts.len() as u32, undrawn as usize % parts.len());
        for (i, part) in parts.iter().enumerate() {
            own.part(*part).join(Tally { passed: 0, of: each + u32::from(i < more) });
        }
        own
    }

    const fn part(&mut self, part: Part) -> &mut Tally {
        match part {
            Part::Deciding => &mut self.deciding,
            Part::Shown => &mut self.shown,
            Part::Kept => &mut self.kept,
        }
    }
}

/// The state of an owner on the Ladder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rung {
    /// Index of the attempt that moved the board last, from 0.
    pub attempt: usize,
    /// Tally that the board shows: the shown parts of that attempt and of others with the same configuration.
    pub shown: Tally,
    /// Tally of the kept instances of the same attempts.
    pub kept: Tally,
    /// Number of attempts that have moved the board.
    pub moves: u32,
    deciding: Tally,
}

/// Returns the rung after all attempts of one owner, in the order of their completion, or `None` without attempts.
///
/// Attempts with the configuration of the rung are taken together with it. In version 1 of the protocol one that moves
/// the board begins anew instead, which drops what the configuration had before.
#[must_use]
pub fn climb(protocol: u32, attempts: &[Attempt<'_>]) -> Option<Rung> {
    let mut rung: Option<Rung> = None;
    for (i, attempt) in attempts.iter().enumerate() {
        let moves = rung.is_none_or(|rung| {
            let step = (attempt.deciding.variance() + rung.deciding.variance()).sqrt();
            attempt.deciding.rate() > rung.deciding.rate() + step
        });
        let is_same = rung.is_some_and(|rung| attempts[rung.attempt].configuration == attempt.configuration);
        match &mut rung {
            Some(rung) if !moves || (is_same && protocol >= 2) => {
                if is_same {
                    rung.shown.join(attempt.shown);
                    rung.kept.join(attempt.kept);
                }
                if moves {
                    (rung.attempt, rung.deciding) = (i, attempt.deciding);
                }
            }
            _ => {
                let moves = rung.map_or(0, |before| before.moves) + 1;
                let Attempt { deciding, shown, kept, .. } = *attempt;
                rung = Some(Rung { attempt: i, shown, kept, moves, deciding });
            }
        }
    }
    rung
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attempt(configuration: &str, deciding: u32, shown: u32) -> Attempt<'_> {
        let tally = |passed| Tally { passed, of: 100 };
        Attempt { configuration, deciding: tally(deciding), shown: tally(shown), kept: tally(shown / 2) }
    }

    #[test]
    fn the_board_moves_by_more_than_the_standard_error_only() {
        assert_eq!(climb(2, &[]), None);
        // The standard error of the difference between 50 of 100 and 55 of 100 is 7 percentage points.
        let rung = climb(2, &[attempt("a", 50, 40), attempt("b", 55, 90)]).unwrap();
        assert_eq!((rung.attempt, rung.shown), (0, Tally { passed: 40, of: 100 }));
        let rung = climb(2, &[attempt("a", 50, 40), attempt("b", 60, 52)]).unwrap();
        assert_eq!((rung.attempt, rung.shown), (1, Tally { passed: 52, of: 100 }));
    }

    #[test]
    fn salts_divide_instances_into_parts_of_the_same_size() {
        let salts: Vec<String> = (0..3_000).map(|i| i.to_string()).collect();
        let outcomes = || salts.iter().map(|salt| (salt.as_str(), true));
        let old = Attempt::of(1, "a", outcomes(), 3);
        assert_eq!((old.deciding.of + old.shown.of, old.kept.of), (3_003, 0));
        let new = Attempt::of(2, "a", outcomes(), 4);
        let parts = [new.deciding, new.shown, new.kept];
        assert!(parts.iter().all(|part| (900..1_100).contains(&part.of)), "{parts:?}");
        assert_eq!(parts.map(|part| part.of - part.passed), [2, 1, 1], "instances that were not drawn");
    }

    #[test]
    fn what_was_tried_again_is_taken_together() {
        let rung = climb(2, &[attempt("a", 50, 60), attempt("a", 50, 40), attempt("b", 50, 99)]).unwrap();
        assert_eq!(rung.shown, Tally { passed: 100, of: 200 });
        assert_eq!((rung.kept, rung.moves), (Tally { passed: 50, of: 200 }, 1));
        // Also where the same configuration moves the board; version 1 began anew.
        let again = [attempt("a", 50, 60), attempt("a", 70, 40)];
        let of = |protocol| climb(protocol, &again).map(|rung| (rung.attempt, rung.shown.of, rung.moves));
        assert_eq!((of(2), of(1)), (Some((1, 200, 1)), Some((1, 100, 2))));
    }
}
