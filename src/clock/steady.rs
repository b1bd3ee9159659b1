//! The wall clock for what cannot be undone: a jump is believed only once it has lasted.
//!
//! A machine's clock can jump, for example because of a faulty time server, and jump back. Whoever seals an epoch,
//! publishes its key or deletes what is old asks this clock.

use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::{travelled_ms, wall_ms};

/// Time for which a jump must last before it is believed.
const PATIENCE: Duration = Duration::from_mins(1);
/// Differences up to this are corrections of the clock, not jumps.
const SLEW_MS: i64 = 5_000;

/// Returns the time in milliseconds since 1970 that nobody has reason to doubt: never later than the wall clock. Logs
/// when the clock jumps, and when the jump is believed. Background tasks ask every few seconds; a jump before the first
/// question is not noticed.
#[must_use]
pub fn steady_now_ms() -> i64 {
    kept().now_ms()
}

/// Returns the wall clock's time, or where the clock has jumped back and is not believed yet, the later time that was
/// believed before.
#[must_use]
pub fn latest_believable_ms() -> i64 {
    kept().latest_ms()
}

/// Returns whether the clock has jumped and is not believed yet.
#[must_use]
pub fn is_doubted() -> bool {
    let mut clock = kept();
    clock.now_ms();
    clock.jumped.is_some()
}

fn kept() -> std::sync::MutexGuard<'static, SteadyClock> {
    static CLOCK: LazyLock<Mutex<SteadyClock>> = LazyLock::new(|| Mutex::new(SteadyClock::new()));
    CLOCK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Wall clock that believes a jump only after [`PATIENCE`]. Until then it goes on at the pace of the processor's clock.
#[derive(Debug)]
struct SteadyClock {
    begun: Instant,
    believed: Offset,
    /// Where the clock has jumped to, and when.
    jumped: Option<(Offset, Duration)>,
}

/// Difference between the wall clock and the time since [`SteadyClock::begun`], in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Offset(i64);

impl Offset {
    const fn is_near(self, other: Self) -> bool {
        self.0.abs_diff(other.0) <= SLEW_MS.unsigned_abs()
    }
}

impl SteadyClock {
    /// Creates a clock that believes the wall clock as it is now.
    fn new() -> Self {
        Self { begun: Instant::now(), believed: Offset(wall_ms()), jumped: None }
    }

    fn now_ms(&mut self) -> i64 {
        let wall_ms = wall_ms();
        wall_ms + travelled_ms() - self.doubted_ms(wall_ms, self.begun.elapsed())
    }

    fn latest_ms(&mut self) -> i64 {
        self.now_ms() + self.behind_ms()
    }

    /// Returns how many milliseconds the wall clock has jumped back, while that is not believed.
    fn behind_ms(&self) -> i64 {
        self.jumped.map_or(0, |(to, _)| (self.believed.0 - to.0).max(0))
    }

    /// Returns how many milliseconds of the wall clock's time are not believed.
    fn doubted_ms(&mut self, wall_ms: i64, elapsed: Duration) -> i64 {
        let offset = Offset(wall_ms - i64::try_from(elapsed.as_millis()).expect("no process lives for ages"));
        if offset.is_near(self.believed) {
            if self.jumped.take().is_some() {
                tracing::warn!("the clock has jumped back to where it should be");
            }
            self.believed = offset;
            return 0;
        }
        match self.jumped {
            Some((to, since)) if offset.is_near(to) => {
                self.jumped = Some((offset, since));
                if elapsed.saturating_sub(since) >= PATIENCE {
                    tracing::warn!("the clock has stood since it jumped, and is believed");
                    (self.believed, self.jumped) = (offset, None);
                    return 0;
                }
            }
            _ => {
                tracing::warn!(
                    seconds = (offset.0 - self.believed.0) / 1_000,
                    believed_after_seconds = PATIENCE.as_secs(),
                    "the clock has jumped; until it has stood for a while, no epoch is settled, no embargo lifted and \
                     nothing old deleted on its word"
                );
                self.jumped = Some((offset, elapsed));
            }
        }
        (offset.0 - self.believed.0).max(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a clock that began at 0, and what it doubts of a wall clock that is `ahead` after some milliseconds.
    fn looks(looks: &[(i64, i64)]) -> Vec<i64> {
        let mut clock = SteadyClock { begun: Instant::now(), believed: Offset(0), jumped: None };
        let look = |&(after, ahead): &(i64, i64)| {
            clock.doubted_ms(after + ahead, Duration::from_millis(u64::try_from(after).expect("it is positive")))
        };
        looks.iter().map(look).collect()
    }

    #[test]
    fn small_corrections_are_believed_at_once_and_add_up() {
        assert_eq!(looks(&[(1_000, 4_000), (2_000, 8_000), (3_000, 12_000), (4_000, 8_000)]), [0; 4]);
    }

    #[test]
    fn a_jump_ahead_is_doubted_for_a_minute() {
        let day = 86_400_000;
        let seen = looks(&[(1_000, 0), (2_000, day), (30_000, day + 2), (61_999, day), (62_000, day), (63_000, day)]);
        assert_eq!(seen, [0, day, day + 2, day, 0, 0]);
    }

    #[test]
    fn a_jump_that_is_taken_back_was_none() {
        let day = 86_400_000;
        assert_eq!(looks(&[(2_000, day), (40_000, 0), (50_000, day), (80_000, day)]), [day, 0, day, day]);
    }

    #[test]
    fn each_jump_begins_its_own_minute() {
        let hour = 3_600_000;
        assert_eq!(
            looks(&[(1_000, hour), (50_000, 2 * hour), (70_000, 2 * hour), (110_000, 2 * hour)]),
            [hour, 2 * hour, 2 * hour, 0]
        );
    }

    #[test]
    fn a_clock_is_behind_until_it_has_stood_where_it_jumped_to() {
        let mut clock = SteadyClock { begun: Instant::now(), believed: Offset(0), jumped: None };
        let behind =
            [(1_000, -50_000), (30_000, -50_000), (31_000, 40_000), (32_000, 0), (33_000, -9_000), (99_000, -9_000)]
                .map(|(after_ms, ahead_ms)| {
                    clock.doubted_ms(after_ms + ahead_ms, Duration::from_millis(after_ms.unsigned_abs()));
                    clock.behind_ms()
                });
        assert_eq!(behind, [50_000, 50_000, 0, 0, 9_000, 0]);
    }

    #[test]
    fn a_clock_that_jumped_back_is_never_overtaken() {
        assert_eq!(looks(&[(1_000, -50_000), (20_000, -50_000), (61_000, -50_000)]), [0; 3]);
    }
}
