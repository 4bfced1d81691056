//! The link as the rest of the program uses it: commands go in, reports come out. Callers without an async runtime,
//! such as a command that performs one task, have a link that blocks.

use super::queue::{self, LinkRequest, ReportQueue};
use super::run::{self, Address};
use panelprep_base::supervision::{WatchedThread, supervise};
use panelprep_cell::cell;
use panelprep_kuka::eki::{
    CELLCMD, CELLSTAT, ChannelError, ChannelFile, ClockMode, Command, CommandId, Epoch, LinkLimits, MappedInputs,
    MoveLin, QueueError, Report, SchemaError, Session, Wire,
};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::sync::{mpsc, oneshot};

/// Maximum time between two heartbeats of the thread.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Time within which the link's thread answers each request, and within which it ends.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(2);

/// The priority of the link's thread over other threads of the machine (nice value).
const NICE: i32 = -10;

/// Returns the link's limits from the cell's file.
pub fn link_limits(cell: &cell::Cell) -> LinkLimits {
    let limits = cell.limits();
    let ms = |ms: usize| Duration::from_millis(ms as u64);
    LinkLimits {
        window: Duration::try_from_secs_f64(limits.window_s()).unwrap_or_default(),
        window_commands: limits.window_commands(),
        min_points: limits.min_points(),
        heartbeat: ms(limits.heartbeat_ms()),
        watchdog: ms(limits.watchdog_ms()),
        // The default is never used: a cell's file with too many names was already refused.
        mapped_inputs: MappedInputs::new(cell.inputs_outputs().mapped_inputs().values().copied())
            .unwrap_or_default(),
        harmful_outputs: cell.inputs_outputs().harmful_bits(),
    }
}

/// The reason why a link cannot be started. An absent controller is not such an error: the link reports it.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// A channel's file cannot be read.
    #[error("{file}: {error}")]
    Channel {
        /// Name of the file.
        file: &'static str,
        /// The problem in the file.
        error: ChannelError,
    },
    /// The files do not fit this program.
    #[error("the EthernetKRL files do not match this program: {0}")]
    Schema(#[from] SchemaError),
    /// The operating system cannot create a thread or an async runtime.
    #[error("the robot link's thread cannot start: {0}")]
    Thread(#[from] std::io::Error),
}

/// The controller's outputs to a line; with this handle, only these outputs can be set, and nothing can be moved.
/// Clones refer to the same outputs.
#[derive(Debug, Clone)]
pub struct LineOutputs(mpsc::WeakUnboundedSender<LinkRequest>);

impl LineOutputs {
    /// Sets the outputs, the first output by the lowest bit. They reach the controller with the next message to it.
    pub fn set(&self, bits: u32) {
        // The handle of the line's outputs does not keep the link alive.
        let Some(orders) = self.0.upgrade() else { return };
        #[expect(clippy::let_underscore_must_use, reason = "if the link has ended, there is no receiver")]
        let _ = orders.send(LinkRequest::Line(bits));
    }
}

/// The fastest way to stop the robot: the abort frame is sent at once, even while the rest of the program waits. All
/// clones stop the same link.
#[derive(Debug, Clone)]
pub struct StopLine(mpsc::WeakUnboundedSender<LinkRequest>);

impl StopLine {
    /// Ends the open epoch, as [`RobotLink::abort`] does, without waiting. If there is nothing to stop, it sends
    /// nothing.
    pub fn stop(&self) {
        // The handle for stopping does not keep the link alive.
        let Some(orders) = self.0.upgrade() else { return };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "a link that has ended has closed its connections, which stops the controller"
        )]
        let _ = orders.send(LinkRequest::Stop);
    }
}

/// The link to one controller.
#[derive(Debug)]
pub struct RobotLink {
    orders: mpsc::UnboundedSender<LinkRequest>,
    reports: Arc<ReportQueue>,
    pace: ClockMode,
    /// The number of reports when time was last allowed to pass.
    granted: Option<u64>,
    thread: Option<JoinHandle<()>>,
    watched: WatchedThread,
}

