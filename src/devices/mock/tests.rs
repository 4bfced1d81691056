//! Tests of the mock controller, with documents as a client sends and receives them; in lock step unless a test
//! advances the time itself.

mod motion;
mod protocol;
mod stops;

use super::kinematics::to_joints;
use super::*;
use panelprep_base::geometry::{Base, Point};
use std::sync::{Arc, Mutex};

/// Axis angles at the start, with the wrist bent down: the flange is at (390, 0, 670), and its Z axis points down.
const START_DEG: [f64; 6] = [0.0, -90.0, 90.0, 0.0, 90.0, 0.0];
/// Length of the tool along the flange's Z axis, mm.
const TOOL_MM: f64 = 100.0;
/// Origin of the base that the tests set, mm.
const BASE_MM: [f64; 3] = [390.0, 0.0, 570.0];
const TOOL_OUTPUT: u16 = 5;

fn setup(clock: Clock) -> Setup {
    let commands = ChannelFile::parse(include_str!("../../../config/kuka/CELLCMD.xml")).expect("read");
    let states = ChannelFile::parse(include_str!("../../../config/kuka/CELLSTAT.xml")).expect("read");
    Setup { clock, start: to_joints(START_DEG), ..Setup::new(commands, states) }
}

/// A world that records every change of an output; input 4 follows the tool's output.
#[derive(Clone, Default)]
struct Wires {
    changes: Arc<Mutex<Vec<(u16, bool, u64)>>>,
}

impl Wires {
    fn changes(&self) -> Vec<(u16, bool, u64)> {
        self.changes.lock().expect("lock").clone()
    }
}

impl World for Wires {
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64) {
        self.changes.lock().expect("lock").push((number, value, time_ms));
    }

    fn input(&self, number: u16, _: u64) -> Option<bool> {
        let tool =
            self.changes().iter().rev().find(|change| change.0 == TOOL_OUTPUT).is_some_and(|change| change.1);
        (number == 4).then_some(tool)
    }
}

/// A controller and a client whose documents are written by the test.
struct Rig {
    controller: Controller,
    wires: Wires,
    epoch: i32,
    /// The id of the last command that was sent.
    id: i32,
    request: i32,
    acks: String,
    states: String,
}

impl Rig {
    /// Creates a connected controller in which epoch 1 is open.
    fn new(clock: Clock) -> Self {
        let mut rig = Rig::before_reset(clock);
        rig.open();
        rig
    }

    fn before_reset(clock: Clock) -> Self {
        let wires = Wires::default();
        let mut controller = Controller::new(setup(clock), Box::new(wires.clone())).expect("started");
        controller.connect(Channel::Command);
        controller.connect(Channel::State);
        Rig { controller, wires, epoch: 0, id: 0, request: 0, acks: String::new(), states: String::new() }
    }

    /// Creates a connected controller in which base, sanding tool, 100 mm/s and 1000 mm/s² are set.
    fn ready(clock: Clock) -> Self {
        let mut rig = Rig::new(clock);
        rig.prepare();
        rig
    }

    fn prepare(&mut self) {
        // With these frames the tool at the start is at the origin of the base, without rotation.
        self.command(3, [0, 0], [0.0; 2], [BASE_MM[0], BASE_MM[1], BASE_MM[2], 180.0, 0.0, 180.0]);
        self.command(4, [1, 0], [0.0; 2], [0.0, 0.0, TOOL_MM, 0.0, 0.0, 0.0]);
        self.command(5, [100, 100], [0.1, 1.0], [0.0; 6]);
        self.beat();
    }

    fn open(&mut self) {
        self.epoch += 1;
        self.id = 0;
        let epoch = self.epoch;
        self.ask(12, epoch);
    }

    fn document(&mut self, operation: i32, n: [i32; 2], r: [f64; 2], p: [f64; 6]) -> String {
        self.id += 1;
        command(self.epoch, self.id, operation, n, r, p)
    }

