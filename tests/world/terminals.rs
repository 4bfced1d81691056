//! The devices at the controller's terminals: light, spray, lens, extraction and tool with their feedbacks. Outputs
//! that must never be on together are checked on the outputs themselves.

use panelprep::devices::mock;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

const LIGHT: u16 = 1;
const SPRAY: u16 = 2;
const LENS: u16 = 3;
const EXTRACTION: u16 = 4;
const TOOL: u16 = 5;
/// Delay between an output and its feedback, ms.
const FEEDBACK_DELAY_MS: u64 = 150;

/// The outputs and their effects.
#[derive(Debug, Default)]
pub struct Around {
    /// The value of each output, and the time since which it has this value, ms.
    outputs: BTreeMap<u16, (bool, u64)>,
    /// An input that does not follow its output: its number, its value, and the time until which this lasts, ms.
    pub stuck: Option<(u16, bool, u64)>,
    /// Time at which the water was last switched on, and time at which it was switched off, ms.
    pub water: Option<(u64, Option<u64>)>,
    /// Actions that violated a requirement.
    pub wrong: Vec<String>,
}

impl Around {
    /// Returns whether this output has been on, or off, long enough for its feedback to report it.
    fn runs(&self, output: u16, now_ms: u64) -> bool {
        let (on, since_ms) = self.outputs.get(&output).copied().unwrap_or((false, 0));
        let followed = now_ms >= since_ms + FEEDBACK_DELAY_MS || since_ms == 0;
        on == followed
    }

    /// Returns whether this output is on.
    pub fn is_on(&self, output: u16) -> bool {
        self.outputs.get(&output).is_some_and(|(on, _)| *on)
    }

    /// Returns whether the lens is shut.
    pub fn is_lens_shut(&self, now_ms: u64) -> bool {
        self.runs(LENS, now_ms)
    }

    /// Returns whether the light has been on for half a second, which it needs to reach its brightness.
    pub fn is_lit(&self, now_ms: u64) -> bool {
        self.outputs.get(&LIGHT).is_some_and(|(on, since_ms)| *on && now_ms >= since_ms + 500)
    }

    /// Returns whether the feedback of the tool or of the extraction is off.
    pub fn is_dead(&self, now_ms: u64) -> bool {
        [3, 4].into_iter().any(|input| self.reads(input, now_ms) == Some(false))
    }

    fn reads(&self, input: u16, now_ms: u64) -> Option<bool> {
        if let Some((stuck, on, until_ms)) = self.stuck
            && stuck == input
            && now_ms < until_ms
        {
            return Some(on);
        }
        Some(match input {
            1 => !self.runs(SPRAY, now_ms),
            2 => self.runs(LENS, now_ms),
            3 => self.runs(EXTRACTION, now_ms),
            4 => self.runs(TOOL, now_ms),
            5 => self.is_lit(now_ms),
            _ => return None,
        })
    }

    fn switched(&mut self, output: u16, on: bool, now_ms: u64) {
        self.outputs.insert(output, (on, now_ms));
        // A wrong feedback may lead to outputs that must not be on together.
        let is_lied_to = self.stuck.is_some_and(|(.., until_ms)| now_ms < until_ms + 30_000);
        match (output, on) {
            (SPRAY, true) => {
                self.water = Some((now_ms, None));
                let to_lens = !self.runs(LENS, now_ms);
                let to_tool = self.is_on(TOOL);
                if (to_lens || to_tool) && !is_lied_to {
                    self.wrong.push(format!("{now_ms} ms: water, lens open {to_lens}, tool on {to_tool}"));
                }
            }
            (SPRAY, false) => {
                if let Some((_, off_ms)) = &mut self.water {
                    off_ms.get_or_insert(now_ms);
                }
            }
            (TOOL, true) => {
                let in_water = self.is_on(SPRAY);
                let in_dust = !self.runs(EXTRACTION, now_ms);
                if (in_water || in_dust) && !is_lied_to {
                    self.wrong
                        .push(format!("{now_ms} ms: tool, in water {in_water}, without extraction {in_dust}"));
                }
            }
            _ => {}
        }
    }
}

/// The controller's side of the terminals.
pub struct Terminals(pub Arc<Mutex<Around>>);

impl mock::World for Terminals {
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).switched(number, value, time_ms);
    }

    fn input(&self, number: u16, time_ms: u64) -> Option<bool> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).reads(number, time_ms)
    }
}
