//! Runs of one agent on all boards, and the tasks that tell most about it.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::Arc;

use super::cache::Board;
use super::leaderboard::{Row, Withdrawn, row_of};
use super::read;
use crate::app::App;
use crate::app::catalogue::tasks::SearchText;
use crate::app::error::{AppError, AppResult};
use crate::store::run_rows::RunRow;
use crate::store::runs::RunsWanted;
use crate::store::states::RunState;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::text::did_you_mean;

/// Number of tasks that are shown as an agent's best and worst.
const TELLING: usize = 4;
/// Greatest number of rows of a board that are listed: the best.
const MAX_ROWS: usize = 50;
/// Greatest number of names that a missing one is compared with.
const MAX_COMPARED: usize = 500;
/// Greatest number of runs under way that are listed.
const MAX_OPEN: i64 = 100;

/// Runs of an agent on one board.
#[derive(Debug)]
pub struct OnBoard {
    /// The board.
    pub board: Arc<Board>,
    /// Its best rows, best first; then those that cover too little to be compared.
    pub rows: Vec<Row>,
    /// Number of all its rows.
    pub count: usize,
    /// Its withdrawn runs.
    pub withdrawn: Vec<Withdrawn>,
}

/// An agent: everything that is public about the runs of one name.
#[derive(Debug)]
pub struct Agent {
    /// Its runs on each board that has any, newest version of a suite first.
    pub boards: Vec<OnBoard>,
    /// Its runs under way, latest first.
    pub open: Vec<RunRow>,
}

/// Tasks that tell most about a run, by their positions in the suite.
#[derive(Debug, PartialEq, Eq)]
pub struct Telling {
    /// Solved tasks that the fewest other runs solve.
    pub best: Vec<usize>,
    /// Failed tasks that the most other runs solve.
    pub worst: Vec<usize>,
}

/// An agent that a search finds.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct KnownAgent {
    /// Its name.
    pub name: String,
    /// Number of its runs on all boards.
    pub runs: usize,
}

/// Returns what is public about the runs of the agent with this name, exactly as it is written.
///
/// # Errors
/// Returns an error (404) that names similar agents if no public run has this name, or an error if the database fails.
pub async fn agent(app: &App, name: &str) -> AppResult<Agent> {
    let mut boards = Vec::new();
    for board in all(app).await? {
        let own = || board.rows.all.iter().chain(&board.rows.incomplete).filter(|row| row.agent == name);
        let rows: Vec<Row> = own().take(MAX_ROWS).map(|row| row_of(&board, row, &board.rows)).collect();
        let (count, withdrawn) = (own().count(), board.withdrawn(i64::MAX, |row| row.agent == name));
        let withdrawn: Vec<Withdrawn> = withdrawn.into_iter().map(|(row, it)| board.withdrawal(row, it)).collect();
        if !(rows.is_empty() && withdrawn.is_empty()) {
            boards.push(OnBoard { board, rows, count, withdrawn });
        }
    }
    let mut open = Vec::new();
    for state in [RunState::Open, RunState::Finishing] {
        let exact_agent = Some(name.to_owned());
        let wanted = RunsWanted { state: Some(state), exact_agent, ..RunsWanted::default() };
        open.extend(app.store.runs(&wanted, MAX_OPEN).await?);
    }
    if boards.is_empty() && open.is_empty() {
        let known = agents(app, "").await?;
        // Comparing names takes time, so only those of a similar length are compared.
        let length = name.chars().count();
        let is_similar = |known: &&str| known.chars().count().abs_diff(length) <= 1 + length / 3;
        let names = known.iter().map(|agent| agent.name.as_str()).filter(is_similar).take(MAX_COMPARED);
        let near = did_you_mean(name, names);
        return Err(AppError::not_found(format!("no public run has the agent {name:?}{near}")));
    }
    Ok(Agent { boards, open })
}

/// Finds the agents on boards whose names contain a text, in whatever case, by name.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn agents(app: &App, text: &str) -> AppResult<Vec<KnownAgent>> {
    let text = SearchText::new(text);
    let mut found: BTreeMap<String, usize> = BTreeMap::new();
    for board in all(app).await? {
        let rows = board.rows.all.iter().chain(&board.rows.incomplete);
        for row in rows.filter(|row| text.is_in(&row.agent)) {
            *found.entry(row.agent.clone()).or_default() += 1;
        }
    }
    Ok(found.into_iter().map(|(name, runs)| KnownAgent { name, runs }).collect())
}

/// Returns the tasks that tell most about a run.
#[must_use]
pub fn telling(board: &Board, run: &Standing) -> Telling {
    let solvers = board.solvers(run.track);
    // The run's own answer counts for every task that it solves and for none that it fails, so it changes no order.
    let outcomes = &run.outcomes;
    let mut best: Vec<usize> = (0..outcomes.len()).filter(|place| outcomes.is_solved(*place)).collect();
    let is_failed = |place: &usize| outcomes.is_answered(*place) && !outcomes.is_accurate(*place);
    let mut worst: Vec<usize> = (0..outcomes.len()).filter(is_failed).collect();
    // Of equals, later tasks ask for more.
    best.sort_by_key(|place| (solvers[*place], Reverse(*place)));
    worst.sort_by_key(|place| (Reverse(solvers[*place]), Reverse(*place)));
    best.truncate(TELLING);
    worst.truncate(TELLING);
    Telling { best, worst }
}

/// Returns the boards of all suites, newest version first.
async fn all(app: &App) -> AppResult<Vec<Arc<Board>>> {
    let mut entries = app.catalogue().suites().to_vec();
    entries.sort_by_key(|entry| Reverse(entry.suite.version));
    let mut boards = Vec::with_capacity(entries.len());
    for entry in entries {
        boards.push(read::of_suite(app, &entry).await?);
    }
    Ok(boards)
}
