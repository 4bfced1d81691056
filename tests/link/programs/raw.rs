//! A controller with programs, and a client that writes its messages directly to the two channels, for actions that a
//! correct client never performs.

use super::super::cell::{START, setup};
use panelprep::devices::mock::{Channel, Clock, Controller, Programs, Setup, UnconnectedWorld};
use panelprep::krl::Cell;

/// Interval between two heartbeats, ms.
const HEARTBEAT_MS: u64 = 96;

pub struct Raw {
    pub controller: Controller,
    epoch: i32,
    id: i32,
}

/// Returns a controller with these programs, open channels, and its robot program running.
pub fn started(programs: Programs) -> Controller {
    let setup = Setup { programs: Some(programs), ..setup(Clock::Free) };
    let mut controller = Controller::new(setup, Box::new(UnconnectedWorld)).expect("starts");
    controller.advance_ms(600);
    controller
}

impl Raw {
    /// Returns a connected controller with an open epoch, base and sanding tool set.
    pub fn opened(programs: Programs) -> Self {
        let mut raw = Raw { controller: started(programs), epoch: 0, id: 0 };
        for channel in [Channel::Command, Channel::State] {
            assert!(raw.controller.connect(channel), "the channel is open");
        }
        raw.run(60);
        raw.open();
        raw
    }

    pub fn open(&mut self) {
        (self.epoch, self.id) = (self.controller.epoch() + 1, 0);
        self.request(12, self.epoch);
        self.run(60);
        self.command(3, [0, 0], [0.0, 0.0], [390.0, 0.0, 530.0, 180.0, 0.0, 180.0]);
        self.command(4, [1, 0], [0.0, 0.0], [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]);
        self.command(5, [37, 50], [0.15, 5.0], [0.0; 6]);
        self.run(120);
    }

    /// Sets the epoch to which the following commands belong.
    pub fn count_from(&mut self, epoch: i32) {
        (self.epoch, self.id) = (epoch, 0);
    }

    pub fn request(&mut self, operation: i32, number: i32) {
        let request = format!("<Req Id=\"1\" Ep=\"{}\" Op=\"{operation}\" N1=\"{number}\"></Req>", self.epoch);
        self.controller.state_bytes(request.as_bytes());
    }

    pub fn command(&mut self, operation: i32, [n1, n2]: [i32; 2], [r1, r2]: [f64; 2], p: [f64; 6]) {
        self.id += 1;
        let [x, y, z, a, b, c] = p;
        let command = format!(
            "<Cmd Id=\"{}\" Ep=\"{}\" Op=\"{operation}\" N1=\"{n1}\" N2=\"{n2}\" R1=\"{r1:.3}\" R2=\"{r2:.3}\">\
             <P X=\"{x:.3}\" Y=\"{y:.3}\" Z=\"{z:.3}\" A=\"{a:.3}\" B=\"{b:.3}\" C=\"{c:.3}\"></P></Cmd>",
            self.id, self.epoch
        );
        self.controller.command_bytes(command.as_bytes());
    }

    /// Sends a blended linear motion to this position on the panel, with the announced number of points that follow.
    pub fn line(&mut self, to_come: i32, contact: bool, [x, y, z]: [f64; 3]) {
        self.command(2, [to_come, i32::from(contact)], [1.2, 0.0], [x, y, z, 0.0, 0.0, 0.0]);
    }

    /// Advances the time, with heartbeats.
    pub fn run(&mut self, ms: u64) {
        let end_ms = self.controller.time_ms() + ms;
        while self.controller.time_ms() < end_ms {
            self.controller.advance_ms(12);
            self.controller.take_output_bytes(Channel::Command);
            self.controller.take_output_bytes(Channel::State);
            if self.controller.time_ms().is_multiple_of(HEARTBEAT_MS) {
                self.request(10, self.id);
            }
        }
    }

    pub fn int(&self, name: &str) -> i32 {
        match self.controller.shared(name) {
            Some(Cell::Int(number)) => number,
            other => panic!("{name} is {other:?}"),
        }
    }

    /// Returns whether the arm is at its start position.
    pub fn has_not_moved(&self) -> bool {
        (self.controller.joints().a1_deg - START.a1_deg).abs() < 1e-3
            && (self.controller.joints().a2_deg - START.a2_deg).abs() < 1e-3
    }
}
