//! Writes boards and coupons of the simulated cell to a rendered folder: boards for the verification of its cameras,
//! with `--boards` also boards for their calibration, and test coupons for `panelprep calibrate removal`.

use super::args::{Common, Render, Simulation};
use super::calibrate::args::{BoardArgs, CameraName, Touch, Verify};
use super::calibrate::pose_keys;
use super::disk;
use super::fault::Fault;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{
    Base, Camera, Degrees, Flange, Frame, GrayPicture, KukaPose, PinholeCamera, Point, Rigid, Tool,
};
use panelprep_cell::cell::{BoardSize, MountedPose, TargetMount};
use panelprep_cell::files::{self, ReportedFlange};
use panelprep_sim as sim;
use panelprep_sim::{BoardCell, BoardPrint, BoardShot, RealArm, ReportedFlangePose, RobotNoise, ScannerDistortion};
use panelprep_toolpath::removal::coupons::{Coupon, CouponTool, Lines};
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::speed::Orbit;
use panelprep_vision::calib::{Board, CalibError};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const TARGET: (&str, f64) = ("5x4", 40.0);
const POSES: usize = 15;
/// Number of poses for the calibration of the arm, which needs more poses than a camera mount.
const ARM_POSE_COUNT: usize = 20;
const LENS_PICTURE_COUNT: usize = 25;
/// The pose noise of the simulated robot.
pub(super) const ROBOT_NOISE: RobotNoise = RobotNoise { shift_mm: 0.02, turn_deg: 0.005 };
const TOUCH_NOISE_MM: f64 = 0.1;

/// The files of a rendered folder, by their purpose.
#[derive(Debug, Clone)]
pub struct RenderedFiles {
    /// The folder.
    pub folder: PathBuf,
    /// Duration of the wet films in the folder, s.
    pub seconds: u32,
}

impl RenderedFiles {
    /// Returns the path of a file in the folder.
    pub fn file_path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

impl RenderedFiles {
    /// Returns the arguments of `panelprep calibrate verify` for this camera, with its rendered target.
    pub fn verification(&self, camera: CameraName) -> Verify {
        let (name, flange) = match camera {
            CameraName::Scanner => ("scanner", None),
            CameraName::FlangeCamera => ("flange_camera", Some(self.file_path("target/flange.json"))),
        };
        Verify {
            camera,
            board: target_board().into(),
            recipe: None,
            image: Some(self.file_path(&format!("target/{name}.png"))),
            live: None,
            simulation: Simulation::default(),
            poses: None,
            flange,
            target: Some(self.file_path(&format!("target/{name}.toml"))),
            learn: false,
            pictures: None,
        }
    }

    /// Returns the arguments of `panelprep calibrate touch`, with the rendered target of the scanner.
    pub fn touch(&self) -> Touch {
        Touch {
            board: target_board().into(),
            target: self.file_path("target/scanner.toml"),
            points: Some(self.file_path("target/touched.toml")),
            live: None,
            pictures: None,
        }
    }

