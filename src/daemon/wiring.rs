//! Switches by the names of the cell's inputs and outputs.

use super::DaemonError;
use crate::cell::{InputsOutputs, Output};
use crate::cycle::Switch;
use crate::eki::{Signal, State};

/// The output that washes off the dust, where there is one of its own.
pub(super) const RINSE: &str = "rinse";

/// An output with the bit of the feedback that proves it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Wire {
    output: u16,
    feedback: Option<u32>,
}

/// The cell's outputs and feedbacks that the cycle needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wiring {
    light: Wire,
    spray: Wire,
    rinse: Wire,
    shutter: Wire,
    extraction: Wire,
    tool: Wire,
}

/// What a switch sets, and what then must be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Setting {
    pub signals: Vec<Signal>,
    pub feedback: Option<(u32, bool)>,
}

impl Wiring {
    /// Takes `light`, `spray`, `lens_shutter`, `extraction` and `tool` with the feedbacks `water_off`, `lens_shut`,
    /// `extraction_flow` and `tool_running`; an output `rinse` where there is one, else the spray rinses.
    ///
    /// # Errors
    /// Where the cell has no such name.
    pub fn of(io: &InputsOutputs) -> Result<Self, DaemonError> {
        let number = |output: Output| {
            let name = output.name();
            io.output(output).ok_or(DaemonError::NotWired { table: "io.outputs", name })
        };
        let proven = |output: Output| -> Result<Wire, DaemonError> {
            let name = output.feedback().name();
            let bit = io.feedback_bit(output.feedback());
            let bit = bit.ok_or(DaemonError::NotWired { table: "io.feedbacks", name })?;
            Ok(Wire { output: number(output)?, feedback: Some(bit) })
        };
        let spray = proven(Output::Spray)?;
        Ok(Wiring {
            light: Wire { output: number(Output::Light)?, feedback: None },
            spray,
            rinse: io.outputs().get(RINSE).map_or(spray, |rinse| Wire { output: *rinse, ..spray }),
            shutter: proven(Output::LensShutter)?,
            extraction: proven(Output::Extraction)?,
            tool: proven(Output::Tool)?,
        })
    }

    pub(super) fn setting(&self, switch: Switch) -> Setting {
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
            Switch::WaterOff => return self.water_off(),
        };
        let water = matches!(switch, Switch::Rinse | Switch::Spray);
        // Water is fed back by what is off.
        let feedback = wire.feedback.map(|bit| (bit, on != water));
        let mut signals = vec![Signal { number: wire.output, on }];
        // One feedback tells of both nozzles: what flows from the other one must not pass for this one's.
        let other = if switch == Switch::Rinse { self.spray.output } else { self.rinse.output };
        if water && other != wire.output {
            signals.insert(0, Signal { number: other, on: false });
        }
        Setting { signals, feedback }
    }

    fn water_off(&self) -> Setting {
        let mut numbers = vec![self.spray.output, self.rinse.output];
        numbers.dedup();
        let signals = numbers.into_iter().map(|number| Signal { number, on: false }).collect();
        Setting { signals, feedback: self.spray.feedback.map(|bit| (bit, true)) }
    }

    pub(super) fn water_is_off(&self, state: &State) -> bool {
        self.spray.feedback.is_none_or(|bit| reads(state, bit))
    }

    pub(super) fn tool_is_off(&self, state: &State) -> bool {
        self.tool.feedback.is_none_or(|bit| !reads(state, bit))
    }
}

/// Whether this mapped input is on.
pub(super) fn reads(state: &State, bit: u32) -> bool {
    state.inputs >> bit & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;

    const IO: &str = "[io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
                      [io.feedbacks]\nwater_off = 17\nlens_shut = 18\nextraction_flow = 25\ntool_running = 20\n";

    #[test]
    fn feedbacks_are_bits_in_the_order_of_their_numbers() {
        let cell = Cell::check("cell.toml", IO).expect("good");
        let wiring = Wiring::of(cell.io()).expect("complete");
        let signal = |number, on| vec![Signal { number, on }];
        let on = wiring.setting(Switch::ToolOn);
        assert_eq!(on, Setting { signals: signal(5, true), feedback: Some((2, true)) }, "17, 18, 20, 25");
        let flow = wiring.setting(Switch::ExtractionOn);
        assert_eq!(flow, Setting { signals: signal(4, true), feedback: Some((3, true)) });
        let spray = wiring.setting(Switch::Spray);
        assert_eq!(spray, Setting { signals: signal(2, true), feedback: Some((0, false)) });
        let off = wiring.setting(Switch::WaterOff);
        assert_eq!(off, Setting { signals: signal(2, false), feedback: Some((0, true)) });
    }

    /// A rinse of its own would else stay open, and its water prove a spray valve that does not open.
    #[test]
    fn each_water_switches_the_other_one_off() {
        let text = IO.replace("spray = 2", "spray = 2\nrinse = 6");
        let wiring = Wiring::of(Cell::check("cell.toml", &text).expect("good").io()).expect("complete");
        let signals = |switch| wiring.setting(switch).signals.into_iter().map(|signal| (signal.number, signal.on));
        assert_eq!(signals(Switch::Spray).collect::<Vec<_>>(), [(6, false), (2, true)]);
        assert_eq!(signals(Switch::Rinse).collect::<Vec<_>>(), [(2, false), (6, true)]);
        assert_eq!(signals(Switch::WaterOff).collect::<Vec<_>>(), [(2, false), (6, false)]);
    }

    #[test]
    fn a_missing_name_is_named() {
        let text = IO.replace("tool_running = 20\n", "");
        let cell = Cell::check("cell.toml", &text).expect("good");
        let error = Wiring::of(cell.io()).expect_err("missing");
        assert!(matches!(error, DaemonError::NotWired { table: "io.feedbacks", name: "tool_running" }), "{error}");
    }
}
