//! The interlocks of single functions: the interlocks of a cycle, checked with the present reports of the controller.
//!
//! A single function has less information than a cycle: no drain time, no approach point, no localization. A condition
//! that is not known is treated as not satisfied. Therefore only a cycle can switch on the tool's output, and water can
//! be switched on only while the arm is at the pose `park`.

use crate::setup::{DeviceReading, RINSE_OUTPUT_NAME, Wiring};
use panelprep_base::geometry::Joints;
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{Cell, Feedback, Output};
use panelprep_cell::cycle::{
    Action, Epoch, Extraction, Facts, Frames, Id, Lens, Motion, Path, Switch, Tool, Water, open_interlocks,
};
use panelprep_kuka::eki::{CONTACT_OVERRIDE_PERCENT, State};

/// Maximum distance of an axis from `park` at which the arm is treated as parked, degrees: ten times the resolution
/// that a controller reports.
const MAX_PARKED_DEVIATION_DEG: f64 = 0.1;

/// Returns the cycle's switch for the output with this name; switching off is always permitted.
pub(super) fn switch_of_output(name: &str) -> Option<Switch> {
    let known = [
        (Output::Light.name(), Switch::LightOn),
        (Output::Spray.name(), Switch::Spray),
        (RINSE_OUTPUT_NAME, Switch::Rinse),
        (Output::LensShutter.name(), Switch::LensGuard),
        (Output::Extraction.name(), Switch::ExtractionOn),
        (Output::Tool.name(), Switch::ToolOn),
    ];
    known.into_iter().find(|(output, _)| *output == name).map(|(_, switch)| switch)
}

/// Returns a motion action with the interlocks of the cycle's motion along this path.
pub(super) fn motion(path: Path) -> Action {
    Action::Move(Motion { epoch: 0, path, plan: 0, waypoints: 1 })
}

/// Returns a rejection if an interlock of the action is not satisfied; `name` is the function that the person
/// requested.
pub(super) fn judge(name: &str, act: Action, state: &State, cell: &Cell) -> Judgement {
    let open = open_interlocks(act, &facts(state, cell));
    let reason = |need: &&str| Reason::new("interlock", format!("{name} needs {need}"));
    Judgement::new(open.iter().map(reason).collect(), vec![])
}

/// Returns the facts about the cell that a single function knows: its epoch is open, and base and tool were confirmed
/// in this epoch.
fn facts(state: &State, cell: &Cell) -> Facts {
    let io = cell.inputs_outputs();
    let wiring = Wiring::from_available_io(io);
    let reading = |switches, (feedback, on)| wiring.reading(switches, (io.feedback_bit(feedback), on), state);
    let parked = cell.park_pose().is_some_and(|park| is_at_pose(&state.joints, &park));
    Facts {
        standing: !state.moving,
        full_override: state.override_percent == CONTACT_OVERRIDE_PERCENT,
        epoch: Epoch::Open,
        frames: Some(Frames::Camera),
        arm: parked.then_some(Path::Park),
        tool: match reading((Switch::ToolOn, Switch::ToolOff), (Feedback::ToolRunning, true)) {
            DeviceReading::NotWired | DeviceReading::Is(false) => Tool::Off,
            DeviceReading::Is(true) => Tool::Running,
            DeviceReading::Open => Tool::Unknown,
        },
        water: match reading((Switch::Spray, Switch::WaterOff), (Feedback::WaterOff, false)) {
            DeviceReading::NotWired => Water::Drained,
            // The time at which the water was switched off is not known, so the water is treated as draining.
            DeviceReading::Is(false) => Water::Draining { until: Id(0) },
            DeviceReading::Is(true) | DeviceReading::Open => Water::Unknown,
        },
        lens: match reading((Switch::LensGuard, Switch::LensClear), (Feedback::LensShut, true)) {
            DeviceReading::Is(true) => Lens::Guarded,
            _ => Lens::Unknown,
        },
        extraction: match reading((Switch::ExtractionOn, Switch::ExtractionOff), (Feedback::ExtractionFlow, true)) {
            DeviceReading::Is(true) => Extraction::Flowing,
            _ => Extraction::Unknown,
        },
        ..Facts::UNKNOWN
    }
}

