//! Compares the hand-written model of the controller with the shipped programs: the same commands and the same
//! disturbances, each at the same point of the work. The client must observe the same on both, or the difference must
//! be in the table of intended differences.

mod meant;
mod script;

use super::super::cell::{self, Blind, Cell, height_mm, setup};
use super::{behaviour_variant, load, texts};
use meant::{Both, INTENDED_DIFFERENCES, Kind};
use panelprep::devices::mock::{Clock, ExecutedMotion, Programs, Setup, World};
use panelprep::eki::{Command, LinkLimits, LinkLoss, MoveLin, Refusal, Report, StopCause};
use rayon::prelude::*;
use script::{Disturbance, Moment, Part, script};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Number of scripts in each test run.
const SCRIPTS: u64 = 250;
/// Maximum time until the client is connected again, ms.
const MAX_RECONNECT_MS: u64 = 15_000;
/// Time limit for an epoch, ms.
const EPOCH_MS: u64 = 15_000;
/// Time from the end of an epoch until all faults are removed and the arm is stationary, ms.
const SETTLE_MS: u64 = 5_000;
/// Off the panel.
const MAX_CONTACT_HEIGHT_MM: f64 = 1.0;
/// Outputs that the end of an epoch switches off immediately.
const HARMFUL: [u16; 2] = [2, cell::TOOL_OUTPUT];

/// The events of an epoch that the client can observe.
#[derive(Debug, Clone, Default, PartialEq)]
struct EpochTrace {
    opened: bool,
    /// Whether the epoch's last path was reported as executed.
    finished: bool,
    executed: Vec<ExecutedMotion>,
    /// The outputs that were on before the epoch.
    before: BTreeMap<u16, bool>,
    /// The changes of the outputs in the epoch, in order.
    outputs: Vec<(u16, bool)>,
    /// The first reason that was reported for the end of the epoch.
    why: Option<&'static str>,
    harmful: bool,
    on_panel: bool,
    connected: bool,
}

/// The terminals of the controller, which record the changes of the outputs in order.
#[derive(Default)]
struct Terminals(Arc<Mutex<Vec<(u16, bool)>>>);

impl World for Terminals {
    fn on_output(&mut self, number: u16, value: bool, _: u64) {
        self.0.lock().expect("no test has failed inside").push((number, value));
    }

    fn input(&self, _: u16, _: u64) -> Option<bool> {
        None
    }
}

/// A run of a script on one controller, which gives the trace of each epoch.
struct Run {
    cell: Cell,
    changes: Arc<Mutex<Vec<(u16, bool)>>>,
}

impl Run {
    fn new(programs: Option<Programs>, seed: u64) -> Self {
        let changes = Arc::<Mutex<Vec<(u16, bool)>>>::default();
        let setup = Setup { programs, ..setup(Clock::Free) };
        let mut cell = Cell::within(setup, LinkLimits::default(), seed, Box::new(Terminals(changes.clone())));
        cell.delay_ms = [(1, 1), (2, 2), (10, 10)][(seed % 3) as usize];
        cell.run(2_000, &mut Blind);
        Run { cell, changes }
    }

    fn run_epoch(&mut self, part: &Part) -> EpochTrace {
        let mut trace = EpochTrace::default();
        let end_ms = self.cell.now_ms + MAX_RECONNECT_MS;
        while !trace.opened && self.cell.now_ms < end_ms {
            if self.cell.session.open_epoch().is_err() {
                let _ = self.cell.session.abort();
                self.cell.run(200, &mut Blind);
            }
            trace.opened = self.cell.until(600, |report| matches!(report, Report::EpochOpened { .. }))
                && self.cell.session.epoch().is_some();
        }
        let Some(epoch) = self.cell.session.epoch() else { return trace };
        self.changes.lock().expect("whole").clear();
        trace.before = self.cell.controller.outputs().clone();
        trace.before.retain(|_, on| *on);
        let executed_before = self.cell.executed().len();
        let mut wrong = part.wrong;
        self.disturb(&mut wrong, |moment| moment == Moment::First);
        let mut last = None;
        for commands in &part.commands {
            let lines: Vec<MoveLin> = commands
                .iter()
                .filter_map(|command| if let Command::MoveLin(line) = command { Some(*line) } else { None })
                .collect();
            let queued = match lines.is_empty() {
                true => commands.iter().try_for_each(|command| {
                    last = Some(self.cell.session.queue(*command)?);
                    Ok::<(), panelprep::eki::QueueError>(())
                }),
                false => self.cell.session.queue_path(&lines).map(|id| last = Some(id)),
            };
            if queued.is_err() {
                break;
            }
        }
        let end_ms = self.cell.now_ms + EPOCH_MS;
        while self.cell.now_ms < end_ms && trace.why.is_none() && !trace.finished {
            let executed = self.cell.executed().len() - executed_before;
            self.disturb(&mut wrong, |moment| matches!(moment, Moment::Behind(motions) if motions <= executed));
            self.cell.run(4, &mut Blind);
            self.take_reports(&mut trace, last);
        }
        if trace.finished {
            // Waits for the outputs after the last motion.
            self.cell.run(200, &mut Blind);
        }
        trace.outputs = self.changes.lock().expect("whole").clone();
        self.disturb(&mut wrong, |_| true);
        self.cell.run(SETTLE_MS, &mut Blind);
        self.take_reports(&mut trace, last);
        let of_epoch = |step: &&ExecutedMotion| step.epoch.cast_unsigned() == epoch.0;
        trace.executed = self.cell.executed()[executed_before..].iter().filter(of_epoch).copied().collect();
        let outputs = self.cell.controller.outputs();
        trace.harmful =
            self.cell.session.epoch().is_none() && HARMFUL.iter().any(|number| outputs.get(number) == Some(&true));
        trace.on_panel =
            part.contact && !trace.executed.is_empty() && height_mm(&self.cell.controller) < MAX_CONTACT_HEIGHT_MM;
        trace.connected = self.cell.session.is_connected();
        trace
    }

