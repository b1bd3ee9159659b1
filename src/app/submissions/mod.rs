//! Submissions: read, checked against their tasks, accepted.

pub mod accept;
pub mod decision;
pub mod log_member;
pub mod posted;