    /// Returns the common arguments for the rendered cell.
    pub fn common_arguments(&self) -> Common {
        Common { cell: self.file_path("cell.toml"), store: None, json: false }
    }
}

fn target_board() -> BoardArgs {
    BoardArgs { board: TARGET.0.to_owned(), square_mm: Some(TARGET.1), subpix: None }
}

/// Writes the boards for the verification of the cameras: pictures, known poses, and a touch.
///
/// # Errors
/// If writing to the disk fails.
pub fn write_targets(cell: &sim::Cell, rendered: &RenderedFiles) -> Result<(), Fault> {
    let (scanner, flange) = (cell.scanner_target(), cell.flange_target());
    for (name, target) in [("scanner", &scanner), ("flange_camera", &flange)] {
        save(rendered, &format!("target/{name}.png"), &target.picture)?;
        let mut known = MountedPose::<TargetMount>::from_pose(KukaPose::from_rigid(&target.known_base_from_board));
        known.board = Some(BoardSize { board: TARGET.0.to_owned(), square_mm: TARGET.1 });
        disk::write(&rendered.file_path(&format!("target/{name}.toml")), known.to_toml())?;
    }
    let arm = cell.real_arm();
    write_flange(&rendered.file_path("target/flange.json"), arm, &flange.base_from_flange)?;
    let board = Board::parse(TARGET.0, TARGET.1).map_err(Fault::stage)?;
    let touched = |places: &[Point<_>]| cell.touched_target(&scanner, places);
    Ok(disk::write(&rendered.file_path("target/touched.toml"), points_text(&board, arm, touched)?)?)
}

/// Returns the flange pose that the controller reports if this is the true pose.
fn controller_report(
    arm: Option<&RealArm>,
    base_from_flange: &Rigid<Base, Flange>,
) -> Result<ReportedFlangePose, Fault> {
    match arm {
        None => Ok(ReportedFlangePose { base_from_flange: *base_from_flange, joints: None }),
        Some(arm) => arm.reported_pose(base_from_flange).ok_or_else(|| {
            let pose = KukaPose::from_rigid(base_from_flange);
            Fault::stage(CalibError::Points(format!("the simulated arm cannot reach {pose}")))
        }),
    }
}

/// Writes the flange pose that the controller reports if this is the true pose.
///
/// # Errors
/// If the arm cannot reach the pose, or writing to the disk fails.
pub fn write_flange(
    file: &Path,
    arm: Option<&RealArm>,
    base_from_flange: &Rigid<Base, Flange>,
) -> Result<(), Fault> {
    let ReportedFlangePose { base_from_flange, joints } = controller_report(arm, base_from_flange)?;
    let base_from_flange = KukaPose::from_rigid(&base_from_flange);
    Ok(disk::write(file, files::write_reported_flange(&ReportedFlange { base_from_flange, joints }))?)
}

/// Writes the data for the calibrations of the cell, each in its own folder: lens, both mounts, three points, tool.
///
/// # Errors
/// If writing to the disk fails.
pub fn write(
    seed: u64,
    reduction: usize,
    (arm, rendered): (Option<&RealArm>, &RenderedFiles),
) -> Result<(), Fault> {
    let cell = BoardCell::new(seed, BoardPrint::chessboard(9, 6, 25.0), ROBOT_NOISE).with_reduction(reduction);
    let board = Board::parse("9x6", 25.0).map_err(Fault::stage)?;
    let lens: Vec<BoardShot<panelprep_base::geometry::FlangeCamera>> =
        cell.lens_shots(&cell.flange_camera(), LENS_PICTURE_COUNT);
    pictures(rendered, "lens", (&cell, &cell.flange_camera()), &lens)?;
    let poses = if arm.is_some() { ARM_POSE_COUNT } else { POSES };
    let fixed = select_reachable_shots(arm, poses, |count| cell.fixed_shots(count));
    let flange = select_reachable_shots(arm, poses, |count| cell.flange_shots(count));
    pictures(rendered, "fixed", (&cell, &cell.scanner()), &fixed)?;
    pictures(rendered, "flange", (&cell, &cell.flange_camera()), &flange)?;
    disk::write(&rendered.file_path("boards/fixed/poses.toml"), poses_text(arm, &fixed)?)?;
    disk::write(&rendered.file_path("boards/flange/poses.toml"), poses_text(arm, &flange)?)?;
    // The true pose of the fixed board, with which `calibrate verify --poses` compares the pictures.
    let mut known = MountedPose::<TargetMount>::from_pose(KukaPose::from_rigid(&cell.base_from_board()));
    known.board = Some(BoardSize { board: "9x6".to_owned(), square_mm: 25.0 });
    disk::write(&rendered.file_path("boards/flange/target.toml"), known.to_toml())?;
    let touchable = |shot: &&BoardShot<Camera>| {
        arm.is_none_or(|arm| can_reach_corners(arm, &board, &(cell.base_from_camera() * shot.camera_from_board)))
    };
    let shot_to_touch = fixed.iter().find(touchable);
    if let Some(shot) = shot_to_touch {
        save(rendered, "boards/touched.png", &cell.picture(&cell.scanner(), shot))?;
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let touched = |places: &[Point<_>]| cell.touch_points(&base_from_board, places, TOUCH_NOISE_MM);
        disk::write(&rendered.file_path("boards/touched.toml"), points_text(&board, arm, touched)?)?;
    }
    if let Some(arm) = arm {
        let fixed = shot_to_touch.map(|shot| cell.base_from_camera() * shot.camera_from_board);
        let boards = [(None, Some(cell.base_from_board())), (Some("touched.png"), fixed)];
        let mut text = touches_text(Some(arm))?;
        for (image, base_from_board) in boards {
            let Some(base_from_board) = base_from_board else { continue };
            text += &corners_text(arm, &board, image, |places| {
                cell.touch_points(&base_from_board, places, TOUCH_NOISE_MM)
            });
        }
        disk::write(&rendered.file_path("boards/touches.toml"), text)?;
    }
    write_force(rendered)?;
    Ok(disk::write(&rendered.file_path("boards/tip.toml"), tip_text(arm)?)?)
}

/// Writes `boards/scanner/*.pcd`: scans of a board with 8×6 inner corners and 30 mm squares, in the whole working
/// volume.
///
/// # Errors
/// If writing to the disk fails.
pub fn write_scans(
    args: &Render,
    distortion: Option<ScannerDistortion>,
    rendered: &RenderedFiles,
) -> Result<(), Fault> {
    let print = BoardPrint::chessboard(8, 6, 30.0);
    let cell = BoardCell::new(args.seed, print, ROBOT_NOISE).with_reduction(args.reduction as usize);
    let distortion = distortion.unwrap_or_else(|| ScannerDistortion::new(args.seed, 0.0));
    let shots = cell.scanner_shots(args.board_scans as usize);
    shots.par_iter().enumerate().try_for_each(|(index, shot)| {
        let file = rendered.file_path(&format!("boards/scanner/{:02}.pcd", index + 1));
        Ok(disk::write(&file, files::write_pcd(&cell.real_scan(shot, &distortion)))?)
    })
}

/// Writes `boards/force.toml`: force measurements of a compliant tool without contact.
///
/// # Errors
/// If writing to the disk fails.
pub fn write_force(rendered: &RenderedFiles) -> Result<(), Fault> {
    Ok(disk::write(&rendered.file_path("boards/force.toml"), FORCE_TEXT)?)
}

/// Returns this number of board poses that the arm can reach; an arm with its nominal geometry reaches all of them.
fn select_reachable_shots<C: Frame>(
    arm: Option<&RealArm>,
    count: usize,
    shots: impl Fn(usize) -> Vec<BoardShot<C>>,
) -> Vec<BoardShot<C>> {
    let Some(arm) = arm else { return shots(count) };
    let comes = |shot: &BoardShot<C>| arm.reported_pose(&shot.base_from_flange).is_some();
    shots(MAX_DRAWS_PER_SHOT * count).into_iter().filter(comes).take(count).collect()
}

/// Maximum number of random poses per required pose, among which at least one is within the reach of the arm.
const MAX_DRAWS_PER_SHOT: usize = 10;

fn save(rendered: &RenderedFiles, name: &str, picture: &GrayPicture) -> Result<(), Fault> {
    Ok(disk::write(&rendered.file_path(name), files::write_gray_png(picture).map_err(Fault::stage)?)?)
}

fn picture_file_name<C: Frame>(index: usize, _: &BoardShot<C>) -> String {
    format!("{:02}.png", index + 1)
}

fn pictures<C: Frame>(
    rendered: &RenderedFiles,
    folder: &str,
    (cell, camera): (&BoardCell, &PinholeCamera),
    shots: &[BoardShot<C>],
) -> Result<(), Fault> {
    shots.par_iter().enumerate().try_for_each(|(index, shot)| {
        save(rendered, &format!("boards/{folder}/{}", picture_file_name(index, shot)), &cell.picture(camera, shot))
    })
}

/// Formats a pose for a poses file, with the axis angles if the arm differs from its nominal geometry.
fn reported_text(ReportedFlangePose { base_from_flange, joints }: &ReportedFlangePose) -> String {
    pose_keys(&ReportedFlange { base_from_flange: KukaPose::from_rigid(base_from_flange), joints: *joints })
}

fn poses_text<C: Frame>(arm: Option<&RealArm>, shots: &[BoardShot<C>]) -> Result<String, Fault> {
    let pose = |(index, shot): (usize, &BoardShot<C>)| {
        let flange = reported_text(&controller_report(arm, &shot.base_from_flange)?);
        Ok(format!("[[poses]]\nimage = \"{}\"\n{flange}\n", picture_file_name(index, shot)))
    };
    shots.iter().enumerate().map(pose).collect()
}

/// Returns the text of a points file with the corners that the calibration asks a person to touch.
#[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
fn points_text(
    board: &Board,
    arm: Option<&RealArm>,
    touched: impl Fn(&[Point<panelprep_base::geometry::Board>]) -> Vec<Point<Base>>,
) -> Result<String, Fault> {
    let corners = board.corners_to_touch();
    let places: Vec<_> = corners.iter().filter_map(|&(column, row)| board.corner(column, row)).collect();
    let mut text = String::new();
    for (index, (place, (column, row))) in touched(&places).iter().zip(corners).enumerate() {
        let number = index + 1;
        // The corners are touched with a pointer that points straight down.
        let pointing = flange_pose_for_tip(*place, [0.0; 3], sim::TOOL_LENGTH_MM);
        let ReportedFlangePose { base_from_flange, joints } = controller_report(arm, &pointing)?;
        let tip = match joints {
            None => place.mm,
            Some(_) => (base_from_flange * Point::<Flange>::at(0.0, 0.0, sim::TOOL_LENGTH_MM)).mm,
        };
        let [x, y, z] = [tip.x, tip.y, tip.z];
        let _ = writeln!(text, "p{number}_mm = [{x:.3}, {y:.3}, {z:.3}]\np{number}_corner = [{column}, {row}]");
        if let Some(joints) = joints {
            let _ = writeln!(text, "p{number}_axes_deg = {:?}", joints.degrees());
        }
    }
    Ok(text)
}

/// Returns whether the arm can reach all corners that are to be touched.
fn can_reach_corners(
    arm: &RealArm,
    board: &Board,
    base_from_board: &Rigid<Base, panelprep_base::geometry::Board>,
) -> bool {
    let corners = board.corners_to_touch();
    let mut places = corners.iter().filter_map(|&(column, row)| board.corner(column, row));
    places.all(|place| {
        arm.reported_pose(&flange_pose_for_tip(*base_from_board * place, [0.0; 3], sim::TOOL_LENGTH_MM)).is_some()
    })
}

/// Returns the flange pose at which the tip of a tool of length `out_mm` is at `place`. The axis of the tool is rotated
/// by `turn_deg` from straight down.
fn flange_pose_for_tip(place: Point<Base>, turn_deg: [f64; 3], out_mm: f64) -> Rigid<Base, Flange> {
    let down = UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(|deg| Degrees(deg).to_rad())));
    let tip: Rigid<Base, Tool> =
        Rigid::from_isometry_unchecked(Isometry3::from_parts(place.mm.coords.into(), turn * down));
    let flange_from_tool: Rigid<Flange, Tool> =
        Rigid::from_isometry_unchecked(Isometry3::translation(0.0, 0.0, out_mm));
    tip * flange_from_tool.inverse()
}

