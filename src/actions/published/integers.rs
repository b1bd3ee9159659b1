//! Coordinates as the published pipeline reads them: `int(str(value).strip())` in Python.

/// Parses text as an integer; returns `None` if Python's `int` would reject it.
pub fn of_text(text: &str) -> Option<i64> {
    let text = text.trim();
    let (sign, digits) = match text.strip_prefix(['+', '-']) {
        Some(rest) => (if text.starts_with('-') { -1 } else { 1 }, rest),
        None => (1, text),
    };
    let mut value: i64 = 0;
    let mut after_digit = false;
    for character in digits.chars() {
        match character.to_digit(10) {
            Some(digit) => {
                // Saturates: a value far out of range stays out of range.
                value = value.saturating_mul(10).saturating_add(i64::from(digit));
                after_digit = true;
            }
            // One underscore between digits is allowed.
            None if character == '_' && after_digit => after_digit = false,
            None => return None,
        }
    }
    after_digit.then_some(sign * value)
}

/// Converts a number to an integer; returns `None` for fractions, for values that are not finite, and from 1e21 on,
/// where the number's text has an exponent.
pub fn of_number(value: f64) -> Option<i64> {
    (value.is_finite() && value.fract() == 0.0 && value.abs() < 1e21).then_some(value as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_count_as_in_python() {
        for (text, value) in [("+9", 9), (" 8 ", 8), ("0012", 12), ("10\n", 10), ("-3", -3), ("1_000", 1000), ("-0", 0)]
        {
            assert_eq!(of_text(text), Some(value), "{text:?}");
        }
        for text in ["", "1.0", "1e2", "0x10", "x", "+", "--1", "1__0", "_1", "1_", "1 2", "0,5"] {
            assert_eq!(of_text(text), None, "{text:?}");
        }
    }

    #[test]
    fn numbers_are_integers_or_nothing() {
        assert_eq!([4.0, -0.0, 1e3].map(of_number), [Some(4), Some(0), Some(1000)]);
        assert_eq!([0.5, f64::NAN, f64::INFINITY, 1e21].map(of_number), [None; 4]);
    }
}
