//! Suites.

use axum::Json;
use axum::extract::{Path, State};
use serde::Serialize;

use super::super::problem::{ApiResult, Problem};
use super::super::state::AppState;
use crate::checks::Criterion;
use crate::tasks::Suite;

/// A suite in short.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SuiteBody {
    /// `name@version`.
    #[schema(example = "mineceraft@1")]
    pub id: String,
    /// Name; where one is given without a version, the latest is meant.
    #[schema(example = "mineceraft")]
    pub name: String,
    /// Version.
    #[schema(example = 1)]
    pub version: u32,
    /// Number of tasks.
    #[schema(example = 723)]
    pub tasks: usize,
    /// Number of turns over all tasks.
    #[schema(example = 747)]
    pub instructions: usize,
    /// Number of checks over all turns.
    #[schema(example = 3530)]
    pub checks: usize,
    /// Families with the number of their tasks, in order.
    pub families: Vec<FamilyBody>,
    /// Number of tasks to which each criterion applies.
    pub criteria: Vec<CriterionCount>,
}

/// A family of tasks.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct FamilyBody {
    /// Name.
    #[schema(example = "1-se-2-walls")]
    pub family: String,
    /// Number of tasks.
    #[schema(example = 48)]
    pub tasks: usize,
}

/// How many tasks a criterion applies to.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct CriterionCount {
    /// The criterion.
    pub criterion: Criterion,
    /// Number of tasks.
    pub tasks: usize,
}

/// All suites.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SuiteList {
    /// By name and version.
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
        }
    }
}

/// All suites that runs can be made for.
#[utoipa::path(
    get, path = "/v1/suites", operation_id = "list_suites", tag = "tasks", summary = "List suites",
    responses(
        (status = 200, description = "The suites", body = SuiteList,
         example = json!({ "suites": [{ "id": "mineceraft@1", "name": "mineceraft", "version": 1, "tasks": 723 }] })),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn list_suites(State(state): State<AppState>) -> ApiResult<Json<SuiteList>> {
    let catalogue = state.store.current_catalogue().await?;
    Ok(Json(SuiteList { suites: catalogue.suites().iter().map(|entry| SuiteBody::of(&entry.suite)).collect() }))
}

/// One suite.
#[utoipa::path(
    get, path = "/v1/suites/{suite}", operation_id = "get_suite", tag = "tasks", summary = "Get a suite",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft")),
    responses(
        (status = 200, description = "The suite", body = SuiteBody,
         example = json!({ "id": "mineceraft@1", "name": "mineceraft", "version": 1, "tasks": 723 })),
        (status = 404, description = "There is none of this name", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_suite(State(state): State<AppState>, Path(suite): Path<String>) -> ApiResult<Json<SuiteBody>> {
    Ok(Json(SuiteBody::of(&state.suite(&suite).await?.suite)))
}