/// Returns the text of a touches file with touched corners of a fixed board. Without `image`, the board is the one in
/// front of the flange camera. Corners that the arm cannot reach are omitted.
#[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
fn corners_text(
    arm: &RealArm,
    board: &Board,
    image: Option<&str>,
    touched: impl Fn(&[Point<panelprep_base::geometry::Board>]) -> Vec<Point<Base>>,
) -> String {
    let corners = board.corners_to_touch();
    let places: Vec<_> = corners.iter().filter_map(|&(column, row)| board.corner(column, row)).collect();
    let mut text = String::new();
    for (place, (column, row)) in touched(&places).iter().zip(corners) {
        for turn_deg in &TOOL_ROTATIONS_DEG[..2] {
            let Some(flange) = arm.reported_pose(&flange_pose_for_tip(*place, *turn_deg, sim::TOOL_LENGTH_MM))
            else {
                continue;
            };
            let image = image.map_or(String::new(), |image| format!("image = \"{image}\"\n"));
            let _ = writeln!(text, "[[touches]]\ncorner = [{column}, {row}]\n{image}{}", reported_text(&flange));
        }
    }
    text
}

/// Returns the text of a touches file with several poses at each of two fixed points.
#[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
fn touches_text(arm: Option<&RealArm>) -> Result<String, Fault> {
    let mut text = String::new();
    for (spot, place) in [Point::at(520.0, 30.0, 250.0), Point::at(450.0, -120.0, 300.0)].into_iter().enumerate() {
        for turn_deg in TOOL_ROTATIONS_DEG {
            let flange = controller_report(arm, &flange_pose_for_tip(place, turn_deg, sim::TOOL_LENGTH_MM))?;
            let _ = writeln!(text, "[[touches]]\nspot = {spot}\n{}", reported_text(&flange));
        }
    }
    Ok(text)
}

