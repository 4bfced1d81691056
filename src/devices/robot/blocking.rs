//! The link for callers without a runtime, such as a command that does one thing.

use super::address::Address;
use super::link::{LineOutputs, RobotLink, StartError, StopLine};
use crate::eki::{Command, CommandId, Epoch, LinkLimits, MoveLin, Pace, QueueError, Report};
use crate::supervision::Watched;
use std::time::Duration;
use tokio::runtime::Runtime;

/// A [`RobotLink`] with blocking calls.
#[derive(Debug)]
pub struct BlockingLink {
    // Dropped first: its thread ends by itself.
    link: RobotLink,
    runtime: Runtime,
}

impl BlockingLink {
    /// As [`RobotLink::start`].
    ///
    /// # Errors
    /// As there.
    pub fn start(address: Address, limits: LinkLimits, pace: Pace) -> Result<Self, StartError> {
        let link = RobotLink::start(address, limits, pace)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
        Ok(BlockingLink { link, runtime })
    }

    /// As [`RobotLink::send`].
    ///
    /// # Errors
    /// As there.
    pub fn send(&self, command: Command) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send(command))
    }

    /// As [`RobotLink::send_path`].
    ///
    /// # Errors
    /// As there.
    pub fn send_path(&self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path(points))
    }

    /// As [`RobotLink::send_path_within`].
    ///
    /// # Errors
    /// As there.
    pub fn send_path_within(&self, points: Vec<MoveLin>, permitted: u32) -> Result<CommandId, QueueError> {
        self.runtime.block_on(self.link.send_path_within(points, permitted))
    }

    /// As [`RobotLink::permit`].
    ///
    /// # Errors
    /// As there.
    pub fn permit(&self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.runtime.block_on(self.link.permit(last))
    }

    /// As [`RobotLink::open_epoch`].
    ///
    /// # Errors
    /// As there.
    pub fn open_epoch(&self) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch())
    }

    /// As [`RobotLink::open_epoch_above`].
    ///
    /// # Errors
    /// As there.
    pub fn open_epoch_above(&self, above: Epoch) -> Result<Epoch, QueueError> {
        self.runtime.block_on(self.link.open_epoch_above(above))
    }

    /// As [`RobotLink::abort`].
    ///
    /// # Errors
    /// As there.
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
    pub fn watched(&self) -> Watched {
        self.link.watched()
    }

    /// Returns the next report; `None` if none arrives within this time by the wall clock.
    pub fn next(&mut self, patience: Duration) -> Option<Report> {
        let BlockingLink { link, runtime } = self;
        runtime.block_on(async { tokio::time::timeout(patience, link.next()).await.ok() })
    }
}
