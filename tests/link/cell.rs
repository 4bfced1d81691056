//! A client's session and a mock controller in virtual time, without sockets. The bytes of each of the four directions
//! may be delayed, split, or lost.
//!
//! Time advances from one event to the next: a tick of the controller, a deadline of the session, an arrival of bytes.

// The module is given by its path, because benches include this file by its own path.
#[path = "cell/transport.rs"]
mod transport;

use panelprep::devices::mock::{self, Clock, Controller, ExecutedMotion, Setup, UnconnectedWorld, World};
use panelprep::eki::{
    CELLCMD, CELLSTAT, Channel, ChannelFile, ClockMode, Command, LinkLimits, LinkLoss, MoveLin, Report, Session,
    SetAccSpeed, SetTcp, TcpKind, Time, Wire,
};
use panelprep::geometry::{Base, Joints, KukaPose, Panel, Rigid, Tool};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::VecDeque;
use std::sync::LazyLock;
use transport::{CHANNELS, Direction, Piece};

/// Start position of the axes, with the wrist bent down: the flange is at (390, 0, 670), with its Z axis straight down.
pub const START: Joints =
    Joints { a1_deg: 0.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 90.0, a6_deg: 0.0 };

/// The frame of the sanding tool: 100 mm along the Z axis of the flange.
pub const TOOL: KukaPose = KukaPose { x_mm: 0.0, y_mm: 0.0, z_mm: 100.0, a_deg: 0.0, b_deg: 0.0, c_deg: 0.0 };

/// The panel's frame, 40 mm below the tool at the start; its Z axis points down, into the panel.
pub const BASE: KukaPose = KukaPose { x_mm: 390.0, y_mm: 0.0, z_mm: 530.0, a_deg: 180.0, b_deg: 0.0, c_deg: 180.0 };

/// Number of the output that runs the tool.
pub const TOOL_OUTPUT: u16 = 5;

/// Interval between two ticks of the controller, ms.
pub const TICK_MS: u64 = 12;

/// Returns the shipped EthernetKRL files in the form that the client uses.
pub fn wire() -> Wire {
    static WIRE: LazyLock<Wire> = LazyLock::new(|| {
        let [command, state] = [CELLCMD, CELLSTAT].map(|text| ChannelFile::parse(text).expect("a shipped file"));
        Wire::new(&command, &state).expect("the shipped files fit")
    });
    WIRE.clone()
}

/// Returns the setup of a controller with the shipped files.
pub fn setup(clock: Clock) -> Setup {
    static FILES: LazyLock<[mock::ChannelFile; 2]> =
        LazyLock::new(|| [CELLCMD, CELLSTAT].map(|text| mock::ChannelFile::parse(text).expect("a shipped file")));
    let [command, state] = FILES.clone();
    let mut setup = Setup { clock, start: START, ..Setup::new(command, state) };
    // The paths of these tests end near the limit of axis 5. With the usual limit, the retract from their last point
    // would exceed it.
    setup.arm.limits_deg[4] = [-130.0, 130.0];
    setup
}

pub fn speed(speed_m_s: f64) -> Command {
    Command::SetAccSpeed(SetAccSpeed {
        speed_m_s,
        acceleration_m_s2: 5.0,
        axis_speed_percent: 50,
        axis_acceleration_percent: 50,
    })
}

pub fn sanding_tool() -> Command {
    Command::SetTcp(SetTcp { flange_from_tool: TOOL, kind: TcpKind::Sanding })
}

/// Returns a path through the air, along the panel in contact, and back into the air. The points have this spacing and
/// are rounded by half of the spacing.
pub fn pass(points: usize, step_mm: f64, contact: bool) -> Vec<MoveLin> {
    let point = |index: usize| {
        let in_air = index < 2 || index + 2 >= points;
        let z_mm = if in_air { -10.0 } else { 0.0 };
        // A shallow zigzag, so that the path changes its direction at every point.
        let y_mm = if index.is_multiple_of(2) { 0.0 } else { 0.2 * step_mm };
        let pose = KukaPose { x_mm: step_mm * index as f64 - 40.0, y_mm, z_mm, ..KukaPose::default() };
        let blend_mm = if index + 1 == points { 0.0 } else { 0.4 * step_mm };
        MoveLin { pose, blend_mm, contact: contact && !in_air, speed_m_s: None }
    };
    (0..points).map(point).collect()
}

/// Returns the height of the tool's tip above the panel, mm.
pub fn height_mm(controller: &Controller) -> f64 {
    let base_from_tool: Rigid<Base, Tool> = controller.flange_pose() * TOOL.to_rigid();
    let panel_from_tool: Rigid<Panel, Tool> = BASE.to_rigid::<Base, Panel>().inverse() * base_from_tool;
    -panel_from_tool.origin().mm.z
}

/// The side that closes a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Client,
    Robot,
}

