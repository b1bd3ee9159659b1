//! Ending a run: finishing it, with the tasks that it skips, or deleting it while it is open.

use axum::Json;
use axum::extract::{Path, State};
use serde::Deserialize;

use super::resource::{RunBody, run_body};
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::posted::TaskRef;
use crate::clock::now_ms;
use crate::http::extract::body::{JsonBody, read_json};
use crate::http::state::AppState;
use crate::store::keys::Scope;
use crate::store::run_rows::{RunRow, Skip};
use crate::store::runs::RunChanged;
use plumbline_engine::intake::Faults;

/// Body that finishes a run.
#[derive(Debug, Default, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({ "skip": "unanswered" }))]
pub struct FinishBody {
    /// Tasks that are skipped on purpose. They count as failed, and as covered: a run that covers too little of its
    /// suite is not compared with others on the board.
    skip: Option<SkipBody>,
}

/// Tasks that a run skips.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
pub enum SkipBody {
    /// All tasks without a submission.
    All(SkipAll),
    /// The listed tasks.
    Tasks(Vec<TaskRef>),
}

/// Name for all tasks without a submission.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SkipAll {
    /// Tasks without a submission.
    Unanswered,
}

/// Declares that no more submissions will come, and which tasks are skipped on purpose. Tasks without a submission
/// count as failed. The run finishes when all its submissions have been graded. The body is optional.
#[utoipa::path(
    post, path = "/v1/runs/{id}/finish", operation_id = "finish_run", tag = "runs", summary = "Finish a run",
    params(("id" = String, Path, description = "The run's id")),
    request_body(content = Option<FinishBody>, content_type = "application/json"),
    responses(
        (status = 409, description = "It was deleted, or finished before with other tasks skipped"),
        (status = 200, description = "The run; its state is finishing or finished", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "finishing", "pending": 2 })),
    )
)]
pub async fn finish_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
    body: Option<JsonBody>,
) -> AppResult<Json<RunBody>> {
    caller.require(Scope::Submit)?;
    let asked: FinishBody = body.as_ref().map(read_json).transpose()?.unwrap_or_default();
    let run = own_run(&state, &caller, &id).await?;
    let skip = match asked.skip {
        None => None,
        Some(SkipBody::All(SkipAll::Unanswered)) => Some(Skip::Unanswered),
        Some(SkipBody::Tasks(names)) => Some(Skip::Tasks(numbers_of(&state, &run, names).await?)),
    };
    match state.store.finish_run(&id, skip.as_ref(), now_ms()).await? {
        RunChanged::Answered(numbers) => {
            let mut faults = Faults::new();
            let entry = state.suite(&run.suite_id).await?;
            let ids = numbers.iter().filter_map(|number| Some(entry.task_numbered(*number)?.0.id.as_str()));
            let ids: Vec<&str> = ids.collect();
            faults.add_at("skip", format!("already answered, so they cannot be skipped: {}", ids.join(", ")));
            Err(AppError::faulty(faults))
        }
        changed => {
            refuse_unless_done(&changed, &id)?;
            Ok(Json(run_body(&state, &id).await?))
        }
    }
}

/// Returns the run if it belongs to the caller.
async fn own_run(state: &AppState, caller: &Caller, id: &str) -> AppResult<RunRow> {
    let run = state.store.run(id).await?;
    let run = run.ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))?;
    caller.require_own(run.owner.as_deref(), "run")?;
    Ok(run)
}

/// Returns the numbers of the named tasks, sorted and without repetitions.
async fn numbers_of(state: &AppState, run: &RunRow, names: Vec<TaskRef>) -> AppResult<Vec<u32>> {
    let entry = state.suite(&run.suite_id).await?;
    let mut faults = Faults::new();
    faults.enter_key("skip");
    if names.len() > entry.suite.tasks.len() {
        faults.add(format!("{} tasks; {} has {}", names.len(), entry.suite.id(), entry.suite.tasks.len()));
        return Err(AppError::faulty(faults));
    }
    let mut numbers = Vec::with_capacity(names.len());
    for (i, name) in names.into_iter().enumerate() {
        faults.enter_index(i);
        match name.find_in(&entry) {
            Ok(number) => numbers.push(number),
            Err(why) => faults.add(why),
        }
        faults.leave();
    }
    numbers.sort_unstable();
    numbers.dedup();
    if faults.is_empty() { Ok(numbers) } else { Err(AppError::faulty(faults)) }
}

fn refuse_unless_done(changed: &RunChanged, id: &str) -> AppResult<()> {
    match changed {
        RunChanged::Done | RunChanged::Answered(_) => Ok(()),
        RunChanged::NoSuchRun => Err(AppError::not_found(format!("there is no run {id:?}"))),
        RunChanged::NotOpen(state) => {
            Err(AppError::conflict("run-not-open", format!("the run is already {}", state.name())))
        }
    }
}

/// Deletes a run that is still open. Its pending submissions are cancelled, and only `state=deleted` lists it. Reports
/// and receipts of its graded submissions stay, and the board still counts it among the runs that the agent has begun.
/// A finished run cannot be deleted.
#[utoipa::path(
    delete, path = "/v1/runs/{id}", operation_id = "delete_run", tag = "runs", summary = "Delete an open run",
    params(("id" = String, Path, description = "The run's id")),
    responses(
        (status = 200, description = "The deleted run", body = RunBody,
         example = json!({ "id": "0198c0de-0000-7000-8000-000000000000", "state": "deleted", "pending": 0 })),
        (status = 409, description = "It is not open any more"),
    )
)]
pub async fn delete_run(
    State(state): State<AppState>,
    caller: Caller,
    Path(id): Path<String>,
) -> AppResult<Json<RunBody>> {
    caller.require(Scope::Submit)?;
    own_run(&state, &caller, &id).await?;
    refuse_unless_done(&state.store.delete_run(&id, now_ms()).await?, &id)?;
    Ok(Json(run_body(&state, &id).await?))
}