fn is_at_pose(joints: &Joints, pose: &Joints) -> bool {
    joints.degrees().iter().zip(pose.degrees()).all(|(is, asked)| (is - asked).abs() <= MAX_PARKED_DEVIATION_DEG)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::tests::standing_state;

    const CELL: &str = "[poses]\npark = { a1_deg = 10.0, a2_deg = -90.0, a3_deg = 90.0, a4_deg = 0.0, a5_deg = 60.0, \
        a6_deg = 0.0 }\n[io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n[io.feedbacks]\n\
        water_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\n";

    fn cell() -> Cell {
        Cell::check("cell.toml", CELL).expect("good")
    }

    /// Returns whether the action is permitted. Bits of `In`, from the lowest: water_off, lens_shut, extraction_flow,
    /// tool_running. Bits of `Out`: light, spray, lens_shutter, extraction, tool.
    fn is_permitted(act: Action, (inputs, outputs): (u32, u32), a1_deg: f64) -> bool {
        let joints = Joints { a1_deg, ..cell().park_pose().expect("given") };
        let state = State { inputs, outputs, joints, ..standing_state() };
        judge("it", act, &state, &cell()).reasons.is_empty()
    }

    /// Tests every combination of feedbacks and outputs, with the arm parked and not parked. Expected results, by hand:
    ///
    /// - A motion requires that water and tool are off.
    /// - Water requires that the arm is parked, the lens shutter is closed and the tool is off.
    /// - The tool's output is permitted only in a cycle.
    /// - Light, lens shutter and extraction require nothing.
    ///
    /// Each state is proven by its output and its feedback together; if they contradict each other, nothing is proven.
    #[test]
    fn a_single_function_does_nothing_that_a_cycle_may_not() {
        for (inputs, outputs) in (0..16).flat_map(|inputs| (0..32).map(move |outputs| (inputs, outputs))) {
            let [is_in, is_out] = [inputs, outputs].map(|bits: u32| move |at: u32| bits >> at & 1 == 1);
            let water_off = is_in(0) && !is_out(1);
            let lens_shut = is_in(1) && is_out(2);
            let tool_off = !is_in(3) && !is_out(4);
            let inputs = (inputs, outputs);
            for (a1_deg, parked) in [(10.0, true), (10.05, true), (10.2, false), (-120.0, false)] {
                for path in [Path::Park, Path::Corner { view: 0 }] {
                    assert_eq!(
                        is_permitted(motion(path), inputs, a1_deg),
                        water_off && tool_off,
                        "{path:?} {inputs:?}"
                    );
                }
                for (name, expected) in [
                    ("spray", parked && lens_shut && tool_off),
                    ("rinse", parked && lens_shut && tool_off),
                    ("tool", false),
                    ("light", true),
                    ("lens_shutter", true),
                    ("extraction", true),
                ] {
                    let act = Action::Switch(switch_of_output(name).expect("known"));
                    assert_eq!(is_permitted(act, inputs, a1_deg), expected, "{name} {inputs:?} {a1_deg}");
                }
            }
        }
        assert_eq!(switch_of_output("horn"), None);
    }

    /// An output without a feedback is not proven off; an output that the cell does not have cannot be on.
    #[test]
    fn an_output_without_a_feedback_is_not_proven_off() {
        let without = |line: &str| Cell::check("cell.toml", &CELL.replace(line, "")).expect("good");
        let refused = |cell: &Cell| {
            let judgement = judge("a motion", motion(Path::Park), &State { inputs: 1, ..standing_state() }, cell);
            judgement.reasons.iter().map(|reason| reason.message.clone()).collect::<Vec<_>>()
        };
        assert_eq!(
            refused(&without("tool_running = 4\n")),
            [
                "a motion needs the tool off, by its output and by the feedback tool_running (and tool_stands, if the cell has it)"
            ]
        );
        let neither = CELL.replace("tool_running = 4\n", "").replace("tool = 5\n", "");
        assert_eq!(refused(&Cell::check("cell.toml", &neither).expect("good")), [""; 0]);
    }
}
