//! Compares calibrations with the renderer's ground truth, for the tests and for `make bench-calib`.
#![allow(dead_code)] // Each of the two uses its part.

use panelprep::calib::hand_eye::hand_eye;
use panelprep::calib::intrinsics::{self, View};
use panelprep::calib::three_points::{TouchedCorner, three_points};
use panelprep::calib::{Arrangement, Board, BoardObservation, HandEye, Station, detect};
use panelprep::cell::{FlangeCameraMount, LensCovariance, ScannerMount};
use panelprep::geometry::{Base, KukaPose, PinholeCamera, Point, Rigid, Vector};
use panelprep::sim::{BoardCell, BoardPrint, BoardShot, RobotNoise};
use rayon::prelude::*;

pub const GOOD_ROBOT: RobotNoise = RobotNoise { shift_mm: 0.02, turn_deg: 0.005 };
/// Pose errors of a robot with 0.5 mm of absolute error, and the corresponding rotation.
pub const BAD_ROBOT: RobotNoise = RobotNoise { shift_mm: 0.288_675, turn_deg: 0.03 };
pub const POSES: usize = 15;
/// Standard deviation of the noise of synthetic corners, px: twice the detection error on rendered pictures.
pub const CORNER_PX: f64 = 0.02;

/// A lens with its stated accuracy.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    pub camera: PinholeCamera,
    pub covariance: Option<LensCovariance>,
}

impl Lens {
    pub fn truth<A: Side>(cell: &BoardCell) -> Self {
        Lens { camera: A::camera(cell), covariance: None }
    }
}

pub fn board() -> Board {
    Board::parse("9x6", 25.0).expect("a board")
}

pub fn cell(seed: u64, robot: RobotNoise) -> BoardCell {
    BoardCell::new(seed, BoardPrint::chessboard(9, 6, 25.0), robot)
}

/// One of the two mounts, with its camera and its ground truth.
pub trait Side: Arrangement {
    const NAME: &'static str;
    fn camera(cell: &BoardCell) -> PinholeCamera;
    fn shots(cell: &BoardCell, count: usize) -> Vec<BoardShot<Self::From>>;
    fn truth(cell: &BoardCell) -> Rigid<Self::To, Self::From>;
}

impl Side for ScannerMount {
    const NAME: &'static str = "fixed camera";

    fn camera(cell: &BoardCell) -> PinholeCamera {
        cell.scanner()
    }

    fn shots(cell: &BoardCell, count: usize) -> Vec<BoardShot<Self::From>> {
        cell.fixed_shots(count)
    }

    fn truth(cell: &BoardCell) -> Rigid<Self::To, Self::From> {
        cell.base_from_camera()
    }
}

impl Side for FlangeCameraMount {
    const NAME: &'static str = "flange camera";

    fn camera(cell: &BoardCell) -> PinholeCamera {
        cell.flange_camera()
    }

    fn shots(cell: &BoardCell, count: usize) -> Vec<BoardShot<Self::From>> {
        cell.flange_shots(count)
    }

    fn truth(cell: &BoardCell) -> Rigid<Self::To, Self::From> {
        cell.flange_from_camera()
    }
}

/// Computes the corners of shots by projection, without rendering, and adds noise.
pub fn synthetic<A: Side>(cell: &BoardCell, shots: &[BoardShot<A::From>]) -> Vec<detect::Corners> {
    shots.iter().map(|shot| cell.corners(&A::camera(cell), shot, CORNER_PX)).collect()
}

/// Detects corners in rendered pictures of full size.
pub fn rendered<A: Side>(cell: &BoardCell, shots: &[BoardShot<A::From>]) -> Vec<detect::Corners> {
    let find = |shot: &BoardShot<A::From>| {
        let picture = cell.picture(&A::camera(cell), shot);
        detect::detect(&shot.index.to_string(), &picture, &board(), None).expect("a board").corners
    };
    shots.par_iter().map(find).collect()
}

