//! `/v1/suites`: suites, their sizes, and draws of Lite suites.

use axum::Json;
use axum::extract::{Path, State};
use serde::{Deserialize, Serialize};

use crate::app::catalogue::suites::draw;
use crate::app::error::AppResult;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use plumbline_engine::checks::Criterion;
use plumbline_engine::tasks::{Suite, Track};

/// Summary of a suite.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SuiteBody {
    /// Identifier of the suite: `name@version`.
    #[schema(example = "mineceraft@4")]
    pub id: String,
    /// Name of the suite. A name without a version stands for the latest version.
    #[schema(example = "mineceraft")]
    pub name: String,
    /// Version of the suite.
    #[schema(example = 2)]
    pub version: u32,
    /// Number of tasks.
    #[schema(example = 723)]
    pub tasks: usize,
    /// Number of turns in all tasks.
    #[schema(example = 747)]
    pub instructions: usize,
    /// Number of checks in all turns.
    #[schema(example = 5843)]
    pub checks: usize,
    /// Families, in order, each with its number of tasks.
    pub families: Vec<FamilyBody>,
    /// Criteria, each with the number of tasks to which it applies.
    pub criteria: Vec<CriterionCount>,
    /// Tracks of prompts that the suite has.
    pub tracks: &'static [Track],
    /// Conventions that the prompts of the track `brief` take for granted: give them to the agent once. Absent if the
    /// suite has no such track.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preamble: Option<String>,
    /// Seed of the Lite draw, if the query gave one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Tasks of that draw, in order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drawn: Option<Vec<DrawnTask>>,
}

/// A task in a Lite draw.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct DrawnTask {
    /// Identifier of the task: `family/instance`.
    #[schema(example = "walls/10x2x7-bulkhead")]
    pub id: String,
    /// Number of the task in the full suite.
    #[schema(example = 160)]
    pub number: u32,
}

/// Query of a suite.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct DrawQuery {
    /// Seed of a draw from a Lite suite, as by Python's `random.Random(seed)`. Runs always use the seed 42; to use
    /// another draw, post its tasks as submissions to the full suite.
    #[param(example = 7)]
    seed: Option<u64>,
}

/// A family and its number of tasks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct FamilyBody {
    /// Name of the family.
    #[schema(example = "walls")]
    pub family: String,
    /// Number of tasks.
    #[schema(example = 48)]
    pub tasks: usize,
}

/// A criterion and the number of tasks to which it applies.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CriterionCount {
    /// Criterion.
    pub criterion: Criterion,
    /// Number of tasks to which the criterion applies.
    pub tasks: usize,
}

/// All suites.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SuiteList {
    /// Suites, sorted by name and version.
    pub suites: Vec<SuiteBody>,
}

impl SuiteBody {
    fn of(suite: &Suite) -> Self {
        let families = suite.families().into_iter();
        let applies = |criterion| suite.tasks.iter().filter(|task| task.criteria().contains(&criterion)).count();
        Self {
            id: suite.id(),
            name: suite.name.clone(),
            version: suite.version,
            tasks: suite.tasks.len(),
            instructions: suite.instruction_count(),
            checks: suite.check_count(),
            families: families
                .map(|tasks| FamilyBody {
                    family: tasks.first().map(|task| task.family().to_owned()).unwrap_or_default(),
                    tasks: tasks.len(),
                })
                .collect(),
            criteria: Criterion::ALL.map(|c| CriterionCount { criterion: c, tasks: applies(c) }).into(),
            tracks: suite.tracks(),
            preamble: suite.preamble.clone(),
            seed: None,
            drawn: None,
        }
    }
}

/// Lists all suites.
///
/// Runs can be created for each of them.
#[utoipa::path(
    get, path = "/v1/suites", operation_id = "list_suites", tag = "tasks", summary = "List suites",
    responses(
        (status = 200, description = "The suites", body = SuiteList,
         example = json!({ "suites": [{ "id": "mineceraft@4", "name": "mineceraft", "version": 4, "tasks": 723 }] })),
    )
)]
pub async fn list_suites(State(state): State<AppState>) -> AppResult<Json<SuiteList>> {
    let catalogue = state.current_catalogue().await?;
    Ok(Json(SuiteList { suites: catalogue.suites().iter().map(|entry| SuiteBody::of(&entry.suite)).collect() }))
}

/// Returns a suite.
///
/// A Lite suite can be drawn with another `seed`.
#[utoipa::path(
    get, path = "/v1/suites/{suite}", operation_id = "get_suite", tag = "tasks", summary = "Get a suite",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft"), DrawQuery),
    responses(
        (status = 200, description = "The suite", body = SuiteBody,
         example = json!({ "id": "mineceraft@4", "name": "mineceraft", "version": 4, "tasks": 723 })),
    )
)]
pub async fn get_suite(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    Params(query): Params<DrawQuery>,
) -> AppResult<Json<SuiteBody>> {
    let Some(seed) = query.seed else { return Ok(Json(SuiteBody::of(&state.suite(&suite).await?.suite))) };
    let lite = draw(&state, &suite, seed).await?;
    let drawn = lite.tasks.iter().map(|task| DrawnTask { id: task.id.clone(), number: task.number }).collect();
    Ok(Json(SuiteBody { seed: Some(seed), drawn: Some(drawn), ..SuiteBody::of(&lite) }))
}
