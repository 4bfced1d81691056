//! The scripted cell: its settings, the functions that run, serve and replay one of its cycles, and the result of a
//! cycle.

mod record;
mod robot;
mod tool;
mod world;

use super::super::*;
pub use crate::setup::testing::standing_state;
use crate::setup::{Calibrations, CellSetup, CycleSetup, PreparedCycle, RecordingPlan, RecordingStatus};
use panelprep_base::geometry::{Base, ColorPicture, Flange, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Event, Motion, Outcome, Path, Refusal, State};
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{Budget, Clock, ContactPath, EarlierPass, Kind, RequestRecord};
use panelprep_cell::{cell, cycle};
use panelprep_sim as sim;
use panelprep_sim::{CellTruth, Scene};
use panelprep_store::store::CycleStart;
use panelprep_store::tape::{EntryReader, LoopMemoryStart, check_recording};
use panelprep_toolpath::removal::model::Model;
pub use record::{Asks, Memory};
use robot::FakeRobot;
use std::path::PathBuf;
use std::sync::Arc;
pub use tool::AtContact;
pub use world::{FakeCameras, TaughtHere, setup};
use world::{Shared, World, calibrations, taught};

const CELL: &str = "[poses]\npark = { a1_deg = -120, a2_deg = -75, a3_deg = 110, a4_deg = 0, a5_deg = 55, a6_deg = 90 }\n\
     ready = { a1_deg = 0, a2_deg = -120, a3_deg = 145, a4_deg = 0, a5_deg = -25, a6_deg = 90 }\n\
     [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
     [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\nlight_on = 5\n";

/// The settings of a scripted cell before its cycle.
pub struct Cell {
    world: Shared,
    box_to_mm: f64,
    fails_at: usize,
    is_full: bool,
    /// Number of writes after which the disk is full; see `fills_at` of the record.
    pub fills_at: Option<usize>,
    /// Additional tables at the end of the recipe.
    pub more_recipe: &'static str,
    /// Numbers of rows and columns of grids, if they differ from those of the simulated region.
    pub grids: Option<[usize; 2]>,
    /// Additional names at the end of the cell's outputs, and of its feedbacks.
    pub more_io: [&'static str; 2],
    /// Additional tables at the end of the cell's file.
    pub more_cell: &'static str,
    /// Wear of the disc before the cycle, mm².
    pub worn_mm2: f64,
    /// The removal model of the disc, if it is calibrated.
    pub removal: Option<Model>,
    /// Earlier sanding passes over the panel.
    pub earlier: Vec<EarlierPass>,
    /// The folder in which the cycles of the service are recorded for replay, if any.
    pub record: Option<PathBuf>,
    /// Whether time passes continuously, and not only while the loop waits for the robot.
    pub by_the_wall: bool,
}

impl Cell {
    pub fn new(scene: Scene) -> Self {
        let world = Shared::new(World::new(sim::Cell::new(3, scene, 4)));
        Cell {
            world,
            box_to_mm: 700.0,
            fails_at: usize::MAX,
            is_full: false,
            fills_at: None,
            more_recipe: "",
            grids: None,
            more_io: ["", ""],
            more_cell: "",
            worn_mm2: 0.0,
            removal: None,
            earlier: Vec::new(),
            record: None,
            by_the_wall: false,
        }
    }

    pub fn with_box_to(self, x_mm: f64) -> Self {
        Cell { box_to_mm: x_mm, ..self }
    }

    /// Returns the cell with a robot that executes ten commands in 100 ms.
    pub fn slow(self) -> Self {
        self.world.borrow_mut().pace = 10;
        self
    }

    pub fn whose_panel_turns_when_wet(self, degrees: f64) -> Self {
        self.world.borrow_mut().turns_when_wet_deg = degrees;
        self
    }

    /// Returns the cell with a bowed panel: its middle is this distance in front of its taught position.
    pub fn whose_panel_bows(self, bow_mm: f64) -> Self {
        {
            let mut world = self.world.borrow_mut();
            world.sim = world.sim.clone().with_bow(bow_mm);
        }
        self
    }

    /// Returns the cell with a panel that is as greasy after sanding as before.
    pub fn whose_panel_stays_greasy(self) -> Self {
        self.world.borrow_mut().stays_greasy = true;
        self
    }

    pub fn whose_link_is_lost_in_contact(self) -> Self {
        self.world.borrow_mut().loses_link = true;
        self
    }

    /// Returns the cell with the flange at this pose before the cycle; the axis positions are the solution nearest to
    /// `near`.
    pub fn whose_flange_stands_at(
        self,
        (base_from_flange, near): (
            panelprep_base::geometry::Rigid<panelprep_base::geometry::Base, panelprep_base::geometry::Flange>,
            panelprep_base::geometry::Joints,
        ),
    ) -> Self {
        {
            let mut world = self.world.borrow_mut();
            world.joints = world.arm.nearest(&base_from_flange, &near).expect("within reach");
            world.base_from_flange = base_from_flange;
        }
        self
    }

    /// Returns the cell with an arm that needs this time to stop after an abort, ms.
    pub fn that_brakes_for(self, ms: u64) -> Self {
        self.world.borrow_mut().brakes_ms = ms;
        self
    }

    /// Returns the cell with a robot that needs this time for each waypoint of a contact path, ms.
    pub fn whose_contact_takes(self, ms: u64) -> Self {
        self.world.borrow_mut().contact_round_ms = ms;
        self.step_by_step()
    }

    /// Returns the cell with a robot that reports a wrong TCP position on a contact path: this distance off the path,
    /// mm, from the first to the second of these waypoints.
    pub fn that_is_off_plan(self, mm: f64, waypoints: [u32; 2]) -> Self {
        self.world.borrow_mut().off_plan = Some((mm, waypoints));
        self
    }

    /// Returns the cell with a dead feedback: this bit of `In` is off from this waypoint in contact on.
    pub fn whose_feedback_is_dead(self, bit: u32, from: u32) -> Self {
        self.world.borrow_mut().dead_feedback = Some((bit, from));
        self
    }

    pub fn with_record_that_fails_at(self, writes: usize) -> Self {
        Cell { fails_at: writes, ..self }
    }

    pub fn with_full_disk(self) -> Self {
        Cell { is_full: true, ..self }
    }

    pub fn fails(self, asks: Asks) -> DaemonError {
        let world = self.world.clone();
        let error = self.tried(asks).err().expect("an error");
        assert!(!world.borrow().open, "the epoch is ended");
        error
    }

    pub fn run(self, asks: Asks) -> Story {
        self.tried(asks).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Returns a function that dries the panel, as a person does before a held cycle continues.
    pub fn dries(&self) -> impl Fn() -> bool + use<> {
        let world = self.world.clone();
        move || {
            world.borrow_mut().water_off_ms = 0;
            true
        }
    }

    /// Returns the cell's file, the recipe, the taught data, and the calibrations.
    pub fn files(&self) -> (cell::Cell, Recipe, TaughtHere, Calibrations) {
        let (taught, recipe) = taught(&self.world.borrow().sim, (self.more_recipe, self.grids));
        let [outputs, feedbacks] = self.more_io;
        let io = CELL.replace("[io.feedbacks]", &format!("{outputs}[io.feedbacks]"));
        let text = format!(
            "{io}{feedbacks}[limits]\nbox_min_mm = [100, -450, 50]\nbox_max_mm = [{}, 450, 900]\nmax_tilt_deg = 60\n{}",
            self.box_to_mm, self.more_cell
        );
        let cell = cell::Cell::check("cell.toml", &text).unwrap_or_else(|e| panic!("{e}"));
        let calibrations = calibrations(&self.world.borrow().sim, self.removal);
        (cell, recipe, taught, calibrations)
    }

    /// Returns the scan of the cell's 3D camera.
    pub fn scan(&self) -> panelprep_base::geometry::OrganizedCloud<panelprep_base::geometry::Camera> {
        self.world.borrow().sim.scan()
    }

    /// Returns the setup of a cycle of this cell.
    pub fn setup(&self) -> CycleSetup {
        let (cell, recipe, taught, calibrations) = self.files();
        setup(&cell, &recipe, &taught, calibrations)
    }

    /// Serves requests until `asks` requests to leave; `cameras` may wrap the cell's own cameras.
    pub fn serve<E: CameraPort + Send + 'static>(
        &self,
        cameras: impl FnOnce(FakeCameras) -> E,
        readable: Vec<Reason>,
        asks: &mut dyn RequestPort,
    ) -> Memory {
        let mut record = Memory {
            fails_at: self.fails_at,
            is_full: self.is_full,
            fills_at: self.fills_at,
            worn_mm2: self.worn_mm2,
            earlier: self.earlier.clone(),
            ..Memory::default_of(&self.world)
        };
        let lock_step = !self.by_the_wall;
        let recording = RecordingSwitch::new("store".as_ref(), lock_step);
        let mut robot = FakeRobot { world: self.world.clone(), by_the_wall: self.by_the_wall };
        let mut tool = self.tool();
        let cameras = RecordedPort::new(Box::new(cameras(FakeCameras::new(self.world.clone()))), recording.clone());
        let ports = LoopPorts {
            robot: &mut RecordedPort::new(&mut robot, recording.clone()),
            tool: &mut RecordedPort::new(&mut tool, recording.clone()),
            record: &mut RecordedPort::new(&mut record, recording.clone()),
            requests: &mut RecordedPort::new(asks, recording.clone()),
            computing: computing(Box::new(cameras), readable, lock_step),
            lock_step,
        };
        let cell = Arc::new(CellSetup::new(&self.files().0).expect("complete"));
        let start = LoopStart { cell, cycle: None, state: State::INITIAL, before: LoopMemoryStart::Boot };
        run(start, ports).unwrap_or_else(|error| panic!("{error}"));
        if let Some(recorded) = recording.finish() {
            assert_eq!(recorded.is, RecordingStatus::Whole, "{}", recorded.message);
        }
        record
    }

    /// Returns the executor of this cell's computing actions, with the wall clock.
    pub fn computing(&self) -> Computing<'static> {
        computing(Box::new(FakeCameras::new(self.world.clone())), vec![], false)
    }

    /// Returns a function that replaces the mock controller by a real controller, with the boot ID of a real one.
    pub fn becomes_real(&self) -> impl Fn() + use<> {
        let world = self.world.clone();
        move || world.borrow_mut().boot = 820_000_000
    }

    /// Returns a function that sets the selector switch.
    pub fn turns_to_local(&self, is_local: bool) -> impl Fn() -> bool + use<> {
        let world = self.world.clone();
        move || {
            world.borrow_mut().is_local = is_local;
            true
        }
    }

    /// Returns a function that ends the epoch before the next command, as a stop does that reaches the robot before the
    /// loop has processed it. The function returns true after the command was received.
    pub fn stops_before_a_command(&self) -> impl FnMut() -> bool + use<> {
        let world = self.world.clone();
        let mut has_stopped = false;
        move || {
            let mut world = world.borrow_mut();
            if !std::mem::replace(&mut has_stopped, true) {
                world.is_overtaken = true;
            }
            world.unsent > 0
        }
    }

    pub fn light(&self, on: bool) {
        self.world.borrow_mut().outputs.insert(1, on);
    }

    pub fn time_passes(&self, ms: u64) {
        self.world.borrow_mut().time_ms += ms;
    }

    /// Replays the recording in this file.
    pub fn replay(&self, file: &std::path::Path) -> (LoopOutcome, ReplayResult) {
        let bytes = std::fs::read(file).expect("a recording");
        let start = check_recording(&bytes[..]).expect("whole").start;
        let setup = Arc::new(self.setup());
        let player = Player::new(EntryReader::new(&bytes[..], start.unix_ns), start.lock_step);
        let ports = LoopPorts {
            robot: &mut player.clone(),
            tool: &mut player.clone(),
            record: &mut player.clone(),
            requests: &mut player.clone(),
            computing: Computing::inline(Box::new(player.clone()), start.lock_step),
            lock_step: start.lock_step,
        };
        let start = LoopStart { cell: setup.cell(), cycle: Some(setup), state: start.state, before: start.begin };
        let ended = run(start, ports);
        let played = player.replay_result();
        (ended.unwrap_or_else(|error| panic!("{error}: {played:?}")), played)
    }

    /// Returns a cycle of this cell that is ready to begin.
    pub fn prepared(&self) -> PreparedCycle {
        let calibrations = calibrations(&self.world.borrow().sim, self.removal);
        let start = CycleStart {
            panel: "p".to_owned(),
            taught_version: String::new(),
            recipe_text: String::new(),
            file_texts: Vec::new(),
            recording: None,
            is_air_run: false,
        };
        let request = cycle::Request::Start { max_passes: 2, max_moves: 3, dries: false };
        let recording =
            self.record.clone().map(|file| RecordingPlan { file: Some(file), files: vec![], calibrations });
        PreparedCycle { request, setup: self.setup(), start, recording, remarks: vec![] }
    }

    fn tried(self, mut asks: Asks) -> Result<Story, DaemonError> {
        let setup = Arc::new(self.setup());
        let mut robot = FakeRobot { world: self.world.clone(), by_the_wall: false };
        let cameras = FakeCameras::new(self.world.clone());
        let (fails_at, worn_mm2) = (self.fails_at, self.worn_mm2);
        let earlier = self.earlier.clone();
        let mut record = Memory { fails_at, worn_mm2, earlier, ..Memory::default_of(&self.world) };
        let ports = LoopPorts {
            robot: &mut robot,
            tool: &mut self.tool(),
            record: &mut record,
            requests: &mut asks,
            computing: Computing::inline(Box::new(cameras), true),
            lock_step: true,
        };
        let start = LoopStart {
            cell: setup.cell(),
            cycle: Some(setup),
            state: State::INITIAL,
            before: LoopMemoryStart::Boot,
        };
        let outcome = run(start, ports)?;
        let world = self.world.borrow();
        Ok(Story {
            outcome,
            truth: world.sim.truth(),
            findings: record.findings,
            figures: record.figures,
            pictures: record.pictures,
            frames: record.frames,
            films_began_s: world.films_began_s.clone(),
            budget: record.budget,
            intents: record.intents,
            events: record.events,
            refusals: asks.refusals,
            contact_points: world.waypoints,
            lines: world.lines,
            feeds: world.feeds_m_s.iter().copied().zip(world.blends_mm.iter().copied()).collect(),
            worn_mm2: record.worn_mm2,
            wears: record.wears,
            contacts: record.contacts,
            beyond: world.beyond,
            asked: record.asked,
            clocks: record.clocks,
            moved_without_intent: world.moved_without_intent,
            contact_off_mm: world.contact_off_mm.clone(),
            bases: world.bases.clone(),
            warning_ms: (world.warning_ms.clone(), world.first_move_ms),
        })
    }
}

fn computing(cameras: Box<dyn CameraPort + Send>, readable: Vec<Reason>, lock_step: bool) -> Computing<'static> {
    let keep = Box::new(|_: &panelprep_base::geometry::ColorPicture| {
        // Pictures are never stored on the loop's thread, because this would delay its deadlines and its watchdog.
        assert_eq!(std::thread::current().name(), Some("computing"));
        Ok(Some(String::new()))
    });
    let parts = (cameras, Box::new(move || readable.clone()) as _, keep as _);
    Computing::on_thread(
        parts,
        lock_step,
        &panelprep_base::supervision::Supervisor::default(),
        super::LiveView::default(),
    )
    .expect("a thread")
}

