//! Submissions: reading bodies, checking against their tasks, acceptance; reading and cancelling what is stored.

pub mod accept;
pub mod cancel;
pub mod decision;
pub mod log_member;
pub mod log_size;
pub mod posted;
pub mod read;
pub mod stress;
