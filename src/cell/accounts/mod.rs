//! People at the operator's page: their roles, the permissions of each role, their passwords, and the pause after
//! wrong ones.
//!
//! Plain data and decisions. The store keeps accounts (`store::people`), the page uses the decisions
//! (`daemon::web`). Stop and abort need no account: authentication must not hinder an emergency action (IEC
//! 62443-4-2, CR 1.1 with its note on essential functions).

mod line_limit;
mod lockout;
mod name;
mod password;
mod role;

pub use line_limit::{LineLimit, MaxLinesPerMinute};
pub use lockout::{Lockout, MAX_ATTEMPTS, PAUSE_S};
pub use name::{MAX_PRINTED, NameError, checked_name};
pub use password::{MIN_CHARACTERS, PasswordError, hash_password, is_correct_password};
pub use role::{Permission, Role};

use panelprep_base::number_text::printable;
use serde::{Deserialize, Serialize};

/// A person who may log in. The newest statement about an account is the valid one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Account {
    /// The name to log in with.
    pub name: String,
    /// The person's printed name, as a signature shows it.
    pub printed_name: String,
    /// Role of the account, which determines what the person may do.
    pub role: Role,
    /// The password's hash, a PHC string of argon2id.
    pub password_hash: String,
    /// Whether the person may log in at all.
    pub is_enabled: bool,
}

impl Account {
    /// Returns a complete account with valid names and an allowed password. Without a new password the former
    /// account's password stays; `salt` is used only for a new password.
    ///
    /// # Errors
    /// If a name or the password is not allowed; the text states the problem.
    pub fn create_validated(
        (name, printed_name): (&str, &str),
        (role, is_enabled): (Role, bool),
        (password, salt): (Option<&str>, [u8; 16]),
        former: Option<&Account>,
    ) -> Result<Self, String> {
        checked_name(name).map_err(|error| error.to_string())?;
        printable(printed_name, MAX_PRINTED).map_err(|problem| format!("the printed name: {problem}"))?;
        let password_hash = match (password, former) {
            (None, Some(former)) => former.password_hash.clone(),
            (password, _) => {
                hash_password(password.unwrap_or_default(), name, salt).map_err(|error| error.to_string())?
            }
        };
        let (name, printed_name) = (name.to_owned(), printed_name.to_owned());
        Ok(Account { name, printed_name, role, password_hash, is_enabled })
    }

    /// Returns the account as a line of the audit trail. The password is not shown; the beginning of its salt shows
    /// that it is a new one.
    pub fn summary(&self) -> String {
        let Account { printed_name, role, password_hash, is_enabled, .. } = self;
        let enabled = if *is_enabled { "enabled" } else { "disabled" };
        let salt = password_hash.split('$').nth(4).and_then(|salt| salt.get(..6)).unwrap_or_default();
        format!("{printed_name}, {}, {enabled}, password {salt}…", role.keyword())
    }
}

/// The name of a recipe's change in the audit trail: a person approved the text after it.
pub const RECIPE_CHANGE: &str = "change recipe";

/// A line of the audit trail: who did what, when and from which address. Refused attempts are recorded too.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AuditEntry {
    /// Time of the action, ms since 1970.
    pub unix_ms: i64,
    /// The account's name; `None` for a person who was not logged in.
    pub who: Option<String>,
    /// The person's role at that time.
    pub role: Option<Role>,
    /// The origin of the request: an IP address, or `terminal`.
    pub from: String,
    /// The action that was done or attempted, such as `log in` or `change account`.
    pub what: String,
    /// The object of the action.
    pub subject: Option<String>,
    /// The value before.
    pub before: Option<String>,
    /// The value after.
    pub after: Option<String>,
    /// The reason why it was refused; `None` if it was done.
    pub refused: Option<String>,
}

impl AuditEntry {
    /// Returns a line about a completed action, without an object; the store sets its time.
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
