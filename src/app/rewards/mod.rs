//! Rewards: turns a request into a log, grades the log, and turns the report into a reward.

pub mod grade;
pub mod grader;
pub mod judge;
pub mod model_text;
pub mod request;
pub mod score;
