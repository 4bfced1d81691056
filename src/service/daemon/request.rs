//! The request type of all interfaces, and the reply to it. Interfaces submit requests to the service; the loop
//! processes them.
//!
//! An interface states what is requested and by whom; [`super::Gateway`] prepares a start, queues the request and waits
//! for the reply. Signals and scripted runs submit the same type. A request on which the cycle's state table decides
//! contains a [`cycle::Request`].

use super::camera_lease::ShotRequest;
use super::operator_texts;
use crate::setup::{PreparedCycle, RecordingResult, StartRequest};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle;
use panelprep_cell::cycle::State;
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{RequestAuthor, RequestSource, RequestedAction};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::oneshot;

/// A request of an interface to the loop.
#[derive(Debug)]
pub struct Request {
    /// The requested action.
    pub what: RequestKind,
    /// The person or program that sends the request, and its interface.
    pub requester: RequestAuthor,
    /// The channel for the reply; `None` if no client waits for the reply.
    pub reply: Option<oneshot::Sender<Reply>>,
}

impl Request {
    /// Creates a request without a client that waits for the reply.
    pub fn new(what: RequestKind, who: RequestAuthor) -> Self {
        Request { what, requester: who, reply: None }
    }

    /// Creates the request for a SIGTERM or SIGINT. The first signal stops the cycle, the second one aborts it; the
    /// service ends when the cell is idle.
    pub fn signal() -> Self {
        Request::new(RequestKind::Leave, RequestAuthor::from_source(RequestSource::Signal))
    }
}

/// Kinds of requests.
pub enum RequestKind {
    /// Requests a report of the present state. It is answered immediately.
    State,
    /// Requests the start of a cycle, in the form in which an interface submits it. The loop receives it as `Begin` or
    /// `Refused`.
    Start(StartRequest),
    /// Begins a cycle whose files have been read.
    Begin(Box<PreparedCycle>),
    /// A request that was refused before it reached the loop: a start with invalid files, or a request that the user's
    /// role does not permit. The loop only records it.
    Refused {
        /// The requested action.
        wanted: RequestedAction,
        /// The reasons why the request is refused.
        reasons: Vec<Reason>,
    },
    /// Records that a new disc was mounted. Permitted while the cell is idle.
    NewDisc,
    /// A request on which the cycle's state table decides.
    Table(cycle::Request),
    /// A person's decision for the state table, which is valid only if the table is still at this step
    /// ([`cycle::State::step`]).
    Decided {
        /// The request: accept, unhold or clear.
        request: cycle::Request,
        /// The number of the step to which the decision refers.
        step: u64,
    },
    /// A request to hold the cycle, with the reason that a person gave.
    Hold {
        /// The reason, as the person wrote it.
        why: String,
    },
    /// A decision that refers to an earlier step. The loop only records it.
    Outdated {
        /// The request.
        request: cycle::Request,
        /// The reasons of the refusal, with the changes since that step.
        reasons: Vec<Reason>,
    },
    /// Requests pictures from the cell's cameras, while no cycle is running.
    Shoot(ShotRequest),
    /// Ends the program if the cell is idle.
    Leave,
}

impl std::fmt::Debug for RequestKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.describe())
    }
}

impl RequestKind {
    /// Describes the request for the log.
    pub(super) fn describe(&self) -> String {
        match self {
            RequestKind::State => "state".to_owned(),
            RequestKind::Table(request)
            | RequestKind::Decided { request, .. }
            | RequestKind::Outdated { request, .. } => operator_texts::command(*request).to_owned(),
            RequestKind::Hold { why } => format!("{}: {why}", operator_texts::command(cycle::Request::Hold)),
            RequestKind::NewDisc => "new-disc".to_owned(),
            RequestKind::Begin(prepared) => format!("start of panel {}", prepared.setup.panel_name()),
            RequestKind::Start(StartRequest { recipe, .. })
            | RequestKind::Refused { wanted: RequestedAction::Start { recipe }, .. } => {
                format!("start by {recipe}")
            }
            RequestKind::Refused { wanted: RequestedAction::NewDisc, .. } => "new-disc".to_owned(),
            // No interface sends this request: `robot prove` stores it directly.
            RequestKind::Refused { wanted: RequestedAction::Proofs { stage, .. }, .. } => {
                format!("acceptance tests of stage {stage}")
            }
            RequestKind::Refused { wanted: RequestedAction::For(request), .. } => {
                operator_texts::command(*request).to_owned()
            }
            RequestKind::Shoot(shot) => shot.describe().to_owned(),
            RequestKind::Leave => "leave".to_owned(),
        }
    }

