//! Board details: rates by group of tasks, and the comparison of two runs.

use std::collections::HashMap;
use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};

use crate::app::boards::Board;
use crate::app::error::{AppError, AppResult};
use crate::http::extract::conditional::tagged_json;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::tasks::Task;

/// Maximum number of rows in a breakdown.
const BREAKDOWN_ROWS: usize = 50;

/// Grouping of tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupBy {
    /// By family: the part of a task's identifier before the slash.
    #[default]
    Family,
    /// By category, of which there are five.
    Category,
    /// By the task types of the paper.
    Type,
    /// By the wording of problems that come in several wordings.
    Wording,
    /// By criterion; a task belongs to the group of each criterion that applies to it.
    Criterion,
}

/// Query of a breakdown.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct BreakdownQuery {
    /// Grouping of tasks.
    #[serde(default)]
    #[param(inline)]
    by: GroupBy,
    /// Run to show; without it, the best 50 runs are shown.
    #[param(format = Uuid)]
    run: Option<String>,
}

/// Rates of runs by group of tasks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Breakdown {
    /// `name@version` of the suite.
    pub suite: String,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// One row per run.
    pub rows: Vec<BreakdownRow>,
}

/// Rates of one run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BreakdownRow {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Name of the agent.
    pub agent: String,
    /// Rate in each group, in the order of `groups`.
    pub cells: Vec<ProblemRate>,
}

fn groups_of(board: &Board, by: GroupBy, place: usize, task: &Task) -> Vec<String> {
    match by {
        GroupBy::Family => vec![task.family().to_owned()],
        GroupBy::Category => task.category.iter().map(|category| category.name().to_owned()).collect(),
        GroupBy::Type => task.kind.iter().cloned().collect(),
        GroupBy::Wording => board.field.wording(place).map(|w| format!("{}: {w}", task.family())).into_iter().collect(),
        GroupBy::Criterion => task.criteria().iter().map(|criterion| criterion.name().to_owned()).collect(),
    }
}

/// Computes the rates of the given runs in each group of tasks.
#[must_use]
pub fn breakdown(board: &Board, by: GroupBy, rows: &[Arc<Standing>]) -> Breakdown {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    let mut number: HashMap<String, usize> = HashMap::new();
    for (place, task) in board.entry.suite.tasks.iter().enumerate() {
        for name in groups_of(board, by, place, task) {
            let next = groups.len();
            let group = *number.entry(name.clone()).or_insert(next);
            if group == next {
                groups.push((name, Vec::new()));
            }
            groups[group].1.push(place);
        }
    }
    if by == GroupBy::Criterion {
        groups.sort_by_key(|(name, _)| Criterion::ALL.iter().position(|criterion| criterion.name() == name));
    }
    let passes = |row: &Standing, name: &str, place: usize| match Criterion::ALL.iter().find(|c| c.name() == name) {
        Some(criterion) if by == GroupBy::Criterion => row.outcomes.holds(place, *criterion),
        _ => row.outcomes.is_solved(place),
    };
    let cells = |row: &Standing| {
        let cell = |(name, places): &(String, Vec<usize>)| {
            let pass = places.iter().filter(|place| passes(row, name, **place)).count() as u64;
            let of = places.len() as u64;
            ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) }
        };
        groups.iter().map(cell).collect()
    };
    let rows =
        rows.iter().map(|row| BreakdownRow { run: row.run.clone(), agent: row.agent.clone(), cells: cells(row) });
    Breakdown {
        suite: board.entry.suite.id(),
        rows: rows.collect(),
        groups: groups.into_iter().map(|(n, _)| n).collect(),
    }
}

async fn board_of(state: &AppState, suite: &str) -> AppResult<Arc<Board>> {
    let entry = state.suite(suite).await?;
    state.boards.of(&state.store, state.least_coverage, &entry).await
}

fn standing<'b>(board: &'b Board, run: &str) -> AppResult<&'b Arc<Standing>> {
    board.standing(run).ok_or_else(|| AppError::not_found(format!("this board has no finished run {run:?}")))
}

