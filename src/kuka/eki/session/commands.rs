//! Sends commands into the open epoch: one command, a whole path, or a path of which only a part is sent for now.

use super::flow::CommandFlow;
use super::limits::{LinkLimits, QueueError};
use super::{Phase, Session};
use crate::eki::command::{Command, CommandError, MoveLin, Request, Signal};
use crate::eki::ids::CommandId;
use crate::eki::wire::Wire;

impl Session {
    /// Queues one command and returns its id. [`Command::GetCurrentState`] is requested at once and has the id 0.
    ///
    /// # Errors
    /// If no epoch is open, or the command cannot be executed; the epoch stays open.
    pub fn queue(&mut self, command: Command) -> Result<CommandId, QueueError> {
        match command {
            Command::GetCurrentState => {
                self.require_greeting()?;
                self.number_request(Request::State);
                Ok(CommandId(0))
            }
            Command::MoveLin(point) => self.queue_path(&[point]),
            // Refused here with the remedy: the controller would only stop the program with its own message.
            Command::SetDigin(Signal { number, .. }) if !self.limits.mapped_inputs.contains(number) => {
                self.require_greeting()?;
                Err(CommandError::InputReadOnly { number }.into())
            }
            other => {
                let (flow, wire, limits) = self.open_flow()?;
                flow.queue(other, wire, limits)
            }
        }
    }

    /// Queues a whole path and returns the id of its last point. If one point is invalid, all are refused.
    ///
    /// # Errors
    /// As [`Session::queue`], and if base or tool were not set in this epoch.
    pub fn queue_path(&mut self, points: &[MoveLin]) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.open_flow()?;
        flow.queue_path(points, wire, limits)
    }

    /// Queues a whole path as [`Session::queue_path`] does, but sends only this number of points until
    /// [`Session::permit_commands`] permits more. A client that records which points the robot may have executed records them
    /// before it permits them.
    ///
    /// # Errors
    /// As [`Session::queue_path`].
    pub fn queue_path_within(&mut self, points: &[MoveLin], permitted: u32) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.open_flow()?;
        let last = flow.queue_path(points, wire, limits)?;
        let count = u32::try_from(points.len()).unwrap_or(u32::MAX);
        flow.permit_up_to(Some(CommandId((last.0 + 1).saturating_sub(count).saturating_add(permitted) - 1)));
        Ok(last)
    }

    /// Permits commands up to this one to be sent, or all if it is `None`.
    ///
    /// # Errors
    /// If no epoch is open.
    pub fn permit_commands(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.open_flow()?.0.permit_up_to(last);
        Ok(())
    }

    fn open_flow(&mut self) -> Result<(&mut CommandFlow, &Wire, &LinkLimits), QueueError> {
        self.require_greeting()?;
        match &mut self.phase {
            Phase::Open(flow) => Ok((flow, &self.wire, &self.limits)),
            _ => Err(QueueError::NoEpoch),
        }
    }
}
