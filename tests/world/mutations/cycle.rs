//! Mutations of the cycle's state machine.

use super::{Mutation, change};

const EXECUTE_SOURCE_PATH: &str = "src/cell/cycle/execute.rs";
const FACTS_SOURCE_PATH: &str = "src/cell/cycle/facts.rs";
const INTERLOCKS_SOURCE_PATH: &str = "src/cell/cycle/interlocks.rs";
const REST_SOURCE_PATH: &str = "src/cell/cycle/step.rs";
const STEP_SOURCE_PATH: &str = "src/cell/cycle/step.rs";
const TURN_SOURCE_PATH: &str = "src/cell/cycle/turn.rs";

pub(super) const ALL: [Mutation; 18] = [
    change(
        "an epoch that the link ends while the cell is reset or cleared is taken for open",
        STEP_SOURCE_PATH,
        "self.state.facts.end_epoch(Epoch::Changing);",
        "if !matches!(self.state.at, At::Resetting | At::Clearing { .. }) { self.state.facts.end_epoch(Epoch::Changing); }",
    ),
    change(
        "a start with tool or water that may run is Stopped",
        REST_SOURCE_PATH,
        "(None, _) if before.facts.tool_may_run || before.facts.water_may_run => {",
        "(None, _) if before.facts.tool_may_run && before.facts.water_may_run => {",
    ),
    change(
        "a start with an open motion is Stopped",
        REST_SOURCE_PATH,
        "(Some(_), _) => At::Aborted { cause: Cause::Interrupted },",
        "(Some(_), _) => At::Stopped,",
    ),
    change(
        "a start forgets an abort that no person cleared",
        REST_SOURCE_PATH,
        "(_, At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause }) => At::Aborted { cause },",
        "(_, At::Aborting { cause, .. }) => At::Aborted { cause },",
    ),
    change(
        "the tool is switched on without extraction",
        INTERLOCKS_SOURCE_PATH,
        "vec![N::FullOverride, N::Epoch, N::Drained, N::ExtractionFlowing, at_approach]",
        "vec![N::FullOverride, N::Epoch, N::Drained, at_approach]",
    )
    .and(
        INTERLOCKS_SOURCE_PATH,
        "[N::FullOverride, N::Epoch, N::Drained, N::ExtractionFlowing, N::Token];",
        "[N::FullOverride, N::Epoch, N::Drained, N::Token];",
    ),
    change(
        "water runs while the lens is open",
        INTERLOCKS_SOURCE_PATH,
        "N::ToolOff, N::LensGuarded]",
        "N::ToolOff]",
    ),
    change(
        "a 3D shot does not ask for a parked arm",
        INTERLOCKS_SOURCE_PATH,
        "vec![N::WaterOff, parked, N::LightOff, N::LensClear],",
        "vec![N::WaterOff, N::LightOff, N::LensClear],",
    ),
    change(
        "a 3D shot does not ask for the light to be off",
        INTERLOCKS_SOURCE_PATH,
        "Action::Locate => vec![N::WaterOff, parked, N::LightOff, N::LensClear],",
        "Action::Locate => vec![N::WaterOff, parked, N::LensClear],",
    ),
    change(
        "what is known of the cell outlives a robot that is not ready",
        STEP_SOURCE_PATH,
        "self.state.facts.forget();",
        "self.state.facts.standing = false;",
    ),
    change(
        "a robot that is not ready does not end what is going on",
        STEP_SOURCE_PATH,
        "_ => self.abort(Cause::Robot(robot)),",
        "_ => {}",
    ),
    change(
        "an abort does not conclude the cycle",
        STEP_SOURCE_PATH,
        "pub fn aborted(&mut self, cause: Cause) {\n        self.conclude(Verdict::Aborted);",
        "pub fn aborted(&mut self, cause: Cause) {",
    ),
    change(
        "a localization outlives a hold",
        EXECUTE_SOURCE_PATH,
        "self.state.job.verified = 0;\n        self.facts().token = None;",
        "self.state.job.verified = 0;",
    ),
    change(
        "water that was switched on is not remembered as what may run",
        FACTS_SOURCE_PATH,
        "(self.water, self.water_may_run) = (Water::Unknown, true),",
        "self.water = Water::Unknown,",
    ),
    change(
        "a cycle makes one pass more than it may",
        EXECUTE_SOURCE_PATH,
        "self.state.job.pass < self.state.job.max_passes;",
        "self.state.job.pass <= self.state.job.max_passes;",
    ),
    change(
        "the arm does not retract behind a contact path",
        EXECUTE_SOURCE_PATH,
        "Path::Contact | Path::Air) => self.state.at = At::Execute(Phase::Retract),",
        "Path::Contact | Path::Air) => self.state.at = At::Execute(Phase::Rinse),",
    ),
    change(
        "what a contact path did is not graded",
        EXECUTE_SOURCE_PATH,
        "self.state.at = At::Execute(Phase::Assess { left: false });",
        "self.state.at = At::Execute(Phase::Rinse);",
    ),
    change(
        "a motion begins before it is on the record",
        TURN_SOURCE_PATH,
        "self.effects.push(Effect::OpenIntent(motion));",
        "",
    ),
    change(
        "a stop leaves the cycle without its end",
        STEP_SOURCE_PATH,
        "self.conclude(if review { Verdict::Review } else { Verdict::Aborted });",
        "if review {\n            self.conclude(Verdict::Review);\n        }",
    ),
];
