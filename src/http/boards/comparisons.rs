//! Boards in detail: rates by group of tasks, and one run against another.

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
use crate::http::problem::Problem;
use crate::http::state::AppState;
use plumbline_engine::checks::Criterion;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::summary::ProblemRate;
use plumbline_engine::tasks::Task;

/// Rows of a breakdown at most.
const BREAKDOWN_ROWS: usize = 50;

/// How tasks are grouped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupBy {
    /// The part of a task's id before the slash.
    #[default]
    Family,
    /// The five categories.
    Category,
    /// The paper's types.
    Type,
    /// How a problem is worded, where it is in several ways.
    Wording,
    /// The criteria that apply; a task is in the group of each.
    Criterion,
}

/// Which breakdown.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct BreakdownQuery {
    /// How tasks are grouped.
    #[serde(default)]
    #[param(inline)]
    by: GroupBy,
    /// Of this run alone; else of the best 50.
    #[param(format = Uuid)]
    run: Option<String>,
}

/// Rates by group of tasks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Breakdown {
    /// `name@version` of the suite.
    pub suite: String,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// A row a run.
    pub rows: Vec<BreakdownRow>,
}

/// Rates of a run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BreakdownRow {
    /// The run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Who built.
    pub agent: String,
    /// A rate a group, in the order of the groups.
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

/// Rates of runs by groups of tasks.
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
    state.boards.of(state, &entry).await
}

fn standing<'b>(board: &'b Board, run: &str) -> AppResult<&'b Arc<Standing>> {
    board.standing(run).ok_or_else(|| AppError::not_found(format!("this board has no finished run {run:?}")))
}

/// Rates of the best runs, or of one, by family, category, type, wording or criterion of the tasks.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/breakdown", operation_id = "get_breakdown", tag = "leaderboards",
    summary = "Get rates by group of tasks",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BreakdownQuery),
    responses(
        (status = 200, description = "The rates", body = Breakdown,
         example = json!({ "suite": "mineceraft@2", "groups": ["walls"], "rows": [] })),
        (status = 304, description = "The rates are those of If-None-Match"),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such suite or run", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
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

/// Which two.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CompareQuery {
    /// A run.
    #[param(format = Uuid)]
    a: String,
    /// Another one.
    #[param(format = Uuid)]
    b: String,
}

/// Two runs on the problems that both answered.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Comparison {
    /// The one.
    pub a: Compared,
    /// The other.
    pub b: Compared,
    /// Problems that both answered.
    pub common: usize,
    /// Of these, solved by both.
    pub both: usize,
    /// Solved by neither.
    pub neither: usize,
    /// Problems that only `a` solves.
    pub only_a: Vec<ComparedTask>,
    /// Problems that only `b` solves.
    pub only_b: Vec<ComparedTask>,
    /// McNemar's exact test, two-sided: how likely so uneven a split is between equals.
    #[schema(minimum = 0, maximum = 1, example = 0.03)]
    pub p_value: f64,
}

/// A run that is compared.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Compared {
    /// The run.
    #[schema(format = Uuid)]
    pub run: String,
    /// Who built.
    pub agent: String,
    /// Problems solved, of all.
    pub overall: ProblemRate,
}

/// A problem that one of two runs solves.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct ComparedTask {
    /// Its number in the suite.
    pub number: u32,
    /// Its id.
    #[schema(example = "walls/5x1x5-raise")]
    pub task: String,
}

/// Two runs compared.
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

/// One run against another: which problems only the one solves, and whether that may be chance.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/compare", operation_id = "get_comparison", tag = "leaderboards",
    summary = "Compare two runs",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), CompareQuery),
    responses(
        (status = 200, description = "The comparison", body = Comparison,
         example = json!({ "common": 723, "both": 200, "neither": 430, "only_a": [], "only_b": [], "p_value": 0.4 })),
        (status = 304, description = "It is that of If-None-Match"),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such suite or run", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
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
