//! Judging what a model wrote, for trainers that name the task beside it.

use std::sync::Arc;

use serde_json::{Map, Value};

use super::grade::ReadRequest;
use super::score::GradeBody;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::tasks::catalogue::Catalogue;

/// Grades what a model wrote against the task that `naming` tells (`task`, `suite`, `reward`). An answer that cannot be graded has reward 0, and `answer.why` tells the reason.
///
/// # Errors
/// Where the task cannot be found (the trainer's fault) or grading failed (ours).
pub async fn judge(
    app: &App,
    who: &Arc<str>,
    catalogue: &Catalogue,
    naming: &Map<String, Value>,
    texts: Vec<String>,
) -> AppResult<GradeBody> {
    let request = ReadRequest::read(request(naming).as_bytes(), catalogue)?.about(texts);
    let prepared = request.prepare(app, who).await.map_err(AppError::without_reward_where_ours)?;
    Ok(prepared.grade(app, who).await?.0)
}

/// The same for one of many samples, which have a place together and wait for their turns beside the time that each may take.
///
/// # Errors
/// The same.
pub async fn judge_in_turn(
    app: &App,
    who: &Arc<str>,
    catalogue: &Catalogue,
    naming: &Map<String, Value>,
    text: String,
) -> AppResult<GradeBody> {
    let request = ReadRequest::read(request(naming).as_bytes(), catalogue)?.about(vec![text]);
    let prepared = request.prepare_in_turn(app, who).await.map_err(AppError::without_reward_where_ours)?;
    prepared.grade_in_turn(app, who).await
}

/// The request that names the task; what was done comes from the model.
fn request(naming: &Map<String, Value>) -> String {
    let mut request = naming.clone();
    request.retain(|_, value| !value.is_null());
    request.insert("turns".to_owned(), Value::Array(Vec::new()));
    Value::Object(request).to_string()
}