    fn command(&mut self, operation: i32, n: [i32; 2], r: [f64; 2], p: [f64; 6]) -> i32 {
        let document = self.document(operation, n, r, p);
        self.controller.command_bytes(document.as_bytes());
        self.id
    }

    fn ask(&mut self, operation: i32, n1: i32) {
        self.request += 1;
        let request = request(self.request, self.epoch, operation, n1);
        self.controller.state_bytes(request.as_bytes());
        self.listen();
    }

    fn listen(&mut self) {
        self.acks += &String::from_utf8(self.controller.take_output_bytes(Channel::Command)).expect("text");
        self.states += &String::from_utf8(self.controller.take_output_bytes(Channel::State)).expect("text");
    }

    /// Sends a heartbeat, which grants 100 ms in lock step.
    fn beat(&mut self) {
        let id = self.id;
        self.ask(10, id);
        if self.controller.clock() == Clock::Free {
            self.controller.advance_ms(100);
            self.listen();
        }
    }

    fn beats(&mut self, count: usize) {
        (0..count).for_each(|_| self.beat());
    }

    /// Sends heartbeats until nothing moves; the maximum number is far above that of any path in these tests.
    fn settle(&mut self) {
        for _ in 0..200 {
            self.beat();
            if !self.controller.is_moving() && self.ack("Free") == 100 {
                self.beat(); // in free time the state is reported before the time passes
                return;
            }
        }
        panic!("it never stands");
    }

    /// Sends linear motions along the base's X axis at a spacing of 5 mm, with a blend of 2 mm: the first `sent` of
    /// `planned` points.
    fn line(&mut self, planned: i32, sent: i32, contact: bool) {
        for point in 1..=sent {
            let p = [5.0 * f64::from(point), 0.0, 0.0, 0.0, 0.0, 0.0];
            self.command(2, [planned - point, i32::from(contact)], [2.0, 0.0], p);
        }
    }

    fn ack(&self, name: &str) -> i32 {
        last(&self.acks, name).parse().expect("a number")
    }

    fn state(&self, name: &str) -> i32 {
        last(&self.states, name).parse().expect("a number")
    }

    fn flag(&self, bit: i32) -> bool {
        self.state("Flags") >> bit & 1 == 1
    }

    fn tool_tip(&self) -> Point<Base> {
        self.controller.flange_pose() * Point::at(0.0, 0.0, TOOL_MM)
    }

    fn tool_on(&self) -> bool {
        self.controller.outputs().get(&TOOL_OUTPUT).copied().unwrap_or(false)
    }

    fn ids(&self) -> Vec<i32> {
        self.controller.executed_motions().iter().map(|executed| executed.id).collect()
    }

    fn causes(&self) -> Vec<StopCause> {
        self.controller.program_stops().iter().map(|stop| stop.cause).collect()
    }
}

fn command(epoch: i32, id: i32, operation: i32, n: [i32; 2], r: [f64; 2], p: [f64; 6]) -> String {
    let ([n1, n2], [r1, r2], [x, y, z, a, b, c]) = (n, r, p);
    format!(
        "<Cmd Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"{n1}\" N2=\"{n2}\" R1=\"{r1:.6}\" R2=\"{r2:.6}\">\
         <P X=\"{x:.6}\" Y=\"{y:.6}\" Z=\"{z:.6}\" A=\"{a:.6}\" B=\"{b:.6}\" C=\"{c:.6}\"></P></Cmd>"
    )
}

fn request(id: i32, epoch: i32, operation: i32, n1: i32) -> String {
    format!("<Req Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"{n1}\"></Req>")
}

/// Returns the last value of this attribute in the documents.
fn last<'a>(documents: &'a str, name: &str) -> &'a str {
    let start = documents.rfind(&format!(" {name}=\"")).expect("told") + name.len() + 3;
    &documents[start..start + documents[start..].find('"').expect("quoted")]
}
