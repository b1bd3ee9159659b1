//! References to tasks: how requests name them, and which task of a suite is meant.

use crate::app::limits::LIMITS;
use plumbline_engine::intake::Faults;
use plumbline_engine::intake::tolerant::{Scalar, Shape, Text};
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::text::did_you_mean;

/// Characters in the identifier of a task. Those that exist are shorter.
pub const TASK_CHARS: usize = LIMITS.task_chars;

/// Reference to a task of a suite.
#[derive(Debug, Clone, PartialEq, Eq, serde::Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
#[schema(as = TaskName)]
pub enum TaskRef {
    /// Identifier of the task.
    #[schema(example = "walls/5x1x5-raise")]
    Id(String),
    /// Number of the task in the suite.
    Number(u32),
}

impl TaskRef {
    /// Returns the number of the task in a suite; adds a fault at `task` if there is no such task.
    pub fn number_in(&self, entry: &Entry, faults: &mut Faults) -> Option<u32> {
        self.find_in(entry).map_err(|why| faults.add_at("task", why)).ok()
    }

    /// Returns the number of the task in a suite.
    ///
    /// # Errors
    /// Returns the reason in words if there is no such task.
    pub fn find_in(&self, entry: &Entry) -> Result<u32, String> {
        let found = match self {
            Self::Id(id) => entry.task(id),
            Self::Number(number) => entry.task_numbered(*number),
        };
        found.map(|(task, _)| task.number).ok_or_else(|| {
            let named = match self {
                Self::Id(id) => format!("{id:?}"),
                Self::Number(number) => format!("number {number}"),
            };
            let near = match self {
                Self::Id(id) => match id.parse().ok().and_then(|number| entry.task_numbered(number)) {
                    Some((task, _)) => {
                        format!("; for the task with this number, give {} as a number, not as a text", task.number)
                    }
                    None => near_tasks(entry, id),
                },
                Self::Number(_) => String::new(),
            };
            format!("{} has no task {named}; /v1/tasks lists them{near}", entry.id)
        })
    }
}

/// Suggests tasks, or families, that a wrong identifier may have meant, in words.
#[must_use]
pub fn near_tasks(entry: &Entry, id: &str) -> String {
    let family = &id.split('/').next().unwrap_or_default().to_lowercase();
    let tasks = &entry.suite.tasks;
    let of_family = tasks.iter().filter(|task| task.family() == family).map(|task| task.id.as_str());
    let found = did_you_mean(id, of_family);
    let families: std::collections::BTreeSet<&str> = tasks.iter().map(Task::family).collect();
    if found.is_empty() && !families.contains(family.as_str()) { did_you_mean(family, families) } else { found }
}

/// Shape of a reference to a task.
#[derive(Debug)]
pub struct TaskShape<'f> {
    /// Collector of faults.
    pub faults: &'f mut Faults,
}

impl Shape<'_> for TaskShape<'_> {
    type Out = TaskRef;

    fn wanted(&self) -> &'static str {
        "a task: its id or its number"
    }

    fn faults(&mut self) -> &mut Faults {
        self.faults
    }

    fn scalar(self, value: &Scalar<'_>) -> Option<TaskRef> {
        let number = match value {
            Scalar::Integer(number) => u32::try_from(*number).ok(),
            Scalar::Number(number) if number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(number) => {
                Some(*number as u32)
            }
            _ => None,
        };
        if let Some(number) = number {
            return Some(TaskRef::Number(number));
        }
        match value {
            text @ Scalar::Text(_) => {
                Text { faults: self.faults, min_chars: 1, max_chars: TASK_CHARS }.scalar(text).map(TaskRef::Id)
            }
            other => {
                self.faults.add(format!(
                    "expected a task's id (a string) or its number, from 1, found {other}; /v1/tasks lists them"
                ));
                None
            }
        }
    }
}
