//! What has ended lately, read once for all who follow events.

use std::sync::Arc;
use std::time::Duration;

use axum::response::sse::Event;
use tokio::sync::broadcast;
use tokio_util::sync::CancellationToken;

use crate::store::events::{EventRow, EventsOf};
use crate::store::{Store, StoreResult};

/// Events read at once.
const PAGE: i64 = 500;
/// How often is looked for what another process has ended.
const LOOK: Duration = Duration::from_secs(1);
/// Pause after each look, so that thousands of ends a second become few looks.
const GATHER: Duration = Duration::from_millis(50);
/// Batches that a slow follower may be behind; then it reads for itself.
const BEHIND: usize = 64;

/// Events that were read together: all that there are after one id, up to another.
#[derive(Debug)]
pub struct Batch {
    /// The event before the first.
    pub after: i64,
    /// The last event.
    pub to: i64,
    /// The events, with what is sent of them.
    pub events: Vec<(EventRow, Event)>,
}

/// Hands on what has ended.
#[derive(Debug, Clone)]
pub struct EventFeed(broadcast::Sender<Arc<Batch>>);

impl EventFeed {
    /// Starts reading; it ends when the service stops. `write` makes of a row what is sent.
    #[must_use]
    pub fn start(store: Store, stop: CancellationToken, write: fn(&Store, &EventRow) -> Option<Event>) -> Self {
        let (sender, _) = broadcast::channel(BEHIND);
        let feed = Self(sender.clone());
        tokio::spawn(async move {
            let mut last = None;
            while !stop.is_cancelled() {
                let ended = store.ends().notified();
                tokio::pin!(ended);
                ended.as_mut().enable();
                // Nobody follows: nothing to read.
                let read = if sender.receiver_count() == 0 {
                    last = None;
                    Ok(false)
                } else {
                    read(&store, &sender, &mut last, write).await
                };
                match read {
                    Ok(true) => {}
                    Ok(false) => tokio::select! {
                        () = ended => tokio::time::sleep(GATHER).await,
                        () = tokio::time::sleep(LOOK) => {}
                        () = stop.cancelled() => {}
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

    /// What is read from now on.
    #[must_use]
    pub fn follow(&self) -> broadcast::Receiver<Arc<Batch>> {
        self.0.subscribe()
    }
}

/// Reads what is new, and hands it on; says whether there may be more.
async fn read(
    store: &Store,
    sender: &broadcast::Sender<Arc<Batch>>,
    last: &mut Option<i64>,
    write: fn(&Store, &EventRow) -> Option<Event>,
) -> StoreResult<bool> {
    let after = if let Some(after) = *last {
        after
    } else {
        let after = store.last_event().await?;
        // Whoever has looked for themselves before this, and not since, looks again.
        let _ = sender.send(Arc::new(Batch { after, to: after, events: Vec::new() }));
        after
    };
    *last = Some(after);
    let rows = store.events(&EventsOf::Everything, after, PAGE).await?;
    let Some(to) = rows.last().map(|row| row.id) else { return Ok(false) };
    let is_full = rows.len() as i64 == PAGE;
    let events = rows.into_iter().filter_map(|row| write(store, &row).map(|event| (row, event))).collect();
    *last = Some(to);
    // Whoever followed may have gone.
    let _ = sender.send(Arc::new(Batch { after, to, events }));
    Ok(is_full)
}
