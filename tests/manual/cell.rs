//! A cell whose devices are reached over their real interfaces alone: the controller by EthernetKRL, executing its own programs, the
//! camera on the flange by GigE Vision over the loopback interface, the scanner by the played Zivid library. What they show is
//! rendered here, from where the arm stands.

use panelprep::cell;
use panelprep::devices::cameras::{Arm, FlangeCamera as _, Scanner as _, simulated};
use panelprep::devices::gige::{LoopbackCamera, PixelFormat, mosaic};
use panelprep::devices::mock::{
    ChannelFile, Clock, Controller, MockHandle, MockServer, Ports, Programs, Sample, Setup, World,
};
use panelprep::devices::world::{SimulatedWorld, Violation};
use panelprep::eki::{CELLCMD, CELLSTAT};
use panelprep::geometry::{
    Base, Board, Camera, ColorPicture, Flange, FlangeCamera, GrayPicture, Joints, OrganizedCloud, Point, Rigid,
    Tool,
};
use panelprep::path::{Kinematics, reach};
use panelprep::sim::{self, BoardCell, BoardPrint, BoardShot, RobotNoise, Scene, TOOL_LENGTH_MM, Target, Truth};
use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc as Shared, Mutex, OnceLock};

/// Pictures have so many times fewer pixels each way than those of the real cameras.
const REDUCTION: usize = 2;
/// The simulated panel, its grease and its places come from this number.
const SEED: u64 = 3;
pub const SERIAL: &str = "MANUAL1";
pub const PORTS: [u16; 2] = [54_604, 54_605];
/// Error of the robot, and of a person who touches something, mm.
const EXACT: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };
const SCAN_NOISE_MM: f64 = 0.05;
const LENS_PICTURES: usize = 80;

/// What a person has put into the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stands {
    LensScanner,
    LensFlange,
    BoardOnFlange,
    BoardLies,
    Target,
    Nominal,
    /// A panel at its place of the day, by its number among the worlds.
    Panel(usize),
}

impl Stands {
    /// As the manual says it.
    pub fn named(words: &str) -> Option<Self> {
        Some(match words {
            "a person holds a board before the scanner" => Stands::LensScanner,
            "a person holds a board before the flange camera" => Stands::LensFlange,
            "the board is on the flange, before the scanner" => Stands::BoardOnFlange,
            "the board lies still, before the flange camera" => Stands::BoardLies,
            "the board of the verification is in its place"
            | "a person brings the tip to the spot"
            | "a person touches corners of the board" => Stands::Target,
            "the panel stands at its nominal place" => Stands::Nominal,
            "a greasy panel stands in the cell" => Stands::Panel(0),
            "a clean panel stands in the cell" => Stands::Panel(1),
            _ => return None,
        })
    }
}

/// What the cameras look at.
struct Scenery {
    stands: Mutex<Stands>,
    taken: AtomicU64,
    nominal: sim::Cell,
    boards: BoardCell,
    lens_scanner: Vec<BoardShot<Camera>>,
    lens_flange: Vec<BoardShot<FlangeCamera>>,
    targets: BoardCell,
    base_from_targets: [Rigid<Base, Board>; 2],
    /// Once the cell's file is there.
    arm: OnceLock<(MockHandle, [SimulatedWorld; 2])>,
}

