//! The memory of the loop: the action in progress and the event for which it waits, the last sent path, the last
//! permitted waypoint of a contact path, and the active deadlines.

use super::abrasion::AbrasionWork;
use super::computing::Computing;
use super::control::Control;
use super::corrected::CalibratedRobot;
use super::perception::Perception;
use super::ports::{RecordPort, RequestPort, RobotPort, ToolPort};
use super::tool_state::PressState;
use crate::setup::{CellSetup, CycleSetup, FeedbackContradiction, SwitchProof};
use panelprep_base::geometry::{Base, Joints, KukaPose, Rigid, Tool};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle;
use panelprep_cell::cycle::{Action, Deadline, Event, Id, Motion, Path, Report, State};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_kuka::eki;
use panelprep_kuka::eki::{CommandId, Time};
use panelprep_store::tape;
use panelprep_store::tape::LoopMemoryStart;
use panelprep_toolpath::path::trace::Trace;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// All ports except the cameras, which the computing thread uses.
pub(super) struct OtherPorts<'a> {
    pub robot: CalibratedRobot<'a>,
    pub tool: &'a mut dyn ToolPort,
    pub record: &'a mut dyn RecordPort,
    pub requests: &'a mut dyn RequestPort,
}

impl OtherPorts<'_> {
    /// Returns the time of the robot's clock.
    pub fn robot_now(&mut self) -> Time {
        self.robot.now()
    }
}

/// The memory of the loop; the memory of the state table is [`State`].
pub(super) struct LoopMemory<'p> {
    pub cell: Arc<CellSetup>,
    /// The data of the cycle; `None` before the first cycle.
    pub cycle: Option<Arc<CycleSetup>>,
    /// Whether the loop runs only this cycle.
    pub is_single: bool,
    pub lock_step: bool,
    pub computing: Computing<'p>,
    pub ports: OtherPorts<'p>,
    pub state: State,
    pub events: VecDeque<Event>,
    pub deadlines: Deadlines,
    pub perception: Perception,
    pub abrasion: AbrasionWork,
    pub trace: Trace,
    pub path_progress: PathProgress,
    pub press_state: PressState,
    pub pending_action: Option<PendingAction>,
    pub sent_path: Option<SentPath>,
    /// The displacement of the panel from its nominal pose in the base frame, as the last localized cycle found it.
    pub last_panel_motion: Option<KukaPose>,
    /// The axis positions at the end of the last path. `None` after a stop, an abort, a lost connection or a start of
    /// the program, and during a motion.
    pub axes_at_path_end: Option<Joints>,
    /// Remarks on the last accepted start, for the record.
    pub remarks: Vec<Reason>,
    /// Number of executed waypoints of the path whose epoch ended last. It is kept until the next motion, because
    /// another answer may replace the answer that reports it.
    pub executed_at_stop: u32,
    pub robot_state: Option<eki::State>,
    pub condition: cycle::Robot,
    /// Whether the override was reported as 100 % to the state table; `None` before the first report.
    pub full_override: Option<bool>,
    /// Contradictions between the reported states and the proven states of the outputs.
    pub feedback_contradiction: FeedbackContradiction,
    pub verdict: Option<Verdict>,
    /// The author of the request that the loop received last.
    pub requester: RequestAuthor,
    /// Which side may command the cell.
    pub control: Control,
    /// Whether the warning was given before a motion since the cell was last idle.
    pub has_warned: bool,
    /// Whether the disk was full at the last check.
    pub is_disk_full: bool,
    /// Whether the loop has accepted a request since it last read the robot.
    pub has_accepted_request: bool,
    /// The last refused stop or abort, its author, and the time at which it was recorded.
    pub last_refused: Option<(cycle::Request, RequestAuthor, Time)>,
}

impl<'p> LoopMemory<'p> {
    pub(super) fn new(
        (cell, cycle): (Arc<CellSetup>, Option<Arc<CycleSetup>>),
        computing: Computing<'p>,
        ports: OtherPorts<'p>,
        (state, lock_step): (State, bool),
    ) -> Self {
        LoopMemory {
            control: Control::new(cell.control_bit),
            has_warned: false,
            cell,
            is_single: cycle.is_some(),
            cycle,
            lock_step,
            computing,
            ports,
            state,
            events: VecDeque::from([Event::Reported(Report::Boot)]),
            deadlines: Deadlines::default(),
            perception: Perception::default(),
            abrasion: AbrasionWork::default(),
            trace: Trace::default(),
            path_progress: PathProgress::default(),
            press_state: PressState::default(),
            pending_action: None,
            sent_path: None,
            remarks: Vec::new(),
            last_panel_motion: None,
            axes_at_path_end: None,
            executed_at_stop: 0,
            robot_state: None,
            condition: cycle::Robot::Unknown,
            full_override: None,
            feedback_contradiction: FeedbackContradiction::default(),
            verdict: None,
            requester: RequestAuthor::from_source(RequestSource::Program),
            is_disk_full: false,
            has_accepted_request: false,
            last_refused: None,
        }
    }

