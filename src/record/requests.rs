//! What was asked of the cell: what, by whom, when, and what came of it.

use crate::cycle::Request;
use crate::verdict::Reason;
use serde::{Deserialize, Serialize};

/// One request, as the record keeps it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestRecord {
    /// When, ms since 1970.
    pub unix_ms: i64,
    /// What was wanted.
    pub wanted: Wanted,
    /// Who asked; `None` where that was not recorded.
    pub who: Option<Who>,
    /// What came of it; `None` where that was not recorded: the program ended before, or it was an earlier one.
    pub answer: Option<Answer>,
    /// Why it was not done; of what was done, what is to be said of it.
    pub reasons: Vec<Reason>,
    /// So many findings of the cycle were kept when it was asked: what it was decided upon. `None` where that was not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub findings: Option<u64>,
}

/// What was wanted.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wanted {
    /// What the table of the cycle decides about.
    For(Request),
    /// To keep that a new disc was mounted.
    NewDisc,
    /// A cycle by this recipe, which was refused before the table was asked.
    Start {
        /// The recipe's file as it was named.
        recipe: String,
    },
}

/// Who asked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Who {
    /// By which way.
    pub front: Front,
    /// The number of the user of the operating system; `None` where it is not known.
    pub uid: Option<u32>,
    /// The user's name; `None` where the system has none for the number.
    pub user: Option<String>,
}

/// The way by which something was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Front {
    /// The service's socket, as `panelprep ctl` uses it.
    Socket,
    /// The operator's page.
    Page,
    /// A method of the OPC UA server.
    OpcUa,
    /// The command that runs one cycle.
    Command,
    /// A host application, by MQTT Sparkplug.
    Sparkplug,
    /// A line, by digital signals at the robot's controller.
    Line,
    /// SIGTERM or SIGINT.
    Signal,
    /// The program by itself, such as a reset whose self-test failed.
    Program,
}

/// What came of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// It was taken, and done as far as it could be at once.
    Done,
    /// It was refused: nothing of it was done.
    Refused,
    /// The cell could not do it.
    Failed,
}

impl Who {
    /// Somebody who came by this way and of whom nothing else is known.
    pub fn by(front: Front) -> Self {
        Who { front, uid: None, user: None }
    }
}

impl std::fmt::Display for Who {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let by = match self.front {
            Front::Socket => "through the service's socket",
            Front::Page => {
                return match &self.user {
                    Some(user) => write!(f, "{user}, on the operator's page"),
                    None => f.write_str("somebody who was not logged in, on the operator's page"),
                };
            }
            Front::OpcUa => {
                return match &self.user {
                    Some(user) => write!(f, "{user}, through OPC UA"),
                    None => f.write_str("somebody who was not logged in, through OPC UA"),
                };
            }
            Front::Command => "who ran the command",
            Front::Sparkplug => return f.write_str("a host application by MQTT Sparkplug; which one is not known"),
            Front::Line => return f.write_str("the line, by its digital signals"),
            Front::Signal => return f.write_str("a signal to the program; who sent it is not known"),
            Front::Program => return f.write_str("the program itself"),
        };
        match (&self.user, self.uid) {
            (Some(user), Some(uid)) => write!(f, "{user} (user {uid}), {by}"),
            (None, Some(uid)) => write!(f, "user {uid}, who has no name on this computer, {by}"),
            (_, None) => write!(f, "a user who is not known, {by}"),
        }
    }
}
