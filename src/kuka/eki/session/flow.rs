//! The flow of commands in one epoch: which are queued, sent, received and executed; the limits of a link, and the
//! reasons why a command is not queued.
//!
//! Commands that are sent but not executed stay inside a window. The window limits their number and the duration of
//! their motion, because the arm executes these commands even after the link is lost. The duration of a path is its
//! length divided by its speed. A minimum number of points of a path is sent together, regardless of their duration, so
//! that the controller can blend. The bytes that are not yet received stay below the size of the controller's buffer,
//! and the commands below the number of free entries that it last reported.

use super::echo::FrameEcho;
use crate::eki::command::{Command, CommandError, MappedInputs, MoveLin, SetTcp};
use crate::eki::ids::{CommandId, Epoch, Keyword, LAST_NUMBER, Time, intern_keyword};
use crate::eki::report::{Report, SequenceError};
use crate::eki::state::{Ack, State};
use crate::eki::wire::Wire;
use panelprep_base::geometry::{Base, KukaPose, Tool};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::time::Duration;

/// Maximum number of bytes that are sent and not yet received: half of a channel's default buffer (`eki.md` 6, 30).
const MAX_UNRECEIVED_BYTES: usize = 8 * 1024;
/// Rotation speed that determines the duration of a linear motion if the rotation takes longer than the translation,
/// degrees per second. It is lower than the controller's own speed (`$VEL.ORI`, 200), so that the duration is not
/// underestimated.
const MIN_ROTATION_SPEED_DEG_S: f64 = 90.0;
/// Maximum delay of a point beyond twice its planned duration (`faults.md` R5).
const MAX_POINT_DELAY: Duration = Duration::from_millis(500);

/// The limits of a link to the controller (`design.md`, "Limits").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkLimits {
    /// Maximum duration of the motion that is sent and not yet executed.
    pub window: Duration,
    /// Maximum number of commands that are sent and not yet executed.
    pub window_commands: usize,
    /// Number of points that are sent together when a path starts, and that are always sent ahead, regardless of their
    /// duration.
    pub min_points: usize,
    /// Interval between heartbeats.
    pub heartbeat: Duration,
    /// Time without a message after which the epoch is ended, if commands are queued.
    pub watchdog: Duration,
    /// The inputs that `set_digin` can set.
    pub mapped_inputs: MappedInputs,
    /// The bits of the outputs in the state message that are dangerous without supervision: tool and water. While one
    /// of them is on, the watchdog applies as it does while commands are queued.
    pub harmful_outputs: u32,
}

impl Default for LinkLimits {
    fn default() -> Self {
        LinkLimits {
            window: Duration::from_secs(1),
            window_commands: 50,
            min_points: 5,
            heartbeat: Duration::from_millis(100),
            watchdog: Duration::from_millis(400),
            mapped_inputs: MappedInputs::default(),
            harmful_outputs: 0,
        }
    }
}

/// The reason why a command was not queued. Nothing of the command was sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum QueueError {
    /// No controller is connected.
    #[error("there is no connection to the controller")]
    NotConnected,
    /// A new epoch was requested while the robot moves.
    #[error("the robot is still moving; abort the motion, and wait for standstill")]
    NotStanding,
    /// No epoch is open.
    #[error("no epoch is open; open a new epoch after each start, stop or fault")]
    NoEpoch,
    /// The next epoch is too far above the controller's epoch.
    #[error(
        "the next epoch would be {next}, but the controller is in epoch {found}, and at most {most} more can be \
         reached. If the controller was replaced: deselect its programs, set CELL_EP on the controller to {above}, and \
         perform a cold start"
    )]
    EpochTooFar {
        /// The number of the next epoch: one above all epochs that were opened before.
        next: u64,
        /// The epoch in which the controller is.
        found: Epoch,
        /// Maximum difference between the two epochs.
        most: u32,
        /// The epoch that a person should set on the controller.
        above: u64,
    },
    /// A linear motion was queued before both base and tool were set.
    #[error("move_lin needs base and tool to be set in this epoch; {missing} is not set")]
    FramesNotSet {
        /// The frame that is not set.
        #[serde(deserialize_with = "intern_keyword")]
        missing: Keyword,
    },
    /// A path without points.
    #[error("the path has no points")]
    EmptyPath,
    /// The epoch would have too many commands.
    #[error("the epoch would have more than {most} commands; open a new epoch")]
    IdsExhausted {
        /// Maximum number of commands in an epoch.
        most: u32,
    },
    /// The robot correction needs the axis angles at a point that cannot be reached with any axis angles.
    #[error(
        "point {point} cannot be reached with any axis angles, so the robot correction cannot be applied to this point"
    )]
    Uncorrected {
        /// The number of the point in the path; the first point is 1.
        point: usize,
    },
    /// A command that no controller can execute.
    #[error(transparent)]
    Command(#[from] CommandError),
}

