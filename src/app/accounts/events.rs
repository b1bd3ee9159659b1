//! Events to follow: one for each submission or run that ends.

use serde::Serialize;
use tokio::sync::Notify;

use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::clock::rfc3339;
use crate::store::StoreResult;
use crate::store::events::{EventRow, EventsOf};
use crate::store::states::{RunState, SubmissionState};

/// Maximum number of events per read.
const MAX_EVENTS: i64 = 500;

/// Final state of a submission or a run.
#[derive(Debug, utoipa::ToSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EndState {
    /// The submission was graded.
    Graded,
    /// The submission was rejected.
    Rejected,
    /// Grading the submission failed because of an internal error.
    GraderError,
    /// The submission was cancelled.
    Cancelled,
    /// The run was finished.
    Finished,
    /// The run was deleted.
    Deleted,
}

/// Data of an event. The name of the event, `submission` or `run`, says what ended.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EventBody {
    /// Identifier of the run; null for a submission without a run.
    #[schema(format = Uuid)]
    pub run: Option<String>,
    /// Identifier of the submission; null for the end of a run.
    #[schema(format = Uuid)]
    pub submission: Option<String>,
    /// `name@version` of the suite.
    #[schema(example = "mineceraft@4")]
    pub suite: Option<String>,
    /// Identifier of the submission's task; null for the end of a run.
    #[schema(example = "walls/5x1x5-raise")]
    pub task: Option<String>,
    /// Number of the submission's task in the suite; null for the end of a run.
    #[schema(example = 113)]
    pub number: Option<u32>,
    /// Final state of the submission or run.
    #[schema(value_type = EndState, example = "graded")]
    pub state: String,
    /// Verdict on a graded submission; otherwise null.
    pub overall: Option<bool>,
    /// Time of the end.
    #[schema(format = DateTime)]
    pub at: String,
}

impl EventBody {
    /// Builds the body of a stored event.
    #[must_use]
    pub fn of(app: &App, row: &EventRow) -> Self {
        Self {
            suite: row.suite_id.clone(),
            task: task_of(app, row),
            number: row.task_number.and_then(|number| u32::try_from(number).ok()),
            run: row.run_id.clone(),
            submission: row.submission_id.clone(),
            state: row.state.clone(),
            overall: row.overall,
            at: rfc3339(row.at_ms),
        }
    }
}

/// Beginning of a stream of events.
#[derive(Debug)]
pub struct Beginning {
    /// Events that are followed.
    pub of: EventsOf,
    /// Number of the event after which the stream begins.
    pub after: i64,
    /// Whether the followed run or submission has already ended.
    pub has_ended: bool,
}

/// Events that were read together.
#[derive(Debug)]
pub struct EventsRead {
    /// The events, in order.
    pub rows: Vec<EventRow>,
    /// Whether there may be more.
    pub is_full: bool,
}

/// Decides where a stream of events begins: after the event that was seen last, else at the beginning of the run or
/// submission, else with the next event.
///
/// # Errors
/// Returns an error if both a run and a submission are given, if there is no such run or submission, or if the database
/// fails.
pub async fn begin(
    app: &App,
    run: Option<String>,
    submission: Option<String>,
    seen: Option<i64>,
) -> AppResult<Beginning> {
    let (of, has_ended) = match (run, submission) {
        (Some(_), Some(_)) => {
            return Err(AppError::wrong_parameter("submission", "run and submission cannot be combined"));
        }
        (Some(id), None) => {
            let state = app.store.run(&id).await?.map(|run| run.state);
            let state = state.ok_or_else(|| AppError::not_found(format!("there is no run {id:?}")))?;
            (EventsOf::Run(id), matches!(state, RunState::Finished | RunState::Deleted))
        }
        (None, Some(id)) => {
            let state = app.store.submission(&id).await?.map(|submission| submission.state);
            let state = state.ok_or_else(|| AppError::not_found(format!("there is no submission {id:?}")))?;
            (EventsOf::Submission(id), !matches!(state, SubmissionState::Queued | SubmissionState::Grading))
        }
        (None, None) => (EventsOf::Everything, false),
    };
    let after = match (seen, &of) {
        (Some(seen), _) => seen,
        (None, EventsOf::Everything) => last(app).await?,
        (None, _) => 0,
    };
    Ok(Beginning { of, after, has_ended })
}

/// Returns the number of the last event; 0 if there is none.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn last(app: &App) -> StoreResult<i64> {
    app.store.last_event().await
}

/// Reads the next events after a number, in order.
///
/// # Errors
/// Returns an error if the database fails.
pub async fn after(app: &App, of: &EventsOf, after: i64) -> StoreResult<EventsRead> {
    let rows = app.store.events(of, after, MAX_EVENTS).await?;
    Ok(EventsRead { is_full: rows.len() as i64 == MAX_EVENTS, rows })
}

/// Returns the notifier that fires after submissions have ended in this process.
#[must_use]
pub fn ends(app: &App) -> &Notify {
    app.store.ends()
}

/// Returns the identifier of the task of an event; none for the end of a run.
fn task_of(app: &App, row: &EventRow) -> Option<String> {
    let number = u32::try_from(row.task_number?).ok()?;
    let catalogue = app.catalogue();
    let entry = catalogue.suite(row.suite_id.as_deref()?)?;
    Some(entry.task_numbered(number)?.0.id.clone())
}
