//! The link for callers without an async runtime, such as a command that performs one task.

use super::address::Address;
use super::link::{LineOutputs, RobotLink, StartError, StopLine};
use panelprep_base::supervision::WatchedThread;
use panelprep_kuka::eki::{ClockMode, Command, CommandId, Epoch, LinkLimits, MoveLin, QueueError, Report};
use std::time::Duration;
use tokio::runtime::Runtime;

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
