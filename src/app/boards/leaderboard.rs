//! Leaderboards: one row per finished run of a suite, selected, sorted and split into pages.

use std::collections::HashSet;
use std::sync::Arc;

use serde::Deserialize;

use super::cache::{Board, Rows};
use super::read;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::app::paging::page_items;
use crate::app::runs::body::RunProvenance;
use crate::clock::{DAY_MS, day_ms, milliseconds};
use crate::store::boards::ActionRow;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::statistics::ranks::RankRange;
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::tasks::Track;
use plumbline_engine::tasks::reported::{self, ReportedRow};

/// Value by which a board is sorted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SortBy {
    /// Share of problems solved.
    #[default]
    Overall,
    /// Share of problems that pass accuracy.
    Accuracy,
    /// Share of problems that pass material.
    Material,
    /// Share of problems that pass shape.
    Shape,
    /// Share of problems that pass size.
    Size,
    /// Share of problems that pass physical plausibility.
    PhysicalPlausibility,
    /// Share of problems that pass dependency.
    Dependency,
    /// Mean structural stability.
    StructuralStability,
    /// Mean efficiency.
    Efficiency,
    /// Number of graded problems.
    Coverage,
    /// Time at which the run finished.
    Finished,
}

/// Sort direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Greatest value first; rows without a value last.
    #[default]
    Desc,
    /// Least value first; rows without a value last.
    Asc,
}

/// Runs that a board lists, by their coverage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoverageFilter {
    /// Runs that cover enough of the suite to be compared.
    #[default]
    Complete,
    /// The other runs, which have no rank.
    Incomplete,
}

/// Runs that a board lists of each agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunsListed {
    /// All runs.
    #[default]
    All,
    /// The best run of each agent, by the share of problems solved; of several, the one that finished first.
    BestOfAgent,
}

/// Selection of rows: filters, order and page.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// Value by which the rows are sorted.
    pub sort: SortBy,
    /// Sort direction.
    pub order: Direction,
    /// Text in the name of the agent; case is ignored.
    pub agent: Option<String>,
    /// Origin of the logs.
    pub provenance: Option<RunProvenance>,
    /// Track of the prompts.
    pub track: Option<Track>,
    /// Runs to list, by their coverage.
    pub coverage: CoverageFilter,
    /// Runs to list of each agent.
    pub runs: RunsListed,
    /// Time at which to show the board (RFC 3339).
    pub as_of: Option<String>,
    /// Run after whose row the page begins.
    pub after: Option<String>,
    /// Maximum number of rows on the page.
    pub limit: Option<u32>,
}

/// A row of a leaderboard: a finished run among others.
#[derive(Debug, Clone)]
pub struct Row {
    /// The run.
    pub standing: Arc<Standing>,
    /// Rank by overall rate; none for a run that covers too little of the suite.
    pub rank: Option<usize>,
    /// Range of ranks that the data allow; none for a run that covers too little of the suite.
    pub places: Option<RankRange>,
    /// Graded problems, of all problems.
    pub coverage: ProblemRate,
    /// Number of runs of this suite that the agent has begun, in any state.
    pub attempts: usize,
    /// Finished runs of other owners with near-identical logs.
    pub similar_to: Vec<String>,
    /// Number of those that finished before this one.
    pub copied_from: usize,
}

/// A page of a leaderboard.
#[derive(Debug)]
pub struct BoardPage {
    /// The board.
    pub board: Arc<Board>,
    /// Number of rows that match the filters, on all pages.
    pub total: usize,
    /// Number of finished runs that cover too little to be compared.
    pub incomplete: usize,
    /// Rows of this page.
    pub rows: Vec<Row>,
    /// Run after whose row the next page begins; none on the last page.
    pub next_after: Option<String>,
    /// Where the page before begins; none on the first page.
    pub before: Option<PageStart>,
    /// Results on this suite that others report; they were not graded by this service.
    pub reported: Vec<ReportedRow>,
    /// Runs that match the filters and that their owners, or the operator for runs without one, withdrew, latest first.
    pub withdrawn: Vec<Withdrawn>,
}

/// Beginning of a page: after the row of this run, or at the first row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageStart(pub Option<String>);

