//! The commands of one epoch: queued, sent, received, executed; the limits of a link, and the reasons why a command
//! is not queued.
//!
//! Commands that are sent but not executed stay inside a window. The window limits their number and the time of their
//! motion, since the arm still executes these commands when the link drops. A path's motion is counted as distance
//! over speed. Points of a path are sent at least a few at a time, however long they last, so that the controller can
//! blend. Bytes that are not yet received stay below the size of its buffer, and commands below the number of free
//! places that it last reported.

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

/// Largest number of bytes sent and not yet received: half of what a channel buffers by default (`eki.md` 6, 30).
const MAX_UNRECEIVED_BYTES: usize = 8 * 1024;
/// Rotation speed with which the duration of a linear motion is calculated if the rotation takes longer than the
/// translation, degrees a second. It is lower than the controller's own speed (`$VEL.ORI`, 200), so that the duration
/// is not too short.
const MIN_ROTATION_SPEED_DEG_S: f64 = 90.0;
/// Largest delay of a point behind its plan, in addition to twice its duration (`faults.md` R5).
const MAX_LATENESS: Duration = Duration::from_millis(500);

/// The limits of a link (`design.md`, "Limits").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkLimits {
    /// Longest motion sent and not yet executed.
    pub window: Duration,
    /// Largest number of commands sent and not yet executed.
    pub window_commands: usize,
    /// Number of points that are sent together when a path starts, and that are always sent ahead, whatever their
    /// duration.
    pub min_points: usize,
    /// Interval between heartbeats.
    pub heartbeat: Duration,
    /// Duration of silence after which the epoch is ended, while anything is queued.
    pub watchdog: Duration,
    /// The inputs that can be set.
    pub mapped_inputs: MappedInputs,
    /// Bits of the state's outputs that do harm without supervision: tool and water. While one is on, silence
    /// counts as it does while commands are queued.
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

/// The reason why a command was not queued. No part of the command was sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum QueueError {
    /// No controller.
    #[error("there is no connection to the controller")]
    NotConnected,
    /// A new epoch would begin while the robot moves.
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
        /// The number that the next epoch would have: one above all epochs opened before.
        next: u64,
        /// Epoch of the controller.
        found: Epoch,
        /// Largest allowed distance between the two epochs.
        most: u32,
        /// The epoch that should be set on the controller.
        above: u64,
    },
    /// Linear motions need both frames, base and tool.
    #[error("move_lin needs base and tool to be set in this epoch; {missing} is not set")]
    FramesNotSet {
        /// The frame that is missing.
        #[serde(deserialize_with = "intern_keyword")]
        missing: Keyword,
    },
    /// A path without points.
    #[error("the path has no points")]
    EmptyPath,
    /// Too many commands.
    #[error("the epoch would have more than {most} commands; open a new epoch")]
    IdsExhausted {
        /// The last id.
        most: u32,
    },
    /// The correction of the arm needs the axis angles at the point, and the point cannot be reached with any axis
    /// angles.
    #[error(
        "point {point} cannot be reached with any axis angles, so the robot correction cannot be applied to this point"
    )]
    Uncorrected {
        /// Number of the point, from 1.
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
    /// The duration of its motion by our calculation; zero if nothing moves.
    motion: Duration,
    /// Whether start and speed of the command's linear motion are known, so that `motion` is its duration.
    measured: bool,
    /// Whether the command's motion ends on the panel.
    contact: bool,
    /// The path of which the command is a point; `None` for other commands.
    path: Option<PathPoint>,
    /// The end and the speed of the command's linear motion, while its start is not known.
    from_anywhere: Option<(KukaPose, Option<f64>)>,
    sent_at: Time,
}

/// The path of a point: its first and its last command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PathPoint {
    first: CommandId,
    last: CommandId,
    /// The commands that set base and tool; the points of the path wait for the echoes of both.
    base: CommandId,
    tool: CommandId,
}

