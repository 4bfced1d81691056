//! Boards of the simulated cell as files: what its cameras are verified on, and with `--boards` what they are
//! calibrated by.

use super::args::Common;
use super::calibrate::args::{BoardArgs, CameraName, Touch, Verify};
use super::disk;
use super::fault::Fault;
use super::render::Rendered;
use crate::calib::Board;
use crate::cell::{BoardSize, MountedPose, TargetMount};
use crate::files;
use crate::geometry::{Base, Degrees, Flange, Frame, GrayPicture, KukaPose, PinholeCamera, Point, Rigid, Tool};
use crate::sim::{self, BoardCell, BoardPrint, BoardShot, RobotNoise};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::fmt::Write;

const TARGET: (&str, f64) = ("5x4", 40.0);
const POSES: usize = 15;
const LENS_PICTURES: usize = 25;
const ROBOT: RobotNoise = RobotNoise { shift_mm: 0.02, turn_deg: 0.005 };
const TOUCH_MM: f64 = 0.1;

impl Rendered {
    /// A look at this camera's target, as `panelprep calibrate verify` takes it.
    pub fn verification(&self, camera: CameraName) -> Verify {
        let (name, flange) = match camera {
            CameraName::Scanner => ("scanner", None),
            CameraName::FlangeCamera => ("flange_camera", Some(self.file("target/flange.json"))),
        };
        Verify {
            camera,
            board: target_board().into(),
            recipe: None,
            image: self.file(&format!("target/{name}.png")),
            flange,
            target: Some(self.file(&format!("target/{name}.toml"))),
            learn: false,
            pictures: None,
        }
    }

    /// A touch of the scanner's target, as `panelprep calibrate touch` takes it.
    pub fn touch(&self) -> Touch {
        Touch {
            board: target_board().into(),
            target: self.file("target/scanner.toml"),
            points: self.file("target/touched.toml"),
            pictures: None,
        }
    }

    /// The cell that these files describe.
    pub fn common(&self) -> Common {
        Common { cell: self.file("cell.toml"), store: None, json: false }
    }
}

fn target_board() -> BoardArgs {
    BoardArgs { board: TARGET.0.to_owned(), square_mm: Some(TARGET.1), subpix: None }
}

/// Writes the boards that the cameras are verified on: pictures, where each is known to stand, a touch.
///
/// # Errors
/// Where the disk refuses.
pub fn write_targets(cell: &sim::Cell, rendered: &Rendered) -> Result<(), Fault> {
    let (scanner, flange) = (cell.scanner_target(), cell.flange_target());
    for (name, target) in [("scanner", &scanner), ("flange_camera", &flange)] {
        save(rendered, &format!("target/{name}.png"), &target.picture)?;
        let mut known = MountedPose::<TargetMount>::of(KukaPose::from_rigid(&target.known_base_from_board));
        known.board = Some(BoardSize { board: TARGET.0.to_owned(), square_mm: TARGET.1 });
        disk::write(&rendered.file(&format!("target/{name}.toml")), known.to_toml())?;
    }
    let pose = KukaPose::from_rigid(&flange.base_from_flange);
    disk::write(&rendered.file("target/flange.json"), files::write_pose(&pose))?;
    let board = Board::parse(TARGET.0, TARGET.1).map_err(Fault::stage)?;
    let touched = |places: &[Point<_>]| cell.touched_target(&scanner, places);
    disk::write(&rendered.file("target/touched.toml"), points_text(&board, touched))
}

/// Writes what the cell is calibrated by, a folder for each: lens, both mounts, three points, tool.
///
/// # Errors
/// Where the disk refuses.
pub fn write(seed: u64, reduction: usize, rendered: &Rendered) -> Result<(), Fault> {
    let cell = BoardCell::new(seed, BoardPrint::chessboard(9, 6, 25.0), ROBOT).with_reduction(reduction);
    let board = Board::parse("9x6", 25.0).map_err(Fault::stage)?;
    let lens: Vec<BoardShot<crate::geometry::FlangeCamera>> = cell.lens_shots(&cell.flange_camera(), LENS_PICTURES);
    pictures(rendered, "lens", (&cell, &cell.flange_camera()), &lens)?;
    let (fixed, flange) = (cell.fixed_shots(POSES), cell.flange_shots(POSES));
    pictures(rendered, "fixed", (&cell, &cell.scanner()), &fixed)?;
    pictures(rendered, "flange", (&cell, &cell.flange_camera()), &flange)?;
    disk::write(&rendered.file("boards/fixed/poses.toml"), poses_text(&fixed))?;
    disk::write(&rendered.file("boards/flange/poses.toml"), poses_text(&flange))?;
    if let Some(shot) = fixed.first() {
        save(rendered, "boards/touched.png", &cell.picture(&cell.scanner(), shot))?;
        let base_from_board = cell.base_from_camera() * shot.camera_from_board;
        let touched = |places: &[Point<_>]| cell.touched(&base_from_board, places, TOUCH_MM);
        disk::write(&rendered.file("boards/touched.toml"), points_text(&board, touched))?;
    }
    disk::write(&rendered.file("boards/tip.toml"), tip_text())
}

