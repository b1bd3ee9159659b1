//! Memory for what free JSON grows into: bounded in total and for each sender.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Instant;

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::app::body::free::memory_of;
use crate::app::error::{AppError, AppResult};
use crate::app::limits::LIMITS;
use crate::app::rewards::in_time::graded_in_time;

/// Number of bytes that one permit of a memory budget stands for.
pub(super) const PERMIT_BYTES: usize = 64 << 10;

/// Memory for the values of free JSON. Requests wait for it, first for a part of what their sender may use, then for a
/// part of the whole, so that one sender alone does not let all others wait.
#[derive(Debug)]
pub struct GrowingRoom {
    all: Arc<Semaphore>,
    /// What each sender may still use; gone once none of its requests uses or awaits any.
    each: Mutex<HashMap<Arc<str>, Weak<Semaphore>>>,
}

/// Memory that a request may use, until it is dropped.
#[derive(Debug)]
pub struct GrowingShare {
    _own: OwnedSemaphorePermit,
    _all: OwnedSemaphorePermit,
}

impl Default for GrowingRoom {
    fn default() -> Self {
        let all = Arc::new(Semaphore::new(LIMITS.free_json_in_memory_bytes / PERMIT_BYTES));
        Self { all, each: Mutex::default() }
    }
}

impl GrowingRoom {
    /// Waits for memory for what a body of free JSON grows into. The share is to be held while its values are in memory;
    /// short bodies need none.
    ///
    /// # Errors
    /// Returns 503 if the request, which began at `begun`, would run out of time.
    pub async fn wait_for(&self, text: Bytes, who: &Arc<str>, begun: Instant) -> AppResult<Option<GrowingShare>> {
        /// Bytes that are looked through sooner than on another thread.
        const SHORT: usize = 64 << 10;
        let bytes = if text.len() <= SHORT {
            memory_of(&text)
        } else {
            let counted = tokio::task::spawn_blocking(move || memory_of(&text)).await;
            counted.map_err(|error| AppError::internal(&error))?
        };
        let permits = u32::try_from(bytes / PERMIT_BYTES).expect("the memory of a body is bounded");
        if permits == 0 {
            return Ok(None);
        }
        graded_in_time(begun, async { Ok(self.share(who, permits).await) }).await.map(Some)
    }

    async fn share(&self, who: &Arc<str>, permits: u32) -> GrowingShare {
        let own = self.own(who).acquire_many_owned(permits).await.expect("it is never closed");
        let all = Arc::clone(&self.all).acquire_many_owned(permits).await.expect("it is never closed");
        GrowingShare { _own: own, _all: all }
    }

    /// Returns what a sender may still use.
    fn own(&self, who: &Arc<str>) -> Arc<Semaphore> {
        let mut each = self.each.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = each.get(who).and_then(Weak::upgrade) {
            return own;
        }
        each.retain(|_, own| own.strong_count() > 0);
        let own = Arc::new(Semaphore::new(LIMITS.free_json_in_memory_bytes_per_sender / PERMIT_BYTES));
        each.insert(Arc::clone(who), Arc::downgrade(&own));
        own
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[tokio::test]
    async fn a_sender_waits_for_its_own_part_and_holds_up_no_other() {
        let room = Arc::new(GrowingRoom::default());
        let (many, one): (Arc<str>, Arc<str>) = (Arc::from("many"), Arc::from("one"));
        let whole = u32::try_from(LIMITS.free_json_in_memory_bytes_per_sender / PERMIT_BYTES).unwrap();
        let held = room.share(&many, whole).await;
        let waiting = tokio::spawn({
            let (room, many) = (Arc::clone(&room), Arc::clone(&many));
            async move { room.share(&many, 1).await }
        });
        let other = tokio::time::timeout(Duration::from_secs(10), room.share(&one, whole)).await;
        drop(other.expect("the other sender has a part of its own"));
        assert!(!waiting.is_finished());
        drop(held);
        drop(waiting.await.unwrap());
        drop(room.share(&one, 1).await);
        assert_eq!(room.each.lock().unwrap().len(), 1, "a sender that is gone is forgotten");
    }

    #[test]
    fn the_greatest_body_has_room() {
        let most = memory_of("[".repeat(LIMITS.free_json_values).as_bytes());
        assert!(most <= LIMITS.free_json_in_memory_bytes_per_sender);
        const { assert!(LIMITS.free_json_in_memory_bytes_per_sender <= LIMITS.free_json_in_memory_bytes) };
    }
}