    fn disturb(&mut self, wrong: &mut Option<(Moment, Disturbance)>, is_now: impl Fn(Moment) -> bool) {
        let Some((_, disturbance)) = wrong.take_if(|(moment, _)| is_now(*moment)) else { return };
        let now_ms = self.cell.now_ms;
        match disturbance {
            Disturbance::Happens(fault) => self.cell.controller.apply_fault(fault),
            Disturbance::Cut(channel, side) => self.cell.cut(channel, side, false),
            Disturbance::Stalls(for_ms) => self.cell.client_stalls_until_ms = now_ms + for_ms,
            Disturbance::Deaf(for_ms) => self.cell.deaf_until_ms = now_ms + for_ms,
            Disturbance::Abort => drop(self.cell.session.abort()),
            Disturbance::Foreign => {
                let next = self.cell.controller.epoch() + 1;
                self.cell.foreign_request(11, next);
            }
        }
    }

    fn take_reports(&mut self, trace: &mut EpochTrace, last: Option<panelprep::eki::CommandId>) {
        while let Some(report) = self.cell.next_report() {
            if let Report::Progress { done } = &report {
                trace.finished |= Some(*done) == last && trace.why.is_none();
            }
            if !trace.finished && trace.why.is_none() {
                trace.why = end_reason(&report);
            }
        }
    }
}

/// Returns the reason for the end of an epoch, according to the reports to the client.
fn end_reason(report: &Report) -> Option<&'static str> {
    Some(match report {
        Report::Refused { refusal: Refusal::NotReachable, .. } => "refused: not reachable",
        Report::Refused { refusal: Refusal::NoMotionMode, .. } => "refused: no motion",
        Report::Refused { refusal: Refusal::Stopped | Refusal::WrongEpoch, .. } => "refused: stopped",
        Report::Refused { .. } => "refused",
        Report::EchoMismatch(_) => "echo",
        Report::Interrupted { cause: StopCause::ByProgram | StopCause::ModeTurned | StopCause::NoProgram } => {
            "by the program"
        }
        Report::Interrupted { .. } => "safety",
        Report::SequenceError(_) => "sequence",
        Report::WatchdogExpired { .. } => "watchdog",
        Report::Rebooted { .. } => "rebooted",
        Report::LinkLost { why: LinkLoss::Refused { .. } } => return None,
        Report::LinkLost { .. } => "link",
        Report::Standstill { .. } => "standstill",
        Report::Slow { contact: true, .. } => "slow",
        _ => return None,
    })
}

/// A difference: the script and epoch in which it was found, its description, and its row among the intended
/// differences.
type Found = (u64, usize, Kind, String, Option<usize>);

fn run_both(seed: u64, ships: &Programs) -> Vec<Found> {
    let adverse = seed % 2 == 1;
    let mut programs = ships.clone();
    (programs.meaning, programs.seed, programs.is_adverse_scheduling) = (behaviour_variant(seed), seed, adverse);
    let (mut model, mut programs) = (Run::new(None, seed), Run::new(Some(programs), seed));
    let mut found = Vec::new();
    for (index, part) in script(seed).iter().enumerate() {
        let both = Both { part, adverse, model: model.run_epoch(part), programs: programs.run_epoch(part) };
        for kind in both.differences() {
            let row = INTENDED_DIFFERENCES.iter().position(|row| row.kinds.contains(&kind) && (row.is_it)(&both));
            let (model, programs) = (&both.model, &both.programs);
            let words = format!(
                "{:?}: {:?} {:?}, {} {} motions",
                part.wrong,
                model.why,
                programs.why,
                model.executed.len(),
                programs.executed.len()
            );
            found.push((seed, index, kind, words, row));
        }
        if !(both.model.opened && both.programs.opened) {
            break;
        }
    }
    found
}

/// For more scripts, set `KRL_WALKS=5000`. Scripts that show intended differences are always included.
#[test]
fn the_model_and_the_programs_behave_equally() {
    let ships = load(&texts("config/kuka"));
    let scripts = std::env::var("KRL_WALKS").ok().and_then(|walks| walks.parse().ok()).unwrap_or(SCRIPTS);
    let shows: Vec<u64> =
        INTENDED_DIFFERENCES.iter().map(|row| row.shown_by).filter(|seed| *seed >= scripts).collect();
    let all: Vec<u64> = (0..scripts).chain(shows).collect();
    let found: Vec<Found> = all.into_par_iter().flat_map_iter(|seed| run_both(seed, &ships)).collect();
    let mut seeds: [Vec<u64>; INTENDED_DIFFERENCES.len()] = Default::default();
    let mut unknown = Vec::new();
    for (seed, index, kind, words, row) in found {
        match row {
            Some(row) => seeds[row].push(seed),
            None => unknown.push(format!("script {seed}, epoch {index}: {kind:?}, {words}")),
        }
    }
    for (row, seeds) in INTENDED_DIFFERENCES.iter().zip(&seeds) {
        println!("{} times {}, first in {:?}: {}", seeds.len(), row.name, seeds.first(), row.reason);
    }
    unknown.iter().take(40).for_each(|found| println!("{found}"));
    assert_eq!(unknown.len(), 0, "of {scripts} scripts");
    for (row, seeds) in INTENDED_DIFFERENCES.iter().zip(&seeds) {
        assert!(seeds.contains(&row.shown_by), "{}: what never differs need not be allowed", row.name);
    }
}
