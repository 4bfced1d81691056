//! Switches by the names of the cell's inputs and outputs.
//!
//! A switch is proven if the state message reports its outputs as they were set, and its feedback with the expected
//! value. The outputs alone show the state of the controller; the feedback shows the state of the valve, the fan or
//! the tool behind it.

use super::DaemonError;
use panelprep_cell::cell::{Feedback, InputsOutputs, Output};
use panelprep_cell::cycle::Switch;
use panelprep_kuka::eki::{Signal, State};

/// The output that rinses off the dust, if it has its own.
pub(super) const RINSE: &str = "rinse";

/// An output with its bit of the state message's `Out`, the bit of the feedback that proves it, and the bit of the
/// opposite feedback, if there is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Wire {
    output: u16,
    bit: u32,
    feedback: Option<u32>,
    opposite: Option<u32>,
}

/// The outputs and feedbacks for the process; each may be missing in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wiring {
    light: Option<Wire>,
    spray: Option<Wire>,
    rinse: Option<Wire>,
    shutter: Option<Wire>,
    extraction: Option<Wire>,
    tool: Option<Wire>,
}

/// The state of a device that is switched on and off, from its output and its feedback together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DeviceReading {
    /// The cell has no such output, and no feedback reports that it is on.
    NotWired,
    /// The state is not proven: there is no feedback, or output and feedback contradict each other.
    Open,
    /// Both report that it is on, or off.
    Is(bool),
}

/// The bits that a state message must contain for a switch to be proven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SwitchProof {
    /// The bits of `Out` that belong to the switch; `outputs_on` contains those that must be on.
    outputs: u32,
    outputs_on: u32,
    feedback: Option<(u32, bool)>,
    opposite: Option<(u32, bool)>,
}

/// The data in a state message about a switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SwitchFeedback {
    /// Whether the outputs are as they were set.
    pub outputs: bool,
    /// The value of the feedback, if there is one.
    pub feedback: Option<bool>,
    /// The value of the opposite feedback, if there is one.
    pub opposite: Option<bool>,
}

impl SwitchProof {
    /// Returns what the state reports: whether the outputs are as they were set, and the values of the feedbacks.
    pub(super) fn read_feedback(&self, state: &State) -> SwitchFeedback {
        let read = |feedback: Option<(u32, bool)>| feedback.map(|(bit, _)| is_input_on(state, bit));
        SwitchFeedback {
            outputs: state.outputs & self.outputs == self.outputs_on,
            feedback: read(self.feedback),
            opposite: read(self.opposite),
        }
    }

    /// Returns whether this state proves the switch.
    pub(super) fn is_satisfied(&self, state: &State) -> bool {
        let expected = |feedback: Option<(u32, bool)>| feedback.map(|(_, on)| on);
        let reading = self.read_feedback(state);
        reading.outputs
            && reading.feedback == expected(self.feedback)
            && reading.opposite == expected(self.opposite)
    }
}

