//! Accounts of the people who use the operator's page: names, roles, the permissions of each role, and the audit trail
//! with its rate limit. Passwords, and the pause after wrong passwords, are in `password`.
//!
//! This module contains only plain data and decisions. The store saves the accounts (`store::people`), and the page
//! applies the decisions (`daemon::web`). Stop and abort need no account: authentication must not hinder an emergency
//! action (IEC 62443-4-2, CR 1.1 with its note on essential functions).

mod password;

pub use password::{
    Lockout, MAX_ATTEMPTS, MIN_PASSWORD_CHARACTERS, PAUSE_S, PasswordError, hash_password, is_correct_password,
};

use panelprep_base::config::Choice;
use panelprep_base::number_text::check_printable;
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// The account of a person who may log in. The newest entry for an account is the valid one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Account {
    /// The name to log in with.
    pub name: String,
    /// The person's name as printed beside a signature.
    pub printed_name: String,
    /// Role of the account, which determines what the person may do.
    pub role: Role,
    /// The password's hash, a PHC string of argon2id.
    pub password_hash: String,
    /// Whether the person may log in; a disabled account is kept.
    pub is_enabled: bool,
}

impl Account {
    /// Returns a complete account after checking its names and its password. Without a new password, the previous
    /// password is kept; `salt` is used only for a new password.
    ///
    /// # Errors
    /// If a name or the password is invalid; the error states the problem.
    pub fn create_validated(
        (name, printed_name): (&str, &str),
        (role, is_enabled): (Role, bool),
        (password, salt): (Option<&str>, [u8; 16]),
        former: Option<&Account>,
    ) -> Result<Self, String> {
        checked_name(name).map_err(|error| error.to_string())?;
        check_printable(printed_name, MAX_PRINTED_CHARACTERS)
            .map_err(|problem| format!("the printed name: {problem}"))?;
        let password_hash = match (password, former) {
            (None, Some(former)) => former.password_hash.clone(),
            (password, _) => {
                hash_password(password.unwrap_or_default(), name, salt).map_err(|error| error.to_string())?
            }
        };
        let (name, printed_name) = (name.to_owned(), printed_name.to_owned());
        Ok(Account { name, printed_name, role, password_hash, is_enabled })
    }

    /// Returns the account as text for the audit trail. The text contains no password, but the beginning of its salt: a
    /// different salt shows that the password was changed.
    pub fn summary(&self) -> String {
        let Account { printed_name, role, password_hash, is_enabled, .. } = self;
        let enabled = if *is_enabled { "enabled" } else { "disabled" };
        let salt = password_hash.split('$').nth(4).and_then(|salt| salt.get(..6)).unwrap_or_default();
        format!("{printed_name}, {}, {enabled}, password {salt}…", role.keyword())
    }
}

/// The action in the audit trail when a person approves a changed recipe; the entry contains the recipe's text.
pub const RECIPE_CHANGE: &str = "change recipe";

/// An entry of the audit trail: the person, the action, the time and the client's address. Refused attempts are
/// recorded too.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuditEntry {
    /// Time of the action, ms since 1970.
    pub unix_ms: i64,
    /// The account's name; `None` for a person who was not logged in.
    pub who: Option<String>,
    /// The person's role at the time of the action.
    pub role: Option<Role>,
    /// The client that sent the request: an IP address, or `terminal`.
    pub from: String,
    /// The action that was done or attempted, such as `log in` or `change account`.
    pub what: String,
    /// The object of the action, such as the name of the changed account.
    pub subject: Option<String>,
    /// State of the object before the action.
    pub before: Option<String>,
    /// State of the object after the action.
    pub after: Option<String>,
    /// The reason why the action was refused; `None` if it was performed.
    pub refused: Option<String>,
}

impl AuditEntry {
    /// Returns an entry for a completed action without an object; the store sets the time.
    pub fn for_completed_action(who: Option<String>, role: Option<Role>, from: String, what: &str) -> Self {
        AuditEntry {
            unix_ms: 0,
            who,
            role,
            from,
            what: what.to_owned(),
            subject: None,
            before: None,
            after: None,
            refused: None,
        }
    }
}

