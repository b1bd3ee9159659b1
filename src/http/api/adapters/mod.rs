//! Adapters: the bodies that trainers of others already send for a reward.

pub mod nemo_gym;
pub mod nemo_metrics;
pub mod openrlhf;

use std::sync::Arc;

use serde_json::{Map, Value};

use super::grade::GradeBody;
use super::grade_request::ReadRequest;
use crate::http::problem::{ApiError, ApiResult};
use crate::http::state::AppState;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Catalogue;

/// Grades what a model wrote against the task that `naming` tells (`task`, `suite`, `reward`). An answer that cannot be graded has reward 0, and `answer.why` tells the reason.
///
/// # Errors
/// Where the task cannot be found (the trainer's fault) or grading failed (ours).
pub async fn judge(
    state: &AppState,
    who: &Arc<str>,
    catalogue: &Catalogue,
    naming: &Map<String, Value>,
    texts: Vec<String>,
) -> ApiResult<GradeBody> {
    let request = ReadRequest::read(request(naming).as_bytes(), catalogue)?.about(texts);
    let prepared = request.prepare(state, who).await.map_err(ApiError::without_reward_where_ours)?;
    Ok(prepared.grade(state, who).await?.0)
}

/// The same for one of many samples, which have a place together and wait for their turns beside the time that each may take.
///
/// # Errors
/// The same.
pub async fn judge_in_turn(
    state: &AppState,
    who: &Arc<str>,
    catalogue: &Catalogue,
    naming: &Map<String, Value>,
    text: String,
) -> ApiResult<GradeBody> {
    let request = ReadRequest::read(request(naming).as_bytes(), catalogue)?.about(vec![text]);
    let prepared = request.prepare_in_turn(state, who).await.map_err(ApiError::without_reward_where_ours)?;
    prepared.grade_in_turn(state, who).await
}

/// The request that names the task; what was done comes from the model.
fn request(naming: &Map<String, Value>) -> String {
    let mut request = naming.clone();
    request.retain(|_, value| !value.is_null());
    request.insert("turns".to_owned(), Value::Array(Vec::new()));
    Value::Object(request).to_string()
}

/// Names the members that look like one of these options misspelt, which was not given: what a trainer believes to have said, and has
/// not. A dataset has fields of its own; a short name must be one letter off, a long one may be three.
fn add_misspelt(object: &Map<String, Value>, missing: &[&str], faults: &mut Faults) {
    for key in object.keys().filter(|key| !missing.contains(&key.as_str())) {
        let meant = missing.iter().find(|option| {
            let allowed = if option.len() > 8 { 3 } else { 1 };
            strsim::osa_distance(&key.to_lowercase(), option) <= allowed
        });
        if let Some(meant) = meant {
            faults.add_at(key, format!("unknown; did you mean {meant}?"));
        }
    }
}
