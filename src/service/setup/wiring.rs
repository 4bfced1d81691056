//! The process switches, by the names of the cell's inputs and outputs.
//!
//! A switch is proven if the state message reports its outputs as they were set, and its feedback with the expected
//! value. The outputs alone only show the state of the controller; the feedback shows the state of the valve, the fan
//! or the tool that the output controls.
//!
//! The proven facts about the outputs are monitored while the state table relies on them (R21). Each fact of the state
//! table about an output was proven when the output was switched: the controller reported the output, and the feedback
//! reported its effect. While the fact is valid, each state of the robot must report both unchanged. If the states
//! contradict the fact for [`CONTRADICTION_LIMIT_MS`], the state table is informed. The work in progress is held, the
//! tool is lifted off the panel, and the output is proven again before it is needed. A shorter contradiction is
//! tolerated because feedbacks may change for a short time: a flow switch flutters, and a sander slows down when it
//! touches the panel. An output that is being switched is checked by its own action.

use super::fault::SetupFault;
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{Feedback, InputsOutputs, Output};
use panelprep_cell::cycle::{Facts, Switch};
use panelprep_kuka::eki::{Signal, State};

/// The name of the output that rinses off the dust, if the cell has one.
pub(crate) const RINSE_OUTPUT_NAME: &str = "rinse";

/// An output: its number, its bit in `Out` of the state message, the bit of the feedback that proves it, and the bit of
/// the opposite feedback, if there is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Wire {
    output: u16,
    bit: u32,
    feedback: Option<u32>,
    opposite: Option<u32>,
}

/// The outputs and feedbacks of the process; a cell may have only some of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wiring {
    light: Option<Wire>,
    spray: Option<Wire>,
    rinse: Option<Wire>,
    shutter: Option<Wire>,
    extraction: Option<Wire>,
    tool: Option<Wire>,
}

/// The state of a device, from its output and its feedback together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DeviceReading {
    /// The cell has no such output, and no feedback reports that the device is on.
    NotWired,
    /// The state is not proven: there is no feedback, or output and feedback contradict each other.
    Open,
    /// Output and feedback both report that the device is on, or both report that it is off.
    Is(bool),
}

/// The bits by which a state message proves a switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SwitchProof {
    /// The bits of `Out` that belong to the switch; `outputs_on` contains those that must be on.
    outputs: u32,
    outputs_on: u32,
    feedback: Option<(u32, bool)>,
    opposite: Option<(u32, bool)>,
}

/// The reported state of a switch's outputs and feedbacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SwitchFeedback {
    /// Whether the outputs are reported as they were set.
    pub outputs: bool,
    /// The value of the feedback, if there is one.
    pub feedback: Option<bool>,
    /// The value of the opposite feedback, if there is one.
    pub opposite: Option<bool>,
}

impl SwitchProof {
    /// Returns what the state reports: whether the outputs are as they were set, and the values of the feedbacks.
    pub(crate) fn read_feedback(&self, state: &State) -> SwitchFeedback {
        let read = |feedback: Option<(u32, bool)>| feedback.map(|(bit, _)| is_input_on(state, bit));
        SwitchFeedback {
            outputs: state.outputs & self.outputs == self.outputs_on,
            feedback: read(self.feedback),
            opposite: read(self.opposite),
        }
    }

    /// Returns whether this state proves the switch.
    pub(crate) fn is_satisfied(&self, state: &State) -> bool {
        let expected = |feedback: Option<(u32, bool)>| feedback.map(|(_, on)| on);
        let reading = self.read_feedback(state);
        reading.outputs
            && reading.feedback == expected(self.feedback)
            && reading.opposite == expected(self.opposite)
    }
}

impl Wiring {
    /// Uses the outputs `light`, `spray`, `lens_shutter`, `extraction` and `tool` with the feedbacks `water_off`,
    /// `lens_shut`, `extraction_flow` and `tool_running`. If the cell has an output `rinse`, it is used for rinsing;
    /// otherwise the spray is used. If the cell has a feedback `light_on`, it proves the light.
    ///
    /// # Errors
    /// If the cell lacks one of these names.
    pub fn from_io(io: &InputsOutputs) -> Result<Self, SetupFault> {
        let wiring = Wiring::from_available_io(io);
        let needed = [
            (Output::Light, wiring.light, None),
            (Output::Spray, wiring.spray, Some(Feedback::WaterOff)),
            (Output::LensShutter, wiring.shutter, Some(Feedback::LensShut)),
            (Output::Extraction, wiring.extraction, Some(Feedback::ExtractionFlow)),
            (Output::Tool, wiring.tool, Some(Feedback::ToolRunning)),
        ];
        for (output, wire, feedback) in needed {
            if let Some(name) = feedback.filter(|feedback| io.feedback_bit(*feedback).is_none()).map(Feedback::name)
            {
                return Err(SetupFault::NotWired { table: "io.feedbacks", name });
            }
            if wire.is_none() {
                return Err(SetupFault::NotWired { table: "io.outputs", name: output.name() });
            }
        }
        Ok(wiring)
    }

