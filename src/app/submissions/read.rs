//! Reading submissions: state and position in the queue, report and log.

use std::sync::Arc;

use crate::actions::turn_replay::TurnReplay;
use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::app::structure_files::written;
use crate::clock::now_ms;
use crate::formats::FileFormat;
use crate::store::StoreError;
use crate::store::reports::ReportRow;
use crate::store::states::SubmissionState;
use crate::store::submissions::SubmissionRow;
use plumbline_engine::checks::Criterion;
use plumbline_engine::tasks::Task;
use plumbline_engine::tasks::catalogue::Entry;
use plumbline_engine::voxel::BlockLog;

/// Number of submissions ahead of another up to which they are counted.
const MAX_COUNTED: i64 = 10_000;

/// Reads the stored results of a submission's action code.
///
/// # Errors
/// Returns an error if they are damaged.
pub fn replays(stored: Option<&str>) -> AppResult<Vec<TurnReplay>> {
    let read = |json| serde_json::from_str(json).map_err(|error| StoreError::corrupt("submissions", error));
    Ok(stored.map(read).transpose()?.unwrap_or_default())
}

/// A submission and how long it still waits.
#[derive(Debug)]
pub struct SubmissionStatus {
    /// The submission.
    pub row: SubmissionRow,
    /// Suite of its task.
    pub entry: Arc<Entry>,
    /// Number of submissions ahead of it while it is queued.
    pub queued_before: Option<i64>,
    /// Estimated seconds until its grading begins, while it is queued, at the pace of the latest gradings.
    pub estimated_seconds: Option<f64>,
}

/// A submission with its task, its agent and its report.
#[derive(Debug)]
pub struct SubmissionDetails {
    /// The submission.
    pub row: SubmissionRow,
    /// Suite of its task.
    pub entry: Arc<Entry>,
    /// Name of the agent of its run.
    pub agent: Option<String>,
    /// Its latest report.
    pub report: Option<ReportRow>,
}

impl SubmissionDetails {
    /// Returns the task that it answers.
    #[must_use]
    pub fn task(&self) -> Option<&Task> {
        self.entry.task_numbered(self.row.task_number).map(|(task, _)| task)
    }

    /// Returns whether the task has a check of structural stability.
    #[must_use]
    pub fn has_stress(&self) -> bool {
        let is_stress = |task: &Task| task.checks().any(|check| check.criterion() == Criterion::StructuralStability);
        self.task().is_some_and(is_stress)
    }
}

/// Submissions that have not ended. Answers to hidden instances are left out.
#[derive(Debug, Clone, Copy)]
pub struct Backlog {
    /// Number of submissions.
    pub open: i64,
    /// Age of the oldest, in milliseconds.
    pub oldest_ms: i64,
}

/// Returns the stored submission with this id.
///
/// # Errors
/// Returns an error if there is no such submission, or if the database fails.
pub async fn stored(app: &App, id: &str) -> AppResult<SubmissionRow> {
    app.store.submission(id).await?.ok_or_else(|| missing(id))
}

/// Returns a submission, with its position in the queue while it is queued.
///
/// # Errors
/// Returns an error if there is no such submission, or if the database fails.
pub async fn status(app: &App, id: &str) -> AppResult<SubmissionStatus> {
    let row = stored(app, id).await?;
    let entry = app.suite(&row.suite_id).await?;
    // Owners take turns in the queue, so the place of an anonymous submission would tell whose it is.
    let waits = row.state == SubmissionState::Queued && !row.is_anonymous;
    let queued_before = if waits { app.store.jobs_before(&row.id, MAX_COUNTED).await? } else { None };
    let pace = app.store.seconds_a_job();
    let estimated_seconds =
        queued_before.zip(pace).map(|(before, pace)| ((before + 1) as f64 * pace * 10.0).round() / 10.0);
    Ok(SubmissionStatus { row, entry, queued_before, estimated_seconds })
}

/// Returns the latest report on a submission, or that of an attempt.
///
/// # Errors
/// Returns an error if there is no such submission or report, if the submission is not graded, or if the database
/// fails.
pub async fn report(app: &App, id: &str, attempt: Option<i64>) -> AppResult<(SubmissionRow, ReportRow)> {
    let row = stored(app, id).await?;
    if let Some(report) = app.store.report(id, attempt).await? {
        return Ok((row, report));
    }
    if let (Some(attempt), SubmissionState::Graded) = (attempt, row.state) {
        return Err(AppError::not_found(format!("there is no report of attempt {attempt}")));
    }
    let error = AppError::conflict("not-graded", format!("the submission is {}", row.state.name()));
    let is_coming = matches!(row.state, SubmissionState::Queued | SubmissionState::Grading);
    Err(if is_coming { error.retry_after(1) } else { error })
}

/// Returns a submission with its task, its agent and its report.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn details(app: &App, row: SubmissionRow) -> AppResult<SubmissionDetails> {
    let entry = app.suite(&row.suite_id).await?;
    let report = app.store.report(&row.id, None).await?;
    let agent = match &row.run_id {
        Some(run) => app.store.run(run).await?.map(|run| run.agent),
        None => None,
    };
    Ok(SubmissionDetails { row, entry, agent, report })
}

/// Returns the log of a submission as canonical JSON.
///
/// # Errors
/// Returns an error if there is no such submission, or if the database fails.
pub async fn log(app: &App, id: &str) -> AppResult<Vec<u8>> {
    app.store.log_json(id).await?.ok_or_else(|| missing(id))
}

/// Returns what stands after a turn of a submission, by default the last, as a structure file, and the position of its
/// least corner.
///
/// # Errors
/// Returns 404 if there is no such submission or turn, 409 if the format cannot hold the build, or an error if the
/// database fails.
pub async fn structure_file(
    app: &App,
    who: &Arc<str>,
    id: &str,
    turn: Option<usize>,
    format: FileFormat,
) -> AppResult<([i32; 3], Vec<u8>)> {
    let slot = app.file_slots.take(who).await;
    let log = log(app, id).await?;
    let writing = tokio::task::spawn_blocking(move || {
        // Held until the work ends, also if the sender no longer waits.
        let _slot = slot;
        let log = BlockLog::from_canonical_json(&log).map_err(|error| AppError::damaged("submissions", error))?;
        written(&log, turn, format)
    });
    writing.await.map_err(|error| AppError::internal(&error))?
}

/// Counts the submissions that have not ended.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn backlog(app: &App) -> AppResult<Backlog> {
    let (open, oldest_ms) = app.store.backlog(now_ms()).await?;
    Ok(Backlog { open, oldest_ms })
}

fn missing(id: &str) -> AppError {
    AppError::not_found(format!("there is no submission {id:?}"))
}
