//! Random walks from a seed, in virtual time: a client sends one path after another, while every possible fault is
//! injected.
//!
//! A walk has at least 100 commands, 3 faults and 20 s. Steps without a fault are far more likely than faults, so that
//! the walk reaches motions. At the end all faults are removed, and the client must reconnect and execute a path.

// The module is given by its path, because a bench includes this file by its own path.
#[path = "walks/faults.rs"]
mod faults;

use super::cell::{self, Cell, pass, sanding_tool, setup, speed};
use super::damage::MAPPED_INPUT;
use super::oracles::Oracles;
use panelprep::devices::mock::{Clock, Programs, Rule, Setup};
use panelprep::eki::{
    Command, CommandId, Epoch, LinkLimits, MappedInputs, MoveJ, MoveLin, QueueError, Report, Signal,
};
use panelprep::geometry::Joints;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::cell::Cell as Flag;
use std::collections::BTreeMap;
use std::time::Duration;

/// Number of walks in each test run. For more, set `LINK_WALKS=20000`, as `make bench-link` does.
const WALKS: u64 = 2_500;

const WEAK_WALKS: u64 = 400;
const COMMANDS: usize = 100;
const FAULTS: usize = 3;
const LENGTH_MS: u64 = 20_000;

/// Limits of a walk over the programs, in which faults are twice as frequent.
const PROGRAM_COMMANDS: usize = 60;

const PROGRAM_LENGTH_MS: u64 = 8_000;

/// Time limit from the end of all faults to a new connection, an open epoch and an executed path, ms.
const RECOVERY_MS: u64 = 12_000;

/// A requirement or limit that is weakened to check that the walks detect this, and the programs that the controller
/// executes instead of the model in Rust.
#[derive(Debug, Clone, Default)]
pub struct Weak {
    pub rule: Option<Rule>,
    pub limits: Option<LinkLimits>,
    pub programs: Option<Programs>,
}

struct Walk {
    cell: Cell,
    oracles: Oracles,
    draw: Pcg64,
    commands: usize,
    faults: usize,
    /// Time of the next fault.
    next_fault_ms: u64,
    mended: bool,
    /// Time at which the foreign program ends and the cell's program is selected again.
    home_at_ms: Option<u64>,
    /// Whether the controller executes the shipped programs.
    is_program: bool,
    /// Whether a production line receives outputs in each round.
    has_line: bool,
}

/// Outputs for a production line; commands do not switch them.
const LINE_OUTPUTS: [u16; 6] = [40, 41, 42, 43, 44, 45];

/// Returns whether the walk has a production line, whose outputs have no effect on the arm.
fn has_line(seed: u64) -> bool {
    seed % 32 == 10
}

/// Runs one walk; the error describes the violated requirement.
fn walk(seed: u64, weak: &Weak) -> Result<(), String> {
    walk_over(seed, weak).1
}

/// Runs one walk; returns the cell at its end, and the violated requirement, if any.
pub fn walk_over(seed: u64, weak: &Weak) -> (Cell, Result<(), String>) {
    let mut draw = Pcg64::seed_from_u64(seed);
    let is_program = weak.programs.is_some();
    let mut setup = Setup { omitted_rule: weak.rule, programs: weak.programs.clone(), ..setup(Clock::Free) };
    let mut limits = weak.limits.unwrap_or_default();
    if is_program {
        setup.mapped_inputs = BTreeMap::from([(MAPPED_INPUT, 860)]);
        if has_line(seed) {
            setup.line_outputs = LINE_OUTPUTS;
        }
        limits.mapped_inputs = MappedInputs::new([MAPPED_INPUT]).expect("room for one");
    }
    let mut cell = Cell::new(setup, limits, seed);
    cell.delay_ms = [(0, 0), (1, 3), (2, 25), (10, 10)][draw.random_range(0..4)];
    cell.fragment = draw.random_bool(0.3);
    let oracles = Oracles::new(cell.delay_ms.1);
    let next_fault_ms = draw.random_range(300..4_000);
    let mut walk = Walk {
        cell,
        oracles,
        draw,
        commands: 0,
        faults: 0,
        next_fault_ms,
        mended: false,
        home_at_ms: None,
        is_program,
        has_line: is_program && has_line(seed),
    };
    let found = walk.whole();
    (walk.cell, found)
}

