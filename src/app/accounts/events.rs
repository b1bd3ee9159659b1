//! Events to follow: one for each submission or run that ends.

use tokio::sync::Notify;

use crate::app::App;
use crate::app::error::{AppError, AppResult};
use crate::store::StoreResult;
use crate::store::events::{EventRow, EventsOf};
use crate::store::states::{RunState, SubmissionState};

/// Maximum number of events per read.
const MAX_EVENTS: i64 = 500;

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
#[must_use]
pub fn task_of(app: &App, row: &EventRow) -> Option<String> {
    let number = u32::try_from(row.task_number?).ok()?;
    let catalogue = app.catalogue();
    let entry = catalogue.suite(row.suite_id.as_deref()?)?;
    Some(entry.task_numbered(number)?.0.id.clone())
}
