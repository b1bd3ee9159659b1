//! `/v1/events`: a stream of events, one for each submission or run that ends, sent once the end is durable.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use tokio::sync::broadcast;

use super::event_feed::Batch;
use crate::app::App;
use crate::app::accounts::events::{Beginning, EventBody, EventsRead, after, begin, last};
use crate::app::error::{AppError, AppResult, Kind};
use crate::fair::Permit;
use crate::http::extract::caller::Reader;
use crate::http::extract::params::Params;
use crate::http::state::AppState;
use crate::store::StoreResult;
use crate::store::events::{EventRow, EventsOf};

/// Interval of keep-alive comments on an idle stream.
const ALIVE: Duration = Duration::from_secs(15);

/// Query of an event stream.
#[derive(Debug, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EventsQuery {
    /// Only events of this run and its submissions, from its beginning.
    #[param(format = Uuid)]
    run: Option<String>,
    /// Only the event of this submission.
    #[param(format = Uuid)]
    submission: Option<String>,
    /// Only events after the one with this identifier; the header `Last-Event-ID` takes precedence.
    after: Option<i64>,
}

/// Streams events.
///
/// A server-sent event tells of each submission or run that ends. Events have identifiers, so a client that reconnects
/// with `Last-Event-ID` misses none. Without `run` or `submission` the stream starts with the next event. With one of
/// them it starts at the beginning of that run or submission, and closes when it has ended.
#[utoipa::path(
    get, path = "/v1/events", operation_id = "get_events", tag = "submissions", summary = "Follow events",
    params(EventsQuery, ("Last-Event-ID" = Option<i64>, Header, description = "Id of the last event received")),
    responses(
        (status = 200, description = "Events, until the client or the service closes the stream", body = String,
         content_type = "text/event-stream",
         example = "id: 7\nevent: submission\ndata: {\"run\":null,\"submission\":\"0198c0de-…\",\"state\":\"graded\",\"overall\":true,\"at\":\"…\"}\n\n"),
        (status = 404, description = "There is no such run or submission"),
    )
)]
pub async fn get_events(
    State(state): State<AppState>,
    Params(query): Params<EventsQuery>,
    Reader(who): Reader,
    headers: HeaderMap,
) -> AppResult<Response> {
    let bad = |detail: &str| AppError::new(Kind::BadRequest, detail);
    let seen = match headers.get("last-event-id") {
        None => query.after,
        Some(id) => {
            let id = id.to_str().ok().and_then(|id| id.trim().parse().ok());
            Some(id.ok_or_else(|| bad("Last-Event-ID: expected the identifier of an event"))?)
        }
    };
    let Beginning { of, after, has_ended } = begin(&state, query.run, query.submission, seen).await?;
    let place = state.event_streams.take(&who);
    let place =
        place.map_err(|_| AppError::too_many("too many event streams are open; send the request again in a moment"))?;
    let feed = state.event_feed.follow();
    let following = Following {
        state,
        of,
        after,
        seen: None,
        feed,
        has_ended,
        is_over: false,
        read: VecDeque::new(),
        _permit: place,
    };
    let events = futures_util::stream::unfold(following, |mut following| async move {
        let event = following.next().await?;
        Some((Ok::<_, Infallible>(event), following))
    });
    // nginx would otherwise hold events back until they fill a buffer.
    let unbuffered = [("x-accel-buffering", "no")];
    Ok((unbuffered, Sse::new(events).keep_alive(KeepAlive::new().interval(ALIVE))).into_response())
}

/// Converts a stored event into the one to send; returns `None` if it cannot be serialized.
pub fn written(app: &App, row: &EventRow) -> Option<Event> {
    let name = if row.submission_id.is_some() { "submission" } else { "run" };
    let body = EventBody::of(app, row);
    Event::default().id(row.id.to_string()).event(name).json_data(body).ok()
}

/// An event stream and its progress.
struct Following {
    state: AppState,
    of: EventsOf,
    after: i64,
    /// Identifier of the event, followed or not, up to which nothing is missing; `None` if the stream must read the
    /// store.
    seen: Option<i64>,
    feed: broadcast::Receiver<Arc<Batch>>,
    /// Whether the followed run or submission had ended when the stream began.
    has_ended: bool,
    /// Whether no more events can follow because the followed run or submission has ended.
    is_over: bool,
    read: VecDeque<(EventRow, Event)>,
    _permit: Permit,
}

impl Following {
    /// Returns the next event; `None` at the end of the stream, or if the service stops or fails and the client has to
    /// reconnect.
    async fn next(&mut self) -> Option<Event> {
        while self.read.is_empty() && !self.is_over {
            if let Err(error) = self.wait().await {
                tracing::warn!(%error, "an event stream failed");
                return None;
            }
            if self.state.stop.is_cancelled() {
                return None;
            }
        }
        let (row, event) = self.read.pop_front()?;
        self.after = row.id;
        self.is_over |= match &self.of {
            EventsOf::Everything => false,
            EventsOf::Run(_) => row.submission_id.is_none(),
            EventsOf::Submission(_) => true,
        };
        Some(event)
    }

    /// Reads the store if the stream may have missed events; otherwise waits for the next shared batch.
    async fn wait(&mut self) -> StoreResult<()> {
        let Some(seen) = self.seen else { return self.look().await };
        let batch = tokio::select! {
            batch = self.feed.recv() => batch,
            () = self.state.stop.cancelled() => return Ok(()),
        };
        match batch {
            Ok(batch) if batch.after <= seen => {
                let own = batch.events.iter().filter(|(row, _)| row.id > self.after && self.of.has(row));
                self.read.extend(own.cloned());
                self.seen = Some(batch.to.max(seen));
            }
            // The shared batches do not continue where this stream left off, or this stream was too slow.
            Ok(_) | Err(broadcast::error::RecvError::Lagged(_)) => self.seen = None,
            Err(broadcast::error::RecvError::Closed) => self.state.stop.cancelled().await,
        }
        Ok(())
    }

    async fn look(&mut self) -> StoreResult<()> {
        // Reads the last identifier first: events added meanwhile may be read twice but are sent once.
        let end = last(&self.state).await?;
        let EventsRead { rows, is_full } = after(&self.state, &self.of, self.after).await?;
        if !is_full {
            self.seen = Some(end);
        }
        // The client has already received the last event.
        self.is_over |= rows.is_empty() && self.has_ended;
        let written = rows.into_iter().filter_map(|row| written(&self.state, &row).map(|event| (row, event)));
        self.read = written.collect();
        Ok(())
    }
}