pub fn stations<A: Side>(shots: &[BoardShot<A::From>], corners: &[detect::Corners]) -> Vec<Station<A::From>> {
    let station = |(shot, corners): (&BoardShot<A::From>, &detect::Corners)| Station {
        name: format!("{:02}.png", shot.index),
        base_from_flange: shot.base_from_flange,
        observation: BoardObservation::Pixels(corners.clone()),
    };
    shots.iter().zip(corners).map(station).collect()
}

/// Number of pictures for a lens calibration, more than for a mount.
const LENS_PICTURES: usize = 25;

/// Calibrates the camera with this program, from rendered pictures in which the board fills the picture.
pub fn own_lens<A: Side>(cell: &BoardCell) -> Lens {
    let camera = A::camera(cell);
    let shots = cell.lens_shots::<A::From>(&camera, LENS_PICTURES);
    let corners = rendered::<A>(cell, &shots);
    calibrate_lens(&camera, &corners)
}

/// Calibrates the camera from synthetic corners of fewer pictures, for statistics.
pub fn synthetic_lens<A: Side>(cell: &BoardCell) -> Lens {
    let camera = A::camera(cell);
    calibrate_lens(&camera, &synthetic::<A>(cell, &cell.lens_shots::<A::From>(&camera, POSES)))
}

/// Calibrates the lens from these corners.
pub fn calibrate_lens(camera: &PinholeCamera, corners: &[detect::Corners]) -> Lens {
    let found = calibrated_lens(camera, corners);
    Lens { camera: found.camera, covariance: Some(found.covariance) }
}

/// Calibrates the lens from these corners, and returns its quality values as well.
pub fn calibrated_lens(camera: &PinholeCamera, corners: &[detect::Corners]) -> intrinsics::Calibrated {
    let view =
        |(index, corners): (usize, &detect::Corners)| View { name: index.to_string(), corners: corners.clone() };
    let views: Vec<View> = corners.iter().enumerate().map(view).collect();
    let size = (camera.width_px, camera.height_px);
    intrinsics::calibrate(size, &views, intrinsics::Options::default()).expect("a camera")
}

/// The error of a calibration against the ground truth.
#[derive(Debug, Clone, Copy)]
pub struct Error {
    pub mm: f64,
    pub deg: f64,
    pub stated_mm: f64,
    /// Whether the true value is within the stated 95 % region.
    pub held: bool,
    pub suspects: usize,
}

pub fn error<A: Side>(cell: &BoardCell, found: &HandEye<A>) -> Error {
    let (pose, truth) = (found.adjustment.to_from_camera, A::truth(cell));
    let off: Vector<A::To> = pose * found.stated_point - truth * found.stated_point;
    Error {
        mm: off.mm.norm(),
        deg: (truth.inverse() * pose).rotation_angle().0,
        stated_mm: found.uncertainty_mm,
        held: found.region_contains(off),
        suspects: found.suspects.len(),
    }
}

/// Calibrates a mount from the corners at many poses, with this lens.
pub fn calibrate_from_many_poses<A: Side>(
    lens: &Lens,
    shots: &[BoardShot<A::From>],
    corners: &[detect::Corners],
) -> HandEye<A> {
    calibrated(lens, &stations::<A>(shots, corners))
}

pub fn calibrated<A: Side>(lens: &Lens, stations: &[Station<A::From>]) -> HandEye<A> {
    let found = hand_eye(&lens.camera, &board(), stations, None).expect("calibrated");
    match &lens.covariance {
        Some(covariance) => {
            found.with_lens_uncertainty(&lens.camera, stations, covariance).expect("in front of the camera")
        }
        None => found,
    }
}

/// Injected faults of a calibration, in the words of the messages that report them.
pub const FAULTS: [&str; 3] = ["upside down", "exchange their poses", "according to the picture"];

