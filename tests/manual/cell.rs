//! A cell whose devices are used only over their real interfaces. The controller is connected by EthernetKRL and
//! executes its own programs. The camera on the flange uses GigE Vision over the loopback interface, and the scanner
//! uses the tests' Zivid library, which emulates a camera. The pictures of both are rendered by `scenery`.

use super::scenery::{CellContents, Flicker, REDUCTION, SEED, Scenery};
use panelprep::cell;
use panelprep::devices::gige::{LoopbackCamera, PixelFormat, mosaic};
use panelprep::devices::mock::{
    ChannelFile, Clock, ContactSample, Controller, MockHandle, MockServer, Ports, Programs, Setup, World,
};
use panelprep::devices::world::{SimulatedWorld, Violation};
use panelprep::eki::{CELLCMD, CELLSTAT};
use panelprep::geometry::{Base, Flange, Joints, Point, Rigid, Tool};
use panelprep::path::{Kinematics, reach};
use panelprep::sim::{self, CellTruth, Scene, TOOL_LENGTH_MM};
use std::net::{IpAddr, Ipv4Addr};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc as Shared;
use std::sync::atomic::{AtomicUsize, Ordering};

pub const SERIAL: &str = "MANUAL1";
pub const PORTS: [u16; 2] = [54_604, 54_605];
/// The terminals of the controller: every world receives the switched outputs, and the world with the panel sets the
/// inputs.
struct Wired {
    terminals: Vec<Box<dyn World>>,
    answers: Shared<AtomicUsize>,
}

impl World for Wired {
    fn on_output(&mut self, number: u16, value: bool, time_ms: u64) {
        self.terminals.iter_mut().for_each(|world| world.on_output(number, value, time_ms));
    }

    fn input(&self, number: u16, time_ms: u64) -> Option<bool> {
        self.terminals[self.answers.load(Ordering::SeqCst)].input(number, time_ms)
    }
}

/// The cell.
pub struct Cell {
    scenery: Shared<Scenery>,
    answers: Shared<AtomicUsize>,
    server: Option<MockServer>,
    _flange_camera: LoopbackCamera,
    feed: PathBuf,
}

impl Cell {
    /// Starts the cameras of the cell; if this machine cannot run them, returns the reason.
    pub fn new(folder: &Path) -> Result<Self, String> {
        let scenery = Shared::new(Scenery::new());
        let camera = scenery.boards.flange_camera();
        let sees = scenery.clone();
        let fill = move |_: u64, pixels: &mut [u8]| {
            let raw = mosaic(&sees.flange_picture(), PixelFormat::BayerRG8);
            let mut flicker = Flicker(sees.number());
            pixels.iter_mut().zip(raw).for_each(|(pixel, gray)| *pixel = flicker.apply(gray));
        };
        let size_px = [camera.width_px, camera.height_px];
        let flange_camera = LoopbackCamera::start(SERIAL, size_px, PixelFormat::BayerRG8, Box::new(fill))
            .map_err(|error| error.to_string())?;
        let feed = folder.join("scene.sock");
        let listener = UnixListener::bind(&feed).map_err(|error| error.to_string())?;
        let sees = scenery.clone();
        std::thread::spawn(move || listener.incoming().flatten().for_each(|asked| sees.answer(asked)));
        let answers = Shared::new(AtomicUsize::new(0));
        Ok(Cell { scenery, answers, server: None, _flange_camera: flange_camera, feed })
    }

    /// Returns the file that describes the emulated Zivid camera.
    pub fn zivid(&self) -> String {
        let camera = self.scenery.boards.scanner();
        let (width, height) = (camera.width_px, camera.height_px);
        format!("serial ZIVID1\nwidth {width}\nheight {height}\nfeed {}\n", self.feed.display())
    }

    /// Starts the controller with the inputs and outputs of the cell's file.
    pub fn start_controller(&mut self, cell: &cell::Cell) {
        let greasy = self.scenery.nominal.clone();
        let clean = sim::Cell::new(SEED, Scene::Clean, REDUCTION).with_pose(1);
        let worlds = [greasy, clean].map(|cell_now| SimulatedWorld::new(cell_now, cell).expect("all is named"));
        worlds.iter().for_each(|world| world.mount_disc(30.0));
        let channel = |text| ChannelFile::parse(text).expect("as it ships");
        let setup = worlds[0].mock_setup(cell, channel(CELLCMD), channel(CELLSTAT));
        let programs = Some(Programs::shipped().expect("as they ship"));
        let wired = Wired {
            terminals: worlds.iter().map(SimulatedWorld::terminals).collect(),
            answers: self.answers.clone(),
        };
        let setup = Setup { clock: Clock::Free, programs, ..setup };
        let mut controller = Controller::new(setup, Box::new(wired)).expect("a controller");
        controller.boot();
        let [command, state] = PORTS;
        let ports = Ports { host: IpAddr::V4(Ipv4Addr::LOCALHOST), command, state };
        let server = MockServer::start(controller, ports).expect("its ports are free");
        assert!(self.scenery.arm.set((server.handle(), worlds)).is_ok(), "once");
        self.server = Some(server);
    }

