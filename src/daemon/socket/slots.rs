//! Slots of connections whose line is not read yet.
//!
//! There are enough for people and programs that mean well. Where they run out, a new connection is never sent away: of
//! the user who holds most slots, the connection that has been silent for longest gives up its own. A client that asks
//! for a stop writes its line at once, so it is read before its turn to give way can come.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// Connections of one user, and of all, that are listened to at one time.
const MOST_OF_USER: usize = 64;
const MOST: usize = 256;

/// All slots. Clones are the same ones.
#[derive(Debug, Clone, Default)]
pub(super) struct Slots(Arc<Mutex<Inside>>);

#[derive(Debug, Default)]
struct Inside {
    last: u64,
    /// The one that waits longest first.
    taken: Vec<Taken>,
}

#[derive(Debug)]
struct Taken {
    number: u64,
    uid: Option<u32>,
    wanted: oneshot::Sender<()>,
}

/// One of the slots; free again when it is dropped.
#[derive(Debug)]
pub(super) struct Slot {
    number: u64,
    wanted: oneshot::Receiver<()>,
    slots: Slots,
}

impl Slots {
    /// A slot for a connection of this user; another one gives way where there is none.
    pub fn take(&self, uid: Option<u32>) -> Slot {
        let mut inside = self.lock();
        let of_user = |inside: &Inside, uid| inside.taken.iter().filter(|taken| taken.uid == uid).count();
        if of_user(&inside, uid) >= MOST_OF_USER {
            inside.gives_way(uid);
        } else if inside.taken.len() >= MOST {
            let greedy = inside.taken.iter().map(|taken| taken.uid).max_by_key(|uid| of_user(&inside, *uid));
            inside.gives_way(greedy.unwrap_or(uid));
        }
        inside.last += 1;
        let (number, (tell, wanted)) = (inside.last, oneshot::channel());
        inside.taken.push(Taken { number, uid, wanted: tell });
        Slot { number, wanted, slots: self.clone() }
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inside {
    fn gives_way(&mut self, uid: Option<u32>) {
        if let Some(at) = self.taken.iter().position(|taken| taken.uid == uid) {
            #[expect(clippy::let_underscore_must_use, reason = "refused where it is about to leave by itself")]
            let _ = self.taken.remove(at).wanted.send(());
        }
    }
}

impl Slot {
    /// Waits until somebody else needs the slot.
    pub async fn is_wanted(&mut self) {
        #[expect(clippy::let_underscore_must_use, reason = "a slot whose giver has gone is wanted back as well")]
        let _ = (&mut self.wanted).await;
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.slots.lock().taken.retain(|taken| taken.number != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_wanted(slot: &mut Slot) -> bool {
        slot.wanted.try_recv().is_ok()
    }

    #[test]
    fn of_one_user_the_connection_that_waits_longest_gives_way() {
        let slots = Slots::default();
        let mut silent: Vec<Slot> = (0..MOST_OF_USER).map(|_| slots.take(Some(7))).collect();
        let mut other = slots.take(Some(8));
        assert!(!silent.iter_mut().any(is_wanted), "there is room");
        let mut stop = slots.take(Some(7));
        assert!(is_wanted(&mut silent[0]) && !is_wanted(&mut silent[1]) && !is_wanted(&mut other));
        silent.remove(5);
        let mut next = slots.take(Some(7));
        assert!(!silent[1..].iter_mut().any(is_wanted), "one had left");
        assert!(!is_wanted(&mut stop) && !is_wanted(&mut next));
    }

    #[test]
    fn of_all_users_the_greediest_gives_way() {
        let slots = Slots::default();
        let mut greedy: Vec<Slot> = (0..60).map(|_| slots.take(Some(7))).collect();
        let mut others: Vec<Slot> =
            (0..MOST - 60).map(|number| slots.take(Some(100 + number as u32 / 20))).collect();
        let _new = slots.take(Some(5));
        assert!(is_wanted(&mut greedy[0]) && !others.iter_mut().any(is_wanted));
    }
}
