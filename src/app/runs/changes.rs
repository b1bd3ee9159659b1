//! Ending a run: finishing it, with the tasks that it skips, or deleting it while it is open.

use super::body::{FinishBody, SkipRequest};
use super::read::stored;
use crate::app::App;
use crate::app::access::Caller;
use crate::app::error::{AppError, AppResult};
use crate::app::task_ref::TaskRef;
use crate::clock::now_ms;
use crate::store::keys::Scope;
use crate::store::run_rows::{RunRow, Skip};
use crate::store::runs::RunChanged;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::text::{agreeing, counted};

/// Finishes a run: accepts no more submissions, and records the tasks that it skips. Returns the run. The draft is
/// `None` if its body is no object; `faults` holds the faults of the body so far.
///
/// # Errors
/// Returns an error if there is no such run, if it belongs to another owner, if it is not open any more, or all faults
/// of the body, with the tasks that cannot be skipped.
pub async fn finish(
    app: &App,
    caller: &Caller,
    id: &str,
    draft: Option<FinishBody>,
    mut faults: Faults,
) -> AppResult<RunRow> {
    let run = own_run(app, caller, id).await?;
    let entry = app.suite(&run.suite_id).await?;
    let asked = draft.and_then(|body| body.skip);
    // Number of the task that each item of the list names.
    let named = match &asked {
        Some(SkipRequest::Tasks(tasks)) => find_tasks(tasks, &entry, &mut faults),
        _ => Vec::new(),
    };
    if !faults.is_empty() {
        return Err(AppError::faulty(faults));
    }
    let skip = asked.map(|asked| match asked {
        SkipRequest::Unanswered => Skip::Unanswered,
        SkipRequest::Tasks(_) => Skip::Tasks(sorted(&named)),
    });
    match app.store.finish_run(id, skip.as_ref(), now_ms()).await? {
        RunChanged::Answered(answered) => Err(AppError::faulty(faults_of_answered(&named, &answered, &entry))),
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
pub(super) async fn own_run(app: &App, caller: &Caller, id: &str) -> AppResult<RunRow> {
    caller.require(Scope::Submit)?;
    let run = stored(app, id).await?;
    caller.require_own(run.owner.as_deref(), "run")?;
    Ok(run)
}

/// Finds the listed tasks, and returns the number of each. Adds a fault for each item that names no task.
fn find_tasks(tasks: &[Option<TaskRef>], entry: &Entry, faults: &mut Faults) -> Vec<Option<u32>> {
    let most = entry.suite.tasks.len();
    faults.enter_key("skip");
    if tasks.len() > most {
        faults.add(format!("{}; {} has {most}", counted(tasks.len(), "task"), entry.id));
    }
    let mut numbers = Vec::new();
    // A body may list millions of tasks. Those far beyond the maximum are not looked up.
    for (i, task) in tasks.iter().take(2 * most).enumerate() {
        faults.enter_index(i);
        let found = task.as_ref().map(|task| task.find_in(entry));
        numbers.push(found.and_then(|found| found.map_err(|why| faults.add(why)).ok()));
        faults.leave();
    }
    faults.leave();
    numbers
}

/// Returns the numbers of tasks, sorted and without repetitions.
fn sorted(named: &[Option<u32>]) -> Vec<u32> {
    let mut numbers: Vec<u32> = named.iter().flatten().copied().collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Returns a fault for each item of the list that names an answered task.
fn faults_of_answered(named: &[Option<u32>], answered: &[u32], entry: &Entry) -> Faults {
    let mut faults = Faults::new();
    faults.enter_key("skip");
    for (i, number) in named.iter().enumerate() {
        let Some(number) = number.filter(|number| answered.contains(number)) else { continue };
        let (task, _) = entry.task_numbered(number).expect("the number was taken from this suite");
        faults.enter_index(i);
        faults.add(format!("{:?} is already answered, so it cannot be skipped", task.id));
        faults.leave();
    }
    // Without a list, there is no item to point to.
    if faults.is_empty() {
        faults.add(format!("{} already answered", agreeing(answered.len(), "task was", "tasks were")));
    }
    faults
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
