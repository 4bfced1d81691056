//! The scripted cell.

use super::super::*;
use crate::cell;
use crate::cycle::{At, Event, Motion, Outcome, Path, Refusal, Request, State};
use crate::devices::mock::Arm;
use crate::eki::{self, Command, CommandId, Epoch, Mode, MoveLin, QueueError, Report, SetTcp, Time};
use crate::geometry::{Base, ColorPicture, KukaPose, OrganizedCloud, Panel};
use crate::panel::{CornerTeaching, panel_from_base_at_teaching};
use crate::phase::Phase;
use crate::record::{Budget, CycleId, Kind};
use crate::sim::{self, Place, SEARCH_BOX_MM, Scene, Truth, WET_FROM_S};
use crate::store::CycleStart;
use crate::verdict::{Reason, Verdict};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What is true of the cell.
struct World {
    sim: sim::Cell,
    time_ms: u64,
    epoch: u32,
    open: bool,
    next_id: u32,
    done: u32,
    queue: VecDeque<(u32, Command)>,
    /// Commands executed in 100 ms.
    pace: usize,
    base: Option<KukaPose>,
    tool: Option<SetTcp>,
    base_from_flange: Rigid<Base, Flange>,
    arm: Arm,
    joints: Joints,
    outputs: BTreeMap<u16, bool>,
    water_off_ms: u64,
    rubbed: usize,
    healed: bool,
    /// The panel turns about its first corner once it is wet, by so much.
    turns_when_wet_deg: f64,
    waypoints: usize,
    reports: VecDeque<Report>,
    lines: usize,
    feeds_m_s: Vec<f64>,
    blends_mm: Vec<f64>,
    intent: Option<Motion>,
    moved_without_intent: usize,
}

/// The world, for the loop's thread and the one that computes.
#[derive(Clone)]
struct Shared(Arc<Mutex<World>>);

impl Shared {
    fn borrow(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn borrow_mut(&self) -> MutexGuard<'_, World> {
        self.borrow()
    }
}

/// Where the arm stands before a cycle.
const START: Joints =
    Joints { a1_deg: 0.0, a2_deg: -120.0, a3_deg: 145.0, a4_deg: 0.0, a5_deg: -25.0, a6_deg: 90.0 };

const CELL: &str = "[poses]\npark = { a1_deg = -120, a2_deg = -75, a3_deg = 110, a4_deg = 0, a5_deg = 55, a6_deg = 90 }\n\
     ready = { a1_deg = 0, a2_deg = -120, a3_deg = 145, a4_deg = 0, a5_deg = -25, a6_deg = 90 }\n\
     [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
     [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\nlight_on = 5\n";

/// A cell before its cycle.
pub struct Cell {
    world: Shared,
    box_to_mm: f64,
    fails_at: usize,
    is_full: bool,
    /// Tables at the end of the recipe.
    pub more_recipe: &'static str,
    /// Tables at the end of the cell's file.
    pub more_cell: &'static str,
    /// What the disc has worn before, mm².
    pub worn_mm2: f64,
}

/// What came of it.
pub struct Story {
    pub outcome: CycleOutcome,
    pub truth: Truth,
    pub findings: Vec<Finding>,
    pub figures: Vec<String>,
    pub budget: Budget,
    pub intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
    pub refusals: Vec<(Request, Refusal)>,
    pub contact_points: usize,
    pub lines: usize,
    /// Of the lines that bring a feed of their own: the feed, m/s, and the rounding, mm.
    pub feeds: Vec<(f64, f64)>,
    pub worn_mm2: f64,
    pub wears: Vec<(f64, bool)>,
    pub moved_without_intent: usize,
}

impl Story {
    /// The stages that found something.
    pub fn stages(&self) -> Vec<Kind> {
        self.findings.iter().map(|finding| finding.kind).collect()
    }

    /// The closed motions along this path.
    pub fn motions(&self, path: Path) -> Vec<(Motion, Outcome, u32)> {
        let closed = self.intents.iter().filter(|(motion, _)| motion.path == path);
        closed.filter_map(|(motion, end)| end.map(|(outcome, done)| (*motion, outcome, done))).collect()
    }
}

impl std::fmt::Display for Story {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{:?} {:?}", self.outcome.state.at, self.refusals)?;
        for event in self.events.iter().filter(|e| !matches!(e, Event::Told(crate::cycle::Report::Progress { .. })))
        {
            writeln!(f, "{event:?}")?;
        }
        for finding in &self.findings {
            writeln!(f, "{:?} {:?} {:?}", finding.kind, finding.judgement, finding.numbers)?;
        }
        Ok(())
    }
}

