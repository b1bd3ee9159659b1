//! Results of a run: its row on the board, what operators did to it, and the result on each task.

use std::sync::Arc;

use super::read::stored;
use crate::app::App;
use crate::app::boards::breakdown::{Breakdown, GroupBy, of_rows};
use crate::app::boards::cache::Board;
use crate::app::boards::leaderboard::{Row, row_of};
use crate::app::boards::read;
use crate::app::boards::tasks::TaskResult;
use crate::app::error::AppResult;
use crate::store::boards::ActionRow;
use crate::store::run_rows::RunRow;
use crate::store::submissions::SubmissionRow;

/// Greatest number of submissions listed for a run that has not finished.
const MAX_SUBMISSIONS: i64 = 1_000;

/// Results of a run.
#[derive(Debug)]
pub struct RunResults {
    /// The run.
    pub run: RunRow,
    /// Board of its suite.
    pub board: Arc<Board>,
    /// Its row among all runs of the board; none before it has finished.
    pub row: Option<Row>,
    /// Its tasks: all tasks of the suite once it has finished, and those with submissions before.
    pub tasks: TasksOfRun,
    /// Actions of operators on its row, in order.
    pub actions: Vec<ActionRow>,
}

/// Tasks of a run.
#[derive(Debug)]
pub enum TasksOfRun {
    /// The result on each task of the suite, in its order.
    Finished(Vec<TaskResult>),
    /// Submissions so far, by task number.
    Underway(Vec<SubmissionRow>),
}

impl RunResults {
    /// Returns whether its row is hidden from the board.
    #[must_use]
    pub fn is_hidden(&self) -> bool {
        self.board.is_hidden(&self.run.id)
    }

    /// Returns its rates by group of tasks; none before it has finished.
    #[must_use]
    pub fn breakdown(&self, by: GroupBy) -> Option<Breakdown> {
        self.row.as_ref().map(|row| of_rows(&self.board, by, std::slice::from_ref(&row.standing)))
    }
}

/// Returns the results of a run.
///
/// # Errors
/// Returns an error if there is no such run, or if the database fails.
pub async fn results(app: &App, id: &str) -> AppResult<RunResults> {
    let run = stored(app, id).await?;
    let board = read::board(app, &run.suite_id).await?;
    let standing = board.standing(id).cloned();
    let tasks = match &standing {
        Some(standing) => {
            let places = 0..board.entry.suite.tasks.len();
            TasksOfRun::Finished(places.map(|place| TaskResult::of(&standing.outcomes, place)).collect())
        }
        None => TasksOfRun::Underway(app.store.submissions_of_run(id, 0, MAX_SUBMISSIONS).await?),
    };
    Ok(RunResults {
        row: standing.map(|standing| row_of(&board, &standing, &board.rows)),
        actions: board.actions.iter().filter(|action| action.run_id == id).cloned().collect(),
        tasks,
        board,
        run,
    })
}
