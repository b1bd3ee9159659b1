//! Tasks: what agents are asked to build and how it is checked; suites of tasks; draws from them.

pub mod catalogue;
pub mod embedded;
pub mod family;
pub mod hidden;
pub mod lite;
pub mod published;
pub mod reported;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::checks::{Check, Criterion};
use family::Category;

/// One instruction of a task and the checks of what stands after it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Instruction {
    /// What the agent is told.
    pub prompt: String,
    /// The checks, in order.
    pub checks: Vec<Check>,
    /// Checks whose result is shown and does not count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub informational: Vec<Check>,
}

/// A problem: one or more instructions, each with its checks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// `family/instance`: readable, stable, unique in its suite.
    pub id: String,
    /// Number in the suite, from 1: the `run_idx` of published records.
    pub number: u32,
    /// One of the five categories; absent in suites of others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<Category>,
    /// One of the paper's 17 types; absent in suites of others.
    #[serde(rename = "type", default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// What this instance of its family is made from, by name.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub parameters: Map<String, Value>,
    /// The instructions, one per turn.
    pub turns: Vec<Instruction>,
}

impl Instruction {
    /// An instruction all of whose checks count.
    #[must_use]
    pub const fn new(prompt: String, checks: Vec<Check>) -> Self {
        Self { prompt, checks, informational: Vec::new() }
    }
}

impl Task {
    /// A task of others, of which no parameters are known.
    #[must_use]
    pub fn foreign(id: String, number: u32, turns: Vec<Instruction>) -> Self {
        Self { id, number, category: None, kind: None, parameters: Map::new(), turns }
    }

    /// The group of tasks this one belongs to: the part of its id before the slash.
    #[must_use]
    pub fn family(&self) -> &str {
        self.id.split_once('/').map_or(self.id.as_str(), |(family, _)| family)
    }

    /// SHA-256 over the task's JSON, in hex: changes with any prompt, check or argument.
    #[must_use]
    pub fn content_hash(&self) -> String {
        hex(&Sha256::digest(serde_json::to_vec(self).unwrap_or_default()))
    }

    /// All checks of all turns that count.
    pub fn checks(&self) -> impl Iterator<Item = &Check> {
        self.turns.iter().flat_map(|turn| &turn.checks)
    }

    /// The criteria that apply: those with at least one check (SPEC 5), in the paper's order.
    #[must_use]
    pub fn criteria(&self) -> Vec<Criterion> {
        let applies = |criterion: &Criterion| self.checks().any(|check| check.criterion() == *criterion);
        Criterion::ALL.into_iter().filter(applies).collect()
    }
}

/// An ordered set of tasks under a name and a version. A change to any task makes a new version.
#[derive(Debug, Clone, PartialEq)]
pub struct Suite {
    /// Name without version, such as `mineceraft`.
    pub name: String,
    /// Version, from 1.
    pub version: u32,
    /// The tasks in order of their numbers.
    pub tasks: Vec<Task>,
}

impl Suite {
    /// `name@version`.
    #[must_use]
    pub fn id(&self) -> String {
        format!("{}@{}", self.name, self.version)
    }

    /// Number of turns over all tasks: the "instruction entries" of the paper.
    #[must_use]
    pub fn instruction_count(&self) -> usize {
        self.tasks.iter().map(|task| task.turns.len()).sum()
    }

    /// Number of checks over all turns.
    #[must_use]
    pub fn check_count(&self) -> usize {
        self.tasks.iter().map(|task| task.checks().count()).sum()
    }

    /// Tasks by family, in the order of the suite.
    #[must_use]
    pub fn families(&self) -> Vec<&[Task]> {
        self.tasks.chunk_by(|a, b| a.family() == b.family()).collect()
    }
}

/// Bytes as lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(bytes.len() * 2), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}