/// A command that is queued or sent.
#[derive(Debug)]
struct QueuedCommand {
    id: CommandId,
    bytes: Vec<u8>,
    /// The calculated duration of the command's motion; zero if nothing moves.
    motion: Duration,
    /// Whether `motion` was calculated from a known start and speed of the linear motion.
    measured: bool,
    /// Whether the command's motion ends on the panel.
    contact: bool,
    /// The path to which the command's point belongs; `None` for other commands.
    path: Option<PathPoint>,
    /// The end and the speed of the command's linear motion, as long as its start is not known.
    from_anywhere: Option<(KukaPose, Option<f64>)>,
    sent_at: Time,
}

/// The path to which a point belongs: its first and its last command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PathPoint {
    first: CommandId,
    last: CommandId,
    /// The commands that set base and tool. The points of the path are sent only after the echoes of both.
    base: CommandId,
    tool: CommandId,
}

/// The flow of commands in an open epoch.
#[derive(Debug)]
pub(super) struct CommandFlow {
    epoch: Epoch,
    queue: VecDeque<QueuedCommand>,
    in_flight: VecDeque<QueuedCommand>,
    /// The duration of the motion that is sent and not yet executed, and the number of bytes that are not yet received.
    motion: Duration,
    unreceived_bytes: usize,
    next_id: CommandId,
    sent: CommandId,
    received: CommandId,
    /// The last values that each of the two channels reported, because one channel may be behind the other.
    acked_received: CommandId,
    acked_done: CommandId,
    state_done: CommandId,
    reported: CommandId,
    /// The highest command number that may be sent, calculated from the free entries in the controller's ring buffer.
    max_sendable: Option<u64>,
    base: FrameEcho,
    tool: FrameEcho,
    speed_mm_s: Option<f64>,
    /// The end pose of the last queued linear motion, if known.
    last_line_end: Option<KukaPose>,
    path_ends: VecDeque<CommandId>,
    /// The time at which the last executed command was reported, and whether it ended on the panel.
    progressed_at: Time,
    touches: bool,
    /// The last point of the path that was reported as late.
    late: Option<CommandId>,
    /// The last command that may be sent; subsequent commands wait.
    permitted: Option<CommandId>,
}

/// A point of a path that takes much longer than planned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LatePoint {
    pub id: CommandId,
    pub contact: bool,
    pub waited: Duration,
}

impl CommandFlow {
    pub(super) fn new(epoch: Epoch) -> Self {
        CommandFlow {
            epoch,
            queue: VecDeque::new(),
            in_flight: VecDeque::new(),
            motion: Duration::ZERO,
            unreceived_bytes: 0,
            next_id: CommandId(1),
            sent: CommandId(0),
            received: CommandId(0),
            acked_received: CommandId(0),
            acked_done: CommandId(0),
            state_done: CommandId(0),
            reported: CommandId(0),
            max_sendable: None,
            base: FrameEcho::new("base"),
            tool: FrameEcho::new("tool"),
            speed_mm_s: None,
            last_line_end: None,
            path_ends: VecDeque::new(),
            progressed_at: Time::default(),
            touches: false,
            late: None,
            permitted: None,
        }
    }

    pub(super) fn epoch(&self) -> Epoch {
        self.epoch
    }

    pub(super) fn last_sent(&self) -> CommandId {
        self.sent
    }

    pub(super) fn last_executed(&self) -> CommandId {
        self.acked_done.max(self.state_done)
    }

    /// Returns whether a command waits in the queue, or was sent and is not executed.
    pub(super) fn is_busy(&self) -> bool {
        !self.queue.is_empty() || !self.in_flight.is_empty()
    }