/// An observer of the cell's messages, which checks requirements.
pub trait Watch {
    /// Called with a command's epoch and ID when the command leaves the client.
    fn sent(&mut self, _epoch: u32, _id: u32, _now_ms: u64) {}
    /// Called with each report of the session.
    fn on_report(&mut self, _report: &Report, _cell: &Insides<'_>) {}
    /// Called after each step.
    fn look(&mut self, _cell: &Insides<'_>) {}
}

/// Changes a message, given its direction (true: to the controller), its channel (0: commands, 1: states) and its
/// bytes. `None` leaves the message unchanged; otherwise these pieces are sent, each delayed by this number of ms.
pub type Tamper = Box<dyn FnMut(bool, usize, &[u8]) -> Option<Vec<(u64, Vec<u8>)>> + Send>;

/// An observer that checks nothing.
pub struct Blind;

impl Watch for Blind {}

/// The state of a cell for observers.
pub struct Insides<'a> {
    pub session: &'a Session,
    pub controller: &'a Controller,
    pub now_ms: u64,
    /// Time at which bytes of the state channel last reached the client, ms.
    pub heard_ms: u64,
    /// Whether the client's process is stalled.
    pub stalled: bool,
}

/// Client and controller.
pub struct Cell {
    pub session: Session,
    pub controller: Controller,
    pub now_ms: u64,
    /// Delay of bytes in each direction, ms: minimum and maximum.
    pub delay_ms: (u64, u64),
    pub fragment: bool,
    /// Time until which the client's process does nothing, ms.
    pub client_stalls_until_ms: u64,
    /// Time until which no message arrives at the client, ms.
    pub deaf_until_ms: u64,
    /// Number of messages that were sent in all directions.
    pub messages: usize,
    /// A function that changes messages in transit.
    pub tamper: Option<Tamper>,
    draw: Pcg64,
    to_robot: [Direction; 2],
    to_client: [Direction; 2],
    /// Whether the client has both connections; `robot_open` contains the controller's end of each connection.
    up: bool,
    robot_open: [bool; 2],
    retry_at_ms: u64,
    pause_ms: u64,
    heard_ms: u64,
    /// Time at which bytes, or a connection, last reached the controller, ms.
    reached_ms: u64,
    reports: VecDeque<Report>,
}

impl Cell {
    /// Creates a cell that is not yet connected.
    pub fn new(setup: Setup, limits: LinkLimits, seed: u64) -> Self {
        Cell::within(setup, limits, seed, Box::new(UnconnectedWorld))
    }

    /// Creates a cell that is not yet connected, with a simulated world at the terminals of the controller.
    pub fn within(setup: Setup, limits: LinkLimits, seed: u64, world: Box<dyn World>) -> Self {
        Cell {
            session: Session::new(wire(), limits, ClockMode::Wall),
            controller: Controller::new(setup, world).expect("the shipped files fit"),
            now_ms: 0,
            delay_ms: (1, 1),
            fragment: false,
            client_stalls_until_ms: 0,
            deaf_until_ms: 0,
            messages: 0,
            tamper: None,
            draw: Pcg64::seed_from_u64(seed),
            to_robot: Default::default(),
            to_client: Default::default(),
            up: false,
            robot_open: [false; 2],
            retry_at_ms: 0,
            pause_ms: 100,
            heard_ms: 0,
            reached_ms: 0,
            reports: VecDeque::new(),
        }
    }

    /// Creates a cell with an open epoch, in which base, tool and speed are set and confirmed.
    pub fn ready(setup: Setup, speed_m_s: f64) -> Self {
        let mut cell = Cell::new(setup, LinkLimits::default(), 1);
        cell.open(speed_m_s);
        cell
    }

    pub fn open(&mut self, speed_m_s: f64) {
        assert!(self.until(8_000, |report| matches!(report, Report::Connected { .. })), "connects");
        self.open_connected(speed_m_s);
    }

    pub fn open_connected(&mut self, speed_m_s: f64) {
        self.session.open_epoch().expect("connected and standing");
        assert!(self.until(1_000, |report| matches!(report, Report::EpochOpened { .. })), "opens");
        for command in [Command::SetBase(BASE), sanding_tool(), speed(speed_m_s)] {
            self.session.queue(command).expect("good");
        }
        self.run(400, &mut Blind);
    }

    /// Advances the time until a matching report arrives; returns false if none arrived in time.
    pub fn until(&mut self, patience_ms: u64, found: impl Fn(&Report) -> bool) -> bool {
        let end_ms = self.now_ms + patience_ms;
        loop {
            while let Some(report) = self.reports.pop_front() {
                if found(&report) {
                    return true;
                }
            }
            if self.now_ms >= end_ms {
                return false;
            }
            self.step(end_ms, &mut Blind);
        }
    }

    pub fn next_report(&mut self) -> Option<Report> {
        self.reports.pop_front()
    }

    pub fn run(&mut self, ms: u64, watch: &mut impl Watch) {
        let end_ms = self.now_ms + ms;
        while self.now_ms < end_ms {
            self.step(end_ms, watch);
        }
    }

