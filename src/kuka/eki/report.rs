//! Reports of a session: everything that the rest of the program learns about the robot.

use super::framer::FrameError;
use super::ids::{CommandId, Epoch, Keyword, intern_keyword};
use super::schema::DecodeError;
use super::state::{Refusal, State};
use panelprep_base::geometry::KukaPose;
use panelprep_base::number_text::distinguishable_texts;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One of the two connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Commands and acknowledgements.
    Command,
    /// Requests and state.
    State,
}

impl std::fmt::Display for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Channel::Command => "command channel",
            Channel::State => "state channel",
        })
    }
}

/// A report of a session. Ids and `done` are of the current epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The controller has answered for the first time on this connection. This starts no motion.
    Connected {
        /// State of the controller.
        state: Box<State>,
    },
    /// The controller is in the new epoch; commands may be queued.
    EpochOpened {
        /// The epoch.
        epoch: Epoch,
    },
    /// The controller did not enter the new epoch.
    EpochNotOpened {
        /// The requested epoch.
        asked: Epoch,
        /// The present epoch of the controller.
        found: Epoch,
    },
    /// The controller's state, about ten times a second.
    State(Box<State>),
    /// All commands up to this one have been executed.
    Progress {
        /// The last executed command.
        done: CommandId,
    },
    /// A path has been executed to its end.
    PathDone {
        /// Its last command.
        last: CommandId,
    },
    /// The controller refused a command; the epoch is being ended.
    Refused {
        /// The command.
        id: CommandId,
        /// Reason of the refusal.
        refusal: Refusal,
    },
    /// Base or tool on the controller are not what was set; the epoch is being ended.
    EchoMismatch(Box<EchoMismatch>),
    /// The robot cannot continue with the queued commands; the epoch is being ended.
    Interrupted {
        /// Cause of the interruption.
        cause: StopCause,
    },
    /// The numbers that the controller reports do not match those of the session; the epoch is being ended.
    SequenceError(SequenceError),
    /// The controller was silent while commands were queued; the epoch is being ended.
    WatchdogExpired {
        /// The silent channel.
        channel: Channel,
        /// Duration of the silence.
        silence: Duration,
    },
    /// The robot is far behind its plan: a point took more than twice its planned time plus half a second. Reported
    /// once for each path; in contact the epoch is being ended.
    Slow {
        /// Id of the waypoint's command.
        id: CommandId,
        /// The tool is on the panel, or on its way to it.
        contact: bool,
        /// How long the command has taken so far.
        waited: Duration,
    },
    /// The robot has stopped after an abort.
    Standstill {
        /// The last executed command of the ended epoch, as far as the controller has reported.
        done: CommandId,
    },
    /// The controller was started again, or its programs were changed; the epoch has ended.
    Rebooted {
        /// State of the controller.
        state: Box<State>,
    },
    /// The connection is lost, or could not be made. The queued commands are discarded.
    LinkLost {
        /// Cause of the loss.
        why: LinkLoss,
    },
}

/// The reason why a robot cannot continue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum StopCause {
    /// An emergency stop is pressed.
    #[error("emergency stop")]
    EmergencyStop,
    /// The guard is open.
    #[error("the guard is open")]
    GuardOpen,
    /// The drives are off.
    #[error("the drives are off")]
    DrivesOff,
    /// The override differs from the one for which contact is planned, while the tool touches the panel or is about to
    /// touch it.
    #[error("the override is not 100 % while the tool is in contact")]
    Override,
    /// The mode switch was turned.
    #[error("the mode switch was turned to T1 or T2")]
    ModeTurned,
    /// The epoch was stopped, and no robot program was able to move the robot.
    #[error(
        "no robot program is running: select cell_motion and start it. Possible causes: in T1, the Start key was \
         released, or a message waits to be acknowledged"
    )]
    NoProgram,
    /// The controller's program has stopped the epoch.
    #[error("the controller's program has stopped by itself")]
    ByProgram,
    /// The robot's reports are not read: the part of the program that supervises the robot has stalled.
    #[error("the program that supervises the robot has not read the robot's reports for too long")]
    Unattended,
}

/// A base or tool on the controller that differs from the one that was set.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum EchoMismatch {
    /// The controller does not report that the frame was set.
    #[error(
        "command {id}, which sets the {frame}, was executed, but the controller reports that this frame is not set in \
         this epoch"
    )]
    NotSet {
        /// Base or tool.
        #[serde(deserialize_with = "intern_keyword")]
        frame: Keyword,
        /// The command.
        id: CommandId,
    },
    /// Another frame is active.
    #[error(
        "the {frame} set by command {id} is {sent}, but the controller has {found}: {} mm and {}° apart (limits 0.001 \
         mm and 0.001°)",
        distinguishable_texts(*distance_mm, 0.001, 4)[0], distinguishable_texts(*turn_deg, 0.001, 5)[0]
    )]
    Differs {
        /// Base or tool.
        #[serde(deserialize_with = "intern_keyword")]
        frame: Keyword,
        /// The command.
        id: CommandId,
        /// The value that was set.
        sent: KukaPose,
        /// The active value.
        found: KukaPose,
        /// Largest difference along an axis, mm.
        distance_mm: f64,
        /// Angle between the rotations, degrees.
        turn_deg: f64,
    },
}

