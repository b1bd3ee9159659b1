//! The task that a request to grade names or brings.

use std::sync::Arc;

use super::score::UnmeasuredCheck;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::checks::Dimension;
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::voxel::Profile;

/// Task to grade against, with its hash.
#[derive(Debug, Clone)]
pub enum GivenTask {
    /// Task of a suite, by its number.
    Listed(Arc<Entry>, u32),
    /// Task that the request brings.
    Inline(Arc<(Task, String)>),
}

impl GivenTask {
    /// Creates a task that the request brings.
    #[must_use]
    pub fn inline(task: Task) -> Self {
        let hash = task.content_hash();
        Self::Inline(Arc::new((task, hash)))
    }

    /// Returns the profile of action code that names none.
    #[must_use]
    pub fn profile(&self) -> Profile {
        match self {
            Self::Inline(_) => Profile::Published,
            Self::Listed(entry, _) => entry.suite.profile(),
        }
    }

    /// Returns the task without the checks of the order of blocks, and the checks left out.
    ///
    /// # Errors
    /// Returns 500 if the suite has no task of this number; the number was looked up before.
    pub fn without_order(&self) -> AppResult<(Self, Vec<UnmeasuredCheck>)> {
        let mut task = self.task()?.0.clone();
        let mut left_out = Vec::new();
        for (turn, number) in task.turns.iter_mut().zip(1..) {
            turn.checks.retain(|check| {
                let is_measured = check.criterion().dimension() != Dimension::Planning;
                if !is_measured {
                    left_out.push(UnmeasuredCheck {
                        turn: number,
                        name: check.name().to_owned(),
                        criterion: check.criterion(),
                        why: "a structure file does not tell in which order its blocks were placed",
                    });
                }
                is_measured
            });
        }
        if left_out.is_empty() { Ok((self.clone(), left_out)) } else { Ok((Self::inline(task), left_out)) }
    }

    /// Returns the task and its hash.
    ///
    /// # Errors
    /// Returns 500 if the suite has no task of this number; the number was looked up before.
    pub fn task(&self) -> AppResult<(&Task, &str)> {
        match self {
            Self::Inline(task) => Ok((&task.0, &task.1)),
            Self::Listed(entry, number) => entry
                .task_numbered(*number)
                .ok_or_else(|| AppError::internal(&format!("{} has no task {number}", entry.id))),
        }
    }
}
