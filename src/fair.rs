//! Fair sharing: slots that waiting senders get in rotation, and permits that are limited in total and per sender.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// Slots for concurrent work. Waiting senders are served in rotation, so that a sender with many requests does not
/// delay one with few.
#[derive(Debug)]
pub struct FairSlots {
    queue: Mutex<Queue>,
    /// Maximum number of slots that one sender may hold.
    each: usize,
}

#[derive(Debug)]
struct Queue {
    free: usize,
    /// Waiting senders, in the order in which they are served.
    order: VecDeque<Arc<str>>,
    senders: HashMap<Arc<str>, SenderState>,
}

#[derive(Debug, Default)]
struct SenderState {
    held: usize,
    waiting: VecDeque<oneshot::Sender<Slot>>,
}

/// Slot, held until it is dropped.
#[derive(Debug)]
pub struct Slot {
    slots: Arc<FairSlots>,
    who: Arc<str>,
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut queue = self.slots.queue();
        queue.free += 1;
        if let Some(sender) = queue.senders.get_mut(&self.who) {
            sender.held -= 1;
            if sender.held == 0 && sender.waiting.is_empty() {
                queue.senders.remove(&self.who);
            }
        }
        drop(queue);
        self.slots.hand_out();
    }
}

impl FairSlots {
    /// Creates `slots` slots, of which one sender may hold `each` at once.
    #[must_use]
    pub fn new(slots: usize, each: usize) -> Arc<Self> {
        let queue = Queue { free: slots.max(1), order: VecDeque::new(), senders: HashMap::new() };
        Arc::new(Self { queue: Mutex::new(queue), each: each.max(1) })
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a slot. A caller that stops waiting loses its position in the queue.
    pub async fn take(self: &Arc<Self>, who: &Arc<str>) -> Slot {
        loop {
            let (give, given) = oneshot::channel();
            self.enter(who, give);
            self.hand_out();
            // The sending end is only dropped together with the slots.
            if let Ok(slot) = given.await {
                return slot;
            }
        }
    }

    /// Adds a waiting caller to the queue of its sender.
    fn enter(&self, who: &Arc<str>, give: oneshot::Sender<Slot>) {
        let mut queue = self.queue();
        let sender = queue.senders.entry(Arc::clone(who)).or_default();
        sender.waiting.push_back(give);
        if sender.waiting.len() == 1 {
            queue.order.push_back(Arc::clone(who));
        }
    }

    /// Hands free slots to the callers that are next.
    fn hand_out(self: &Arc<Self>) {
        while let Some((waiter, slot)) = self.next() {
            // If the caller no longer waits, the slot is dropped, which frees it at once.
            let _ = waiter.send(slot);
        }
    }

    /// Takes the next waiting caller from the queue, with a slot for it.
    fn next(self: &Arc<Self>) -> Option<(oneshot::Sender<Slot>, Slot)> {
        let mut queue = self.queue();
        let queue = &mut *queue;
        for _ in 0..queue.order.len() {
            if queue.free == 0 {
                return None;
            }
            let who = queue.order.pop_front()?;
            let Some(sender) = queue.senders.get_mut(&who) else { continue };
            while sender.waiting.front().is_some_and(oneshot::Sender::is_closed) {
                sender.waiting.pop_front();
            }
            if sender.held >= self.each && !sender.waiting.is_empty() {
                queue.order.push_back(who);
                continue;
            }
            let Some(waiter) = sender.waiting.pop_front() else {
                if sender.held == 0 {
                    queue.senders.remove(&who);
                }
                continue;
            };
            sender.held += 1;
            queue.free -= 1;
            if !sender.waiting.is_empty() {
                queue.order.push_back(Arc::clone(&who));
            }
            return Some((waiter, Slot { slots: Arc::clone(self), who }));
        }
        None
    }
}

/// Permits, limited in total and per sender.
#[derive(Debug)]
pub struct PermitPool {
    held: Mutex<(usize, HashMap<Arc<str>, usize>)>,
    all: usize,
    each: usize,
}

/// Permit, held until it is dropped.
#[derive(Debug)]
pub struct Permit {
    places: Arc<PermitPool>,
    who: Arc<str>,
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut held = self.places.held.lock().unwrap_or_else(PoisonError::into_inner);
        held.0 -= 1;
        if let Some(own) = held.1.get_mut(&self.who) {
            *own -= 1;
            if *own == 0 {
                held.1.remove(&self.who);
            }
        }
    }
}