    /// Restores the data with which another loop began a cycle.
    pub(super) fn restore_memory(&mut self, before: LoopMemoryStart) {
        if let LoopMemoryStart::Cycle { robot, armed, place } = before {
            self.last_panel_motion = place;
            self.events.clear();
            (self.robot_state, self.condition) = (robot.map(|robot| *robot), self.state.facts.robot);
            self.full_override = self.robot_state.map(|_| self.state.facts.full_override);
            self.deadlines = Deadlines::from_recording(&armed);
        }
    }

    /// Returns the data that the phases of the cycle use.
    pub(super) fn cycle_setup(&self) -> Option<&CycleSetup> {
        self.cycle.as_deref()
    }
}

/// An action that still waits for its answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct PendingAction {
    pub id: Id,
    pub act: Action,
    pub waits: Condition,
}

/// The events for which an action can wait.
#[derive(Debug, Clone, Copy)]
pub(super) enum Condition {
    /// Waits until the robot is stationary.
    Standing,
    /// The requested epoch.
    Epoch,
    /// Waits for the end of the epoch with tool and water proven off. `done` is the number of executed waypoints, after
    /// it is reported.
    EpochEnd { done: Option<u32> },
    /// Waits until the commands for base and tool are executed and the controller reports the new frames.
    Frames(CommandId),
    /// Waits until the outputs are set and the feedback confirms it.
    Feedback { last: CommandId, proof: SwitchProof },
    /// Waits until the warning before the motion was on for its required time, which begins with the first state that
    /// reports the output as on.
    Warned {
        /// The command that switches the warning output on.
        last: CommandId,
        /// The end of the warning time; `None` before the output is on.
        until: Option<Time>,
    },
    /// The command could not be sent, because the epoch had ended. Waits for the report of the stop that ended the
    /// epoch; if no stop is reported, the action fails.
    NoEpoch {
        /// Number of further robot states until the action fails.
        states: u8,
    },
    /// Waits until the arm is at the ready pose, from which a linear motion may begin.
    Ready(CommandId),
    /// Waits for the end of a path.
    PathEnd,
    /// A computation.
    Computing,
    /// In lock step: waits for the robot's next state, so that time passes until the film's next picture.
    Film,
}

/// The commanded pose at the end of a path.
#[derive(Debug, Clone, Copy)]
pub(super) enum PathEndPose {
    Joints(Joints),
    Tip(Rigid<Base, Tool>),
}

/// The path that was sent last.
#[derive(Debug, Clone, Copy)]
pub(super) struct SentPath {
    pub id: Id,
    pub motion: Motion,
    pub first: CommandId,
    pub last: CommandId,
    pub end: PathEndPose,
    pub reported: u32,
}

impl SentPath {
    /// Returns the kind of the sent path.
    pub fn path(&self) -> Path {
        self.motion.path
    }

    /// Returns the number of the command that executes the path's first waypoint.
    pub fn first_command(&self) -> CommandId {
        self.first
    }

    /// Returns the number of executed waypoints if the commands up to `done` are executed.
    pub fn waypoints(&self, done: CommandId) -> u32 {
        if matches!(self.motion.path, Path::Contact | Path::Air) {
            (done.0 + 1).saturating_sub(self.first.0).min(self.motion.waypoints)
        } else {
            u32::from(done >= self.last) * self.motion.waypoints
        }
    }
}

/// Minimum duration of the permitted motion ahead of the arm, in windows of the connection. If less remains, further
/// waypoints are permitted, up to `MAX_WINDOWS`.
const MIN_WINDOWS: f64 = 2.0;

const MAX_WINDOWS: f64 = 4.0;

/// Minimum number of permitted waypoints ahead of the arm, whatever their duration.
const MIN_AHEAD_WAYPOINTS: u32 = 16;

/// Data of the contact path in progress that are needed for its record.
#[derive(Debug, Default)]
pub(super) struct PathProgress {
    /// Wear of the disc that is already recorded for this path, mm².
    pub reserved_mm2: f64,
    /// The time at which each waypoint is reached at the planned feed, s; the first waypoint is the air point at which
    /// the path begins.
    reached_s: Vec<f64>,
    window_s: f64,
    /// Number of waypoints that may be sent.
    pub permitted: u32,
}

impl PathProgress {
    pub fn new(reached_s: Vec<f64>, window_s: f64) -> Self {
        let mut underway = PathProgress { reached_s, window_s, ..PathProgress::default() };
        underway.permitted = underway.new_permission(0).unwrap_or(0);
        underway
    }

    pub fn waypoint_count(&self) -> u32 {
        u32::try_from(self.reached_s.len().saturating_sub(1)).unwrap_or(u32::MAX)
    }

    fn time_of_waypoint_s(&self, waypoint: u32) -> f64 {
        self.reached_s.get(waypoint as usize).or(self.reached_s.last()).copied().unwrap_or(0.0)
    }

