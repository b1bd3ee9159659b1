//! Action code without a fence around it, alone or among words.

use std::ops::Range;

use super::fences::Fence;

/// What a line of JavaScript begins with, and a line of prose hardly.
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
/// What its last line ends with.
const ENDS: [char; 4] = [';', '}', ')', '/'];

/// Whether a text begins as a script does.
pub(super) fn is_script_start(text: &str) -> bool {
    let text = text.trim_start();
    STARTS.iter().any(|start| text.starts_with(start))
}

/// Whether a text calls one of the agent's skills.
pub(super) fn calls_skills(text: &str) -> bool {
    text.match_indices("skills.").any(|(at, word)| {
        let name = text[at + word.len()..].trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_');
        name.starts_with('(') && !text[at + word.len()..].starts_with('(')
    })
}

/// Where scripts stand outside fences: in each part of the text between fences from the first line that begins like code to the last
/// that ends like it, if skills are called there outside of JSON.
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
    let mut at = part.start;
    let (mut first, mut last, mut is_called) = (None, None, false);
    for line in text[part].split_inclusive('\n') {
        let range = at..at + line.len();
        at = range.end;
        // A log may be one line, or many; its lines are no code of their own.
        if first.is_none() && logs.iter().any(|log| log.start < range.end && range.start < log.end) {
            continue;
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
    Some(first?..last?).filter(|_| is_called)
}
