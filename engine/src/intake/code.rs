//! Turns that bring action code instead of events: the code is read here, and becomes events elsewhere.

use std::borrow::Cow;

use super::text::fences::{Fence, fences};
use super::text::thinking::without_thoughts;
use crate::voxel::block_log::{BlockLog, Event};
use crate::voxel::cell::Cell;

/// A log as it was sent: what was done in each turn, and the code of turns that are empty until it has been run.
#[derive(Debug, Clone, Default)]
pub struct SentLog {
    /// Events per turn.
    pub log: BlockLog,
    /// Code of the turns that bring some, in their order.
    pub codes: Vec<TurnCode>,
}

/// The action code of a turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TurnCode {
    /// Place of the turn in the log, from 0.
    pub turn: usize,
    /// The code.
    pub code: String,
}

impl SentLog {
    /// A log of one turn that was done by code.
    #[must_use]
    pub fn of_code(code: String) -> Self {
        let log = BlockLog { turns: vec![Vec::new()], ..BlockLog::default() };
        Self { log, codes: vec![TurnCode { turn: 0, code }] }
    }
}

impl SentLog {
    /// Adds the turns of another log after those of this one.
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
        let codes = other.codes.iter().map(|code| TurnCode { turn: turns + code.turn, code: code.code.clone() });
        self.codes.extend(codes);
    }
}

impl From<BlockLog> for SentLog {
    fn from(log: BlockLog) -> Self {
        Self { log, codes: Vec::new() }
    }
}

impl BlockLog {
    /// Adds an event to a turn that is there: a cell, and the material that is placed, or none to remove.
    pub fn add_event(&mut self, turn: usize, cell: Cell, material: Option<&str>) {
        let event = match material {
            Some(name) => Event::Place { cell, material: self.palette.intern(name) },
            None => Event::Remove { cell },
        };
        self.turns[turn].push(event);
    }
}

/// The code alone, where it was sent with code fences around it: that of the last fence outside thinking tags, on the lines where it
/// stood, so that the lines of errors are those of what was sent.
#[must_use]
pub fn without_fences(code: &str) -> Cow<'_, str> {
    if fences(code).is_empty() {
        return Cow::Borrowed(code);
    }
    let (shown, _) = without_thoughts(code);
    let fences = fences(&shown);
    let is_filled = |fence: &&Fence| !shown[fence.content.clone()].trim().is_empty();
    Cow::Owned(match (fences.iter().rev().find(is_filled), fences.first()) {
        (Some(fence), _) => on_its_lines(&shown, fence.content.clone()),
        // The closing fence alone, after an opening one that stands in the prompt: the code is what comes before.
        (None, Some(fence)) => {
            let mark = shown[..fence.content.start].trim_end().rfind('\n').unwrap_or(0);
            shown[..mark].to_owned()
        }
        (None, None) => shown,
    })
}

/// A part of a text after as many line breaks as come before it there.
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
    fn code_is_taken_out_of_its_fences() {
        let code = "await skills.placeBlock(bot, 'stone', 0, 0, 0);";
        for (sent, expected) in [
            (code.to_owned(), code.to_owned()),
            (format!("So:\n```js\n{code}\n```\n"), format!("\n\n{code}\n")),
            (format!("{code}\n```"), code.to_owned()),
            (format!("{code}\n```\n"), code.to_owned()),
            (format!("<think>\n```\nno\n```\n</think>\n```\n{code}\n```"), format!("{}{code}\n", "\n".repeat(6))),
        ] {
            assert_eq!(without_fences(&sent), expected, "{sent}");
        }
    }
}
