//! `panelprep cycle` and `panelprep air-run`: one cycle on the configured cell, or its path in the air, then exit.

use super::args::{Common, Cycle};
use super::assignment::{Assignment, Calibrated};
use super::fault::Fault;
use super::live::Live;
use super::load::CellFiles;
use super::outcome::Outcome;
use crate::cycle::{At, Event, Refusal, Report, Request, Robot, State};
use crate::daemon::{Ask, Ports, Requests, StoreRecord, run_cycle};
use crate::geometry::KukaPose;
use crate::verdict::{Judgement, Verdict};
use serde_json::json;

/// Runs the cycle and tells how it ended.
///
/// # Errors
/// Where a file is not what it must be, a motion is open in the store, or the store does not write.
pub fn run(args: &Cycle, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    once(args, common, progress, Assignment::request)
}

/// The same in the air: no water, no tool, no contact; the path goes over all grids.
///
/// # Errors
/// As [`run`].
pub fn air_run(args: &Cycle, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    once(args, common, progress, Assignment::air_request)
}

fn once(
    args: &Cycle,
    common: &Common,
    progress: &dyn Fn(&str),
    request: fn(&Assignment) -> Request,
) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let assignment = Assignment::read(&files, &args.recipe)?;
    let calibrated = Calibrated::read(&files, common)?;
    let job = assignment.job(&files, &calibrated)?;
    let mut store = files.settled_store()?;
    // The cycle that an earlier program left has its end from `recover`; this start is not part of the new one.
    store.append(&Event::Told(Report::Boot), None).map_err(Fault::stage)?;
    let journal = store.journal().map_err(Fault::stage)?;

    let mut live = Live::start(&files.cell, &calibrated.values, args.simulation)?;
    if let Some(simulated) = &live.simulated {
        simulated.world.mount_disc(assignment.recipe.path().disc_diameter_mm());
    }
    let cycle = store.begin_cycle(&assignment.start(&calibrated)).map_err(Fault::stage)?;
    let mut once = Once { start: request(&assignment), asked: 0, refused: None, told: None, progress };
    let ports = Ports {
        robot: &mut live.robot,
        eyes: &mut live.eyes,
        record: &mut StoreRecord::new(&mut store, cycle),
        requests: &mut once,
    };
    let ended = run_cycle(&job, ports, journal).map_err(Fault::stage)?;
    let verdict = ended.verdict.unwrap_or(Verdict::Aborted);
    let reasons = store
        .cycle(cycle)
        .ok()
        .and_then(|kept| kept.judgement)
        .map(|judgement| judgement.reasons)
        .unwrap_or_default();
    let mut outcome = Outcome::of(&Judgement { verdict, reasons });
    outcome.say(format!("cycle {cycle}: {}", ended.state.at.word()));
    if let Some((request, refusal)) = once.refused {
        outcome.say(format!("refused: {request:?}, {refusal:?}"));
    }
    let passes: Vec<_> = ended.passes.iter().map(|(grid, times)| format!("{grid} ×{times}")).collect();
    outcome.say(format!("abraded: {}", if passes.is_empty() { "nothing".to_owned() } else { passes.join(", ") }));
    outcome.put("cycle_id", json!(cycle.0));
    outcome.put("state", json!(ended.state.at.word()));
    outcome.put("abraded", json!(passes));
    outcome.put("base_from_panel", json!(ended.base_from_panel.map(|place| KukaPose::from_rigid(&place))));
    Ok(outcome)
}

/// Asks for one cycle and leaves where it rests.
struct Once<'a> {
    start: Request,
    asked: u8,
    refused: Option<(Request, Refusal)>,
    told: Option<At>,
    progress: &'a dyn Fn(&str),
}

impl Requests for Once<'_> {
    fn next(&mut self, state: &State) -> Ask {
        if self.told.replace(state.at) != Some(state.at) {
            (self.progress)(&format!("{:?}", state.at));
        }
        let asked = self.asked;
        let mut ask = |request| {
            self.asked += 1;
            Ask::For(request)
        };
        match (state.at, asked) {
            (At::Stopped, 0) if state.facts.robot == Robot::Ready => ask(Request::Reset),
            (At::Idle, 1) => ask(self.start),
            // A result for a person ends there; so does what a person must mend.
            (At::Held(_), 2) => ask(Request::Stop),
            (At::Stopped, 0) if state.facts.robot == Robot::Unknown => Ask::Nothing,
            (At::Stopped | At::Complete { .. } | At::Aborted { .. }, _) => Ask::Leave,
            _ => Ask::Nothing,
        }
    }

    fn refused(&mut self, request: Request, refusal: Refusal) {
        self.refused = Some((request, refusal));
    }
}
