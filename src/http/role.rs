//! Roles of nodes: which routes a node serves.

use crate::app::error::{AppError, AppResult};

/// Role of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Serves everything.
    Whole,
    /// Grades within requests and stores nothing: rewards, adapters and the catalogue.
    GradeOnly,
    /// Grades submissions, and serves probes and metrics.
    WorkOnly,
}

/// Routes that every node serves.
const EVERYWHERE: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Routes of a node that only grades: a path, or all paths under it.
const GRADING: [&str; 21] = [
    "/v1/grade",
    "/v1/grade:structure",
    "/v1/grade:batch",
    "/v1/tasks",
    "/v1/suites",
    "/v1/limits",
    "/v1/profiles",
    "/v1/agent-guide",
    "/v1/blocks",
    "/v1/replay",
    "/seed_session",
    "/verify",
    "/reverify_mode",
    "/close_session",
    "/aggregate_metrics",
    "/get_reward",
    "/ng-rollout",
    "/with-key",
    "/openapi.json",
    "/docs",
    "/assets",
];

impl Role {
    /// Returns whether a node of this role serves a path.
    #[must_use]
    pub fn serves(self, path: &str) -> bool {
        let is_at =
            |route: &&str| path.strip_prefix(*route).is_some_and(|rest: &str| rest.is_empty() || rest.starts_with('/'));
        match self {
            Self::Whole => true,
            Self::GradeOnly => EVERYWHERE.iter().chain(&GRADING).any(is_at),
            Self::WorkOnly => EVERYWHERE.iter().any(is_at),
        }
    }

    /// Refuses a path that a node of this role does not serve.
    ///
    /// # Errors
    /// Returns an error (404) that says which node serves it.
    pub fn must_serve(self, path: &str) -> AppResult<()> {
        if self.serves(path) {
            return Ok(());
        }
        Err(AppError::not_found(match self {
            Self::GradeOnly => {
                "this node only grades within requests (it was started with --grade-only); send this to a node with a \
                 database"
            }
            _ => {
                "this node only grades submissions (`plumbline work`); send this to a node that serves \
                 (`plumbline serve`)"
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_serves_whole_paths_and_what_is_under_them() {
        for (role, path, is_served) in [
            (Role::Whole, "/v1/runs", true),
            (Role::GradeOnly, "/v1/grade", true),
            (Role::GradeOnly, "/v1/grade:batch", true),
            (Role::GradeOnly, "/v1/tasks/walls/5x1x5-raise", true),
            (Role::GradeOnly, "/v1/graded", false),
            (Role::GradeOnly, "/v1/runs", false),
            (Role::GradeOnly, "/", false),
            (Role::WorkOnly, "/readyz", true),
            (Role::WorkOnly, "/v1/grade", false),
        ] {
            assert_eq!(role.serves(path), is_served, "{role:?} {path}");
        }
    }
}
