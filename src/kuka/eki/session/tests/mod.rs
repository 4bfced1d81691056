//! Tests the session with a scripted controller, in virtual time, without a socket.

mod ends;
mod link;
mod stops;
mod window;

use super::*;
use crate::eki::fixture::wire;
use crate::eki::{
    Command, CommandError, EchoMismatch, FrameError, MappedInputs, MoveLin, Refusal, SequenceError, SetAccSpeed,
    SetTcp, Signal, StopCause, TcpKind,
};
use panelprep_base::geometry::KukaPose;
use std::time::Duration;

/// A minimal controller for the tests. It uses the messages of a real controller, executes commands at a constant rate
/// and replies immediately.
struct Controller {
    now_ms: u64,
    epoch: u32,
    received: u32,
    done: u32,
    refused: Option<(u32, u32)>,
    ring: VecDeque<Vec<String>>,
    executed: Vec<(u32, u32)>,
    discarded: usize,
    frames: [Option<[String; 6]>; 2],
    sequence: u32,
    answered: u32,
    /// Offset that is added to the number of the last answered request, to report a wrong number.
    answers_ahead: u32,
    flags: u32,
    /// Whether the robot program has stopped the epoch.
    stopped: bool,
    boot: u32,
    ms_per_command: u64,
    busy_until_ms: u64,
    ring_places: usize,
    silent: bool,
    /// Whether the controller neither executes commands nor replies to requests.
    is_unresponsive: bool,
    /// Whether the controller responds to aborts without stopping.
    ignores_aborts: bool,
    deaf_to_commands: bool,
    mode: u32,
    override_percent: u8,
    most_in_ring: usize,
    command_bytes: Vec<u8>,
    state_bytes: Vec<u8>,
}

/// The flags of a controller that is ready: drives on (1), no emergency stop (2), guard closed (4), motion possible
/// (16).
const READY: u32 = 1 + 2 + 4 + 16;

impl Controller {
    fn new() -> Self {
        Controller {
            now_ms: 0,
            epoch: 6,
            received: 0,
            done: 0,
            refused: None,
            ring: VecDeque::new(),
            executed: Vec::new(),
            discarded: 0,
            frames: [None, None],
            sequence: 40,
            answered: 0,
            answers_ahead: 0,
            flags: READY,
            stopped: false,
            boot: 77,
            ms_per_command: 20,
            busy_until_ms: 0,
            ring_places: 100,
            silent: false,
            is_unresponsive: false,
            ignores_aborts: false,
            deaf_to_commands: false,
            mode: 4,
            override_percent: 100,
            most_in_ring: 0,
            command_bytes: Vec::new(),
            state_bytes: Vec::new(),
        }
    }

    /// Reads the attribute values of one document and processes the message.
    fn receive(&mut self, bytes: &[u8]) {
        let text = std::str::from_utf8(bytes).expect("ASCII");
        let values: Vec<String> = text.split('"').skip(1).step_by(2).map(str::to_owned).collect();
        let number = |index: usize| values[index].parse::<u32>().expect("a number");
        if text.starts_with("<Req ") {
            if self.is_unresponsive {
                return;
            }
            self.answered = number(0);
            let follows = number(3) > self.epoch && number(3) - self.epoch <= 1_000_000;
            match number(2) {
                11 if !self.ignores_aborts => {
                    self.stop();
                    if follows {
                        self.begin(number(3));
                    }
                }
                12 if follows => {
                    self.begin(number(3));
                    self.stopped = false;
                }
                _ => {}
            }
            self.send_state();
            return;
        }
        if self.deaf_to_commands || number(1) != self.epoch || self.stopped {
            return;
        }
        if number(0) != self.received + 1 {
            self.refused = Some((1, number(0)));
        } else {
            self.received += 1;
            self.ring.push_back(values);
            self.most_in_ring = self.most_in_ring.max(self.ring.len());
        }
        self.send_ack();
    }

    fn stop(&mut self) {
        self.stopped = true;
        self.discarded += self.ring.len();
        self.ring.clear();
    }

    fn begin(&mut self, epoch: u32) {
        (self.epoch, self.received, self.done, self.refused) = (epoch, 0, 0, None);
        self.frames = [None, None];
        self.discarded += self.ring.len();
        self.ring.clear();
    }

    fn pass(&mut self, ms: u64) {
        self.now_ms += ms;
        while self.now_ms >= self.busy_until_ms
            && let Some(values) = self.ring.pop_front()
        {
            let number = |index: usize| values[index].parse::<u32>().expect("a number");
            if let (3 | 4, Some(frame)) = (number(2), values[7..].first_chunk::<6>()) {
                self.frames[number(2) as usize - 3] = Some(frame.clone());
            }
            self.done = number(0);
            self.executed.push((self.epoch, self.done));
            self.busy_until_ms = self.now_ms + self.ms_per_command;
            self.send_ack();
        }
        if self.now_ms.is_multiple_of(100) {
            self.send_state();
        }
    }

    fn send_ack(&mut self) {
        let ack = self.ack();
        self.command_bytes.extend_from_slice(ack.as_bytes());
    }

    fn ack(&self) -> String {
        let (error, error_id) = self.refused.unwrap_or((0, 0));
        let free = self.ring_places - self.ring.len();
        let Controller { received, done, epoch, .. } = self;
        format!(
            "<Ack Rx=\"{received}\" Done=\"{done}\" Free=\"{free}\" Err=\"{error}\" ErrId=\"{error_id}\" Ep=\"{epoch}\"></Ack>"
        )
    }

