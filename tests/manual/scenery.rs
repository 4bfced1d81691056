//! The objects in the cell of the manual, and the pictures of its cameras, rendered from the arm's present pose.

use panelprep::devices::cameras::{
    Arm, FlangeCamera as _, Scanner as _, SimulatedFlangeCamera, SimulatedScanner, simulated_cameras,
};
use panelprep::devices::mock::MockHandle;
use panelprep::devices::world::SimulatedWorld;
use panelprep::geometry::{
    Base, Board, Camera, ColorPicture, Flange, FlangeCamera, GrayPicture, OrganizedCloud, Rigid,
};
use panelprep::sim::{self, BoardCell, BoardPrint, BoardShot, RobotNoise, Scene, Target};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};

/// Factor by which pictures have fewer pixels in each direction than those of the real cameras.
pub const REDUCTION: usize = 2;
/// Random seed for the simulated panel, its grease and its poses.
pub const SEED: u64 = 3;
/// Pose error of a robot with the board or the camera on it: none.
const EXACT: RobotNoise = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };
const SCAN_NOISE_MM: f64 = 0.05;
const LENS_PICTURES: usize = 80;

/// The objects that a person has put into the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellContents {
    LensScanner,
    LensFlange,
    BoardOnFlange,
    BoardLies,
    Target,
    Nominal,
    /// A panel at its present pose; the number is its index among the worlds.
    Panel(usize),
}

impl CellContents {
    /// Returns the contents of the cell that the manual describes with these words.
    pub fn named(words: &str) -> Option<Self> {
        Some(match words {
            "a person holds a board before the scanner" => CellContents::LensScanner,
            "a person holds a board before the flange camera" => CellContents::LensFlange,
            "the board is on the flange, before the scanner" => CellContents::BoardOnFlange,
            "the board lies still, before the flange camera" => CellContents::BoardLies,
            "the board of the verification is in its place"
            | "a person brings the tip to the spot"
            | "a person touches corners of the board" => CellContents::Target,
            "the panel stands at its nominal place" => CellContents::Nominal,
            "a greasy panel stands in the cell" => CellContents::Panel(0),
            "a clean panel stands in the cell" => CellContents::Panel(1),
            _ => return None,
        })
    }
}

/// The objects in the view of the cameras.
pub struct Scenery {
    pub stands: Mutex<CellContents>,
    taken: AtomicU64,
    pub nominal: sim::Cell,
    pub boards: BoardCell,
    lens_scanner: Vec<BoardShot<Camera>>,
    lens_flange: Vec<BoardShot<FlangeCamera>>,
    pub targets: BoardCell,
    pub base_from_targets: [Rigid<Base, Board>; 2],
    /// Set when the cell's file exists.
    pub arm: OnceLock<(MockHandle, [SimulatedWorld; 2])>,
}

impl Scenery {
    /// Creates the scenery before the cell's file exists: it has no arm yet.
    pub fn new() -> Self {
        let nominal = sim::Cell::new(SEED, Scene::Good, REDUCTION);
        let of = |print: BoardPrint| BoardCell::new(SEED, print, EXACT).with_reduction(REDUCTION);
        let (boards, targets) = (of(BoardPrint::chessboard(9, 6, 25.0)), of(Target::target_print()));
        Scenery {
            stands: Mutex::new(CellContents::Nominal),
            taken: AtomicU64::new(0),
            base_from_targets: [nominal.scanner_target().base_from_board, nominal.flange_target().base_from_board],
            nominal,
            lens_scanner: boards.lens_shots(&boards.scanner(), LENS_PICTURES),
            lens_flange: boards.lens_shots(&boards.flange_camera(), LENS_PICTURES),
            boards,
            targets,
            arm: OnceLock::new(),
        }
    }

    pub fn number(&self) -> u64 {
        self.taken.fetch_add(1, Ordering::SeqCst)
    }

    pub fn contents(&self) -> CellContents {
        *self.stands.lock().expect("no thread failed")
    }

    /// Returns the pose of the flange, if the flange is stationary.
    fn flange(&self) -> Option<Rigid<Base, Flange>> {
        let (handle, _) = self.arm.get()?;
        handle.with_controller(|arm| (!arm.is_moving()).then(|| arm.flange_pose()))
    }

