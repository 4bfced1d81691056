//! Slots for connections that wait for data from a client; the service's socket and the web pages use them.
//!
//! The number of slots is sufficient for normal use. If no slot is free, a new connection is accepted nevertheless, and
//! another one is closed: of the user or address with the most slots, the connection that has been silent for the
//! longest time. A client that requests a stop sends its line immediately, so the line is read before its connection is
//! closed.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// Maximum number of connections that are read at the same time, of one owner and in total.
#[derive(Debug, Clone, Copy)]
pub(super) struct MaxConnections {
    /// Maximum number of connections of one user or one address.
    pub per_owner: usize,
    /// Maximum number of all connections.
    pub total: usize,
}

/// All slots; `Of` is the type of a connection's owner. Clones share the same slots.
#[derive(Debug)]
pub(super) struct Slots<Of>(Arc<Mutex<Inside<Of>>>);

#[derive(Debug)]
struct Inside<Of> {
    most: MaxConnections,
    last: u64,
    /// The occupied slots, ordered by activity: the one whose connection has been silent for the longest time is first.
    taken: Vec<OccupiedSlot<Of>>,
}

#[derive(Debug)]
struct OccupiedSlot<Of> {
    number: u64,
    owner: Of,
    wanted: oneshot::Sender<()>,
}

/// An occupied slot; dropping this value frees it.
#[derive(Debug)]
pub(super) struct Slot<Of> {
    number: u64,
    wanted: oneshot::Receiver<()>,
    slots: Slots<Of>,
}

/// A handle that marks the connection of a slot as active. Clones mark the same connection.
#[derive(Debug)]
pub(super) struct ActivityHandle<Of> {
    number: u64,
    slots: Slots<Of>,
}

impl<Of> Clone for Slots<Of> {
    fn clone(&self) -> Self {
        Slots(self.0.clone())
    }
}

impl<Of> Clone for ActivityHandle<Of> {
    fn clone(&self) -> Self {
        ActivityHandle { number: self.number, slots: self.slots.clone() }
    }
}

impl<Of> Slots<Of> {
    /// Creates this number of free slots.
    pub fn new(most: MaxConnections) -> Self {
        Slots(Arc::new(Mutex::new(Inside { most, last: 0, taken: Vec::new() })))
    }

    fn lock(&self) -> MutexGuard<'_, Inside<Of>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<Of: Copy + PartialEq> Slots<Of> {
    /// Assigns a slot to a connection of this owner; if no slot is free, another connection must give up its slot.
    pub fn acquire(&self, of: Of) -> Slot<Of> {
        let mut inside = self.lock();
        let held = |inside: &Inside<Of>, of| inside.taken.iter().filter(|taken| taken.owner == of).count();
        if held(&inside, of) >= inside.most.per_owner {
            inside.evict_oldest(of);
        } else if inside.taken.len() >= inside.most.total {
            let greedy = inside.taken.iter().map(|taken| taken.owner).max_by_key(|of| held(&inside, *of));
            inside.evict_oldest(greedy.unwrap_or(of));
        }
        inside.last += 1;
        let (number, (tell, wanted)) = (inside.last, oneshot::channel());
        inside.taken.push(OccupiedSlot { number, owner: of, wanted: tell });
        Slot { number, wanted, slots: self.clone() }
    }
}

impl<Of: PartialEq> Inside<Of> {
    fn evict_oldest(&mut self, of: Of) {
        if let Some(at) = self.taken.iter().position(|taken| taken.owner == of) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "fails if the connection is about to close by itself"
            )]
            let _ = self.taken.remove(at).wanted.send(());
        }
    }
}

impl<Of> Slot<Of> {
    /// Waits until another connection needs this slot.
    pub async fn wait_until_wanted(&mut self) {
        #[expect(clippy::let_underscore_must_use, reason = "a dropped sender also means that the slot is needed")]
        let _ = (&mut self.wanted).await;
    }

    /// Returns the handle that marks this slot's connection as active.
    pub fn activity_handle(&self) -> ActivityHandle<Of> {
        ActivityHandle { number: self.number, slots: self.slots.clone() }
    }
}

impl<Of> ActivityHandle<Of> {
    /// Marks the connection as active now: it becomes the last one that must give up its slot.
    pub fn mark_active(&self) {
        let mut inside = self.slots.lock();
        if let Some(at) = inside.taken.iter().position(|taken| taken.number == self.number) {
            let taken = inside.taken.remove(at);
            inside.taken.push(taken);
        }
    }
}

impl<Of> Drop for Slot<Of> {
    fn drop(&mut self) {
        self.slots.lock().taken.retain(|taken| taken.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: MaxConnections = MaxConnections { per_owner: 64, total: 256 };

    fn wait_until_wanted(slot: &mut Slot<u32>) -> bool {
        slot.wanted.try_recv().is_ok()
    }

    #[test]
    fn the_longest_waiting_connection_of_a_user_gives_up_its_slot() {
        let slots = Slots::new(LIMITS);
        let mut silent: Vec<Slot<u32>> = (0..LIMITS.per_owner).map(|_| slots.acquire(7)).collect();
        let mut other = slots.acquire(8);
        assert!(!silent.iter_mut().any(wait_until_wanted), "there is room");
        let mut stop = slots.acquire(7);
        assert!(
            wait_until_wanted(&mut silent[0])
                && !wait_until_wanted(&mut silent[1])
                && !wait_until_wanted(&mut other)
        );
        silent.remove(5);
        let mut next = slots.acquire(7);
        assert!(!silent[1..].iter_mut().any(wait_until_wanted), "one had left");
        assert!(!wait_until_wanted(&mut stop) && !wait_until_wanted(&mut next));
    }

    #[test]
    fn the_user_with_the_most_slots_gives_one_up() {
        let slots = Slots::new(LIMITS);
        let mut greedy: Vec<Slot<u32>> = (0..60).map(|_| slots.acquire(7)).collect();
        let mut others: Vec<Slot<u32>> =
            (0..LIMITS.total - 60).map(|number| slots.acquire(100 + number as u32 / 20)).collect();
        let _new = slots.acquire(5);
        assert!(wait_until_wanted(&mut greedy[0]) && !others.iter_mut().any(wait_until_wanted));
    }

    #[test]
    fn the_most_recently_active_client_gives_up_its_slot_last() {
        let slots = Slots::new(MaxConnections { per_owner: 2, total: 4 });
        let (mut first, mut second) = (slots.acquire(7), slots.acquire(7));
        first.activity_handle().mark_active();
        let mut third = slots.acquire(7);
        assert!(wait_until_wanted(&mut second) && !wait_until_wanted(&mut first) && !wait_until_wanted(&mut third));
        second.activity_handle().mark_active();
        drop(second);
        assert_eq!(slots.lock().taken.len(), 2, "one that gave way takes no slot again");
    }
}
