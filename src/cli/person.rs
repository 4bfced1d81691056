//! The person at a simulated cell, who dries the panel before saying that it is dry.
//!
//! `start` and `unhold --dried` say so; nobody else could dry it there.

use crate::cycle::{self, At};
use crate::daemon::{News, Port, Request, RequestAnswer, RequestCommand, What};
use crate::devices::world::SimulatedWorld;

/// Passes on what is requested, and dries the panel first where that is said; does nothing more at a real cell.
pub struct Person<R> {
    /// Where requests come from.
    pub requester: R,
    /// The simulated world.
    pub world: Option<SimulatedWorld>,
}

impl<R: Port<RequestCommand>> Port<RequestCommand> for Person<R> {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        let is_held = matches!(command, RequestCommand::Next(state) if matches!(state.at, At::Held(_)));
        let begins = matches!(command, RequestCommand::Tell(News::Begun(..)));
        let answer = self.requester.perform(command);
        let unholds =
            |request: &Request| matches!(request.what, What::Table(cycle::Request::Unhold { dried: true }));
        let dries = match &answer {
            RequestAnswer::Next(Ok(Some(request))) => is_held && unholds(request),
            _ => begins,
        };
        if let (Some(world), true) = (&self.world, dries) {
            world.dry_panel();
        }
        answer
    }
}