    fn send_state(&mut self) {
        let state = self.next_state();
        self.state_bytes.extend_from_slice(state.as_bytes());
    }

    fn next_state(&mut self) -> String {
        self.sequence += 1;
        let bit = |frame: &Option<_>, bit: u32| if frame.is_some() { 1 << bit } else { 0 };
        let stopped = u32::from(self.stopped) << 7;
        let flags = self.flags + bit(&self.frames[0], 5) + bit(&self.frames[1], 6) + stopped;
        let zero = [const { String::new() }; 6].map(|_| "0.000000".to_owned());
        let pose = |name: &str, numbers: &[String; 6]| {
            let [x, y, z, a, b, c] = numbers;
            format!("<{name} X=\"{x}\" Y=\"{y}\" Z=\"{z}\" A=\"{a}\" B=\"{b}\" C=\"{c}\"></{name}>")
        };
        let [base, tool] = [0, 1].map(|index: usize| self.frames[index].clone().unwrap_or(zero.clone()));
        let Controller { now_ms, sequence, epoch, boot, done, mode, override_percent, .. } = self;
        let answered = self.answered + self.answers_ahead;
        format!(
            "<St T=\"{now_ms}\" Seq=\"{sequence}\" Re=\"{answered}\" Ep=\"{epoch}\" Boot=\"{boot}\" Sum=\"5\" Mode=\"{mode}\" \
                 Flags=\"{flags}\" In=\"0\" Out=\"0\" Done=\"{done}\" Under=\"0\" Ov=\"{override_percent}\"><J A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" \
                 A4=\"0.0\" A5=\"0.0\" A6=\"0.0\"></J>{}{}{}</St>",
            pose("Tcp", &zero),
            pose("Base", &base),
            pose("Tool", &tool)
        )
    }
}

/// A session and a controller, which advance in steps of 10 ms of virtual time.
struct Cell {
    session: Session,
    controller: Controller,
    now_ms: u64,
    reports: Vec<Report>,
}

impl Cell {
    fn new() -> Self {
        let session = Session::new(wire(), LinkLimits::default(), ClockMode::Wall);
        Cell { session, controller: Controller::new(), now_ms: 0, reports: Vec::new() }
    }

    /// Creates a connected session with an open epoch, in which base, tool and speed are queued.
    fn ready() -> Self {
        Cell::ready_at(ClockMode::Wall)
    }

    fn ready_at(pace: ClockMode) -> Self {
        let mut cell = Cell::new();
        cell.session = Session::new(wire(), LinkLimits::default(), pace);
        cell.session.connected(Time::from_ms(0));
        cell.pass(100);
        cell.open();
        cell
    }

    fn open(&mut self) {
        let epoch = self.session.open_epoch().expect("connected");
        self.pass(100);
        assert!(self.reports.contains(&Report::EpochOpened { epoch }), "{:?}", self.events());
        for command in [base(400.0), tool(), speed(0.1)] {
            self.session.queue(command).expect("good");
        }
    }

    fn pass(&mut self, ms: u64) {
        for _ in 0..ms / 10 {
            self.exchange();
            self.now_ms += 10;
            self.controller.pass(10);
            self.exchange();
        }
    }

    fn exchange(&mut self) {
        let now = Time::from_ms(self.now_ms);
        if self.session.deadline().is_some_and(|at| at <= now) {
            self.session.time_passed(now);
        }
        while let Some((_, bytes)) = self.session.poll_transmit(now) {
            self.controller.receive(&bytes);
        }
        let (command, state) =
            (std::mem::take(&mut self.controller.command_bytes), std::mem::take(&mut self.controller.state_bytes));
        if !self.controller.silent {
            self.session.push_command_bytes(&command, now);
            self.session.push_state_bytes(&state, now);
        }
        while let Some(report) = self.session.poll_report() {
            self.reports.push(report);
        }
    }

    /// Returns all reports except states and progress.
    fn events(&self) -> Vec<&Report> {
        let is_event = |report: &&Report| !matches!(report, Report::State(_) | Report::Progress { .. });
        self.reports.iter().filter(is_event).collect()
    }
}

fn base(x_mm: f64) -> Command {
    Command::SetBase(KukaPose { x_mm, a_deg: 30.0, ..KukaPose::default() })
}

fn tool() -> Command {
    let flange_from_tool = KukaPose { z_mm: 120.0, ..KukaPose::default() };
    Command::SetTcp(SetTcp { flange_from_tool, kind: TcpKind::Sanding })
}

fn speed(speed_m_s: f64) -> Command {
    Command::SetAccSpeed(SetAccSpeed {
        speed_m_s,
        acceleration_m_s2: 1.0,
        axis_speed_percent: 30,
        axis_acceleration_percent: 30,
    })
}

/// Returns a straight path with this number of points at this spacing.
fn path(points: usize, step_mm: f64) -> Vec<MoveLin> {
    let point = |index: usize| {
        let pose = KukaPose { x_mm: step_mm * index as f64, ..KukaPose::default() };
        MoveLin { pose, blend_mm: 1.0, contact: true, speed_m_s: None }
    };
    (0..points).map(point).collect()
}
