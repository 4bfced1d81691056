//! The interface of the loop to the robot and its compliant tool. The robot receives commands, returns reports, and
//! provides the clock of its motions. Its last reported position can also be read by other threads ([`LastState`]). No
//! command waits for an answer of the tool.

use super::port::{Command as PortCommand, Port};
use panelprep_base::geometry::Joints;
use panelprep_base::supervision::{ThreadFault, WatchedThread};
use panelprep_cell::cell::Cell;
use panelprep_cell::force::ForceSetPoint;
use panelprep_devices::acf::{ConnectedTool, ToolReport};
use panelprep_devices::robot::{Address, BlockingLink, LineOutputs, StartError, StopLine, link_limits};
use panelprep_kuka::eki;
use panelprep_kuka::eki::{ClockMode, Command, CommandId, Epoch, MoveLin, QueueError, Report, Time};
use serde::Serialize;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The commands to the robot.
#[derive(Debug)]
pub enum RobotCommand {
    /// Queues one command.
    Send(Command),
    /// Queues a whole path in the active base. If `permitted` is given, only this number of points is sent until more
    /// points are permitted.
    Path {
        /// The points.
        points: Vec<MoveLin>,
        /// The number of points that may be sent now; `None` if all may be sent.
        permitted: Option<u32>,
    },
    /// Permits the commands up to this one to be sent; `None` permits all of them.
    Permit(Option<CommandId>),
    /// Requests a new epoch whose number is above this one.
    OpenEpoch(Epoch),
    /// Ends the epoch.
    Abort,
    /// Waits for the next report. In lock step, time passes only during this command.
    Next,
    /// Reads the clock; in lock step, the virtual clock.
    Now,
}

/// The answers of the robot.
#[derive(Debug)]
pub enum RobotAnswer {
    /// Answer to `Send` and `Path`: the number of the command, or of the last point of the path.
    Queued(Result<CommandId, QueueError>),
    /// Answer to `OpenEpoch`: the requested epoch.
    Epoch(Result<Epoch, QueueError>),
    /// Answer to `Permit` and `Abort`.
    Done(Result<(), QueueError>),
    /// Answer to `Next`: a report, or `None` if no report arrived within the waiting time. An error states that the
    /// thread of the connection failed, so that no further report will arrive.
    Report(Result<Option<Report>, ThreadFault>),
    /// Answer to `Now`.
    Time(Time),
}

impl PortCommand for RobotCommand {
    type Answer = RobotAnswer;
}

/// The error for an answer to a different command; no port gives such an answer.
const MISMATCH: QueueError = QueueError::NotConnected;

/// The commands of the robot as functions. A command cannot be queued if no controller is connected, no epoch is open,
/// or the command cannot be executed.
pub trait RobotPort: Port<RobotCommand> {
    /// Queues one command.
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        let RobotAnswer::Queued(id) = self.perform(RobotCommand::Send(command)) else { return Err(MISMATCH) };
        id
    }

    /// Queues a whole path; see [`RobotCommand::Path`].
    fn send_path(&mut self, points: Vec<MoveLin>, permitted: Option<u32>) -> Result<CommandId, QueueError> {
        let path = RobotCommand::Path { points, permitted };
        let RobotAnswer::Queued(last) = self.perform(path) else { return Err(MISMATCH) };
        last
    }

    /// Permits the commands up to this one to be sent; `None` permits all of them.
    fn permit_commands(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        let RobotAnswer::Done(done) = self.perform(RobotCommand::Permit(last)) else { return Err(MISMATCH) };
        done
    }

    /// Requests a new epoch whose number is above this one; returns the number of the new epoch.
    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        let RobotAnswer::Epoch(asked) = self.perform(RobotCommand::OpenEpoch(above)) else { return Err(MISMATCH) };
        asked
    }

    /// Ends the epoch.
    fn abort(&mut self) -> Result<(), QueueError> {
        let RobotAnswer::Done(done) = self.perform(RobotCommand::Abort) else { return Err(MISMATCH) };
        done
    }

    /// Waits a limited time for the next report. Fails if the thread of the connection failed.
    fn next(&mut self) -> Result<Option<Report>, ThreadFault> {
        let RobotAnswer::Report(report) = self.perform(RobotCommand::Next) else { return Ok(None) };
        report
    }

    /// Reads the clock.
    fn now(&mut self) -> Time {
        let RobotAnswer::Time(now) = self.perform(RobotCommand::Now) else { return Time::default() };
        now
    }
}

impl<P: Port<RobotCommand> + ?Sized> RobotPort for P {}

/// A robot that is connected over the network.
pub struct LinkedRobot {
    link: BlockingLink,
    pace: ClockMode,
    started: Instant,
    virtual_now: Time,
    last: LastState,
}

impl LinkedRobot {
    /// Creates the port for the robot at the other end of this connection; `pace` is the clock mode.
    pub fn new(link: BlockingLink, pace: ClockMode) -> Self {
        LinkedRobot {
            link,
            pace,
            started: Instant::now(),
            virtual_now: Time::default(),
            last: LastState::default(),
        }
    }

