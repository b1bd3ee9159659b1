//! Tasks, the suites that contain them, and draws from suites. A task says what to build and how to check it.

pub mod catalogue;
pub mod embedded;
pub mod family;
pub mod hidden;
pub mod lite;
pub mod published;
pub mod reported;
pub mod track;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::checks::{Check, Criterion};
use crate::voxel::{Profile, Reading};
use family::Category;
pub use track::Track;

/// One instruction of a task, with the checks of the structure that stands after it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Instruction {
    /// Text given to the agent.
    pub prompt: String,
    /// Text given to the agent on the track `brief`; absent if the suite has no such track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brief: Option<String>,
    /// Checks that count, in order.
    pub checks: Vec<Check>,
    /// Checks whose results are reported but do not count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub informational: Vec<Check>,
}

/// A problem of one or more instructions, each with its checks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// Readable and stable identifier, `family/instance`, unique in its suite.
    pub id: String,
    /// Number in the suite, from 1; the `run_idx` of published records.
    pub number: u32,
    /// One of the five categories; absent if the task does not come from a family file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<Category>,
    /// One of the paper's 17 types; absent if the task does not come from a family file.
    #[serde(rename = "type", default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// Parameters of this instance of its family, by name.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub parameters: Map<String, Value>,
    /// How the blocks of a log are read before they are checked.
    #[serde(default, skip_serializing_if = "Reading::is_as_listed")]
    pub reading: Reading,
    /// What the prompts mention and no check measures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unmeasured: Vec<String>,
    /// Instructions, one per turn.
    pub turns: Vec<Instruction>,
}

impl Instruction {
    /// Creates an instruction whose checks all count.
    #[must_use]
    pub const fn new(prompt: String, checks: Vec<Check>) -> Self {
        Self { prompt, brief: None, checks, informational: Vec::new() }
    }
}

impl Instruction {
    /// Returns the prompt of a track, or `None` if the suite has no such track.
    #[must_use]
    pub fn prompt_on(&self, track: Track) -> Option<&str> {
        match track {
            Track::Specified => Some(&self.prompt),
            Track::Brief => self.brief.as_deref(),
        }
    }
}

impl Task {
    /// Creates a task that comes from no family file, so that it has neither category nor type nor parameters.
    #[must_use]
    pub fn foreign(id: String, number: u32, turns: Vec<Instruction>) -> Self {
        Self {
            id,
            number,
            category: None,
            kind: None,
            parameters: Map::new(),
            reading: Reading::AsListed,
            unmeasured: Vec::new(),
            turns,
        }
    }

    /// Returns the name of the task's family, which is the part of its id before the slash.
    #[must_use]
    pub fn family(&self) -> &str {
        self.id.split_once('/').map_or(self.id.as_str(), |(family, _)| family)
    }

    /// Returns the SHA-256 hash of the task's JSON, in hex. It changes with any prompt, check or argument.
    #[must_use]
    pub fn content_hash(&self) -> String {
        hex(&Sha256::digest(serde_json::to_vec(self).expect("a task is JSON")))
    }

    /// Returns the checks that count, over all turns.
    pub fn checks(&self) -> impl Iterator<Item = &Check> {
        self.turns.iter().flat_map(|turn| &turn.checks)
    }

    /// Returns the criteria that apply, i.e. those with at least one check (`docs/rules.md#scores`), in the paper's
    /// order.
    #[must_use]
    pub fn criteria(&self) -> Vec<Criterion> {
        let applies = |criterion: &Criterion| self.checks().any(|check| check.criterion() == *criterion);
        Criterion::ALL.into_iter().filter(applies).collect()
    }
}

/// Computes the hash of a suite's content from those of its tasks, in hex, and from its preamble.
#[must_use]
pub fn content_hash_of(tasks: &[String], preamble: Option<&str>) -> String {
    hex(&Sha256::digest(tasks.concat() + preamble.unwrap_or_default()))
}

/// An ordered set of tasks with a name and a version. Changing any task requires a new version.
#[derive(Debug, Clone, PartialEq)]
pub struct Suite {
    /// Name without the version, such as `mineceraft`.
    pub name: String,
    /// Version number, from 1.
    pub version: u32,
    /// Conventions that the prompts of the track `brief` take for granted; none if the suite has no such track.
    pub preamble: Option<String>,
    /// Tasks in the order of their numbers.
    pub tasks: Vec<Task>,
}

impl Suite {
    /// Returns the suite's identifier, `name@version`.
    #[must_use]
    pub fn id(&self) -> String {
        format!("{}@{}", self.name, self.version)
    }

    /// Returns the hash of the suite's content: of the hashes of its tasks, in order, and of its preamble, if it has one.
    #[must_use]
    pub fn content_hash(&self) -> String {
        let tasks: Vec<String> = self.tasks.iter().map(Task::content_hash).collect();
        content_hash_of(&tasks, self.preamble.as_deref())
    }

    /// Returns the profile of action code that names none: `mindcraft` for the benchmark's suites from version 3 on,
    /// whose prompts are written for it.
    #[must_use]
    pub fn profile(&self) -> Profile {
        let is_ours = self.name == "mineceraft" || self.name.starts_with("mineceraft-");
        if is_ours && self.version >= 3 { Profile::Mindcraft } else { Profile::Published }
    }

    /// Returns the tracks of prompts that the suite has.
    #[must_use]
    pub fn tracks(&self) -> &'static [Track] {
        if self.preamble.is_some() { &Track::ALL } else { &[Track::Specified] }
    }

    /// Tells that the suite has no prompts of a track; nothing if it has.
    #[must_use]
    pub fn lacks(&self, track: Track) -> Option<String> {
        let is_there = self.tracks().contains(&track);
        (!is_there).then(|| format!("{} has no prompts of the track {}", self.id(), track.name()))
    }

    /// Counts the turns of all tasks, which the paper calls "instruction entries".
    #[must_use]
    pub fn instruction_count(&self) -> usize {
        self.tasks.iter().map(|task| task.turns.len()).sum()
    }

    /// Counts the checks that count, over all turns of all tasks.
    #[must_use]
    pub fn check_count(&self) -> usize {
        self.tasks.iter().map(|task| task.checks().count()).sum()
    }

    /// Groups the tasks by family, in the order of the suite.
    #[must_use]
    pub fn families(&self) -> Vec<&[Task]> {
        self.tasks.chunk_by(|a, b| a.family() == b.family()).collect()
    }
}

/// Encodes bytes as lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    let digits = bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]);
    digits.map(|digit| char::from(DIGITS[usize::from(digit)])).collect()
}
