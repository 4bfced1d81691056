//! The table of all OPC UA nodes: the path of each node, its data type, its unit and description, and the function that
//! computes its value from the known state.

use super::snapshot::{Kind, Snapshot, UnitMode, UnitState, Value, Verified, alarm_id};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_store::history::Alarm;

/// An OPC UA node of the cell.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    /// The path of the node below the cell's object, such as `PackML/Status/StateCurrent`.
    pub path: &'static str,
    /// The data type of the values.
    pub kind: Kind,
    /// The unit of the values; empty without a unit.
    pub unit: &'static str,
    /// Description of the node.
    pub meaning: &'static str,
    /// Computes the value of the node.
    pub value: fn(&Snapshot) -> Value,
}

const fn node(
    path: &'static str,
    kind: Kind,
    unit: &'static str,
    meaning: &'static str,
    value: fn(&Snapshot) -> Value,
) -> Node {
    Node { path, kind, unit, meaning, value }
}

fn value_or_absent<T>(value: Option<T>, of: impl FnOnce(T) -> Value) -> Value {
    value.map_or(Value::Absent, of)
}

fn text(value: Option<&String>) -> Value {
    value_or_absent(value, |text| Value::String(text.clone()))
}

fn unit_state(now: &Snapshot) -> Option<UnitState> {
    now.state.map(|state| UnitState::from_state(state.at))
}

fn unit_mode(now: &Snapshot) -> Option<UnitMode> {
    now.state.as_ref().map(UnitMode::from_state)
}

fn robot(now: &Snapshot) -> Value {
    value_or_absent(now.state, |state| Value::String(state.facts.robot.keyword().to_owned()))
}

/// Returns the most important reason why the unit does not work; `None` in a state in which it works.
fn stop_reason(now: &Snapshot) -> Option<&Reason> {
    use UnitState::{Completing, Execute, Resetting, Starting, Unholding};
    let works = matches!(unit_state(now)?, Starting | Execute | Unholding | Completing | Resetting);
    now.reasons.first().filter(|_| !works)
}

fn reasons(now: &Snapshot, of: fn(&Reason) -> String) -> Value {
    Value::Strings(now.reasons.iter().map(of).collect())
}

fn alarms(now: &Snapshot, of: fn(&Alarm) -> String) -> Value {
    Value::Strings(now.alarms.iter().map(of).collect())
}

fn verification_time(verified: Option<Verified>) -> Value {
    value_or_absent(verified, |verified| Value::DateTime(verified.at_unix_s.saturating_mul(1_000)))
}

fn age_h(now: &Snapshot, verified: Option<Verified>) -> Value {
    let age_ms = |verified: Verified| now.now_unix_ms.saturating_sub(verified.at_unix_s.saturating_mul(1_000));
    value_or_absent(verified, |verified| Value::Double((age_ms(verified) / 360_000) as f64 / 10.0))
}

fn error_mm(verified: Option<Verified>) -> Value {
    value_or_absent(verified, |verified| Value::Double(verified.error_mm))
}

fn limit_mm(verified: Option<Verified>) -> Value {
    value_or_absent(verified, |verified| Value::Double(verified.limit_mm))
}

