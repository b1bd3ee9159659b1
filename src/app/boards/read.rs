//! Reading the board of a suite.

use std::sync::Arc;

use super::cache::Board;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::catalogue::Entry;

/// Returns the board of a suite, by its name or by name and version, as it is now.
///
/// # Errors
/// Returns an error if there is no such suite, or if the database fails.
pub async fn board(app: &App, suite: &str) -> AppResult<Arc<Board>> {
    of_suite(app, &app.suite(suite).await?).await
}

/// Returns the board of a suite as it is now.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn of_suite(app: &App, entry: &Arc<Entry>) -> AppResult<Arc<Board>> {
    app.boards.of(&app.store, app.least_coverage, entry).await
}

/// Returns the current result of a run on a board.
///
/// # Errors
/// Returns an error if the board has no such run.
pub fn standing<'b>(board: &'b Board, run: &str) -> AppResult<&'b Arc<Standing>> {
    board.standing(run).ok_or_else(|| AppError::not_found(format!("this board has no finished run {run:?}")))
}
