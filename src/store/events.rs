//! Events: ends of submissions and runs, in the order in which they became durable.

use super::db::{Builder, Tx, query_scalar};
use super::locks::Lock;
use super::rows::from_row;
use super::{Store, StoreResult};

/// End of a submission or a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRow {
    /// Number of the event; increases with each event.
    pub id: i64,
    /// Time of the event, in milliseconds since 1970.
    pub at_ms: i64,
    /// Identifier of the run, if there is one.
    pub run_id: Option<String>,
    /// Identifier of the submission; none if a run ended.
    pub submission_id: Option<String>,
    /// State in which it ended.
    pub state: String,
    /// Verdict of a graded submission.
    pub overall: Option<bool>,
    /// `name@version` of the suite of the submission or run.
    pub suite_id: Option<String>,
    /// Number of the submission's task in the suite.
    pub task_number: Option<i64>,
}

from_row!(EventRow { id, at_ms, run_id, submission_id, state, overall, suite_id, task_number });

/// Selection of events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum EventsOf {
    /// All events.
    Everything,
    /// Events of a run and its submissions.
    Run(String),
    /// Events of a submission.
    Submission(String),
}

impl EventsOf {
    /// Returns whether an event is in the selection.
    #[must_use]
    pub fn has(&self, row: &EventRow) -> bool {
        match self {
            Self::Everything => true,
            Self::Run(id) => row.run_id.as_ref() == Some(id),
            Self::Submission(id) => row.submission_id.as_ref() == Some(id),
        }
    }
}

/// Event to store.
#[derive(Debug)]
pub(super) struct NewEvent<'a> {
    pub run_id: Option<&'a str>,
    pub submission_id: Option<&'a str>,
    pub state: &'static str,
    pub overall: Option<bool>,
}

/// Stores events.
pub(super) async fn enter(tx: &mut Tx, events: &[NewEvent<'_>], now_ms: i64) -> StoreResult<()> {
    tx.lock([Lock::Order]).await?;
    let mut query = Builder::new("INSERT INTO events (at_ms, run_id, submission_id, state, overall) ");
    query.push_values(events, |row, event| {
        row.push_bind(now_ms)
            .push_bind(event.run_id.map(str::to_owned))
            .push_bind(event.submission_id.map(str::to_owned))
            .push_bind(event.state)
            .push_bind(event.overall);
    });
    query.build().execute(tx).await?;
    Ok(())
}

impl Store {
    /// Returns at most `limit` events after number `after`, in order.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn events(&self, of: &EventsOf, after: i64, limit: i64) -> StoreResult<Vec<EventRow>> {
        let mut query =
            Builder::new(
            "SELECT e.id, e.at_ms, e.run_id, e.submission_id, e.state, e.overall, COALESCE(s.suite_id, r.suite_id) AS suite_id,
                    s.task_number
             FROM events e LEFT JOIN submissions s ON s.id = e.submission_id LEFT JOIN runs r ON r.id = e.run_id
             WHERE e.id > ",
        );
        query.push_bind(after);
        match of {
            EventsOf::Everything => {}
            EventsOf::Run(id) => {
                query.push(" AND e.run_id = ").push_bind(id.clone());
            }
            EventsOf::Submission(id) => {
                query.push(" AND e.submission_id = ").push_bind(id.clone());
            }
        }
        query.push(" ORDER BY e.id LIMIT ").push_bind(limit);
        query.build_as().fetch_all(&self.readers).await
    }

    /// Returns the number of the last event; 0 if there is none.
    ///
    /// # Errors
    /// Returns an error if the database fails.
    pub async fn last_event(&self) -> StoreResult<i64> {
        query_scalar("SELECT COALESCE(MAX(id), 0) FROM events").fetch_one(&self.readers).await
    }
}