    pub fn flange_picture(&self) -> ColorPicture {
        let (number, camera) = (self.number(), self.boards.flange_camera());
        let black = || GrayPicture {
            width: camera.width_px,
            height: camera.height_px,
            gray: vec![0; camera.width_px * camera.height_px],
        };
        let stands = self.contents();
        if stands == CellContents::LensFlange {
            let shot = &self.lens_flange[number as usize % LENS_PICTURES];
            return self.boards.picture(&camera, shot).to_color();
        }
        let Some(flange) = self.flange() else { return black().to_color() };
        match stands {
            CellContents::BoardLies => {
                self.boards.picture(&camera, &self.boards.flange_view(number, flange)).to_color()
            }
            CellContents::Target => {
                let base_from_camera = flange * self.targets.flange_from_camera();
                let camera_from_board = base_from_camera.inverse() * self.base_from_targets[1];
                let shot = BoardShot { index: number, base_from_flange: flange, camera_from_board };
                self.targets.picture(&camera, &shot).to_color()
            }
            CellContents::Nominal => self.nominal.flange_picture(&flange, sim::PanelPosition::Nominal),
            CellContents::Panel(world) => {
                let taken = self.cameras(world).and_then(|mut cameras| cameras.1.capture().ok());
                taken.map_or_else(|| black().to_color(), |taken| taken.picture)
            }
            _ => black().to_color(),
        }
    }

    fn cameras(&self, world: usize) -> Option<(SimulatedScanner, SimulatedFlangeCamera)> {
        let (handle, worlds) = self.arm.get()?;
        Some(simulated_cameras(&worlds[world], &Arm::Mock(handle.clone())))
    }

    /// Returns the shot of a board in front of the scanner.
    fn board_shot(&self) -> Option<(&BoardCell, BoardShot<Camera>)> {
        let number = self.number();
        match self.contents() {
            CellContents::LensScanner => Some((&self.boards, self.lens_scanner[number as usize % LENS_PICTURES])),
            CellContents::BoardOnFlange => Some((&self.boards, self.boards.fixed_view(number, self.flange()?))),
            CellContents::Target => {
                let camera_from_board = self.targets.base_from_camera().inverse() * self.base_from_targets[0];
                let base_from_flange = self.flange()?;
                Some((&self.targets, BoardShot { index: number, base_from_flange, camera_from_board }))
            }
            _ => None,
        }
    }

    fn scan(&self) -> Option<OrganizedCloud<Camera>> {
        match self.contents() {
            CellContents::Nominal => Some(self.nominal.taught_scan()),
            CellContents::Panel(world) => self.cameras(world)?.0.capture_3d().ok().map(|shot| shot.cloud),
            CellContents::LensFlange | CellContents::BoardLies => Some(self.nominal.taught_scan()),
            _ => self.board_shot().map(|(cell, shot)| cell.scan(&shot, SCAN_NOISE_MM)),
        }
    }

    fn picture(&self) -> Option<ColorPicture> {
        match self.contents() {
            CellContents::Nominal | CellContents::LensFlange | CellContents::BoardLies => {
                Some(self.nominal.taught_scan().picture())
            }
            CellContents::Panel(world) => self.cameras(world)?.0.capture_2d().ok().map(|shot| shot.picture),
            _ => self.board_shot().map(|(cell, shot)| cell.picture(&cell.scanner(), &shot).to_color()),
        }
    }

    /// Renders one exposure for the emulated camera. If no object is visible, the connection ends and the camera fails.
    pub fn answer(&self, mut asked: UnixStream) {
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
        let mut colors = |rgb: &[[u8; 3]]| {
            rgb.iter().flat_map(|[r, g, b]| [flicker.apply(*r), *g, *b, 255]).collect::<Vec<u8>>()
        };
        let answer = match &wish {
            b"3d\n" => self.scan().map(|cloud| {
                let points = cloud.raw_points_mm().iter().flatten().flat_map(|mm| mm.to_ne_bytes());
                let head = size(cloud.width(), cloud.height());
                [head, points.collect(), colors(&cloud.picture().rgb)].concat()
            }),
            _ => self.picture().map(|picture| [size(picture.width, picture.height), colors(&picture.rgb)].concat()),
        };
        if let Some(answer) = answer {
            // The requesting process may have ended.
            let _ = asked.write_all(&answer);
        }
    }
}

/// Makes each exposure of a sensor different: one grey level more at some pixels.
pub struct Flicker(pub u64);

impl Flicker {
    pub fn apply(&mut self, gray: u8) -> u8 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        gray.saturating_add(u8::from(self.0 >> 61 == 0))
    }
}
