//! Judging of texts that a model wrote, for trainers that name the task separately.

use std::sync::Arc;
use std::time::Instant;

use serde_json::{Map, Value};

use super::grade::ReadRequest;
use super::in_time::{code_in_time, graded_in_time};
use super::score::GradeBody;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::tasks::catalogue::Catalogue;

/// Grades the texts of a model against the task that `naming` selects (`task`, `suite`, `reward`). A text that cannot
/// be graded has reward 0, and `answer.why` gives the reason. The time that it waits to be graded does not count as time
/// for grading.
///
/// # Errors
/// Returns an error if the task cannot be found (the trainer's fault) or grading failed (ours).
pub async fn judge(
    app: &App,
    who: &Arc<str>,
    catalogue: &Catalogue,
    naming: Map<String, Value>,
    texts: Vec<String>,
) -> AppResult<GradeBody> {
    let begun = Instant::now();
    // What names the task may have grown into much memory: it is gone before anything waits.
    let request = request(naming);
    let read = ReadRequest::read(request.as_bytes(), catalogue)?.about(texts);
    drop(request);
    let prepared = code_in_time(None, read.prepare_in_turn(app, who)).await;
    let prepared = prepared.map_err(AppError::without_reward_where_ours)?;
    graded_in_time(begun, prepared.grade_in_turn(app, who)).await
}

/// Creates the request that names the task, with an empty log in place of the model's.
fn request(mut request: Map<String, Value>) -> String {
    request.retain(|_, value| !value.is_null());
    request.insert("turns".to_owned(), Value::Array(Vec::new()));
    Value::Object(request).to_string()
}
