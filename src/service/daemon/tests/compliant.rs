//! Tests the compliant tool in the loop: a whole cycle with the tool, the recording of the cycle, and every injected
//! fault at every waypoint of a path.

use super::fake::{Asks, AtContact, Cell as Fake};
use super::*;
use crate::setup::{CellSetup, CycleSetup};
use panelprep_cell::cycle::{Hold, Trouble};
use panelprep_devices::acf::ToolFault;
use std::collections::BTreeMap;
use std::sync::Arc;

const TOOL: &str = "tool_error_mm = 1.0\n[tool]\nkind = 'simulated'\n";
const FORCE: &str = "[path]\nforce_n = 20\n";

fn compliant() -> Fake {
    let mut fake = Fake::new(Scene::Good).step_by_step();
    (fake.more_cell, fake.more_recipe) = (TOOL, FORCE);
    fake
}

/// The tool presses with the force of the recipe, and the record contains the measured force at the poses that the
/// robot reported.
#[test]
fn a_cycle_with_a_compliant_tool_passes() {
    let story = compliant().run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Pass), "{story}");
    assert!(story.findings.iter().all(|finding| finding.kind != Kind::Tool), "{story}");
    let abraded = story.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("abraded");
    let force = |name| abraded.number(name).expect("a force");
    println!("{:.1} N, {:.1} to {:.1} N", force(name::FORCE_MEAN), force(name::FORCE_MIN), force(name::FORCE_MAX));
    assert!((force(name::FORCE_MEAN) - 20.0).abs() < 2.0 && force(name::FORCE_MAX) < 25.0, "{abraded:?}");
}

/// Returns the reason code with which an injected fault is expected to be reported.
fn code(fault: ToolFault) -> &'static str {
    match fault {
        ToolFault::LinkCut | ToolFault::Silent | ToolFault::Late(_) | ToolFault::Garbage | ToolFault::OtherId => {
            "tool_link"
        }
        ToolFault::Errors(_) => "tool_errors",
        ToolFault::ForceOff(_) => "force_band",
        ToolFault::NoContact => "no_contact",
        ToolFault::Stuck => "tool_stuck",
    }
}

/// Each fault is injected at every fourth waypoint, and the next fault one waypoint later, so that each waypoint has at
/// least one fault.
#[test]
fn a_fault_at_every_waypoint_ends_contact_in_time() {
    faults_end_contact_in_time(4);
}

#[test]
#[ignore = "a minute: make test-long"]
fn every_fault_at_every_waypoint_ends_contact_in_time() {
    faults_end_contact_in_time(1);
}