/// Reason why there is no permit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPermit {
    /// All permits are held.
    All,
    /// The sender holds as many permits as one sender may.
    Own,
}

impl PermitPool {
    /// Creates `all` permits, of which one sender may hold `each`.
    #[must_use]
    pub fn new(all: usize, each: usize) -> Arc<Self> {
        Arc::new(Self { held: Mutex::default(), all, each })
    }

    /// Takes a permit.
    ///
    /// # Errors
    /// Returns an error if there is none.
    pub fn take(self: &Arc<Self>, who: &Arc<str>) -> Result<Permit, NoPermit> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if held.0 >= self.all {
            return Err(NoPermit::All);
        }
        let own = held.1.entry(Arc::clone(who)).or_default();
        if *own >= self.each {
            return Err(NoPermit::Own);
        }
        *own += 1;
        held.0 += 1;
        Ok(Permit { places: Arc::clone(self), who: Arc::clone(who) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> Arc<str> {
        Arc::from(name)
    }

    #[tokio::test]
    async fn one_who_asks_seldom_is_served_after_one_of_the_others() {
        let slots = FairSlots::new(1, 1);
        let (a, b) = (named("a"), named("b"));
        let first = slots.take(&a).await;
        let order: Arc<Mutex<Vec<&str>>> = Arc::default();
        let mut waiting = Vec::new();
        for (who, name) in [(&a, "a1"), (&a, "a2"), (&a, "a3"), (&b, "b1")] {
            let (slots, order, who) = (Arc::clone(&slots), Arc::clone(&order), Arc::clone(who));
            waiting.push(tokio::spawn(async move {
                let _slot = slots.take(&who).await;
                order.lock().unwrap().push(name);
            }));
            tokio::task::yield_now().await;
        }
        drop(first);
        for one in waiting {
            one.await.unwrap();
        }
        assert_eq!(*order.lock().unwrap(), ["a1", "b1", "a2", "a3"]);
        assert!(slots.queue().senders.is_empty(), "a sender that is gone is forgotten");
    }

    #[tokio::test]
    async fn whoever_leaves_loses_the_turn_and_no_slot_is_lost() {
        let slots = FairSlots::new(1, 1);
        let (a, b) = (named("a"), named("b"));
        let first = slots.take(&a).await;
        let gone = tokio::spawn({
            let (slots, a) = (Arc::clone(&slots), Arc::clone(&a));
            async move { slots.take(&a).await }
        });
        tokio::task::yield_now().await;
        gone.abort();
        assert!(gone.await.is_err());
        drop(first);
        drop(slots.take(&b).await);
        assert_eq!(slots.queue().free, 1);
        assert!(slots.queue().order.is_empty());
    }

    #[tokio::test]
    async fn one_sender_has_its_part_of_the_slots() {
        let slots = FairSlots::new(2, 1);
        let (a, b) = (named("a"), named("b"));
        let _first = slots.take(&a).await;
        let second = tokio::time::timeout(std::time::Duration::from_millis(20), slots.take(&a)).await;
        assert!(second.is_err(), "a second slot of the same sender");
        drop(slots.take(&b).await);
    }

    #[test]
    fn places_are_counted_in_all_and_for_each() {
        let places = PermitPool::new(3, 2);
        let (a, b) = (named("a"), named("b"));
        let held = [places.take(&a).unwrap(), places.take(&a).unwrap()];
        assert_eq!(places.take(&a).unwrap_err(), NoPermit::Own);
        let other = places.take(&b).unwrap();
        assert_eq!(places.take(&b).unwrap_err(), NoPermit::All);
        drop((held, other));
        assert!(places.take(&b).is_ok() && places.held.lock().unwrap().1.is_empty());
    }
}
