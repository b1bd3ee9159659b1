//! Explanations of why a text is not JSON.

/// Explains why a text is not JSON, and where.
#[must_use]
pub fn why_not_json(text: &[u8], error: &serde_json::Error) -> String {
    if let Err(bad) = std::str::from_utf8(text) {
        let at = bad.valid_up_to();
        let line = text[..at].split(|byte| *byte == b'\n').count();
        return format!("not UTF-8: byte {:#04x} at offset {at}, in line {line}; JSON must be UTF-8", text[at]);
    }
    if error.to_string().starts_with("trailing characters") && error.line() > 1 {
        return format!("{error}: expected a single document; send several, one per line, as application/x-ndjson");
    }
    let line = text.split(|byte| *byte == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
    // The parser stops at or after the first character that it does not expect.
    let around = &line[error.column().saturating_sub(2).min(line.len())..];
    for word in ["NaN", "Infinity", "-Infinity", "undefined", "None", "True", "False"] {
        if around.starts_with(word.as_bytes()) || around.get(1..).is_some_and(|rest| rest.starts_with(word.as_bytes()))
        {
            return format!("{error}: JSON has no {word}");
        }
    }
    if follows_comma(text, error) {
        return format!("{error}: JSON has no comma after the last value");
    }
    error.to_string()
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
    let text = why_not_json(line, error);
    if !text.contains(" at line ") {
        return text;
    }
    let (what, rest) = text.split_once(" at line ").unwrap_or((&text, ""));
    let hint = rest.split_once(": ").map(|(_, hint)| format!(": {hint}")).unwrap_or_default();
    format!("{what} at column {}{hint}", error.column())
}
