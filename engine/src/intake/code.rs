//! Turns that hold action code or a structure file instead of events. Making events of them happens elsewhere.

use std::borrow::Cow;

use super::text::fences::{Fence, fences};
use super::text::template::message;
use super::text::thinking::{begins_with_thought, left_out, without_thoughts};
use crate::text::line_of;
use crate::voxel::block_log::{BlockLog, Event};
use crate::voxel::cell::Cell;
use crate::voxel::profile::Profile;

/// A log as it was sent: the events of each turn, and the code of the turns that are empty until the code has run.
#[derive(Debug, Clone, Default)]
pub struct SentLog {
    /// Events of each turn.
    pub log: BlockLog,
    /// Code of the turns that have code, in turn order.
    pub codes: Vec<TurnCode>,
    /// Structure files of the turns that are empty until the files are read, in turn order.
    pub structures: Vec<TurnStructure>,
}

/// A turn as a structure file: what stands after the turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TurnStructure {
    /// Index of the turn in the log, from 0.
    pub turn: usize,
    /// The file, in base64.
    pub base64: String,
    /// Where the least corner of the file's box goes; by default where a paste at (0, 0, 0) puts it.
    pub corner: Option<[i32; 3]>,
}

/// The action code of a turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TurnCode {
    /// Index of the turn in the log, from 0.
    pub turn: usize,
    /// Answers or files of code as they were sent, in the order in which they run.
    pub files: Vec<String>,
}

impl SentLog {
    /// Creates a log of one turn that consists of code.
    #[must_use]
    pub fn of_code(code: String) -> Self {
        Self::of_code_files(vec![code])
    }

    /// Creates a log of one turn that consists of files of code.
    #[must_use]
    pub fn of_code_files(files: Vec<String>) -> Self {
        let log = BlockLog { turns: vec![Vec::new()], ..BlockLog::default() };
        Self { log, codes: vec![TurnCode { turn: 0, files }], structures: Vec::new() }
    }
}

impl SentLog {
    /// Sets the rules of the log: those that were asked for, or else, if it has code, those that code has by default.
    pub fn choose_profile(&mut self, asked: Option<Profile>, of_code: Option<Profile>) {
        let of_code = of_code.filter(|_| !self.codes.is_empty());
        if let Some(profile) = asked.or(of_code) {
            self.log.profile = profile;
        }
    }

    /// Appends the turns of another log.
    pub fn append(&mut self, other: &Self) {
        let turns = self.log.turns.len();
        for turn in &other.log.turns {
            let place = self.log.turns.len();
            self.log.turns.push(Vec::with_capacity(turn.len()));
            for event in turn {
                match *event {
                    Event::Place { cell, material } => {
                        self.log.add_event(place, cell, Some(other.log.palette.name(material)));
                    }
                    Event::Remove { cell } => self.log.add_event(place, cell, None),
                }
            }
        }
        let codes = other.codes.iter().map(|code| TurnCode { turn: turns + code.turn, files: code.files.clone() });
        self.codes.extend(codes);
        let structures = other.structures.iter().cloned().map(|own| TurnStructure { turn: turns + own.turn, ..own });
        self.structures.extend(structures);
    }
}

impl From<BlockLog> for SentLog {
    fn from(log: BlockLog) -> Self {
        Self { log, codes: Vec::new(), structures: Vec::new() }
    }
}

impl BlockLog {
    /// Appends an event to an existing turn: a placement of `material` at `cell`, or a removal if `material` is `None`.
    pub fn add_event(&mut self, turn: usize, cell: Cell, material: Option<&str>) {
        let event = match material {
            Some(name) => Event::Place { cell, material: self.palette.intern(name) },
            None => Event::Remove { cell },
        };
        self.turns[turn].push(event);
    }
}