/// The result of a run of the scripted cell.
pub struct Story {
    pub outcome: LoopOutcome,
    pub truth: CellTruth,
    pub findings: Vec<Finding>,
    pub figures: Vec<String>,
    pub pictures: Vec<(String, ColorPicture, Rigid<Base, Flange>)>,
    pub frames: Vec<(Arc<ColorPicture>, f64, Phase)>,
    /// The times at which the films began, s.
    pub films_began_s: Vec<f64>,
    pub budget: Budget,
    pub intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
    pub refusals: Vec<(cycle::Request, Refusal)>,
    pub contact_points: usize,
    pub lines: usize,
    /// Feed, m/s, and rounding, mm, of each line that has its own feed.
    pub feeds: Vec<(f64, f64)>,
    pub worn_mm2: f64,
    pub wears: Vec<(f64, bool)>,
    pub contacts: Vec<(ContactPath, Vec<u32>)>,
    /// Number of waypoints that were executed before the record permitted them.
    pub beyond: u32,
    pub asked: Vec<RequestRecord>,
    pub clocks: Vec<Clock>,
    pub moved_without_intent: usize,
    /// Distance of each contact point in front of the true panel, mm.
    pub contact_off_mm: Vec<f64>,
    /// Each base that was set, in order.
    pub bases: Vec<panelprep_base::geometry::KukaPose>,
    /// The times at which output 6 was set, with its values, ms, and the time at which the arm first moved, ms.
    pub warning_ms: (Vec<(u64, bool)>, Option<u64>),
}

impl Story {
    /// Returns the stages that recorded a finding.
    pub fn stages(&self) -> Vec<Kind> {
        self.findings.iter().map(|finding| finding.kind).collect()
    }

    /// Returns the completed motions along this path.
    pub fn motions(&self, path: Path) -> Vec<(Motion, Outcome, u32)> {
        let closed = self.intents.iter().filter(|(motion, _)| motion.path == path);
        closed.filter_map(|(motion, end)| end.map(|(outcome, done)| (*motion, outcome, done))).collect()
    }
}

impl std::fmt::Display for Story {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{:?} {:?}", self.outcome.state.at, self.refusals)?;
        for event in self
            .events
            .iter()
            .filter(|e| !matches!(e, Event::Reported(panelprep_cell::cycle::Report::Progress { .. })))
        {
            writeln!(f, "{event:?}")?;
        }
        for finding in &self.findings {
            writeln!(f, "{:?} {:?} {:?}", finding.kind, finding.judgement, finding.checks)?;
        }
        Ok(())
    }
}
