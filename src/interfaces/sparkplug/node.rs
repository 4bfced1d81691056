//! The edge node: its messages to the broker, and how it handles received messages. It converts events to actions,
//! without sockets and clocks.
//!
//! ```text
//! Connecting ─ Connected ─ (primary host online) ─ NBIRTH ─ NDATA at each change ─ NDEATH
//! ```
//!
//! The death message is registered at the broker as the will of the connection, before any other message. It has the
//! same number (`bdSeq`) as the birth messages of this connection. `seq` counts birth and data messages from 0 to 255,
//! then again from 0.
//!
//! If a primary host application is configured, nothing is published while it is offline.

use super::command::{CommandLimit, MAX_AUDIT_LINES, NodeCommand, commands};
use super::metrics::{METRICS, alias};
use super::payload::{CellIds, DataType, Metric, Payload, Value};
use panelprep_cell::accounts::LineLimit;
use prost::Message as _;
use serde::Deserialize;

/// The settings of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeSetup {
    /// The names of the node.
    pub ids: CellIds,
    /// Whether the commands hold, stop and abort are permitted.
    pub commands_allowed: bool,
    /// Whether data messages use aliases. Some host applications do not support aliases; each message then contains
    /// names and data types.
    pub aliases: bool,
}

/// The present time of the wall clock and of a monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeTime {
    /// Time of the wall clock, ms since 1970, UTC.
    pub unix_ms: u64,
    /// Time of the monotonic clock, ms since an arbitrary moment.
    pub steady_ms: u64,
}

/// An event for the node.
#[derive(Debug, Clone, PartialEq)]
pub enum NodeEvent<'m> {
    /// A connection to the broker begins, with [`EdgeNode::last_will`] as its will.
    Connecting,
    /// The broker has accepted all subscriptions.
    Subscribed,
    /// The connection was lost.
    Lost,
    /// The values of the cell were read, in the order of [`METRICS`].
    Seen(Vec<Value>),
    /// The broker delivered a message.
    Received {
        /// The topic of the message.
        topic: &'m str,
        /// The content of the message.
        payload: &'m [u8],
        /// Whether the message was retained by the broker, so that it may be old.
        is_retained: bool,
    },
    /// The program ends.
    Leaving,
}

/// An action that the owner of the connection must perform.
#[derive(Debug, Clone, PartialEq)]
pub enum NodeAction {
    /// Publish this message without the retain flag.
    Publish(Message),
    /// Send a command to the cell. It is the same request, with the same checks, as through any other interface.
    Ask {
        /// The requested command.
        command: NodeCommand,
        /// Whether the result is recorded in the audit trail.
        is_noted: bool,
    },
    /// Write an entry to the audit trail.
    Note(AuditNote),
    /// Disconnect after all published messages are sent, and connect again.
    Disconnect,
}

/// A message to the broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// The topic of the message.
    pub topic: String,
    /// The content of the message.
    pub payload: Vec<u8>,
    /// The quality of service: 0 for birth and data messages, 1 for a death message.
    pub qos: u8,
}

/// An entry of the audit trail, without time and address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditNote {
    /// The action that was attempted.
    pub what: String,
    /// The object of the attempted action.
    pub subject: Option<String>,
    /// The reason why the action was refused; `None` if it was performed.
    pub refused: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NodeSession {
    Offline,
    /// The subscriptions were accepted; nothing has been published yet.
    Waiting,
    Born,
}

/// An edge node of MQTT Sparkplug.
#[derive(Debug, Clone)]
pub struct EdgeNode {
    setup: NodeSetup,
    session: NodeSession,
    /// The number of the connection (`bdSeq`), 0 to 255; `None` before the first connection.
    bd_seq: Option<u8>,
    /// The sequence number of the next message.
    seq: u8,
    host: PrimaryHost,
    /// The values of the cell that were last read.
    last_values: Option<Vec<Value>>,
    /// The values that were last published.
    published: Vec<Value>,
    commands: CommandLimit,
    lines: LineLimit,
}

impl EdgeNode {
    /// Creates a node without a connection.
    pub fn new(setup: NodeSetup) -> Self {
        EdgeNode {
            setup,
            session: NodeSession::Offline,
            bd_seq: None,
            seq: 0,
            host: PrimaryHost::default(),
            last_values: None,
            published: Vec::new(),
            commands: CommandLimit::default(),
            lines: LineLimit::new(MAX_AUDIT_LINES, 0),
        }
    }

    /// Returns the topics to subscribe to, each with quality of service 1.
    pub fn subscriptions(&self) -> Vec<String> {
        let ids = &self.setup.ids;
        [Some(ids.command_topic()), ids.state()].into_iter().flatten().collect()
    }

    /// Returns the death message of this connection. It is the will of the connection; the node also publishes it
    /// before it disconnects.
    pub fn last_will(&self, now: NodeTime) -> Message {
        let payload = Payload {
            timestamp: Some(now.unix_ms),
            metrics: vec![self.bd_seq(now)],
            seq: None, // not known beforehand
        };
        Message { topic: self.setup.ids.death_topic(), payload: payload.encode_to_vec(), qos: 1 }
    }