impl Cell {
    pub fn new(scene: Scene) -> Self {
        let sim = sim::Cell::new(3, scene, 4);
        let world = World {
            base_from_flange: Arm::kr6_r700_2().base_from_flange(&START),
            sim,
            time_ms: 0,
            epoch: 5,
            open: false,
            next_id: 1,
            done: 0,
            queue: VecDeque::new(),
            pace: 1_000,
            base: None,
            tool: None,
            joints: START,
            arm: Arm::kr6_r700_2(),
            outputs: BTreeMap::new(),
            water_off_ms: 0,
            rubbed: 0,
            healed: false,
            turns_when_wet_deg: 0.0,
            waypoints: 0,
            reports: VecDeque::new(),
            lines: 0,
            feeds_m_s: Vec::new(),
            blends_mm: Vec::new(),
            intent: None,
            moved_without_intent: 0,
        };
        let world = Shared(Arc::new(Mutex::new(world)));
        Cell {
            world,
            box_to_mm: 700.0,
            fails_at: usize::MAX,
            is_full: false,
            more_recipe: "",
            more_cell: "",
            worn_mm2: 0.0,
        }
    }

    pub fn with_box_to(self, x_mm: f64) -> Self {
        Cell { box_to_mm: x_mm, ..self }
    }

    /// Ten commands in 100 ms.
    pub fn slow(self) -> Self {
        self.world.borrow_mut().pace = 10;
        self
    }

    pub fn whose_panel_turns_when_wet(self, degrees: f64) -> Self {
        self.world.borrow_mut().turns_when_wet_deg = degrees;
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

    /// The cell's file, recipe, what was taught, and the calibrations.
    pub fn files(&self) -> (cell::Cell, Recipe, TaughtHere, Calibrations) {
        let (taught, recipe) = taught(&self.world.borrow().sim, self.more_recipe);
        let text = format!(
            "{CELL}[limits]\nbox_min_mm = [100, -450, 50]\nbox_max_mm = [{}, 450, 900]\nmax_tilt_deg = 60\n{}",
            self.box_to_mm, self.more_cell
        );
        let cell = cell::Cell::check("cell.toml", &text).unwrap_or_else(|e| panic!("{e}"));
        let calibrations = calibrations(&self.world.borrow().sim);
        (cell, recipe, taught, calibrations)
    }

    /// Serves until `asks` leaves; `eyes` may stand before the cell's own.
    pub fn serve<E: Eyes + Send + 'static>(
        &self,
        eyes: impl FnOnce(FakeEyes) -> E,
        readable: Vec<Reason>,
        asks: &mut dyn Requests,
    ) -> Memory {
        let mut record = Memory {
            fails_at: self.fails_at,
            is_full: self.is_full,
            worn_mm2: self.worn_mm2,
            ..Memory::default_of(&self.world)
        };
        let service = Service {
            robot: &mut FakeRobot(self.world.clone()),
            eyes: Box::new(eyes(FakeEyes(self.world.clone()))),
            readable: Box::new(move || readable.clone()),
            keep: Box::new(|_| {
                // Never on the loop, whose deadlines and watchdog would wait for it.
                assert_eq!(std::thread::current().name(), Some("computing"));
                Ok(String::new())
            }),
            record: &mut record,
            requests: asks,
        };
        let site = Site::new(&self.files().0).expect("complete");
        serve(site, service, []).unwrap_or_else(|error| panic!("{error}"));
        record
    }

    /// A cycle to begin.
    pub fn order(&self) -> Order {
        let (_, recipe, taught, calibrations) = self.files();
        let start = CycleStart {
            panel: "p".to_owned(),
            taught_version: String::new(),
            recipe_text: String::new(),
            file_texts: Vec::new(),
        };
        let request = Request::Start { max_passes: 2, max_moves: 3 };
        Order { request, task: Task::new(recipe, taught, calibrations).expect("a corner"), start }
    }

    fn tried(self, mut asks: Asks) -> Result<Story, DaemonError> {
        let (cell, recipe, taught, calibrations) = self.files();
        let job = Job::new(&cell, &recipe, (&taught.0, &taught.1), calibrations)?;
        let mut robot = FakeRobot(self.world.clone());
        let mut eyes = FakeEyes(self.world.clone());
        let (fails_at, worn_mm2) = (self.fails_at, self.worn_mm2);
        let mut record = Memory { fails_at, worn_mm2, ..Memory::default_of(&self.world) };
        let ports = Ports { robot: &mut robot, eyes: &mut eyes, record: &mut record, requests: &mut asks };
        let outcome = run_cycle(&job, ports, [])?;
        let world = self.world.borrow();
        Ok(Story {
            outcome,
            truth: world.sim.truth(),
            findings: record.findings,
            figures: record.figures,
            budget: record.budget,
            intents: record.intents,
            events: record.events,
            refusals: asks.refusals,
            contact_points: world.waypoints,
            lines: world.lines,
            feeds: world.feeds_m_s.iter().copied().zip(world.blends_mm.iter().copied()).collect(),
            worn_mm2: record.worn_mm2,
            wears: record.wears,
            moved_without_intent: world.moved_without_intent,
        })
    }
}