    /// Returns this request in the form of the record, for an interface that refuses it; `None` if the request changes
    /// nothing in the cell.
    pub(super) fn wanted(&self) -> Option<RequestedAction> {
        match self {
            RequestKind::Table(request) | RequestKind::Decided { request, .. } => {
                Some(RequestedAction::For(*request))
            }
            RequestKind::Hold { .. } => Some(RequestedAction::For(cycle::Request::Hold)),
            RequestKind::NewDisc => Some(RequestedAction::NewDisc),
            RequestKind::Start(StartRequest { recipe, .. }) => {
                Some(RequestedAction::Start { recipe: recipe.clone() })
            }
            _ => None,
        }
    }

    /// Returns the request for the state table that this request contains, if there is one.
    pub(super) fn table_request(&self) -> Option<cycle::Request> {
        match self {
            RequestKind::Table(request) => Some(*request),
            RequestKind::Hold { .. } => Some(cycle::Request::Hold),
            RequestKind::Begin(prepared) => Some(prepared.request),
            _ => None,
        }
    }

    /// Returns whether the request must reach the loop before all other waiting requests.
    pub(super) fn is_urgent(&self) -> bool {
        matches!(self, RequestKind::Leave | RequestKind::Table(cycle::Request::Stop | cycle::Request::Abort))
    }
}

/// Result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RequestResult {
    /// The state table accepted the request.
    Done,
    /// The request is refused: it is not possible now, or not in this form.
    Refused,
    /// The request failed because of the condition of the cell.
    Fault,
}

impl RequestResult {
    /// Returns the exit code of `panelprep ctl`.
    pub fn code(self) -> u8 {
        match self {
            RequestResult::Done => 0,
            RequestResult::Refused => 2,
            RequestResult::Fault => 3,
        }
    }
}

/// The reply to a request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reply {
    /// The result of the request.
    pub answer: RequestResult,
    /// The state in PackML's terms; `None` if the loop was not asked.
    pub state: Option<String>,
    /// The phase inside Execute; if the cycle is held, the phase in which it continues.
    pub phase: Option<String>,
    /// The panel of the current cycle, or of the last one.
    pub panel: Option<String>,
    /// Number of the cycle's sanding passes so far.
    pub pass: Option<u8>,
    /// Present duration of the film in progress, s.
    pub film_s: Option<f64>,
    /// Number of executed waypoints of the path in progress.
    pub waypoint: Option<u32>,
    /// Total number of waypoints of this path.
    pub of: Option<u32>,
    /// The page of the last cycle; `None` until it is written.
    pub page: Option<PathBuf>,
    /// Position of the arm's axes, degrees, while the arm is at rest and the link to it works.
    pub axes_deg: Option<[f64; 6]>,
    /// The last epoch of the robot.
    pub epoch: Option<u32>,
    /// The step of the cycle's state table in this reply; the requests accept, unhold and clear must state it.
    pub step: Option<u64>,
    /// The running cycle, or the last one since the service started.
    pub cycle_id: Option<i64>,
    /// The verdict of the cycle; `None` until it exists.
    pub verdict: Option<Verdict>,
    /// The recording of the cycle, if there is one.
    pub recording: Option<RecordingResult>,
    /// Description of what was done, if the state does not show it.
    pub done: Option<String>,
    /// The reasons why the request was refused, or why the cell is in this state.
    pub reasons: Vec<Reason>,
    /// Data for the operator's page and the plant, which are not sent over the socket.
    #[serde(skip)]
    pub extras: PageData,
}

/// The data that only the operator's page and the plant show.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PageData {
    /// The state of the cycle's state table.
    pub table: Option<State>,
    /// The words of the requests that the state table would accept now.
    pub possible: Vec<&'static str>,
    /// The panel's grids; empty before the first cycle.
    pub grids: Arc<[GridId]>,
    /// Planned duration of the film, s.
    pub film_total_s: Option<f64>,
    /// Whether the cycle waits for a person's decision on a result.
    pub is_review: bool,
}

impl Reply {
    /// Returns the messages of all reasons as one text.
    pub(super) fn joined_reasons(&self) -> String {
        let sentences: Vec<&str> = self.reasons.iter().map(|reason| reason.message.as_str()).collect();
        sentences.join("; ")
    }

    /// Returns whether the loop may not have received the request, so that the interface must record it. A service that
    /// has ended may have recorded it as well; two entries in the record are better than none.
    pub(super) fn may_be_unrecorded(&self) -> bool {
        let codes = ["busy", "ended", "bad_request"];
        self.state.is_none() && self.reasons.first().is_some_and(|reason| codes.contains(&&*reason.code))
    }

    /// Creates a refusal that does not come from the loop.
    pub fn refused(answer: RequestResult, reasons: Vec<Reason>) -> Self {
        Reply {
            answer,
            state: None,
            phase: None,
            panel: None,
            pass: None,
            film_s: None,
            waypoint: None,
            of: None,
            page: None,
            axes_deg: None,
            epoch: None,
            step: None,
            cycle_id: None,
            verdict: None,
            recording: None,
            done: None,
            reasons,
            extras: PageData::default(),
        }
    }
}
