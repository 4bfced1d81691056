//! The outputs of the controller: commands switch them, and the end of an epoch switches some of them off, timed by the
//! controller's own clock.

use super::model::Controller;
use super::options::Rule;

/// Time for which an output is kept off after its automatic switch-off, ms: if it is switched on in this time, it is
/// switched off again.
const FORCED_OFF_DURATION_MS: u64 = 1_000;

impl Controller {
    /// Switches an output, as a person does on the teach pendant.
    pub fn switch_output(&mut self, number: u16, on: bool) {
        self.set_output(number, on);
    }

    pub(super) fn set_output(&mut self, number: u16, value: bool) {
        if self.outputs.insert(number, value).unwrap_or(false) != value {
            self.world.on_output(number, value, self.now_ms);
        }
    }

    /// Sets the outputs to a production line; the lowest bit is the first output.
    pub(super) fn set_line_outputs(&mut self, bits: i32) {
        for (place, number) in self.setup.line_outputs.into_iter().enumerate() {
            if number > 0 {
                self.set_output(number, bits >> place & 1 == 1);
            }
        }
    }

    /// Returns whether an output is on that the end of an epoch switches off without delay, such as tool or water.
    pub(super) fn has_harmful_output_on(&self) -> bool {
        let mut at_once = self.setup.off_delays_ms.iter().filter(|(_, after_ms)| **after_ms == 0);
        at_once.any(|(number, _)| self.outputs.get(number) == Some(&true))
    }

    /// Switches off those outputs of the automatic switch-off whose delay satisfies this condition.
    pub(super) fn switch_off_outputs(&mut self, is_over: impl Fn(u64) -> bool) {
        if self.setup.omitted_rule == Some(Rule::OutputsOff) {
            return;
        }
        let over = self.setup.off_delays_ms.iter().filter(|(_, after_ms)| is_over(**after_ms));
        let on = over.map(|(number, _)| *number).filter(|number| self.outputs.get(number) == Some(&true));
        let on: Vec<u16> = on.collect();
        on.into_iter().for_each(|number| self.set_output(number, false));
    }

    /// Switches off each output of the automatic switch-off when its delay after the end of an epoch has passed, and
    /// keeps it off for some time.
    pub(super) fn switch_off_due_outputs(&mut self) {
        if self.epoch.open || self.setup.omitted_rule == Some(Rule::OutputsOff) {
            return;
        }
        let since_ms = self.now_ms - self.ended_ms;
        for (number, after_ms) in self.setup.off_delays_ms.clone() {
            if since_ms >= after_ms && self.pending_off_outputs.contains(&number) {
                if self.outputs.get(&number) == Some(&true) {
                    self.set_output(number, false);
                }
                if since_ms >= after_ms + FORCED_OFF_DURATION_MS {
                    self.pending_off_outputs.remove(&number);
                }
            }
        }
    }
}