type TaughtHere = (TaughtPanel, Vec<TaughtCorner>);

fn taught(sim: &sim::Cell, more_recipe: &str) -> (TaughtHere, Recipe) {
    let region = sim.region();
    let text = format!(
        "panel = \"p\"\n[process]\nobservation_s = 40.0\nframes_per_second = 0.5\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\nsettled_mm = 0.1\n\
         [region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n[locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n\
         {more_recipe}",
        region.corners_px.map(|px| [px.u, px.v]),
        region.rows,
        region.columns,
        SEARCH_BOX_MM[0],
        SEARCH_BOX_MM[1]
    );
    let recipe = Recipe::check("simulated.toml", &text).unwrap_or_else(|e| panic!("{e}"));
    let base_from_camera = sim.calibrated_base_from_camera();
    let panel = TaughtPanel::learn(&sim.taught_scan(), *sim.scanner(), base_from_camera, &recipe).expect("a panel");
    let camera = sim.flange_camera();
    let teach = |(index, view): (usize, sim::CornerView)| {
        let picture = sim.flange_picture(&view.base_from_flange, Place::Nominal).to_gray();
        let panel_from_camera =
            panel_from_base_at_teaching() * view.base_from_flange * sim.calibrated_flange_from_camera();
        let depth_mm = (panel_from_camera.inverse() * view.corner).mm.z;
        let (settings, px_per_mm) = (recipe.corner(), camera.px_per_mm_at(depth_mm).0);
        let found = crate::locate::corner::find(&picture, settings, settings.which().of(index), px_per_mm);
        let teaching = CornerTeaching { reference_px: found.expect("a corner").corner_px, panel_from_camera };
        panel.corner(teaching, camera).expect("on the panel")
    };
    let corners = sim.corner_views().into_iter().enumerate().map(teach).collect();
    ((panel, corners), recipe)
}

fn calibrations(sim: &sim::Cell) -> Calibrations {
    Calibrations {
        scanner: *sim.scanner(),
        base_from_camera: sim.calibrated_base_from_camera(),
        flange_camera: *sim.flange_camera(),
        flange_from_camera: sim.calibrated_flange_from_camera(),
        flange_from_tool: KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid(),
        hand_eye_mm: None,
        robot_mm: None,
    }
}

impl World {
    fn queue(&mut self, command: Command) -> Result<CommandId, QueueError> {
        if !self.open {
            return Err(QueueError::NoEpoch);
        }
        let id = self.next_id;
        self.next_id += 1;
        self.queue.push_back((id, command));
        Ok(CommandId(id))
    }

    fn execute(&mut self, command: Command) {
        let moves = matches!(command, Command::MoveJ(_) | Command::MoveLin(_));
        self.moved_without_intent += usize::from(moves && self.intent.is_none());
        match command {
            Command::SetBase(base) => self.base = Some(base),
            Command::SetTcp(tool) => self.tool = Some(tool),
            Command::SetDigout(signal) => {
                if signal.number == 2 && !signal.on && self.outputs.get(&2) == Some(&true) {
                    self.water_off_ms = self.time_ms;
                    self.healed = self.rubbed > 0;
                }
                self.outputs.insert(signal.number, signal.on);
            }
            Command::MoveJ(target) => {
                self.joints = target.joints;
                self.base_from_flange = self.arm.base_from_flange(&target.joints);
            }
            Command::MoveLin(MoveLin { pose, contact, speed_m_s, blend_mm }) => {
                let (base, tool) = (self.base.expect("set"), self.tool.expect("set"));
                let base_from_tool = base.to_rigid::<Base, Panel>() * pose.to_rigid::<Panel, Tool>();
                self.base_from_flange = base_from_tool * tool.flange_from_tool.to_rigid::<Flange, Tool>().inverse();
                self.joints = self.arm.nearest(&self.base_from_flange, &self.joints).expect("within reach");
                self.lines += 1;
                self.feeds_m_s.extend(speed_m_s);
                self.blends_mm.extend(speed_m_s.map(|_| blend_mm));
                if self.outputs.get(&5) == Some(&true) {
                    self.waypoints += 1;
                    self.rubbed += usize::from(contact);
                }
            }
            _ => {}
        }
    }