/// Impossible numbers from the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum SequenceError {
    /// A state is missing, repeated or out of order.
    #[error(
        "state message {found} was received after state message {last}: a message is missing, repeated or out of order"
    )]
    State {
        /// Number of the state message before it.
        last: u32,
        /// The received number.
        found: u32,
    },
    /// An answer without a request.
    #[error("the controller sent a response to request {found}; valid: {first} to {last}")]
    Answer {
        /// Number of the command that the answer names.
        found: u32,
        /// The last request answered.
        first: u32,
        /// The last request sent.
        last: u32,
    },
    /// The controller reports a received or executed command that was not sent, or a number that is lower than before.
    #[error("the controller reports that command {found} was {what}; valid: {first} to {last}")]
    Command {
        /// Received or executed.
        #[serde(deserialize_with = "intern_keyword")]
        what: Keyword,
        /// The reported command.
        found: CommandId,
        /// The lowest command that the controller may report.
        first: CommandId,
        /// The highest command that the controller may report.
        last: CommandId,
    },
    /// An epoch that this client did not open.
    #[error(
        "the controller is in epoch {found}, but this program is in epoch {ours}; check whether another client is \
         connected"
    )]
    Epoch {
        /// Its epoch.
        found: Epoch,
        /// Epoch of this program.
        ours: Epoch,
    },
}

/// Causes of a lost or refused connection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum LinkLoss {
    /// No program listens on the port.
    #[error(
        "{address} refuses the {channel}: the controller responds, but its EthernetKRL server does not. Check that the \
         controller's program is running, and that the port is the same as in the channel's file"
    )]
    Refused {
        /// The connection.
        channel: Channel,
        /// Host and port.
        address: String,
    },
    /// The controller does not answer.
    #[error(
        "{address} does not respond within {waited_ms} ms ({channel}): check that the controller is on, the cable is \
         connected, the subnet is the controller's, and the port is open in its firewall"
    )]
    NoAnswer {
        /// The connection.
        channel: Channel,
        /// Host and port.
        address: String,
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// The client is connected, but receives no message.
    #[error(
        "the {channel} is connected, but no message was received for {silence_ms} ms: check that the program on the \
         controller is running, and that no other client is connected"
    )]
    Silent {
        /// The connection.
        channel: Channel,
        /// Duration of the silence, ms.
        silence_ms: u64,
    },
    /// A message has begun and does not end.
    #[error("the {channel} received the start of a message, but not its end within {waited_ms} ms")]
    Unfinished {
        /// The connection.
        channel: Channel,
        /// Time since the message began, ms.
        waited_ms: u64,
    },
    /// An epoch that no controller can have reached from the last known one.
    #[error(
        "the {channel} reports epoch {found}, but the last known epoch is {known}: the message is rejected, because a \
         controller's epoch never decreases, and never increases by more than {step}"
    )]
    EpochJump {
        /// The connection.
        channel: Channel,
        /// The reported epoch.
        found: Epoch,
        /// The highest known epoch.
        known: Epoch,
        /// Largest allowed step above the known epoch.
        step: u32,
    },
    /// A controller that has hardly any epochs left.
    #[error(
        "the controller is in epoch {found} (limit {most}): its epoch counter is corrupt. Deselect all programs on the \
         controller, set CELL_EP to 0, and perform a cold start"
    )]
    EpochTooHigh {
        /// Its epoch.
        found: Epoch,
        /// The highest epoch that is accepted.
        most: u32,
    },
    /// An abort that the controller did not answer. Without a client the controller stops by itself.
    #[error(
        "the controller did not respond to an abort within {waited_ms} ms: the connections are closed, which also \
         stops the controller"
    )]
    AbortNotAnswered {
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// Commands of several epochs were not acknowledged, although states arrive: closing the channel may remove the
    /// cause.
    #[error(
        "the controller has acknowledged no command in {epochs} consecutive epochs, although it reports its state: \
         the connections are opened again"
    )]
    NotAcknowledged {
        /// Number of epochs without an acknowledgement.
        epochs: u32,
    },
    /// An abort that was answered but not carried out. Without a client the controller stops by itself.
    #[error(
        "the controller responded to an abort, but did not stop: the connections are closed, which also stops the \
         controller"
    )]
    AbortNotObeyed,
    /// The connection has used all request numbers of 32 bits; a new connection starts counting again.
    #[error("{most} requests were sent on this connection, the limit of the request counter")]
    RequestsExhausted {
        /// The highest request number.
        most: u32,
    },
    /// The controller closed the channel before its first message: another client is connected to it.
    #[error(
        "the controller closed the {channel} before it sent any data. Possible causes: another client is connected \
         (another PC, or a program that hangs); the previous connection is not yet released; the controller's XML \
         files are of another version (`panelprep check`)"
    )]
    Occupied {
        /// The connection.
        channel: Channel,
    },
    /// The two ports are exchanged: each one leads to the other channel.
    #[error("the {channel} received messages of the other channel: command_port and state_port are exchanged")]
    PortsExchanged {
        /// The connection.
        channel: Channel,
    },
    /// Closed by the controller.
    #[error("the controller closed the {channel}")]
    Closed {
        /// The connection.
        channel: Channel,
    },
    /// The operating system reports an error.
    #[error("the {channel} failed: {problem}")]
    System {
        /// The connection.
        channel: Channel,
        /// The system's error.
        problem: String,
    },
    /// Bytes that do not form documents.
    #[error("the {channel} received data that no controller sends: {error}")]
    Frame {
        /// The connection.
        channel: Channel,
        /// The error and its position.
        error: FrameError,
    },
    /// A document that is not a valid message.
    #[error("the {channel} received an invalid message: {error}")]
    Message {
        /// The connection.
        channel: Channel,
        /// The error of the message.
        error: DecodeError,
    },
}
