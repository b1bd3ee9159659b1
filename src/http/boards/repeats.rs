//! Repeats on a board.

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Serialize;

use crate::app::boards::repeats::{Group, repeats};
use crate::app::error::AppResult;
use crate::http::extract::conditional::tagged_json;
use crate::http::state::AppState;
use plumbline_engine::grading::repeats::PassAll;
use plumbline_engine::grading::statistics::interval::Interval;
use plumbline_engine::tasks::Track;

/// Repeats of configurations on a board.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RepeatsBody {
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@4")]
    pub suite: String,
    /// Groups of two runs or more, best first.
    pub groups: Vec<RepeatGroup>,
}

/// Runs of one owner, agent, track, profile and configuration.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct RepeatGroup {
    /// Name of the agent.
    pub agent: String,
    /// Owner of the runs; null if they were created without a key.
    pub owner: Option<String>,
    /// Track of the prompts.
    pub track: Track,
    /// Profile of the submissions.
    pub profile: String,
    /// SHA-256 of the configuration, as the runs' cards declare it.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    pub configuration_sha256: String,
    /// Identifiers of the runs, in the order in which they finished.
    pub runs: Vec<String>,
    /// Number of runs of the group that their owner withdrew, which the figures leave out; absent if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    #[schema(minimum = 0)]
    pub withdrawn: usize,
    /// Mean of the runs' rates of solved problems.
    #[schema(minimum = 0, maximum = 1)]
    pub mean: f64,
    /// 95 % interval of the mean, over problems of this kind.
    pub interval: Option<Interval>,
    /// Sample standard deviation of the runs' rates.
    #[schema(minimum = 0)]
    pub standard_deviation: f64,
    /// Least rate of a run.
    #[schema(minimum = 0, maximum = 1)]
    pub least: f64,
    /// Greatest rate of a run.
    #[schema(minimum = 0, maximum = 1)]
    pub most: f64,
    /// Rates of problems that `k` of the runs all solve, for each `k` (pass^k).
    pub pass_all: Vec<PassAllBody>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Rate of problems that a number of runs all solve.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct PassAllBody {
    /// Number of runs.
    #[schema(minimum = 1)]
    pub k: usize,
    /// Rate of problems.
    #[schema(minimum = 0, maximum = 1)]
    pub rate: f64,
    /// 95 % interval of the rate, over problems of this kind.
    pub interval: Option<Interval>,
}

impl From<Group> for RepeatGroup {
    fn from(Group { configuration_hash, runs, figures, withdrawn }: Group) -> Self {
        let first = &runs[0];
        let pass = |PassAll { k, rate, interval }| PassAllBody { k, rate, interval };
        Self {
            agent: first.agent.clone(),
            owner: first.owner.clone(),
            track: first.track,
            profile: first.profile.clone(),
            configuration_sha256: configuration_hash,
            runs: runs.iter().map(|run| run.run.clone()).collect(),
            withdrawn,
            mean: figures.mean,
            interval: figures.interval,
            standard_deviation: figures.deviation,
            least: figures.least,
            most: figures.most,
            pass_all: figures.pass_all.into_iter().map(pass).collect(),
        }
    }
}

/// Returns the repeats on a board.
///
/// Repeats are finished runs of one owner, agent, track and profile whose cards declare the same
/// `configuration_sha256`. Runs that their owner withdrew are counted in `withdrawn` alone, and runs under embargo
/// belong to no group. Each group has the mean and the spread of its runs, and pass^k: the rate of problems that k of
/// its runs all solve. Runs that cover too little of the suite belong to no group.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}/repeats", operation_id = "get_repeats", tag = "leaderboards",
    summary = "Get repeats of configurations",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft")),
    responses(
        (status = 200, description = "The groups", body = RepeatsBody, example = json!({ "suite": "mineceraft@4", "groups": [] })),
        (status = 304, description = "Not modified: If-None-Match names the current entity tag"),
    )
)]
pub async fn get_repeats(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    asked: HeaderMap,
) -> AppResult<Response> {
    let (board, groups) = repeats(&state, &suite).await?;
    let groups = groups.into_iter().map(RepeatGroup::from).collect();
    tagged_json(&asked, &RepeatsBody { suite: board.entry.id.clone(), groups })
}
