//! Accounts: quotas, teams, and events to follow.

pub mod body;
pub mod events;
pub mod operations;
pub mod quota;
pub mod team;
