//! The true state of the scripted cell, which its simulated parts share; the cameras that render it; the calibrations
//! of the cell, and its taught data.

use crate::daemon::*;
use crate::setup::{Calibrations, CellSetup, CycleSetup};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, ColorPicture, Flange, Joints, KukaPose, Rigid};
use panelprep_cell::cell;
use panelprep_cell::cell::LensExtent;
use panelprep_cell::cycle::Motion;
use panelprep_cell::panel::{CornerTeaching, TaughtCorner, TaughtPanel, panel_from_base_at_teaching};
use panelprep_cell::recipe::Recipe;
use panelprep_devices::acf::ToolFault;
use panelprep_devices::mock::Arm;
use panelprep_kuka::eki::{Command, Report, SetTcp};
use panelprep_sim as sim;
use panelprep_sim::{PanelPosition, SEARCH_BOX_MM, WET_FROM_S};
use panelprep_toolpath::removal::model::Model;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The position of the arm before a cycle.
const START: Joints =
    Joints { a1_deg: 0.0, a2_deg: -120.0, a3_deg: 145.0, a4_deg: 0.0, a5_deg: -25.0, a6_deg: 90.0 };

/// The true state of the cell.
#[derive(Clone)]
pub(super) struct World {
    /// The injected fault of the tool, and the number of executed lines of the contact path after which it occurs.
    pub(super) tool_fault: Option<(u32, ToolFault)>,
    /// The time since which the disc has been rubbing continuously while the tool has its injected fault, ms.
    pub(super) rubs_since_ms: Option<u64>,
    /// The time at which the end of an epoch switched the tool off, ms.
    pub(super) tool_off_ms: Option<u64>,
    /// Whether the last executed line ends on the panel.
    pub(super) rubs: bool,

    pub(super) sim: sim::Cell,
    pub(super) time_ms: u64,
    pub(super) epoch: u32,
    pub(super) open: bool,
    pub(super) next_id: u32,
    pub(super) done: u32,
    pub(super) queue: VecDeque<(u32, Command)>,
    /// The number of the last command that may be executed.
    pub(super) let_go: Option<u32>,
    /// Number of waypoints of the contact path that the record permits. `in_contact` counts the executed ones, and
    /// `beyond` those executed without permission.
    pub(super) permitted: u32,
    pub(super) in_contact: u32,
    /// Whether the connection is lost when the arm is clearly in contact.
    pub(super) loses_link: bool,
    /// The bit of a feedback that is off, and the waypoint in contact from which it is off.
    pub(super) dead_feedback: Option<(u32, u32)>,
    /// Whether no controller answers until the next state is received.
    pub(super) is_lost: bool,
    pub(super) beyond: u32,
    /// Number of commands executed in 100 ms.
    pub(super) pace: usize,
    /// Time between two states of the robot on a contact path, ms; elsewhere it is 100.
    pub(super) contact_round_ms: u64,
    /// Time for which the arm still moves after an abort, ms; `brakes_until_ms` is the time at which it stops.
    pub(super) brakes_ms: u64,
    pub(super) brakes_until_ms: u64,
    /// The deviation of the reported TCP on a contact path, mm, and the first and last waypoint at which it occurs.
    pub(super) off_plan: Option<(f64, [u32; 2])>,
    pub(super) base: Option<KukaPose>,
    /// Each base that was set, in order.
    pub(super) bases: Vec<KukaPose>,
    pub(super) tool: Option<SetTcp>,
    pub(super) base_from_flange: Rigid<Base, Flange>,
    pub(super) arm: Arm,
    pub(super) joints: Joints,
    pub(super) outputs: BTreeMap<u16, bool>,
    pub(super) water_off_ms: u64,
    pub(super) rubbed: usize,
    pub(super) healed: bool,
    /// Whether sanding removes no grease.
    pub(super) stays_greasy: bool,
    /// The angle by which the panel rotates about its first corner when it is wet, degrees.
    pub(super) turns_when_wet_deg: f64,
    pub(super) waypoints: usize,
    pub(super) reports: VecDeque<Report>,
    pub(super) lines: usize,
    pub(super) feeds_m_s: Vec<f64>,
    pub(super) blends_mm: Vec<f64>,
    pub(super) intent: Option<Motion>,
    pub(super) moved_without_intent: usize,
    /// The times at which output 6 was set, with its values, ms. The next field contains the time at which the arm
    /// first moved.
    pub(super) warning_ms: Vec<(u64, bool)>,
    pub(super) first_move_ms: Option<u64>,
    /// Distance of each contact point in front of the true panel, mm.
    pub(super) contact_off_mm: Vec<f64>,
    /// The state of input 6, the selector switch.
    pub(super) is_local: bool,
    /// The boot ID that the controller reports.
    pub(super) boot: i32,
    /// Whether a directly sent stop has ended the epoch before the next command arrived.
    pub(super) is_overtaken: bool,
    /// Number of commands that arrived when no epoch was open.
    pub(super) unsent: u32,
    pub(super) films_began_s: Vec<f64>,
}

