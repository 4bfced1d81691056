//! The shared parts of all interfaces of the service: page, plant and office see the same cell.

use super::alarms::Alarms;
use super::gateway::Gateway;
use super::people::AccountService;
use super::setup_source::SetupSource;
use std::sync::Arc;

/// The shared parts of the interfaces. Clones share the same parts.
#[derive(Clone)]
pub struct InterfaceContext {
    /// The destination of requests.
    pub gateway: Gateway,
    /// The persons who may log in, and the interfaces' access to the store.
    pub people: Arc<AccountService>,
    /// The alarms of the cell.
    pub alarms: Arc<Alarms>,
    /// Recipes, calibrations and the rest of the set-up.
    pub setup: Arc<dyn SetupSource>,
}

impl InterfaceContext {
    /// Checks for alarms between cycles if no one has done so within the last minute; a camera may need some time.
    pub(super) fn check_alarms(&self) {
        self.alarms.check_cell(&*self.setup, self.gateway.cameras.as_ref());
    }
}
