//! Live data for people: the state of the cell as a page shows it, and the newest picture, which is drawn, reduced and
//! encoded once for all viewers.

use crate::daemon::live_view::{LiveFrame, LiveScene, LiveView};
use crate::daemon::request::{PageData, Reply};
use crate::report::canvas::resize_to_width;
use crate::setup::clock::now_unix_ms;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::files;
use serde::Serialize;
use std::sync::{Arc, Mutex, PoisonError};

/// The state of the cell as a page shows it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(super) struct LiveState {
    /// Time at which the loop last answered, on the service's clock, ms since 1970.
    pub answered_ms: u64,
    /// Whether the loop answers now.
    pub answers: bool,
    pub state: Option<String>,
    pub phase: Option<String>,
    /// The number of the shown step of the state table; a person's decision contains this number.
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
    /// The requests that the cycle's state table would accept now.
    pub possible: Vec<&'static str>,
    pub is_review: bool,
    pub grids: Vec<String>,
    /// The number of the newest picture; the next field is its name.
    pub frame: u64,
    pub frame_name: Option<String>,
}

impl LiveState {
    /// Returns the state from this reply, with number and name of the newest picture. A cell that was reset shows no
    /// cycle until the next one begins, because the data of the last cycle belong to another part.
    pub fn from_reply(reply: Reply, (frame, frame_name): (u64, Option<String>)) -> Self {
        let is_reset = matches!(reply.state.as_deref(), Some("resetting" | "idle"));
        let (reply, (frame, frame_name)) = match is_reset {
            true => (without_cycle(reply), (0, None)),
            false => (reply, (frame, frame_name)),
        };
        LiveState {
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

    /// Returns the state for a visitor without a session: without the names of people.
    pub fn without_names(&self) -> Self {
        let reasons = self.reasons.iter().filter(|reason| reason.code != "held_by").cloned().collect();
        LiveState { reasons, ..self.clone() }
    }

    /// Returns whether nothing has changed except the time.
    pub fn is_unchanged(&self, other: &LiveState) -> bool {
        LiveState { answered_ms: 0, ..self.clone() } == LiveState { answered_ms: 0, ..other.clone() }
    }
}

fn without_cycle(reply: Reply) -> Reply {
    let extras = PageData { grids: Arc::default(), film_total_s: None, ..reply.extras };
    Reply { panel: None, pass: None, cycle_id: None, verdict: None, extras, ..reply }
}

/// Maximum width of a picture that is sent, px.
const MAX_WIDTH_PX: usize = 960;

/// Encodes the newest picture as a JPEG.
pub(super) struct FrameEncoder {
    view: LiveView,
    last: Mutex<Option<(u64, Arc<Vec<u8>>)>>,
}

impl FrameEncoder {
    pub fn new(view: LiveView) -> Self {
        FrameEncoder { view, last: Mutex::new(None) }
    }

    /// Returns the scene of the newest cycle.
    pub fn scene(&self) -> LiveScene {
        self.view.scene().clone()
    }

    /// Returns the number and the name of the newest picture; 0 if there is none.
    pub fn newest_frame(&self) -> (u64, Option<String>) {
        match self.view.newest_picture() {
            (number, Some(frame)) => (number, Some(frame.name.clone())),
            (_, None) => (0, None),
        }
    }

    /// Returns the newest picture as a JPEG; `None` if there is none. Encoding takes some 10 ms, once for each picture.
    pub fn newest_jpeg(&self) -> Option<Arc<Vec<u8>>> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let (number, frame) = self.view.newest_picture();
        let frame = frame?;
        if let Some((kept, jpeg)) = last.as_ref()
            && *kept == number
        {
            return Some(jpeg.clone());
        }
        let jpeg = Arc::new(encoded(&frame)?);
        *last = Some((number, jpeg.clone()));
        Some(jpeg)
    }
}

fn encoded(frame: &LiveFrame) -> Option<Vec<u8>> {
    let drawn = frame.draw().and_then(|picture| match picture.width > MAX_WIDTH_PX {
        true => resize_to_width(&picture, MAX_WIDTH_PX),
        false => Ok(picture),
    });
    let jpeg = drawn.map_err(|error| error.to_string());
    match jpeg.and_then(|picture| files::write_color_jpeg(&picture).map_err(|error| error.to_string())) {
        Ok(jpeg) => Some(jpeg),
        Err(error) => {
            tracing::warn!("the picture {} cannot be shown: {error}", frame.name);
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::request::RequestResult;
    use panelprep_cell::panel::GridId;

    /// After a reset, no data of the last part are shown as present data.
    #[test]
    fn a_cell_that_was_reset_shows_nothing_of_the_last_part() {
        let grid: GridId = "r1c1".parse().expect("a grid");
        let reply = |state: &str| Reply {
            state: Some(state.to_owned()),
            panel: Some("wing".to_owned()),
            pass: Some(1),
            cycle_id: Some(7),
            verdict: Some(Verdict::Pass),
            extras: PageData { grids: Arc::from([grid]), ..PageData::default() },
            ..Reply::refused(RequestResult::Done, vec![])
        };
        let picture = || (9, Some("film".to_owned()));
        let complete = LiveState::from_reply(reply("complete"), picture());
        assert_eq!((complete.cycle, complete.frame, complete.grids.len()), (Some(7), 9, 1));
        for state in ["resetting", "idle"] {
            let live = LiveState::from_reply(reply(state), picture());
            let expected = LiveState {
                state: Some(state.to_owned()),
                answers: true,
                answered_ms: live.answered_ms,
                ..LiveState::default()
            };
            assert_eq!(live, expected);
        }
    }
    #[test]
    fn a_visitor_without_a_session_sees_no_names() {
        let reasons = vec![Reason::new("asked", "held"), Reason::new("held_by", "anna: a hair")];
        let live = LiveState { reasons, ..LiveState::default() }.without_names();
        assert_eq!(live.reasons, [Reason::new("asked", "held")]);
    }
}
