//! Accounts: quotas, and events to follow.

pub mod events;
pub mod quota;
