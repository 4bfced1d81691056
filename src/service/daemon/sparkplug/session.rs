//! One connection to the broker, from its beginning to its end. `BrokerConnection` contains the parameters of the
//! connection: address, TLS, user and password; their files are read again for each connection. `HostRequests` passes
//! the requests of a host to the cell, and adds entries to the audit trail for requests that did not reach the cell.

use crate::daemon::alarms::Alarms;
use crate::daemon::gateway::Gateway;
use crate::daemon::people::AccountService;
use crate::daemon::request::RequestKind;
use crate::setup::clock::now_unix_ms;
use panelprep_base::trust;
use panelprep_base::trust::TrustError;
use panelprep_cell::accounts::{AuditEntry, Role};
use panelprep_cell::cell::SparkplugNode;
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_interfaces::sparkplug::{
    AuditNote, CellView, EdgeNode, Message, NodeAction, NodeCommand, NodeEvent, NodeTime, values,
};
use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, EventLoop, LastWill, MqttOptions, Outgoing, Packet,
    PublishOptions, QoS, SubscribeReasonCode, TlsConfiguration, Transport,
};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, timeout};

/// Maximum number of messages that wait to be sent. If there are more, the connection is closed: data may be lost, but
/// must not be reordered.
const MAX_WAITING_MESSAGES: usize = 64;
/// Maximum number of received packets that wait for the node; further packets wait in the broker.
const MAX_PACKETS: usize = 16;
/// Interval at which the cell's values are read.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Time limit for the broker to accept a connection, s, and below it to accept the last messages.
const CONNECT_TIMEOUT_S: u64 = 10;
const DISCONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// The error text if the connection's task ended without a message, which indicates an error in the program.
pub(super) const FAILED_TASK_MESSAGE: &str =
    "internal fault: the task of the connection to the broker ended; it is started again";

/// The way in which a connection ended.
pub(super) enum SessionEnd {
    /// The program ends.
    Leaving,
    /// The primary host went offline.
    HostOffline,
    /// The connection was lost, or was never established, for this reason.
    Lost(String),
}

/// The parts that all connections share.
pub(super) struct SessionParts {
    pub host_requests: HostRequests,
    pub view: watch::Receiver<Option<CellView>>,
    pub started: Instant,
    /// The broker's address and port, as shown to people.
    pub address: String,
    pub alarms: Arc<Alarms>,
}

/// Name of the node in the log and in alarms.
pub(super) const NAME: &str = "MQTT Sparkplug";

impl SessionParts {
    /// Reports why there is no connection. A repeated reason is logged only once, until there is a connection again.
    pub fn report_failure(&self, why: &str) {
        let problem = format!("no connection to {}: {why}", self.address);
        if self.alarms.set_connection_problem(NAME, Some(&problem)) {
            tracing::warn!("{NAME}: {problem}; retrying");
        }
    }

    fn report_success(&self) {
        self.alarms.set_connection_problem(NAME, None);
        tracing::info!("{NAME}: connected to {}", self.address);
    }

    fn now(&self) -> NodeTime {
        let steady_ms = u64::try_from(self.started.elapsed().as_millis()).unwrap_or(u64::MAX);
        NodeTime { unix_ms: now_unix_ms().unsigned_abs(), steady_ms }
    }
}

struct Session<'s> {
    parts: &'s SessionParts,
    node: &'s mut EdgeNode,
    client: AsyncClient,
    packets: mpsc::Receiver<Result<rumqttc::Event, ConnectionError>>,
    /// Number of subscriptions that the broker has not accepted yet.
    open_subscriptions: usize,
}

/// Connects to the broker, and serves the connection until it ends.
pub(super) async fn run_connection(
    (parts, broker): (&SessionParts, &BrokerConnection),
    node: &mut EdgeNode,
    leave: &mut oneshot::Receiver<()>,
) -> SessionEnd {
    node.step(NodeEvent::Connecting, parts.now());
    let options = broker.connection_options(node.last_will(parts.now()));
    // Each connection has its own client, so that messages that waited for an earlier connection are not sent on this
    // one.
    let (client, mut eventloop) = AsyncClient::builder(options).capacity(MAX_WAITING_MESSAGES).build();
    eventloop.network_options.set_connection_timeout(CONNECT_TIMEOUT_S);
    let (tell, packets) = mpsc::channel(MAX_PACKETS);
    // The task ends with this connection, because dropping the set ends its tasks.
    let mut polling = JoinSet::new();
    polling.spawn(drive_connection(eventloop, tell));
    let mut session = Session { parts, node, client, packets, open_subscriptions: 0 };
    let ended = session.serve(leave).await;
    node.step(NodeEvent::Lost, parts.now());
    ended
}

