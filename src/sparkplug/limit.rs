//! Limits for what a broker sends: a flood neither fills the audit trail nor takes the loop's turns, and never swallows a stop.

use super::command::NodeCommand;
use std::collections::BTreeMap;

/// The same command is passed on at most so often, ms. One that comes earlier is passed on when that time is over: nothing that stops is
/// lost.
const EVERY_MS: u64 = 1_000;
/// Lines of the audit trail in a minute: of what was done, and of what was refused.
const MOST_DONE: u32 = 60;
const MOST_REFUSED: u32 = 20;
const MINUTE_MS: u64 = 60_000;

/// When each command was passed on last, and which wait.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandLimit(BTreeMap<NodeCommand, Passed>);

#[derive(Debug, Clone, Copy)]
struct Passed {
    at_ms: u64,
    waits: bool,
}

impl CommandLimit {
    /// Whether this command is passed on now; else it waits.
    pub fn asked(&mut self, command: NodeCommand, now_ms: u64) -> bool {
        match self.0.get_mut(&command) {
            Some(passed) if now_ms.saturating_sub(passed.at_ms) < EVERY_MS => {
                passed.waits = true;
                false
            }
            _ => {
                self.0.insert(command, Passed { at_ms: now_ms, waits: false });
                true
            }
        }
    }

    /// Commands whose waiting is over.
    pub fn due(&mut self, now_ms: u64) -> Vec<NodeCommand> {
        let is_due = |passed: &Passed| passed.waits && now_ms.saturating_sub(passed.at_ms) >= EVERY_MS;
        let due: Vec<_> = self.0.iter().filter(|(_, passed)| is_due(passed)).map(|(command, _)| *command).collect();
        for command in &due {
            self.0.insert(*command, Passed { at_ms: now_ms, waits: false });
        }
        due
    }

    /// Whether this command waits.
    pub fn waits(&self, command: NodeCommand) -> bool {
        self.0.get(&command).is_some_and(|passed| passed.waits)
    }

    /// Nothing of this command is left to do.
    pub fn forget(&mut self, command: NodeCommand) {
        if let Some(passed) = self.0.get_mut(&command) {
            passed.waits = false;
        }
    }

    /// Nothing of any command is left to do. When each was passed on last stays known.
    pub fn forget_all(&mut self) {
        for passed in self.0.values_mut() {
            passed.waits = false;
        }
    }
}

/// How many lines were written in this minute, and how many were not.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LineLimit {
    since_ms: u64,
    done: u32,
    refused: u32,
    left_out: u64,
}

impl LineLimit {
    /// Whether this line is written; else it is counted.
    pub fn allows(&mut self, is_refused: bool) -> bool {
        let (count, most) =
            if is_refused { (&mut self.refused, MOST_REFUSED) } else { (&mut self.done, MOST_DONE) };
        let is_allowed = *count < most;
        if is_allowed {
            *count += 1;
        } else {
            self.left_out += 1;
        }
        is_allowed
    }

    /// At the end of a minute: how many lines were left out of it, if any.
    pub fn minute_over(&mut self, now_ms: u64) -> Option<u64> {
        if now_ms.saturating_sub(self.since_ms) < MINUTE_MS {
            return None;
        }
        let left_out = self.left_out;
        *self = LineLimit { since_ms: now_ms, ..LineLimit::default() };
        (left_out > 0).then_some(left_out)
    }
}
