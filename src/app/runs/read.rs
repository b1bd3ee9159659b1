//! Reading runs and their submissions.

use std::sync::Arc;

use crate::app::App;
use crate::app::access::Caller;
use crate::app::catalogue::suites::no_suite;
use crate::app::error::{AppError, AppResult, FaultBody};
use crate::app::paging::{Page, page_items};
use crate::clock::{DAY_MS, day_ms, milliseconds};
use crate::store::run_rows::RunRow;
use crate::store::runs::RunsWanted;
use crate::store::states::RunState;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::intake::Faults;
use plumbline_engine::tasks::catalogue::Entry;

/// Filter for listing runs, and the page.
#[derive(Debug, Default)]
pub struct RunFilter {
    /// State of the runs; if none, all but deleted runs.
    pub state: Option<RunState>,
    /// Suite of the runs, as `name@version`, or as a name for all versions.
    pub suite: Option<String>,
    /// Part of the agent's name; the case of ASCII letters is ignored.
    pub agent: Option<String>,
    /// Whether to list only runs of the caller's owner.
    pub mine: bool,
    /// Earliest time of creation, inclusive (RFC 3339), or a date, which stands for the beginning of that day in UTC.
    pub since: Option<String>,
    /// Latest time of creation, exclusive (RFC 3339), or a date, which stands for the end of that day in UTC.
    pub until: Option<String>,
    /// Run before whose creation the page begins.
    pub after: Option<String>,
    /// Maximum number of runs on the page.
    pub limit: Option<u32>,
}

/// A page of a run's submissions.
#[derive(Debug)]
pub struct SubmissionsOfRun {
    /// Suite of the run.
    pub entry: Arc<Entry>,
    /// The submissions, by task number, without superseded ones.
    pub page: Page<SubmissionRow>,
}

/// Returns the stored run with this id.
///
/// # Errors
/// Returns an error if there is no such run, or if the database fails.
pub async fn stored(app: &App, id: &str) -> AppResult<RunRow> {
    app.store.run(id).await?.ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))
}

/// Lists runs, latest first. The caller is needed only to list the caller's own runs. `faults` holds the faults of the
/// parameters that could not be read.
///
/// # Errors
/// Returns all faults of the parameters, or an error if the caller's runs are wanted and the caller is unknown, or if
/// the database fails.
pub async fn list(
    app: &App,
    caller: AppResult<Caller>,
    filter: RunFilter,
    mut faults: Vec<FaultBody>,
) -> AppResult<Page<RunRow>> {
    let mut owner = None;
    if filter.mine {
        let caller = caller?;
        owner = caller.owner().map(str::to_owned);
        if owner.is_none() {
            let why = caller.refused.unwrap_or("no key was sent");
            faults.push(FaultBody::of_parameter("mine", format!("{why}, so the owner is unknown")));
        }
    }
    let items = page_items(filter.limit, 100).unwrap_or_else(|error| {
        faults.extend_from_slice(error.faults());
        0
    });
    if let Some(suite) = filter.suite.as_deref()
        && app.find_suite(suite).await?.is_none()
    {
        let detail = no_suite(&app.catalogue(), suite);
        faults.push(FaultBody::of_parameter("suite", detail));
    }
    if let Some(after) = filter.after.as_deref()
        && app.store.run(after).await?.is_none()
    {
        faults.push(FaultBody::of_parameter("after", format!("there is no run {after:?}")));
    }
    let since_ms = filter.since.and_then(|text| time("since", &text, day_ms(&text), &mut faults));
    // A date includes its whole day.
    let until_ms =
        filter.until.and_then(|text| time("until", &text, day_ms(&text).map(|day| day + DAY_MS), &mut faults));
    if !faults.is_empty() {
        faults.truncate(Faults::KEPT);
        return Err(AppError::invalid_query(faults));
    }
    let wanted = RunsWanted {
        state: filter.state,
        suite_id: filter.suite,
        agent: filter.agent,
        exact_agent: None,
        owner,
        since_ms,
        until_ms,
        after: filter.after,
    };
    Ok(Page::of(app.store.runs(&wanted, items as i64 + 1).await?, items))
}

/// Reads a time; `of_date` is the time that the text stands for if it is a date. Adds a fault if it is neither.
fn time(name: &str, text: &str, of_date: Option<i64>, faults: &mut Vec<FaultBody>) -> Option<i64> {
    let time = milliseconds(text).or(of_date);
    if time.is_none() {
        let detail = format!("{text:?} is neither an RFC 3339 time, such as 2026-11-22T00:00:00Z, nor a date");
        faults.push(FaultBody::of_parameter(name, detail));
    }
    time
}

/// Lists the submissions of a run by task number, from the one after `after`.
///
/// # Errors
/// Returns an error if `limit` is out of range, if there is no such run, or if the database fails.
pub async fn submissions(app: &App, id: &str, after: Option<u32>, limit: Option<u32>) -> AppResult<SubmissionsOfRun> {
    let items = page_items(limit, 100)?;
    let run = stored(app, id).await?;
    let entry = app.suite(&run.suite_id).await?;
    let after = i64::from(after.unwrap_or(0));
    let rows = app.store.submissions_of_run(id, after, items as i64 + 1).await?;
    Ok(SubmissionsOfRun { entry, page: Page::of(rows, items) })
}

/// Returns the submission that counts for a task of a run: the one that no later submission supersedes.
///
/// # Errors
/// Returns an error if the run has no submission for the task, or if the database fails.
pub async fn answer(app: &App, run: &str, number: u32) -> AppResult<SubmissionRow> {
    let rows = app.store.submissions_of_run(run, i64::from(number) - 1, 1).await?;
    let row = rows.into_iter().find(|row| row.task_number == number);
    row.ok_or_else(|| AppError::not_found(format!("the run {run:?} has no submission for task {number}")))
}
