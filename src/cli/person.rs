//! The person at a simulated cell, who dries the panel before saying that it is dry.
//!
//! `start` and `unhold --dried` are such words; nobody else could do it there.

use crate::cycle::{self, At, Id, Refusal, State};
use crate::daemon::{Request, Requests, What};
use crate::devices::world::SimulatedWorld;
use crate::record::CycleId;
use crate::supervision::ThreadFault;
use crate::tape::Begin;
use crate::verdict::{Reason, Verdict};

/// Passes on what is asked, and dries the panel first where that is said; does nothing more at a real cell.
pub struct Person<R> {
    /// Who asks.
    pub asks: R,
    /// The simulated world.
    pub world: Option<SimulatedWorld>,
}

impl<R> Person<R> {
    fn dries(&self) {
        if let Some(world) = &self.world {
            world.dry_panel();
        }
    }
}

impl<R: Requests> Requests for Person<R> {
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let request = self.asks.next(state)?;
        let unholds =
            |request: &Request| matches!(request.what, What::Table(cycle::Request::Unhold { dried: true }));
        if request.as_ref().is_some_and(unholds) && matches!(state.at, At::Held(_)) {
            self.dries();
        }
        Ok(request)
    }

    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        self.asks.refused(request, refusal);
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        self.asks.unable(reasons);
    }

    fn begun(&mut self, cycle: CycleId, before: Begin) {
        self.dries();
        self.asks.begun(cycle, before);
    }

    fn lets_in(&mut self, result: Id) -> bool {
        self.asks.lets_in(result)
    }

    fn concluded(&mut self, verdict: Verdict) {
        self.asks.concluded(verdict);
    }

    fn filmed(&mut self, seconds: f64) {
        self.asks.filmed(seconds);
    }

    fn disc_mounted(&mut self) {
        self.asks.disc_mounted();
    }

    fn noted(&mut self, reasons: &[Reason]) {
        self.asks.noted(reasons);
    }
}
