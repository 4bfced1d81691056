//! The interface of the robot link for the rest of the program: it sends commands and receives reports. For callers
//! without an async runtime, such as a command that performs one task, there is a link with blocking calls.

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

/// Maximum time between two heartbeats of the link's thread; after this time its supervisor reports it as hanging.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Maximum time in which the link's thread replies to a request, and in which it ends.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(2);

/// The nice value of the link's thread; a negative value has priority over other threads of the computer.
const LINK_NICE_VALUE: i32 = -10;

/// Returns the limits of the link according to the cell file.
pub fn link_limits(cell: &cell::Cell) -> LinkLimits {
    let limits = cell.limits();
    let ms = |ms: usize| Duration::from_millis(ms as u64);
    LinkLimits {
        window: Duration::try_from_secs_f64(limits.window_s()).unwrap_or_default(),
        window_commands: limits.window_commands(),
        min_points: limits.min_points(),
        heartbeat: ms(limits.heartbeat_ms()),
        watchdog: ms(limits.watchdog_ms()),
        // The default is never used, because a cell file with too many mapped inputs is refused before.
        mapped_inputs: MappedInputs::new(cell.inputs_outputs().mapped_inputs().values().copied())
            .unwrap_or_default(),
        harmful_outputs: cell.inputs_outputs().immediate_off_bits(),
    }
}

/// The reason why a link cannot be started. A missing controller is not such a reason: the link reports it and tries
/// again.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// An EthernetKRL file cannot be parsed.
    #[error("{file}: {error}")]
    Channel {
        /// The name of the EthernetKRL file.
        file: &'static str,
        /// The problem in the file.
        error: ChannelError,
    },
    /// The EthernetKRL files do not match this program.
    #[error("the EthernetKRL files do not match this program: {0}")]
    Schema(#[from] SchemaError),
    /// The operating system cannot create a thread or an async runtime.
    #[error("the robot link's thread cannot start: {0}")]
    Thread(#[from] std::io::Error),
}

/// A handle of the controller's outputs to a production line. It can set only these outputs and cannot move the robot.
/// Clones set the same outputs.
#[derive(Debug, Clone)]
pub struct LineOutputs(mpsc::WeakUnboundedSender<LinkRequest>);

impl LineOutputs {
    /// Sets the outputs; the lowest bit is the first output. The values are sent with the next message to the
    /// controller.
    pub fn set(&self, bits: u32) {
        // The handle holds only a weak reference, so it does not keep the link alive.
        let Some(orders) = self.0.upgrade() else { return };
        #[expect(clippy::let_underscore_must_use, reason = "sending fails only if the link has already ended")]
        let _ = orders.send(LinkRequest::Line(bits));
    }
}

/// A handle that stops the robot as fast as possible: the abort is sent immediately, even while the rest of the program
/// waits. All clones stop the same link.
#[derive(Debug, Clone)]
pub struct StopLine(mpsc::WeakUnboundedSender<LinkRequest>);

impl StopLine {
    /// Ends the open epoch like [`RobotLink::abort`], but without waiting. If there is nothing to stop, nothing is
    /// sent.
    pub fn stop(&self) {
        // The handle holds only a weak reference, so it does not keep the link alive.
        let Some(orders) = self.0.upgrade() else { return };
        #[expect(
            clippy::let_underscore_must_use,
            reason = "a link that has ended has closed its connections, which stops the controller"
        )]
        let _ = orders.send(LinkRequest::Stop);
    }
}

/// The link to a robot controller.
#[derive(Debug)]
pub struct RobotLink {
    orders: mpsc::UnboundedSender<LinkRequest>,
    reports: Arc<ReportQueue>,
    pace: ClockMode,
    /// The number of reports when the controller's time was last advanced; only in lock step.
    granted: Option<u64>,
    thread: Option<JoinHandle<()>>,
    watched: WatchedThread,
}

impl RobotLink {
    /// Starts the thread of the link, which begins to connect.
    ///
    /// # Errors
    /// If the shipped EthernetKRL files do not match this program, or the operating system cannot start a thread.
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

    /// Returns the handle by which a supervisor watches the link's thread.
    pub fn supervision_handle(&self) -> WatchedThread {
        self.watched.clone()
    }

    /// Returns a handle of the controller's outputs to a production line.
    pub fn line(&self) -> LineOutputs {
        LineOutputs(self.orders.downgrade())
    }

    /// Returns a handle that stops the robot as fast as possible.
    pub fn stop_line(&self) -> StopLine {
        StopLine(self.orders.downgrade())
    }

