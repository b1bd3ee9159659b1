//! Boards: finished runs of a suite, ordered and compared, and what operators did to their rows.

pub mod actions;
pub mod agents;
pub mod breakdown;
pub mod cache;
pub mod comparison;
pub mod leaderboard;
pub mod news;
pub mod read;
pub mod repeats;
pub mod tasks;
