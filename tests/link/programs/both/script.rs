//! Scripts: epochs of commands, and disturbances at certain points of these epochs.

use super::super::super::cell::{self, Side, pass, sanding_tool, speed};
use panelprep::devices::mock::{ConnectionSide as End, Fault, Mode};
use panelprep::eki::{Channel, Command, MoveJ, Signal};
use panelprep::geometry::Joints;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Distance between two points, mm.
pub const STEP_MM: f64 = 4.0;

/// A disturbance of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Disturbance {
    Happens(Fault),
    Cut(Channel, Side),
    Stalls(u64),
    Deaf(u64),
    Abort,
    Foreign,
}

/// The point of an epoch at which an event of a script occurs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// Before the epoch's first command is sent.
    First,
    /// After this number of executed motions.
    Behind(usize),
    /// After all commands are executed, while the epoch is still open.
    Last,
}

/// One epoch of a script.
#[derive(Debug, Clone)]
pub struct Part {
    pub commands: Vec<Vec<Command>>,
    /// Whether the paths of this epoch are in contact.
    pub contact: bool,
    pub wrong: Option<(Moment, Disturbance)>,
}

pub fn script(seed: u64) -> Vec<Part> {
    let mut draw = Pcg64::seed_from_u64(seed);
    let parts = draw.random_range(2..4);
    let mut all: Vec<Part> = (0..parts).map(|_| part(&mut draw)).collect();
    // The last epoch has no disturbance: whatever happened before, it must be executed.
    all.push(Part { wrong: None, ..part(&mut draw) });
    all
}

pub fn part(draw: &mut Pcg64) -> Part {
    let speed_m_s = [0.1, 0.15][draw.random_range(0..2)];
    let mut commands = vec![vec![Command::SetBase(cell::BASE), sanding_tool(), speed(speed_m_s)]];
    if draw.random_bool(0.3) {
        let joints = Joints { a1_deg: draw.random_range(-4.0..4.0), ..cell::START };
        commands.push(vec![Command::MoveJ(MoveJ { joints, axis_speed_percent: 60.0 })]);
    }
    for _ in 0..draw.random_range(0..6) {
        commands.push(vec![match draw.random_range(0..4) {
            0 => Command::CallSubroutine { index: 0 },
            _ => signal(draw.random_range(1..9), draw.random_bool(0.5)),
        }]);
    }
    let mut motions = 0;
    let contact = draw.random_bool(0.7);
    for _ in 0..draw.random_range(1..3) {
        let mut points = pass(draw.random_range(60..100), STEP_MM, contact);
        for point in &mut points {
            point.speed_m_s = draw.random_bool(0.2).then_some(speed_m_s);
        }
        motions += points.len();
        commands.push(vec![signal(cell::TOOL_OUTPUT, true)]);
        commands.push(points.into_iter().map(Command::MoveLin).collect());
        if draw.random_bool(0.3) {
            commands.push(vec![Command::SetDigoutOnPath(Signal { number: 3, on: draw.random_bool(0.5) })]);
        }
        commands.push(vec![signal(cell::TOOL_OUTPUT, false)]);
    }
    Part { commands, contact, wrong: Some(wrong(draw, motions)) }
}

pub fn signal(number: u16, on: bool) -> Command {
    Command::SetDigout(Signal { number, on })
}

pub fn wrong(draw: &mut Pcg64, motions: usize) -> (Moment, Disturbance) {
    let for_ms = draw.random_range(500..1_500);
    let lasts = Some(for_ms);
    let channel = [Channel::Command, Channel::State][draw.random_range(0..2)];
    let end = [End::Command, End::State, End::Both][draw.random_range(0..3)];
    let disturbance = match draw.random_range(0..20) {
        0 => Disturbance::Cut(channel, Side::Client),
        1 => Disturbance::Cut(channel, Side::Robot),
        2 => Disturbance::Stalls(for_ms),
        3 => Disturbance::Deaf(for_ms),
        4 => Disturbance::Abort,
        5 => Disturbance::Foreign,
        6 => Disturbance::Happens(Fault::Garbage(end)),
        7 => Disturbance::Happens(Fault::Unplug { for_ms: lasts }),
        8 => Disturbance::Happens(Fault::Mute { for_ms: lasts }),
        9 => Disturbance::Happens(Fault::NoAcks { for_ms: lasts }),
        10 => Disturbance::Happens(Fault::Stall { for_ms: lasts }),
        11 => Disturbance::Happens(Fault::SkipState),
        12 => Disturbance::Happens(Fault::EStop { for_ms: lasts }),
        13 => Disturbance::Happens(Fault::Guard { for_ms: lasts }),
        14 => Disturbance::Happens(Fault::Drives { for_ms: lasts }),
        15 => Disturbance::Happens(Fault::Mode {
            to: [Mode::T1, Mode::T2, Mode::Aut][draw.random_range(0..3)],
            for_ms: lasts,
        }),
        16 => Disturbance::Happens(Fault::Deselect { for_ms: lasts }),
        17 => Disturbance::Happens(Fault::Reboot { for_ms: lasts }),
        18 => {
            let fault = [Fault::LoseBase, Fault::LoseTool, Fault::WrongBase][draw.random_range(0..3)];
            return (Moment::First, Disturbance::Happens(fault));
        }
        _ => Disturbance::Happens(Fault::Slow { percent: draw.random_range(40..100), for_ms: lasts }),
    };
    let moment = match draw.random_range(0..10) {
        0 => Moment::First,
        1 => Moment::Last,
        // The point is early enough that each disturbance takes effect before the end.
        _ => Moment::Behind(draw.random_range(1..motions / 4)),
    };
    (moment, disturbance)
}
