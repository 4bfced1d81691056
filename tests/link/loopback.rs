//! A mock controller behind sockets, in real time, and a client connected to it.

use super::cell::setup;
use panelprep::devices::mock::{self, Clock, FaultSpec, MockServer, Ports, Setup};
use panelprep::devices::robot::{Address, BlockingLink};
use panelprep::eki::{ClockMode, LinkLimits};

/// Returns a mock server with these injected faults, and a client connected to it.
pub fn served(faults: &str) -> (MockServer, BlockingLink) {
    let faults: FaultSpec = if faults.is_empty() { FaultSpec::default() } else { faults.parse().expect("good") };
    let setup = Setup { faults, ..setup(Clock::Free) };
    let controller = mock::Controller::new(setup, Box::new(mock::UnconnectedWorld)).expect("fits");
    let server = MockServer::start(controller, Ports::free_ports()).expect("starts");
    let address = Address {
        host: "127.0.0.1".to_owned(),
        command_port: server.command_address().port(),
        state_port: server.state_address().port(),
    };
    (server, BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts"))
}
