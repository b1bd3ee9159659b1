//! The wall clock, as the rest of the program reads it.

pub mod steady;

use jiff::Timestamp;

/// Returns the current time in milliseconds since 1970 (UTC).
#[must_use]
pub fn now_ms() -> i64 {
    wall_ms() + travelled_ms()
}

/// Returns how far a test has moved time, in milliseconds.
fn travelled_ms() -> i64 {
    set_ms()[0]
}

/// Returns what the machine's clock says, in milliseconds since 1970: without the time travel of a test, but with the
/// jump that it makes the clock take.
fn wall_ms() -> i64 {
    Timestamp::now().as_millisecond() + set_ms()[1]
}

/// Returns how far a test has moved the clock, in milliseconds: the time travel, and a jump. They are the words of the
/// file that `PLUMBLINE_TEST_CLOCK` names. Only in debug builds.
#[cfg(debug_assertions)]
fn set_ms() -> [i64; 2] {
    static FILE: std::sync::LazyLock<Option<String>> =
        std::sync::LazyLock::new(|| std::env::var("PLUMBLINE_TEST_CLOCK").ok());
    let text = FILE.as_ref().and_then(|file| std::fs::read_to_string(file).ok()).unwrap_or_default();
    let mut words = text.split_whitespace().map(|word| word.parse().expect("a test sets numbers"));
    [words.next().unwrap_or(0), words.next().unwrap_or(0)]
}

#[cfg(not(debug_assertions))]
const fn set_ms() -> [i64; 2] {
    [0, 0]
}

/// Parses an RFC 3339 time into milliseconds since 1970; returns `None` if it is not one.
#[must_use]
pub fn milliseconds(text: &str) -> Option<i64> {
    text.parse::<Timestamp>().ok().map(Timestamp::as_millisecond)
}

/// Milliseconds in a day.
pub const DAY_MS: i64 = 86_400_000;

/// Parses a date, such as `2026-11-21`, into the beginning of that day in UTC, in milliseconds since 1970.
#[must_use]
pub fn day_ms(text: &str) -> Option<i64> {
    // Rejects what the parser of dates also takes, such as a date with a time.
    const CHARS: usize = "2026-11-21".len();
    if text.len() == CHARS { milliseconds(&format!("{text}T00:00:00Z")) } else { None }
}

/// Formats a stored time as RFC 3339 in UTC with milliseconds, such as `2026-11-21T07:00:00.000Z`.
#[must_use]
pub fn rfc3339(ms: i64) -> String {
    Timestamp::from_millisecond(ms).map_or_else(|_| ms.to_string(), |time| format!("{time:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_date_is_the_beginning_of_its_day() {
        assert_eq!(day_ms("1970-01-02"), Some(DAY_MS));
        for other in ["1970-1-2", "1970-01-32", "1970-01-02T00:00:00Z", "yesterday!", ""] {
            assert_eq!(day_ms(other), None, "{other}");
        }
    }
}