fn save(rendered: &Rendered, name: &str, picture: &GrayPicture) -> Result<(), Fault> {
    disk::write(&rendered.file(name), files::write_gray_png(picture).map_err(Fault::stage)?)
}

fn file_of<C: Frame>(index: usize, _: &BoardShot<C>) -> String {
    format!("{:02}.png", index + 1)
}

fn pictures<C: Frame>(
    rendered: &Rendered,
    folder: &str,
    (cell, camera): (&BoardCell, &PinholeCamera),
    shots: &[BoardShot<C>],
) -> Result<(), Fault> {
    shots.par_iter().enumerate().try_for_each(|(index, shot)| {
        save(rendered, &format!("boards/{folder}/{}", file_of(index, shot)), &cell.picture(camera, shot))
    })
}

fn pose_text(pose: &KukaPose) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = pose;
    format!(
        "base_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, \
         c_deg = {c_deg:?} }}\n"
    )
}

fn poses_text<C: Frame>(shots: &[BoardShot<C>]) -> String {
    let pose = |(index, shot): (usize, &BoardShot<C>)| {
        let flange = pose_text(&KukaPose::from_rigid(&shot.base_from_flange));
        format!("[[poses]]\nimage = \"{}\"\n{flange}\n", file_of(index, shot))
    };
    shots.iter().enumerate().map(pose).collect()
}

/// A points file with the corners that the program asks to be touched.
fn points_text(board: &Board, touched: impl Fn(&[Point<crate::geometry::Board>]) -> Vec<Point<Base>>) -> String {
    let corners = board.corners_to_touch();
    let places: Vec<_> = corners.iter().filter_map(|&(column, row)| board.corner(column, row)).collect();
    let mut text = String::new();
    for (index, (place, (column, row))) in touched(&places).iter().zip(corners).enumerate() {
        let (number, [x, y, z]) = (index + 1, [place.mm.x, place.mm.y, place.mm.z]);
        // Writing to a `String` cannot fail.
        let _ = writeln!(text, "p{number}_mm = [{x:.3}, {y:.3}, {z:.3}]\np{number}_corner = [{column}, {row}]");
    }
    text
}

/// Poses that hold the simulated tool's tip at one spot, and two that hold a point 60 mm behind it there, as a teach
/// pendant shows them: to a hundredth.
fn tip_text() -> String {
    let spot: Rigid<Base, Tool> = Rigid::claim(Isometry3::translation(520.0, 30.0, 250.0));
    let held = |turn_deg: [f64; 3], out_mm: f64| {
        let down = UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(|deg| Degrees(deg).rad())));
        let turned: Rigid<Tool, Tool> = Rigid::claim(Isometry3::from_parts(Default::default(), turn * down));
        let flange_from_tool: Rigid<Flange, Tool> = Rigid::claim(Isometry3::translation(0.0, 0.0, out_mm));
        let pose = KukaPose::from_rigid(&(spot * turned * flange_from_tool.inverse()));
        let shown = |number: f64| (number * 100.0).round() / 100.0;
        pose_text(&KukaPose {
            x_mm: shown(pose.x_mm),
            y_mm: shown(pose.y_mm),
            z_mm: shown(pose.z_mm),
            a_deg: shown(pose.a_deg),
            b_deg: shown(pose.b_deg),
            c_deg: shown(pose.c_deg),
        })
    };
    let turns = [[0.0, 0.0, 0.0], [30.0, 0.0, 20.0], [-30.0, 10.0, 0.0], [0.0, 35.0, -40.0], [10.0, -35.0, 60.0]];
    let tip: String =
        turns.iter().map(|&turn| format!("[[poses]]\n{}\n", held(turn, super::render::TOOL_LENGTH_MM))).collect();
    let behind = super::render::TOOL_LENGTH_MM - 60.0;
    let axis: String = turns[..2].iter().map(|&turn| format!("[[axis]]\n{}\n", held(turn, behind))).collect();
    tip + &axis
}