/// Injects every fault at each `step`-th waypoint. Expected: the tool is off within 500 ms of the fault, or of the
/// first contact after it; the fault is reported by its code; the cycle is held; the record contains the executed part
/// of the path.
fn faults_end_contact_in_time(step: u32) {
    let begun = AtContact::new(compliant());
    let whole = begun.run(0, None);
    assert_eq!(whole.done, Some(begun.waypoints()), "{:?} {:?}", whole.state.at, whole.findings);
    let faults = [
        ToolFault::LinkCut,
        ToolFault::Silent,
        ToolFault::Late(130),
        ToolFault::Garbage,
        ToolFault::OtherId,
        ToolFault::Errors(2),
        ToolFault::ForceOff(12.0),
        ToolFault::ForceOff(-12.0),
        ToolFault::NoContact,
        ToolFault::Stuck,
    ];
    let mut worst_ms: BTreeMap<String, u64> = BTreeMap::new();
    let mut ended = 0_usize;
    for (first, fault) in (1..).zip(faults) {
        for from in (1..=begun.waypoints()).filter(|from| from % step == first % step) {
            let end = begun.run(from, Some(fault));
            let at = format!("{fault:?} from waypoint {from}: {:?} {:?}", end.state.at, end.findings);
            if let Some(took_ms) = end.took_ms {
                let worst = worst_ms.entry(format!("{fault:?}")).or_default();
                *worst = (*worst).max(took_ms);
                assert!(took_ms <= 500, "{took_ms} ms, {at}");
            }
            let found = end.findings.iter().find(|finding| finding.kind == Kind::Tool);
            let Some(found) = found else {
                // The disc no longer pressed after the fault, or the tool is stuck at a position at which its force is
                // still correct.
                assert!(end.done == Some(begun.waypoints()), "{at}");
                assert!(fault == ToolFault::Stuck || from + 5 > begun.waypoints(), "{at}");
                continue;
            };
            ended += 1;
            let reported = &found.judgement.reasons[0];
            // If the force is too small for landing, there is no contact and no force to be checked.
            let is_weak =
                matches!(fault, ToolFault::ForceOff(off_n) if off_n < 0.0) && reported.code == "no_contact";
            let fits = reported.code == code(fault) || is_weak || fault == ToolFault::Stuck;
            assert!(fits && reported.message.contains("compliant tool"), "{at}");
            assert!(matches!(end.state.at, At::Held(Hold { why: Why::Trouble(Trouble::Force), .. })), "{at}");
            let abraded =
                end.findings.iter().find(|finding| finding.kind == Kind::Abrade).expect("what was touched");
            assert_eq!(abraded.number(name::EXECUTED_WAYPOINTS_NAME), end.done.map(f64::from), "{at}");
        }
    }
    println!(
        "{} waypoints, {ended} paths ended; longest until the tool is off, ms: {worst_ms:?}",
        begun.waypoints()
    );
    assert!(ended as u32 * step > 8 * begun.waypoints(), "{ended} in steps of {step}");
}

/// A recipe with a force requires a compliant tool, a compliant tool requires a force, and the tool must be able to
/// apply it.
#[test]
fn recipe_and_tool_must_agree() {
    let says = |cell: &'static str, recipe: &'static str| {
        let mut fake = Fake::new(Scene::Good);
        (fake.more_cell, fake.more_recipe) = (cell, "");
        let (cell, _, taught, calibrations) = fake.files();
        let cell = Arc::new(CellSetup::new(&cell).expect("complete"));
        fake.more_recipe = recipe;
        let recipe = fake.files().1;
        CycleSetup::new(cell, recipe, taught, (calibrations, panelprep_cell::cell::LensExtent::default()))
            .err()
            .map(|error| error.to_string())
            .unwrap_or_default()
    };
    assert!(
        says(TOOL, "").contains("contains no [path] force_n, which the cell's compliant tool needs: add the force")
    );
    assert!(says("", FORCE).contains("force_n = 20, which has no effect"));
    // Expected value, calculated by hand: the weight of 1.5 kg is 14.7 N. With a force tolerance of 5 N, a tool of 100
    // N has 80.3 N left if it points upwards.
    let told = says(TOOL, "[path]\nforce_n = 80.5\n");
    assert!(
        told.contains("with the tool's force tolerance of 5 N and the weight of its payload, 14.7 N"),
        "{told}"
    );
    assert!(told.contains("it exceeds [tool] max_force_n = 100"), "{told}");
    assert_eq!(says(TOOL, "[path]\nforce_n = 80\n"), "");
    assert_eq!(says(TOOL, FORCE), "");
}

/// The tool's stroke is shorter than the error at the tool: the part is rejected before the panel is wetted.
#[test]
fn a_stroke_that_is_too_short_is_rejected() {
    let mut fake = compliant();
    fake.more_cell = "tool_error_mm = 9.8\n[tool]\nkind = 'simulated'\n";
    let story = fake.run(Asks::one_cycle());
    assert_eq!(story.outcome.verdict, Some(Verdict::Reject), "{story}");
    let last = story.findings.last().expect("a finding");
    assert_eq!((last.kind, &*last.judgement.reasons[0].code), (Kind::Reach, "tool_stroke"), "{story}");
}