/// One open epoch.
#[derive(Debug)]
pub(super) struct CommandFlow {
    epoch: Epoch,
    queue: VecDeque<QueuedCommand>,
    in_flight: VecDeque<QueuedCommand>,
    /// Motion of the commands in flight, and bytes of those not yet received.
    motion: Duration,
    unreceived_bytes: usize,
    next_id: CommandId,
    sent: CommandId,
    received: CommandId,
    /// The last values that each channel reported, since one channel may be behind the other.
    acked_received: CommandId,
    acked_done: CommandId,
    state_done: CommandId,
    reported: CommandId,
    /// The highest command number that may be sent, from the free places in the controller's ring.
    max_sendable: Option<u64>,
    base: FrameEcho,
    tool: FrameEcho,
    speed_mm_s: Option<f64>,
    /// The end of the last queued line, if known.
    last_line_end: Option<KukaPose>,
    path_ends: VecDeque<CommandId>,
    /// The time at which the last command was executed, as far as reported, and whether it ended on the panel.
    progressed_at: Time,
    touches: bool,
    /// The last point of the path that was reported as late.
    late: Option<CommandId>,
    /// The last command that may be sent; the commands behind it wait.
    permitted: Option<CommandId>,
}

/// A point that should have been executed long ago.
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

    /// Returns whether a command waits, or was sent and not executed.
    pub(super) fn is_busy(&self) -> bool {
        !self.queue.is_empty() || !self.in_flight.is_empty()
    }

    /// Returns the time at which the oldest command was sent that the controller has not received.
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
        // The command is encoded before anything changes: a refused command leaves neither a gap in the ids nor a frame
        // that waits for its echo.
        let bytes = wire.encode_command(id, self.epoch, &command, 0)?;
        let mut motion = Duration::ZERO;
        match command {
            Command::SetBase(base) => self.base.queued(id, base),
            Command::SetTcp(SetTcp { flange_from_tool, .. }) => self.tool.queued(id, flange_from_tool),
            Command::SetAccSpeed(speed) => self.speed_mm_s = Some(1_000.0 * speed.speed_m_s),
            // Only the controller knows how long these commands take: each of them fills the window alone.
            Command::MoveJ(_) | Command::CallSubroutine { .. } => motion = limits.window,
            Command::MoveLin(MoveLin { speed_m_s: Some(speed_m_s), .. }) => {
                self.speed_mm_s = Some(1_000.0 * speed_m_s)
            }
            _ => {}
        }
        if matches!(
            command,
            // After these commands, only the controller knows the position of the tip in the active frames.
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
        // Changes are made to copies until every point is encoded: one bad point refuses the whole path, since a part
        // of it would end in contact.
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
                // A line of unknown length fills the window alone: too few commands ahead only cost time, too many
                // cannot be taken back.
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

    /// Permits commands up to this one; those behind it wait until a later one is permitted. `None` removes this limit.
    pub(super) fn permit_up_to(&mut self, last: Option<CommandId>) {
        self.permitted = last;
    }

    /// Returns the first id of a block of this number of new ids.
    fn reserve_ids(&self, count: u32) -> Result<CommandId, QueueError> {
        match self.next_id.0.checked_add(count) {
            Some(after) if after <= LAST_NUMBER => Ok(self.next_id),
            _ => Err(QueueError::IdsExhausted { most: LAST_NUMBER }),
        }
    }

    /// Returns the bytes of the next command, if it may be sent now.
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
        // The points behind the permitted one are planned, but the caller has not yet checked them; the controller
        // executes every point that it receives.
        if self.permitted.is_some_and(|last| next.id > last) {
            return false;
        }
        // Both limits apply: the free places in the ring of the controller's program, and the bytes that EthernetKRL
        // buffers before that program reads them.
        let has_place = self.max_sendable.is_none_or(|credit| u64::from(next.id.0) <= credit)
            && self.unreceived_bytes + next.bytes.len() <= MAX_UNRECEIVED_BYTES;
        let commands = self.in_flight.len();
        let Some(part) = next.path else {
            let fits = next.motion.is_zero() || self.motion + next.motion <= limits.window;
            return has_place && fits && commands < limits.window_commands;
        };
        // A line in another frame than the planned one ends at another place, so no point is sent before both echoes
        // agree.
        if !(self.base.is_confirmed(part.base) && self.tool.is_confirmed(part.tool)) {
            return false;
        }
        // A path starts when there are enough points to blend, or when it is complete.
        let points = (part.last.0 - part.first.0 + 1) as usize;
        let together = if next.id == part.first { points.min(limits.min_points) } else { 1 };
        has_place && commands + together <= limits.window_commands && self.motion_fits(part, together, limits)
    }

    /// Returns whether the duration of the path's next points fits into the window. If only a few points of the path
    /// are in flight, the duration is not limited.
    fn motion_fits(&self, part: PathPoint, together: usize, limits: &LinkLimits) -> bool {
        let is_ours = |queued: &QueuedCommand| queued.path == Some(part);
        let ahead = self.in_flight.iter().filter(|queued| is_ours(queued)).count();
        let few = ahead < limits.min_points
            && self.in_flight.iter().all(|queued| is_ours(queued) || queued.motion.is_zero());
        let motion: Duration = self.queue.iter().take(together).map(|queued| queued.motion).sum();
        few || self.motion + motion <= limits.window
    }

    /// Accepts an acknowledgement of this epoch.
    pub(super) fn acknowledge(&mut self, ack: &Ack, now: Time) -> Result<(), SequenceError> {
        check_range("received", ack.received, self.acked_received, self.sent)?;
        // A command cannot be executed before it is received: such an acknowledgement is damaged or is for another
        // client.
        check_range("executed", ack.done, self.acked_done, ack.received)?;
        (self.acked_received, self.acked_done) = (ack.received, ack.done);
        self.acknowledge_up_to(ack.received);
        // Calculated in 64 bits: a damaged count near the largest number must not wrap into a small or a huge credit.
        self.max_sendable = Some(u64::from(ack.received.0) + u64::from(ack.free));
        self.remove_executed(now);
        Ok(())
    }

    /// Accepts a state of this epoch.
    pub(super) fn accept_state(&mut self, state: &State, now: Time) -> Result<(), Report> {
        check_range("executed", state.done, self.state_done, self.sent).map_err(Report::SequenceError)?;
        self.state_done = state.done;
        // The state may arrive before the acknowledgement on the other channel; a command that was executed was also
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
        // Only an arm at rest in confirmed frames is at the reported pose; an arm that moves has already left it.
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
        // Never beyond what was sent, or the bytes in flight would be subtracted twice.
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

    /// Returns the point to which the arm is moving, if the motion takes far longer than planned; at most once for each
    /// path.
    pub(super) fn late_point(&mut self, now: Time) -> Option<LatePoint> {
        let next = self.in_flight.front().filter(|next| next.measured)?;
        let last = next.path?.last;
        // A point that waits behind others is not late: its time counts from the end of the point before it.
        let waited = now.since(next.sent_at.max(self.progressed_at));
        if waited <= 2 * next.motion + MAX_LATENESS || self.late.replace(last) == Some(last) {
            return None;
        }
        Some(LatePoint { id: next.id, contact: next.contact || self.touches, waited })
    }

    /// Returns whether the tool touches the panel, or a sent point will touch it.
    pub(super) fn is_contact_possible(&self) -> bool {
        self.in_flight.iter().any(|queued| queued.contact) || (self.is_busy() && self.touches)
    }

    /// Returns the progress and the completed paths since the last call.
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

/// Returns the duration of a line; `None` if start or speed are not known.
fn line_time(start: Option<KukaPose>, end: KukaPose, speed_mm_s: Option<f64>) -> Option<Duration> {
    let [start, end] = [start?, end].map(|pose| pose.to_rigid::<Base, Tool>());
    let along_s = start.origin().distance_mm(end.origin()) / speed_mm_s?;
    let turning_s =
        start.isometry().rotation.angle_to(&end.isometry().rotation).to_degrees() / MIN_ROTATION_SPEED_DEG_S;
    Duration::try_from_secs_f64(along_s.max(turning_s)).ok()
}