/// Returns the rates of the best runs, or of one run, by family, category, type, wording or criterion of the tasks.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/breakdown", operation_id = "get_breakdown", tag = "leaderboards",
    summary = "Get rates by group of tasks",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BreakdownQuery),
    responses(
        (status = 200, description = "The rates", body = Breakdown,
         example = json!({ "suite": "mineceraft@2", "groups": ["walls"], "rows": [] })),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_breakdown(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    Params(query): Params<BreakdownQuery>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let board = board_of(&state, &suite).await?;
    let rows = match &query.run {
        Some(run) => vec![Arc::clone(standing(&board, run)?)],
        None => board.rows.all.iter().take(BREAKDOWN_ROWS).cloned().collect(),
    };
    tagged_json(&asked, &breakdown(&board, query.by, &rows))
}

/// Query of a comparison.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CompareQuery {
    /// First run.
    #[param(format = Uuid)]
    a: String,
    /// Second run.
    #[param(format = Uuid)]
    b: String,
}

/// Comparison of two runs on the problems that both answered.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Comparison {
    /// First run.
    pub a: Compared,
    /// Second run.
    pub b: Compared,
    /// Number of problems that both runs answered.
    pub common: usize,
    /// Number of common problems that both runs solve.
    pub both: usize,
    /// Number of common problems that neither run solves.
    pub neither: usize,
    /// Common problems that only `a` solves.
    pub only_a: Vec<ComparedTask>,
    /// Common problems that only `b` solves.
    pub only_b: Vec<ComparedTask>,
    /// Two-sided p-value of McNemar's exact test: the probability of a split at least this uneven between equal agents.
    #[schema(minimum = 0, maximum = 1, example = 0.03)]
    pub p_value: f64,
}

/// One of the two compared runs.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Compared {
    /// Identifier of the run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Name of the agent.
    pub agent: String,
    /// Share of all problems that the run solves.
    pub overall: ProblemRate,
}

/// A problem that only one of the two runs solves.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct ComparedTask {
    /// Number of the task in the suite.
    pub number: u32,
    /// Identifier of the task.
    #[schema(example = "walls/5x1x5-raise")]
    pub task: String,
}

/// Compares two runs of a board.
#[must_use]
pub fn compare(board: &Board, a: &Standing, b: &Standing) -> Comparison {
    let tasks = &board.entry.suite.tasks;
    let common: Vec<usize> =
        (0..tasks.len()).filter(|place| a.outcomes.is_answered(*place) && b.outcomes.is_answered(*place)).collect();
    let solved = |one: bool, other: bool| {
        let is_so =
            move |place: &&usize| a.outcomes.is_solved(**place) == one && b.outcomes.is_solved(**place) == other;
        let told = |place: &usize| ComparedTask { number: tasks[*place].number, task: tasks[*place].id.clone() };
        common.iter().filter(is_so).map(told).collect::<Vec<_>>()
    };
    let compared = |row: &Standing| Compared {
        run: row.run.clone(),
        agent: row.agent.clone(),
        overall: row.summary.problem_level.overall,
    };
    Comparison {
        a: compared(a),
        b: compared(b),
        common: common.len(),
        both: solved(true, true).len(),
        neither: solved(false, false).len(),
        only_a: solved(true, false),
        only_b: solved(false, true),
        p_value: board.field.compare(a, b).0,
    }
}

/// Compares two runs: lists the problems that only one of them solves, and tests whether the difference may be chance.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/compare", operation_id = "get_comparison", tag = "leaderboards",
    summary = "Compare two runs",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), CompareQuery),
    responses(
        (status = 200, description = "The comparison", body = Comparison,
         example = json!({ "common": 723, "both": 200, "neither": 430, "only_a": [], "only_b": [], "p_value": 0.4 })),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_comparison(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    Params(query): Params<CompareQuery>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let board = board_of(&state, &suite).await?;
    tagged_json(&asked, &compare(&board, standing(&board, &query.a)?, standing(&board, &query.b)?))
}