/// Polls the connection. This needs its own task: if a poll is dropped before it is complete, a message may be
/// truncated.
async fn drive_connection(mut eventloop: EventLoop, tell: mpsc::Sender<Result<rumqttc::Event, ConnectionError>>) {
    loop {
        let event = eventloop.poll().await;
        let is_over = event.is_err();
        if tell.send(event).await.is_err() || is_over {
            return;
        }
    }
}

impl Session<'_> {
    async fn serve(&mut self, leave: &mut oneshot::Receiver<()>) -> SessionEnd {
        let mut look = interval(POLL_INTERVAL);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let ended = tokio::select! {
                _ = &mut *leave => {
                    let acts = self.node.step(NodeEvent::Leaving, self.parts.now());
                    self.perform(acts).await;
                    return SessionEnd::Leaving;
                }
                _ = look.tick() => self.on_cell_values().await,
                packet = self.packets.recv() => match packet {
                    Some(Ok(event)) => self.on_event(event).await,
                    Some(Err(error)) => Some(SessionEnd::Lost(describe_error(&error))),
                    None => Some(SessionEnd::Lost(FAILED_TASK_MESSAGE.to_owned())),
                },
            };
            if let Some(ended) = ended {
                return ended;
            }
        }
    }

    async fn on_cell_values(&mut self) -> Option<SessionEnd> {
        let seen = self.parts.view.borrow().as_ref().map(values)?;
        let acts = self.node.step(NodeEvent::Seen(seen), self.parts.now());
        self.perform(acts).await
    }

    async fn on_event(&mut self, event: rumqttc::Event) -> Option<SessionEnd> {
        match event {
            rumqttc::Event::Incoming(Packet::ConnAck(_)) => {
                let topics = self.node.subscriptions();
                self.open_subscriptions = topics.len();
                let all = topics.into_iter().map(|topic| self.client.try_subscribe(topic, quality_of_service(1)));
                let failed = all.filter(Result::is_err).count();
                (failed > 0).then(|| {
                    SessionEnd::Lost(
                        "the subscriptions could not be sent to the broker; the cell \
                                                       connects again"
                            .to_owned(),
                    )
                })
            }
            rumqttc::Event::Incoming(Packet::SubAck(ack)) => {
                if ack.return_codes.contains(&SubscribeReasonCode::Failure) {
                    let topics = self.node.subscriptions().join(" and ");
                    return Some(SessionEnd::Lost(format!(
                        "the broker refuses the subscription to {topics}; check the permissions of its user"
                    )));
                }
                let was_open = self.open_subscriptions > 0;
                self.open_subscriptions = self.open_subscriptions.saturating_sub(1);
                if !was_open || self.open_subscriptions > 0 {
                    return None;
                }
                self.parts.report_success();
                let acts = self.node.step(NodeEvent::Subscribed, self.parts.now());
                self.perform(acts).await
            }
            rumqttc::Event::Incoming(Packet::Publish(message)) => {
                let Ok(topic) = str::from_utf8(&message.topic) else {
                    return Some(SessionEnd::Lost(
                        "the broker sent a topic that is not UTF-8; the cell connects \
                                                  again"
                            .to_owned(),
                    ));
                };
                let (payload, is_retained) = (&*message.payload, message.retain);
                let acts = self.node.step(NodeEvent::Received { topic, payload, is_retained }, self.parts.now());
                self.perform(acts).await
            }
            _ => None,
        }
    }

    async fn perform(&mut self, acts: Vec<NodeAction>) -> Option<SessionEnd> {
        for act in acts {
            let asking = self.parts.host_requests.clone();
            match act {
                NodeAction::Publish(message) => {
                    let sent = self.client.try_publish(
                        message.topic,
                        message.payload,
                        PublishOptions::new(quality_of_service(message.qos)),
                    );
                    if sent.is_err() {
                        return Some(SessionEnd::Lost(
                            "a message could not be sent to the broker; the cell connects \
                                                      again"
                                .to_owned(),
                        ));
                    }
                }
                // The connection never waits for the loop or the disk; the number of these tasks is limited.
                NodeAction::Ask { command, is_noted } => drop(tokio::spawn(asking.request_cell(command, is_noted))),
                NodeAction::Note(note) => drop(tokio::spawn(asking.write_audit(note))),
                NodeAction::Disconnect => {
                    self.disconnect().await;
                    return Some(SessionEnd::HostOffline);
                }
            }
        }
        None
    }

    /// Ends the connection after all earlier messages are sent.
    async fn disconnect(&mut self) {
        if self.client.try_disconnect().is_err() {
            return;
        }
        let sent = async {
            while let Some(Ok(event)) = self.packets.recv().await {
                if event == rumqttc::Event::Outgoing(Outgoing::Disconnect) {
                    return;
                }
            }
        };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "a broker that accepts no message publishes the death certificate itself"
        )]
        let _ = timeout(DISCONNECT_TIMEOUT, sent).await;
    }
}