    /// Returns the new number of permitted waypoints after `done` waypoints are executed; `None` if no further waypoint
    /// needs to be permitted now.
    pub fn new_permission(&self, done: u32) -> Option<u32> {
        let (all, now_s) = (self.waypoint_count(), self.time_of_waypoint_s(done));
        let ahead_s = self.time_of_waypoint_s(self.permitted) - now_s;
        if self.permitted >= all
            || (ahead_s >= MIN_WINDOWS * self.window_s
                && self.permitted >= done.saturating_add(MIN_AHEAD_WAYPOINTS / 2))
        {
            return None;
        }
        let until_s = now_s + MAX_WINDOWS * self.window_s;
        let by_time = u32::try_from(self.reached_s.partition_point(|at_s| *at_s < until_s)).unwrap_or(u32::MAX);
        let wanted = by_time.max(done.saturating_add(MIN_AHEAD_WAYPOINTS)).min(all);
        (wanted > self.permitted).then_some(wanted)
    }
}

#[derive(Debug, Clone, Copy)]
struct ArmedDeadline {
    id: Id,
    deadline: Deadline,
    time: Time,
}

/// The armed deadlines.
#[derive(Debug, Default)]
pub(super) struct Deadlines {
    armed: Vec<ArmedDeadline>,
}

impl Deadlines {
    pub fn arm(&mut self, id: Id, which: Deadline, at: Time) {
        // Only one deadline of each kind is active: an older one belongs to an action that has ended.
        self.armed.retain(|armed| armed.deadline != which);
        self.armed.push(ArmedDeadline { id, deadline: which, time: at });
    }

    /// Removes the deadline of an action that was answered.
    pub fn disarm(&mut self, id: Id) {
        self.armed.retain(|armed| !(armed.id == id && armed.deadline == Deadline::Answer));
    }

    /// Returns the active deadlines in the form of a recording.
    pub fn to_recording(&self) -> Vec<tape::ArmedDeadline> {
        let to_armed = |armed: &ArmedDeadline| {
            let at_ns = u64::try_from(armed.time.since_start().as_nanos()).unwrap_or(u64::MAX);
            tape::ArmedDeadline { id: armed.id, which: armed.deadline, at_ns }
        };
        self.armed.iter().map(to_armed).collect()
    }

    /// Creates the deadlines from a recording.
    pub fn from_recording(recorded: &[tape::ArmedDeadline]) -> Self {
        let mut deadlines = Deadlines::default();
        for armed in recorded {
            deadlines.arm(armed.id, armed.which, Time::from_start(Duration::from_nanos(armed.at_ns)));
        }
        deadlines
    }

    /// Removes and returns the earliest deadline that has passed.
    pub fn take_expired(&mut self, now: Time) -> Option<Report> {
        let first = self
            .armed
            .iter()
            .enumerate()
            .filter(|(_, armed)| armed.time <= now)
            .min_by_key(|(_, armed)| armed.time);
        let ArmedDeadline { id, deadline: which, .. } = self.armed.remove(first?.0);
        Some(Report::Deadline { id, which })
    }
}

/// Converts a number of seconds to a duration; returns zero if it is not a valid time.
pub(super) fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_earliest_deadline_comes_first_and_a_new_one_replaces_the_old_one() {
        let mut deadlines = Deadlines::default();
        deadlines.arm(Id(1), Deadline::Spray, Time::from_ms(300));
        deadlines.arm(Id(2), Deadline::Answer, Time::from_ms(200));
        deadlines.arm(Id(3), Deadline::Spray, Time::from_ms(250));
        deadlines.arm(Id(4), Deadline::Token, Time::from_ms(400));
        deadlines.disarm(Id(4));
        assert_eq!(deadlines.take_expired(Time::from_ms(199)), None);
        let over = |deadlines: &mut Deadlines| deadlines.take_expired(Time::from_ms(400));
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(over(&mut deadlines), report(2, Deadline::Answer));
        assert_eq!(over(&mut deadlines), report(3, Deadline::Spray));
        assert_eq!(over(&mut deadlines), report(4, Deadline::Token), "an answer disarms its own deadline alone");
        assert_eq!(over(&mut deadlines), None);
    }

    /// A recording contains the active deadlines; a replay activates them again.
    #[test]
    fn deadlines_of_a_recording_are_armed_again() {
        let mut deadlines = Deadlines::default();
        deadlines.arm(Id(1), Deadline::Drain, Time::from_ms(300));
        deadlines.arm(Id(2), Deadline::Settle, Time::from_ms(200));
        let mut again = Deadlines::from_recording(&deadlines.to_recording());
        assert_eq!(again.take_expired(Time::from_ms(199)), None);
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(again.take_expired(Time::from_ms(300)), report(2, Deadline::Settle));
        assert_eq!(again.take_expired(Time::from_ms(300)), report(1, Deadline::Drain));
    }
}
