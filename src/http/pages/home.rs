//! The home page: what is measured, who is ahead, and how to take part.

use askama::Template;
use axum::extract::State;

use super::about::CRITERIA;
use super::epochs::{Next, next_of};
use super::html::{self, PageResult};
use super::lines::{Line, lines};
use super::submission::{View, view_of};
use crate::app::access::Openness;
use crate::app::boards::cache::Board;
use crate::app::boards::leaderboard::best_of_newest;
use crate::app::boards::tasks::{Contrast, contrasts};
use crate::app::error::{AppError, AppResult};
use crate::app::runs::read::answer;
use crate::http::extract::origin::Origin;
use crate::http::state::AppState;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::tasks::reported;

/// Number of rows of each board.
const ROWS: u32 = 5;

/// The best rows of a board.
struct Best {
    suite: String,
    tasks: usize,
    runs: usize,
    /// Whether its runs have prompts of several kinds, of which those with the specified ones are shown.
    has_tracks: bool,
    /// What people reach according to the paper, in percent.
    people: Option<f64>,
    lines: Vec<Line>,
}

/// A build on the home page.
struct Build {
    submission: String,
    agent: String,
    view: View,
}

/// Two builds for one task: one that solves it and one that does not.
struct Pair {
    suite: String,
    number: u32,
    prompt: String,
    good: Build,
    bad: Build,
}

#[derive(Template)]
#[template(path = "home.html")]
struct Home {
    boards: Vec<Best>,
    others: Vec<String>,
    pair: Option<Pair>,
    epoch: Option<(String, Next)>,
    origin: Origin,
    is_open: bool,
}

/// Name of the row of people among the results that the paper reports.
const PEOPLE: &str = "human participants";

/// Returns the percentage that people reach on a suite according to the paper.
fn people(suite: &str) -> AppResult<Option<f64>> {
    let rows = reported::on(suite).map_err(|error| AppError::internal(&error))?;
    Ok(rows.into_iter().find(|row| row.agent == PEOPLE).and_then(|row| row.overall))
}

/// Serves the home page.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn home(State(state): State<AppState>, origin: Origin) -> PageResult {
    let (newest, others) = best_of_newest(&state, ROWS).await?;
    let mut shown = None;
    for page in &newest {
        if shown.is_none() {
            shown = pair(&state, &page.board).await?;
        }
    }
    let mut boards = Vec::new();
    for page in newest {
        let suite = &page.board.entry.suite;
        boards.push(Best {
            suite: suite.id(),
            tasks: suite.tasks.len(),
            runs: page.total,
            has_tracks: suite.tracks().len() > 1,
            people: people(&suite.name)?,
            lines: lines(&state, page.rows).await?,
        });
    }
    let is_open = state.keys.open == Openness::Open;
    html::page(&Home { boards, others, pair: shown, epoch: next_of(&state).await?, origin, is_open })
}

/// Returns two builds for one task that show what is measured. A run that built nothing shows nothing.
async fn pair(state: &AppState, board: &Board) -> AppResult<Option<Pair>> {
    for Contrast { place, solves, fails } in contrasts(board) {
        let task = &board.entry.suite.tasks[place];
        let good = answer(state, &solves.run, task.number).await;
        let bad = answer(state, &fails.run, task.number).await;
        // What was withdrawn or deleted meanwhile is not shown.
        let (Ok(good), Ok(bad)) = (good, bad) else { continue };
        if bad.events == 0 {
            continue;
        }
        let first = task.turns.first();
        let prompt = first.map(|turn| turn.brief.clone().unwrap_or_else(|| turn.prompt.clone()));
        return Ok(Some(Pair {
            suite: board.entry.id.clone(),
            number: task.number,
            prompt: prompt.unwrap_or_default(),
            good: build(state, good, &solves.agent).await?,
            bad: build(state, bad, &fails.agent).await?,
        }));
    }
    Ok(None)
}

async fn build(state: &AppState, row: SubmissionRow, agent: &str) -> AppResult<Build> {
    let (submission, agent) = (row.id.clone(), agent.to_owned());
    Ok(Build { submission, agent, view: view_of(state, row, "pair").await? })
}