const TOOL_ROTATIONS_DEG: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [30.0, 0.0, 20.0], [-30.0, 10.0, 0.0], [0.0, 35.0, -40.0], [10.0, -35.0, 60.0]];

/// Force measurements of a compliant tool without contact, pointing down, at 45°, horizontal and up, for a payload of
/// 1.5 kg and a force zero of 0.4 N.
pub(super) const FORCE_TEXT: &str = "\
[[readings]]
base_from_flange = { x_mm = 520.0, y_mm = 30.0, z_mm = 450.0, a_deg = 0.0, b_deg = 180.0, c_deg = 0.0 }
force_n = -14.31

[[readings]]
base_from_flange = { x_mm = 520.0, y_mm = 30.0, z_mm = 450.0, a_deg = 0.0, b_deg = 135.0, c_deg = 0.0 }
force_n = -10.02

[[readings]]
base_from_flange = { x_mm = 520.0, y_mm = 30.0, z_mm = 450.0, a_deg = 0.0, b_deg = 90.0, c_deg = 0.0 }
force_n = 0.43

[[readings]]
base_from_flange = { x_mm = 520.0, y_mm = 30.0, z_mm = 450.0, a_deg = 0.0, b_deg = 45.0, c_deg = 0.0 }
force_n = 10.80
";

