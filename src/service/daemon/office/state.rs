//! The cell's state as reported to the office.

use crate::daemon::clock::now_unix_ms;
use crate::daemon::interface_context::InterfaceContext;
use crate::daemon::request::RequestKind;
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::CellName;
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_store::history::{Alarm, Priority};
use panelprep_store::office::{CellState, Position, ReasonText};
use std::time::{Duration, Instant};

/// Shortest time between two reports of the state.
const MIN_REPORT_INTERVAL: Duration = Duration::from_secs(2);
/// Interval at which alarms are read.
const ALARM_POLL_INTERVAL: Duration = Duration::from_secs(5);

/// Determines the state of the cell when a report is due.
pub(super) struct StateReporter {
    front: InterfaceContext,
    last_report: Option<Instant>,
    lasting_alarms: Vec<ReasonText>,
    last_alarm_check: Option<Instant>,
}

impl StateReporter {
    pub fn new(front: InterfaceContext) -> Self {
        StateReporter { front, last_report: None, lasting_alarms: Vec::new(), last_alarm_check: None }
    }

    /// Returns the state of the cell; `None` if it was reported a moment ago.
    pub async fn now(&mut self, cell: &CellName, last: &[Position]) -> Option<CellState> {
        if self.last_report.is_some_and(|reported| reported.elapsed() < MIN_REPORT_INTERVAL) {
            return None;
        }
        if self.last_alarm_check.is_none_or(|stood| stood.elapsed() >= ALARM_POLL_INTERVAL) {
            let front = self.front.clone();
            self.lasting_alarms =
                tokio::task::spawn_blocking(move || lasting_alarms(&front)).await.unwrap_or_default();
            self.last_alarm_check = Some(Instant::now());
        }
        let reply = self
            .front
            .gateway
            .request(RequestKind::State, RequestAuthor::from_source(RequestSource::Program))
            .await;
        self.last_report = Some(Instant::now());
        let mut state = CellState::new(cell);
        state.unix_ms = now_unix_ms();
        env!("CARGO_PKG_VERSION").clone_into(&mut state.version);
        (state.state, state.phase, state.panel) = (reply.state, reply.phase, reply.panel);
        (state.cycle, state.waypoint) = (reply.cycle_id, reply.waypoint.zip(reply.of).map(|(at, of)| [at, of]));
        let reason = |reason: Reason| ReasonText { code: reason.code.into_owned(), message: reason.message };
        state.reasons = reply.reasons.into_iter().map(reason).collect();
        // A reason for which a cycle waits is also an alarm, so it is left out here.
        state.standing =
            self.lasting_alarms.iter().filter(|reported| !state.reasons.contains(reported)).cloned().collect();
        state.last = last.to_vec();
        Some(state)
    }
}

/// Returns the lasting alarms that a person must know. Runs on the calling thread, which may wait for a camera or
/// the disk.
fn lasting_alarms(front: &InterfaceContext) -> Vec<ReasonText> {
    front.check_alarms();
    let lasting = front.people.read(|store| front.alarms.active_in_order(store)).unwrap_or_else(|error| {
        tracing::warn!("the alarms cannot be reported to the office: {error}");
        Vec::new()
    });
    let is_told = |alarm: &Alarm| alarm.priority > Priority::Note;
    lasting
        .into_iter()
        .filter(is_told)
        .map(|alarm| ReasonText { code: alarm.code, message: alarm.message })
        .collect()
}