/// Extracts code that was sent inside code fences: returns the last non-empty fence outside thinking tags.
///
/// The code keeps its line numbers, so that the lines in error messages are those of the text that was sent. Text
/// without fences is returned without a thought at its beginning and without the tokens that end a message.
#[must_use]
pub fn without_fences(code: &str) -> Cow<'_, str> {
    if fences(code).is_empty() {
        if begins_with_thought(code) {
            return Cow::Owned(without_thoughts(code).0);
        }
        return Cow::Borrowed(&code[..message(code).end]);
    }
    let (shown, _) = without_thoughts(code);
    let fences = fences(&shown);
    let is_filled = |fence: &&Fence| !shown[fence.content.clone()].trim().is_empty();
    Cow::Owned(match (fences.iter().rev().find(is_filled), fences.first()) {
        (Some(fence), _) => on_its_lines(&shown, fence.content.clone()),
        // Only a closing fence is present, because the opening one is in the prompt: the code precedes it.
        (None, Some(fence)) => {
            let mark = shown[..fence.content.start].trim_end().rfind('\n').unwrap_or(0);
            shown[..mark].to_owned()
        }
        (None, None) => shown,
    })
}

/// Says what [`without_fences`] leaves out of a text, for the author of code that did not do what was meant: earlier
/// fences, a fence or a thought without end, and what follows the end of a message.
#[must_use]
pub fn left_out_of(code: &str) -> Vec<String> {
    let (shown, ends_in_thought) = without_thoughts(code);
    let fences = fences(&shown);
    let mut told = Vec::new();
    if !fences.is_empty() || begins_with_thought(code) {
        told.extend(left_out(code));
    }
    let mut filled = fences.iter().filter(|fence| !shown[fence.content.clone()].trim().is_empty());
    let (Some(last), before) = (filled.next_back(), filled.count()) else { return told };
    if before > 0 {
        let line = line_of(&shown, last.content.start);
        told.push(format!("of {} code fences the last alone is run, which begins on line {line}", before + 1));
    }
    if last.content.end == shown.len() && !ends_in_thought {
        told.push("the answer ends without a closing fence, so it may be incomplete".to_owned());
    }
    told
}

/// Returns a part of a text, prefixed with as many line breaks as precede it, so that it keeps its line numbers.
#[must_use]
pub fn on_its_lines(text: &str, part: std::ops::Range<usize>) -> String {
    let before = text[..part.start].matches('\n').count();
    let mut code = "\n".repeat(before);
    code.push_str(&text[part]);
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_told() {
        for (sent, told) in [
            ("a();", &[][..]),
            ("```js\na();\n```", &[]),
            (
                "<think>\nI need a wall.\n```js\na();\n```",
                &["inside a thinking tag that is never closed: <think> in line 1"],
            ),
            (
                "```js\na();\n```\nThen\n```js\nb();\n```",
                &["of 2 code fences the last alone is run, which begins on line 6"],
            ),
            ("```js\na(", &["ends without a closing fence"]),
            ("a(); // <think>", &[]),
        ] {
            let found = left_out_of(sent);
            assert_eq!(found.len(), told.len(), "{sent}: {found:?}");
            assert!(found.iter().zip(told).all(|(found, told)| found.contains(told)), "{sent}: {found:?}");
        }
    }

    #[test]
    fn code_is_taken_out_of_its_fences() {
        let code = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
        for (sent, expected) in [
            (code.to_owned(), code.to_owned()),
            (format!("<think>a\n</think>\n{code}<|im_end|>"), format!("        \n        \n{code}          ")),
            (format!("{code}</s>"), code.to_owned()),
            (format!("{code} // <think>"), format!("{code} // <think>")),
            (format!("So:\n```js\n{code}\n```\n"), format!("\n\n{code}\n")),
            (format!("{code}\n```"), code.to_owned()),
            (format!("{code}\n```\n"), code.to_owned()),
            (format!("<think>\n```\nno\n```\n</think>\n```\n{code}\n```"), format!("{}{code}\n", "\n".repeat(6))),
        ] {
            assert_eq!(without_fences(&sent), expected, "{sent}");
        }
    }
}
