//! Leaderboards: rows, comparisons, and actions of operators on rows.

#![expect(clippy::missing_errors_doc, reason = "each handler lists its errors as responses of the OpenAPI document")]

pub mod actions;
pub mod body;
pub mod comparisons;
pub mod formats;
pub mod leaderboard;
pub mod repeats;