fn describe_error(error: &ConnectionError) -> String {
    match error {
        ConnectionError::ConnectionRefused(code) => match code {
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized => {
                "the broker refuses the user or the password; check [sparkplug] user and password_file".to_owned()
            }
            ConnectReturnCode::BadClientId => "the broker refuses the client ID; check the permissions of its \
                                               user"
                .to_owned(),
            ConnectReturnCode::RefusedProtocolVersion => {
                "the broker does not support MQTT 3.1.1; enable it on the broker, or use another broker".to_owned()
            }
            _ => "the broker is not available; check that it is running".to_owned(),
        },
        ConnectionError::NetworkTimeout => format!("the broker did not respond within {CONNECT_TIMEOUT_S} s"),
        other => {
            let words = other.to_string();
            let advice = if words.contains("UnknownIssuer") {
                "; the file at ca_certificate does not contain the certificate authority that signed the broker's certificate"
            } else if words.contains("Promised boundary crossed") || words.contains("reset by peer") {
                "; the broker may use another protocol at this port, or MQTT over TLS: set ca_certificate for TLS"
            } else if words.contains("closed by peer abruptly") {
                "; another client may have the same group_id and edge_node_id"
            } else {
                ""
            };
            format!("{words}{advice}")
        }
    }
}

/// Time without data after which a connection is checked, s; the broker reports the node's death after one and a half
/// times this time.
const KEEP_ALIVE_S: u16 = 10;
/// Maximum size of a message from the broker, and of a message to the broker, bytes. A command is much smaller.
const MAX_BYTES: [usize; 2] = [16 * 1_024, 256 * 1_024];

/// The parameters of the connection to the broker.
pub(super) struct BrokerConnection {
    options: MqttOptions,
}

impl BrokerConnection {
    /// Reads the files that `[sparkplug]` names.
    ///
    /// # Errors
    /// If a file cannot be read or is not valid.
    pub fn read(node: &SparkplugNode) -> Result<Self, TrustError> {
        let client_id = format!("{}/{}", node.group_id, node.edge_node_id);
        let mut options = MqttOptions::new(client_id, (node.broker.clone(), node.port));
        options
            .set_keep_alive(KEEP_ALIVE_S)
            .set_clean_session(true)
            .set_max_packet_size(MAX_BYTES[0], MAX_BYTES[1]);
        if let Some(tls) = &node.tls {
            let config = trust::client_config(&tls.ca_certificate, tls.client_certificate.as_ref())?;
            let config = TlsConfiguration::Rustls(Arc::new(config));
            options.set_transport(Transport::Tls(config));
        }
        if let Some((user, file)) = &node.login {
            options.set_credentials(user.clone(), trust::secret(file)?);
        }
        Ok(BrokerConnection { options })
    }

    /// Returns the options for a connection with this last will.
    pub fn connection_options(&self, will: Message) -> MqttOptions {
        let mut options = self.options.clone();
        options.set_last_will(LastWill::new(will.topic, will.payload, quality_of_service(will.qos), false));
        options
    }
}

/// Returns the quality of service with this number.
fn quality_of_service(qos: u8) -> QoS {
    if qos == 0 { QoS::AtMostOnce } else { QoS::AtLeastOnce }
}

/// Passes commands to the cell, and entries to the audit trail.
#[derive(Clone)]
pub(super) struct HostRequests {
    pub gateway: Gateway,
    pub people: Arc<AccountService>,
    /// The origin of the commands, for the audit trail.
    pub origin: String,
}

impl HostRequests {
    /// Requests this command from the cell, with the same checks as a request of the operator's page. The loop records
    /// the request with its result; an entry in the audit trail is written only for a request that the loop did not
    /// receive.
    pub async fn request_cell(self, command: NodeCommand, is_noted: bool) {
        let Some(request) = command.request() else { return };
        let from = Some(self.origin.clone());
        let who = RequestAuthor { from, ..RequestAuthor::from_source(RequestSource::Sparkplug) };
        let reply = self.gateway.request(RequestKind::Table(request), who).await;
        if is_noted && reply.may_be_unrecorded() {
            let refused = Some(reply.joined_reasons());
            self.write_audit(AuditNote { what: command.keyword().to_owned(), subject: None, refused }).await;
        }
    }

    /// Adds an entry to the audit trail, on a thread that may wait for the disk.
    pub async fn write_audit(self, note: AuditNote) {
        let AuditNote { what, subject, refused } = note;
        // The cell's file gives this role to all hosts; it is not known which host sent the command.
        let role = refused.is_none().then_some(Role::Operator);
        let entry = AuditEntry {
            subject,
            refused,
            ..AuditEntry::for_completed_action(None, role, self.origin.clone(), &what)
        };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "an entry that cannot be stored is written to the service's log"
        )]
        let _ = tokio::task::spawn_blocking(move || self.people.audit(&entry)).await;
    }
}