/// A run that its owner withdrew.
#[derive(Debug)]
pub struct Withdrawn {
    /// The run.
    pub standing: Arc<Standing>,
    /// Number of runs of this suite that the agent has begun, in any state.
    pub attempts: usize,
    /// Time of the withdrawal, in milliseconds since 1970.
    pub at_ms: i64,
    /// Reason that the owner gave.
    pub reason: String,
}

impl Board {
    /// Describes the withdrawal of a run.
    pub(super) fn withdrawal(&self, row: &Arc<Standing>, action: &ActionRow) -> Withdrawn {
        Withdrawn {
            standing: Arc::clone(row),
            attempts: self.attempts(&row.agent),
            at_ms: action.at_ms,
            reason: action.reason.clone(),
        }
    }
}

/// Selects a page of a board.
///
/// # Errors
/// Returns an error (400) if a parameter is invalid.
pub fn page(board: &Arc<Board>, wanted: &Selection) -> AppResult<BoardPage> {
    let items = page_items(wanted.limit, 100)?;
    if let Some(detail) = wanted.track.and_then(|track| board.entry.suite.lacks(track)) {
        return Err(AppError::wrong_parameter("track", detail));
    }
    let as_of = moment(wanted.as_of.as_deref())?;
    let compared = &*rows_at(board, as_of);
    let all = match wanted.coverage {
        CoverageFilter::Complete => &compared.all,
        CoverageFilter::Incomplete => &compared.incomplete,
    };
    let agent = wanted.agent.as_ref().map(|agent| agent.to_lowercase());
    let lets_through = |row: &Standing| {
        agent.as_ref().is_none_or(|text| row.agent.to_lowercase().contains(text))
            && wanted.provenance.is_none_or(|wanted| wanted.name() == row.provenance)
            && wanted.track.is_none_or(|wanted| wanted == row.track)
    };
    let withdrawn = board.withdrawn(as_of.unwrap_or(i64::MAX), lets_through);
    let withdrawn = withdrawn.into_iter().map(|(row, action)| board.withdrawal(row, action)).collect();
    let mut rows: Vec<&Arc<Standing>> = all.iter().filter(|row| lets_through(row)).collect();
    if wanted.runs == RunsListed::BestOfAgent {
        keep_best(&mut rows);
    }
    if (wanted.sort, wanted.order) != (SortBy::Overall, Direction::Desc) {
        rows.sort_by(|a, b| by_value(value(a, wanted.sort), value(b, wanted.sort), wanted.order));
    }
    let total = rows.len();
    let begin = match &wanted.after {
        None => 0,
        Some(run) => {
            let missing = || AppError::wrong_parameter("after", format!("this board has no row for the run {run:?}"));
            1 + rows.iter().position(|row| row.run == *run).ok_or_else(missing)?
        }
    };
    let end = (begin + items).min(total);
    Ok(BoardPage {
        total,
        incomplete: compared.incomplete.len(),
        rows: rows[begin..end].iter().map(|row| row_of(board, row, compared)).collect(),
        before: (begin > 0).then(|| PageStart(begin.checked_sub(items + 1).map(|row| rows[row].run.clone()))),
        next_after: (end < total).then(|| rows[end - 1].run.clone()),
        // The paper's prompts are short, so its results stand beside runs with short prompts alone.
        reported: match wanted.track {
            Some(Track::Brief) => reported::on(&board.entry.suite.name).map_err(|error| AppError::internal(&error))?,
            _ => Vec::new(),
        },
        withdrawn,
        board: Arc::clone(board),
    })
}

/// Keeps the first of the rows of each agent and track, which are ordered from the best.
fn keep_best(rows: &mut Vec<&Arc<Standing>>) {
    let mut seen = HashSet::new();
    rows.retain(|row| seen.insert((row.track, row.agent.as_str())));
}

/// Reads the time at which a board is to be shown: an RFC 3339 time, or a date, which stands for its last moment, so
/// that the board shows everything of that day.
///
/// # Errors
/// Returns an error (400) if it is neither.
pub fn moment(as_of: Option<&str>) -> AppResult<Option<i64>> {
    let Some(text) = as_of else { return Ok(None) };
    let at = milliseconds(text).or_else(|| Some(day_ms(text)? + DAY_MS - 1));
    let detail = || format!("{text:?} is neither an RFC 3339 time, such as 2026-11-22T00:00:00Z, nor a date");
    at.map(Some).ok_or_else(|| AppError::wrong_parameter("as_of", detail()))
}

