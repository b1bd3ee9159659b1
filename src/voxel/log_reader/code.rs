//! Turns that bring action code instead of events: the code is read here, and becomes events elsewhere.

use super::super::block_log::{BlockLog, Event};
use super::super::cell::Cell;

/// The action code of a turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TurnCode {
    /// Place of the turn in the log, from 0.
    pub turn: usize,
    /// The code.
    pub code: String,
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
