//! Leaderboards: one row per finished run of a suite.

use std::sync::Arc;

use axum::extract::{Path, RawQuery, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};

use super::formats::{Format, render};
use crate::app::boards::{Board, Rows};
use crate::app::error::{AppError, AppResult};
use crate::clock::{milliseconds, rfc3339};
use crate::http::catalogue::tasks::page_items;
use crate::http::extract::params::{Params, wrong};
use crate::http::problem::Problem;
use crate::http::runs::body::RunProvenance;
use crate::http::state::AppState;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::statistics::interval::Interval;
use plumbline_engine::grading::statistics::ranks::RankRange;
use plumbline_engine::grading::summary::{CheckRate, Graded, PerCriterion, ProblemRate};
use plumbline_engine::tasks::reported;
use plumbline_engine::tasks::reported::ReportedRow;

/// A row: a finished run.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct BoardRow {
    /// Place by overall rate; runs with the same rate share one. Null for a run that covers too little of the suite.
    pub rank: Option<usize>,
    /// The places that it may have as far as the data tell: runs that McNemar's exact test shows to be better or worse on the
    /// common problems, by Holm's procedure over all pairs of the board at 5 %, come before or after it. Null for a run that covers
    /// too little of the suite.
    pub places: Option<RankRange>,
    /// The run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Who built.
    pub agent: String,
    /// Accuracy and physical plausibility and dependency, over all problems.
    pub overall: ProblemRate,
    /// The 95 % interval of the overall rate: Wilson's, with wordings of one problem as a cluster.
    pub interval: Option<Interval>,
    /// Material and shape and size, over the problems that have any of them.
    pub accuracy: ProblemRate,
    /// Problems that pass, per criterion and dimension.
    pub problems: PerCriterion<ProblemRate>,
    /// Scores of checks, per criterion and dimension.
    pub checks: PerCriterion<CheckRate>,
    /// Means of efficiency and structural stability.
    pub graded: Graded,
    /// Problems graded.
    pub coverage: ProblemRate,
    /// Problems that the run skips on purpose; they count as failed.
    pub skipped: usize,
    /// Runs of this suite that the agent has begun, whatever became of them.
    pub attempts: usize,
    /// Where the logs come from.
    #[schema(value_type = RunProvenance, example = "self-reported")]
    pub provenance: String,
    /// Finished runs of other owners whose logs are near-identical with this one's: nearly the same blocks in nearly the same order.
    #[schema(value_type = Vec<uuid::Uuid>)]
    pub similar_to: Vec<String>,
    /// When the run finished.
    #[schema(format = DateTime)]
    pub finished_at: String,
}

/// A page of a leaderboard.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BoardBody {
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@2")]
    pub suite: String,
    /// Problems of the suite.
    #[schema(example = 723)]
    pub tasks: usize,
    /// Rows that the filters let through, on all pages.
    #[schema(example = 3)]
    pub total: usize,
    /// The share of the suite that a run must have answered, or skipped on purpose, to be compared with others.
    #[schema(example = 1.0, minimum = 0, maximum = 1)]
    pub minimum_coverage: f64,
    /// Finished runs that cover less; `coverage=incomplete` lists them.
    #[schema(example = 0)]
    pub incomplete: usize,
    /// The rows of this page.
    pub rows: Vec<BoardRow>,
    /// `after` of the next page; null on the last.
    #[schema(format = Uuid)]
    pub next_after: Option<String>,
    /// Results that others report on this suite; not graded here.
    pub reported: Vec<ReportedRow>,
}

/// What a board is sorted by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SortBy {
    /// Problems solved.
    #[default]
    Overall,
    /// Problems that are accurate.
    Accuracy,
    /// Problems that pass by material.
    Material,
    /// By shape.
    Shape,
    /// By size.
    Size,
    /// By plausibility.
    PhysicalPlausibility,
    /// By order.
    Dependency,
    /// Mean of structural stability.
    StructuralStability,
    /// Mean of efficiency.
    Efficiency,
    /// Problems graded.
    Coverage,
    /// When the run finished.
    Finished,
}

