//! Limits for messages from a broker: a flood neither fills the audit trail nor uses up the loop's turns, and never
//! swallows a stop.

use super::command::NodeCommand;
use crate::accounts::MostLines;
use std::collections::BTreeMap;

/// The shortest time between two passings of the same command, ms. An earlier one is passed on when that time is
/// over: no stop is lost.
const MIN_INTERVAL_MS: u64 = 1_000;
/// Lines of the audit trail in a minute: of what was done, and of what was refused.
pub(super) const LINES: MostLines = MostLines { done: 60, refused: 20 };

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
            Some(passed) if now_ms.saturating_sub(passed.at_ms) < MIN_INTERVAL_MS => {
                passed.waits = true;
                false
            }
            _ => {
                self.0.insert(command, Passed { at_ms: now_ms, waits: false });
                true
            }
        }
    }

    /// The commands that have waited long enough.
    pub fn due(&mut self, now_ms: u64) -> Vec<NodeCommand> {
        let is_due = |passed: &Passed| passed.waits && now_ms.saturating_sub(passed.at_ms) >= MIN_INTERVAL_MS;
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
