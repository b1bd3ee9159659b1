//! Explanations of why a text is not JSON.

/// First bytes of what gzip writes.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Greatest number of lists and objects within each other that the parser reads.
const MAX_LEVELS: u32 = 127;

/// Explains why a text is not JSON, where, and what to do about it.
#[must_use]
pub fn why_not_json(text: &[u8], error: &serde_json::Error) -> String {
    if let Some(bad) = not_utf8(text) {
        let line = text[..bad].split(|byte| *byte == b'\n').count();
        return format!("not UTF-8: byte {:#04x} at offset {bad}, in line {line}; {}", text[bad], instead_of(text));
    }
    if text.trim_ascii().is_empty() {
        return "empty: expected a JSON document".to_owned();
    }
    if error.to_string().starts_with("trailing characters") && error.line() > 1 {
        return format!("{error}: expected a single document; send several, one per line, as application/x-ndjson");
    }
    if error.to_string().starts_with("recursion limit exceeded") {
        let (line, column) = (error.line(), error.column());
        return format!(
            "too many brackets within each other at line {line} column {column}: at most {MAX_LEVELS} levels are read"
        );
    }
    match remedy(text, error) {
        Some(remedy) => format!("{}: {remedy}", message(error)),
        None => message(error),
    }
}

/// Returns the parser's message in plain words.
#[must_use]
pub fn message(error: &serde_json::Error) -> String {
    error.to_string().replace("EOF while parsing", "cut off within").replace("within a list", "within an array")
}

/// Returns the offset of the first byte that is not UTF-8.
fn not_utf8(text: &[u8]) -> Option<usize> {
    std::str::from_utf8(text).err().map(|bad| bad.valid_up_to())
}

/// Says what to send instead of bytes that are not UTF-8.
fn instead_of(text: &[u8]) -> &'static str {
    if text.starts_with(&GZIP) { "gzip needs the header Content-Encoding: gzip" } else { "JSON must be UTF-8" }
}

/// Words of other languages that JSON lacks.
const WORDS: [&str; 7] = ["NaN", "Infinity", "-Infinity", "undefined", "None", "True", "False"];