    fn state(&self) -> eki::State {
        let is_on = |output: u16| u32::from(self.outputs.get(&output) == Some(&true));
        let base = self.base.unwrap_or_default();
        let flange_from_tool = self.tool.map_or(KukaPose::default(), |tool| tool.flange_from_tool);
        let tip = base.to_rigid::<Base, Panel>().inverse()
            * (self.base_from_flange * flange_from_tool.to_rigid::<Flange, Tool>());
        eki::State {
            time_ms: self.time_ms as u32,
            sequence: 0,
            answered: 0,
            epoch: Epoch(self.epoch),
            boot: 1,
            programs_checksum: 1,
            mode: Mode::External,
            drives_on: true,
            emergency_stop: false,
            guard_closed: true,
            moving: !self.queue.is_empty(),
            motion_possible: true,
            base_set: self.base.is_some(),
            tool_set: self.tool.is_some(),
            stopped: false,
            inputs: (1 - is_on(2)) | is_on(3) << 1 | is_on(4) << 2 | is_on(5) << 3 | is_on(1) << 4,
            outputs: 0,
            done: CommandId(self.done),
            underruns: 0,
            joints: self.joints,
            base_from_tcp: KukaPose::from_rigid(&tip),
            active_base: base,
            flange_from_tool,
        }
    }

    fn end_epoch(&mut self) -> u32 {
        let done = self.done;
        (self.open, self.done, self.next_id) = (false, 0, 1);
        (self.base, self.tool) = (None, None);
        self.queue.clear();
        self.outputs.insert(5, false);
        self.epoch += 1;
        done
    }
}

struct FakeRobot(Shared);

impl Robot for FakeRobot {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        self.0.borrow_mut().queue(command)
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        let mut world = self.0.borrow_mut();
        points.into_iter().try_fold(CommandId(0), |_, point| world.queue(Command::MoveLin(point)))
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        let mut world = self.0.borrow_mut();
        world.end_epoch();
        world.epoch = world.epoch.max(above.0 + 1);
        world.open = true;
        let epoch = Epoch(world.epoch);
        world.reports.push_back(Report::EpochOpened { epoch });
        Ok(epoch)
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        let mut world = self.0.borrow_mut();
        let done = CommandId(world.end_epoch());
        world.reports.push_back(Report::Standstill { done });
        Ok(())
    }

    fn next(&mut self) -> Option<Report> {
        let mut world = self.0.borrow_mut();
        if let Some(report) = world.reports.pop_front() {
            return Some(report);
        }
        world.time_ms += 100;
        let before = world.done;
        for _ in 0..world.pace {
            let Some((id, command)) = world.queue.pop_front() else { break };
            world.execute(command);
            world.done = id;
        }
        if world.done > before {
            let done = CommandId(world.done);
            world.reports.push_back(Report::Progress { done });
        }
        let state = Report::State(Box::new(world.state()));
        world.reports.push_back(state);
        world.reports.pop_front()
    }

    fn now(&self) -> Time {
        Time::at_ms(self.0.borrow().time_ms)
    }

    fn is_lock_step(&self) -> bool {
        true
    }
}

pub struct FakeEyes(Shared);

impl Eyes for FakeEyes {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        assert!(self.0.borrow().outputs.get(&1) != Some(&true), "the light is off");
        Ok(self.0.borrow().sim.scan())
    }

    fn picture(&mut self) -> Result<ColorPicture, SightError> {
        let world = self.0.borrow();
        assert_eq!(world.outputs.get(&1), Some(&true), "the light is on");
        let spots = if world.healed { Vec::new() } else { world.sim.spots().to_vec() };
        let film_s = match world.water_off_ms {
            0 => 0.0,
            off_ms => WET_FROM_S + (world.time_ms - off_ms) as f64 / 1_000.0,
        };
        Ok(world.sim.film_of(&spots).picture(film_s))
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        let world = self.0.borrow();
        let stands = world.sim.truth().base_from_panel;
        let turn_deg = if world.water_off_ms > 0 { world.turns_when_wet_deg } else { 0.0 };
        let about = (stands * world.sim.corner_views()[0].corner).mm;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * turn_deg.to_radians());
        let turned: Rigid<Base, Base> =
            Rigid::claim(Isometry3::from_parts((about.coords - turn * about.coords).into(), turn));
        Ok(world.sim.flange_picture_at(&world.base_from_flange, &(turned * stands)))
    }

    fn check(&mut self) -> Vec<SightError> {
        Vec::new()
    }
}

