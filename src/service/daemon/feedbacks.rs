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
mod tests;