    /// Does the same as `from_io`, but only for the names that the cell has.
    pub(crate) fn from_available_io(io: &InputsOutputs) -> Self {
        let wire = |number: Option<u16>, output: Output| {
            let number = number?;
            let (bit, feedback) = (io.output_bit(number)?, io.feedback_bit(output.feedback()));
            let stands = || io.feedback_bit(Feedback::ToolStands);
            let opposite = (output == Output::Tool).then(stands).flatten();
            Some(Wire { output: number, bit, feedback, opposite })
        };
        let own = |output: Output| wire(io.output(output), output);
        let (spray, rinse) =
            (own(Output::Spray), wire(io.outputs().get(RINSE_OUTPUT_NAME).copied(), Output::Spray));
        Wiring {
            light: own(Output::Light),
            spray: spray.or(rinse),
            rinse: rinse.or(spray),
            shutter: own(Output::LensShutter),
            extraction: own(Output::Extraction),
            tool: own(Output::Tool),
        }
    }

    /// Returns the state of the device that these two switches control; `feedback_on` is the value of the feedback
    /// while the device is on.
    pub(crate) fn reading(
        &self,
        (on, off): (Switch, Switch),
        (feedback, feedback_on): (Option<u32>, bool),
        state: &State,
    ) -> DeviceReading {
        let is_fed_back = feedback.map(|bit| is_input_on(state, bit) == feedback_on);
        match (self.switch_wires(on)[1], is_fed_back) {
            (None, None | Some(false)) => DeviceReading::NotWired,
            (None, Some(true)) | (Some(_), None) => DeviceReading::Open,
            (Some(_), Some(_)) if self.switch_proof(on).is_satisfied(state) => DeviceReading::Is(true),
            (Some(_), Some(_)) if self.switch_proof(off).is_satisfied(state) => DeviceReading::Is(false),
            (Some(_), Some(_)) => DeviceReading::Open,
        }
    }

    /// Returns the signals that a switch sets, in order.
    pub(crate) fn signals(&self, switch: Switch) -> Vec<Signal> {
        let wires = self.switch_wires(switch).into_iter().flatten();
        wires.map(|(wire, on)| Signal { number: wire.output, on }).collect()
    }

    /// Returns the bits that a state message must contain to prove this switch.
    pub(crate) fn switch_proof(&self, switch: Switch) -> SwitchProof {
        let mut proof = SwitchProof { outputs: 0, outputs_on: 0, feedback: None, opposite: None };
        for (wire, on) in self.switch_wires(switch).into_iter().flatten() {
            let bit = 1u32.checked_shl(wire.bit).unwrap_or(0);
            proof.outputs |= bit;
            proof.outputs_on |= if on { bit } else { 0 };
            // The water feedback is on when the water is off. The nozzle that is switched last determines the expected
            // feedback.
            let is_water = [self.spray, self.rinse].into_iter().flatten().any(|water| water.output == wire.output);
            proof.feedback = wire.feedback.map(|bit| (bit, on != is_water));
            proof.opposite = wire.opposite.map(|bit| (bit, !on));
        }
        proof
    }

    fn switch_wires(&self, switch: Switch) -> [Option<(Wire, bool)>; 2] {
        let (wire, on) = match switch {
            Switch::ToolOn => (self.tool, true),
            Switch::ToolOff => (self.tool, false),
            Switch::LightOn => (self.light, true),
            Switch::LightOff => (self.light, false),
            Switch::LensClear => (self.shutter, false),
            Switch::LensGuard => (self.shutter, true),
            Switch::ExtractionOn => (self.extraction, true),
            Switch::ExtractionOff => (self.extraction, false),
            Switch::Rinse => (self.rinse, true),
            Switch::Spray => (self.spray, true),
            Switch::WaterOff => (self.spray, false),
        };
        // Both nozzles share one feedback: flow from the other nozzle must not be treated as flow from this one.
        let other = match switch {
            Switch::Rinse => Some(self.spray),
            Switch::Spray | Switch::WaterOff => Some(self.rinse),
            _ => None,
        };
        let number = wire.map(|wire| wire.output);
        let other = other.flatten().filter(|other| Some(other.output) != number).map(|other| (other, false));
        [other, wire.map(|wire| (wire, on))]
    }

