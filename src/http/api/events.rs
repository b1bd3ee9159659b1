//! `/v1/events`: the ends of submissions and runs, as they become durable.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Query, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use serde::{Deserialize, Serialize};
use tokio::sync::OwnedSemaphorePermit;

use super::super::problem::{ApiError, ApiResult, Problem};
use super::super::state::AppState;
use crate::clock::rfc3339;
use crate::store::StoreResult;
use crate::store::events::{EventRow, EventsOf};

/// Events read at once.
const PAGE: i64 = 500;
/// How often is looked for what another process has ended.
const LOOK: Duration = Duration::from_secs(1);
/// Pause after each look, so that thousands of ends a second become few looks.
const GATHER: Duration = Duration::from_millis(50);
/// How often a quiet stream says that it lives.
const ALIVE: Duration = Duration::from_secs(15);

/// Which events.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EventsQuery {
    /// Of this run and its submissions, from its beginning.
    run: Option<String>,
    /// Of this submission.
    submission: Option<String>,
    /// Only events after this one, as the header `Last-Event-ID` says it too.
    after: Option<i64>,
}

/// Data of an event. Its name is `submission` or `run`: what ended.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct EventBody {
    /// The run, where there is one.
    pub run: Option<String>,
    /// The submission; null where it is the run that ended.
    pub submission: Option<String>,
    /// The state in which it ended.
    #[schema(example = "graded")]
    pub state: String,
    /// Verdict of a graded submission.
    pub overall: Option<bool>,
    /// When.
    pub at: String,
}

/// Follow the ends of submissions and runs as server-sent events. Each has an id; a client that comes back with
/// `Last-Event-ID` misses none. Without `run` or `submission` the stream begins now; with one, at its beginning, and it ends
/// when that has ended.
#[utoipa::path(
    get, path = "/v1/events", operation_id = "get_events", tag = "submissions", summary = "Follow what ends",
    params(EventsQuery, ("Last-Event-ID" = Option<i64>, Header, description = "The last event that was seen")),
    responses(
        (status = 200, description = "Events, until the client or the service ends the stream", body = String,
         content_type = "text/event-stream",
         example = "id: 7\nevent: submission\ndata: {\"run\":null,\"submission\":\"0198c0de-…\",\"state\":\"graded\",\"overall\":true,\"at\":\"…\"}\n\n"),
        (status = 400, description = "A parameter is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There is no such run or submission", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too many streams; come back", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "A failure of ours", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_events(
    State(state): State<AppState>,
    Query(query): Query<EventsQuery>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let bad = |detail: &str| ApiError::new(StatusCode::BAD_REQUEST, "bad-request", "Bad request", detail);
    let seen = match headers.get("last-event-id") {
        None => query.after,
        Some(id) => {
            let id = id.to_str().ok().and_then(|id| id.trim().parse().ok());
            Some(id.ok_or_else(|| bad("Last-Event-ID: expected the id of an event"))?)
        }
    };
    let of = match (query.run, query.submission) {
        (Some(_), Some(_)) => return Err(bad("expected run or submission, not both")),
        (Some(id), None) if state.store.run(&id).await?.is_none() => {
            return Err(ApiError::not_found(format!("there is no run {id:?}")));
        }
        (None, Some(id)) if state.store.submission(&id).await?.is_none() => {
            return Err(ApiError::not_found(format!("there is no submission {id:?}")));
        }
        (Some(id), None) => EventsOf::Run(id),
        (None, Some(id)) => EventsOf::Submission(id),
        (None, None) => EventsOf::Everything,
    };
    let after = match (seen, &of) {
        (Some(seen), _) => seen,
        (None, EventsOf::Everything) => state.store.last_event().await?,
        (None, _) => 0,
    };
    let place = Arc::clone(&state.event_streams).try_acquire_owned();
    let Ok(place) = place else { return Err(ApiError::too_many("many follow events; come back in a moment")) };
    let following = Following { state, of, after, is_over: false, read: VecDeque::new(), _place: place };
    let events = futures_util::stream::unfold(following, |mut following| async move {
        let event = following.next().await?;
        Some((Ok::<_, Infallible>(event), following))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::new().interval(ALIVE)).into_response())
}

/// A stream and how far it is.
struct Following {
    state: AppState,
    of: EventsOf,
    after: i64,
    /// Whether nothing more can come: what was followed has ended.
    is_over: bool,
    read: VecDeque<EventRow>,
    _place: OwnedSemaphorePermit,
}

impl Following {
    /// The next event; none where the service stops or fails, and the client comes back.
    async fn next(&mut self) -> Option<Event> {
        while self.read.is_empty() && !self.is_over {
            // Listening begins before looking, so that nothing falls in between.
            let store = self.state.store.clone();
            let ended = store.ends().notified();
            tokio::pin!(ended);
            ended.as_mut().enable();
            if let Err(error) = self.look().await {
                tracing::warn!(%error, "a stream of events ends");
                return None;
            }
            if self.read.is_empty() {
                tokio::select! {
                    () = ended => tokio::time::sleep(GATHER).await,
                    () = tokio::time::sleep(LOOK) => {}
                    () = self.state.stop.cancelled() => return None,
                }
            }
        }
        let row = self.read.pop_front()?;
        self.after = row.id;
        self.is_over |= match &self.of {
            EventsOf::Everything => false,
            EventsOf::Run(_) => row.submission_id.is_none(),
            EventsOf::Submission(_) => true,
        };
        let name = if row.submission_id.is_some() { "submission" } else { "run" };
        let body = EventBody {
            run: row.run_id,
            submission: row.submission_id,
            state: row.state,
            overall: row.overall,
            at: rfc3339(row.at_ms),
        };
        Event::default().id(row.id.to_string()).event(name).json_data(body).ok()
    }

    async fn look(&mut self) -> StoreResult<()> {
        self.read = self.state.store.events(&self.of, self.after, PAGE).await?.into();
        Ok(())
    }
}
