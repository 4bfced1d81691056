//! The state of the cell, as a page shows it.

use crate::daemon::clock::now_unix_ms;
use crate::daemon::reply::Reply;
use crate::verdict::{Reason, Verdict};
use serde::Serialize;

/// The state of the cell.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(super) struct Live {
    /// The service's clock when the loop answered last, ms since 1970.
    pub answered_ms: u64,
    /// Whether the loop answers now.
    pub answers: bool,
    pub state: Option<String>,
    pub phase: Option<String>,
    /// The step of the cycle's table that is shown; a person's decision names this step.
    pub step: Option<u64>,
    pub panel: Option<String>,
    pub pass: Option<u8>,
    pub film_s: Option<f64>,
    pub film_total_s: Option<f64>,
    pub waypoint: Option<u32>,
    pub of: Option<u32>,
    pub cycle: Option<i64>,
    pub verdict: Option<Verdict>,
    pub reasons: Vec<Reason>,
    /// The requests that the table would accept now.
    pub possible: Vec<&'static str>,
    pub is_review: bool,
    pub grids: Vec<String>,
    /// The number of the newest picture; the picture's name follows.
    pub frame: u64,
    pub frame_name: Option<String>,
}

impl Live {
    pub fn from_reply(reply: Reply, (frame, frame_name): (u64, Option<String>)) -> Self {
        Live {
            answered_ms: now_unix_ms().unsigned_abs(),
            answers: reply.state.is_some(),
            state: reply.state,
            phase: reply.phase,
            step: reply.step,
            panel: reply.panel,
            pass: reply.pass,
            film_s: reply.film_s,
            film_total_s: reply.extras.film_total_s,
            waypoint: reply.waypoint,
            of: reply.of,
            cycle: reply.cycle_id,
            verdict: reply.verdict,
            reasons: reply.reasons,
            possible: reply.extras.possible,
            is_review: reply.extras.is_review,
            grids: reply.extras.grids.iter().map(ToString::to_string).collect(),
            frame,
            frame_name,
        }
    }

    /// Returns whether nothing changed except the time.
    pub fn says_the_same(&self, other: &Live) -> bool {
        Live { answered_ms: 0, ..self.clone() } == Live { answered_ms: 0, ..other.clone() }
    }
}
