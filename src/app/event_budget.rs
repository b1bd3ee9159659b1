//! What one body may still add to its logs.

use crate::app::limits::Limits;

/// What the code and the structure files of one body may still do.
#[derive(Debug)]
pub struct EventBudget {
    /// Events that may still be recorded.
    left: usize,
    /// Structure files that may still be read.
    files: usize,
}

impl EventBudget {
    /// Creates the full budget.
    #[must_use]
    pub fn whole(limits: &Limits) -> Self {
        Self { left: limits.action_body_events, files: limits.structures_in_body }
    }

    /// Takes a structure file; returns false if the body has too many.
    pub(in crate::app) fn take_file(&mut self) -> bool {
        let is_left = self.files > 0;
        self.files = self.files.saturating_sub(1);
        is_left
    }

    /// Takes events; returns false if the body has too many.
    pub(in crate::app) fn take_events(&mut self, events: usize) -> bool {
        let is_left = events <= self.left;
        self.left = self.left.saturating_sub(events);
        is_left
    }
}