/// Calibrates with an injected fault at station `seed`: a flipped board, two exchanged pictures or a mistyped number.
/// Returns the messages, and their expected first words.
pub fn calibrate_with_fault<A: Side>(seed: u64, fault: usize) -> (Vec<String>, Vec<String>) {
    let cell = cell(seed, GOOD_ROBOT);
    let shots = A::shots(&cell, POSES);
    let mut stations = stations::<A>(&shots, &synthetic::<A>(&cell, &shots));
    let (at, other) = (seed as usize % POSES, (seed as usize + 4) % POSES);
    let mut wrong = vec![stations[at].name.clone()];
    match fault {
        0 => {
            let BoardObservation::Pixels(corners) = &mut stations[at].observation else { unreachable!("pictures") };
            let pixels: Vec<_> = corners.iter().rev().map(|(_, pixel)| *pixel).collect();
            corners.iter_mut().zip(pixels).for_each(|(corner, pixel)| corner.1 = pixel);
        }
        1 => {
            let seen = stations[at].observation.clone();
            stations[at].observation = std::mem::replace(&mut stations[other].observation, seen);
            wrong.push(stations[other].name.clone());
        }
        _ => {
            let mut pose = KukaPose::from_rigid(&stations[at].base_from_flange);
            if seed.is_multiple_of(2) {
                pose.y_mm += 3.0
            } else {
                pose.b_deg += 0.9
            }
            stations[at].base_from_flange = pose.to_rigid();
        }
    }
    let found = calibrated::<A>(&Lens::truth::<A>(&cell), &stations);
    wrong.sort();
    (found.suspects.iter().map(ToString::to_string).collect(), wrong)
}

/// Returns whether the fault is detected and named correctly, and no other fault is reported.
pub fn is_fault_named((told, wrong): &(Vec<String>, Vec<String>), fault: usize) -> bool {
    let mut named = told.iter().zip(wrong);
    told.len() == wrong.len() && named.all(|(told, name)| told.starts_with(&**name) && told.contains(FAULTS[fault]))
}

/// Calibrates the fixed camera from three points with the board at the panel's pose. Returns the error at the panel's
/// centre and at its farthest corner, mm.
pub fn three_point_errors(seed: u64, noise_mm: f64, is_rendered: bool) -> [f64; 2] {
    let cell = cell(seed, RobotNoise { shift_mm: 0.0, turn_deg: 0.0 });
    let camera = cell.scanner();
    let mut shot = cell.fixed_shots(1)[0];
    // The operator holds the board at the position of the panel, approximately facing the camera.
    let middle = board().centre().mm.coords;
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::new(0.2, -0.25, 0.05));
    let place = cell.panel_middle().mm.coords - turn * middle;
    shot.camera_from_board = Rigid::from_isometry_unchecked(nalgebra::Isometry3::from_parts(place.into(), turn));
    let base_from_board = cell.base_from_camera() * shot.camera_from_board;
    let corners = board().corners_to_touch();
    let places: Vec<_> = corners.iter().map(|&(c, r)| board().corner(c, r).expect("on the board")).collect();
    let touched: Vec<TouchedCorner> = corners
        .iter()
        .zip(cell.touch_points(&base_from_board, &places, noise_mm))
        .map(|(&corner, place)| TouchedCorner { corner, place })
        .collect();
    let seen = if is_rendered {
        let picture = cell.picture(&camera, &shot);
        detect::detect("board.png", &picture, &board(), None).expect("a board").corners
    } else {
        cell.corners(&camera, &shot, CORNER_PX)
    };
    let found = three_points::<ScannerMount>(&camera, &board(), &BoardObservation::Pixels(seen), &touched, None);
    let found = found.expect("calibrated");
    let truth = cell.base_from_camera();
    let off = |point: Point<_>| found.to_from_camera.distance_at_mm(truth, point);
    let centre: Point<Base> = Point::at(560.0, 0.0, 360.0);
    let panel = panelprep::sim::Cell::new(1, panelprep::sim::Scene::Clean, 8).truth().outline();
    let corner = panel.iter().map(|p| off(truth.inverse() * Point::<Base>::new(p.mm))).fold(0.0, f64::max);
    [off(truth.inverse() * centre), corner]
}
