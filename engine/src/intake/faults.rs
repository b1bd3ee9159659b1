//! Faults: what is wrong with an input, each with the place where it is wrong.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

/// One thing wrong with an input.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// Line of an NDJSON body or file, counted from 1; absent for a single document.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// JSON pointer (RFC 6901) to the value; empty for the whole document.
    pub pointer: String,
    /// What is wrong, in words, with what was expected and what was found.
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

/// Step of a path into a document.
#[derive(Debug, Clone)]
enum Step {
    Key(String),
    Index(usize),
}

/// The faults found so far and the place being read. Keeps at most [`Faults::KEPT`], counts them all.
#[derive(Debug, Default)]
pub struct Faults {
    path: Vec<Step>,
    line: Option<u64>,
    list: Vec<Fault>,
    total: u64,
}

impl Faults {
    /// Faults listed at most; the rest are counted.
    pub const KEPT: usize = 100;

    /// Characters of a key shown in a pointer; a longer one ends in an ellipsis.
    const KEY_CHARS: usize = 100;

    /// No faults, at the root of a document.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// From here on, faults belong to this line of an NDJSON input, at its root.
    pub fn enter_line(&mut self, line: u64) {
        self.line = Some(line);
        self.path.clear();
    }

    /// Steps into the member `key`.
    pub fn enter_key(&mut self, key: &str) {
        let shown = match key.char_indices().nth(Self::KEY_CHARS) {
            Some((end, _)) => format!("{}…", &key[..end]),
            None => key.to_owned(),
        };
        self.path.push(Step::Key(shown));
    }

    /// Steps into the element `index`.
    pub fn enter_index(&mut self, index: usize) {
        self.path.push(Step::Index(index));
    }

    /// Steps back out.
    pub fn leave(&mut self) {
        self.path.pop();
    }

    /// Records a fault at the place being read.
    pub fn add(&mut self, detail: impl Into<String>) {
        self.total += 1;
        if self.list.len() < Self::KEPT {
            let fault = Fault { line: self.line, pointer: self.pointer(), detail: detail.into() };
            self.list.push(fault);
        }
    }

    /// Records a fault at member `key` of the place being read.
    pub fn add_at(&mut self, key: &str, detail: impl Into<String>) {
        self.enter_key(key);
        self.add(detail);
        self.leave();
    }

    /// The JSON pointer of the place being read.
    #[must_use]
    pub fn pointer(&self) -> String {
        let mut pointer = String::new();
        for step in &self.path {
            match step {
                Step::Key(key) => {
                    pointer.push('/');
                    pointer.push_str(&key.replace('~', "~0").replace('/', "~1"));
                }
                Step::Index(index) => {
                    // Writing to a string cannot fail.
                    let _ = write!(pointer, "/{index}");
                }
            }
        }
        pointer
    }

    /// Number of faults found, listed or not.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Whether nothing is wrong.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// The faults kept.
    #[must_use]
    pub fn list(&self) -> &[Fault] {
        &self.list
    }

    /// The faults kept, taken out.
    #[must_use]
    pub fn into_list(self) -> Vec<Fault> {
        self.list
    }
}
