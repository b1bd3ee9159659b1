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
    let whole = part.clone();
    let mut at = part.start;
    let (mut first, mut last, mut is_called) = (None, None, false);
    for line in text[part].split_inclusive('\n') {
        let range = at..at + line.len();
        at = range.end;
        // Logs are in order and apart: the first that ends after this line began is the only one that may touch it.
        let log = logs.get(logs.partition_point(|log| log.end <= range.start)).filter(|log| log.start < range.end);
        if let Some(log) = log {
            // A log may be one line, or many; its lines are no code of their own, unless it is data within a statement.
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
    // A script without a call of skills is one where nothing stands around it.
    let is_alone = text[whole].trim() == &text[found.clone()];
    Some(found).filter(|_| is_called || is_alone)
}
