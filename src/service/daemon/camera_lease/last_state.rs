//! The last reported position of the robot.

use panelprep_base::geometry::Joints;
use panelprep_kuka::eki;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Largest age of the robot's last state at which its axis positions still count as the present ones.
const MAX_STATE_AGE: Duration = Duration::from_millis(500);

/// The robot's last state, and when it arrived. All clones share the same state.
#[derive(Debug, Clone, Default)]
pub struct LastState(Arc<Mutex<Option<(eki::State, Instant)>>>);

impl LastState {
    /// Records the last state; `None` if the link is lost.
    pub fn is(&self, state: Option<&eki::State>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state.map(|state| (*state, Instant::now()));
    }

    /// Returns the controller's mapped inputs as bits, as long as the state is fresh.
    pub(in crate::daemon) fn inputs(&self) -> Option<u32> {
        let (state, came) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        (came.elapsed() < MAX_STATE_AGE).then_some(state.inputs)
    }

    /// Returns the position of the axes, while the arm is at rest and the state is fresh.
    pub(super) fn resting_joints(&self) -> Option<Joints> {
        let (state, came) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        (came.elapsed() < MAX_STATE_AGE && !state.moving).then_some(state.joints)
    }
}
