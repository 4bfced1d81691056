//! The memory of the loop.

use super::abrasion::AbrasionWork;
use super::computing::Computing;
use super::control::Control;
use super::corrected::CalibratedRobot;
use super::deadlines::Deadlines;
use super::feedbacks::FeedbackContradiction;
use super::path_progress::PathProgress;
use super::path_progress::SentPath;
use super::pending_action::PendingAction;
use super::perception::Perception;
use super::ports::{RecordPort, RequestPort, RobotPort, ToolPort};
use super::setup::{CellSetup, CycleSetup};
use super::tool_state::PressState;
use panelprep_base::geometry::{Joints, KukaPose};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{self, Event, Report, State};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_kuka::eki::{self, Time};
use panelprep_store::tape::LoopMemoryStart;
use panelprep_toolpath::path::trace::Trace;
use std::collections::VecDeque;
use std::sync::Arc;

/// All ports except the cameras, which are used by the computing thread.
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

/// The memory of the loop; the memory of the table is [`State`].
pub(super) struct LoopMemory<'p> {
    pub cell: Arc<CellSetup>,
    /// The setup of the cycle; `None` before the first cycle.
    pub cycle: Option<Arc<CycleSetup>>,
    /// The loop was started to run this one cycle only.
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
    /// The motion from a panel's nominal pose to the pose last known in the earlier cycles, in the base.
    pub last_panel_motion: Option<KukaPose>,
    /// The axes at the end of the last path. `None` after a stop, an abort, a lost robot or a start of the program,
    /// and during a motion.
    pub axes_at_path_end: Option<Joints>,
    /// Remarks for the record on the last accepted start.
    pub remarks: Vec<Reason>,
    /// Executed waypoints of the path whose epoch was ended last. They are retained until the next motion, because the
    /// answer that reports them may be dropped in favour of another one.
    pub executed_at_stop: u32,
    pub robot_state: Option<eki::State>,
    pub condition: cycle::Robot,
    /// The last report to the table about the override; `None` before the first report.
    pub full_override: Option<bool>,
    /// Contradictions between a reported state and what was proven.
    pub feedback_contradiction: FeedbackContradiction,
    pub verdict: Option<Verdict>,
    /// The author of the request that the loop took last.
    pub requester: RequestAuthor,
    /// Which side may command the cell.
    pub control: Control,
    /// The cell has warned of motion since it last rested.
    pub has_warned: bool,
    /// Whether the disk was full at the last check.
    pub is_disk_full: bool,
    /// The loop has taken a request, and the robot has not been read since.
    pub has_accepted_request: bool,
    /// The last refused stop or abort, its author, and when it was recorded.
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

    /// Continues from the point at which another loop began a cycle.
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