/// Says what JSON has instead of what the parser stopped at, if that is a common mistake.
#[must_use]
pub fn remedy(text: &[u8], error: &serde_json::Error) -> Option<String> {
    let message = error.to_string();
    if message.starts_with("trailing characters") {
        return Some("nothing may follow the document".to_owned());
    }
    if message.starts_with("control character") {
        return Some("inside a string, write a line break as \\n and a tab as \\t".to_owned());
    }
    if message.starts_with("lone leading surrogate") || message.starts_with("unexpected end of hex escape") {
        return Some(
            "half a character: one beyond U+FFFF is two escapes, such as \\ud83d\\ude00; where a text was cut, replace the half \
             with \\ufffd"
                .to_owned(),
        );
    }
    let line = text.split(|byte| *byte == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
    // The parser stops at or after the first character that it does not expect.
    let around = &line[error.column().saturating_sub(2).min(line.len())..];
    let is_here = |begin: &str| {
        around.starts_with(begin.as_bytes()) || around.get(1..).is_some_and(|rest| rest.starts_with(begin.as_bytes()))
    };
    if let Some(word) = WORDS.into_iter().find(|word| is_here(word)) {
        return Some(format!("JSON has no {word}"));
    }
    if is_here("//") || is_here("/*") || is_here("#") {
        return Some("JSON has no comments".to_owned());
    }
    if is_here("'") || is_here("\u{201c}") || is_here("\u{201d}") || is_here("`") {
        return Some("JSON has straight double quotes around names and strings".to_owned());
    }
    if follows_comma(text, error) {
        return Some("JSON has no comma after the last value".to_owned());
    }
    message.starts_with("key must be a string").then(|| "JSON has double quotes around names".to_owned())
}

/// Returns whether the parser stopped at a bracket that a comma stands before.
fn follows_comma(text: &[u8], error: &serde_json::Error) -> bool {
    let lines = text.split_inclusive(|byte| *byte == b'\n').take(error.line().saturating_sub(1));
    let at = lines.map(<[u8]>::len).sum::<usize>() + error.column();
    let Some((b']' | b'}', before)) = text.get(..at).and_then(<[u8]>::split_last) else { return false };
    before.trim_ascii_end().ends_with(b",")
}

/// Explains why one line of an NDJSON text is not JSON, and gives the column only: the parser's own line number is
/// always 1, and the line number in the text is reported elsewhere.
#[must_use]
pub fn on_its_line(line: &[u8], error: &serde_json::Error) -> String {
    if let Some(bad) = not_utf8(line) {
        return format!("not UTF-8: byte {:#04x} at offset {bad} of the line; {}", line[bad], instead_of(line));
    }
    let text = why_not_json(line, error);
    let Some((what, rest)) = text.split_once(" at line ") else { return text };
    let hint = rest.split_once(": ").map(|(_, hint)| format!(": {hint}")).unwrap_or_default();
    format!("{what} at column {}{hint}", error.column())
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn error(text: &[u8]) -> serde_json::Error {
        serde_json::from_slice::<Value>(text).expect_err("it is no JSON")
    }

    #[test]
    fn common_mistakes_are_told_with_their_remedy() {
        for (text, expected) in [
            (
                "{'a': 1}",
                "key must be a string at line 1 column 2: JSON has straight double quotes around names and strings",
            ),
            (
                "{\"a\": 'b'}",
                "expected value at line 1 column 7: JSON has straight double quotes around names and strings",
            ),
            (
                "{“a”: 1}",
                "key must be a string at line 1 column 2: JSON has straight double quotes around names and strings",
            ),
            ("{a: 1}", "key must be a string at line 1 column 2: JSON has double quotes around names"),
            ("[1,\n // one\n 2]", "expected value at line 2 column 2: JSON has no comments"),
            ("[1, 2,]", "trailing comma at line 1 column 7: JSON has no comma after the last value"),
            ("{\"a\": NaN}", "expected value at line 1 column 7: JSON has no NaN"),
            ("{\"a\": None}", "expected value at line 1 column 7: JSON has no None"),
            (" \n", "empty: expected a JSON document"),
            ("[1] x", "trailing characters at line 1 column 5: nothing may follow the document"),
            ("{\"a\": [\"b", "cut off within a string at line 1 column 9"),
            ("{\"a\": [1,", "cut off within a value at line 1 column 9"),
            ("{\"a\":\n [1", "cut off within an array at line 2 column 3"),
        ] {
            assert_eq!(why_not_json(text.as_bytes(), &error(text.as_bytes())), expected, "{text}");
        }
        let (deep, deepest) = ("[".repeat(128), format!("{}{}", "[".repeat(127), "]".repeat(127)));
        let why = why_not_json(deep.as_bytes(), &error(deep.as_bytes()));
        assert_eq!(why, "too many brackets within each other at line 1 column 128: at most 127 levels are read");
        assert!(serde_json::from_str::<Value>(&deepest).is_ok());
        let text = b"\"a\nb\"";
        assert!(why_not_json(text, &error(text)).ends_with("write a line break as \\n and a tab as \\t"));
        let text = b"\"\\ud83d\"";
        let why = why_not_json(text, &serde_json::from_slice::<String>(text).expect_err("half a pair"));
        assert!(why.contains("is two escapes, such as \\ud83d\\ude00"), "{why}");
    }

    #[test]
    fn what_is_not_utf8_is_told_by_its_place() {
        let text = b"{\n\"caf\xe9\": 1}";
        assert_eq!(why_not_json(text, &error(text)), "not UTF-8: byte 0xe9 at offset 6, in line 2; JSON must be UTF-8");
        assert_eq!(
            on_its_line(b"\"caf\xe9\"", &error(text)),
            "not UTF-8: byte 0xe9 at offset 4 of the line; JSON must be UTF-8"
        );
        let text = b"\x1f\x8b\x08";
        assert!(why_not_json(text, &error(text)).ends_with("gzip needs the header Content-Encoding: gzip"));
    }
}