impl World {
    /// Creates the world before a cycle: the arm is at [`START`], and all outputs are off.
    pub(super) fn new(sim: sim::Cell) -> Self {
        World {
            tool_fault: None,
            rubs_since_ms: None,
            tool_off_ms: None,
            rubs: false,
            base_from_flange: Arm::kr6_r700_2().base_from_flange(&START),
            sim,
            time_ms: 0,
            epoch: 5,
            open: false,
            next_id: 1,
            done: 0,
            queue: VecDeque::new(),
            let_go: None,
            permitted: 0,
            in_contact: 0,
            loses_link: false,
            dead_feedback: None,
            is_lost: false,
            beyond: 0,
            pace: 1_000,
            contact_round_ms: 100,
            brakes_ms: 0,
            brakes_until_ms: 0,
            off_plan: None,
            base: None,
            bases: Vec::new(),
            tool: None,
            joints: START,
            arm: Arm::kr6_r700_2(),
            outputs: BTreeMap::new(),
            water_off_ms: 0,
            rubbed: 0,
            healed: false,
            stays_greasy: false,
            turns_when_wet_deg: 0.0,
            waypoints: 0,
            reports: VecDeque::new(),
            lines: 0,
            feeds_m_s: Vec::new(),
            blends_mm: Vec::new(),
            intent: None,
            moved_without_intent: 0,
            warning_ms: Vec::new(),
            first_move_ms: None,
            contact_off_mm: Vec::new(),
            is_local: true,
            boot: 1,
            is_overtaken: false,
            unsent: 0,
            films_began_s: Vec::new(),
        }
    }
}

/// The simulated world, shared by the thread of the loop and the computing thread.
#[derive(Clone)]
pub(super) struct Shared(Arc<Mutex<World>>);

impl Shared {
    pub(super) fn new(world: World) -> Self {
        Shared(Arc::new(Mutex::new(world)))
    }

    pub(super) fn borrow(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn borrow_mut(&self) -> MutexGuard<'_, World> {
        self.borrow()
    }
}

pub struct FakeCameras {
    world: Shared,
    /// The time at which the film began, its picture rate, and the number of captured pictures.
    film: Option<(u64, f64, u32)>,
}

impl FakeCameras {
    pub(super) fn new(world: Shared) -> Self {
        FakeCameras { world, film: None }
    }
}

impl Port<CameraCommand> for FakeCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        Ok(match command {
            CameraCommand::Scan => {
                let world = self.world.borrow();
                assert!(world.outputs.get(&1) != Some(&true), "the light is off");
                CameraAnswer::Scan(world.sim.scan())
            }
            CameraCommand::Picture => CameraAnswer::Picture(self.rendered()),
            CameraCommand::BeginFilm(pictures_per_second) => {
                let now_ms = self.world.borrow().time_ms;
                self.film = Some((now_ms, pictures_per_second, 0));
                self.world.borrow_mut().films_began_s.push(now_ms as f64 / 1e3);
                CameraAnswer::FilmBegan(now_ms as f64 / 1e3)
            }
            CameraCommand::NextOfFilm => {
                self.rendered_of_film().map_or(CameraAnswer::NoneDue, CameraAnswer::Picture)
            }
            CameraCommand::EndFilm => {
                self.film.take().expect("begun");
                CameraAnswer::FilmEnded(0)
            }
            CameraCommand::CornerPicture => CameraAnswer::Corner(self.rendered_corner()),
            CameraCommand::Check => CameraAnswer::Checked(vec![]),
        })
    }
}

impl FakeCameras {
    fn rendered_of_film(&mut self) -> Option<Picture2d> {
        let (began_ms, pictures_per_second, taken) = self.film.as_mut().expect("begun");
        let since_s = (self.world.borrow().time_ms - *began_ms) as f64 / 1e3;
        if since_s * *pictures_per_second < f64::from(*taken) {
            return None;
        }
        *taken += 1;
        Some(self.rendered())
    }