impl Walk {
    fn whole(&mut self) -> Result<(), String> {
        let (commands, length_ms) =
            if self.is_program { (PROGRAM_COMMANDS, PROGRAM_LENGTH_MS) } else { (COMMANDS, LENGTH_MS) };
        while !(self.commands >= commands && self.faults >= FAULTS && self.cell.now_ms >= length_ms) {
            self.round()?;
            if self.cell.now_ms > 20 * LENGTH_MS {
                return Err(format!("{} commands and {} faults in 400 s", self.commands, self.faults));
            }
        }
        self.recover()
    }

    fn pass_time(&mut self, ms: u64) -> Result<(), String> {
        let end_ms = self.cell.now_ms + ms;
        while self.cell.now_ms < end_ms {
            if !self.mended && self.cell.now_ms >= self.next_fault_ms {
                self.inject_fault();
            }
            let next_ms =
                if self.mended { end_ms } else { end_ms.min(self.next_fault_ms.max(self.cell.now_ms + 1)) };
            self.cell.step(next_ms, &mut self.oracles);
            if let Some(violation) = self.oracles.violation.take() {
                return Err(violation);
            }
            self.work_with_another_program();
        }
        Ok(())
    }

    /// Advances the time until a matching report arrives; returns false if none arrived in time.
    fn until(&mut self, patience_ms: u64, found: impl Fn(&Report) -> bool) -> Result<bool, String> {
        let end_ms = self.cell.now_ms + patience_ms;
        loop {
            while let Some(report) = self.cell.next_report() {
                if found(&report) {
                    return Ok(true);
                }
            }
            if self.cell.now_ms >= end_ms {
                return Ok(false);
            }
            self.pass_time((end_ms - self.cell.now_ms).min(12))?;
        }
    }

    /// Opens an epoch and sends a path, as far as the faults allow.
    fn round(&mut self) -> Result<(), String> {
        match self.cell.session.open_epoch() {
            Ok(_) => {}
            Err(_) => {
                let _ = self.cell.session.abort();
                let pause_ms = self.draw.random_range(50..400);
                return self.pass_time(pause_ms);
            }
        }
        let ends = |report: &Report| {
            matches!(report, Report::EpochOpened { .. } | Report::EpochNotOpened { .. } | Report::LinkLost { .. })
        };
        if !self.until(1_000, ends)? || self.cell.session.epoch().is_none() {
            return self.pass_time(100);
        }
        if self.has_line {
            let bits = self.draw.random_range(0..64);
            self.cell.session.set_line_signals(bits);
        }
        let speed_m_s = [0.15, 0.3][self.draw.random_range(0..2)];
        if self.is_program && self.draw.random_bool(0.1) {
            self.queue(Command::CallSubroutine { index: 0 });
        }
        for command in [Command::SetBase(cell::BASE), sanding_tool(), speed(speed_m_s)] {
            self.queue(command);
        }
        if self.draw.random_bool(0.2) {
            let swing_deg = self.draw.random_range(-4.0..4.0);
            let joints = Joints { a1_deg: swing_deg, ..cell::START };
            self.queue(Command::MoveJ(MoveJ { joints, axis_speed_percent: 60.0 }));
        }
        for _ in 0..self.draw.random_range(0..12) {
            let signal = Signal { number: self.draw.random_range(1..9), on: self.draw.random_bool(0.5) };
            self.queue(Command::SetDigout(signal));
        }
        if self.draw.random_bool(0.1) {
            self.queue(Command::CallSubroutine { index: 0 });
        }
        if self.is_program && self.draw.random_bool(0.2) {
            let on = self.draw.random_bool(0.5);
            self.queue(Command::SetDigin(Signal { number: MAPPED_INPUT, on }));
        }
        for _ in 0..self.draw.random_range(1..3) {
            // One path in ten has more points than the window holds.
            let count = if self.draw.random_bool(0.1) { 60..140 } else { 5..36 };
            let mut points = pass(self.draw.random_range(count), 3.0, self.draw.random_bool(0.6));
            self.queue(Command::SetDigout(Signal { number: cell::TOOL_OUTPUT, on: true }));
            if self.is_program {
                self.vary(&mut points, speed_m_s);
            }
            let Some(last) = self.queue_path(&points, speed_m_s) else { break };
            if self.is_program && self.draw.random_bool(0.3) {
                for _ in 0..self.draw.random_range(1..3) {
                    let signal = Signal { number: 3, on: self.draw.random_bool(0.5) };
                    self.queue(Command::SetDigoutOnPath(signal));
                }
            }
            self.queue(Command::SetDigout(Signal { number: cell::TOOL_OUTPUT, on: false }));
            let over = |report: &Report| match report {
                Report::PathDone { last: done } => *done == last,
                Report::Standstill { .. } | Report::LinkLost { .. } | Report::Rebooted { .. } => true,
                _ => false,
            };
            let patience_ms = self.draw.random_range(500..if self.is_program { 2_500 } else { 4_000 });
            if !self.until(patience_ms, over)? {
                // The person at the cell aborts the path.
                let _ = self.cell.session.abort();
            }
        }
        let pause_ms = self.draw.random_range(100..if self.is_program { 800 } else { 2_500 });
        self.pass_time(pause_ms)
    }

