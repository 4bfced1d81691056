//! Commands to the edge node: the requests in a message on its command topic, and which requests are refused.
//!
//! The number of messages from a broker is limited: a flood of messages neither fills the audit trail nor blocks the
//! control loop, and a stop within a flood is not lost.

use super::metrics::{METRICS, alias};
use super::payload::{Metric, Payload, WireType};
use panelprep_cell::accounts::MaxLinesPerMinute;
use panelprep_cell::cycle::Request;
use prost::Message as _;
use std::collections::BTreeMap;
use strum::VariantArray;

/// A command that a host application may send. No command starts a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, VariantArray)]
pub enum NodeCommand {
    /// Publish all values again.
    Rebirth,
    /// Hold the cycle.
    Hold,
    /// Stop the cycle.
    Stop,
    /// Abort the cycle.
    Abort,
}

impl NodeCommand {
    /// Returns the name of the command's metric.
    pub fn name(self) -> &'static str {
        match self {
            NodeCommand::Rebirth => "Node Control/Rebirth",
            NodeCommand::Hold => "Node Control/Hold",
            NodeCommand::Stop => "Node Control/Stop",
            NodeCommand::Abort => "Node Control/Abort",
        }
    }

    /// Returns the command's keyword in the audit trail.
    pub fn keyword(self) -> &'static str {
        match self {
            NodeCommand::Rebirth => "rebirth",
            NodeCommand::Hold => "hold",
            NodeCommand::Stop => "stop",
            NodeCommand::Abort => "abort",
        }
    }

    /// Returns the alias of the command's metric. The specification forbids an alias for a rebirth.
    pub fn alias(self) -> Option<u64> {
        match self {
            NodeCommand::Rebirth => None,
            NodeCommand::Hold => Some(1_001),
            NodeCommand::Stop => Some(1_002),
            NodeCommand::Abort => Some(1_003),
        }
    }

    /// Returns the corresponding request to the cycle's state table; `None` for a rebirth.
    pub fn request(self) -> Option<Request> {
        match self {
            NodeCommand::Rebirth => None,
            NodeCommand::Hold => Some(Request::Hold),
            NodeCommand::Stop => Some(Request::Stop),
            NodeCommand::Abort => Some(Request::Abort),
        }
    }

    /// Returns the available commands: all commands if commands are permitted, otherwise only the rebirth.
    pub(super) fn offered_commands(commands_allowed: bool) -> impl Iterator<Item = NodeCommand> {
        let is_offered = move |command: &NodeCommand| commands_allowed || *command == NodeCommand::Rebirth;
        NodeCommand::VARIANTS.iter().copied().filter(is_offered)
    }
}

/// The reason why a command message, or a part of it, is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CommandError {
    /// The message is not a Sparkplug B payload.
    #[error("the message is not a Sparkplug B payload: {problem}")]
    NotAPayload {
        /// The problem in the message.
        problem: String,
    },
    /// The message has too many metrics.
    #[error("the message has {found} metrics (limit {MAX_METRICS})")]
    TooMany {
        /// Number of metrics in the message.
        found: usize,
    },
    /// The message contains no metric.
    #[error("the message has no metric; write true to one of: {allowed}")]
    Empty {
        /// The names of the metrics that may be written.
        allowed: String,
    },
    /// The metric does not exist, or is read-only.
    #[error("the metric {found} cannot be written; valid: {allowed}")]
    NotWritten {
        /// The metric's name or alias.
        found: String,
        /// The names of the metrics that may be written.
        allowed: String,
    },
    /// The cell's file does not permit commands.
    #[error("{name} is not permitted by [sparkplug] commands in the cell's file")]
    NotPermitted {
        /// The name of the command's metric.
        name: &'static str,
    },
    /// The value is not true.
    #[error("the value of {name} is not valid; valid: the Boolean true")]
    NotTrue {
        /// The name of the command's metric.
        name: &'static str,
    },
}

/// Maximum number of metrics in a command message; a host application needs far fewer.
const MAX_METRICS: usize = 32;
/// Maximum number of characters of a received name in the audit trail.
const MAX_REPORTED_NAME_CHARACTERS: usize = 80;

