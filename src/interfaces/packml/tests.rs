//! Tests that compare all states, nodes and methods with tables.

use super::*;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::accounts::{Permission, Role};
use panelprep_cell::cycle::{At, Cause, Hold, Id, Phase, Robot, State, Why};
use std::collections::BTreeSet;
use strum::VariantArray;

const HOLD: Hold = Hold { why: Why::Asked, resume: Phase::Abrade };

/// All states of the cycle: number and name in ISA-TR88.00.02, and whether the state ends by itself.
const STATES: [(At, i32, &str, bool); 14] = [
    (At::Clearing { cause: Cause::Asked }, 1, "Clearing", true),
    (At::Stopped, 2, "Stopped", false),
    (At::Starting, 3, "Starting", true),
    (At::Idle, 4, "Idle", false),
    (At::Execute(Phase::Abrade), 6, "Execute", true),
    (At::Stopping { until: Id(1) }, 7, "Stopping", true),
    (At::Aborting { cause: Cause::Asked }, 8, "Aborting", true),
    (At::Aborted { cause: Cause::Asked }, 9, "Aborted", false),
    (At::Holding(HOLD), 10, "Holding", true),
    (At::Held(HOLD), 11, "Held", false),
    (At::Unholding { resume: Phase::Abrade, verify: true }, 12, "Unholding", true),
    (At::Resetting, 15, "Resetting", true),
    (At::Completing { verdict: Verdict::Pass }, 16, "Completing", true),
    (At::Complete { verdict: Verdict::Pass }, 17, "Complete", false),
];

fn at(at: At) -> Snapshot {
    Snapshot { answers: true, state: Some(State { at, ..State::INITIAL }), ..Snapshot::default() }
}

fn value(path: &str, now: &Snapshot) -> Value {
    let node = NODES.iter().find(|node| node.path == path).expect("such a node");
    (node.value)(now)
}

#[test]
fn each_state_has_its_number_in_the_standard() {
    for (state, number, name, is_acting) in STATES {
        let unit = UnitState::from_state(state);
        assert_eq!((unit.number(), unit.name(), unit.is_acting_state()), (number, name, is_acting), "{state:?}");
        assert_eq!(name.to_lowercase(), state.keyword(), "the name is the cycle's own");
        assert_eq!(unit.is_acting_state(), !state.is_at_rest(), "{state:?}");
        assert_eq!(value("PackML/Status/StateCurrent", &at(state)), Value::Int32(number));
        assert_eq!(value("PackML/Status/StateCurrentName", &at(state)), Value::String(name.to_owned()));
    }
    let seen: BTreeSet<i32> = STATES.iter().map(|state| state.1).collect();
    assert_eq!(seen.len(), UnitState::VARIANTS.len(), "the table has every state once");
}

#[test]
fn the_mode_follows_the_robot_switch_and_the_purpose_of_the_cycle() {
    let mode = |robot, running, air| {
        let mut state = State::INITIAL;
        (state.facts.robot, state.job.running, state.job.air) = (robot, running, air);
        UnitMode::from_state(&state)
    };
    for (robot, running, air, expected) in [
        (Robot::Ready, false, false, (1, "Production")),
        (Robot::Ready, true, false, (1, "Production")),
        (Robot::LinkLost, true, true, (2, "Maintenance")),
        (Robot::Ready, false, true, (1, "Production")),
        (Robot::NotAutomatic, true, true, (3, "Manual")),
    ] {
        let found = mode(robot, running, air);
        assert_eq!((found.number(), found.name()), expected, "{robot:?} {running} {air}");
    }
}

/// Each value has the data type of its node, on which clients rely.
#[test]
fn each_value_has_the_type_of_its_node_in_every_state() {
    let full = full();
    for (state, ..) in STATES {
        let full = Snapshot { state: at(state).state, ..full.clone() };
        for node in NODES {
            let found = (node.value)(&full);
            let may_be_absent = node.path.starts_with("PackML/Admin/StopReason");
            assert!(
                found.kind() == Some(node.kind) || may_be_absent && found == Value::Absent,
                "{}: {found:?}",
                node.path
            );
        }
    }
    for node in NODES {
        let found = (node.value)(&Snapshot::default());
        assert!(found.kind().is_none_or(|kind| kind == node.kind), "{}: {found:?}", node.path);
    }
}