/// Maximum length of an account name, characters.
const MAX_NAME_CHARACTERS: usize = 40;

/// Maximum length of a printed name, characters.
pub const MAX_PRINTED_CHARACTERS: usize = 80;

/// The reason why a text is not a valid account name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{}\" is not a valid account name; valid: 1 to 40 of the characters a to z, 0 to 9, dot, hyphen and \
     underscore, beginning with a letter",
    found.escape_debug()
)]
pub struct NameError {
    /// The invalid name.
    pub found: String,
}

/// Checks an account name and returns it unchanged.
///
/// # Errors
/// If the name is empty or too long, or contains invalid characters.
pub fn checked_name(name: &str) -> Result<&str, NameError> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '.' | '-' | '_');
    let begins = name.starts_with(|c: char| c.is_ascii_lowercase());
    if begins && name.len() <= MAX_NAME_CHARACTERS && name.chars().all(is_plain) {
        return Ok(name);
    }
    Err(NameError { found: name.chars().take(2 * MAX_NAME_CHARACTERS).collect() })
}

/// The role of an account, which determines its permissions.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    Serialize,
    Deserialize,
    strum::IntoStaticStr,
    strum::EnumString,
    strum::VariantArray,
    clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Role {
    /// A wall display: it only shows the pages, and its session never expires.
    Display,
    /// May read everything, but change nothing.
    Viewer,
    /// May run cycles.
    Operator,
    /// Accepts results and signs records.
    Inspector,
    /// The process engineer: runs cycles and changes recipes.
    Engineer,
    /// May manage accounts.
    Administrator,
}

/// An action that a role may permit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, strum::VariantArray)]
pub enum Permission {
    /// View states, records and trends.
    View,
    /// Start, hold, resume, clear and reset the cycle, and confirm that a new disc is mounted.
    Operate,
    /// Accept a result that needs the decision of a person.
    Accept,
    /// Acknowledge alarms.
    Acknowledge,
    /// Sign a record.
    Sign,
    /// Change and approve recipes.
    Configure,
    /// Read the audit trail.
    Audit,
    /// Add and change accounts.
    ManagePeople,
}

impl Role {
    /// Returns the roles that have this permission.
    pub fn roles_with_permission(permission: Permission) -> impl Iterator<Item = Role> {
        Role::VARIANTS.iter().copied().filter(move |role| role.has_permission(permission))
    }

    /// Returns the role's keyword, as it is stored.
    pub fn keyword(self) -> &'static str {
        self.into()
    }

    /// Returns whether this role has the permission.
    pub fn has_permission(self, permission: Permission) -> bool {
        use Permission::{Accept, Acknowledge, Audit, Configure, ManagePeople, Operate, Sign, View};
        match self {
            Role::Display | Role::Viewer => matches!(permission, View),
            // The operator runs the cell and must not accept deviations.
            Role::Operator => matches!(permission, View | Operate | Acknowledge),
            Role::Inspector => matches!(permission, View | Accept | Acknowledge | Sign | Audit),
            Role::Engineer => matches!(permission, View | Operate | Accept | Acknowledge | Configure | Audit),
            Role::Administrator => matches!(permission, View | Audit | ManagePeople),
        }
    }
}

impl Choice for Role {
    const KEYWORDS: &'static [(&'static str, Self)] = &[
        ("display", Role::Display),
        ("viewer", Role::Viewer),
        ("operator", Role::Operator),
        ("inspector", Role::Inspector),
        ("engineer", Role::Engineer),
        ("administrator", Role::Administrator),
    ];
}

const MINUTE_MS: u64 = 60_000;

/// Maximum number of entries that are written to the audit trail within one minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaxLinesPerMinute {
    /// Maximum number of entries for completed actions.
    pub done: u32,
    /// Maximum number of entries for refused actions.
    pub refused: u32,
}

/// Counts the audit entries that were written and those that were dropped in the current minute. All times are ms of a
/// monotonic clock.
#[derive(Debug, Clone, Copy)]
pub struct LineLimit {
    limits: MaxLinesPerMinute,
    since_ms: u64,
    done: u32,
    refused: u32,
    left_out: u64,
}

