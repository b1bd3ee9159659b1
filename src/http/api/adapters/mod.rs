//! Adapters: the bodies that trainers of others already send for a reward.

pub mod nemo_gym;
pub mod openrlhf;

use serde_json::Value;

use super::super::limits::LIMITS;
use super::super::problem::{ApiError, ApiResult};
use super::super::state::AppState;
use super::grade::{GradeBody, prepare_with};
use crate::tasks::catalogue::Catalogue;
use crate::voxel::BlockLog;
use crate::voxel::log_reader::text::read_log_in_text;

/// What came of one answer of a model.
#[derive(Debug)]
pub enum Judged {
    /// Its log was graded.
    Graded(Box<GradeBody>),
    /// It holds no log that fits the task: the model's own failure, so its reward is 0.
    Unreadable(String),
}

impl Judged {
    /// The reward.
    #[must_use]
    pub fn reward(&self) -> f64 {
        match self {
            Self::Graded(graded) => graded.reward,
            Self::Unreadable(_) => 0.0,
        }
    }
}

/// Grades the log in a model's answer against the task that `naming` tells (`task`, `suite`, `reward`), on this thread.
///
/// # Errors
/// Where the task cannot be found (the trainer's fault) or grading failed (ours).
pub fn judge(state: &AppState, catalogue: &Catalogue, naming: &Value, answer: &str) -> ApiResult<Judged> {
    let (log, why) = match read_log_in_text(answer, LIMITS.log()) {
        Ok(log) => (log, None),
        // The task must be right all the same.
        Err(why) => (BlockLog::default(), Some(why)),
    };
    match (prepare_with(request(naming).as_bytes(), Some(log), catalogue), why) {
        (Ok(_), Some(why)) => Ok(Judged::Unreadable(why)),
        (Ok(prepared), None) => Ok(Judged::Graded(Box::new(prepared.grade_here(state)?))),
        (Err(error), why) => log_fault(error).map(|fault| Judged::Unreadable(why.unwrap_or(fault))),
    }
}

/// What is wrong with the log, where nothing else is wrong with a request.
///
/// # Errors
/// The error itself, where something else is.
fn log_fault(error: ApiError) -> ApiResult<String> {
    let problem = error.problem();
    let is_about_log = !problem.faults.is_empty() && problem.faults.iter().all(|f| f.pointer.starts_with("/turns"));
    if !is_about_log {
        return Err(error);
    }
    Ok(problem.faults.first().map(|fault| fault.detail.clone()).unwrap_or_default())
}

/// The request that names the task; its log comes from the answer.
fn request(naming: &Value) -> String {
    let mut request = serde_json::Map::new();
    for key in ["task", "suite", "reward"] {
        if let Some(value) = naming.get(key).filter(|value| !value.is_null()) {
            request.insert(key.to_owned(), value.clone());
        }
    }
    request.insert("turns".to_owned(), Value::Array(Vec::new()));
    Value::Object(request).to_string()
}