    fn rendered(&self) -> Picture2d {
        let world = self.world.borrow();
        assert_eq!(world.outputs.get(&1), Some(&true), "the light is on");
        let spots = if world.healed && !world.stays_greasy { Vec::new() } else { world.sim.spots().to_vec() };
        let film_s = match world.water_off_ms {
            0 => 0.0,
            off_ms => WET_FROM_S + (world.time_ms - off_ms) as f64 / 1_000.0,
        };
        let picture = world.sim.film_with_spots(&spots).picture(film_s);
        Picture2d { picture, time_s: world.time_ms as f64 / 1e3 }
    }

    fn rendered_corner(&self) -> ColorPicture {
        let world = self.world.borrow();
        let stands = world.sim.truth().base_from_panel;
        let turn_deg = if world.water_off_ms > 0 { world.turns_when_wet_deg } else { 0.0 };
        let about = (stands * world.sim.corner_views()[0].corner).mm;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::x() * turn_deg.to_radians());
        let turned: Rigid<Base, Base> = Rigid::from_isometry_unchecked(Isometry3::from_parts(
            (about.coords - turn * about.coords).into(),
            turn,
        ));
        world.sim.flange_picture_at(&world.base_from_flange, &(turned * stands))
    }
}

pub type TaughtHere = (TaughtPanel, Vec<TaughtCorner>);

/// Returns the data of a cycle of this cell.
pub fn setup(cell: &cell::Cell, recipe: &Recipe, taught: &TaughtHere, calibrations: Calibrations) -> CycleSetup {
    let cell = Arc::new(CellSetup::new(cell).expect("complete"));
    CycleSetup::new(cell, recipe.clone(), taught.clone(), (calibrations, LensExtent::default())).expect("a corner")
}

pub(super) fn taught(sim: &sim::Cell, (more_recipe, grids): (&str, Option<[usize; 2]>)) -> (TaughtHere, Recipe) {
    let region = sim.region();
    let [rows, columns] = grids.unwrap_or([region.rows, region.columns]);
    let text = format!(
        "panel = \"p\"\n[process]\nobservation_s = 40.0\nframes_per_second = 0.5\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\nsettled_mm = 0.1\n\
         [region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n[locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n\
         [inspect]\nmin_break_mm2 = 75.0 # a quarter of the pixels each way shows no smaller break surely\n{more_recipe}",
        region.corners_px.map(|px| [px.u, px.v]),
        rows,
        columns,
        SEARCH_BOX_MM[0],
        SEARCH_BOX_MM[1]
    );
    let recipe = Recipe::check("simulated.toml", &text).unwrap_or_else(|e| panic!("{e}"));
    let base_from_camera = sim.calibrated_base_from_camera();
    let panel = TaughtPanel::learn(&sim.taught_scan(), *sim.scanner(), base_from_camera, &recipe).expect("a panel");
    let camera = sim.flange_camera();
    let teach = |(index, view): (usize, sim::CornerView)| {
        let picture = sim.flange_picture(&view.base_from_flange, PanelPosition::Nominal).to_gray();
        let base_from_camera = view.base_from_flange * sim.calibrated_flange_from_camera();
        let panel_from_camera = panel.nominal_pose.inverse() * base_from_camera;
        // In the simulator, the panel frame is the base at the nominal pose, whatever the recipe states.
        let corner = panel_from_base_at_teaching().inverse() * view.corner;
        let depth_mm = (base_from_camera.inverse() * corner).mm.z;
        let (settings, px_per_mm) = (recipe.corner(), camera.px_per_mm_at(depth_mm).0);
        let found = panelprep_vision::locate::corner::find(
            &picture,
            settings,
            settings.which().for_picture(index),
            px_per_mm,
        );
        let teaching = CornerTeaching { reference_px: found.expect("a corner").corner_px, panel_from_camera };
        panel.corner(teaching, camera).expect("on the panel")
    };
    let corners = sim.corner_views().into_iter().enumerate().map(teach).collect();
    ((panel, corners), recipe)
}

pub(super) fn calibrations(sim: &sim::Cell, removal: Option<Model>) -> Calibrations {
    Calibrations {
        scan_errors: panelprep_vision::locate::ScanErrors::default(),
        scanner: *sim.scanner(),
        base_from_camera: sim.calibrated_base_from_camera(),
        flange_camera: *sim.flange_camera(),
        flange_from_camera: sim.calibrated_flange_from_camera(),
        flange_from_tool: KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid(),
        hand_eye_mm: None,
        robot_mm: None,
        removal,
    }
}