/// Returns the commands in a message in their order, or for each refused one the reason.
pub fn commands(bytes: &[u8], commands_allowed: bool) -> Vec<Result<NodeCommand, CommandError>> {
    let payload = match Payload::decode(bytes) {
        Ok(payload) => payload,
        Err(error) => return vec![Err(CommandError::NotAPayload { problem: error.to_string() })],
    };
    if payload.metrics.is_empty() {
        return vec![Err(CommandError::Empty { allowed: describe_allowed(commands_allowed) })];
    }
    if payload.metrics.len() > MAX_METRICS {
        return vec![Err(CommandError::TooMany { found: payload.metrics.len() })];
    }
    payload.metrics.iter().map(|metric| command(metric, commands_allowed)).collect()
}

fn command(metric: &Metric, commands_allowed: bool) -> Result<NodeCommand, CommandError> {
    let is_meant = |command: &&NodeCommand| match (&metric.name, metric.alias) {
        // If both name and alias are given, they must belong to the same command.
        (Some(name), Some(alias)) => command.name() == name && command.alias() == Some(alias),
        (Some(name), None) => command.name() == name,
        (None, alias) => alias.is_some() && command.alias() == alias,
    };
    let Some(command) = NodeCommand::VARIANTS.iter().find(is_meant).copied() else {
        return Err(CommandError::NotWritten {
            found: describe(metric),
            allowed: describe_allowed(commands_allowed),
        });
    };
    let name = command.name();
    if !NodeCommand::offered_commands(commands_allowed).any(|offered| offered == command) {
        return Err(CommandError::NotPermitted { name });
    }
    match metric.value {
        Some(WireType::Boolean(true)) if metric.is_null != Some(true) => Ok(command),
        _ => Err(CommandError::NotTrue { name }),
    }
}

fn describe_allowed(commands_allowed: bool) -> String {
    NodeCommand::offered_commands(commands_allowed).map(NodeCommand::name).collect::<Vec<_>>().join(", ")
}

/// Returns how a message for people names a metric; a long name is truncated.
fn describe(metric: &Metric) -> String {
    let of_alias = |number: u64| METRICS.iter().enumerate().find(|(place, _)| alias(*place) == number);
    match (&metric.name, metric.alias) {
        (Some(name), _) => {
            let name: String = name.chars().take(MAX_REPORTED_NAME_CHARACTERS).collect();
            format!("\"{}\"", name.escape_debug())
        }
        (None, Some(number)) => match of_alias(number) {
            Some((_, known)) => format!("\"{}\", which is read-only", known.name),
            None => format!("with the alias {number}"),
        },
        (None, None) => "without a name or an alias".to_owned(),
    }
}

/// Minimum interval between two commands of the same kind, ms. A command that arrives earlier is delayed, so that no
/// stop is lost.
const MIN_INTERVAL_MS: u64 = 1_000;
/// Maximum number of audit entries per minute, for performed and for refused commands.
pub(super) const MAX_AUDIT_LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 60, refused: 20 };

/// For each command, the time at which it was last passed on, and whether another one is delayed.
#[derive(Debug, Clone, Default)]
pub(super) struct CommandLimit(BTreeMap<NodeCommand, LastPassed>);

#[derive(Debug, Clone, Copy)]
struct LastPassed {
    at_ms: u64,
    waits: bool,
}

impl CommandLimit {
    /// Returns whether this command may be passed on now; otherwise it is delayed.
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

    /// Returns the delayed commands whose interval has ended, and records them as passed on.
    pub fn due_commands(&mut self, now_ms: u64) -> Vec<NodeCommand> {
        let is_due = |passed: &LastPassed| passed.waits && now_ms.saturating_sub(passed.at_ms) >= MIN_INTERVAL_MS;
        let due: Vec<_> = self.0.iter().filter(|(_, passed)| is_due(passed)).map(|(command, _)| *command).collect();
        for command in &due {
            self.0.insert(*command, LastPassed { at_ms: now_ms, waits: false });
        }
        due
    }

    /// Returns whether this command is delayed.
    pub fn is_waiting(&self, command: NodeCommand) -> bool {
        self.0.get(&command).is_some_and(|passed| passed.waits)
    }

    /// Discards this delayed command.
    pub fn forget(&mut self, command: NodeCommand) {
        if let Some(passed) = self.0.get_mut(&command) {
            passed.waits = false;
        }
    }

    /// Discards all delayed commands. The times at which commands were last passed on are kept.
    pub fn clear(&mut self) {
        for passed in self.0.values_mut() {
            passed.waits = false;
        }
    }
}