    pub fn executed(&self) -> &[ExecutedMotion] {
        self.controller.executed_motions()
    }

    fn next_event_ms(&self, end_ms: u64) -> u64 {
        let deadline = self.session.deadline().map(|at| at.since_start().as_micros().div_ceil(1_000) as u64);
        let client = deadline.into_iter().chain(self.to_client.iter().filter_map(Direction::due_ms));
        let retry = (!self.up).then_some(self.retry_at_ms);
        let client = client.chain(retry).map(|at| at.max(self.client_stalls_until_ms));
        let robot = self.to_robot.iter().filter_map(Direction::due_ms).map(|at| at.max(self.deaf_until_ms));
        let tick_ms = (self.now_ms / TICK_MS + 1) * TICK_MS;
        let next = client.chain(robot).chain([tick_ms]).min().unwrap_or(end_ms);
        next.clamp(self.now_ms + 1, end_ms.max(self.now_ms + 1))
    }

    /// Advances to the next event and performs it.
    pub fn step(&mut self, end_ms: u64, watch: &mut impl Watch) {
        let next_ms = self.next_event_ms(end_ms);
        self.controller.advance_ms(next_ms - self.now_ms);
        self.now_ms = next_ms;
        self.reach_robot();
        self.leave_robot();
        if self.now_ms >= self.client_stalls_until_ms {
            self.connect();
            self.reach_client();
            let now = Time::from_ms(self.now_ms);
            if self.session.deadline().is_some_and(|at| at <= now) {
                self.session.time_passed(now);
            }
            self.leave_client(watch);
        }
        let Cell { session, controller, now_ms, heard_ms, .. } = self;
        let stalled = *now_ms < self.client_stalls_until_ms;
        let insides = Insides { session, controller, now_ms: *now_ms, heard_ms: *heard_ms, stalled };
        watch.look(&insides);
    }

    /// Ends the client's process and starts another one with this session. The system closes the connections, except
    /// after a power failure: the controller then receives no further data, and detects the end of the old connections
    /// only when new connections are made.
    pub fn restart_client(&mut self, session: Session, is_power_cut: bool) {
        self.session = session;
        self.reports.clear();
        if self.up && !is_power_cut {
            self.to_robot.iter_mut().for_each(|way| way.put(self.now_ms + self.delay_ms.0, Piece::End));
        }
        (self.up, self.to_client) = (false, Default::default());
        (self.retry_at_ms, self.pause_ms) = (self.now_ms, 100);
    }

    /// Closes the old connections of a client that had a power failure.
    pub fn close_dead_connections(&mut self) {
        for (_, end) in CHANNELS {
            self.controller.disconnect(end);
        }
        self.to_robot = Default::default();
    }

    /// Advances the time without a process on the client's side.
    pub fn without_client(&mut self, ms: u64, watch: &mut impl Watch) {
        let end_ms = self.now_ms + ms;
        while self.now_ms < end_ms {
            let next_ms = (self.now_ms + TICK_MS).min(end_ms);
            self.controller.advance_ms(next_ms - self.now_ms);
            self.now_ms = next_ms;
            self.reach_robot();
            self.leave_robot();
            let Cell { session, controller, now_ms, heard_ms, .. } = self;
            let insides = Insides { session, controller, now_ms: *now_ms, heard_ms: *heard_ms, stalled: true };
            watch.look(&insides);
        }
    }

    /// Returns the time since the client last received a state, ms, if the client runs and is connected.
    pub fn silence_ms(&self) -> Option<u64> {
        let runs = self.up && self.session.is_connected() && self.now_ms >= self.client_stalls_until_ms;
        runs.then(|| self.now_ms - self.heard_ms)
    }

    /// Returns the time since any data last reached the controller, ms, if a client is connected there.
    pub fn unreached_ms(&self) -> Option<u64> {
        let holds = CHANNELS.iter().any(|(_, end)| self.controller.is_connected(*end));
        holds.then(|| self.now_ms - self.reached_ms)
    }

    /// Returns whether no message is waiting to be received.
    pub fn all_heard(&self) -> bool {
        self.reports.is_empty()
    }

    /// Sends a request of another client to the controller.
    pub fn foreign_request(&mut self, operation: i32, number: i32) {
        let request = format!("<Req Id=\"1\" Ep=\"0\" Op=\"{operation}\" N1=\"{number}\"></Req>");
        self.controller.state_bytes(request.as_bytes());
        self.reached_ms = self.now_ms;
    }

    /// Closes one end of one connection; bytes in transit arrive, or are lost if `loses` is set.
    pub fn cut(&mut self, channel: Channel, side: Side, loses: bool) {
        if !self.up {
            return;
        }
        let index = usize::from(channel == Channel::State);
        if loses {
            (self.to_robot[index], self.to_client[index]) = Default::default();
        }
        match side {
            Side::Robot => self.controller.disconnect(CHANNELS[index].1),
            Side::Client => self.session.disconnected(LinkLoss::Closed { channel }),
        }
    }
}
