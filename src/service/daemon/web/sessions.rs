//! The users of the page: the sessions of people who logged in, and the sender of a request ([`Visitor`]: a person with
//! a role, or a visitor who is not logged in).
//!
//! Sessions are stored in memory only: a restart of the service ends all of them. A wall display ([`Role::Display`]) is
//! the exception. No person uses it, so its session has no time limit, and the service begins it again at its start
//! (`accounts::begin_displays`). It ends with a log-out, another password or a disabled account; its role can only
//! view.
//!
//! [`AccountStamps`] checks whether a session's account is unchanged since the session began. The account may have been
//! disabled, or given another role or password: on another page, on the terminal, or while the person was logging in.

use super::page_texts::{Language, Translations};
use crate::daemon::people::{AccountService, account_stamp};
use panelprep_cell::accounts::{Permission, Role};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Arc;
use tokio::sync::Mutex;
use tokio::task::spawn_blocking;

/// Maximum duration of a person's session after the log-in, s, even if the person is active. A wall display has no
/// limit.
const MAX_SESSION_S: f64 = 12.0 * 3_600.0;
/// Maximum number of sessions of all accounts.
const MAX_SESSIONS: usize = 200;

/// A session.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// The account's name.
    pub name: String,
    /// The person's printed name.
    pub printed_name: String,
    /// The role.
    pub role: Role,
    /// The stamp of the account when the person logged in (`people::account_stamp`).
    pub stamp: String,
    /// The token that each change must contain, so that no other site can cause a change.
    pub csrf: String,
    began_s: f64,
    seen_s: f64,
}

/// The person who owns a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionHolder {
    /// The account's name.
    pub name: String,
    /// The person's printed name.
    pub printed_name: String,
    /// The role.
    pub role: Role,
    /// The present stamp of the account.
    pub stamp: String,
}

/// The hash of a token. It is stored instead of the token, so that a copy of the memory does not allow a log-in, and
/// the time of a look-up reveals nothing about the token.
type TokenHash = [u8; 32];

/// All sessions. Times are in seconds of a monotonic clock.
#[derive(Debug)]
pub struct Sessions {
    open: BTreeMap<TokenHash, Session>,
    idle_s: f64,
    of_account: usize,
}

fn key(token: &str) -> TokenHash {
    Sha256::digest(token.as_bytes()).into()
}

impl Sessions {
    /// Creates an empty set of sessions. A session ends after `idle_s` seconds without a request, except that of a wall
    /// display; an account has at most `of_account` sessions.
    pub fn new(idle_s: f64, of_account: usize) -> Self {
        Sessions { open: BTreeMap::new(), idle_s, of_account }
    }

    /// Begins a session with a new token. If the account then has too many sessions, the one without a request for the
    /// longest time ends.
    pub fn begin_session(&mut self, (token, csrf): (&str, String), who: SessionHolder, now_s: f64) {
        self.forget(now_s);
        let SessionHolder { name, printed_name, role, stamp } = who;
        while self.open.values().filter(|session| session.name == name).count() >= self.of_account {
            self.end_oldest_session(|session| session.name == name);
        }
        if self.open.len() >= MAX_SESSIONS {
            self.end_oldest_session(|_| true);
        }
        let session = Session { name, printed_name, role, stamp, csrf, began_s: now_s, seen_s: now_s };
        self.open.insert(key(token), session);
    }

    fn end_oldest_session(&mut self, of: impl Fn(&Session) -> bool) {
        let oldest = self.open.iter().filter(|(_, session)| of(session));
        let oldest = oldest.min_by(|a, b| a.1.seen_s.total_cmp(&b.1.seen_s)).map(|(key, _)| *key);
        oldest.and_then(|key| self.open.remove(&key));
    }

    /// Returns the session with this token. Actions of a person extend it; automatic requests of a page do not.
    pub fn find(&mut self, token: &str, now_s: f64, is_action: bool) -> Option<Session> {
        self.forget(now_s);
        let session = self.open.get_mut(&key(token))?;
        if is_action {
            session.seen_s = now_s;
        }
        Some(session.clone())
    }

    /// Ends the session with this token.
    pub fn end(&mut self, token: &str) -> Option<Session> {
        self.open.remove(&key(token))
    }

    /// Ends every session of this account, for example because the account was changed.
    pub fn end_account_sessions(&mut self, name: &str) {
        self.open.retain(|_, session| session.name != name);
    }

    fn forget(&mut self, now_s: f64) {
        let idle_s = self.idle_s;
        let lasts = |session: &Session| now_s - session.seen_s < idle_s && now_s - session.began_s < MAX_SESSION_S;
        // No person uses a wall display; its role can only view, and its account can be disabled.
        self.open.retain(|_, session| session.role == Role::Display || lasts(session));
    }
}

