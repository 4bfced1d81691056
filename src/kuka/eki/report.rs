//! The reports of a session, by which the rest of the program is informed about the robot.

use super::framer::FrameError;
use super::ids::{CommandId, Epoch, Keyword, intern_keyword};
use super::schema::DecodeError;
use super::state::{Refusal, State};
use panelprep_base::geometry::KukaPose;
use panelprep_base::number_text::distinguishable_texts;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// One of the two connections to the controller.
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

/// A report of a session. Command ids, and the field `done`, belong to the current epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The controller has replied for the first time on this connection. No motion is started.
    Connected {
        /// The state of the controller in its first reply.
        state: Box<State>,
    },
    /// The controller has begun the new epoch; commands may be queued.
    EpochOpened {
        /// The epoch.
        epoch: Epoch,
    },
    /// The controller has not begun the new epoch.
    EpochNotOpened {
        /// The requested epoch.
        asked: Epoch,
        /// The epoch in which the controller is.
        found: Epoch,
    },
    /// The controller's state, reported about ten times a second.
    State(Box<State>),
    /// All commands up to the command `done` have been executed.
    Progress {
        /// The last executed command.
        done: CommandId,
    },
    /// A path has been executed to its end.
    PathDone {
        /// The last command of the path.
        last: CommandId,
    },
    /// The controller refused a command; the epoch is being ended.
    Refused {
        /// The command.
        id: CommandId,
        /// The reason why the controller refused the command.
        refusal: Refusal,
    },
    /// The base or tool on the controller differs from the frame that was set; the epoch is being ended.
    EchoMismatch(Box<EchoMismatch>),
    /// The robot cannot execute the remaining commands; the epoch is being ended.
    Interrupted {
        /// Cause of the interruption.
        cause: StopCause,
    },
    /// A command, request or epoch number from the controller does not match the session; the epoch is being ended.
    SequenceError(SequenceError),
    /// The controller sent nothing for too long while commands were queued; the epoch is being ended.
    WatchdogExpired {
        /// The silent channel.
        channel: Channel,
        /// Duration of the silence.
        silence: Duration,
    },
    /// The robot is much slower than planned: a point took more than twice its planned time plus half a second. This is
    /// reported once for each path. If the tool is in contact, the epoch is being ended.
    Slow {
        /// The command of the delayed waypoint.
        id: CommandId,
        /// Whether the tool is on the panel, or on its way to the panel.
        contact: bool,
        /// The time that the command has taken so far.
        waited: Duration,
    },
    /// The robot has stopped after an abort.
    Standstill {
        /// The last command of the ended epoch that the controller has reported as executed.
        done: CommandId,
    },
    /// The controller was restarted, or its programs were changed; the epoch has ended.
    Rebooted {
        /// The state of the controller after the restart.
        state: Box<State>,
    },
    /// The connection is lost, or could not be opened. The queued commands are discarded.
    LinkLost {
        /// The cause of the loss.
        why: LinkLoss,
    },
}

/// The reason why the robot cannot execute the remaining commands.
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
    /// The speed override is not 100 % although the tool touches the panel or is about to touch it. Contact paths are
    /// planned for 100 %.
    #[error("the override is not 100 % while the tool is in contact")]
    Override,
    /// The mode switch was set to T1 or T2.
    #[error("the mode switch was turned to T1 or T2")]
    ModeTurned,
    /// The epoch was stopped because no robot program was running that could move the robot.
    #[error(
        "no robot program is running: select cell_motion and start it. Possible causes: in T1, the Start key was \
         released, or a message waits to be acknowledged"
    )]
    NoProgram,
    /// The robot program on the controller has stopped the epoch by itself.
    #[error("the robot program has stopped the epoch by itself: read its message on the pendant")]
    ByProgram,
    /// This program does not read the robot's reports any more: the part that supervises the robot has stalled.
    #[error(
        "the cell's control loop has not read the robot's reports for too long, so the epoch was ended: restart the \
         service"
    )]
    Unattended,
}

/// A base or tool frame on the controller that differs from the frame that was set.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum EchoMismatch {
    /// The command was executed, but the controller does not report the frame as set.
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
    /// The controller reports another frame than the one that was set.
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
        /// The frame that this program has set.
        sent: KukaPose,
        /// The active value.
        found: KukaPose,
        /// Largest difference between the two positions along an axis, mm.
        distance_mm: f64,
        /// Angle between the two orientations, degrees.
        turn_deg: f64,
    },
}

/// A number in a message of the controller that contradicts what this session has sent or received.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum SequenceError {
    /// A state message is missing, repeated or out of order.
    #[error(
        "state message {found} was received after state message {last}: a message is missing, repeated or out of order"
    )]
    State {
        /// The number of the previous state message.
        last: u32,
        /// The received number.
        found: u32,
    },
    /// A response to a request that was not sent.
    #[error("the controller sent a response to request {found}; valid: {first} to {last}")]
    Answer {
        /// The request number in the response.
        found: u32,
        /// The lowest valid request number: the last request that was answered.
        first: u32,
        /// The highest valid request number: the last request that was sent.
        last: u32,
    },
    /// The controller reports as received or executed a command that was not sent, or an earlier command than before.
    #[error("the controller reports that command {found} was {what}; valid: {first} to {last}")]
    Command {
        /// Received or executed.
        #[serde(deserialize_with = "intern_keyword")]
        what: Keyword,
        /// The reported command.
        found: CommandId,
        /// The lowest command number that is valid in the report.
        first: CommandId,
        /// The highest command number that is valid in the report.
        last: CommandId,
    },
    /// The controller is in an epoch that this client did not open.
    #[error(
        "the controller is in epoch {found}, but this program is in epoch {ours}; check whether another client is \
         connected"
    )]
    Epoch {
        /// The epoch of the controller.
        found: Epoch,
        /// The epoch that this program has opened.
        ours: Epoch,
    },
}