    /// Returns whether the outputs of both nozzles and the feedback report that no water runs.
    pub(crate) fn water_is_off(&self, state: &State) -> bool {
        self.switch_proof(Switch::WaterOff).is_satisfied(state)
    }

    /// Returns whether the tool's output and its feedback report that the tool has stopped.
    pub(crate) fn tool_is_off(&self, state: &State) -> bool {
        self.switch_proof(Switch::ToolOff).is_satisfied(state)
    }
}

/// Returns whether this mapped input is on.
pub(crate) fn is_input_on(state: &State, bit: u32) -> bool {
    state.inputs >> bit & 1 == 1
}

/// Time for which states may contradict a proven fact, ms.
const CONTRADICTION_LIMIT_MS: u32 = 500;

/// An output whose proof is contradicted, and the time since when, on the controller's clock, ms.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FeedbackContradiction(Option<(Switch, u32)>);

impl FeedbackContradiction {
    /// Returns the output that the robot's states, including this one, have contradicted for longer than the limit.
    pub(crate) fn update(&mut self, wiring: &Wiring, facts: &Facts, state: &State) -> Option<Switch> {
        let now_ms = state.time_ms;
        // Only proven switches are compared, because during switching the feedback is expected to differ.
        let contrary = facts.proven_switches().find(|switch| !wiring.switch_proof(*switch).is_satisfied(state));
        // If the clock was set back, the time is counted again from zero.
        let last = self.0.filter(|(last, since_ms)| Some(*last) == contrary && *since_ms <= now_ms);
        self.0 = contrary.map(|switch| (switch, last.map_or(now_ms, |(_, since_ms)| since_ms)));
        let (switch, since_ms) = self.0?;
        (now_ms - since_ms >= CONTRADICTION_LIMIT_MS).then_some(switch)
    }
}

/// Returns the effect of a switch in words, and its output.
fn describe_switch(switch: Switch) -> (&'static str, Output) {
    match switch {
        Switch::ToolOn => ("the tool is on", Output::Tool),
        Switch::ToolOff => ("the tool is off", Output::Tool),
        Switch::Rinse => ("the rinse water is on", Output::Spray),
        Switch::Spray => ("the spray water is on", Output::Spray),
        Switch::WaterOff => ("the water is off", Output::Spray),
        Switch::LightOn => ("the light is on", Output::Light),
        Switch::LightOff => ("the light is off", Output::Light),
        Switch::LensClear => ("the lens shutter is open", Output::LensShutter),
        Switch::LensGuard => ("the lens shutter is closed", Output::LensShutter),
        Switch::ExtractionOn => ("the dust extraction is on", Output::Extraction),
        Switch::ExtractionOff => ("the dust extraction is off", Output::Extraction),
    }
}

