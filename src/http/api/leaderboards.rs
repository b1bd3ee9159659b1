//! Leaderboards: one row per finished run of a suite.

use std::collections::HashMap;
use std::sync::{Arc, RwLock};
use std::time::{Duration, Instant};

use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Serialize;

use super::super::conditional::Tagged;
use super::super::problem::{ApiResult, Problem};
use super::super::state::AppState;
use crate::clock::rfc3339;
use crate::grading::summary::{CheckRate, Graded, PerCriterion, ProblemRate, Summary};
use crate::store::runs::RunRow;

/// A row: a finished run.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct BoardRow {
    /// Place by overall rate; runs with the same rate share one.
    pub rank: usize,
    /// The run.
    pub run: String,
    /// Who built.
    pub agent: String,
    /// Accuracy and physical plausibility and dependency, over all problems.
    pub overall: ProblemRate,
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
    /// When the run finished.
    pub finished_at: String,
}

/// A leaderboard.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Board {
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@2")]
    pub suite: String,
    /// Problems of the suite.
    #[schema(example = 723)]
    pub tasks: usize,
    /// Finished runs, the best first.
    pub rows: Vec<BoardRow>,
}

impl BoardRow {
    fn of(run: RunRow) -> Option<Self> {
        let Summary { check_level, problem_level, graded, .. } = run.summary?;
        let (pass, of) = (u64::try_from(run.graded).ok()?, u64::try_from(run.tasks).ok()?);
        Some(Self {
            rank: 0,
            run: run.id,
            agent: run.agent,
            overall: problem_level.overall,
            accuracy: problem_level.per.accuracy,
            problems: problem_level.per,
            checks: check_level,
            graded,
            coverage: ProblemRate { pass, of, rate: (of > 0).then(|| pass as f64 / of as f64) },
            finished_at: rfc3339(run.finished_at_ms?),
        })
    }
}

/// The board of a suite.
///
/// # Errors
/// 404 where there is no such suite.
pub async fn board(state: &AppState, suite: &str) -> ApiResult<Board> {
    let entry = state.suite(suite).await?;
    let runs = state.store.finished_runs(&entry.suite.id()).await?;
    let mut rows: Vec<BoardRow> = runs.into_iter().filter_map(BoardRow::of).collect();
    let rate = |row: &BoardRow| row.overall.rate.unwrap_or(-1.0);
    // A stable sort: of equal runs the earlier stays first.
    rows.sort_by(|a, b| rate(b).total_cmp(&rate(a)));
    let (mut rank, mut before) = (0, None);
    for (place, row) in (1..).zip(&mut rows) {
        if before != Some(rate(row)) {
            (rank, before) = (place, Some(rate(row)));
        }
        row.rank = rank;
    }
    Ok(Board { suite: entry.suite.id(), tasks: entry.suite.tasks.len(), rows })
}

/// The leaderboard of a suite: finished runs by overall rate.
#[utoipa::path(
    get, path = "/v1/leaderboards/{suite}", operation_id = "get_leaderboard", tag = "leaderboards",
    summary = "Get a leaderboard",
    params(("suite" = String, Path, description = "Name, or name@version", example = "mineceraft")),
    responses(
        (status = 200, description = "The board", body = Board, headers(("ETag" = String, description = "Of these very rows")),
         example = json!({ "suite": "mineceraft@2", "tasks": 723, "rows": [] })),
        (status = 304, description = "The rows are those of If-None-Match"),
        (status = 404, description = "There is no such suite", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_leaderboard(
    State(state): State<AppState>,
    Path(suite): Path<String>,
    asked: HeaderMap,
) -> ApiResult<Response> {
    let entry = state.suite(&suite).await?;
    let kept = state.boards.document(&state, &entry.suite.id()).await?;
    Ok(kept.answer(&asked))
}

/// How long a document is kept although nothing of this process says that it changed: another process on the same file may
/// have ended a run.
const KEPT_FOR: Duration = Duration::from_secs(1);

/// Boards as documents, kept until a run ends.
#[derive(Debug, Default)]
pub struct Boards {
    kept: RwLock<HashMap<String, Kept>>,
}

#[derive(Debug)]
struct Kept {
    document: Arc<Tagged>,
    runs_ended: u64,
    since: Instant,
}

impl Boards {
    /// The document of a suite's board.
    ///
    /// # Errors
    /// Where the database fails.
    async fn document(&self, state: &AppState, suite_id: &str) -> ApiResult<Arc<Tagged>> {
        let runs_ended = state.store.runs_ended();
        if let Some(document) = self.fresh(suite_id, runs_ended) {
            return Ok(document);
        }
        let document = Arc::new(Tagged::of(&board(state, suite_id).await?)?);
        let kept = Kept { document: Arc::clone(&document), runs_ended, since: Instant::now() };
        let mut all = self.kept.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        all.insert(suite_id.to_owned(), kept);
        Ok(document)
    }

    fn fresh(&self, suite_id: &str, runs_ended: u64) -> Option<Arc<Tagged>> {
        let all = self.kept.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        let kept = all.get(suite_id)?;
        let is_fresh = kept.runs_ended == runs_ended && kept.since.elapsed() < KEPT_FOR;
        is_fresh.then(|| Arc::clone(&kept.document))
    }
}