impl LineLimit {
    /// Starts a new minute, at `now_ms`, without entries.
    pub fn new(most: MaxLinesPerMinute, now_ms: u64) -> Self {
        LineLimit { limits: most, since_ms: now_ms, done: 0, refused: 0, left_out: 0 }
    }

    /// Returns whether the next entry may be written. An entry that may not be written is counted as dropped.
    pub fn admit_line(&mut self, is_refused: bool) -> bool {
        let (count, most) =
            if is_refused { (&mut self.refused, self.limits.refused) } else { (&mut self.done, self.limits.done) };
        let is_allowed = *count < most;
        if is_allowed {
            *count += 1;
        } else {
            self.left_out += 1;
        }
        is_allowed
    }

    /// Returns whether the current minute has ended.
    pub fn has_minute_elapsed(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.since_ms) >= MINUTE_MS
    }

    /// Returns the number of entries that were dropped in the current minute.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Returns the time until the current minute ends, ms.
    pub fn remaining_ms(&self, now_ms: u64) -> u64 {
        MINUTE_MS.saturating_sub(now_ms.saturating_sub(self.since_ms))
    }

    /// If the minute has ended: starts a new one and returns how many entries were dropped; `None` if none were
    /// dropped.
    pub fn end_elapsed_minute(&mut self, now_ms: u64) -> Option<u64> {
        if !self.has_minute_elapsed(now_ms) {
            return None;
        }
        let left_out = self.left_out;
        *self = LineLimit::new(self.limits, now_ms);
        (left_out > 0).then_some(left_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_account_name_has_only_plain_characters() {
        for name in ["a", "anna", "anna.b-2_c", &"x".repeat(40)] {
            assert_eq!(checked_name(name), Ok(name));
        }
        for name in ["", "Anna", "2anna", ".a", "a b", "änna", "a\n", "<b>", &"x".repeat(41)] {
            assert!(checked_name(name).is_err(), "{name}");
        }
    }

    /// Separation of duties: a person who manages accounts neither runs the cell nor signs; a person who signs neither
    /// runs cycles nor changes recipes.
    #[test]
    fn duties_are_separate() {
        let all =
            |permission| -> Vec<&str> { Role::roles_with_permission(permission).map(Role::keyword).collect() };
        assert_eq!(
            all(Permission::View),
            ["display", "viewer", "operator", "inspector", "engineer", "administrator"]
        );
        assert_eq!(all(Permission::Operate), ["operator", "engineer"]);
        assert_eq!(all(Permission::Accept), ["inspector", "engineer"]);
        assert_eq!(all(Permission::Acknowledge), ["operator", "inspector", "engineer"]);
        assert_eq!(all(Permission::Sign), ["inspector"]);
        assert_eq!(all(Permission::Configure), ["engineer"]);
        assert_eq!(all(Permission::Audit), ["inspector", "engineer", "administrator"]);
        assert_eq!(all(Permission::ManagePeople), ["administrator"]);
    }

    #[test]
    fn role_keywords_are_read_back() {
        for role in Role::VARIANTS {
            assert_eq!(role.keyword().parse(), Ok(*role));
            assert!(Role::KEYWORDS.contains(&(role.keyword(), *role)), "{role:?}");
        }
    }

    #[test]
    fn lines_beyond_the_limit_are_only_counted() {
        let mut limit = LineLimit::new(MaxLinesPerMinute { done: 3, refused: 2 }, 500);
        assert_eq!((0..10).filter(|_| limit.admit_line(true)).count(), 2);
        assert_eq!((0..10).filter(|_| limit.admit_line(false)).count(), 3);
        assert_eq!(limit.end_elapsed_minute(60_499), None);
        assert_eq!(limit.end_elapsed_minute(60_500), Some(15));
        assert!(limit.admit_line(true) && limit.admit_line(false));
        assert_eq!(limit.end_elapsed_minute(120_500), None, "nothing was left out");
    }
}