/// The cause of a lost or refused connection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum LinkLoss {
    /// The connection was refused, because no program listens on the port.
    #[error(
        "{address} refuses the {channel}: the controller responds, but its EthernetKRL server does not. Check that the \
         controller's program is running, and that the port is the same as in the channel's file"
    )]
    Refused {
        /// The channel of the connection.
        channel: Channel,
        /// Host and port.
        address: String,
    },
    /// The controller does not respond to the connection request.
    #[error(
        "{address} does not respond within {waited_ms} ms ({channel}): check that the controller is on, the cable is \
         connected, the subnet is the controller's, and the port is open in its firewall"
    )]
    NoAnswer {
        /// The channel of the connection.
        channel: Channel,
        /// Host and port.
        address: String,
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// The client is connected, but receives no messages.
    #[error(
        "the {channel} is connected, but no message was received for {silence_ms} ms: check that the program on the \
         controller is running, and that no other client is connected"
    )]
    Silent {
        /// The channel of the connection.
        channel: Channel,
        /// Time without a message, ms.
        silence_ms: u64,
    },
    /// The end of a message was not received in time.
    #[error(
        "the {channel} received the start of a message, but not its end within {waited_ms} ms; it is connected again \
         automatically"
    )]
    Unfinished {
        /// The channel of the connection.
        channel: Channel,
        /// Time since the start of the message, ms.
        waited_ms: u64,
    },
    /// The reported epoch cannot follow the last known epoch.
    #[error(
        "the {channel} reports epoch {found}, but the last known epoch is {known}: the message is rejected, because a \
         controller's epoch never decreases, and never increases by more than {step}"
    )]
    EpochJump {
        /// The channel of the connection.
        channel: Channel,
        /// The reported epoch.
        found: Epoch,
        /// The highest epoch that is known for this controller.
        known: Epoch,
        /// Maximum step above the known epoch.
        step: u32,
    },
    /// The controller's epoch is so high that too few epoch numbers remain.
    #[error(
        "the controller is in epoch {found} (limit {most}): its epoch counter is corrupt. Deselect all programs on the \
         controller, set CELL_EP to 0, and perform a cold start"
    )]
    EpochTooHigh {
        /// The epoch of the controller.
        found: Epoch,
        /// The maximum epoch that is accepted.
        most: u32,
    },
    /// The controller did not respond to an abort. The connections are closed, after which the controller stops by
    /// itself.
    #[error(
        "the controller did not respond to an abort within {waited_ms} ms: the connections are closed, which also \
         stops the controller"
    )]
    AbortNotAnswered {
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// The commands of several consecutive epochs were not acknowledged, although state messages arrive. Closing the
    /// channel may remove the cause.
    #[error(
        "the controller has acknowledged no command in {epochs} consecutive epochs, although it reports its state: \
         the connections are opened again"
    )]
    NotAcknowledged {
        /// The number of consecutive epochs without an acknowledgement.
        epochs: u32,
    },
    /// The controller responded to an abort, but did not stop. The connections are closed, after which the controller
    /// stops by itself.
    #[error(
        "the controller responded to an abort, but did not stop: the connections are closed, which also stops the \
         controller"
    )]
    AbortNotObeyed,
    /// The connection has used all request numbers of 32 bits. A new connection counts from 1 again.
    #[error(
        "{most} requests were sent on this connection, the limit of the request counter; a new connection is opened \
         automatically"
    )]
    RequestsExhausted {
        /// The highest request number.
        most: u32,
    },
    /// The controller closed the channel before its first message, usually because another client is connected.
    #[error(
        "the controller closed the {channel} before it sent any data. Possible causes: another client is connected \
         (another PC, or a program that hangs); the previous connection is not yet released; the controller's XML \
         files are of another version (`panelprep check`)"
    )]
    Occupied {
        /// The channel of the connection.
        channel: Channel,
    },
    /// The two ports are exchanged: the connection leads to the other channel.
    #[error("the {channel} received messages of the other channel: command_port and state_port are exchanged")]
    PortsExchanged {
        /// The channel of the connection.
        channel: Channel,
    },
    /// The controller closed the channel.
    #[error("the controller closed the {channel}")]
    Closed {
        /// The channel of the connection.
        channel: Channel,
    },
    /// The operating system reports an error.
    #[error("the {channel} failed: {problem}")]
    System {
        /// The channel of the connection.
        channel: Channel,
        /// The error of the operating system.
        problem: String,
    },
    /// The received bytes do not form XML documents.
    #[error("the {channel} received data that no controller sends: {error}")]
    Frame {
        /// The channel of the connection.
        channel: Channel,
        /// The error in the bytes, with its position.
        error: FrameError,
    },
    /// A received document is not a valid message.
    #[error("the {channel} received an invalid message: {error}")]
    Message {
        /// The channel of the connection.
        channel: Channel,
        /// The reason why the message is invalid.
        error: DecodeError,
    },
}