    /// Returns the time at which the oldest command that the controller has not received was sent.
    pub(super) fn oldest_unreceived(&self) -> Option<Time> {
        let received = self.in_flight.partition_point(|queued| queued.id <= self.received);
        self.in_flight.get(received).map(|queued| queued.sent_at)
    }

    pub(super) fn queue(
        &mut self,
        command: Command,
        wire: &Wire,
        limits: &LinkLimits,
    ) -> Result<CommandId, QueueError> {
        let id = self.reserve_ids(1)?;
        // The command is encoded before anything changes. So a refused command leaves no gap in the ids, and no frame
        // that waits for its echo.
        let bytes = wire.encode_command(id, self.epoch, &command, 0)?;
        let mut motion = Duration::ZERO;
        match command {
            Command::SetBase(base) => self.base.queued(id, base),
            Command::SetTcp(SetTcp { flange_from_tool, .. }) => self.tool.queued(id, flange_from_tool),
            Command::SetAccSpeed(speed) => self.speed_mm_s = Some(1_000.0 * speed.speed_m_s),
            // Only the controller knows the duration of these commands, so each of them fills the window alone.
            Command::MoveJ(_) | Command::CallSubroutine { .. } => motion = limits.window,
            Command::MoveLin(MoveLin { speed_m_s: Some(speed_m_s), .. }) => {
                self.speed_mm_s = Some(1_000.0 * speed_m_s)
            }
            _ => {}
        }
        if matches!(
            command,
            // After these commands only the controller knows the position of the TCP in the active frames.
            Command::SetBase(_) | Command::SetTcp(_) | Command::MoveJ(_) | Command::CallSubroutine { .. }
        ) {
            self.last_line_end = None;
        }
        self.queue.push_back(QueuedCommand {
            id,
            bytes,
            motion,
            measured: false,
            contact: false,
            path: None,
            from_anywhere: None,
            sent_at: Time::default(),
        });
        self.next_id = CommandId(id.0 + 1);
        Ok(id)
    }

    pub(super) fn queue_path(
        &mut self,
        points: &[MoveLin],
        wire: &Wire,
        limits: &LinkLimits,
    ) -> Result<CommandId, QueueError> {
        let base = self.base.last_queued().ok_or(QueueError::FramesNotSet { missing: "the base" })?;
        let tool = self.tool.last_queued().ok_or(QueueError::FramesNotSet { missing: "the tool" })?;
        let count = u32::try_from(points.len()).unwrap_or(u32::MAX);
        if count == 0 {
            return Err(QueueError::EmptyPath);
        }
        let first = self.reserve_ids(count)?;
        let last = CommandId(first.0 + (count - 1));
        let path = Some(PathPoint { first, last, base, tool });
        // The changes are made on copies until every point is encoded. One invalid point refuses the whole path,
        // because an incomplete path would end in contact.
        let (mut end, mut speed_mm_s) = (self.last_line_end, self.speed_mm_s);
        let mut queued = Vec::with_capacity(points.len());
        for (point, id) in points.iter().zip((first.0..=last.0).map(CommandId)) {
            let bytes = wire.encode_command(id, self.epoch, &Command::MoveLin(*point), last.0 - id.0)?;
            speed_mm_s = point.speed_m_s.map(|speed_m_s| 1_000.0 * speed_m_s).or(speed_mm_s);
            let motion = line_time(end, point.pose, speed_mm_s);
            let from_anywhere = end.is_none().then_some((point.pose, speed_mm_s));
            end = Some(point.pose);
            queued.push(QueuedCommand {
                id,
                bytes,
                // A linear motion of unknown length fills the window alone. Too few commands ahead only cost time, but
                // commands that are sent cannot be taken back.
                motion: motion.unwrap_or(limits.window),
                measured: motion.is_some(),
                contact: point.contact,
                path,
                from_anywhere,
                sent_at: Time::default(),
            });
        }
        self.queue.extend(queued);
        (self.last_line_end, self.speed_mm_s, self.next_id) = (end, speed_mm_s, CommandId(last.0 + 1));
        self.path_ends.push_back(last);
        Ok(last)
    }

    /// Permits the session to send commands up to this one; subsequent commands wait. `None` removes the limit.
    pub(super) fn permit_up_to(&mut self, last: Option<CommandId>) {
        self.permitted = last;
    }

