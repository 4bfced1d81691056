//! What every front beside the loop works with: the page, the plant and the office see one cell.

use super::alarms::Alarms;
use super::gateway::Gateway;
use super::people::People;
use super::setup_source::SetupSource;
use std::sync::Arc;

/// Clones are the same ones.
#[derive(Clone)]
pub struct FrontParts {
    /// The destination of requests.
    pub gateway: Gateway,
    /// Who may log in, and the store as fronts have it.
    pub people: Arc<People>,
    /// The alarms of the cell.
    pub alarms: Arc<Alarms>,
    /// Recipes, calibrations and what else is set up.
    pub setup: Arc<dyn SetupSource>,
}

impl FrontParts {
    /// Checks for alarms between cycles if no one has done so within the last minute; a camera may need some time.
    pub(super) fn look(&self) {
        self.alarms.look(&*self.setup, self.gateway.cameras.as_ref());
    }
}