/// All nodes of the server.
pub const NODES: &[Node] = &[
    node(
        "PackML/Status/StateCurrent",
        Kind::Int32,
        "",
        "number of the unit's state: 1 Clearing, 2 Stopped, 3 Starting, 4 Idle, 6 Execute, 7 Stopping, 8 Aborting, 9 Aborted, 10 Holding, 11 Held, 12 Unholding, 15 Resetting, 16 Completing, 17 Complete",
        |now| value_or_absent(unit_state(now), |state| Value::Int32(state.number())),
    ),
    node("PackML/Status/StateCurrentName", Kind::String, "", "name of the unit's state", |now| {
        value_or_absent(unit_state(now), |state| Value::String(state.name().to_owned()))
    }),
    node(
        "PackML/Status/StateChangeInProcess",
        Kind::Boolean,
        "",
        "true in a state that ends by itself, false if the unit waits for a command",
        |now| value_or_absent(unit_state(now), |state| Value::Boolean(state.is_acting_state())),
    ),
    node(
        "PackML/Status/UnitModeCurrent",
        Kind::Int32,
        "",
        "number of the mode: 1 Production, 2 Maintenance (an air-run), 3 Manual (the robot is in T1 or T2)",
        |now| value_or_absent(unit_mode(now), |mode| Value::Int32(mode.number())),
    ),
    node("PackML/Status/UnitModeCurrentName", Kind::String, "", "name of the mode", |now| {
        value_or_absent(unit_mode(now), |mode| Value::String(mode.name().to_owned()))
    }),
    node(
        "PackML/Admin/StateCurrentTime",
        Kind::UInt32,
        "s",
        "time in the current state, since this service started to observe it",
        |now| value_or_absent(now.state, |_| Value::UInt32(now.in_state_s)),
    ),
    node(
        "PackML/Admin/ModeCurrentTime",
        Kind::UInt32,
        "s",
        "time in the current mode, since this service started to observe it",
        |now| value_or_absent(now.state, |_| Value::UInt32(now.in_mode_s)),
    ),
    node(
        "PackML/Admin/ProdProcessedCount",
        Kind::UInt32,
        "",
        "number of ended cycles in the store, without air-runs and without cycles that found no part",
        |now| Value::UInt32(now.counts.processed_count()),
    ),
    node(
        "PackML/Admin/ProdDefectiveCount",
        Kind::UInt32,
        "",
        "number of ended cycles with the verdict fail or reject, without air-runs and without cycles that found no part",
        |now| Value::UInt32(now.counts.defective_count()),
    ),
    node(
        "PackML/Admin/StopReasonCode",
        Kind::String,
        "",
        "code of the reason why the unit does not work, from the page of messages; no value while the unit works",
        |now| value_or_absent(stop_reason(now), |reason| Value::String(reason.code.to_string())),
    ),
    node(
        "PackML/Admin/StopReason",
        Kind::String,
        "",
        "text of the reason why the unit does not work, with the remedy",
        |now| value_or_absent(stop_reason(now), |reason| Value::String(reason.message.clone())),
    ),
    node(
        "Cycle/Number",
        Kind::UInt32,
        "",
        "number of the running cycle, or of the last cycle since the service started",
        |now| value_or_absent(now.cycle.and_then(|cycle| u32::try_from(cycle).ok()), Value::UInt32),
    ),
    node("Cycle/Panel", Kind::String, "", "panel of the current or last cycle", |now| text(now.panel.as_ref())),
    node(
        "Cycle/Phase",
        Kind::String,
        "",
        "phase of the cycle: locate, refine, dry, wet, inspect, plan, verify, abrade, retract, assess or rinse; \
         while held, the phase in which the cycle will continue",
        |now| text(now.phase.as_ref()),
    ),
    node(
        "Cycle/Step",
        Kind::UInt32,
        "",
        "number of the step to which these values belong; Unhold, Clear and Accept must state this number",
        |now| value_or_absent(now.state.and_then(|state| u32::try_from(state.step).ok()), Value::UInt32),
    ),
    node("Cycle/Pass", Kind::UInt32, "", "number of sanding passes in the cycle so far", |now| {
        value_or_absent(now.pass, |pass| Value::UInt32(u32::from(pass)))
    }),
    node("Cycle/FilmTime", Kind::Double, "s", "elapsed time of the current film", |now| {
        value_or_absent(now.film_s, Value::Double)
    }),
    node("Cycle/FilmTimeTotal", Kind::Double, "s", "observation time of a film", |now| {
        value_or_absent(now.film_total_s, Value::Double)
    }),
    node("Cycle/Waypoint", Kind::UInt32, "", "number of executed waypoints of the current path", |now| {
        value_or_absent(now.waypoint, Value::UInt32)
    }),
    node("Cycle/Waypoints", Kind::UInt32, "", "total number of waypoints of the current path", |now| {
        value_or_absent(now.waypoints, Value::UInt32)
    }),
    node(
        "Cycle/Verdict",
        Kind::String,
        "",
        "verdict of the cycle, if there is one: pass, fail, reject, invalid, review, accept or aborted",
        |now| value_or_absent(now.verdict, |verdict: Verdict| Value::String(verdict.keyword().to_owned())),
    ),
    node(
        "Cycle/WaitsForReview",
        Kind::Boolean,
        "",
        "true if the cycle waits for a person's decision on a result",
        |now| value_or_absent(now.state, |_| Value::Boolean(now.is_review)),
    ),
    node(
        "Cycle/ReasonCodes",
        Kind::Strings,
        "",
        "codes of the reasons for the cell's state, and of the last problems that were found",
        |now| reasons(now, |reason| reason.code.to_string()),
    ),
    node("Cycle/Reasons", Kind::Strings, "", "texts of the reasons in ReasonCodes, in the same order", |now| {
        reasons(now, |reason| reason.message.clone())
    }),
    node(
        "Cycle/PossibleCommands",
        Kind::Strings,
        "",
        "requests that the cell would accept now, with their names in `panelprep ctl`",
        |now| Value::Strings(now.possible.iter().map(|&word| word.to_owned()).collect()),
    ),
    node("Recipes/Names", Kind::Strings, "", "file names of the recipes in the folder of [page] recipes", |now| {
        Value::Strings(now.recipes.iter().map(|recipe| recipe.name.clone()).collect())
    }),
    node(
        "Recipes/Hashes",
        Kind::Strings,
        "",
        "SHA-256 of each recipe in Names, in the same order; the argument RecipeHash of Start",
        |now| Value::Strings(now.recipes.iter().map(|recipe| recipe.sha256.clone()).collect()),
    ),
    node("Part/SerialNumber", Kind::String, "", "serial number of the part", |now| text(now.part.serial.as_ref())),
    node("Part/WorkOrder", Kind::String, "", "work order of the part", |now| text(now.part.order.as_ref())),
    node("Part/Operator", Kind::String, "", "operator of the cell, as named at the start", |now| {
        text(now.part.operator.as_ref())
    }),
    node("Grids/Ids", Kind::Strings, "", "names of the panel's grids", |now| {
        Value::Strings(now.grids.iter().map(|grid| grid.id.clone()).collect())
    }),
    node(
        "Grids/States",
        Kind::Strings,
        "",
        "state of each grid, in the same order: untested, whole (the film held), broke, abraded (since its last \
         film)",
        |now| Value::Strings(now.grids.iter().map(|grid| grid.state.to_owned()).collect()),
    ),
    node(
        "Calibrations/MayStart",
        Kind::Boolean,
        "",
        "true if a cycle may start with the present calibrations",
        |now| value_or_absent(now.may_start, Value::Boolean),
    ),
    node(
        "Calibrations/Reasons",
        Kind::Strings,
        "",
        "reasons why a cycle may not start, or why a calibration is doubtful",
        |now| Value::Strings(now.calibration_reasons.clone()),
    ),
    node("Calibrations/Files", Kind::Strings, "", "each calibration with its file and its age", |now| {
        Value::Strings(now.calibrations.clone())
    }),
    node(
        "Calibrations/Scanner/VerifiedAt",
        Kind::DateTime,
        "",
        "time of the last verification of the 3D camera",
        |now| verification_time(now.scanner),
    ),
    node(
        "Calibrations/Scanner/Age",
        Kind::Double,
        "h",
        "time since the last verification of the 3D camera",
        |now| age_h(now, now.scanner),
    ),
    node(
        "Calibrations/Scanner/Error",
        Kind::Double,
        "mm",
        "error found in the last verification of the 3D camera",
        |now| error_mm(now.scanner),
    ),
    node(
        "Calibrations/Scanner/Limit",
        Kind::Double,
        "mm",
        "limit of the last verification of the 3D camera",
        |now| limit_mm(now.scanner),
    ),
    node(
        "Calibrations/FlangeCamera/VerifiedAt",
        Kind::DateTime,
        "",
        "time of the last verification of the camera on the flange",
        |now| verification_time(now.flange_camera),
    ),
    node(
        "Calibrations/FlangeCamera/Age",
        Kind::Double,
        "h",
        "time since the last verification of the camera on the flange",
        |now| age_h(now, now.flange_camera),
    ),
    node(
        "Calibrations/FlangeCamera/Error",
        Kind::Double,
        "mm",
        "error found in the last verification of the camera on the flange",
        |now| error_mm(now.flange_camera),
    ),
    node(
        "Calibrations/FlangeCamera/Limit",
        Kind::Double,
        "mm",
        "limit of the last verification of the camera on the flange",
        |now| limit_mm(now.flange_camera),
    ),
    node(
        "Calibrations/Tool/VerifiedAt",
        Kind::DateTime,
        "",
        "time of the last verification of the tool by touch",
        |now| verification_time(now.tool),
    ),
    node(
        "Calibrations/Tool/Age",
        Kind::Double,
        "h",
        "time since the last verification of the tool by touch",
        |now| age_h(now, now.tool),
    ),
    node(
        "Calibrations/Tool/Error",
        Kind::Double,
        "mm",
        "error found in the last verification of the tool by touch",
        |now| error_mm(now.tool),
    ),
    node(
        "Calibrations/Tool/Limit",
        Kind::Double,
        "mm",
        "limit of the last verification of the tool by touch",
        |now| limit_mm(now.tool),
    ),
    node(
        "Alarms/Ids",
        Kind::Strings,
        "",
        "IDs of the active alarms, the most urgent first; AcknowledgeAlarm requires such an ID",
        |now| alarms(now, alarm_id),
    ),
    node("Alarms/Codes", Kind::Strings, "", "codes of the active alarms, in the same order as Ids", |now| {
        alarms(now, |alarm| alarm.code.clone())
    }),
    node(
        "Alarms/Priorities",
        Kind::Strings,
        "",
        "priorities of the active alarms: high, medium, low or note",
        |now| alarms(now, |alarm| alarm.priority.keyword().to_owned()),
    ),
    node("Alarms/Messages", Kind::Strings, "", "texts of the active alarms", |now| {
        alarms(now, |alarm| alarm.message.clone())
    }),
    node("Alarms/Remedies", Kind::Strings, "", "remedies for the active alarms", |now| {
        alarms(now, |alarm| alarm.remedy.clone())
    }),
    node("Alarms/RaisedAt", Kind::DateTimes, "", "times at which the active alarms were raised", |now| {
        Value::DateTimes(now.alarms.iter().map(|alarm| alarm.raised_unix_ms).collect())
    }),
    node(
        "Alarms/AcknowledgedBy",
        Kind::Strings,
        "",
        "person who acknowledged each active alarm; empty if it is not acknowledged",
        |now| alarms(now, |alarm| alarm.acknowledged.as_ref().map_or(String::new(), |seen| seen.who.clone())),
    ),
    node("Counters/Passed", Kind::UInt32, "", "number of cycles that ended with pass", |now| {
        Value::UInt32(now.counts.passed)
    }),
    node("Counters/Failed", Kind::UInt32, "", "number of cycles that ended with fail", |now| {
        Value::UInt32(now.counts.failed)
    }),
    node("Counters/Rejected", Kind::UInt32, "", "number of cycles that ended with reject", |now| {
        Value::UInt32(now.counts.rejected)
    }),
    node("Counters/Invalid", Kind::UInt32, "", "number of cycles that ended with invalid", |now| {
        Value::UInt32(now.counts.invalid)
    }),
    node("Counters/Aborted", Kind::UInt32, "", "number of cycles that ended by a stop or an abort", |now| {
        Value::UInt32(now.counts.aborted)
    }),
    node("Counters/Other", Kind::UInt32, "", "number of cycles that ended with another verdict", |now| {
        Value::UInt32(now.counts.other)
    }),
    node(
        "Robot/Condition",
        Kind::String,
        "",
        "condition of the robot: unknown, ready, link_lost, restarted, emergency_stop, guard_open, drives_off or \
         not_automatic",
        robot,
    ),
    node("Robot/Epoch", Kind::UInt32, "", "last epoch that was opened on the robot link", |now| {
        value_or_absent(now.state, |state| Value::UInt32(state.epoch))
    }),
    node("Service/Version", Kind::String, "", "version of the program", |_| {
        Value::String(env!("CARGO_PKG_VERSION").to_owned())
    }),
    node(
        "Service/Answers",
        Kind::Boolean,
        "",
        "false if the service's loop does not respond: all other values are then the last ones that it reported",
        |now| Value::Boolean(now.answers),
    ),
    node(
        "Service/LastRefusal/Method",
        Kind::String,
        "",
        "name of the last method that was called and refused",
        |now| value_or_absent(now.refusal.as_ref(), |refusal| Value::String(refusal.method.to_owned())),
    ),
    node("Service/LastRefusal/User", Kind::String, "", "user who called the last refused method", |now| {
        value_or_absent(now.refusal.as_ref(), |refusal| Value::String(refusal.user.clone()))
    }),
    node("Service/LastRefusal/Time", Kind::DateTime, "", "time of the last refusal", |now| {
        value_or_absent(now.refusal.as_ref(), |refusal| Value::DateTime(refusal.at_unix_ms))
    }),
    node("Service/LastRefusal/Code", Kind::String, "", "code of the reason for the last refusal", |now| {
        value_or_absent(now.refusal.as_ref(), |refusal| Value::String(refusal.reason.code.to_string()))
    }),
    node(
        "Service/LastRefusal/Message",
        Kind::String,
        "",
        "text of the reason for the last refusal, and what is possible instead",
        |now| value_or_absent(now.refusal.as_ref(), |refusal| Value::String(refusal.reason.message.clone())),
    ),
];