    /// Reserves this number of new ids, and returns the first of them.
    fn reserve_ids(&self, count: u32) -> Result<CommandId, QueueError> {
        match self.next_id.0.checked_add(count) {
            Some(after) if after <= LAST_NUMBER => Ok(self.next_id),
            _ => Err(QueueError::IdsExhausted { most: LAST_NUMBER }),
        }
    }

    /// Returns the encoded next command, if it may be sent now.
    pub(super) fn next_command_bytes(&mut self, now: Time, limits: &LinkLimits) -> Option<Vec<u8>> {
        if !self.queue.front().is_some_and(|next| self.may_send(next, limits)) {
            return None;
        }
        let mut queued = self.queue.pop_front()?;
        let bytes = queued.bytes.clone();
        (self.sent, queued.sent_at) = (queued.id, now);
        self.motion += queued.motion;
        self.unreceived_bytes += queued.bytes.len();
        self.in_flight.push_back(queued);
        Some(bytes)
    }

    fn may_send(&self, next: &QueuedCommand, limits: &LinkLimits) -> bool {
        // The caller has not yet checked the points after the permitted one, and the controller executes every point
        // that it receives.
        if self.permitted.is_some_and(|last| next.id > last) {
            return false;
        }
        // Two limits apply: the free entries in the ring buffer of the robot program, and the bytes that EthernetKRL
        // buffers before the program reads them.
        let has_place = self.max_sendable.is_none_or(|credit| u64::from(next.id.0) <= credit)
            && self.unreceived_bytes + next.bytes.len() <= MAX_UNRECEIVED_BYTES;
        let commands = self.in_flight.len();
        let Some(part) = next.path else {
            let fits = next.motion.is_zero() || self.motion + next.motion <= limits.window;
            return has_place && fits && commands < limits.window_commands;
        };
        // A linear motion in another frame than planned ends at another place. So no point is sent before both echoes
        // match.
        if !(self.base.is_confirmed(part.base) && self.tool.is_confirmed(part.tool)) {
            return false;
        }
        // A path starts when it has enough points to blend, or when it is complete.
        let points = (part.last.0 - part.first.0 + 1) as usize;
        let together = if next.id == part.first { points.min(limits.min_points) } else { 1 };
        has_place && commands + together <= limits.window_commands && self.motion_fits(part, together, limits)
    }

    /// Returns whether the duration of the path's next points fits into the window. If fewer than the minimum number of
    /// points are in flight, the duration is not limited.
    fn motion_fits(&self, part: PathPoint, together: usize, limits: &LinkLimits) -> bool {
        let is_ours = |queued: &QueuedCommand| queued.path == Some(part);
        let ahead = self.in_flight.iter().filter(|queued| is_ours(queued)).count();
        let few = ahead < limits.min_points
            && self.in_flight.iter().all(|queued| is_ours(queued) || queued.motion.is_zero());
        let motion: Duration = self.queue.iter().take(together).map(|queued| queued.motion).sum();
        few || self.motion + motion <= limits.window
    }

    /// Processes an acknowledgement of this epoch.
    pub(super) fn acknowledge(&mut self, ack: &Ack, now: Time) -> Result<(), SequenceError> {
        check_range("received", ack.received, self.acked_received, self.sent)?;
        // A command cannot be executed before it is received. An acknowledgement that reports this is corrupted or
        // belongs to another client.
        check_range("executed", ack.done, self.acked_done, ack.received)?;
        (self.acked_received, self.acked_done) = (ack.received, ack.done);
        self.acknowledge_up_to(ack.received);
        // The sum has 64 bits, so that a corrupted count near the maximum does not overflow to a wrong credit.
        self.max_sendable = Some(u64::from(ack.received.0) + u64::from(ack.free));
        self.remove_executed(now);
        Ok(())
    }

    /// Processes a state message of this epoch.
    pub(super) fn accept_state(&mut self, state: &State, now: Time) -> Result<(), Report> {
        check_range("executed", state.done, self.state_done, self.sent).map_err(Report::SequenceError)?;
        self.state_done = state.done;
        // The state may arrive before the acknowledgement on the other channel. A command that was executed was also
        // received.
        self.acknowledge_up_to(state.done);
        self.remove_executed(now);
        let echo = [
            (&mut self.base, state.base_set, state.active_base),
            (&mut self.tool, state.tool_set, state.flange_from_tool),
        ];
        for (frame, is_set, found) in echo {
            frame.compare_with_state(state.done, self.sent, is_set, found).map_err(Report::EchoMismatch)?;
        }
        self.measure_start(state);
        Ok(())
    }

