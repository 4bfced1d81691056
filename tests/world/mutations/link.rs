//! Mutations of the client's side of the connection to the robot.

use super::{Mutation, change};

const ECHO_SOURCE_PATH: &str = "src/kuka/eki/session/echo.rs";
const EPOCHS_SOURCE_PATH: &str = "src/kuka/eki/session/epochs.rs";
const FLOW_SOURCE_PATH: &str = "src/kuka/eki/session/flow.rs";
const LIMITS_SOURCE_PATH: &str = "src/devices/robot/link.rs";
const RECEIVE_SOURCE_PATH: &str = "src/kuka/eki/session/receive.rs";
const TIMING_SOURCE_PATH: &str = "src/kuka/eki/session/epochs.rs";

pub(super) const ALL: [Mutation; 15] = [
    change(
        "an abort is not sent where no number of an epoch is left, and any number is believed",
        EPOCHS_SOURCE_PATH,
        "let next = Epoch(self.highest_known_epoch().0.saturating_add(1).min(LAST_NUMBER));",
        "let next = Epoch(self.highest_known_epoch().0.saturating_add(1));\n        if next.0 > LAST_NUMBER {\n            return;\n        }",
    )
    .and(
        RECEIVE_SOURCE_PATH,
        "let follows = found.0 <= known.0.saturating_add(MAX_EPOCH_STEP) && !goes_back;",
        "let follows = found.0 <= LAST_NUMBER && !(goes_back && found.0 > LAST_NUMBER) && MAX_EPOCH_STEP > 0;",
    ),
    change(
        "any jump of the controller's epoch is believed",
        RECEIVE_SOURCE_PATH,
        "found.0 <= known.0.saturating_add(MAX_EPOCH_STEP) && !goes_back;",
        "!goes_back;",
    ),
    change(
        "an ended epoch may be opened again",
        EPOCHS_SOURCE_PATH,
        "let highest = self.highest_known_epoch().max(self.opened_epoch).max(above);",
        "let highest = self.highest_known_epoch().max(above.min(Epoch(0)));",
    ),
    change(
        "a silent connection is never given up",
        TIMING_SOURCE_PATH,
        "const SILENCE_TIMEOUT: Duration = Duration::from_secs(1);",
        "const SILENCE_TIMEOUT: Duration = Duration::from_secs(18_000);",
    ),
    change(
        "silence of the states does not end the epoch",
        TIMING_SOURCE_PATH,
        "let both = [self.has_open_work().then_some(state), unreceived];",
        "let both = [(self.has_open_work() && self.stale == u64::MAX).then_some(state), unreceived];",
    ),
    change(
        "silence while tool or water is on does not end the epoch",
        EPOCHS_SOURCE_PATH,
        "if flow.is_busy() || self.harmful_on)",
        "if flow.is_busy())",
    ),
    change(
        "the window is not kept by time",
        FLOW_SOURCE_PATH,
        "few || self.motion + motion <= limits.window",
        "few || motion <= limits.window",
    ),
    change(
        "waypoints are sent that are not permitted",
        FLOW_SOURCE_PATH,
        "if self.permitted.is_some_and(|last| next.id > last) {",
        "if self.permitted.is_some_and(|last| next.id > CommandId(last.0 + 1_000)) {",
    ),
    change(
        "lines are sent before base and tool were seen at the controller",
        FLOW_SOURCE_PATH,
        "if !(self.base.is_confirmed(part.base) && self.tool.is_confirmed(part.tool)) {\n            return false;\n        }",
        "",
    )
    .not_found("the loop hands over no line before a state has shown both, and the link has looked at that state first"),
    change(
        "a base that differs from the one that was set is taken",
        ECHO_SOURCE_PATH,
        "if distance_mm <= ECHO_TOLERANCE && turn_deg <= ECHO_TOLERANCE {\n            self.confirmed = id;",
        "if distance_mm <= 1e6 && turn_deg <= 360.0 {\n            self.confirmed = id;",
    ),
    change(
        "an abort that the controller did not obey is taken for obeyed",
        RECEIVE_SOURCE_PATH,
        "if stopping.ended == Some(state.epoch) && !state.stopped {",
        "if stopping.ended == Some(state.epoch) && !state.stopped && stopping.obeyed {",
    ),
    change(
        "a stop of the controller is not noticed while nothing is queued",
        RECEIVE_SOURCE_PATH,
        "let ends = state.stopped || matches!",
        "let ends = matches!",
    ),
    change(
        "a connection that swallows commands is kept for ever",
        TIMING_SOURCE_PATH,
        "const MAX_UNACKNOWLEDGED_EPOCHS: u32 = 2;",
        "const MAX_UNACKNOWLEDGED_EPOCHS: u32 = 1_000_000;",
    ),
    change(
        "heartbeats come each second",
        LIMITS_SOURCE_PATH,
        "heartbeat: ms(limits.heartbeat_ms()),",
        "heartbeat: 10 * ms(limits.heartbeat_ms()),",
    ),
    change(
        "an acknowledgement frees places of commands that were not executed",
        FLOW_SOURCE_PATH,
        "let done = self.last_executed();\n        while let Some(queued) = self.in_flight",
        "let last_executed = self.received;\n        while let Some(queued) = self.in_flight",
    ),
];
