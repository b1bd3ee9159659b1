//! Action code without a code fence, alone or in prose.

use std::ops::Range;

use super::fences::Fence;

/// Prefixes of lines of JavaScript with which lines of prose rarely begin.
const STARTS: [&str; 29] = [
    "(async",
    "async ",
    "(function",
    "function ",
    "function*",
    "export ",
    "module.exports",
    "exports.",
    "await ",
    "const ",
    "let ",
    "var ",
    "for (",
    "for(",
    "if (",
    "if(",
    "while (",
    "while(",
    "try {",
    "skills.",
    "//",
    "/*",
    "'use strict'",
    "\"use strict\"",
    "class ",
    "import ",
    "({",
    "bot.",
    "(() =>",
];
/// Characters with which the last line of a script ends.
const ENDS: [char; 4] = [';', '}', ')', '/'];

/// Characters without width that may come before a script when it is copied.
const UNSEEN: [char; 5] = ['\u{feff}', '\u{200b}', '\u{200c}', '\u{200d}', '\u{2060}'];

/// Returns whether a text begins like a script.
pub(super) fn is_script_start(text: &str) -> bool {
    // A byte order mark is space to JavaScript; the others are an error there, which the code's reader names.
    let text = text.trim_start_matches(|c: char| c.is_whitespace() || UNSEEN.contains(&c));
    STARTS.iter().any(|start| text.starts_with(start))
}

/// Returns whether a text calls one of the agent's skills.
pub(super) fn calls_skills(text: &str) -> bool {
    text.match_indices("skills.").any(|(at, word)| {
        let name = text[at + word.len()..].trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_');
        name.starts_with('(') && !text[at + word.len()..].starts_with('(')
    })
}

/// Returns the byte ranges of the scripts outside fences. In each part of the text between fences, a script extends
/// from the first line that begins like code to the last line that ends like code. It counts if it calls skills outside
/// of JSON, or if it is all that the part holds.
pub(super) fn regions<'t>(
    text: &'t str,
    fences: &'t [Fence],
    logs: &'t [Range<usize>],
) -> impl Iterator<Item = Range<usize>> + 't {
    let begins = std::iter::once(0).chain(fences.iter().map(|fence| fence.content.end));
    let ends = fences.iter().map(|fence| fence.content.start).chain(std::iter::once(text.len()));
    begins.zip(ends).filter_map(move |(begin, end)| region(text, begin..end, logs))
}

fn region(text: &str, part: Range<usize>, logs: &[Range<usize>]) -> Option<Range<usize>> {
    let whole = part.clone();
    let mut at = part.start;
    let (mut first, mut last, mut is_called) = (None, None, false);
    for line in text[part].split_inclusive('\n') {
        let range = at..at + line.len();
        at = range.end;
        // Logs are in order and disjoint, so only the first log that ends after the start of this line needs a look.
        let log = logs.get(logs.partition_point(|log| log.end <= range.start)).filter(|log| log.start < range.end);
        if let Some(log) = log {
            // A log may span one or more lines, which are not code unless the log is data within a statement.
            let begins_line = log.start <= range.start || text[range.start..log.start].trim().is_empty();
            match first {
                None => continue,
                Some(begin) if begins_line && log.start > begin && log.start >= range.start => break,
                Some(_) => {}
            }
        }
        if first.is_none() && is_script_start(line) {
            first = Some(range.start);
        }
        if first.is_some() {
            is_called |= calls_skills(line);
            if line.trim_end().ends_with(ENDS) {
                last = Some(range.start + line.trim_end().len());
            }
        }
    }
    let found = first?..last?;
    // Code that calls no skills counts only if nothing surrounds it.
    let is_alone = text[whole].trim() == &text[found.clone()];
    Some(found).filter(|_| is_called || is_alone)
}
