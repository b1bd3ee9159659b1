//! Rewards: turns a request into a log, grades the log, and turns the report into a reward.

pub mod given_task;
pub mod grade;
pub mod grader;
pub mod in_time;
pub mod judge;
pub mod model_text;
pub mod reading;
pub mod request;
pub mod results;
pub mod scheme;
pub mod score;
pub mod task_member;
