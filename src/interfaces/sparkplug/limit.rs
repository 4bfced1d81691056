//! Limits for messages from a broker: a flood neither fills the audit trail nor uses up the loop's turns, and no stop
//! is lost in it.

use super::command::NodeCommand;
use panelprep_cell::accounts::MaxLinesPerMinute;
use std::collections::BTreeMap;

/// Shortest time after which the same command is passed on again, ms. A command that arrives earlier waits until this
/// time is over: no stop is lost.
const MIN_INTERVAL_MS: u64 = 1_000;
/// Limits of lines in the audit trail per minute: for executed and for refused commands.
pub(super) const LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 60, refused: 20 };

/// The time when each command was last passed on, and whether it waits.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandLimit(BTreeMap<NodeCommand, LastPassed>);

#[derive(Debug, Clone, Copy)]
struct LastPassed {
    at_ms: u64,
    waits: bool,
}

impl CommandLimit {
    /// Returns whether this command is passed on now; otherwise it waits.
    pub fn admit(&mut self, command: NodeCommand, now_ms: u64) -> bool {
        match self.0.get_mut(&command) {
            Some(passed) if now_ms.saturating_sub(passed.at_ms) < MIN_INTERVAL_MS => {
                passed.waits = true;
                false
            }
            _ => {
                self.0.insert(command, LastPassed { at_ms: now_ms, waits: false });
                true
            }
        }
    }

    /// The commands that have waited long enough.
    pub fn due_commands(&mut self, now_ms: u64) -> Vec<NodeCommand> {
        let is_due = |passed: &LastPassed| passed.waits && now_ms.saturating_sub(passed.at_ms) >= MIN_INTERVAL_MS;
        let due: Vec<_> = self.0.iter().filter(|(_, passed)| is_due(passed)).map(|(command, _)| *command).collect();
        for command in &due {
            self.0.insert(*command, LastPassed { at_ms: now_ms, waits: false });
        }
        due
    }

    /// Returns whether this command waits.
    pub fn is_waiting(&self, command: NodeCommand) -> bool {
        self.0.get(&command).is_some_and(|passed| passed.waits)
    }

    /// Cancels the waiting of this command.
    pub fn forget(&mut self, command: NodeCommand) {
        if let Some(passed) = self.0.get_mut(&command) {
            passed.waits = false;
        }
    }

    /// Cancels the waiting of all commands. The times when they were last passed on are kept.
    pub fn clear(&mut self) {
        for passed in self.0.values_mut() {
            passed.waits = false;
        }
    }
}
