//! A session that is driven by bytes: a controller that sends any message at any time, and a program that sends any
//! request.
//!
//! One byte selects the next event, and the following bytes select its numbers. The simulated controller follows the
//! requests, so that a run makes progress; depending on a byte, any number that the controller sends is wrong.

use panelprep::eki::{
    CELLCMD, CELLSTAT, Channel, ChannelFile, ClockMode, Command, CommandId, LinkLimits, LinkLoss, MoveLin, Report,
    Session, SetAccSpeed, SetTcp, StopCause, TcpKind, Time, Wire,
};
use panelprep::geometry::KukaPose;
use std::sync::OnceLock;

const BASE: KukaPose = KukaPose { x_mm: 400.0, y_mm: 0.0, z_mm: 12.5, a_deg: 0.5, b_deg: 0.0, c_deg: 0.0 };
const TOOL: KukaPose = KukaPose { x_mm: 0.0, y_mm: 0.0, z_mm: 120.0, a_deg: 0.0, b_deg: 0.0, c_deg: 0.0 };
/// Maximum number of steps of one run; more steps find no further errors.
const MAX_STEPS: usize = 2_000;
const ABORT: i64 = 11;
const RESET: i64 = 12;

/// Returns the shipped EthernetKRL files in the form that the client uses.
pub fn wire() -> Wire {
    static FILES: OnceLock<[ChannelFile; 2]> = OnceLock::new();
    let [command, state] =
        FILES.get_or_init(|| [CELLCMD, CELLSTAT].map(|text| ChannelFile::parse(text).expect("a shipped file")));
    Wire::new(command, state).expect("the shipped files fit")
}

/// Runs a session as these bytes state, and checks it after each step.
pub fn run(bytes: &[u8]) {
    let (pace, bytes) = match bytes.split_first() {
        Some((1, rest)) => (ClockMode::LockStep, rest),
        _ => (ClockMode::Wall, bytes),
    };
    let limits = LinkLimits { harmful_outputs: 0b11, ..LinkLimits::default() };
    let mut run = Run {
        session: Session::new(wire(), limits, pace),
        now: Time::default(),
        bytes: Bytes(bytes),
        heard: ControllerState::default(),
        judge: Judge::default(),
    };
    for _ in 0..MAX_STEPS {
        let Some(step) = run.bytes.next() else { return };
        run.step(step);
        run.drain();
    }
}

/// The bytes that were not used yet.
struct Bytes<'b>(&'b [u8]);

impl Bytes<'_> {
    fn next(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    fn or_zero(&mut self) -> u8 {
        self.next().unwrap_or(0)
    }

    /// Returns the correct number, a number near it, or a number at an end of its range.
    fn near(&mut self, right: i64) -> i64 {
        match self.or_zero() {
            0..=200 => right,
            201..=215 => right + 1,
            216..=230 => right - 1,
            231..=240 => i64::from(i32::MAX),
            241..=247 => 0,
            _ => i64::from(i32::MIN),
        }
    }
}

/// The requests to the simulated controller, and its reported state.
#[derive(Default)]
struct ControllerState {
    request: i64,
    epoch: i64,
    command: i64,
    sequence: i64,
    done: i64,
}

/// The requirements that the session must satisfy, whatever it receives.
#[derive(Default)]
struct Judge {
    /// The last requested epoch, and below it the highest epoch that was reported as open, and the highest that has
    /// ended.
    asked: i64,
    opened: i64,
    ended: i64,
    /// The epoch and the number of the last sent command.
    sent: (i64, i64),
    /// The highest number of the open epoch that was reported as executed.
    done: i64,
}

struct Run<'b> {
    session: Session,
    now: Time,
    bytes: Bytes<'b>,
    heard: ControllerState,
    judge: Judge,
}

