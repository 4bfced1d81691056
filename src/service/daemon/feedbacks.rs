//! Monitors the proven facts about the outputs while the state table relies on them (R21).
//!
//! Each fact of the state table about an output was proven when it was switched: the controller reported the output,
//! and the feedback reported its effect. While the fact holds, each state of the robot must report the same. If the
//! states report something else for [`CONTRADICTION_LIMIT_MS`], the state table is informed. The work in progress is held,
//! the tool is lifted off the panel, and the output is proven again before it is needed. A shorter time is tolerated
//! because feedbacks are not steady: a flow switch flutters, and a sander slows down when it touches the panel. An
//! output that is being switched is monitored by its own act.

use super::wiring::{SwitchFeedback, Wiring};
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{Feedback, Output};
use panelprep_cell::cycle::{Facts, Switch};
use panelprep_kuka::eki::State;

/// The time for which states may contradict a proven fact, ms.
const CONTRADICTION_LIMIT_MS: u32 = 500;

/// An output whose proof is contradicted, and since when, by the controller's clock, ms.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FeedbackContradiction(Option<(Switch, u32)>);

impl FeedbackContradiction {
    /// Returns the output that the robot's states have contradicted for too long, including this state.
    pub(super) fn update(&mut self, wiring: &Wiring, facts: &Facts, state: &State) -> Option<Switch> {
        let now_ms = state.time_ms;
        // Judged only while the state is proven: during a switch the feedback is expected to differ.
        let contrary = facts.proven_switches().find(|switch| !wiring.switch_proof(*switch).is_satisfied(state));
        // If the clock was set back, the time is counted again from the beginning.
        let last = self.0.filter(|(last, since_ms)| Some(*last) == contrary && *since_ms <= now_ms);
        self.0 = contrary.map(|switch| (switch, last.map_or(now_ms, |(_, since_ms)| since_ms)));
        let (switch, since_ms) = self.0?;
        (now_ms - since_ms >= CONTRADICTION_LIMIT_MS).then_some(switch)
    }
}

/// Describes the effect of a switch, and the names of the output and the feedback that proved it.
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

/// Describes what the state reports about a switch's output and feedback.
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

/// Returns the reason: which proven fact is not true any more, and what to check.
pub(super) fn contrary_reason(switch: Switch, wiring: &Wiring, state: &State) -> Reason {
    let ((was_proven, _), tells) = (describe_switch(switch), describe_state(switch, wiring, state));
    let contrary_s = f64::from(CONTRADICTION_LIMIT_MS) / 1_000.0;
    let message = format!(
        "expected: {was_proven}; the controller has reported a different state for {contrary_s:.1} s: {tells}"
    );
    Reason::new("feedback", message)
}

/// Returns the reason: what was commanded and not proven by its deadline, and what to check. `None` if the state
/// reports it by now.
pub(super) fn unproven_reason(switch: Switch, wiring: &Wiring, state: &State) -> Option<Reason> {
    if wiring.switch_proof(switch).is_satisfied(state) {
        return None;
    }
    let ((is_asked, _), tells) = (describe_switch(switch), describe_state(switch, wiring, state));
    let message = format!("commanded: {is_asked}; the controller did not confirm it in time: {tells}");
    Some(Reason::new("feedback", message))
}

#[cfg(test)]
mod tests {
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

    /// The text states what was proven, and whether the output or the feedback contradicts it.
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