pub struct Memory {
    world: Shared,
    fails_at: usize,
    writes: usize,
    cycles: i64,
    is_full: bool,
    pub worn_mm2: f64,
    /// Each entry of the disc's wear, and whether a motion was open then.
    pub wears: Vec<(f64, bool)>,
    pub findings: Vec<Finding>,
    figures: Vec<String>,
    budget: Budget,
    intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
}

impl Memory {
    fn default_of(world: &Shared) -> Self {
        Memory {
            world: world.clone(),
            fails_at: 0,
            writes: 0,
            cycles: 0,
            is_full: false,
            worn_mm2: 0.0,
            wears: Vec::new(),
            findings: Vec::new(),
            figures: Vec::new(),
            budget: Budget::default(),
            intents: Vec::new(),
            events: Vec::new(),
        }
    }

    fn written(&mut self) -> Result<(), RecordError> {
        self.writes += 1;
        if self.writes >= self.fails_at { Err(RecordError("the disk is full".into())) } else { Ok(()) }
    }
}

impl Record for Memory {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        self.findings.push(finding.clone());
        self.written()
    }

    fn picture(&mut self, _: &str, _: &ColorPicture) -> Result<(), RecordError> {
        self.written()
    }

    fn frame(&mut self, _: &Arc<ColorPicture>, _: f64, _: Phase) -> Result<(), RecordError> {
        self.written()
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        self.figures.push(figure.name.clone());
        self.written()
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.budget = self.budget.renewed(*measured);
        self.written()
    }
}

impl Journal for Memory {
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError> {
        if let Kept::Figure(figure) = kept {
            self.figures.push(figure.name);
        }
        self.written()
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.events.push(*event);
        self.written()
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        let mut world = self.world.borrow_mut();
        assert!(world.open && motion.epoch == world.epoch);
        world.intent = Some(*motion);
        drop(world);
        self.intents.push((*motion, None));
        self.written()
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        self.world.borrow_mut().intent = None;
        let open = self.intents.last_mut().expect("open");
        assert_eq!((open.0, open.1), (*motion, None));
        open.1 = Some((outcome, done));
        self.written()
    }

    fn conclude(&mut self, _: Verdict) -> Result<(), RecordError> {
        self.written()
    }

    fn begin(&mut self, _: &CycleStart) -> Result<CycleId, RecordError> {
        self.cycles += 1;
        // Another panel, dry and as greasy as the last one.
        let mut world = self.world.borrow_mut();
        (world.water_off_ms, world.rubbed, world.healed) = (0, 0, false);
        drop(world);
        self.written().map(|()| CycleId(self.cycles))
    }

    fn between_cycles(&mut self) {}

    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        Ok(self.worn_mm2)
    }

    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError> {
        self.worn_mm2 += swept_mm2;
        self.wears.push((swept_mm2, self.world.borrow().intent.is_some()));
        self.written()
    }

    fn mount_disc(&mut self) -> Result<(), RecordError> {
        self.worn_mm2 = 0.0;
        self.written()
    }

    fn check(&mut self) -> Vec<Reason> {
        if self.is_full { vec![Reason::new("disk_full", "no room")] } else { vec![] }
    }
}

type When = Box<dyn Fn(&State) -> bool>;

/// Somebody who asks each thing once, in order, when its time has come, and leaves where nothing more can happen.
pub struct Asks {
    script: VecDeque<(When, Request)>,
    refusals: Vec<(Request, Refusal)>,
}

impl Asks {
    pub fn one_cycle() -> Self {
        let asks = Asks { script: VecDeque::new(), refusals: Vec::new() };
        let ready = |state: &State| state.facts.robot == crate::cycle::Robot::Ready;
        asks.with(ready, Request::Reset)
            .with(|state| state.at == At::Idle, Request::Start { max_passes: 2, max_moves: 3 })
    }

    pub fn with(mut self, when: impl Fn(&State) -> bool + 'static, request: Request) -> Self {
        self.script.push_back((Box::new(when), request));
        self
    }
}

impl Requests for Asks {
    fn next(&mut self, state: &State) -> Ask {
        if let Some((_, request)) = self.script.pop_front_if(|(when, _)| when(state)) {
            return Ask::For(request);
        }
        match state.at {
            At::Complete { .. } | At::Aborted { .. } => Ask::Leave,
            At::Held(_) | At::Stopped if self.script.is_empty() => Ask::Leave,
            _ => Ask::Nothing,
        }
    }

    fn refused(&mut self, request: Request, refusal: Refusal) {
        self.refusals.push((request, refusal));
    }
}
