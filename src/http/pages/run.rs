//! The page of a run, and redirects to its submissions.

use askama::Template;
use axum::extract::{Path, State};
use axum::response::{IntoResponse as _, Redirect};

use super::html::{self, PageResult};
use crate::app::boards::breakdown::GroupBy;
use crate::app::boards::tasks::TaskResult;
use crate::app::runs::read::answer;
use crate::app::runs::results::{TasksOfRun, results};
use crate::clock::rfc3339;
use crate::http::boards::body::BoardRow;
use crate::http::boards::comparisons::Breakdown;
use crate::http::state::AppState;
use crate::store::run_rows::RunRow;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::tasks::Task;

/// A problem, shown as a small coloured square.
struct Square {
    number: u32,
    task: String,
    class: &'static str,
    told: &'static str,
}

#[derive(Template)]
#[template(path = "run.html")]
struct RunPage {
    run: RunRow,
    begun: String,
    row: Option<BoardRow>,
    is_hidden: bool,
    actions: Vec<(String, String, String, String)>,
    squares: Vec<Square>,
    tables: Vec<(&'static str, Breakdown)>,
    metadata: String,
}

/// Serves the page of a run.
///
/// # Errors
/// Returns a 404 error if the run does not exist.
pub async fn run(State(state): State<AppState>, Path(id): Path<String>) -> PageResult {
    let results = results(&state, &id).await?;
    let squares = match &results.tasks {
        TasksOfRun::Finished(all) => {
            results.board.entry.suite.tasks.iter().zip(all).map(|(task, result)| square(task, *result)).collect()
        }
        TasksOfRun::Underway(rows) => rows.iter().map(square_so_far).collect(),
    };
    let tables = [
        ("By criterion", GroupBy::Criterion),
        ("By category", GroupBy::Category),
        ("By family", GroupBy::Family),
        ("By wording", GroupBy::Wording),
    ];
    let tables = tables.into_iter().filter_map(|(title, by)| Some((title, Breakdown::from(results.breakdown(by)?))));
    let is_hidden = results.is_hidden();
    html::page(&RunPage {
        begun: rfc3339(results.run.created_at_ms),
        is_hidden,
        tables: tables.filter(|(_, rates)| !rates.groups.is_empty()).collect(),
        actions: results.actions.into_iter().map(|a| (rfc3339(a.at_ms), a.action, a.actor, a.reason)).collect(),
        row: results.row.map(BoardRow::from),
        metadata: serde_json::to_string_pretty(&results.run.metadata).unwrap_or_default(),
        squares,
        run: results.run,
    })
}

fn square(task: &Task, result: TaskResult) -> Square {
    let (class, told) = match result {
        TaskResult::Skipped => ("", "skipped"),
        TaskResult::NotAnswered => ("", "not answered"),
        TaskResult::Solved => ("solved", "solved"),
        TaskResult::Accurate => ("accurate", "accurate, but not solved"),
        TaskResult::Failed => ("failed", "not solved"),
    };
    Square { number: task.number, task: task.id.clone(), class, told }
}

/// Builds the square of a submission to a run that has not finished.
fn square_so_far(row: &SubmissionRow) -> Square {
    let (class, told) = match row.overall {
        Some(true) => ("solved", "solved"),
        Some(false) => ("failed", "not solved"),
        None => ("", row.state.name()),
    };
    Square { number: row.task_number, task: String::new(), class, told }
}

/// Redirects to a run's submission for a task.
///
/// # Errors
/// Returns a 404 error if the run has no submission for the task.
pub async fn task_of_run(State(state): State<AppState>, Path((run, number)): Path<(String, u32)>) -> PageResult {
    let row = answer(&state, &run, number).await?;
    Ok(Redirect::to(&format!("/submissions/{}", row.id)).into_response())
}
