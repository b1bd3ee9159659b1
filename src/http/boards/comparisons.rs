//! Board details: rates by group of tasks, and the comparison of two runs.

use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};

use crate::app::boards::breakdown::{self, GroupBy};
use crate::app::boards::comparison;
use crate::app::error::AppResult;
use crate::http::extract::conditional::tagged_json;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::grading::standings::Standing;
use plumbline_engine::grading::summary::ProblemRate;

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

impl From<breakdown::Breakdown> for Breakdown {
    fn from(breakdown::Breakdown { suite, groups, rows }: breakdown::Breakdown) -> Self {
        let row = |(standing, cells): (Arc<Standing>, Vec<ProblemRate>)| BreakdownRow {
            run: standing.run.clone(),
            agent: standing.agent.clone(),
            cells,
        };
        Self { suite, groups, rows: rows.into_iter().map(row).collect() }
    }
}

/// Returns rates by group of tasks.
///
/// The rates are those of the best runs, or of one run, by family, category, type, wording or criterion of the tasks.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/breakdown", operation_id = "get_breakdown", tag = "leaderboards",
    summary = "Get rates by group of tasks",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), BreakdownQuery),
    responses(
        (status = 200, description = "The rates", body = Breakdown,
         example = json!({ "suite": "mineceraft@4", "groups": ["walls"], "rows": [] })),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_breakdown(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    Params(query): Params<BreakdownQuery>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let rates = breakdown::breakdown(&state, &suite, query.by, query.run.as_deref()).await?;
    tagged_json(&asked, &Breakdown::from(rates))
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

/// Comparison of two runs on the problems that both answered or skipped; skipped problems count as failed.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Comparison {
    /// First run.
    pub a: Compared,
    /// Second run.
    pub b: Compared,
    /// Number of problems that both runs answered or skipped.
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

impl From<comparison::Comparison> for Comparison {
    fn from(comparison::Comparison { board, a, b, split, p_value }: comparison::Comparison) -> Self {
        let tasks = &board.entry.suite.tasks;
        let told = |place: &usize| ComparedTask { number: tasks[*place].number, task: tasks[*place].id.clone() };
        Self {
            a: Compared::from(&*a),
            b: Compared::from(&*b),
            common: split.common,
            both: split.both,
            neither: split.neither,
            only_a: split.only_a.iter().map(told).collect(),
            only_b: split.only_b.iter().map(told).collect(),
            p_value,
        }
    }
}

impl From<&Standing> for Compared {
    fn from(row: &Standing) -> Self {
        Self { run: row.run.clone(), agent: row.agent.clone(), overall: row.summary.problem_level.overall }
    }
}

/// Compares two runs.
///
/// The response lists the problems that only one of them solves, and says whether the difference may be chance.
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
    let compared = comparison::compare(&state, &suite, &query.a, &query.b).await?;
    tagged_json(&asked, &Comparison::from(compared))
}
