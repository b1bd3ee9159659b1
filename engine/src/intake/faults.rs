//! Faults: the errors in an input, each with its location.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_path_to_error::Segment;

/// A single error in an input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Line of an NDJSON body or file, counted from 1; absent for a single document.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// JSON pointer (RFC 6901) to the value; empty for the whole document.
    pub pointer: String,
    /// Human-readable description of the error, with what was expected and what was found.
    pub detail: String,
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        if !self.pointer.is_empty() {
            write!(f, "{}: ", self.pointer)?;
        }
        f.write_str(&self.detail)
    }
}

/// A step of the path to a value in a document. Each number that is read with care enters and leaves one, so it owns
/// nothing.
#[derive(Debug, Clone, Copy)]
enum Step {
    Name(&'static str),
    /// The next of [`Faults::keys`].
    Key,
    Index(usize),
}

/// The faults found so far, and the current location in the input. Keeps up to [`Faults::KEPT`] faults, but counts all.
#[derive(Debug, Default)]
pub struct Faults {
    path: Vec<Step>,
    /// The keys of the steps [`Step::Key`] of the path, in order.
    keys: Vec<String>,
    line: Option<u64>,
    list: Vec<Fault>,
    total: u64,
}

impl Faults {
    /// Maximum number of faults kept; further ones are only counted.
    pub const KEPT: usize = 100;

    /// Maximum number of characters of a key in a pointer; a longer key is cut and ends in an ellipsis.
    const KEY_CHARS: usize = 100;

    /// Creates an empty collector, located at the root of a document.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Moves to the root of this line of an NDJSON input; further faults belong to that line.
    pub fn enter_line(&mut self, line: u64) {
        self.line = Some(line);
        self.path.clear();
        self.keys.clear();
    }

    /// Enters the member `key` of the current object.
    pub fn enter_key(&mut self, key: &str) {
        let shown = match key.char_indices().nth(Self::KEY_CHARS) {
            Some((end, _)) => format!("{}…", &key[..end]),
            None => key.to_owned(),
        };
        self.path.push(Step::Key);
        self.keys.push(shown);
    }

    /// Enters the member of the current object whose name the program knows.
    pub fn enter_name(&mut self, name: &'static str) {
        self.path.push(Step::Name(name));
    }

    /// Enters the element `index` of the current array.
    pub fn enter_index(&mut self, index: usize) {
        self.path.push(Step::Index(index));
    }

    /// Leaves the innermost member or element.
    pub fn leave(&mut self) {
        if let Some(Step::Key) = self.path.pop() {
            self.keys.pop();
        }
    }

    /// Enters what a path of serde leads to, and returns how deep the location was before. Steps that serde cannot name are
    /// left out.
    pub fn enter_path(&mut self, path: &serde_path_to_error::Path) -> usize {
        let depth = self.depth();
        for segment in path {
            match segment {
                Segment::Seq { index } => self.enter_index(*index),
                Segment::Map { key } | Segment::Enum { variant: key } => self.enter_key(key),
                Segment::Unknown => {}
            }
        }
        depth
    }

    /// Returns how many members and elements deep the current location is.
    pub(super) fn depth(&self) -> usize {
        self.path.len()
    }

    /// Leaves members and elements until the location is this deep.
    pub fn leave_to(&mut self, depth: usize) {
        while self.path.len() > depth {
            self.leave();
        }
    }

    /// Records a fault at the current location.
    pub fn add(&mut self, detail: impl Into<String>) {
        self.total += 1;
        if self.list.len() < Self::KEPT {
            let fault = Fault { line: self.line, pointer: self.pointer(), detail: detail.into() };
            self.list.push(fault);
        }
    }

    /// Records a fault at the member `key` of the current location.
    pub fn add_at(&mut self, key: &str, detail: impl Into<String>) {
        self.enter_key(key);
        self.add(detail);
        self.leave();
    }

    /// Returns whether no further fault is kept, so that nothing is gained by a text that takes long to make.
    #[must_use]
    pub fn are_full(&self) -> bool {
        self.list().len() >= Self::KEPT
    }

    /// Returns the JSON pointer of the current location.
    #[must_use]
    pub fn pointer(&self) -> String {
        let mut pointer = String::new();
        let mut keys = self.keys.iter();
        for step in &self.path {
            let key: &str = match step {
                Step::Name(name) => name,
                Step::Key => keys.next().expect("each key of the path is kept"),
                Step::Index(index) => {
                    // Writing to a string cannot fail.
                    let _ = write!(pointer, "/{index}");
                    continue;
                }
            };
            pointer.push('/');
            pointer.push_str(&key.replace('~', "~0").replace('/', "~1"));
        }
        pointer
    }

    /// Returns the number of all faults found, kept or not.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Returns whether no faults were found.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// Returns the kept faults.
    #[must_use]
    pub fn list(&self) -> &[Fault] {
        &self.list
    }

    /// Consumes the collector and returns the kept faults.
    #[must_use]
    pub fn into_list(self) -> Vec<Fault> {
        self.list
    }
}