impl RobotLink {
    /// Starts the link's thread, which begins to connect.
    ///
    /// # Errors
    /// If the shipped EthernetKRL files do not fit, or the system cannot start a thread.
    pub fn start(address: Address, limits: LinkLimits, pace: ClockMode) -> Result<Self, StartError> {
        let read = |file, text| ChannelFile::parse(text).map_err(|error| StartError::Channel { file, error });
        let wire = Wire::new(&read("CELLCMD.xml", CELLCMD)?, &read("CELLSTAT.xml", CELLSTAT)?)?;
        let session = Session::new(wire, limits, pace);
        let (orders, taken) = mpsc::unbounded_channel();
        let reports = Arc::new(ReportQueue::default());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        let (sign, watched) = supervise("robot link", HEARTBEAT_TIMEOUT);
        let link = run::LinkLoop::new(address, session, pace, (taken, reports.clone()), sign);
        let thread = std::thread::Builder::new().name("robot link".to_owned());
        let thread = thread.spawn(move || {
            if pace == ClockMode::Wall {
                raise_priority();
            }
            runtime.block_on(link.run());
        })?;
        Ok(RobotLink { orders, reports, pace, granted: None, thread: Some(thread), watched })
    }

    /// Returns the link's thread for its supervisor.
    pub fn supervision_handle(&self) -> WatchedThread {
        self.watched.clone()
    }

    /// Returns the controller's outputs to a line.
    pub fn line(&self) -> LineOutputs {
        LineOutputs(self.orders.downgrade())
    }

    /// Returns the fastest way to stop the robot.
    pub fn stop_line(&self) -> StopLine {
        StopLine(self.orders.downgrade())
    }

    /// Queues one command and returns its id, 0 for `get_current_state`.
    ///
    /// # Errors
    /// If there is no controller, no open epoch, or the command cannot be executed.
    pub async fn send(&self, command: Command) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::Queue(command, reply)).await
    }

    /// Queues a whole path, in the active base, and returns the id of its last point.
    ///
    /// # Errors
    /// As [`RobotLink::send`]; one bad point refuses all points.
    pub async fn send_path(&self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::QueuePath(points, reply)).await
    }

    /// Queues a whole path, but sends only the first `permitted` points until more points are permitted.
    ///
    /// # Errors
    /// As [`RobotLink::send_path`].
    pub async fn send_path_within(&self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::QueuePathWithin(points, permitted, reply)).await
    }

    /// Permits commands up to this one to be sent, or all if it is `None`.
    ///
    /// # Errors
    /// If no epoch is open.
    pub async fn permit_commands(&self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.send_request(|reply| LinkRequest::Permit(last, reply)).await
    }

    /// Requests a new epoch; [`Report::EpochOpened`] follows. Nothing moves.
    ///
    /// # Errors
    /// If no controller has answered yet.
    pub async fn open_epoch(&self) -> Result<Epoch, QueueError> {
        self.open_epoch_above(Epoch(0)).await
    }

    /// Opens an epoch with a number above `above`.
    ///
    /// # Errors
    /// As [`RobotLink::open_epoch`].
    pub async fn open_epoch_above(&self, above: Epoch) -> Result<Epoch, QueueError> {
        self.send_request(|reply| LinkRequest::OpenEpoch(above, reply)).await
    }

    /// Ends the epoch; [`Report::Standstill`] follows.
    ///
    /// # Errors
    /// If no controller has answered yet.
    pub async fn abort(&self) -> Result<(), QueueError> {
        self.send_request(LinkRequest::Abort).await
    }

    /// Returns the next report. If this future is dropped while it waits, no report is lost. In lock step the
    /// controller's time passes only in this function.
    pub async fn next(&mut self) -> Report {
        loop {
            match self.reports.pop() {
                Ok(report) => return report,
                Err(queue::NoReport { closed: true, .. }) => std::future::pending().await,
                Err(queue::NoReport { told, .. })
                    if self.pace == ClockMode::LockStep && self.granted != Some(told) =>
                {
                    self.granted = Some(told);
                    #[expect(
                        clippy::let_underscore_must_use,
                        reason = "refused only if the thread has ended, which closes the queue"
                    )]
                    let _ = self.orders.send(LinkRequest::Grant { told });
                }
                Err(_) => {}
            }
            self.reports.changed().await;
        }
    }

    async fn send_request<T>(
        &self,
        order: impl FnOnce(oneshot::Sender<Result<T, QueueError>>) -> LinkRequest,
    ) -> Result<T, QueueError> {
        let (reply, answer) = oneshot::channel();
        self.orders.send(order(reply)).map_err(|_| QueueError::NotConnected)?;
        // The thread answers at once. If it does not, it has failed, and the caller must not wait for it for ever.
        match tokio::time::timeout(RESPONSE_TIMEOUT, answer).await {
            Ok(Ok(answer)) => answer,
            Ok(Err(_)) | Err(_) => Err(QueueError::NotConnected),
        }
    }
}

