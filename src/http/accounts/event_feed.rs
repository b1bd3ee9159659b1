//! The event feed: reads new events once for all event streams.

use std::sync::Arc;
use std::time::Duration;

use axum::response::sse::Event;
use tokio::sync::broadcast;

use crate::app::App;
use crate::app::accounts::events::{EventsRead, after, ends, last};
use crate::store::StoreResult;
use crate::store::events::{EventRow, EventsOf};

/// Polling interval for events that another process has written.
const LOOK: Duration = Duration::from_secs(1);
/// Pause before reading after a notification, so that thousands of events per second need few reads.
const GATHER: Duration = Duration::from_millis(50);
/// Number of batches that a stream may fall behind before it must read the store itself.
const BEHIND: usize = 64;

/// Events read together: all events after one identifier, up to and including another.
#[derive(Debug)]
pub struct Batch {
    /// Identifier of the event before the first of the batch.
    pub after: i64,
    /// Identifier of the last event.
    pub to: i64,
    /// Events, as stored and as sent.
    pub events: Vec<(EventRow, Event)>,
}

/// Broadcasts new events to the event streams.
#[derive(Debug, Clone)]
pub struct EventFeed(broadcast::Sender<Arc<Batch>>);

impl EventFeed {
    /// Starts the task that reads events until the service stops. `write` turns a stored event into the one to send.
    #[must_use]
    pub fn start(app: Arc<App>, write: fn(&App, &EventRow) -> Option<Event>) -> Self {
        let (sender, _) = broadcast::channel(BEHIND);
        let feed = Self(sender.clone());
        tokio::spawn(async move {
            let mut read_to = None;
            while !app.stop.is_cancelled() {
                let ended = ends(&app).notified();
                tokio::pin!(ended);
                ended.as_mut().enable();
                // Without streams there is nothing to read.
                let read = if sender.receiver_count() == 0 {
                    read_to = None;
                    Ok(false)
                } else {
                    read(&app, &sender, &mut read_to, write).await
                };
                match read {
                    Ok(true) => {}
                    Ok(false) => tokio::select! {
                        () = ended => tokio::time::sleep(GATHER).await,
                        () = tokio::time::sleep(LOOK) => {}
                        () = app.stop.cancelled() => {}
                    },
                    Err(error) => {
                        tracing::warn!(%error, "could not read events");
                        tokio::time::sleep(LOOK).await;
                    }
                }
            }
        });
        feed
    }

    /// Returns a receiver for all batches from now on.
    #[must_use]
    pub fn follow(&self) -> broadcast::Receiver<Arc<Batch>> {
        self.0.subscribe()
    }
}

/// Reads the new events and broadcasts them; returns whether there may be more.
async fn read(
    app: &App,
    sender: &broadcast::Sender<Arc<Batch>>,
    read_to: &mut Option<i64>,
    write: fn(&App, &EventRow) -> Option<Event>,
) -> StoreResult<bool> {
    let from = if let Some(from) = *read_to {
        from
    } else {
        let from = last(app).await?;
        // Makes each stream that last read the store before this point read it again.
        let _ = sender.send(Arc::new(Batch { after: from, to: from, events: Vec::new() }));
        from
    };
    *read_to = Some(from);
    let EventsRead { rows, is_full } = after(app, &EventsOf::Everything, from).await?;
    let Some(to) = rows.last().map(|row| row.id) else { return Ok(false) };
    let events = rows.into_iter().filter_map(|row| write(app, &row).map(|event| (row, event))).collect();
    *read_to = Some(to);
    // Sending fails if all streams have ended meanwhile.
    let _ = sender.send(Arc::new(Batch { after: from, to, events }));
    Ok(is_full)
}