    /// Queues one command and returns its id; the id of `get_current_state` is 0.
    ///
    /// # Errors
    /// If no controller is connected, no epoch is open, or the command cannot be executed.
    pub async fn send(&self, command: Command) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::Queue(command, reply)).await
    }

    /// Queues a whole path in the active base, and returns the id of its last point.
    ///
    /// # Errors
    /// The errors of [`RobotLink::send`]; one invalid point refuses the whole path.
    pub async fn send_path(&self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::QueuePath(points, reply)).await
    }

    /// Queues a whole path, but sends only the first `permitted` points until [`RobotLink::permit_commands`] permits
    /// more.
    ///
    /// # Errors
    /// The errors of [`RobotLink::send_path`].
    pub async fn send_path_within(&self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.send_request(|reply| LinkRequest::QueuePathWithin(points, permitted, reply)).await
    }

    /// Permits the link to send commands up to this one; `None` permits all commands.
    ///
    /// # Errors
    /// If no epoch is open.
    pub async fn permit_commands(&self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.send_request(|reply| LinkRequest::Permit(last, reply)).await
    }

    /// Requests a new epoch; [`Report::EpochOpened`] follows. Nothing moves.
    ///
    /// # Errors
    /// If no controller has replied yet.
    pub async fn open_epoch(&self) -> Result<Epoch, QueueError> {
        self.open_epoch_above(Epoch(0)).await
    }

    /// Requests a new epoch with a number higher than `above`.
    ///
    /// # Errors
    /// The errors of [`RobotLink::open_epoch`].
    pub async fn open_epoch_above(&self, above: Epoch) -> Result<Epoch, QueueError> {
        self.send_request(|reply| LinkRequest::OpenEpoch(above, reply)).await
    }

    /// Ends the epoch; [`Report::Standstill`] follows.
    ///
    /// # Errors
    /// If no controller has replied yet.
    pub async fn abort(&self) -> Result<(), QueueError> {
        self.send_request(LinkRequest::Abort).await
    }

    /// Returns the next report. The future is cancel-safe: if it is dropped, no report is lost. In lock step the
    /// controller's time advances only in this function.
    pub async fn next(&mut self) -> Report {
        loop {
            match self.reports.pop() {
                Ok(report) => return report,
                Err(queue::NoReport { closed: true, .. }) => std::future::pending().await,
                Err(queue::NoReport { report_count, .. })
                    if self.pace == ClockMode::LockStep && self.granted != Some(report_count) =>
                {
                    self.granted = Some(report_count);
                    #[expect(
                        clippy::let_underscore_must_use,
                        reason = "sending fails only if the thread has ended, which also closes the queue"
                    )]
                    let _ = self.orders.send(LinkRequest::Grant { report_count });
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
        // The thread replies without delay. If it does not, it has failed, and the caller must not wait forever.
        match tokio::time::timeout(RESPONSE_TIMEOUT, answer).await {
            Ok(Ok(answer)) => answer,
            Ok(Err(_)) | Err(_) => Err(QueueError::NotConnected),
        }
    }
}

impl Drop for RobotLink {
    fn drop(&mut self) {
        // The thread ends when all senders of its request channel are dropped.
        (self.orders, _) = mpsc::unbounded_channel();
        // The thread must end before this function returns, because it still sends an abort if a cycle is running.
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

/// Raises the priority of the calling thread only. If the operating system does not permit this (the unit's `LimitNICE`
/// does), the link has the priority of the program. The threads for computations have lowered their own priority, so
/// the link still precedes them.
fn raise_priority() {
    if let Err(error) = rustix::process::setpriority_process(None, LINK_NICE_VALUE) {
        tracing::info!("the priority of the robot link's thread cannot be raised: {error}");
    }
}

/// A [`RobotLink`] whose functions block.
#[derive(Debug)]
pub struct BlockingLink {
    // This field is declared first because it must be dropped first; then the link's thread ends.
    link: RobotLink,
    runtime: Runtime,
}

impl BlockingLink {
    /// Starts the link like [`RobotLink::start`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::start`].
    pub fn start(address: Address, limits: LinkLimits, pace: ClockMode) -> Result<Self, StartError> {
        let link = RobotLink::start(address, limits, pace)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
        Ok(BlockingLink { link, runtime })
    }

    /// Queues one command like [`RobotLink::send`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::send`].
    pub fn send(&self, command: Command) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send(command))
    }

    /// Queues a whole path like [`RobotLink::send_path`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::send_path`].
    pub fn send_path(&self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path(points))
    }

    /// Queues a path of which only some points are permitted, like [`RobotLink::send_path_within`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::send_path_within`].
    pub fn send_path_within(&self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path_within(points, permitted))
    }

    /// Permits more commands, like [`RobotLink::permit_commands`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::permit_commands`].
    pub fn permit_commands(&self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.runtime.block_on(self.link.permit_commands(last))
    }

    /// Requests a new epoch, like [`RobotLink::open_epoch`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::open_epoch`].
    pub fn open_epoch(&self) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch())
    }

    /// Requests a new epoch with a number higher than `above`, like [`RobotLink::open_epoch_above`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::open_epoch_above`].
    pub fn open_epoch_above(&self, above: Epoch) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch_above(above))
    }

    /// Ends the epoch, like [`RobotLink::abort`].
    ///
    /// # Errors
    /// The errors of [`RobotLink::abort`].
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

    /// Returns the next report; `None` if no report arrives within this time on the wall clock.
    pub fn next(&mut self, patience: Duration) -> Option<Report> {
        let BlockingLink { link, runtime } = self;
        runtime.block_on(async { tokio::time::timeout(patience, link.next()).await.ok() })
    }
}
