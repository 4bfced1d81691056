//! The reply to a request.

use super::replay::RecordingResult;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::State;
use panelprep_cell::panel::GridId;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RequestResult {
    /// The state table accepted the request.
    Done,
    /// The request is refused: it is not possible now, or not in this form.
    Refused,
    /// The condition of the cell does not allow the request.
    Fault,
}

impl RequestResult {
    /// The exit code of `panelprep ctl`.
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
    /// Result of the request.
    pub answer: RequestResult,
    /// The PackML word; `None` if the loop was not asked.
    pub state: Option<String>,
    /// The phase inside Execute; if the cycle is held, the phase in which it continues.
    pub phase: Option<String>,
    /// The panel of the current cycle, or of the last one.
    pub panel: Option<String>,
    /// The cycle's number of abrasions so far.
    pub pass: Option<u8>,
    /// Seconds of the film in progress.
    pub film_s: Option<f64>,
    /// Number of executed waypoints of the path in progress.
    pub waypoint: Option<u32>,
    /// Total number of waypoints.
    pub of: Option<u32>,
    /// The page of the last cycle, once it is written.
    pub page: Option<PathBuf>,
    /// Position of the arm's axes, degrees, while the arm is at rest and the link to it works.
    #[serde(default)]
    pub axes_deg: Option<[f64; 6]>,
    /// The last epoch of the robot.
    pub epoch: Option<u32>,
    /// The step of the cycle's state table that this reply shows; the requests accept, unhold and clear must state it.
    #[serde(default)]
    pub step: Option<u64>,
    /// The cycle that runs, or the last one since the service started.
    pub cycle_id: Option<i64>,
    /// The verdict of the cycle, once it exists.
    pub verdict: Option<Verdict>,
    /// The recording of the cycle, if there is one.
    pub recording: Option<RecordingResult>,
    /// The action that was done, if the state does not show it.
    pub done: Option<String>,
    /// The reason why the request was refused, or why the cell is in this state.
    pub reasons: Vec<Reason>,
    /// Data for the operator's page and the plant, which are not sent through a socket.
    #[serde(skip)]
    pub extras: PageData,
}

/// The data that only the operator's page and the plant show.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PageData {
    /// The state of the cycle's state table.
    pub table: Option<State>,
    /// Words of the requests that the table would accept now.
    pub possible: Vec<&'static str>,
    /// The panel's grids; none before the first cycle.
    pub grids: Arc<[GridId]>,
    /// Planned duration of the film, s.
    pub film_total_s: Option<f64>,
    /// Whether the cycle waits for a person's decision on a result.
    pub is_review: bool,
}

impl Reply {
    /// Returns the sentences of all reasons as one text.
    pub(super) fn joined_reasons(&self) -> String {
        let sentences: Vec<&str> = self.reasons.iter().map(|reason| reason.message.as_str()).collect();
        sentences.join("; ")
    }

    /// Returns whether the loop may not have received the request, so that the interface records it. A service that
    /// ended may have recorded it as well: two lines are better than none.
    pub(super) fn may_be_unrecorded(&self) -> bool {
        let codes = ["busy", "ended", "bad_request"];
        self.state.is_none() && self.reasons.first().is_some_and(|reason| codes.contains(&&*reason.code))
    }

    /// Creates an answer that does not come from the loop.
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
