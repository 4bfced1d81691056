//! The requests in a cycle's record: the requested action, its sender, and the result.

use crate::cycle::Request;
use panelprep_base::verdict::Reason;
use serde::{Deserialize, Serialize};

/// A request in a cycle's record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestRecord {
    /// Time of the request, ms since 1970.
    pub unix_ms: i64,
    /// The action that was requested.
    pub wanted: RequestedAction,
    /// The sender; `None` if the sender was not recorded.
    pub who: Option<RequestAuthor>,
    /// The result; `None` if it was not recorded, because the program ended before.
    pub answer: Option<Answer>,
    /// The reasons why the request was not performed; for a performed request, remarks.
    pub reasons: Vec<Reason>,
    /// Number of findings of the cycle at the time of the request, which were the basis of the decision. `None` if it
    /// was not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub findings: Option<u64>,
}

/// The actions that can be requested.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RequestedAction {
    /// A request that the cycle's state table decides.
    For(Request),
    /// A request to record that a new disc was mounted.
    NewDisc,
    /// A start of a cycle that was refused before the state table received it.
    Start {
        /// The recipe's file, as named in the request.
        recipe: String,
    },
    /// The acceptance tests of the controller: a person has performed a stage, or has signed its page.
    Proofs {
        /// The letter of the stage.
        stage: String,
        /// The checksum that the controller reported for its programs.
        programs_sum: i32,
        /// SHA-256 of the page.
        page_sha256: String,
        /// The person who performed the tests, or who signed the page.
        by: String,
        /// The result that the page shows.
        result: ProofsResult,
    },
}

/// The result of a stage of the controller's acceptance tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProofsResult {
    /// A test failed on a real controller; pages of this stage that were signed before are no longer valid.
    Wrong,
    /// All tests passed; the page can be signed.
    Proven,
    /// A person signed the page.
    Signed,
}

/// The sender of a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestAuthor {
    /// The interface through which the request was sent.
    pub front: RequestSource,
    /// The user id in the operating system; `None` if it is unknown.
    pub uid: Option<u32>,
    /// The user's name; `None` if the operating system has no name for this id.
    pub user: Option<String>,
    /// The address of the sender's computer; `None` if it is unknown, or there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// The interface through which a request was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RequestSource {
    /// The service's socket, used by `panelprep ctl`.
    Socket,
    /// The operator's page in a browser.
    Page,
    /// A method of the OPC UA server.
    OpcUa,
    /// The command that runs a single cycle.
    Command,
    /// A host application, through MQTT Sparkplug.
    Sparkplug,
    /// A production line, through digital signals of the robot controller.
    Line,
    /// A signal to the process: SIGTERM or SIGINT.
    Signal,
    /// The program itself, for example the result of a reset whose self-test failed.
    Program,
}

/// The result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The request was accepted, and performed as far as this is possible immediately.
    Done,
    /// The request was refused without any action.
    Refused,
    /// The cell could not perform the request.
    Failed,
}

impl RequestAuthor {
    /// Returns a sender of which only the interface is known.
    pub fn from_source(front: RequestSource) -> Self {
        RequestAuthor { front, uid: None, user: None, from: None }
    }
}

impl std::fmt::Display for RequestAuthor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let by = match self.front {
            RequestSource::Socket => "through the service's socket",
            RequestSource::Page => {
                match &self.user {
                    Some(user) => write!(f, "{user}, on the operator's page")?,
                    None => f.write_str("a person who was not logged in, on the operator's page")?,
                }
                return self.from.iter().try_for_each(|from| write!(f, " at {from}"));
            }
            RequestSource::OpcUa => {
                return match &self.user {
                    Some(user) => write!(f, "{user}, through OPC UA"),
                    None => f.write_str("a client that was not logged in, through OPC UA"),
                };
            }
            RequestSource::Command => "who ran the command",
            RequestSource::Sparkplug => {
                return f.write_str("an unknown host application, through MQTT Sparkplug");
            }
            RequestSource::Line => return f.write_str("the line, by its digital signals"),
            RequestSource::Signal => return f.write_str("a signal to the program; the sender is unknown"),
            RequestSource::Program => return f.write_str("the program itself"),
        };
        match (&self.user, self.uid) {
            (Some(user), Some(uid)) => write!(f, "{user} (user {uid}), {by}"),
            (None, Some(uid)) => write!(f, "user id {uid} (without a name on this computer), {by}"),
            (_, None) => write!(f, "an unknown user, {by}"),
        }
    }
}
