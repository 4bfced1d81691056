//! Tests when a state that contradicts a proven fact is reported.

use super::*;
use crate::daemon::tests::standing_state;
use panelprep_cell::cell::Cell;
use panelprep_cell::cycle::{Extraction, Lens, Light, Tool, Water};

const IO: &str = "[io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
                  [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\n";

fn wiring() -> Wiring {
    Wiring::from_io(Cell::check("cell.toml", IO).expect("good").inputs_outputs()).expect("complete")
}

/// In contact: tool and extraction on, lens guarded, water and light off. Bits of `Out` from the lowest: light,
/// spray, lens, extraction, tool; of `In`: water off, lens shut, flow, running.
const CONTACT: Facts = Facts {
    tool: Tool::Running,
    water: Water::Drained,
    light: Light::Off,
    lens: Lens::Guarded,
    extraction: Extraction::Flowing,
    ..Facts::UNKNOWN
};

fn state(outputs: u32, inputs: u32) -> State {
    State { outputs, inputs, ..standing_state() }
}

/// A contradiction is reported after half a second, counted from the first contrary state; a state that agrees in
/// between restarts the time.
#[test]
fn half_a_second_of_contrary_states_is_reported() {
    let (wiring, mut contrary) = (wiring(), FeedbackContradiction::default());
    let (good, dead) = (state(0b1_1100, 0b1111), state(0b1_1100, 0b0111));
    let mut at = |ms, state: &State| contrary.update(&wiring, &CONTACT, &State { time_ms: ms, ..*state });
    assert_eq!(at(0, &good), None);
    assert_eq!(at(100, &dead), None);
    assert_eq!(at(599, &dead), None);
    assert_eq!(at(600, &dead), Some(Switch::ToolOn));
    assert_eq!((at(700, &good), at(800, &dead), at(1_299, &dead)), (None, None, None));
    assert_eq!(at(1_300, &dead), Some(Switch::ToolOn));
    // The controller's clock was set back.
    assert_eq!((at(10, &dead), at(509, &dead)), (None, None));
    assert_eq!(at(510, &dead), Some(Switch::ToolOn));
}

/// Each bit of the outputs and feedbacks is compared with the fact that it proved; unknown facts are not watched.
#[test]
fn each_output_and_each_feedback_is_watched() {
    let wiring = wiring();
    let told = |facts: &Facts, outputs, inputs| {
        let mut contrary = FeedbackContradiction::default();
        let first = contrary.update(&wiring, facts, &state(outputs, inputs));
        assert_eq!(first, None);
        contrary.update(&wiring, facts, &State { time_ms: 500, ..state(outputs, inputs) })
    };
    let switches = [Switch::LightOff, Switch::WaterOff, Switch::LensGuard, Switch::ExtractionOn, Switch::ToolOn];
    for (bit, switch) in switches.into_iter().enumerate() {
        assert_eq!(told(&CONTACT, 0b1_1100 ^ 1 << bit, 0b1111), Some(switch));
        assert_eq!(told(&Facts::UNKNOWN, 0b1_1100 ^ 1 << bit, 0b1111), None);
    }
    for (bit, switch) in switches[1..].iter().enumerate() {
        assert_eq!(told(&CONTACT, 0b1_1100, 0b1111 ^ 1 << bit), Some(*switch));
    }
}

/// The text states what was proven, and whether the output or the feedback contradicts it.
#[test]
fn the_reason_names_output_and_feedback() {
    let wiring = wiring();
    let leaks = contrary_reason(Switch::WaterOff, &wiring, &state(0b1_1100, 0b1110)).message;
    assert!(
        leaks.starts_with("expected: the water is off; the controller has reported a different state for 0.5 s"),
        "{leaks}"
    );
    assert!(
        leaks.ends_with("the output spray is reported as commanded; the feedback water_off reads off"),
        "{leaks}"
    );
    let switched = contrary_reason(Switch::LightOff, &wiring, &state(0b1_1101, 0b1111)).message;
    assert!(switched.ends_with("the output light is reported not as commanded"), "{switched}");
    let unproven = |inputs| unproven_reason(Switch::ToolOn, &wiring, &state(0b1_1100, inputs));
    let dead = unproven(0b0111).expect("the tool does not turn").message;
    assert!(dead.starts_with("commanded: the tool is on; the controller did not confirm it in time"), "{dead}");
    assert!(
        dead.ends_with("the output tool is reported as commanded; the feedback tool_running reads off"),
        "{dead}"
    );
    assert!(unproven(0b1111).is_none(), "it came");
}
