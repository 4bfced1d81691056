//! The person at a simulated cell, who dries the panel before confirming that it is dry.
//!
//! `start` and `unhold --dried` confirm it; no one else could dry it there.

use panelprep_cell::cycle::{self, At};
use panelprep_devices::world::SimulatedWorld;
use panelprep_service::daemon::{LoopEvent, Port, Request, RequestAnswer, RequestCommand, RequestKind};

/// Passes requests on, and first dries the panel if the request confirms that it is dry. At a real cell it does
/// nothing more.
pub struct Person<R> {
    /// The source of the requests.
    pub requester: R,
    /// The simulated world.
    pub world: Option<SimulatedWorld>,
}

impl<R: Port<RequestCommand>> Port<RequestCommand> for Person<R> {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        let is_held = matches!(command, RequestCommand::Next(state) if matches!(state.at, At::Held(_)));
        let begins = matches!(command, RequestCommand::Publish(LoopEvent::Begun(..)));
        let answer = self.requester.perform(command);
        let unholds =
            |request: &Request| matches!(request.what, RequestKind::Table(cycle::Request::Unhold { dried: true }));
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