impl Wiring {
    /// Uses `light`, `spray`, `lens_shutter`, `extraction` and `tool` with the feedbacks `water_off`, `lens_shut`,
    /// `extraction_flow` and `tool_running`. Uses an output `rinse` if there is one, otherwise the spray rinses.
    /// The feedback `light_on` proves the light if there is one.
    ///
    /// # Errors
    /// If the cell lacks one of these names.
    pub fn from_io(io: &InputsOutputs) -> Result<Self, DaemonError> {
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
                return Err(DaemonError::NotWired { table: "io.feedbacks", name });
            }
            if wire.is_none() {
                return Err(DaemonError::NotWired { table: "io.outputs", name: output.name() });
            }
        }
        Ok(wiring)
    }

    /// Does the same as `from_io`, but only for the names that the cell has.
    pub(super) fn from_available_io(io: &InputsOutputs) -> Self {
        let wire = |number: Option<u16>, output: Output| {
            let number = number?;
            let (bit, feedback) = (io.output_bit(number)?, io.feedback_bit(output.feedback()));
            let stands = || io.feedback_bit(Feedback::ToolStands);
            let opposite = (output == Output::Tool).then(stands).flatten();
            Some(Wire { output: number, bit, feedback, opposite })
        };
        let own = |output: Output| wire(io.output(output), output);
        let (spray, rinse) = (own(Output::Spray), wire(io.outputs().get(RINSE).copied(), Output::Spray));
        Wiring {
            light: own(Output::Light),
            spray: spray.or(rinse),
            rinse: rinse.or(spray),
            shutter: own(Output::LensShutter),
            extraction: own(Output::Extraction),
            tool: own(Output::Tool),
        }
    }

    /// Returns the state of the device that these two switches control; `feedback_on` is the value of the cell's
    /// feedback while the device is on.
    pub(super) fn reading(
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
    pub(super) fn signals(&self, switch: Switch) -> Vec<Signal> {
        let wires = self.switch_wires(switch).into_iter().flatten();
        wires.map(|(wire, on)| Signal { number: wire.output, on }).collect()
    }

    /// Returns the content that a state message must have to prove this switch.
    pub(super) fn switch_proof(&self, switch: Switch) -> SwitchProof {
        let mut proof = SwitchProof { outputs: 0, outputs_on: 0, feedback: None, opposite: None };
        for (wire, on) in self.switch_wires(switch).into_iter().flatten() {
            let bit = 1u32.checked_shl(wire.bit).unwrap_or(0);
            proof.outputs |= bit;
            proof.outputs_on |= if on { bit } else { 0 };
            // The water feedback is on when the water is off; the nozzle that is switched last determines the expected
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
        // One feedback covers both nozzles: flow from the other nozzle must not be mistaken for flow from this one.
        let other = match switch {
            Switch::Rinse => Some(self.spray),
            Switch::Spray | Switch::WaterOff => Some(self.rinse),
            _ => None,
        };
        let number = wire.map(|wire| wire.output);
        let other = other.flatten().filter(|other| Some(other.output) != number).map(|other| (other, false));
        [other, wire.map(|wire| (wire, on))]
    }

    /// Returns whether both nozzles' outputs and the feedback report that no water runs.
    pub(super) fn water_is_off(&self, state: &State) -> bool {
        self.switch_proof(Switch::WaterOff).is_satisfied(state)
    }

    /// Returns whether the tool's output and its feedback report that it has stopped.
    pub(super) fn tool_is_off(&self, state: &State) -> bool {
        self.switch_proof(Switch::ToolOff).is_satisfied(state)
    }
}

/// Returns whether this mapped input is on.
pub(super) fn is_input_on(state: &State, bit: u32) -> bool {
    state.inputs >> bit & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::Cell;

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

    /// The controller reports the output, and the feedback reports the device behind it: each alone is not a proof.
    #[test]
    fn a_switch_is_proven_by_its_output_and_its_feedback() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let proof = Wiring::from_io(cell.inputs_outputs()).expect("complete").switch_proof(Switch::ToolOn);
        let state = |outputs, inputs| State { outputs, inputs, ..crate::daemon::tests::standing_state() };
        assert!(proof.is_satisfied(&state(0b1_0000, 0b0100)));
        assert!(!proof.is_satisfied(&state(0b1_0000, 0)), "the tool does not turn");
        assert!(!proof.is_satisfied(&state(0b0_1000, 0b0100)), "it was another output");
    }

    /// Each water output switches the other one off. Otherwise a rinse with its own output would stay open, and its
    /// water would seem to prove a spray valve that does not open.
    #[test]
    fn each_water_switches_the_other_one_off() {
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

    /// An output that is on does not count as off, regardless of its feedback; and a feedback that is on does not
    /// count as off, regardless of its output.
    #[test]
    fn off_needs_the_output_and_the_feedback() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let wiring = Wiring::from_io(cell.inputs_outputs()).expect("complete");
        // In `Out`, bit 4 is the tool and bit 1 the spray; in `In`, bit 2 reports that the tool runs and bit 0 that
        // the water is off.
        for (outputs, inputs, tool_off, water_off) in [
            (0b0_0000, 0b0001, true, true),
            (0b1_0000, 0b0001, false, true),
            (0b0_0000, 0b0101, false, true),
            (0b0_0010, 0b0001, true, false),
            (0b0_0000, 0b0000, true, false),
        ] {
            let state = State { outputs, inputs, ..crate::daemon::tests::standing_state() };
            let found = (wiring.tool_is_off(&state), wiring.water_is_off(&state));
            assert_eq!(found, (tool_off, water_off), "Out {outputs:05b}, In {inputs:04b}");
        }
    }

    /// A broken wire of `tool_running` looks like a stopped tool. With the additional feedback `tool_stands`, "off" is
    /// proven by a signal that is present.
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
            let state = State { inputs, ..crate::daemon::tests::standing_state() };
            assert_eq!((one.tool_is_off(&state), both.tool_is_off(&state)), (by_one, by_both), "{inputs:05b}");
        }
        let runs = |inputs| {
            both.switch_proof(Switch::ToolOn).is_satisfied(&State {
                inputs,
                outputs: 0b1_0000,
                ..crate::daemon::tests::standing_state()
            })
        };
        assert_eq!([runs(0b0_0100), runs(0b1_0100)], [true, false]);
    }

    #[test]
    fn a_missing_name_is_named() {
        let text = IO.replace("tool_running = 20\n", "");
        let cell = Cell::check("cell.toml", &text).expect("good");
        let error = Wiring::from_io(cell.inputs_outputs()).expect_err("missing");
        assert!(matches!(error, DaemonError::NotWired { table: "io.feedbacks", name: "tool_running" }), "{error}");
    }
}
