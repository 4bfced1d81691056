//! `panelprep cycle`: one cycle on the simulated cell, then exit.

use super::args::{Common, Cycle};
use super::disk;
use super::fault::Fault;
use super::load::{self, CellFiles};
use super::outcome::Outcome;
use crate::cycle::{At, Event, Refusal, Report, Request, Robot, State};
use crate::daemon::{Ask, Calibrations, Cameras, Job, LinkedRobot, Ports, Requests, StoreRecord, run_cycle};
use crate::devices::cameras::simulated;
use crate::devices::mock::{self, ChannelFile, Controller, MockServer};
use crate::devices::robot::{Address, BlockingLink, link_limits};
use crate::devices::world::SimulatedWorld;
use crate::eki::{CELLCMD, CELLSTAT, Pace};
use crate::geometry::KukaPose;
use crate::sim;
use crate::store::CycleStart;
use crate::verdict::{Judgement, Verdict};
use serde_json::json;

/// Width of the simulated scanner's picture at full size, px.
const FULL_WIDTH_PX: usize = 1944;

/// Runs the cycle and tells how it ended.
///
/// # Errors
/// Where a file is not what it must be, a motion is open in the store, or the store does not write.
pub fn run(args: &Cycle, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let recipe = load::recipe(&args.recipe)?;
    let taught = load::taught(&files, &args.recipe, &recipe)?;
    let (scanner, base_from_camera) = (files.scanner()?, files.base_from_camera()?);
    let (flange_camera, flange_from_camera) = (files.flange_camera()?, files.flange_from_camera()?);
    let tool = files.flange_from_tool()?;
    let calibrations = Calibrations {
        scanner: scanner.value,
        base_from_camera: base_from_camera.value,
        flange_camera: flange_camera.value,
        flange_from_camera: flange_from_camera.value,
        flange_from_tool: tool.value,
    };
    let job =
        Job::new(&files.cell, &recipe, (&taught.panel, &taught.corners), calibrations).map_err(Fault::stage)?;
    let mut store = files.store_for_writing()?;
    let recovered = store.recover().map_err(Fault::stage)?;
    if recovered.intent.is_some() || store.has_open_motion().map_err(Fault::stage)? {
        return Err(Fault::MotionOpen);
    }
    if matches!(recovered.at, At::Aborted { .. }) {
        return Err(Fault::NotCleared);
    }
    // The cycle that an earlier program left has its end from `recover`; this start is not part of the new one.
    store.append(&Event::Told(Report::Boot), None).map_err(Fault::stage)?;
    let journal = store.journal().map_err(Fault::stage)?;
    let texts = [
        ("cell", disk::read_text(&common.cell)?),
        ("scanner", scanner.text),
        ("base_from_camera", base_from_camera.text),
        ("flange_camera", flange_camera.text),
        ("flange_from_camera", flange_from_camera.text),
        ("flange_from_tool", tool.text),
    ];
    let start = CycleStart {
        panel: recipe.panel().to_owned(),
        taught_version: taught.version.clone(),
        recipe_text: disk::read_text(&args.recipe)?,
        file_texts: texts.map(|(name, text)| (name.to_owned(), text)).into(),
    };
    let cycle = store.begin_cycle(&start).map_err(Fault::stage)?;

    let reduction = (FULL_WIDTH_PX / scanner.value.width_px.max(1)).max(1);
    let simulated_cell = sim::Cell::new(args.seed, args.scene.into(), reduction);
    let world =
        SimulatedWorld::new(simulated_cell, &files.cell, recipe.path().disc_diameter_mm()).map_err(Fault::stage)?;
    let channel = |text| ChannelFile::parse(text).map_err(Fault::stage);
    let setup = world.setup(&files.cell, channel(CELLCMD)?, channel(CELLSTAT)?);
    let controller = Controller::new(setup, world.terminals()).map_err(Fault::stage)?;
    let server = MockServer::start(controller, mock::Ports::free()).map_err(Fault::stage)?;
    let address = Address {
        host: server.command_address().ip().to_string(),
        command_port: server.command_address().port(),
        state_port: server.state_address().port(),
    };
    let link =
        BlockingLink::start(address, link_limits(files.cell.limits()), Pace::LockStep).map_err(Fault::stage)?;
    let (scanner, flange) = simulated(&world, &server.handle());
    let max_passes = u8::try_from(recipe.process().max_passes_per_grid()).unwrap_or(u8::MAX);
    let max_moves = u8::try_from(recipe.corner().max_moves()).unwrap_or(u8::MAX);
    let mut once =
        Once { start: Request::Start { max_passes, max_moves }, asked: 0, refused: None, told: None, progress };
    let ports = Ports {
        robot: &mut LinkedRobot::new(link, Pace::LockStep),
        eyes: &mut Cameras { scanner, flange },
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