impl Drop for RobotLink {
    fn drop(&mut self) {
        // The thread ends when no sender of orders is left.
        (self.orders, _) = mpsc::unbounded_channel();
        // Waits for the thread, because it still sends the abort of a cycle that is being left.
        let Some(thread) = self.thread.take() else { return };
        let since = Instant::now();
        while !thread.is_finished() {
            if since.elapsed() > RESPONSE_TIMEOUT {
                tracing::warn!(
                    "the robot link's thread does not end; the controller's own watchdog stops the robot"
                );
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
        let _ = thread.join();
    }
}

/// Raises the priority of the calling thread only. If the system does not permit this (the unit's `LimitNICE` does),
/// the link runs at the program's own priority. Computing threads have lowered their own priority below that.
fn raise_priority() {
    if let Err(error) = rustix::process::setpriority_process(None, NICE) {
        tracing::info!("the priority of the robot link's thread cannot be raised: {error}");
    }
}

/// A [`RobotLink`] with blocking calls.
#[derive(Debug)]
pub struct BlockingLink {
    // This field is dropped first, so that the link's thread ends by itself.
    link: RobotLink,
    runtime: Runtime,
}

impl BlockingLink {
    /// Starts the link as [`RobotLink::start`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::start`].
    pub fn start(address: Address, limits: LinkLimits, pace: ClockMode) -> Result<Self, StartError> {
        let link = RobotLink::start(address, limits, pace)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
        Ok(BlockingLink { link, runtime })
    }

    /// Queues one command as [`RobotLink::send`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::send`].
    pub fn send(&self, command: Command) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send(command))
    }

    /// Queues a whole path as [`RobotLink::send_path`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::send_path`].
    pub fn send_path(&self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path(points))
    }

    /// Queues a path of which only some points are permitted, as [`RobotLink::send_path_within`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::send_path_within`].
    pub fn send_path_within(&self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path_within(points, permitted))
    }

    /// Permits more commands, as [`RobotLink::permit_commands`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::permit_commands`].
    pub fn permit_commands(&self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.runtime.block_on(self.link.permit_commands(last))
    }

    /// Opens an epoch as [`RobotLink::open_epoch`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::open_epoch`].
    pub fn open_epoch(&self) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch())
    }

    /// Opens an epoch with a number above `above`, as [`RobotLink::open_epoch_above`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::open_epoch_above`].
    pub fn open_epoch_above(&self, above: Epoch) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch_above(above))
    }

    /// Ends the epoch as [`RobotLink::abort`] does.
    ///
    /// # Errors
    /// As for [`RobotLink::abort`].
    pub fn abort(&self) -> Result<(), QueueError> {
        self.runtime.block_on(self.link.abort())
    }

    /// As [`RobotLink::line`].
    pub fn line(&self) -> LineOutputs {
        self.link.line()
    }

    /// As [`RobotLink::stop_line`].
    pub fn stop_line(&self) -> StopLine {
        self.link.stop_line()
    }

    /// As [`RobotLink::watched`].
    pub fn supervision_handle(&self) -> WatchedThread {
        self.link.supervision_handle()
    }

    /// Returns the next report; `None` if none arrives within this time by the wall clock.
    pub fn next(&mut self, patience: Duration) -> Option<Report> {
        let BlockingLink { link, runtime } = self;
        runtime.block_on(async { tokio::time::timeout(patience, link.next()).await.ok() })
    }
}