/// Returns the rows of a board at a time, or as they are now.
fn rows_at(board: &Board, at_ms: Option<i64>) -> Arc<Rows> {
    at_ms.map_or_else(|| Arc::clone(&board.rows), |at| board.as_of(at))
}

/// Computes the rows of the wanted time in a thread that no other request waits for, if they are not at hand.
///
/// # Errors
/// Returns an error if the time is invalid.
pub async fn prepare(board: &Arc<Board>, wanted: Option<&str>) -> AppResult<()> {
    let Some(at) = moment(wanted)?.filter(|at| !board.is_at_hand(*at)) else { return Ok(()) };
    let board = Arc::clone(board);
    let computing = tokio::task::spawn_blocking(move || drop(board.as_of(at)));
    computing.await.map_err(|error| AppError::internal(&error))
}

/// Returns the best rows of the newest version of each suite, of one track, and the identifiers of the other versions.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn best_of_newest(app: &App, rows: u32) -> AppResult<(Vec<BoardPage>, Vec<String>)> {
    let mut entries = app.catalogue().suites().to_vec();
    entries.sort_by_key(|entry| std::cmp::Reverse(entry.suite.version));
    let (mut pages, mut others, mut seen) = (Vec::new(), Vec::new(), HashSet::new());
    for entry in entries {
        let suite = &entry.suite;
        if !seen.insert(suite.name.clone()) {
            others.push(suite.id());
            continue;
        }
        let track = (suite.tracks().len() > 1).then_some(Track::Specified);
        let best = Selection { limit: Some(rows), track, ..Selection::default() };
        pages.push(page(&read::of_suite(app, &entry).await?, &best)?);
    }
    Ok((pages, others))
}

/// Builds the row of a run and compares the run with the given rows.
#[must_use]
pub fn row_of(board: &Board, standing: &Arc<Standing>, rows: &Rows) -> Row {
    let rate = |row: &Standing| row.rate().unwrap_or(-1.0);
    let (pass, of) = (standing.answered() as u64, standing.outcomes.len() as u64);
    let is_compared = standing.covers(board.least_coverage);
    let similar_to = board.similar_to(&standing.run);
    Row {
        // The rows are sorted by rate, greatest first; only those with prompts of the same track are compared.
        rank: is_compared.then(|| {
            let better = rows.all.partition_point(|row| rate(row) > rate(standing));
            1 + rows.all[..better].iter().filter(|row| row.track == standing.track).count()
        }),
        places: is_compared.then(|| rows.places(standing, &board.field)),
        coverage: ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) },
        attempts: board.attempts(&standing.agent),
        copied_from: board.copied_from(standing, &similar_to),
        similar_to,
        standing: Arc::clone(standing),
    }
}

fn value(row: &Standing, by: SortBy) -> Option<f64> {
    let per = &row.summary.problem_level.per;
    match by {
        SortBy::Overall => row.rate(),
        SortBy::Accuracy => per.accuracy.rate,
        SortBy::Material => per.material.rate,
        SortBy::Shape => per.shape.rate,
        SortBy::Size => per.size.rate,
        SortBy::PhysicalPlausibility => per.physical_plausibility.rate,
        SortBy::Dependency => per.dependency.rate,
        SortBy::StructuralStability => row.summary.graded.stress.mean,
        SortBy::Efficiency => row.summary.graded.efficiency.mean,
        SortBy::Coverage => Some(row.answered() as f64),
        SortBy::Finished => Some(row.finished_at_ms as f64),
    }
}

/// Orders two values in the given direction; missing values come last in both directions.
fn by_value(a: Option<f64>, b: Option<f64>, order: Direction) -> std::cmp::Ordering {
    match (a, b, order) {
        (Some(a), Some(b), Direction::Asc) => a.total_cmp(&b),
        (Some(a), Some(b), Direction::Desc) => b.total_cmp(&a),
        (a, b, _) => b.is_some().cmp(&a.is_some()),
    }
}
