//! Halves of surrogate pairs in JSON: escapes such as `\ud83d` without their other half.
//!
//! The text of a model that was cut amid a character has one, and JSON libraries of many languages write it as it is. No
//! Unicode text can hold it, so it is read as U+FFFD, as decoders of UTF-8 and of JavaScript read it.

use std::borrow::Cow;

/// Bytes of an escape such as `\ud83d`.
const ESCAPE: usize = 6;

/// Replaces the escape of each half of a surrogate pair that lacks its other half by `\ufffd`, which is as long.
#[must_use]
pub fn without_lone_surrogates(json: &[u8]) -> Cow<'_, [u8]> {
    let mut replaced: Option<Vec<u8>> = None;
    let mut at = 0;
    while let Some(offset) = memchr::memchr(b'\\', &json[at..]) {
        at += offset;
        let Some(unit) = unit_at(json, at) else {
            // Another escape, whose second byte may be a backslash.
            at = (at + 2).min(json.len());
            continue;
        };
        let is_pair = is_leading(unit) && unit_at(json, at + ESCAPE).is_some_and(is_trailing);
        if (is_leading(unit) || is_trailing(unit)) && !is_pair {
            replaced.get_or_insert_with(|| json.to_vec())[at + 2..at + ESCAPE].copy_from_slice(b"fffd");
        }
        at += if is_pair { 2 * ESCAPE } else { ESCAPE };
    }
    replaced.map_or(Cow::Borrowed(json), Cow::Owned)
}

/// Returns the UTF-16 code unit that is escaped here, if one is.
fn unit_at(json: &[u8], at: usize) -> Option<u16> {
    let digits = json.get(at..at + ESCAPE)?.strip_prefix(br"\u")?;
    digits.iter().try_fold(0, |unit: u16, digit| {
        let digit = u16::try_from(char::from(*digit).to_digit(16)?).ok()?;
        Some(unit << 4 | digit)
    })
}

const fn is_leading(unit: u16) -> bool {
    matches!(unit, 0xd800..=0xdbff)
}

const fn is_trailing(unit: u16) -> bool {
    matches!(unit, 0xdc00..=0xdfff)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_become_replacement_characters_and_pairs_stay() {
        for (json, read) in [
            (r#""a\ud83d""#, "a\u{fffd}"),
            (r#""\uDE00b""#, "\u{fffd}b"),
            (r#""\ud83d\ude00""#, "\u{1f600}"),
            (r#""\ud83d\ud83d\ude00""#, "\u{fffd}\u{1f600}"),
            (r#""\ude00\ud83d""#, "\u{fffd}\u{fffd}"),
            (r#""\ud83d\n""#, "\u{fffd}\n"),
            (r#""\\ud83d \\\\ud83d""#, r"\ud83d \\ud83d"),
            (r#""\\\ud83d""#, "\\\u{fffd}"),
            (r#""\u00e9""#, "\u{e9}"),
        ] {
            let text: String = serde_json::from_slice(&without_lone_surrogates(json.as_bytes())).unwrap();
            assert_eq!(text, read, "{json}");
        }
    }

    #[test]
    fn what_is_no_escape_stays_as_it_is() {
        for json in ["", "\\", "\\u", "\\ud83", "\\ud83d"[..5].as_ref(), "\\uzzzz", "\\u+123", "{\"a\": 1}"] {
            assert!(matches!(without_lone_surrogates(json.as_bytes()), Cow::Borrowed(same) if same == json.as_bytes()));
        }
    }
}