/// The sender of a request.
#[derive(Debug, Clone)]
pub(super) struct Visitor {
    /// Network address of the client.
    pub from: String,
    /// The person, if one is logged in.
    pub person: Option<Person>,
    /// Whether the browser sends the cookie of a session that is no longer valid.
    pub has_ended: bool,
    /// The chosen language; the next field contains the languages that the browser prefers.
    pub chosen: Option<String>,
    pub accepted: Option<String>,
    pub words: Arc<Translations>,
}

/// A person who is logged in.
#[derive(Debug, Clone)]
pub(super) struct Person {
    pub name: String,
    pub printed_name: String,
    pub role: Role,
    /// The stamp of the account when the person logged in.
    pub stamp: String,
    pub csrf: String,
    pub token: String,
}

impl Visitor {
    /// Returns the texts in the visitor's language.
    pub fn language(&self) -> Language<'_> {
        self.words.language(self.chosen.as_deref(), self.accepted.as_deref())
    }

    /// Returns the visitor in the form in which the service records the author of a request.
    pub fn as_requester(&self) -> RequestAuthor {
        let user = self.person.as_ref().map(|person| person.name.clone());
        RequestAuthor { front: RequestSource::Page, uid: None, user, from: Some(self.from.clone()) }
    }

    /// Returns whether the visitor's role has this permission; a visitor who is not logged in has none.
    pub fn has_permission(&self, permission: Permission) -> bool {
        self.person.as_ref().is_some_and(|person| person.role.has_permission(permission))
    }
}

/// Returns the key of the word for a role.
pub(super) fn role_key(role: Role) -> &'static str {
    match role {
        Role::Display => "role.display",
        Role::Viewer => "role.viewer",
        Role::Operator => "role.operator",
        Role::Inspector => "role.inspector",
        Role::Engineer => "role.engineer",
        Role::Administrator => "role.administrator",
    }
}

/// Minimum interval between two readings of the accounts for this check, s. If the last reading does not confirm a
/// session, the accounts are read again immediately.
const MIN_READ_INTERVAL_S: f64 = 1.0;

/// The accounts as of the last reading; `None` before the first reading.
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
            // If the store cannot be read, no session ends: the last known data remain valid.
            failed => {
                if let Ok(Err(error)) = failed {
                    tracing::warn!(
                        "the accounts could not be read, so changes of accounts are not effective yet: {error}; they \
                         are read again automatically"
                    );
                }
                known.as_ref().is_none_or(|known| known.contains(person))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anna() -> SessionHolder {
        let (name, printed_name) = ("anna".to_owned(), "Anna B".to_owned());
        SessionHolder { name, printed_name, role: Role::Operator, stamp: String::new() }
    }

    #[test]
    fn a_session_ends_when_idle_and_at_the_end_of_a_shift() {
        let mut sessions = Sessions::new(60.0, 2);
        sessions.begin_session(("t", "c".to_owned()), anna(), 0.0);
        assert_eq!(sessions.find("t", 59.0, false).map(|found| found.name), Some("anna".to_owned()));
        assert_eq!(sessions.find("t", 60.0, false), None, "a page that only looks keeps nothing alive");
        sessions.begin_session(("t", "c".to_owned()), anna(), 100.0);
        let mut now_s = 100.0;
        while sessions.find("t", now_s, true).is_some() {
            now_s += 59.0;
        }
        assert!((MAX_SESSION_S..MAX_SESSION_S + 59.0).contains(&(now_s - 100.0)), "{now_s}");
        assert_eq!(sessions.find("u", 0.0, true), None);
    }

    #[test]
    fn a_display_on_the_wall_keeps_its_session_without_clicks() {
        let mut sessions = Sessions::new(60.0, 2);
        sessions.begin_session(("t", "c".to_owned()), SessionHolder { role: Role::Display, ..anna() }, 0.0);
        assert!(sessions.find("t", 30.0 * 24.0 * 3_600.0, false).is_some(), "30 days");
        sessions.end_account_sessions("anna");
        assert_eq!(sessions.find("t", 1.0, false), None);
    }

    #[test]
    fn an_account_has_a_limited_number_of_sessions() {
        let mut sessions = Sessions::new(60.0, 2);
        for (token, now_s) in [("a", 0.0), ("b", 1.0)] {
            sessions.begin_session((token, String::new()), anna(), now_s);
        }
        sessions.find("a", 2.0, true).expect("open");
        sessions.begin_session(("c", String::new()), anna(), 3.0);
        let open: Vec<bool> = ["a", "b", "c"].map(|token| sessions.find(token, 4.0, false).is_some()).into();
        assert_eq!(open, [true, false, true], "the one that was silent for longest ended");
        sessions.end_account_sessions("anna");
        assert_eq!(sessions.open.len(), 0);
    }
}
