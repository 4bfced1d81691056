//! The one request: what every front hands to the service, and what the loop takes up.
//!
//! A front (the socket today) says what is requested and by whom; [`super::Gateway`] prepares a start, queues the request and
//! waits for the reply. Signals and scripted runs hand over the same type. What the table of the cycle decides about is a
//! [`cycle::Request`] inside of it.

use super::lending::ShotRequest;
use super::replay::RecordingPlan;
use super::reply::Reply;
use super::setup::CycleSetup;
use super::words;
use crate::cycle;
pub use crate::record::PartNames;
use crate::record::{Front, Who};
use crate::store::CycleStart;
use crate::verdict::Reason;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use tokio::sync::oneshot;

/// One request, on its way from a front to the loop.
#[derive(Debug)]
pub struct Request {
    /// What is requested.
    pub what: What,
    /// Who requests it, and through which front.
    pub who: Who,
    /// Where the reply goes; `None` where nobody waits for one.
    pub reply: Option<oneshot::Sender<Reply>>,
}

impl Request {
    /// A request whose reply nobody waits for.
    pub fn new(what: What, who: Who) -> Self {
        Request { what, who, reply: None }
    }

    /// SIGTERM or SIGINT. The first one stops the cell, the second one aborts; the service ends once the cell is at rest.
    pub fn signal() -> Self {
        Request::new(What::Leave, Who::by(Front::Signal))
    }
}

/// What is requested.
pub enum What {
    /// The present state. It is answered at once.
    State,
    /// A cycle, as a front names it. The loop sees it as `Begin` or `Unprepared`.
    Start(StartRequest),
    /// A cycle whose files were read.
    Begin(Box<PreparedCycle>),
    /// A cycle that was refused when its files were read. The loop only records it.
    Unprepared {
        /// The recipe's file as the front named it.
        recipe: String,
        /// Why the cycle cannot begin.
        reasons: Vec<Reason>,
    },
    /// To record that a new disc was mounted. Possible where the cell rests.
    NewDisc,
    /// What the table of the cycle decides about.
    Table(cycle::Request),
    /// The same, by a person who decided upon what this step of the table showed ([`cycle::State::step`]).
    Decided {
        /// What is requested: accept, unhold or clear.
        request: cycle::Request,
        /// The step.
        step: u64,
    },
    /// What was decided upon another step than the present one. The loop only records it.
    Outdated {
        /// What was requested.
        request: cycle::Request,
        /// What changed since.
        reasons: Vec<Reason>,
    },
    /// Pictures of the cell's cameras, while the cell rests without a cycle.
    Shoot(ShotRequest),
    /// To end the program, where the cell rests.
    Leave,
}

impl std::fmt::Debug for What {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.words())
    }
}

impl What {
    /// What is requested, as it stands in the log.
    pub(super) fn words(&self) -> String {
        match self {
            What::State => "state".to_owned(),
            What::Table(request) | What::Decided { request, .. } | What::Outdated { request, .. } => {
                words::command(*request).to_owned()
            }
            What::NewDisc => "new-disc".to_owned(),
            What::Begin(prepared) => format!("start of panel {}", prepared.setup.panel_name()),
            What::Start(StartRequest { recipe, .. }) | What::Unprepared { recipe, .. } => {
                format!("start by {recipe}")
            }
            What::Shoot(shot) => shot.word().to_owned(),
            What::Leave => "leave".to_owned(),
        }
    }

    /// What it asks of the table, if it asks anything of it.
    pub(super) fn of_table(&self) -> Option<cycle::Request> {
        match self {
            What::Table(request) => Some(*request),
            What::Begin(prepared) => Some(prepared.request),
            _ => None,
        }
    }

    /// Whether it must reach the loop before everything else, however much waits.
    pub(super) fn is_urgent(&self) -> bool {
        matches!(self, What::Leave | What::Table(cycle::Request::Stop | cycle::Request::Abort))
    }
}

/// A cycle that is requested. The recipe comes as text, so that a front needs no file that the service can read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartRequest {
    /// The recipe's name in messages.
    pub recipe: String,
    /// Its text.
    pub text: String,
    /// Where the cycle is recorded, where it is.
    #[serde(default)]
    pub record: Option<RecordIn>,
    /// The part in the cell, with its work order and operator.
    #[serde(default)]
    pub part: Option<PartNames>,
    /// A person says that another part than in the cycles before lies in the fixture: abrasions count from zero.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub another_part: bool,
    /// Whether the text may be another than the recipes' folder has. The front decides it by the person's role; no line of a
    /// client can say so.
    #[serde(skip)]
    pub own_text: OwnText,
}

/// Whether a start may bring a text that is none of the recipes' folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OwnText {
    /// Only a recipe of the folder, by name and content.
    #[default]
    Refused,
    /// Any text; the record says that it is none of the folder's.
    Allowed,
}

/// Where a cycle is recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordIn {
    /// In the store, under the cycle's number.
    Store,
    /// In this new file, given by its absolute path.
    File(PathBuf),
}

/// A cycle whose files were read and checked; the loop can begin it.
#[derive(Debug)]
pub struct PreparedCycle {
    /// How the table is asked to begin.
    pub request: cycle::Request,
    /// Recipe, taught panel and calibrations.
    pub setup: CycleSetup,
    /// What the cycle's record begins with.
    pub start: CycleStart,
    /// How it is recorded, where it is.
    pub recording: Option<RecordingPlan>,
    /// What the record says of the start, though it is taken.
    pub remarks: Vec<Reason>,
}