/// Returns the text of a poses file for the simulated tool: poses with its tip at a fixed point, and two poses with a
/// point 60 mm behind the tip at this fixed point. The numbers have two decimals, as on a pendant.
fn tip_text(arm: Option<&RealArm>) -> Result<String, Fault> {
    let held = |turn_deg: [f64; 3], out_mm: f64| -> Result<String, Fault> {
        let ReportedFlangePose { base_from_flange, joints } =
            controller_report(arm, &flange_pose_for_tip(Point::at(520.0, 30.0, 250.0), turn_deg, out_mm))?;
        let pose = KukaPose::from_rigid(&base_from_flange);
        let shown = |number: f64| (number * 100.0).round() / 100.0;
        let base_from_flange = KukaPose {
            x_mm: shown(pose.x_mm),
            y_mm: shown(pose.y_mm),
            z_mm: shown(pose.z_mm),
            a_deg: shown(pose.a_deg),
            b_deg: shown(pose.b_deg),
            c_deg: shown(pose.c_deg),
        };
        Ok(pose_keys(&ReportedFlange { base_from_flange, joints }))
    };
    let table = |name: &str, turn_deg: &[f64; 3], out_mm: f64| -> Result<String, Fault> {
        Ok(format!("[[{name}]]\n{}\n", held(*turn_deg, out_mm)?))
    };
    let behind_mm = sim::TOOL_LENGTH_MM - 60.0;
    let tip = TOOL_ROTATIONS_DEG.iter().map(|turn_deg| table("poses", turn_deg, sim::TOOL_LENGTH_MM));
    let axis = TOOL_ROTATIONS_DEG[..2].iter().map(|turn_deg| table("axis", turn_deg, behind_mm));
    tip.chain(axis).collect()
}

