//! The addresses on which a controller listens.

use panelprep_cell::cell;

/// The addresses on which a controller listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    /// Host name or address of the controller.
    pub host: String,
    /// Port of the command channel.
    pub command_port: u16,
    /// Port of the state channel.
    pub state_port: u16,
}

impl From<&cell::Robot> for Address {
    fn from(robot: &cell::Robot) -> Self {
        Address {
            host: robot.host().to_owned(),
            command_port: robot.command_port(),
            state_port: robot.state_port(),
        }
    }
}
