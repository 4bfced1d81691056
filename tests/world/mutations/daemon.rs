//! Mutations of the service's loop.

use super::{Mutation, change};

const ACTS_SOURCE_PATH: &str = "src/service/daemon/actions.rs";
const CONTACTS_SOURCE_PATH: &str = "src/service/daemon/contacts.rs";
const HANDLER_SOURCE_PATH: &str = "src/service/daemon/request_handler.rs";
const JUDGEMENT_SOURCE_PATH: &str = "src/base/verdict.rs";
const MOVES_SOURCE_PATH: &str = "src/service/daemon/moves.rs";
const REPORTS_SOURCE_PATH: &str = "src/service/daemon/robot_reports.rs";
const RUN_SOURCE_PATH: &str = "src/service/daemon/run.rs";
const SENT_SOURCE_PATH: &str = "src/service/daemon/running.rs";

pub(super) const ALL: [Mutation; 16] = [
    change(
        "a contact path is not counted as wear before it begins",
        CONTACTS_SOURCE_PATH,
        "self.ports.record.perform_and_forget(RecordCommand::WearDisc(wears_mm2))?;",
        "",
    ),
    change(
        "a contact path is counted as wear twice",
        CONTACTS_SOURCE_PATH,
        "RecordCommand::WearDisc(worn_mm2 - reserved_mm2)",
        "RecordCommand::WearDisc(worn_mm2 + 0.0 * reserved_mm2)",
    ),
    change(
        "the end of a path is not waited for until the arm stands",
        ACTS_SOURCE_PATH,
        "Condition::PathEnd if is_still => self.end_path(id, act, state)?,",
        "Condition::PathEnd => self.end_path(id, act, state)?,",
    )
    .not_found(
        "the controller counts a path's last point where the arm stands; that it moves can only be older news",
    ),
    change(
        "a switch is taken for done before output and feedback say so",
        ACTS_SOURCE_PATH,
        "Condition::Feedback { last, proof } if state.done >= last && proof.is_satisfied(state) => {",
        "Condition::Feedback { last, proof } if state.done >= last && (proof.is_satisfied(state) || state.done >= last) => {",
    ),
    change("what was proven is not watched in contact", REPORTS_SOURCE_PATH, "self.watch_outputs(state)?;", ""),
    change(
        "an event is done before it is on the journal",
        RUN_SOURCE_PATH,
        "self.ports.record.perform_and_forget(RecordCommand::Event(event))?;",
        "",
    )
    .and(
        RUN_SOURCE_PATH,
        "self.record_request(event, refused)?;",
        "self.ports.record.perform_and_forget(RecordCommand::Event(event))?;\n        self.record_request(event, refused)?;",
    ),
    change(
        "an answer that does not come is waited for 5 hours",
        RUN_SOURCE_PATH,
        "const FEEDBACK_S: f64 = 5.0;",
        "const FEEDBACK_S: f64 = 18_000.0;",
    ),
    change("a lost link is not told to the table", REPORTS_SOURCE_PATH, "self.on_robot_condition(cycle::Robot::LinkLost);", ""),
    change(
        "a controller that has started anew is taken for the same",
        REPORTS_SOURCE_PATH,
        "self.on_robot_condition(cycle::Robot::Restarted);",
        "",
    ),
    change(
        "the end of an epoch forgets which waypoints were executed",
        MOVES_SOURCE_PATH,
        "self.executed_at_stop = sent.waypoints(done).max(sent.reported);",
        "self.executed_at_stop = sent.waypoints(done).min(0);",
    ),
    change(
        "a reason to reject is one to review",
        JUDGEMENT_SOURCE_PATH,
        "(false, _) => Verdict::Reject,",
        "(false, _) => Verdict::Review,",
    ),
    change(
        "the program leaves while the cell works",
        RUN_SOURCE_PATH,
        "RequestOutcome::Leave if self.state.at.is_at_rest() => return Ok(None),",
        "RequestOutcome::Leave if self.state.at.is_at_rest() || self.state.due.is_some() => return Ok(None),",
    ),
    change(
        "a full disk does not hold the cell",
        RUN_SOURCE_PATH,
        "if let Some(why) = self.ports.record.disk_full_reason() {",
        "if let Some(why) = self.ports.record.disk_full_reason().filter(|_| self.is_single) {",
    ),
    change(
        "one waypoint more is taken for executed than was",
        SENT_SOURCE_PATH,
        "(done.0 + 1).saturating_sub(self.first.0)",
        "(done.0 + 2).saturating_sub(self.first.0)",
    ),
    change(
        "the axes move from a place that is not known",
        MOVES_SOURCE_PATH,
        "let obstacles = cycle.map(|cycle| self.obstacles_at_rest(&cycle));",
        "let obstacles = None;",
    ),
    change(
        "a decision upon an earlier step is taken",
        HANDLER_SOURCE_PATH,
        "if step == state.step {",
        "if step <= state.step {",
    ),
];