/// Diameter of the disc, mm; the default of a recipe.
pub const DISC_DIAMETER_MM: f64 = 30.0;
/// The simulated sander for the coupons, with an orbit of 5 mm.
pub const COUPON_TOOL: CouponTool = CouponTool {
    pad: PadWithDisc { radius_mm: DISC_DIAMETER_MM / 2.0, stiffness_n_mm3: 0.05 },
    orbit: Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 },
};
/// Preston's coefficient of the simulated disc, mm²/N, and its decay with the swept area, 1/mm².
const PRESTON_MM2_PER_N: f64 = 4e-4;
const DECAY_PER_MM2: f64 = 0.8e-6;
/// Maximum relative difference of a coupon's removal from the mean of its disc, to either side.
const MAX_RELATIVE_DIFFERENCE: f64 = 0.05;
/// Maximum relative difference of a disc's removal from the mean of all discs, to either side.
const MAX_DISC_DIFFERENCE: f64 = 0.03;
/// The names of the measured places on each coupon.
const MEASURED_PLACE_NAMES: [&str; 3] = ["left", "middle", "right"];
/// For each coupon, the force, N, and the area that its disc had already swept, mm²; each disc has two coupons.
const COUPONS: [(f64, f64); 8] = [
    (20.0, 0.0),
    (10.0, 390_000.0),
    (10.0, 130_000.0),
    (20.0, 260_000.0),
    (20.0, 390_000.0),
    (10.0, 0.0),
    (10.0, 260_000.0),
    (20.0, 130_000.0),
];

/// Writes `boards/coupons.csv`: thicknesses before and after sanding, with new and worn discs.
///
/// # Errors
/// If writing to the disk fails.
pub fn write_coupons(seed: u64, rendered: &RenderedFiles) -> Result<(), Fault> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut text = "# two forces, single lines, measured in their middle; worn_mm2 as `panelprep plan` reports \
                    it\ncoupon,place,disc,force_n,feed_mm_s,passes,worn_mm2,before_um,after_um\n"
        .to_owned();
    let discs: Vec<f64> = (0..COUPONS.len() / 2)
        .map(|_| 1.0 + random.random_range(-MAX_DISC_DIFFERENCE..MAX_DISC_DIFFERENCE))
        .collect();
    for index in 0..MEASURED_PLACE_NAMES.len() * COUPONS.len() {
        let number = index / MEASURED_PLACE_NAMES.len();
        // The forces are below and above the force in the recipe of the simulated cell.
        let (passes, (force_n, worn_mm2)) = ([1.0, 2.0, 4.0][index % 3], COUPONS[number]);
        let (name, disc, lines) = (format!("C{}", number + 1), format!("D{}", number / 2 + 1), Lines::One);
        let coupon = Coupon {
            line: 0,
            name,
            disc: Some(disc.clone()),
            force_n,
            feed_mm_s: 60.0,
            passes,
            lines,
            worn_mm2,
            depth_um: 0.0,
        };
        let own =
            discs[number / 2] * (1.0 + random.random_range(-MAX_RELATIVE_DIFFERENCE..MAX_RELATIVE_DIFFERENCE));
        let k = PRESTON_MM2_PER_N * (-DECAY_PER_MM2 * worn_mm2).exp();
        let depth_um = 1_000.0 * k * coupon.exposure_n_mm(&COUPON_TOOL) * own;
        let before_um = 120.0 + random.random_range(-2.0..2.0);
        let place = MEASURED_PLACE_NAMES[index % MEASURED_PLACE_NAMES.len()];
        let after_um = before_um - depth_um;
        #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
        let _ = writeln!(
            text,
            "{},{place},{disc},{force_n},60,{passes},{worn_mm2},{before_um:.2},{after_um:.2}",
            coupon.name
        );
    }
    Ok(disk::write(&rendered.file_path("boards/coupons.csv"), text)?)
}
