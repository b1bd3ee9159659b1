//! The suites that a service offers, and the lookup of their tasks.

use std::collections::HashMap;
use std::sync::Arc;

use super::{Suite, Task};

/// All suites, with their tasks indexed by id and by number.
#[derive(Debug, Default)]
pub struct Catalogue {
    suites: Vec<Arc<Entry>>,
}

/// A suite with indexes of its tasks.
#[derive(Debug)]
pub struct Entry {
    /// Name and version of the suite, `name@version`.
    pub id: String,
    /// The suite.
    pub suite: Suite,
    /// Content hash of each task, in the suite's order.
    pub hashes: Vec<String>,
    by_id: HashMap<String, usize>,
    by_number: HashMap<u32, usize>,
}

impl Catalogue {
    /// Creates the catalogue of these suites, in the given order.
    #[must_use]
    pub fn new(suites: Vec<Suite>) -> Self {
        Self { suites: suites.into_iter().map(|suite| Arc::new(Entry::new(suite))).collect() }
    }

    /// Returns all suites, in the order in which they were given.
    #[must_use]
    pub fn suites(&self) -> &[Arc<Entry>] {
        &self.suites
    }

    /// Finds a suite by `name@version`, or the latest version of it by `name`.
    #[must_use]
    pub fn suite(&self, name: &str) -> Option<&Arc<Entry>> {
        if name.contains('@') {
            return self.suites.iter().find(|entry| entry.id == name);
        }
        self.suites.iter().filter(|entry| entry.suite.name == name).max_by_key(|entry| entry.suite.version)
    }
}

impl Entry {
    fn new(suite: Suite) -> Self {
        let tasks = || suite.tasks.iter().enumerate();
        Self {
            id: suite.id(),
            hashes: suite.tasks.iter().map(Task::content_hash).collect(),
            by_id: tasks().map(|(i, task)| (task.id.clone(), i)).collect(),
            by_number: tasks().map(|(i, task)| (task.number, i)).collect(),
            suite,
        }
    }

    /// Finds a task by its id; returns it with its hash.
    #[must_use]
    pub fn task(&self, id: &str) -> Option<(&Task, &str)> {
        self.by_id.get(id).map(|&i| (&self.suite.tasks[i], self.hashes[i].as_str()))
    }

    /// Finds a task by its number; returns it with its hash.
    #[must_use]
    pub fn task_numbered(&self, number: u32) -> Option<(&Task, &str)> {
        self.by_number.get(&number).map(|&i| (&self.suite.tasks[i], self.hashes[i].as_str()))
    }
}
