//! Rewards: a request becomes a log, the log is graded, the report becomes a reward.

pub mod grade;
pub mod grader;
pub mod judge;
pub mod model_text;
pub mod request;
pub mod score;