fn full() -> Snapshot {
    let verified = Some(Verified { at_unix_s: 1_000, error_mm: 0.1, limit_mm: 0.3 });
    Snapshot {
        answers: true,
        phase: Some("abrade".to_owned()),
        cycle: Some(7),
        panel: Some("door".to_owned()),
        pass: Some(1),
        film_s: Some(1.5),
        film_total_s: Some(60.0),
        waypoint: Some(3),
        waypoints: Some(9),
        verdict: Some(Verdict::Pass),
        reasons: vec![Reason::new("asked", "a person asked")],
        part: panelprep_cell::record::PartNames {
            serial: Some("SN 7".to_owned()),
            order: Some("WO 1".to_owned()),
            operator: Some("Ada".to_owned()),
        },
        grids: vec![GridState { id: "r1c1".to_owned(), state: "whole" }],
        scanner: verified,
        flange_camera: verified,
        tool: verified,
        may_start: Some(true),
        refusal: Some(LastRefusal {
            method: "Hold",
            user: "ada".to_owned(),
            at_unix_ms: 5,
            reason: Reason::new("not_now", "hold is not possible"),
        }),
        // 1.5 hours after the verification.
        now_unix_ms: 1_000_000 + 5_400_000,
        ..Snapshot::default()
    }
}

#[test]
fn values_are_computed_from_the_snapshot() {
    let full = Snapshot { state: at(At::Held(HOLD)).state, ..full() };
    assert_eq!(value("Calibrations/Scanner/Age", &full), Value::Double(1.5));
    assert_eq!(value("Calibrations/Tool/VerifiedAt", &full), Value::DateTime(1_000_000));
    assert_eq!(value("PackML/Admin/StopReasonCode", &full), Value::String("asked".to_owned()));
    let working = Snapshot { state: at(At::Execute(Phase::Wet)).state, ..full.clone() };
    assert_eq!(value("PackML/Admin/StopReasonCode", &working), Value::Absent, "it works: nothing stops it");
    let counts = CycleCounts { passed: 5, failed: 2, rejected: 1, invalid: 1, aborted: 3, other: 1 };
    let counted = Snapshot { counts, ..Snapshot::default() };
    assert_eq!(value("PackML/Admin/ProdProcessedCount", &counted), Value::UInt32(13));
    assert_eq!(value("PackML/Admin/ProdDefectiveCount", &counted), Value::UInt32(3));
}

#[test]
fn unknown_values_are_absent() {
    let nothing = Snapshot::default();
    for path in ["PackML/Status/StateCurrent", "Cycle/Verdict", "Calibrations/Tool/Age", "Cycle/WaitsForReview"] {
        assert_eq!(value(path, &nothing), Value::Absent, "{path}");
    }
}

#[test]
fn node_paths_are_unique_and_not_nested() {
    let paths: BTreeSet<&str> = NODES.iter().map(|node| node.path).collect();
    assert_eq!(paths.len(), NODES.len());
    for path in &paths {
        let below = format!("{path}/");
        assert!(!paths.iter().any(|other| other.starts_with(&below)), "{path} is a folder and a value");
    }
}

/// Each method requires the same roles as the corresponding request on the operator's page.
#[test]
fn each_command_has_one_method_with_its_roles() {
    let roles = |name: &str| -> Vec<&str> {
        let method = method(name).expect("such a method");
        Role::VARIANTS.iter().filter(|role| method.is_allowed(Some(**role))).map(|role| role.keyword()).collect()
    };
    let everybody = ["display", "viewer", "operator", "inspector", "engineer", "administrator"];
    for (name, expected) in [
        ("Reset", &["operator", "engineer"][..]),
        ("Start", &["operator", "engineer"]),
        ("Hold", &["operator", "engineer"]),
        ("Unhold", &["operator", "engineer"]),
        ("Stop", &everybody),
        ("Abort", &everybody),
        ("Clear", &["operator", "engineer"]),
        ("Accept", &["inspector", "engineer"]),
        ("NewDisc", &["operator", "engineer"]),
        ("AcknowledgeAlarm", &["operator", "inspector", "engineer"]),
    ] {
        assert_eq!(roles(name), expected, "{name}");
    }
    let without: Vec<&str> =
        METHODS.iter().filter(|method| method.is_allowed(None)).map(|method| method.name).collect();
    assert_eq!(without, ["Stop", "Abort"], "no person has to log in to stop the cell");
    for command in Command::VARIANTS {
        let of: Vec<_> = METHODS.iter().filter(|method| method.command == *command).collect();
        assert_eq!(of.len(), 1, "{command:?} has one method");
    }
    assert_eq!(METHODS.len(), Command::VARIANTS.len());
    assert!(
        METHODS.iter().all(|method| method.required_permission != Some(Permission::View)),
        "to look is no command"
    );
}
