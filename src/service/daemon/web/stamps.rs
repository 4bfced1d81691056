//! Checks whether a session's account is unchanged since the session began. The account may have been disabled, or
//! given another role or password: on another page, on the terminal, or while the person was logging in.

use super::visitor::Person;
use crate::daemon::people::{AccountService, account_stamp};
use std::collections::BTreeMap;
use std::sync::Arc;
use tokio::sync::Mutex;
use tokio::task::spawn_blocking;

/// Shortest time between two readings of the accounts for this check, s. If the last reading does not confirm a
/// session, the accounts are read again at once.
const MIN_READ_INTERVAL_S: f64 = 1.0;

/// The accounts as they were read last; `None` before the first reading.
#[derive(Debug, Default)]
pub(super) struct AccountStamps(Mutex<Option<KnownStamps>>);

/// The stamps of all enabled accounts.
#[derive(Debug)]
struct KnownStamps {
    read_s: f64,
    stamps: BTreeMap<String, String>,
}

impl KnownStamps {
    fn contains(&self, person: &Person) -> bool {
        self.stamps.get(&person.name) == Some(&person.stamp)
    }
}

impl AccountStamps {
    /// Returns whether this person's session is still valid. It may wait for the store's disk.
    pub async fn is_session_valid(&self, people: &Arc<AccountService>, person: &Person) -> bool {
        let mut known = self.0.lock().await;
        let read_s = people.now_s();
        if known.as_ref().is_some_and(|known| read_s - known.read_s < MIN_READ_INTERVAL_S && known.contains(person))
        {
            return true;
        }
        let shared = people.clone();
        match spawn_blocking(move || shared.read(|store| store.accounts())).await {
            Ok(Ok(accounts)) => {
                let enabled = accounts.values().filter(|account| account.is_enabled);
                let stamps = enabled.map(|account| (account.name.clone(), account_stamp(account))).collect();
                known.insert(KnownStamps { read_s, stamps }).contains(person)
            }
            // A store that cannot be read ends no session: the last known data remains valid.
            failed => {
                if let Ok(Err(error)) = failed {
                    tracing::warn!(
                        "the accounts could not be read, so changes of accounts are not effective yet: {error}"
                    );
                }
                known.as_ref().is_none_or(|known| known.contains(person))
            }
        }
    }
}
