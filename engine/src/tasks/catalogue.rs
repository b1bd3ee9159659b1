//! The suites that a service offers, and how tasks are found in them.

use std::collections::HashMap;
use std::sync::Arc;

use super::{Suite, Task};

/// All suites, with their tasks found by id and by number.
#[derive(Debug, Default)]
pub struct Catalogue {
    suites: Vec<Arc<Entry>>,
}

/// A suite with its index.
#[derive(Debug)]
pub struct Entry {
    /// The suite.
    pub suite: Suite,
    /// Hash of each task, in the suite's order.
    pub hashes: Vec<String>,
    by_id: HashMap<String, usize>,
    by_number: HashMap<u32, usize>,
}

impl Catalogue {
    /// The catalogue of these suites.
    #[must_use]
    pub fn new(suites: Vec<Suite>) -> Self {
        Self { suites: suites.into_iter().map(|suite| Arc::new(Entry::new(suite))).collect() }
    }

    /// All suites, by name and version.
    #[must_use]
    pub fn suites(&self) -> &[Arc<Entry>] {
        &self.suites
    }

    /// The suite called `name@version`, or the latest version of the one called `name`.
    #[must_use]
    pub fn suite(&self, name: &str) -> Option<&Arc<Entry>> {
        if name.contains('@') {
            return self.suites.iter().find(|entry| entry.suite.id() == name);
        }
        self.suites.iter().filter(|entry| entry.suite.name == name).max_by_key(|entry| entry.suite.version)
    }
}

impl Entry {
    fn new(suite: Suite) -> Self {
        let tasks = || suite.tasks.iter().enumerate();
        Self {
            hashes: suite.tasks.iter().map(Task::content_hash).collect(),
            by_id: tasks().map(|(i, task)| (task.id.clone(), i)).collect(),
            by_number: tasks().map(|(i, task)| (task.number, i)).collect(),
            suite,
        }
    }

    /// The task with this id, with its hash.
    #[must_use]
    pub fn task(&self, id: &str) -> Option<(&Task, &str)> {
        self.by_id.get(id).map(|&i| (&self.suite.tasks[i], self.hashes[i].as_str()))
    }

    /// The task with this number, with its hash.
    #[must_use]
    pub fn task_numbered(&self, number: u32) -> Option<(&Task, &str)> {
        self.by_number.get(&number).map(|&i| (&self.suite.tasks[i], self.hashes[i].as_str()))
    }
}
