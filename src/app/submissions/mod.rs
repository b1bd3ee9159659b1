//! Submissions: reading, checking against their tasks, and acceptance.

pub mod accept;
pub mod decision;
pub mod log_member;
pub mod posted;
pub mod stress;