    /// Calculates the duration of a linear motion that starts at the arm's present position.
    fn measure_start(&mut self, state: &State) {
        let is_seen = |frame: &FrameEcho| frame.last_queued().is_some_and(|last| frame.is_confirmed(last));
        // The reported pose is the start of the next motion only if the arm is at rest and both frames are confirmed.
        // An arm that moves has already left the reported pose.
        if !self.is_busy() && is_seen(&self.base) && is_seen(&self.tool) {
            self.last_line_end = Some(state.base_from_tcp);
        }
        let stands = self.in_flight.iter().all(|queued| queued.motion.is_zero());
        if let Some(next) = self.queue.front_mut().filter(|_| stands)
            && let (Some(part), Some((end, speed_mm_s))) = (next.path, next.from_anywhere)
            && self.base.is_confirmed(part.base)
            && self.tool.is_confirmed(part.tool)
            && let Some(motion) = line_time(Some(state.base_from_tcp), end, speed_mm_s)
        {
            (next.motion, next.measured) = (motion, true);
        }
    }

    pub(super) fn acknowledge_up_to(&mut self, id: CommandId) {
        let before = self.in_flight.partition_point(|queued| queued.id <= self.received);
        // The number is limited to the commands that were sent, because otherwise the bytes in flight would be
        // subtracted twice.
        self.received = self.received.max(id).min(self.sent);
        let fresh = self.in_flight.iter().skip(before).take_while(|queued| queued.id <= self.received);
        self.unreceived_bytes -= fresh.map(|queued| queued.bytes.len()).sum::<usize>();
    }

    fn remove_executed(&mut self, now: Time) {
        let done = self.last_executed();
        while let Some(queued) = self.in_flight.pop_front_if(|queued| queued.id <= done) {
            self.motion -= queued.motion;
            (self.progressed_at, self.touches) = (now, queued.contact);
        }
    }

    /// Returns the point to which the arm is moving, if the motion takes much longer than planned; at most once for
    /// each path.
    pub(super) fn late_point(&mut self, now: Time) -> Option<LatePoint> {
        let next = self.in_flight.front().filter(|next| next.measured)?;
        let last = next.path?.last;
        // A point that waits for earlier points is not late: its time begins when the previous point is reached.
        let waited = now.since(next.sent_at.max(self.progressed_at));
        if waited <= 2 * next.motion + MAX_POINT_DELAY || self.late.replace(last) == Some(last) {
            return None;
        }
        Some(LatePoint { id: next.id, contact: next.contact || self.touches, waited })
    }

    /// Returns whether the tool touches the panel, or a point that was sent will touch the panel.
    pub(super) fn is_contact_possible(&self) -> bool {
        self.in_flight.iter().any(|queued| queued.contact) || (self.is_busy() && self.touches)
    }

    /// Returns reports of the progress, and of the paths that were completed since the last call.
    pub(super) fn take_progress(&mut self) -> Vec<Report> {
        let done = self.last_executed();
        let mut news = Vec::new();
        if done > self.reported {
            self.reported = done;
            news.push(Report::Progress { done });
        }
        while let Some(last) = self.path_ends.pop_front_if(|last| *last <= done) {
            news.push(Report::PathDone { last });
        }
        news
    }
}

fn check_range(
    what: &'static str,
    found: CommandId,
    first: CommandId,
    last: CommandId,
) -> Result<(), SequenceError> {
    if found >= first && found <= last { Ok(()) } else { Err(SequenceError::Command { what, found, first, last }) }
}

/// Returns the duration of a linear motion; `None` if its start or speed is not known.
fn line_time(start: Option<KukaPose>, end: KukaPose, speed_mm_s: Option<f64>) -> Option<Duration> {
    let [start, end] = [start?, end].map(|pose| pose.to_rigid::<Base, Tool>());
    let along_s = start.origin().distance_mm(end.origin()) / speed_mm_s?;
    let turning_s =
        start.isometry().rotation.angle_to(&end.isometry().rotation).to_degrees() / MIN_ROTATION_SPEED_DEG_S;
    Duration::try_from_secs_f64(along_s.max(turning_s)).ok()
}