/// The controller's terminals: every world hears what is switched, the one in which a panel stands answers.
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
    /// The cell's cameras; where this machine has no place for them, why.
    pub fn new(folder: &Path) -> Result<Self, String> {
        let nominal = sim::Cell::new(SEED, Scene::Good, REDUCTION);
        let of = |print: BoardPrint| BoardCell::new(SEED, print, EXACT).with_reduction(REDUCTION);
        let (boards, targets) = (of(BoardPrint::chessboard(9, 6, 25.0)), of(Target::print()));
        let scenery = Shared::new(Scenery {
            stands: Mutex::new(Stands::Nominal),
            taken: AtomicU64::new(0),
            base_from_targets: [nominal.scanner_target().base_from_board, nominal.flange_target().base_from_board],
            nominal,
            lens_scanner: boards.lens_shots(&boards.scanner(), LENS_PICTURES),
            lens_flange: boards.lens_shots(&boards.flange_camera(), LENS_PICTURES),
            boards,
            targets,
            arm: OnceLock::new(),
        });
        let camera = scenery.boards.flange_camera();
        let sees = scenery.clone();
        let fill = move |_: u64, pixels: &mut [u8]| {
            let raw = mosaic(&sees.flange_picture(), PixelFormat::BayerRG8);
            let mut flicker = Flicker(sees.number());
            pixels.iter_mut().zip(raw).for_each(|(pixel, gray)| *pixel = flicker.of(gray));
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

    /// The file that describes the played Zivid camera.
    pub fn zivid(&self) -> String {
        let camera = self.scenery.boards.scanner();
        let (width, height) = (camera.width_px, camera.height_px);
        format!("serial ZIVID1\nwidth {width}\nheight {height}\nfeed {}\n", self.feed.display())
    }

    /// The controller, with the inputs and outputs of the cell's file.
    pub fn start_controller(&mut self, cell: &cell::Cell) {
        let greasy = self.scenery.nominal.clone();
        let clean = sim::Cell::new(SEED, Scene::Clean, REDUCTION).placed(1);
        let worlds = [greasy, clean].map(|cell_now| SimulatedWorld::new(cell_now, cell).expect("all is named"));
        worlds.iter().for_each(|world| world.mount_disc(30.0));
        let channel = |text| ChannelFile::parse(text).expect("as it ships");
        let setup = worlds[0].setup(cell, channel(CELLCMD), channel(CELLSTAT));
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

    /// A person puts something else into the cell.
    pub fn put(&self, stands: Stands) {
        *self.scenery.stands.lock().expect("nobody failed") = stands;
        let Stands::Panel(number) = stands else { return };
        self.answers.store(number, Ordering::SeqCst);
        if let Some((_, worlds)) = self.scenery.arm.get() {
            worlds[number].dry_panel();
        }
    }

    fn handle(&self) -> &MockHandle {
        &self.scenery.arm.get().expect("the controller runs").0
    }

    /// A person jogs the arm so that the flange is here.
    pub fn jog(&self, base_from_flange: &Rigid<Base, Flange>) {
        let joints =
            joints_at(base_from_flange).unwrap_or_else(|| panic!("the arm comes there: {base_from_flange:?}"));
        assert!(self.handle().with(|arm| arm.jog(joints)), "the arm stands");
    }

    /// A person jogs the arm to where a first picture of the calibration board can be taken.
    pub fn jog_to_board(&self) {
        let boards = &self.scenery.boards;
        let stands = *self.scenery.stands.lock().expect("nobody failed");
        let flanges: Vec<Rigid<Base, Flange>> = match stands {
            Stands::BoardOnFlange => boards.fixed_shots(20).iter().map(|shot| shot.base_from_flange).collect(),
            _ => boards.flange_shots(20).iter().map(|shot| shot.base_from_flange).collect(),
        };
        let joints = flanges.iter().find_map(joints_at).expect("one of twenty poses is within reach");
        assert!(self.handle().with(|arm| arm.jog(joints)), "the arm stands");
    }

    /// A person brings the camera on the flange to the taught corner.
    pub fn jog_to_corner(&self, index: usize) {
        self.jog(&self.scenery.nominal.corner_views()[index].base_from_flange);
    }

    /// Where the arm sees the board of the verification.
    pub fn verify_pose(&self) -> Joints {
        joints_at(&self.scenery.nominal.flange_target().base_from_flange).expect("within reach")
    }

    /// A person touches an inner corner of the verification's board with the tool's tip.
    pub fn touch_corner(&self, column: usize, row: usize) {
        let board = self.scenery.targets.print();
        let corner = board.corners()[row * 5 + column];
        self.jog(&held_at(self.scenery.base_from_targets[0] * corner, [0.0; 3], TOOL_LENGTH_MM));
    }

    /// A person holds the tip, or a mark behind it, at the spot.
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
        self.jog(&held_at(Point::at(520.0, 30.0, 250.0), TURNS_DEG[number % 6], out_mm));
    }

    /// The region's corners in the taught scan, and its rows and columns, as a person draws them.
    pub fn region(&self) -> sim::Region {
        self.scenery.nominal.region()
    }

    /// The truth of the greasy panel, what was executed, and how much of its grease is left.
    pub fn greasy(&self) -> (Truth, Vec<Sample>, usize) {
        let (handle, worlds) = self.scenery.arm.get().expect("the controller runs");
        let trace = handle.with(|arm| arm.trace().to_vec());
        (worlds[0].truth().clone(), trace, worlds[0].greasy().len())
    }

    /// What was done that must not be done. A scanner that is opened takes a first shot whatever light is on; nothing is made of that
    /// shot.
    pub fn violations(&self) -> String {
        let (_, worlds) = self.scenery.arm.get().expect("the controller runs");
        let all = worlds.iter().flat_map(SimulatedWorld::violations);
        all.filter(|(_, wrong)| *wrong != Violation::LightDuring3d).map(|wrong| format!("{wrong:?} ")).collect()
    }
}

impl Scenery {
    fn number(&self) -> u64 {
        self.taken.fetch_add(1, Ordering::SeqCst)
    }

    fn stands(&self) -> Stands {
        *self.stands.lock().expect("nobody failed")
    }

    /// Where the flange is, unless it moves.
    fn flange(&self) -> Option<Rigid<Base, Flange>> {
        let (handle, _) = self.arm.get()?;
        handle.with(|arm| (!arm.is_moving()).then(|| arm.flange_pose()))
    }

    fn flange_picture(&self) -> ColorPicture {
        let (number, camera) = (self.number(), self.boards.flange_camera());
        let black = || GrayPicture {
            width: camera.width_px,
            height: camera.height_px,
            gray: vec![0; camera.width_px * camera.height_px],
        };
        let stands = self.stands();
        if stands == Stands::LensFlange {
            let shot = &self.lens_flange[number as usize % LENS_PICTURES];
            return self.boards.picture(&camera, shot).to_color();
        }
        let Some(flange) = self.flange() else { return black().to_color() };
        match stands {
            Stands::BoardLies => self.boards.picture(&camera, &self.boards.flange_view(number, flange)).to_color(),
            Stands::Target => {
                let base_from_camera = flange * self.targets.flange_from_camera();
                let camera_from_board = base_from_camera.inverse() * self.base_from_targets[1];
                let shot = BoardShot { index: number, base_from_flange: flange, camera_from_board };
                self.targets.picture(&camera, &shot).to_color()
            }
            Stands::Nominal => self.nominal.flange_picture(&flange, sim::Place::Nominal),
            Stands::Panel(world) => {
                let taken = self.cameras(world).and_then(|mut cameras| cameras.1.capture().ok());
                taken.map_or_else(|| black().to_color(), |taken| taken.picture)
            }
            _ => black().to_color(),
        }
    }

    fn cameras(
        &self,
        world: usize,
    ) -> Option<(panelprep::devices::cameras::SimulatedScanner, panelprep::devices::cameras::SimulatedFlangeCamera)>
    {
        let (handle, worlds) = self.arm.get()?;
        Some(simulated(&worlds[world], &Arm::Mock(handle.clone())))
    }

    /// The shot of a board before the scanner.
    fn board_shot(&self) -> Option<(&BoardCell, BoardShot<Camera>)> {
        let number = self.number();
        match self.stands() {
            Stands::LensScanner => Some((&self.boards, self.lens_scanner[number as usize % LENS_PICTURES])),
            Stands::BoardOnFlange => Some((&self.boards, self.boards.fixed_view(number, self.flange()?))),
            Stands::Target => {
                let camera_from_board = self.targets.base_from_camera().inverse() * self.base_from_targets[0];
                let base_from_flange = self.flange()?;
                Some((&self.targets, BoardShot { index: number, base_from_flange, camera_from_board }))
            }
            _ => None,
        }
    }

    fn scan(&self) -> Option<OrganizedCloud<Camera>> {
        match self.stands() {
            Stands::Nominal => Some(self.nominal.taught_scan()),
            Stands::Panel(world) => self.cameras(world)?.0.capture_3d().ok().map(|shot| shot.cloud),
            Stands::LensFlange | Stands::BoardLies => Some(self.nominal.taught_scan()),
            _ => self.board_shot().map(|(cell, shot)| cell.scan(&shot, SCAN_NOISE_MM)),
        }
    }

    fn picture(&self) -> Option<ColorPicture> {
        match self.stands() {
            Stands::Nominal | Stands::LensFlange | Stands::BoardLies => Some(self.nominal.taught_scan().picture()),
            Stands::Panel(world) => self.cameras(world)?.0.capture_2d().ok().map(|shot| shot.picture),
            _ => self.board_shot().map(|(cell, shot)| cell.picture(&cell.scanner(), &shot).to_color()),
        }
    }

    /// One exposure for the played camera; where nothing can be seen the connection ends, and the camera fails.
    fn answer(&self, mut asked: UnixStream) {
        let mut wish = [0; 3];
        if asked.read_exact(&mut wish).is_err() {
            return;
        }
        let mut bytes = Vec::new();
        let mut size = |width: usize, height: usize| {
            [width, height].iter().for_each(|px| bytes.extend((*px as u32).to_ne_bytes()));
            std::mem::take(&mut bytes)
        };
        let mut flicker = Flicker(self.number());
        let mut colors =
            |rgb: &[[u8; 3]]| rgb.iter().flat_map(|[r, g, b]| [flicker.of(*r), *g, *b, 255]).collect::<Vec<u8>>();
        let answer = match &wish {
            b"3d\n" => self.scan().map(|cloud| {
                let points = cloud.raw_points_mm().iter().flatten().flat_map(|mm| mm.to_ne_bytes());
                let head = size(cloud.width(), cloud.height());
                [head, points.collect(), colors(&cloud.picture().rgb)].concat()
            }),
            _ => self.picture().map(|picture| [size(picture.width, picture.height), colors(&picture.rgb)].concat()),
        };
        if let Some(answer) = answer {
            // Who asked may be gone.
            let _ = asked.write_all(&answer);
        }
    }
}

/// No two exposures of a sensor are alike: a grey level more here and there.
struct Flicker(u64);

impl Flicker {
    fn of(&mut self, gray: u8) -> u8 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        gray.saturating_add(u8::from(self.0 >> 61 == 0))
    }
}

/// Axes that bring the flange there.
fn joints_at(base_from_flange: &Rigid<Base, Flange>) -> Option<Joints> {
    let arm = Kinematics::new(cell::Cell::check("", "").expect("an arm").arm());
    reach::postures(&arm, base_from_flange, Point::at(0.0, 0.0, 0.0)).into_iter().next()
}

/// The flange while a tool of this length holds its tip at a place, its axis turned from straight down.
fn held_at(place: Point<Base>, turn_deg: [f64; 3], out_mm: f64) -> Rigid<Base, Flange> {
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    let down = UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(f64::to_radians)));
    let tip: Rigid<Base, Tool> = Rigid::claim(Isometry3::from_parts(place.mm.coords.into(), turn * down));
    let flange_from_tool: Rigid<Flange, Tool> = Rigid::claim(Isometry3::translation(0.0, 0.0, out_mm));
    tip * flange_from_tool.inverse()
}