    /// Starts the link to the controller that the cell's file names, in real time; it connects on its own.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn start(cell: &Cell) -> Result<Self, StartError> {
        let link = BlockingLink::start(Address::from(cell.robot()), link_limits(cell), ClockMode::Wall)?;
        Ok(LinkedRobot::new(link, ClockMode::Wall))
    }

    /// Returns the handle that other threads use to read the robot's last state.
    pub fn last_state(&self) -> LastState {
        self.last.clone()
    }

    /// Returns the outputs by which the controller informs a production line.
    pub fn line(&self) -> LineOutputs {
        self.link.line()
    }

    /// Returns the direct connection by which a stop reaches the robot fastest; `None` in lock step, in which all
    /// events have a fixed order.
    pub fn stop_line(&self) -> Option<StopLine> {
        (self.pace == ClockMode::Wall).then(|| self.link.stop_line())
    }

    /// Returns the thread of the connection, for its supervisor.
    pub fn supervision_handle(&self) -> WatchedThread {
        self.link.supervision_handle()
    }

    /// Returns whether time passes only while the loop waits for a report.
    pub fn is_lock_step(&self) -> bool {
        self.pace == ClockMode::LockStep
    }

    fn receive(&mut self) -> Result<Option<Report>, ThreadFault> {
        let report = self.link.next(REPORT_POLL_TIMEOUT);
        match &report {
            Some(Report::State(state) | Report::Connected { state }) => {
                self.last.set(Some(state));
                self.virtual_now = Time::from_ms(u64::from(state.time_ms));
            }
            Some(Report::LinkLost { .. }) => self.last.set(None),
            Some(_) => {}
            None => self.link.supervision_handle().check_thread()?,
        }
        Ok(report)
    }
}

/// Maximum time by the wall clock for which the loop waits for a report of the robot, before it checks its other
/// inputs. In lock step, checking other inputs takes no time.
const REPORT_POLL_TIMEOUT: Duration = Duration::from_millis(20);

impl Port<RobotCommand> for LinkedRobot {
    fn perform(&mut self, command: RobotCommand) -> RobotAnswer {
        match command {
            RobotCommand::Send(command) => RobotAnswer::Queued(self.link.send(command)),
            RobotCommand::Path { points, permitted: None } => RobotAnswer::Queued(self.link.send_path(points)),
            RobotCommand::Path { points, permitted: Some(permitted) } => {
                RobotAnswer::Queued(self.link.send_path_within(points, permitted))
            }
            RobotCommand::Permit(last) => RobotAnswer::Done(self.link.permit_commands(last)),
            RobotCommand::OpenEpoch(above) => RobotAnswer::Epoch(self.link.open_epoch_above(above)),
            RobotCommand::Abort => RobotAnswer::Done(self.link.abort()),
            RobotCommand::Next => RobotAnswer::Report(self.receive()),
            RobotCommand::Now => RobotAnswer::Time(match self.pace {
                ClockMode::LockStep => self.virtual_now,
                ClockMode::Wall => Time::from_start(self.started.elapsed()),
            }),
        }
    }
}

/// Maximum age of the robot's last state at which its axis positions are still treated as the present positions.
const MAX_STATE_AGE: Duration = Duration::from_millis(500);

/// The robot's last state, and the time of its arrival. Clones share the same state.
#[derive(Debug, Clone, Default)]
pub struct LastState(Arc<Mutex<Option<(eki::State, Instant)>>>);

impl LastState {
    /// Records the last state; `None` if the connection is lost.
    pub fn set(&self, state: Option<&eki::State>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state.map(|state| (*state, Instant::now()));
    }

    /// Returns the mapped inputs of the controller as bits, if the last state is recent.
    pub(in crate::daemon) fn inputs(&self) -> Option<u32> {
        let (state, came) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        (came.elapsed() < MAX_STATE_AGE).then_some(state.inputs)
    }

    /// Returns the positions of the axes if the arm is stationary and the last state is recent.
    pub(in crate::daemon) fn resting_joints(&self) -> Option<Joints> {
        let (state, came) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        (came.elapsed() < MAX_STATE_AGE && !state.moving).then_some(state.joints)
    }
}

/// The commands to the compliant tool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ToolCommand {
    /// Presses with these force set-points from now on.
    Press(ForceSetPoint),
    /// Reports the news.
    Report,
}

/// The answers of the compliant tool.
#[derive(Debug, Clone, PartialEq)]
pub enum ToolAnswer {
    /// Answer to `Press`.
    Done,
    /// Answer to `Report`: a measured value, or the loss of the connection to the tool; `None` if there is no new
    /// report.
    Report(Option<ToolReport>),
}

impl PortCommand for ToolCommand {
    type Answer = ToolAnswer;
}

/// The commands of the compliant tool as functions.
pub trait ToolPort: Port<ToolCommand> {
    /// See [`ToolCommand::Press`].
    fn set_force(&mut self, press: ForceSetPoint) {
        self.perform(ToolCommand::Press(press));
    }

    /// See [`ToolCommand::Report`].
    fn next_report(&mut self) -> Option<ToolReport> {
        let ToolAnswer::Report(news) = self.perform(ToolCommand::Report) else { return None };
        news
    }
}

impl<P: Port<ToolCommand> + ?Sized> ToolPort for P {}

/// A tool that is connected over the network; `None` if the tool is a spring.
#[derive(Default)]
pub struct LinkedTool(Option<Box<dyn ConnectedTool>>);

impl LinkedTool {
    /// Links this tool.
    pub fn new(tool: impl ConnectedTool + 'static) -> Self {
        LinkedTool(Some(Box::new(tool)))
    }
}

impl Port<ToolCommand> for LinkedTool {
    fn perform(&mut self, command: ToolCommand) -> ToolAnswer {
        match (command, &mut self.0) {
            (ToolCommand::Press(press), Some(tool)) => {
                tool.set_force(press);
                ToolAnswer::Done
            }
            (ToolCommand::Press(_), None) => ToolAnswer::Done,
            (ToolCommand::Report, tool) => ToolAnswer::Report(tool.as_mut().and_then(|tool| tool.next_report())),
        }
    }
}