impl Run<'_> {
    fn step(&mut self, step: u8) {
        match step % 16 {
            0 => {
                (self.heard.request, self.heard.sequence) = (0, 0);
                self.session.connected(self.now);
            }
            1 | 2 => {
                let ms = u64::from(self.bytes.or_zero());
                self.now = self.now + std::time::Duration::from_millis(ms);
                self.session.time_passed(self.now);
            }
            3..=5 => {
                let state = self.state();
                self.session.push_state_bytes(state.as_bytes(), self.now);
            }
            6 | 7 => {
                let ack = self.ack();
                self.session.push_command_bytes(ack.as_bytes(), self.now);
            }
            8 => self.open(),
            9 => self.queue(),
            10 => self.abort(),
            11 => self.session.heartbeat(self.now),
            12 => {
                let rubbish = self.bytes.0;
                let (piece, rest) = rubbish.split_at(usize::from(step / 16).min(rubbish.len()));
                self.bytes.0 = rest;
                self.session.push_state_bytes(piece, self.now);
                self.session.push_command_bytes(piece, self.now);
            }
            13 => self.session.interrupt(StopCause::GuardOpen),
            14 => {
                let last = u32::from(self.bytes.or_zero());
                // The call is refused if no epoch is open.
                self.session.permit_commands((last > 0).then_some(CommandId(last))).ok();
            }
            _ => self
                .session
                .disconnected(LinkLoss::Refused { channel: Channel::State, address: "192.0.2.1:54600".to_owned() }),
        }
    }

    /// Checks that an epoch is opened only on request, with a number that was never used.
    fn open(&mut self) {
        let above = u32::from(self.bytes.or_zero());
        if let Ok(epoch) = self.session.open_epoch_above(panelprep::eki::Epoch(above)) {
            let epoch = i64::from(epoch.0);
            assert!(epoch > self.judge.ended && epoch > self.judge.opened, "epoch {epoch} was there before");
            self.judge.asked = epoch;
        }
    }

    /// Sends a stop. It is possible in every state, and no command of the epoch may be sent after it.
    fn abort(&mut self) {
        let is_connected = self.session.is_connected();
        assert_eq!(self.session.abort().is_ok(), is_connected);
        assert!(self.session.epoch().is_none(), "an epoch is open after an abort");
        if is_connected {
            self.judge.ended = self.judge.ended.max(self.judge.opened);
        }
    }

    fn queue(&mut self) {
        let choice = self.bytes.or_zero();
        let point = |index: u8| MoveLin {
            pose: KukaPose { x_mm: f64::from(index), ..KukaPose::default() },
            blend_mm: 0.0,
            contact: choice & 64 > 0,
            speed_m_s: None,
        };
        let queued = match choice % 8 {
            0 => self.session.queue(Command::SetBase(BASE)),
            1 => self.session.queue(Command::SetTcp(SetTcp { flange_from_tool: TOOL, kind: TcpKind::Sanding })),
            2 => self.session.queue(Command::SetAccSpeed(SetAccSpeed {
                speed_m_s: 0.1,
                acceleration_m_s2: 1.0,
                axis_speed_percent: 10,
                axis_acceleration_percent: 10,
            })),
            3 => self.session.queue(Command::GetCurrentState),
            4 => self.session.queue(Command::CallSubroutine { index: u16::from(choice) }),
            5 => self.session.queue_path_within(&[1, 2, 3].map(point), u32::from(self.bytes.or_zero())),
            _ => {
                let points: Vec<MoveLin> = (0..self.bytes.or_zero()).map(point).collect();
                if points.is_empty() {
                    return;
                }
                self.session.queue_path(&points)
            }
        };
        let may = self.session.is_connected() && (self.session.epoch().is_some() || choice % 8 == 3);
        assert!(queued.is_err() || may, "queued without an epoch");
    }

    /// Reads the messages to the program and to the controller.
    fn drain(&mut self) {
        // Executed commands free space in the window, so they are received first.
        self.receive();
        while let Some((channel, bytes)) = self.session.poll_transmit(self.now) {
            let text = String::from_utf8(bytes).expect("text");
            match channel {
                Channel::State => self.asked(&text),
                Channel::Command => self.commanded(&text),
            }
        }
        self.receive();
        let deadline = self.session.deadline();
        assert!(deadline.is_none() || self.session.is_connected(), "a deadline without a connection");
    }

    fn receive(&mut self) {
        while let Some(report) = self.session.poll_report() {
            self.on_report(&report);
        }
    }

    fn asked(&mut self, text: &str) {
        let next = number(text, "N1");
        self.heard.request = number(text, "Id");
        match number(text, "Op") {
            ABORT => {
                // The request stops the epoch whatever its number is. A number that is not the next one leaves the
                // controller's count unchanged.
                if next > self.heard.epoch {
                    (self.heard.epoch, self.heard.command, self.heard.done) = (next, 0, 0);
                }
                self.judge.ended = self.judge.ended.max(self.judge.opened);
            }
            RESET => {
                assert!(next <= self.judge.asked, "{text}: no person asked for it");
                (self.heard.epoch, self.heard.command, self.heard.done) = (next, 0, 0);
            }
            _ => {}
        }
    }

    fn commanded(&mut self, text: &str) {
        let (epoch, id) = (number(text, "Ep"), number(text, "Id"));
        assert!(epoch > self.judge.ended, "{text}: of an ended epoch, the last is {}", self.judge.ended);
        assert_eq!(self.session.epoch().map(|open| i64::from(open.0)), Some(epoch), "{text}: not the open epoch");
        let last = if self.judge.sent.0 == epoch { self.judge.sent.1 } else { 0 };
        assert_eq!(id, last + 1, "{text}: command {last} was the last one of epoch {epoch}");
        self.judge.sent = (epoch, id);
        let window = LinkLimits::default().window_commands as i64;
        assert!(
            id - self.judge.done <= window,
            "{text}: more on the way than the window, {} done",
            self.judge.done
        );
        self.heard.command = id;
    }

    fn on_report(&mut self, report: &Report) {
        assert!(!format!("{report:?}").is_empty());
        match report {
            Report::EpochOpened { epoch } => {
                let epoch = i64::from(epoch.0);
                assert!(epoch == self.judge.asked && epoch > self.judge.ended, "epoch {epoch} opened by itself");
                (self.judge.opened, self.judge.done) = (epoch, 0);
            }
            Report::Progress { done } => {
                let done = i64::from(done.0);
                assert!(done > self.judge.done, "command {done} was told done twice");
                assert!(done <= self.judge.sent.1, "command {done} was told done and never sent");
                self.judge.done = done;
            }
            Report::LinkLost { .. } => {
                assert!(self.session.epoch().is_none(), "an epoch is open without a link");
                self.judge.ended = self.judge.ended.max(self.judge.opened);
            }
            _ => {}
        }
    }

    fn state(&mut self) -> String {
        let heard = &mut self.heard;
        heard.sequence += 1;
        let moves = u8::from(self.bytes.or_zero() > 128);
        heard.done = (heard.done + i64::from(moves)).min(heard.command);
        let bytes = &mut self.bytes;
        let (sequence, request) = (bytes.near(heard.sequence), bytes.near(heard.request));
        let (epoch, done) = (bytes.near(heard.epoch), bytes.near(heard.done));
        let (boot, flags) = (bytes.near(77), i64::from(bytes.or_zero() / 16) ^ 119);
        let (out, x_mm) = (i64::from(bytes.or_zero() & 3), 400 + i64::from(bytes.or_zero() > 240));
        let time = self.now.since_start().as_millis();
        format!(
            "<St T=\"{time}\" Seq=\"{sequence}\" Re=\"{request}\" Ep=\"{epoch}\" Boot=\"{boot}\" Sum=\"-12345\" Mode=\"4\" \
             Flags=\"{flags}\" In=\"5\" Out=\"{out}\" Done=\"{done}\" Under=\"0\" Ov=\"100\"><J A1=\"5.0\" A2=\"-90.0\" A3=\"90.0\" \
             A4=\"0.0\" A5=\"45.5\" A6=\"-185.25\"></J><Tcp X=\"1.0\" Y=\"0.0\" Z=\"0.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\">\
             </Tcp><Base X=\"{x_mm}.0\" Y=\"0.0\" Z=\"12.5\" A=\"0.5\" B=\"0.0\" C=\"0.0\"></Base><Tool X=\"0.0\" \
             Y=\"0.0\" Z=\"120.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\"></Tool></St>"
        )
    }

    fn ack(&mut self) -> String {
        let (heard, bytes) = (&self.heard, &mut self.bytes);
        let (received, done) = (bytes.near(heard.command), bytes.near(heard.done));
        let (error, epoch) = (i64::from(bytes.or_zero() / 32), bytes.near(heard.epoch));
        let of = if error > 0 { bytes.near(heard.command) } else { 0 };
        format!(
            "<Ack Rx=\"{received}\" Done=\"{done}\" Free=\"97\" Err=\"{error}\" ErrId=\"{of}\" Ep=\"{epoch}\"></Ack>"
        )
    }
}

/// Returns the numeric value of an attribute in a message of the session.
fn number(text: &str, name: &str) -> i64 {
    let from = text.find(&format!(" {name}=\"")).expect("the attribute") + name.len() + 3;
    let until = text[from..].find('"').expect("quoted") + from;
    text[from..until].parse().expect("a number")
}
