//! Synchronous grading of a structure file.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult, FaultBody};
use crate::app::rewards::grade::ReadRequest;
use crate::app::rewards::score::GradeBody;
use crate::http::extract::body::RawBody;
use crate::http::extract::params::{Params, position};
use crate::http::state::AppState;
use crate::http::submissions::structure::StructureFile;
use crate::store::keys::Scope;
use plumbline_engine::tasks::catalogue::Catalogue;

/// Query parameters of a structure file to grade.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StructureGradeQuery {
    /// Identifier of the task, which must have one turn.
    #[param(example = "walls/5x1x5-raise")]
    task: String,
    /// Suite of the task: name, or name@version.
    suite: Option<String>,
    /// Where the least corner of the file's box goes: `x,y,z`. By default where a paste at (0, 0, 0) puts it.
    #[param(example = "0,0,0")]
    corner: Option<String>,
    /// Reward scheme: `strict`, `shaped` or `mean`; `strict` by default.
    reward: Option<String>,
    /// Level of detail of the response: `scores` or `report`; `scores` by default.
    detail: Option<String>,
}

impl StructureGradeQuery {
    /// Returns the request that grades a file as `/v1/grade` takes it.
    fn request(&self, file: &[u8]) -> AppResult<Value> {
        let mut turn = json!({ "structure": STANDARD.encode(file) });
        if let Some(corner) = &self.corner {
            turn["corner"] = json!(position("corner", corner)?);
        }
        let number = self.task.parse::<u32>().map(|number| json!(number));
        let mut request = json!({ "task": number.unwrap_or_else(|_| json!(self.task)), "turns": [turn] });
        for (member, value) in [("suite", &self.suite), ("reward", &self.reward), ("detail", &self.detail)] {
            if let Some(value) = value {
                request[member] = json!(value);
            }
        }
        Ok(request)
    }
}

/// Names the places of faults as the sender knows them: parameters, and the file.
fn placed(error: AppError) -> AppError {
    let told = error.faults().iter().cloned().map(|fault| match fault.pointer.as_str() {
        "/turns/0/corner" => FaultBody::of_parameter("corner", fault.detail),
        "/turns" if fault.detail.contains("the task has") => {
            FaultBody::of_parameter("task", "it has several turns; send a structure for each of them to /v1/grade")
        }
        "/turns" | "/turns/0/structure" => FaultBody { pointer: String::new(), ..fault },
        pointer => match pointer.strip_prefix('/') {
            Some(name @ ("task" | "suite" | "reward" | "detail")) => FaultBody::of_parameter(name, fault.detail),
            _ => fault,
        },
    });
    let told: Vec<FaultBody> = told.collect();
    if told.is_empty() { error } else { error.with_fault_list(told) }
}

/// Grades a structure file.
///
/// The body is the bytes of the file (`.nbt`, `.schem` or `.litematic`), for a task of one turn. For tasks of several
/// turns, send a file for each turn to `/v1/grade`. A file does not tell in which order its blocks were placed, so
/// checks of planning are left out, and `not_measured` lists them.
#[utoipa::path(
    post, path = "/v1/grade:structure", operation_id = "grade_structure", tag = "rewards",
    summary = "Grade a structure file",
    params(StructureGradeQuery),
    request_body(content = StructureFile, content_type = "application/octet-stream"),
    responses(
        (status = 200, description = "Scores and reward", body = GradeBody,
         example = json!({ "task": "walls/5x1x5-raise", "reward": 1.0, "scheme": "strict", "overall": true, "accuracy": true,
                           "criteria": [], "checks": [], "timings": { "read_us": 20, "grade_us": 30 } })),
        (status = 504, description = "The deadline passed"),
    )
)]
pub async fn grade_structure(
    State(state): State<AppState>,
    caller: Caller,
    Params(query): Params<StructureGradeQuery>,
    body: RawBody,
) -> AppResult<Json<GradeBody>> {
    caller.require(Scope::Grade)?;
    let who = caller.who();
    let _permit = state.grader.admit(who).map_err(AppError::without_reward)?;
    let request = Bytes::from(query.request(&body.bytes)?.to_string());
    let read = |catalogue: Arc<Catalogue>| {
        let request = request.clone();
        async move {
            let reading = tokio::task::spawn_blocking(move || ReadRequest::read(&request, &catalogue));
            reading.await.map_err(|error| AppError::internal(&error))?
        }
    };
    let request = state.with_catalogue(read).await.map_err(placed)?;
    let prepared = request.prepare(&state, who).await.map_err(|error| placed(error.without_reward_where_ours()))?;
    Ok(Json(prepared.grade(&state, who).await?.0))
}
