//! Leaderboards: one row per finished run of a suite.

use std::sync::Arc;

use axum::extract::{Path, RawQuery, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;

use super::body::{BoardBody, BoardRow};
use super::formats::{Format, render};
use crate::app::boards::{Board, Rows};
use crate::app::error::{AppError, AppResult};
use crate::clock::{DAY_MS, day_ms, milliseconds, rfc3339};
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::params::{Params, wrong};
use crate::http::runs::body::RunProvenance;
use crate::http::state::AppState;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::tasks::reported;

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

/// Query of a board: filters, order and page.
#[derive(Debug, Clone, Default, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct BoardQuery {
    /// Value by which the rows are sorted.
    #[serde(default)]
    #[param(inline)]
    pub sort: SortBy,
    /// Sort direction.
    #[serde(default)]
    #[param(inline)]
    pub order: Direction,
    /// Only agents whose name contains this text; case is ignored.
    pub agent: Option<String>,
    /// Only rows with this provenance.
    #[param(inline)]
    pub provenance: Option<RunProvenance>,
    /// Whether to list the runs that cover enough of the suite to be compared, or the other runs.
    #[serde(default)]
    #[param(inline)]
    pub coverage: CoverageFilter,
    /// Time at which to show the board: RFC 3339, or a date, which stands for the end of that day in UTC.
    pub as_of: Option<String>,
    /// Only rows after the row of this run, for paging.
    #[param(format = Uuid)]
    pub after: Option<String>,
    /// Maximum number of rows on the page.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
    /// Format of the page: `json`, `csv` or `ndjson`.
    #[serde(default)]
    #[param(inline)]
    pub format: Format,
}

/// Selects a page of a board.
///
/// # Errors
/// Returns an error (400) if a parameter is invalid.
pub fn page(board: &Board, query: &BoardQuery) -> AppResult<BoardBody> {
    let items = page_items(query.limit, 100)?;
    let as_of = match &query.as_of {
        None => None,
        // A date stands for its last moment, so that the board shows everything of that day.
        Some(text) => Some(milliseconds(text).or_else(|| Some(day_ms(text)? + DAY_MS - 1)).ok_or_else(|| {
            wrong("as_of", format!("{text:?} is neither an RFC 3339 time, such as 2026-11-22T00:00:00Z, nor a date"))
        })?),
    };
    let then = as_of.map(|at| board.as_of(at));
    let compared = then.as_ref().unwrap_or(&board.rows);
    let all = match query.coverage {
        CoverageFilter::Complete => &compared.all,
        CoverageFilter::Incomplete => &compared.incomplete,
    };
    let wanted = query.agent.as_ref().map(|agent| agent.to_lowercase());
    let lets_through = |row: &&Arc<Standing>| {
        wanted.as_ref().is_none_or(|text| row.agent.to_lowercase().contains(text))
            && query.provenance.is_none_or(|wanted| wanted.name() == row.provenance)
    };
    let mut rows: Vec<&Arc<Standing>> = all.iter().filter(lets_through).collect();
    if (query.sort, query.order) != (SortBy::Overall, Direction::Desc) {
        rows.sort_by(|a, b| by_value(value(a, query.sort), value(b, query.sort), query.order));
    }
    let total = rows.len();
    let begin = match &query.after {
        None => 0,
        Some(run) => {
            let place = rows.iter().position(|row| row.run == *run);
            1 + place.ok_or_else(|| wrong("after", format!("this board has no row for the run {run:?}")))?
        }
    };
    let end = (begin + items).min(total);
    let suite = &board.entry.suite;
    let reported = reported::on(&suite.name).map_err(|error| AppError::internal(&error))?;
    Ok(BoardBody {
        suite: suite.id(),
        tasks: suite.tasks.len(),
        total,
        minimum_coverage: board.least_coverage,
        incomplete: compared.incomplete.len(),
        rows: rows[begin..end].iter().map(|row| row_of(board, row, compared)).collect(),
        next_after: (end < total).then(|| rows[end - 1].run.clone()),
        reported,
    })
}

/// Builds the row of a run and compares the run with the given rows.
#[must_use]
pub fn row_of(board: &Board, standing: &Standing, rows: &Rows) -> BoardRow {
    let rate = |row: &Standing| row.rate().unwrap_or(-1.0);
    let levels = &standing.summary.problem_level;
    let (pass, of) = (standing.answered() as u64, standing.outcomes.len() as u64);
    let is_compared = standing.covers(board.least_coverage);
    BoardRow {
        // The rows are sorted by rate, greatest first.
        rank: is_compared.then(|| 1 + rows.all.partition_point(|row| rate(row) > rate(standing))),
        places: is_compared.then(|| rows.places(standing, &board.field)),
        run: standing.run.clone(),
        agent: standing.agent.clone(),
        overall: levels.overall,
        interval: standing.interval,
        accuracy: levels.per.accuracy,
        problems: levels.per,
        checks: standing.summary.check_level,
        graded: standing.summary.graded,
        coverage: ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) },
        skipped: standing.skipped(),
        attempts: board.attempts(&standing.agent),
        provenance: standing.provenance.clone(),
        similar_to: board.similar_to(&standing.run),
        finished_at: rfc3339(standing.finished_at_ms),
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

/// Returns the leaderboard of a suite: its finished runs, best first unless sorted otherwise, with the range of ranks
/// that each run may have.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}", operation_id = "get_leaderboard", tag = "leaderboards",
    summary = "Get a leaderboard",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BoardQuery),
    responses(
        (status = 200, description = "A page of the board, in the requested format", content((BoardBody = "application/json",
         example = json!({ "suite": "mineceraft@2", "tasks": 723, "total": 0, "minimum_coverage": 1.0, "incomplete": 0, "rows": [], "next_after": null, "reported": [] })),
         (String = "text/csv", example = "rank,first_place,last_place,run,agent\n"), (String = "application/x-ndjson", example = "{\"rank\":1}\n")),
         headers(("ETag" = String, description = "Strong entity tag"))),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_leaderboard(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    RawQuery(raw): RawQuery,
    Params(query): Params<BoardQuery>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let entry = state.suite(&suite).await?;
    let board = state.boards.of(&state.store, state.least_coverage, &entry).await?;
    // The same version of a board and the same query always give the same document.
    let name = format!("board:{}:{}", board.version, raw.unwrap_or_default());
    state.documents.answer(&asked, name, || {
        let body = page(&board, &query)?;
        render(&body, query.format)
    })
}