/// Which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// The greatest first.
    #[default]
    Desc,
    /// The least first. What has no value comes last all the same.
    Asc,
}

/// Which runs a board lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CoverageFilter {
    /// Those that cover enough of the suite to be compared.
    #[default]
    Complete,
    /// The others, without ranks.
    Incomplete,
}

/// Which rows, in which order.
#[derive(Debug, Clone, Default, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct BoardQuery {
    /// What the rows are sorted by.
    #[serde(default)]
    #[param(inline)]
    pub sort: SortBy,
    /// Which way.
    #[serde(default)]
    #[param(inline)]
    pub order: Direction,
    /// Only agents whose names hold this text, in whatever case.
    pub agent: Option<String>,
    /// Only rows of this provenance.
    #[param(inline)]
    pub provenance: Option<RunProvenance>,
    /// Runs that cover enough of the suite to be compared, or the others.
    #[serde(default)]
    #[param(inline)]
    pub coverage: CoverageFilter,
    /// The board as it was at this time (RFC 3339).
    #[param(format = DateTime)]
    pub as_of: Option<String>,
    /// Only rows after that of this run: the page after.
    #[param(format = Uuid)]
    pub after: Option<String>,
    /// Rows on a page.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
    /// `json`, `csv`, `ndjson`.
    #[serde(default)]
    #[param(inline)]
    pub format: Format,
}

/// A page of a board.
///
/// # Errors
/// 400 where a parameter is wrong.
pub fn page(board: &Board, query: &BoardQuery) -> AppResult<BoardBody> {
    let items = page_items(query.limit, 100)?;
    let as_of = match &query.as_of {
        None => None,
        Some(text) => Some(milliseconds(text).ok_or_else(|| {
            wrong("as_of", format!("{text:?} is not a time (RFC 3339, such as 2026-11-22T00:00:00Z)"))
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
            1 + place.ok_or_else(|| wrong("after", format!("no row of this board is of a run {run:?}")))?
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

/// A row, compared with all that show.
#[must_use]
pub fn row_of(board: &Board, standing: &Standing, rows: &Rows) -> BoardRow {
    let rate = |row: &Standing| row.rate().unwrap_or(-1.0);
    let levels = &standing.summary.problem_level;
    let (pass, of) = (standing.answered() as u64, standing.outcomes.len() as u64);
    let is_compared = standing.covers(board.least_coverage);
    BoardRow {
        // All are sorted by rate, the greatest first.
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

/// What has no value comes last, whichever way.
fn by_value(a: Option<f64>, b: Option<f64>, order: Direction) -> std::cmp::Ordering {
    match (a, b, order) {
        (Some(a), Some(b), Direction::Asc) => a.total_cmp(&b),
        (Some(a), Some(b), Direction::Desc) => b.total_cmp(&a),
        (a, b, _) => b.is_some().cmp(&a.is_some()),
    }
}

/// The leaderboard of a suite: finished runs, the best first or in another order, with how sure their places are.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}", operation_id = "get_leaderboard", tag = "leaderboards",
    summary = "Get a leaderboard",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BoardQuery),
    responses(
        (status = 200, description = "A page of the board, as `format` asks for it", content((BoardBody = "application/json",
         example = json!({ "suite": "mineceraft@2", "tasks": 723, "total": 0, "minimum_coverage": 1.0, "incomplete": 0, "rows": [], "next_after": null, "reported": [] })),
         (String = "text/csv", example = "rank,first_place,last_place,run,agent\n"), (String = "application/x-ndjson", example = "{\"rank\":1}\n")),
         headers(("ETag" = String, description = "Of these very bytes"))),
        (status = 304, description = "The rows are those of If-None-Match"),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such suite", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
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
    let board = state.boards.of(&state, &entry).await?;
    // What a board of this state and a query come to is the same each time.
    let name = format!("board:{}:{}", board.version, raw.unwrap_or_default());
    state.documents.answer(&asked, name, || {
        let body = page(&board, &query)?;
        render(&body, query.format)
    })
}
