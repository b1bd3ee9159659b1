//! Ending a run: finishing it, with the tasks that it skips, or deleting it while it is open.

use super::read::stored;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::submissions::posted::TaskRef;
use crate::clock::now_ms;
use crate::store::keys::Scope;
use crate::store::run_rows::{RunRow, Skip};
use crate::store::runs::RunChanged;
use plumbline_engine::intake::Faults;

/// Tasks that a run skips on purpose.
#[derive(Debug)]
pub enum SkipRequest {
    /// All tasks without a submission.
    Unanswered,
    /// The listed tasks.
    Tasks(Vec<TaskRef>),
}

/// Finishes a run: accepts no more submissions, and records the tasks that it skips. Returns the run.
///
/// # Errors
/// Returns an error if there is no such run, if it belongs to another owner, if it is not open any more, or if tasks
/// cannot be skipped.
pub async fn finish(app: &App, caller: &Caller, id: &str, skip: Option<SkipRequest>) -> AppResult<RunRow> {
    let run = own_run(app, caller, id).await?;
    let skip = match skip {
        None => None,
        Some(SkipRequest::Unanswered) => Some(Skip::Unanswered),
        Some(SkipRequest::Tasks(tasks)) => Some(Skip::Tasks(numbers_of(app, &run, &tasks).await?)),
    };
    match app.store.finish_run(id, skip.as_ref(), now_ms()).await? {
        RunChanged::Answered(numbers) => {
            let mut faults = Faults::new();
            let entry = app.suite(&run.suite_id).await?;
            let ids = numbers.iter().filter_map(|number| Some(entry.task_numbered(*number)?.0.id.as_str()));
            let ids: Vec<&str> = ids.collect();
            faults.add_at("skip", format!("already answered, so they cannot be skipped: {}", ids.join(", ")));
            Err(AppError::faulty(faults))
        }
        changed => {
            refuse_unless_done(&changed, id)?;
            stored(app, id).await
        }
    }
}

/// Deletes a run that is still open, and cancels its unfinished submissions. Returns the run.
///
/// # Errors
/// Returns an error if there is no such run, if it belongs to another owner, if it is not open any more, or if the
/// database fails.
pub async fn delete(app: &App, caller: &Caller, id: &str) -> AppResult<RunRow> {
    own_run(app, caller, id).await?;
    refuse_unless_done(&app.store.delete_run(id, now_ms()).await?, id)?;
    stored(app, id).await
}

/// Returns the run if the caller may submit and the run belongs to the caller.
async fn own_run(app: &App, caller: &Caller, id: &str) -> AppResult<RunRow> {
    caller.require(Scope::Submit)?;
    let run = stored(app, id).await?;
    caller.require_own(run.owner.as_deref(), "run")?;
    Ok(run)
}

/// Returns the numbers of the named tasks, sorted and without repetitions.
async fn numbers_of(app: &App, run: &RunRow, tasks: &[TaskRef]) -> AppResult<Vec<u32>> {
    let entry = app.suite(&run.suite_id).await?;
    let mut faults = Faults::new();
    faults.enter_key("skip");
    if tasks.len() > entry.suite.tasks.len() {
        faults.add(format!("{} tasks; {} has {}", tasks.len(), entry.suite.id(), entry.suite.tasks.len()));
        return Err(AppError::faulty(faults));
    }
    let mut numbers = Vec::with_capacity(tasks.len());
    for (i, task) in tasks.iter().enumerate() {
        faults.enter_index(i);
        match task.find_in(&entry) {
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
