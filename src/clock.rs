//! The wall clock, as the rest of the program reads it.

use jiff::Timestamp;

/// Milliseconds since 1970 (UTC).
#[must_use]
pub fn now_ms() -> i64 {
    Timestamp::now().as_millisecond()
}

/// A stored time as RFC 3339 in UTC with milliseconds, such as `2026-11-21T07:00:00.000Z`.
#[must_use]
pub fn rfc3339(ms: i64) -> String {
    Timestamp::from_millisecond(ms).map_or_else(|_| ms.to_string(), |time| format!("{time:.3}"))
}