    /// Returns whether a birth message was published on this connection.
    pub fn has_published_birth(&self) -> bool {
        self.session == NodeSession::Born
    }

    /// Returns whether a rebirth is pending; no data messages are published until then.
    pub fn is_rebirth_pending(&self) -> bool {
        self.commands.is_waiting(NodeCommand::Rebirth)
    }

    /// Handles an event, and returns the resulting actions.
    pub fn step(&mut self, event: NodeEvent<'_>, now: NodeTime) -> Vec<NodeAction> {
        let mut acts = match event {
            NodeEvent::Connecting => {
                self.bd_seq = Some(self.bd_seq.map_or(0, |last| last.wrapping_add(1)));
                (self.session, self.host) = (NodeSession::Offline, self.host.connected());
                vec![]
            }
            NodeEvent::Subscribed => {
                self.session = NodeSession::Waiting;
                vec![]
            }
            NodeEvent::Lost => {
                self.session = NodeSession::Offline;
                // Delayed commands are discarded with their connection: a command must not be executed minutes later.
                self.commands.clear();
                vec![]
            }
            NodeEvent::Seen(values) => {
                self.last_values = Some(values);
                self.after_minimum_interval(now)
            }
            NodeEvent::Received { topic, payload, is_retained } => {
                self.received((topic, payload, is_retained), now)
            }
            NodeEvent::Leaving => self.end_session(now),
        };
        acts.extend(self.next_message(now));
        acts
    }

    fn bd_seq(&self, now: NodeTime) -> Metric {
        let number = Value::as_integer(self.bd_seq);
        Metric::new(&number, now.unix_ms).with_name("bdSeq", DataType::Int64)
    }

    /// Returns the next message: a birth message if none was published on this connection, otherwise a data message
    /// with the changed values.
    fn next_message(&mut self, now: NodeTime) -> Option<NodeAction> {
        let may_publish = self.setup.ids.primary_host_id.is_none() || self.host.is_online();
        match self.session {
            NodeSession::Waiting if may_publish => self.birth(now),
            // No data message is published between the request of a rebirth and the birth message.
            NodeSession::Born if !self.is_rebirth_pending() => self.data(now),
            _ => None,
        }
    }

    fn birth(&mut self, now: NodeTime) -> Option<NodeAction> {
        let seen = self.last_values.clone()?;
        let NodeTime { unix_ms, .. } = now;
        let of_cell = METRICS.iter().zip(&seen).enumerate().map(|(place, (metric, value))| {
            self.with_node_alias(
                Metric::new(value, unix_ms).with_name(metric.name, metric.datatype),
                Some(alias(place)),
            )
        });
        let written = NodeCommand::offered_commands(self.setup.commands_allowed).map(|command| {
            let metric = Metric::new(&Value::Truth(false), unix_ms).with_name(command.name(), DataType::Boolean);
            self.with_node_alias(metric, command.alias())
        });
        let metrics: Vec<_> = [self.bd_seq(now)].into_iter().chain(written).chain(of_cell).collect();
        (self.session, self.seq, self.published) = (NodeSession::Born, 0, seen);
        self.commands.forget(NodeCommand::Rebirth);
        Some(self.publish_counted(self.setup.ids.birth_topic(), metrics, now))
    }

    fn data(&mut self, now: NodeTime) -> Option<NodeAction> {
        let seen = self.last_values.as_ref()?;
        let changed = METRICS.iter().zip(seen.iter().zip(&self.published)).enumerate();
        let changed = changed.filter(|(_, (_, (seen, told)))| seen != told).map(|(place, (metric, (value, _)))| {
            let value = Metric::new(value, now.unix_ms);
            match self.setup.aliases {
                true => value.with_alias(alias(place)),
                false => value.with_name(metric.name, metric.datatype),
            }
        });
        let metrics: Vec<_> = changed.collect();
        if metrics.is_empty() {
            return None;
        }
        self.published.clone_from(seen);
        Some(self.publish_counted(self.setup.ids.data_topic(), metrics, now))
    }

    fn with_node_alias(&self, metric: Metric, alias: Option<u64>) -> Metric {
        match alias.filter(|_| self.setup.aliases) {
            Some(alias) => metric.with_alias(alias),
            None => metric,
        }
    }

    fn publish_counted(&mut self, topic: String, metrics: Vec<Metric>, now: NodeTime) -> NodeAction {
        let payload = Payload { timestamp: Some(now.unix_ms), metrics, seq: Some(u64::from(self.seq)) };
        self.seq = self.seq.wrapping_add(1);
        NodeAction::Publish(Message { topic, payload: payload.encode_to_vec(), qos: 0 })
    }

    /// Publishes the death message and disconnects.
    fn end_session(&mut self, now: NodeTime) -> Vec<NodeAction> {
        let was = std::mem::replace(&mut self.session, NodeSession::Offline);
        let death = (was == NodeSession::Born).then(|| NodeAction::Publish(self.last_will(now)));
        death.into_iter().chain([NodeAction::Disconnect]).collect()
    }