    /// Gives some lines a separate speed, and makes some lines in the air stop exactly.
    fn vary(&mut self, points: &mut [MoveLin], speed_m_s: f64) {
        for point in points {
            point.speed_m_s = self.draw.random_bool(0.2).then_some(speed_m_s);
            if !point.contact && self.draw.random_bool(0.2) {
                point.blend_mm = 0.0;
            }
        }
    }

    fn queue(&mut self, command: Command) {
        // The command is refused if something has just failed; the next round begins again.
        self.commands += usize::from(self.cell.session.queue(command).is_ok());
    }

    fn queue_path(&mut self, points: &[MoveLin], speed_m_s: f64) -> Option<CommandId> {
        let epoch: Epoch = self.cell.session.epoch()?;
        let last: Result<CommandId, QueueError> = self.cell.session.queue_path(points);
        let last = last.ok()?;
        self.oracles.queued(epoch, last, points, speed_m_s);
        self.commands += points.len();
        Some(last)
    }

    /// Removes all faults: the client must reconnect and execute a path.
    fn recover(&mut self) -> Result<(), String> {
        self.mended = true;
        self.cell.controller.set_start_key(false);
        self.pass_time(4_000)?;
        let end_ms = self.cell.now_ms + RECOVERY_MS;
        while self.cell.now_ms < end_ms {
            // A fault that was set for the next base or command may still occur once.
            if self.cell.session.open_epoch().is_err() {
                let _ = self.cell.session.abort();
                self.pass_time(100)?;
                continue;
            }
            if !self.until(1_000, |report| matches!(report, Report::EpochOpened { .. }))? {
                continue;
            }
            for command in [Command::SetBase(cell::BASE), sanding_tool(), speed(0.3)] {
                self.queue(command);
            }
            let Some(last) = self.queue_path(&pass(8, 3.0, true), 0.3) else { continue };
            let done = Flag::new(false);
            let over = |report: &Report| {
                done.set(matches!(report, Report::PathDone { last: done } if *done == last));
                done.get() || !matches!(report, Report::State(_) | Report::Progress { .. })
            };
            self.until(2_500, over)?;
            if done.get() {
                return Ok(());
            }
        }
        let last = self.cell.controller.program_stops().last();
        Err(format!("not back {RECOVERY_MS} ms after everything was mended: {last:?}"))
    }
}

fn first_violation(seeds: u64, weak: &Weak) -> Option<(u64, String)> {
    (0..seeds).into_par_iter().find_map_any(|seed| walk(seed, weak).err().map(|violation| (seed, violation)))
}

#[test]
fn no_walk_violates_a_requirement() {
    let walks = std::env::var("LINK_WALKS").map_or(WALKS, |walks| walks.parse().expect("a number of walks"));
    let found = first_violation(walks, &Weak::default());
    assert_eq!(found, None);
}

/// Each requirement that is removed from the controller or the client is detected within four hundred walks.
#[test]
fn a_missing_requirement_makes_a_walk_fail() {
    let of = |rule| Weak { rule: Some(rule), ..Weak::default() };
    let patient = LinkLimits { watchdog: Duration::from_secs(3_600), ..LinkLimits::default() };
    let greedy = LinkLimits { window: Duration::from_secs(60), window_commands: 1_000, ..LinkLimits::default() };
    let client = |limits| Weak { limits: Some(limits), ..Weak::default() };
    let cases = [
        ("epoch check", of(Rule::EpochCheck)),
        ("watchdog", of(Rule::Watchdog)),
        ("link loss", of(Rule::LinkLoss)),
        ("discard", of(Rule::Discard)),
        ("retract", of(Rule::Retract)),
        ("outputs that go off", of(Rule::OutputsOff)),
        ("step of the epoch", of(Rule::EpochStep)),
        ("client's watchdog", client(patient)),
        ("client's window", client(greedy)),
    ];
    for (name, weak) in cases {
        let found = first_violation(WEAK_WALKS, &weak);
        println!("without the {name}: {found:?}");
        assert!(found.is_some(), "without the {name} every walk is green");
    }
}