fn on_off_text(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

/// Describes the reported state of a switch's output and feedback.
fn describe_state(switch: Switch, wiring: &Wiring, state: &State) -> String {
    let (_, output) = describe_switch(switch);
    let SwitchFeedback { outputs, feedback, opposite } = wiring.switch_proof(switch).read_feedback(state);
    let agrees = if outputs { "as commanded" } else { "not as commanded" };
    let output_words = format!("the output {} is reported {agrees}", output.name());
    let name = output.feedback().name();
    let feedbacks = [(name, feedback), (Feedback::ToolStands.name(), opposite)];
    let words = feedbacks
        .into_iter()
        .filter_map(|(name, on)| Some(format!("; the feedback {name} reads {}", on_off_text(on?))));
    std::iter::once(output_words).chain(words).collect()
}

/// Returns the reason: the proven fact that is not true any more, and what to check.
pub(crate) fn contrary_reason(switch: Switch, wiring: &Wiring, state: &State) -> Reason {
    let ((was_proven, _), tells) = (describe_switch(switch), describe_state(switch, wiring, state));
    let contrary_s = f64::from(CONTRADICTION_LIMIT_MS) / 1_000.0;
    let message = format!(
        "expected: {was_proven}; the controller has reported a different state for {contrary_s:.1} s: {tells}"
    );
    Reason::new("feedback", message)
}

/// Returns the reason: what was commanded and not proven before its deadline, and what to check. `None` if the state
/// reports it now.
pub(crate) fn unproven_reason(switch: Switch, wiring: &Wiring, state: &State) -> Option<Reason> {
    if wiring.switch_proof(switch).is_satisfied(state) {
        return None;
    }
    let ((is_asked, _), tells) = (describe_switch(switch), describe_state(switch, wiring, state));
    let message = format!("commanded: {is_asked}; the controller did not confirm it in time: {tells}");
    Some(Reason::new("feedback", message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::standing_state;
    use panelprep_cell::cell::Cell;
    use panelprep_cell::cycle::{Extraction, Lens, Light, Tool, Water};

    const IO: &str = "[io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
                      [io.feedbacks]\nwater_off = 17\nlens_shut = 18\nextraction_flow = 25\ntool_running = 20\n";

    #[test]
    fn feedbacks_are_bits_in_the_order_of_their_numbers() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let wiring = Wiring::from_io(cell.inputs_outputs()).expect("complete");
        let set = |wiring: &Wiring, switch| (wiring.signals(switch), wiring.switch_proof(switch));
        let setting = |number: u16, on, feedback| {
            let proof = SwitchProof {
                outputs: 1 << (number - 1),
                outputs_on: u32::from(on) << (number - 1),
                feedback,
                opposite: None,
            };
            (vec![Signal { number, on }], proof)
        };
        assert_eq!(set(&wiring, Switch::ToolOn), setting(5, true, Some((2, true))), "17, 18, 20, 25");
        assert_eq!(set(&wiring, Switch::ExtractionOn), setting(4, true, Some((3, true))));
        assert_eq!(set(&wiring, Switch::Spray), setting(2, true, Some((0, false))));
        assert_eq!(set(&wiring, Switch::WaterOff), setting(2, false, Some((0, true))));
        assert_eq!(set(&wiring, Switch::LightOn), setting(1, true, None), "it has no feedback here");
        let text = format!("{IO}light_on = 3\n");
        let wiring =
            Wiring::from_io(Cell::check("cell.toml", &text).expect("good").inputs_outputs()).expect("complete");
        assert_eq!(set(&wiring, Switch::LightOff), setting(1, false, Some((0, false))), "3, 17, 18, 20, 25");
    }

    /// The controller reports the output, and the feedback reports the controlled device: neither of them alone is a
    /// proof.
    #[test]
    fn a_switch_is_proven_by_its_output_and_its_feedback() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let proof = Wiring::from_io(cell.inputs_outputs()).expect("complete").switch_proof(Switch::ToolOn);
        let state = |outputs, inputs| State { outputs, inputs, ..crate::setup::testing::standing_state() };
        assert!(proof.is_satisfied(&state(0b1_0000, 0b0100)));
        assert!(!proof.is_satisfied(&state(0b1_0000, 0)), "the tool does not turn");
        assert!(!proof.is_satisfied(&state(0b0_1000, 0b0100)), "it was another output");
    }

    /// Each water output is switched off when the other one is switched on. Otherwise the valve of a separate rinse
    /// output would stay open, and its water would seem to prove a spray valve that does not open.
    #[test]
    fn each_water_output_switches_the_other_one_off() {
        let text = IO.replace("spray = 2", "spray = 2\nrinse = 6");
        let wiring =
            Wiring::from_io(Cell::check("cell.toml", &text).expect("good").inputs_outputs()).expect("complete");
        let signals = |switch| wiring.signals(switch).into_iter().map(|signal| (signal.number, signal.on));
        assert_eq!(signals(Switch::Spray).collect::<Vec<_>>(), [(6, false), (2, true)]);
        assert_eq!(signals(Switch::Rinse).collect::<Vec<_>>(), [(2, false), (6, true)]);
        assert_eq!(signals(Switch::WaterOff).collect::<Vec<_>>(), [(6, false), (2, false)]);
        let proof = |switch| wiring.switch_proof(switch);
        let (spray, rinse) = (0b0_0010, 0b10_0000);
        let both = |outputs_on, is_off| SwitchProof {
            outputs: spray | rinse,
            outputs_on,
            feedback: Some((0, is_off)),
            opposite: None,
        };
        assert_eq!(proof(Switch::Spray), both(spray, false));
        assert_eq!(proof(Switch::Rinse), both(rinse, false));
        assert_eq!(proof(Switch::WaterOff), both(0, true));
    }

    /// An output that is on is not treated as off, whatever its feedback; and a feedback that is on is not treated as
    /// off, whatever its output.
    #[test]
    fn only_output_and_feedback_together_prove_off() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let wiring = Wiring::from_io(cell.inputs_outputs()).expect("complete");
        // In `Out`, bit 4 is the tool and bit 1 the spray; in `In`, bit 2 reports that the tool runs and bit 0 that the
        // water is off.
        for (outputs, inputs, tool_off, water_off) in [
            (0b0_0000, 0b0001, true, true),
            (0b1_0000, 0b0001, false, true),
            (0b0_0000, 0b0101, false, true),
            (0b0_0010, 0b0001, true, false),
            (0b0_0000, 0b0000, true, false),
        ] {
            let state = State { outputs, inputs, ..crate::setup::testing::standing_state() };
            let found = (wiring.tool_is_off(&state), wiring.water_is_off(&state));
            assert_eq!(found, (tool_off, water_off), "Out {outputs:05b}, In {inputs:04b}");
        }
    }

    /// A broken wire of `tool_running` looks like a stopped tool. The additional feedback `tool_stands` is on while the
    /// tool is stopped, so it proves that the tool is off.
    #[test]
    fn the_absence_of_a_signal_proves_no_tool_off() {
        let wiring = |io: &str| {
            Wiring::from_io(Cell::check("cell.toml", io).expect("good").inputs_outputs()).expect("complete")
        };
        let (one, both) = (wiring(IO), wiring(&format!("{IO}tool_stands = 30\n")));
        // Inputs 17, 18, 20, 25, 30: bit 2 is tool_running, bit 4 is tool_stands.
        for (inputs, by_one, by_both) in
            [(0b0_0000, true, false), (0b1_0000, true, true), (0b1_0100, false, false), (0b0_0100, false, false)]
        {
            let state = State { inputs, ..crate::setup::testing::standing_state() };
            assert_eq!((one.tool_is_off(&state), both.tool_is_off(&state)), (by_one, by_both), "{inputs:05b}");
        }
        let runs = |inputs| {
            both.switch_proof(Switch::ToolOn).is_satisfied(&State {
                inputs,
                outputs: 0b1_0000,
                ..crate::setup::testing::standing_state()
            })
        };
        assert_eq!([runs(0b0_0100), runs(0b1_0100)], [true, false]);
    }

    #[test]
    fn a_missing_signal_name_is_reported() {
        let text = IO.replace("tool_running = 20\n", "");
        let cell = Cell::check("cell.toml", &text).expect("good");
        let error = Wiring::from_io(cell.inputs_outputs()).expect_err("missing");
        assert!(matches!(error, SetupFault::NotWired { table: "io.feedbacks", name: "tool_running" }), "{error}");
    }

    const FEEDBACK_IO: &str = "[io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
                      [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\n";

    fn wiring() -> Wiring {
        Wiring::from_io(Cell::check("cell.toml", FEEDBACK_IO).expect("good").inputs_outputs()).expect("complete")
    }

    /// Facts in contact: tool and extraction on, lens shutter closed, water and light off. Bits of `Out` from the
    /// lowest: light, spray, lens shutter, extraction, tool; of `In`: water off, lens shut, flow, running.
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

    /// A contradiction is reported after half a second, counted from the first contradicting state; an agreeing state
    /// in between resets this time.
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

    /// Each bit of the outputs and feedbacks is compared with the fact that it proved; facts that are not known are not
    /// monitored.
    #[test]
    fn each_output_and_each_feedback_is_watched() {
        let wiring = wiring();
        let told = |facts: &Facts, outputs, inputs| {
            let mut contrary = FeedbackContradiction::default();
            let first = contrary.update(&wiring, facts, &state(outputs, inputs));
            assert_eq!(first, None);
            contrary.update(&wiring, facts, &State { time_ms: 500, ..state(outputs, inputs) })
        };
        let switches =
            [Switch::LightOff, Switch::WaterOff, Switch::LensGuard, Switch::ExtractionOn, Switch::ToolOn];
        for (bit, switch) in switches.into_iter().enumerate() {
            assert_eq!(told(&CONTACT, 0b1_1100 ^ 1 << bit, 0b1111), Some(switch));
            assert_eq!(told(&Facts::UNKNOWN, 0b1_1100 ^ 1 << bit, 0b1111), None);
        }
        for (bit, switch) in switches[1..].iter().enumerate() {
            assert_eq!(told(&CONTACT, 0b1_1100, 0b1111 ^ 1 << bit), Some(*switch));
        }
    }

    /// The text contains the proven fact, and whether the output or the feedback contradicts it.
    #[test]
    fn the_reason_names_output_and_feedback() {
        let wiring = wiring();
        let leaks = contrary_reason(Switch::WaterOff, &wiring, &state(0b1_1100, 0b1110)).message;
        assert!(
            leaks
                .starts_with("expected: the water is off; the controller has reported a different state for 0.5 s"),
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
}
