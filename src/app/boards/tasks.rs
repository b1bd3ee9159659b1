//! Results of the finished runs of a board on its tasks.

use std::cmp::Reverse;
use std::sync::Arc;

use super::cache::Board;
use super::read;
use crate::app::App;
use crate::app::catalogue::tasks::{FoundTask, SearchText, numbered};
use crate::app::error::AppResult;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::outcomes::Outcomes;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::tasks::{Task, Track};

/// Greatest number of runs listed for a task.
const MAX_RUNS: usize = 50;
/// Greatest number of contrasts that are returned.
const MAX_CONTRASTS: usize = 8;

/// Result of a run on a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TaskResult {
    /// The run skips the task, which counts as failed.
    Skipped,
    /// The run has no graded answer.
    NotAnswered,
    /// The answer passes.
    Solved,
    /// The accuracy passes, but not the whole answer.
    Accurate,
    /// The accuracy does not pass.
    Failed,
}

impl TaskResult {
    /// Returns the result on the task at this position in the suite.
    #[must_use]
    pub fn of(outcomes: &Outcomes, place: usize) -> Self {
        match outcomes {
            o if o.is_skipped(place) => Self::Skipped,
            o if !o.is_answered(place) => Self::NotAnswered,
            o if o.is_solved(place) => Self::Solved,
            o if o.is_accurate(place) => Self::Accurate,
            _ => Self::Failed,
        }
    }
}

/// Tasks of a board, with the number of runs that solved each.
#[derive(Debug)]
pub struct SolvedTasks {
    /// The board.
    pub board: Arc<Board>,
    /// Positions of the tasks in the suite, each with the number of runs that solved it.
    pub tasks: Vec<(usize, usize)>,
}

/// Two runs of which one solves a task that the other answered and did not solve.
#[derive(Debug)]
pub struct Contrast {
    /// Position of the task in the suite.
    pub place: usize,
    /// Run that solves it.
    pub solves: Arc<Standing>,
    /// Run that does not.
    pub fails: Arc<Standing>,
}

/// Returns tasks that tell the best run of a board from another of its track, at most one for each other run: those that
/// answered the most tasks come first, and of these the worst. If possible it is a task of one turn, by the size of its
/// build, which anybody sees; of several, one of the last, which ask for more.
#[must_use]
pub fn contrasts(board: &Board) -> Vec<Contrast> {
    let Some(solves) = board.rows.all.first() else { return Vec::new() };
    let tells = |other: &Standing, place: usize| {
        let (one, other) = (&solves.outcomes, &other.outcomes);
        one.is_solved(place) && other.is_answered(place) && !other.is_accurate(place)
    };
    let is_plain = |other: &Standing, place: usize| {
        !other.outcomes.holds(place, Criterion::Size) && board.entry.suite.tasks[place].turns.len() == 1
    };
    let mut others: Vec<_> = board.rows.all.iter().skip(1).rev().filter(|other| other.track == solves.track).collect();
    others.sort_by_key(|other| Reverse(other.answered()));
    let find = |must_be_plain: bool| {
        let of = move |other: &&Arc<Standing>| {
            let shows = |place: &usize| tells(other, *place) && (!must_be_plain || is_plain(other, *place));
            let place = (0..solves.outcomes.len()).rev().find(shows)?;
            Some(Contrast { place, solves: Arc::clone(solves), fails: Arc::clone(other) })
        };
        others.iter().filter_map(of)
    };
    find(true).chain(find(false)).take(MAX_CONTRASTS).collect()
}

/// Results on one task.
#[derive(Debug)]
pub struct ResultsOnTask {
    /// The task.
    pub found: FoundTask,
    /// Number of compared runs of the board.
    pub runs: usize,
    /// Number of those that solved the task.
    pub solved: usize,
    /// Best runs with an answer, each with its result.
    pub results: Vec<(Arc<Standing>, TaskResult)>,
}

/// Finds the tasks of a suite whose ids, types or instructions contain a text, each with the number of runs that solved
/// it.
///
/// # Errors
/// Returns an error if there is no such suite, or if the database fails.
pub async fn search(app: &App, suite: &str, text: &str) -> AppResult<SolvedTasks> {
    let board = read::board(app, suite).await?;
    let text = SearchText::new(text.trim());
    let fits = |task: &Task| text.is_in_task(task) || task.kind.as_ref().is_some_and(|kind| text.is_in(kind));
    let tasks = board.entry.suite.tasks.iter().enumerate().filter(|(_, task)| fits(task));
    let tasks = tasks.map(|(place, _)| (place, solved(&board, place))).collect();
    Ok(SolvedTasks { board, tasks })
}

/// Returns the results of runs on a task.
///
/// # Errors
/// Returns an error if there is no such suite or task, or if the database fails.
pub async fn results_on(app: &App, suite: &str, number: u32) -> AppResult<ResultsOnTask> {
    let found = numbered(app, suite, number).await?;
    let board = read::of_suite(app, &found.entry).await?;
    let place = found.place;
    let answered = board.rows.all.iter().filter(|row| row.outcomes.is_answered(place)).take(MAX_RUNS);
    let results = answered.map(|row| (Arc::clone(row), TaskResult::of(&row.outcomes, place))).collect();
    Ok(ResultsOnTask { runs: board.rows.all.len(), solved: solved(&board, place), results, found })
}

fn solved(board: &Board, place: usize) -> usize {
    Track::ALL.into_iter().map(|track| board.solvers(track)[place]).sum()
}
