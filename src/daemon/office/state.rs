//! The cell's state as the office is told.

use crate::cell::CellName;
use crate::daemon::clock::now_unix_ms;
use crate::daemon::gateway::Gateway;
use crate::daemon::request::What;
use crate::daemon::setup_source::SetupSource;
use crate::office::{CellState, Position, Told};
use crate::record::{Front, Who};
use crate::verdict::Reason;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The state is told so often, at most.
const EVERY: Duration = Duration::from_secs(2);
/// What is wrong between cycles is looked at so often.
const STANDING_EVERY: Duration = Duration::from_secs(60);

/// Finds out how the cell stands, when it is time.
pub(super) struct Teller {
    gateway: Gateway,
    setup: Arc<dyn SetupSource>,
    told: Option<Instant>,
    standing: Vec<Told>,
    stood: Option<Instant>,
}

impl Teller {
    pub fn new(gateway: Gateway, setup: Arc<dyn SetupSource>) -> Self {
        Teller { gateway, setup, told: None, standing: Vec::new(), stood: None }
    }

    /// How the cell stands; `None` where it was told a moment ago.
    pub async fn now(&mut self, cell: &CellName, last: &[Position]) -> Option<CellState> {
        if self.told.is_some_and(|told| told.elapsed() < EVERY) {
            return None;
        }
        if self.stood.is_none_or(|stood| stood.elapsed() >= STANDING_EVERY) {
            let setup = self.setup.clone();
            let found = tokio::task::spawn_blocking(move || setup.standing()).await.unwrap_or_default();
            (self.standing, self.stood) = (told(&found), Some(Instant::now()));
        }
        let reply = self.gateway.request(What::State, Who::by(Front::Program)).await;
        self.told = Some(Instant::now());
        let mut state = CellState::of(cell);
        state.unix_ms = now_unix_ms();
        env!("CARGO_PKG_VERSION").clone_into(&mut state.version);
        (state.state, state.phase, state.panel) = (reply.state, reply.phase, reply.panel);
        (state.cycle, state.waypoint) = (reply.cycle_id, reply.waypoint.zip(reply.of).map(|(at, of)| [at, of]));
        (state.reasons, state.standing) = (told(&reply.reasons), self.standing.clone());
        state.last = last.to_vec();
        Some(state)
    }
}

fn told(reasons: &[Reason]) -> Vec<Told> {
    let told = |reason: &Reason| Told { code: reason.code.to_string(), message: reason.message.clone() };
    reasons.iter().map(told).collect()
}