    /// Changes the contents of the cell, as a person does.
    pub fn put(&self, stands: CellContents) {
        *self.scenery.stands.lock().expect("no thread failed") = stands;
        let CellContents::Panel(number) = stands else { return };
        self.answers.store(number, Ordering::SeqCst);
        if let Some((_, worlds)) = self.scenery.arm.get() {
            worlds[number].dry_panel();
        }
    }

    fn handle(&self) -> &MockHandle {
        &self.scenery.arm.get().expect("the controller runs").0
    }

    /// Jogs the arm so that the flange is at this pose, as a person does.
    pub fn jog(&self, base_from_flange: &Rigid<Base, Flange>) {
        let joints =
            joints_at(base_from_flange).unwrap_or_else(|| panic!("the arm comes there: {base_from_flange:?}"));
        assert!(self.handle().with_controller(|arm| arm.jog_to(joints)), "the arm stands");
    }

    /// Jogs the arm to a pose for the first picture of the calibration board, as a person does.
    pub fn jog_to_board(&self) {
        let boards = &self.scenery.boards;
        let flanges: Vec<Rigid<Base, Flange>> = match self.scenery.contents() {
            CellContents::BoardOnFlange => {
                boards.fixed_shots(20).iter().map(|shot| shot.base_from_flange).collect()
            }
            _ => boards.flange_shots(20).iter().map(|shot| shot.base_from_flange).collect(),
        };
        let joints = flanges.iter().find_map(joints_at).expect("one of twenty poses is within reach");
        assert!(self.handle().with_controller(|arm| arm.jog_to(joints)), "the arm stands");
    }

    /// Jogs the camera on the flange to the taught corner, as a person does.
    pub fn jog_to_corner(&self, index: usize) {
        self.jog(&self.scenery.nominal.corner_views()[index].base_from_flange);
    }

    /// Returns the pose from which the camera views the verification board.
    pub fn verify_pose(&self) -> Joints {
        joints_at(&self.scenery.nominal.flange_target().base_from_flange).expect("within reach")
    }

    /// Touches an inner corner of the verification board with the tool's tip, as a person does.
    pub fn touch_corner(&self, column: usize, row: usize) {
        let board = self.scenery.targets.print();
        let corner = board.corners()[row * 5 + column];
        self.jog(&flange_for_tip_at(self.scenery.base_from_targets[0] * corner, [0.0; 3], TOOL_LENGTH_MM));
    }

    /// Moves the tip, or a mark behind the tip, to the spot, as a person does.
    pub fn hold_tip(&self, number: usize, is_mark: bool) {
        const TURNS_DEG: [[f64; 3]; 6] = [
            [0.0, 0.0, 0.0],
            [30.0, 0.0, 20.0],
            [-30.0, 10.0, 0.0],
            [0.0, 35.0, -40.0],
            [10.0, -35.0, 60.0],
            [-20.0, -20.0, -60.0],
        ];
        let out_mm = if is_mark { TOOL_LENGTH_MM - 60.0 } else { TOOL_LENGTH_MM };
        self.jog(&flange_for_tip_at(Point::at(520.0, 30.0, 250.0), TURNS_DEG[number % 6], out_mm));
    }

    /// Returns the corners of the region in the picture of the taught scan, and its rows and columns, as a person draws
    /// them.
    pub fn region(&self) -> sim::Region {
        self.scenery.nominal.region()
    }

    /// Returns the ground truth of the greasy panel, the executed motions, and the number of its remaining greasy
    /// spots.
    pub fn greasy_panel_state(&self) -> (CellTruth, Vec<ContactSample>, usize) {
        let (handle, worlds) = self.scenery.arm.get().expect("the controller runs");
        let trace = handle.with_controller(|arm| arm.trace().to_vec());
        (worlds[0].truth().clone(), trace, worlds[0].greasy_spots().len())
    }

    /// Returns the forbidden actions that occurred. When a scanner is opened, it takes a first shot with any light on;
    /// this shot is not used.
    pub fn violations(&self) -> String {
        let (_, worlds) = self.scenery.arm.get().expect("the controller runs");
        let all = worlds.iter().flat_map(SimulatedWorld::violations);
        all.filter(|(_, wrong)| *wrong != Violation::LightDuring3d).map(|wrong| format!("{wrong:?} ")).collect()
    }
}

/// Returns axis positions that bring the flange to this pose.
fn joints_at(base_from_flange: &Rigid<Base, Flange>) -> Option<Joints> {
    let arm = Kinematics::new(cell::Cell::check("", "").expect("an arm").arm());
    reach::postures(&arm, base_from_flange, Point::at(0.0, 0.0, 0.0)).into_iter().next()
}

/// Returns the pose of the flange at which a tool of this length has its tip at a point, with the tool's axis rotated
/// from straight down.
fn flange_for_tip_at(place: Point<Base>, turn_deg: [f64; 3], out_mm: f64) -> Rigid<Base, Flange> {
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    let down = UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(f64::to_radians)));
    let tip: Rigid<Base, Tool> =
        Rigid::from_isometry_unchecked(Isometry3::from_parts(place.mm.coords.into(), turn * down));
    let flange_from_tool: Rigid<Flange, Tool> =
        Rigid::from_isometry_unchecked(Isometry3::translation(0.0, 0.0, out_mm));
    tip * flange_from_tool.inverse()
}
