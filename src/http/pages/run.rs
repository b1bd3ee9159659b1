//! The page of a run, and redirects to its submissions.

use askama::Template;
use axum::extract::{Path, State};
use axum::response::{IntoResponse as _, Redirect};

use super::html::{self, PageResult};
use crate::app::error::AppError;
use crate::clock::rfc3339;
use crate::http::boards::body::BoardRow;
use crate::http::boards::comparisons::{Breakdown, GroupBy, breakdown};
use crate::http::boards::leaderboard::row_of;
use crate::http::state::AppState;
use crate::store::run_rows::RunRow;
use crate::store::submissions::SubmissionRow;

/// Greatest number of submissions shown for an open run.
const LATEST: i64 = 1_000;

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
    let run = state.store.run(&id).await?.ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))?;
    let entry = state.suite(&run.suite_id).await?;
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    let standing = board.standing(&id).cloned();
    let squares = match &standing {
        Some(standing) => entry
            .suite
            .tasks
            .iter()
            .enumerate()
            .map(|(place, task)| {
                let (class, told) = match &standing.outcomes {
                    o if o.is_skipped(place) => ("", "skipped"),
                    o if !o.is_answered(place) => ("", "not answered"),
                    o if o.is_solved(place) => ("solved", "solved"),
                    o if o.is_accurate(place) => ("accurate", "accurate, but not solved"),
                    _ => ("failed", "not solved"),
                };
                Square { number: task.number, task: task.id.clone(), class, told }
            })
            .collect(),
        None => state.store.submissions_of_run(&id, 0, LATEST).await?.iter().map(square).collect(),
    };
    let tables = standing.iter().flat_map(|standing| {
        [
            ("By criterion", GroupBy::Criterion),
            ("By category", GroupBy::Category),
            ("By family", GroupBy::Family),
            ("By wording", GroupBy::Wording),
        ]
        .map(|(title, by)| (title, breakdown(&board, by, std::slice::from_ref(standing))))
    });
    let own = board.actions.iter().filter(|action| action.run_id == id);
    html::page(&RunPage {
        begun: rfc3339(run.created_at_ms),
        is_hidden: board.is_hidden(&id),
        actions: own.map(|a| (rfc3339(a.at_ms), a.action.clone(), a.actor.clone(), a.reason.clone())).collect(),
        tables: tables.filter(|(_, rates)| !rates.groups.is_empty()).collect(),
        row: standing.map(|standing| row_of(&board, &standing, &board.rows)),
        metadata: serde_json::to_string_pretty(&run.metadata).unwrap_or_default(),
        squares,
        run,
    })
}

fn square(row: &SubmissionRow) -> Square {
    let (class, told) = match row.overall {
        Some(true) => ("solved", "solved"),
        Some(false) => ("failed", "not solved"),
        None => ("", row.state.name()),
    };
    let number = row.task_number;
    Square { number, task: String::new(), class, told }
}

/// Returns the submission that counts for a task of a run: the one that no later submission supersedes.
///
/// # Errors
/// Returns a 404 error if the run has no submission for the task.
pub async fn answer_of(state: &AppState, run: &str, number: u32) -> Result<SubmissionRow, AppError> {
    let rows = state.store.submissions_of_run(run, i64::from(number) - 1, 1).await?;
    let row = rows.into_iter().find(|row| row.task_number == number);
    row.ok_or_else(|| AppError::not_found(format!("the run {run:?} has no submission for task {number}")))
}

/// Redirects to a run's submission for a task.
///
/// # Errors
/// Returns a 404 error if the run has no submission for the task.
pub async fn task_of_run(State(state): State<AppState>, Path((run, number)): Path<(String, u32)>) -> PageResult {
    let row = answer_of(&state, &run, number).await?;
    Ok(Redirect::to(&format!("/submissions/{}", row.id)).into_response())
}