    fn received(&mut self, (topic, payload, is_retained): (&str, &[u8], bool), now: NodeTime) -> Vec<NodeAction> {
        if self.setup.ids.state().is_some_and(|state| state == topic) {
            return self.on_host_state(payload, now);
        }
        if topic != self.setup.ids.command_topic() {
            let topic: String = topic.chars().take(100).collect();
            let refused = "the node has not subscribed to this topic".to_owned();
            return self.refuse("message", Some(topic.escape_debug().to_string()), refused);
        }
        if is_retained {
            let refused = "the broker had retained this command, so its age is unknown; send commands without the \
                           retain flag";
            return self.refuse("command", None, refused.to_owned());
        }
        let asked = commands(payload, self.setup.commands_allowed);
        asked
            .into_iter()
            .flat_map(|asked| match asked {
                Ok(command) => self.on_command(command, now),
                Err(error) => self.refuse("command", None, error.to_string()),
            })
            .collect()
    }

    fn on_command(&mut self, command: NodeCommand, now: NodeTime) -> Vec<NodeAction> {
        if command == NodeCommand::Rebirth && self.session != NodeSession::Born {
            let refused = "the node publishes nothing while the primary host is offline".to_owned();
            return self.refuse(command.keyword(), None, refused);
        }
        match self.commands.admit(command, now.steady_ms) {
            true => self.pass_command(command, now),
            false => vec![],
        }
    }

    fn pass_command(&mut self, command: NodeCommand, now: NodeTime) -> Vec<NodeAction> {
        let is_noted = self.lines.admit_line(false);
        if command != NodeCommand::Rebirth {
            return vec![NodeAction::Ask { command, is_noted }];
        }
        let note = AuditNote { what: command.keyword().to_owned(), subject: None, refused: None };
        let note = is_noted.then_some(NodeAction::Note(note));
        self.birth(now).into_iter().chain(note).collect()
    }

    fn refuse(&mut self, what: &str, subject: Option<String>, refused: String) -> Vec<NodeAction> {
        let note = AuditNote { what: what.to_owned(), subject, refused: Some(refused) };
        self.lines.admit_line(true).then_some(NodeAction::Note(note)).into_iter().collect()
    }

    fn on_host_state(&mut self, payload: &[u8], now: NodeTime) -> Vec<NodeAction> {
        let Some(state) = HostState::read(payload) else {
            let refused =
                "the STATE message of the primary host is not a JSON object with \"online\" and \"timestamp\""
                    .to_owned();
            return self.refuse("host state", None, refused);
        };
        self.host = self.host.with_state(state);
        // A node that has not published a birth keeps its connection, because there is only one broker.
        match self.session == NodeSession::Born && !self.host.is_online() {
            true => self.end_session(now),
            false => vec![],
        }
    }

    fn after_minimum_interval(&mut self, now: NodeTime) -> Vec<NodeAction> {
        let mut acts = Vec::new();
        for command in self.commands.due_commands(now.steady_ms) {
            let may = command != NodeCommand::Rebirth || self.session == NodeSession::Born;
            acts.extend(may.then(|| self.pass_command(command, now)).into_iter().flatten());
        }
        if let Some(left_out) = self.lines.end_elapsed_minute(now.steady_ms) {
            let refused = format!("{left_out} further messages within one minute were not recorded individually");
            let note = AuditNote { what: "flood".to_owned(), subject: None, refused: Some(refused) };
            acts.push(NodeAction::Note(note));
        }
        acts
    }
}

/// The message of a host application on its STATE topic, in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct HostState {
    /// Whether the host is online.
    pub online: bool,
    /// The time that identifies the connection of the host application, ms since 1970.
    pub timestamp: u64,
}

impl HostState {
    /// Parses a STATE message; `None` if the bytes are not a valid one.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice(bytes).ok()
    }
}

/// The known state of the primary host. A STATE message that is older than a previous one belongs to an earlier
/// connection of the host and is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct PrimaryHost {
    is_online: bool,
    /// The newest timestamp of all STATE messages, and that of the messages in which the host is online.
    newest: Option<u64>,
    newest_online: Option<u64>,
}

impl PrimaryHost {
    pub fn is_online(self) -> bool {
        self.is_online
    }

    /// Returns the state at the beginning of a new connection to the broker: only the newest timestamps are kept.
    pub fn connected(self) -> Self {
        PrimaryHost { is_online: false, ..self }
    }

    pub fn with_state(self, state: HostState) -> Self {
        let since = if state.online { self.newest } else { self.newest_online };
        if since.is_some_and(|since| state.timestamp < since) {
            return self;
        }
        let newest_online = if state.online { Some(state.timestamp) } else { self.newest_online };
        PrimaryHost { is_online: state.online, newest: self.newest.max(Some(state.timestamp)), newest_online }
    }
}
