//! Requests in a cycle's record: what was requested, by whom, and the result.

use crate::cycle::Request;
use panelprep_base::verdict::Reason;
use serde::{Deserialize, Serialize};

/// One request in a cycle's record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestRecord {
    /// Time of the request, ms since 1970.
    pub unix_ms: i64,
    /// The requested action.
    pub wanted: RequestedAction,
    /// The sender; `None` if it was not recorded.
    pub who: Option<RequestAuthor>,
    /// The result; `None` if it was not recorded: the program ended before, or an earlier version wrote the record.
    pub answer: Option<Answer>,
    /// The reason why the request was not carried out; if it was carried out, remarks.
    pub reasons: Vec<Reason>,
    /// Number of findings of the cycle that were stored at the time of the request: the basis of the decision. `None`
    /// if it was not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub findings: Option<u64>,
}

/// Actions that can be requested.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RequestedAction {
    /// A request on which the cycle's state table decides.
    For(Request),
    /// A request to record that a new disc was mounted.
    NewDisc,
    /// A cycle with this recipe, which was refused before the state table decided.
    Start {
        /// The recipe's file as named in the request.
        recipe: String,
    },
    /// A person went through a stage of the controller's proofs, or signed its page.
    Proofs {
        /// The letter of the stage.
        stage: String,
        /// The checksum that the controller's programs reported.
        programs_sum: i32,
        /// SHA-256 of the page.
        page_sha256: String,
        /// The person at the controller, or the one who signed.
        by: String,
        /// What the page shows.
        result: ProofsResult,
    },
}

/// What a page of the controller's proofs shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProofsResult {
    /// A row was found wrong on a real controller: pages of this stage that were signed before do not count any more.
    Wrong,
    /// Each row was proven; the page can be signed.
    Proven,
    /// A person signed the page.
    Signed,
}

/// The sender of a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestAuthor {
    /// Interface through which the request came.
    pub front: RequestSource,
    /// The number of the operating system's user; `None` if it is not known.
    pub uid: Option<u32>,
    /// The user's name; `None` if the system has no name for the number.
    pub user: Option<String>,
    /// The address of the sender's computer; `None` if there is none or it is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

/// The path by which a request arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RequestSource {
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
    /// A production line, by digital signals at the robot's controller.
    Line,
    /// SIGTERM or SIGINT.
    Signal,
    /// The program itself, such as a reset with a failed self-test.
    Program,
}

/// The result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The request was accepted, and carried out as far as possible at once.
    Done,
    /// It was refused: no part was done.
    Refused,
    /// The cell could not carry out the request.
    Failed,
}

impl RequestAuthor {
    /// Returns a sender of which only this source is known.
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
                return f.write_str("a host application by MQTT Sparkplug; which one is not known");
            }
            RequestSource::Line => return f.write_str("the line, by its digital signals"),
            RequestSource::Signal => return f.write_str("a signal to the program; who sent it is not known"),
            RequestSource::Program => return f.write_str("the program itself"),
        };
        match (&self.user, self.uid) {
            (Some(user), Some(uid)) => write!(f, "{user} (user {uid}), {by}"),
            (None, Some(uid)) => write!(f, "user {uid}, who has no name on this computer, {by}"),
            (_, None) => write!(f, "an unknown user, {by}"),
        }
    }
}
