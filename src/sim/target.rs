//! The stationary boards in the cell, with which the cameras' calibrations are verified every day.
//!
//! There is one board for each camera. The stated poses of the boards contain the error of the pointer that touched
//! them.

use super::board::BoardPrint;
use super::cell::Cell;
use super::noise::{NormalStream, RandomPurpose};
use super::scene;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Board, Flange, Frame, GrayPicture, PinholeCamera, Point, Rigid};

/// Error of the touched position of a board along each axis, mm.
const TOUCH_NOISE_MM: f64 = 0.03;

/// A board in front of a camera.
#[derive(Debug, Clone)]
pub struct Target {
    /// Its true pose.
    pub base_from_board: Rigid<Base, Board>,
    /// Its known pose.
    pub known_base_from_board: Rigid<Base, Board>,
    /// The flange's pose at which the flange camera takes its picture; without meaning for the fixed camera.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The camera's picture of the board.
    pub picture: GrayPicture,
}

impl Target {
    /// The print of the board: 5 × 4 inner corners, squares of 40 mm.
    pub fn target_print() -> BoardPrint {
        BoardPrint::chessboard(5, 4, 40.0)
    }
}

impl Cell {
    /// The board beside the middle of the fixed camera's view, within reach of the arm that touches it.
    pub fn scanner_target(&self) -> Target {
        let camera_from_board = board_pose_at([120.0, 90.0, 690.0], [0.15, -0.2, 0.05]);
        let base_from_board = scene::base_from_camera() * camera_from_board;
        self.target(
            0,
            &self.scanner.0,
            &camera_from_board,
            (base_from_board, Rigid::from_isometry_unchecked(Isometry3::identity())),
        )
    }

    /// Returns the board that lies in the cell, seen by the flange camera above it.
    pub fn flange_target(&self) -> Target {
        let base_from_board: Rigid<Base, Board> =
            board_pose_at([540.0, 60.0, 200.0], [std::f64::consts::PI, 0.02, 0.0]);
        let camera_from_board = board_pose_at([10.0, -8.0, 470.0], [0.2, 0.15, 0.1]);
        let base_from_flange =
            base_from_board * camera_from_board.inverse() * scene::flange_from_camera().inverse();
        self.target(1, &self.flange_camera.0, &camera_from_board, (base_from_board, base_from_flange))
    }

    /// Returns points of a target's board as measured with the tool's tip, in the base.
    pub fn touched_target(&self, target: &Target, places: &[Point<Board>]) -> Vec<Point<Base>> {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::Touch, 2));
        let mut touch = |&place: &Point<Board>| {
            let noise = Vector3::from_fn(|_, _| normal.next()) * TOUCH_NOISE_MM;
            Point::new((target.base_from_board * place).mm + noise)
        };
        places.iter().map(&mut touch).collect()
    }

    fn target<C: Frame>(
        &self,
        index: u64,
        camera: &PinholeCamera,
        camera_from_board: &Rigid<C, Board>,
        (base_from_board, base_from_flange): (Rigid<Base, Board>, Rigid<Base, Flange>),
    ) -> Target {
        let mut normal = NormalStream::new(self.seed.stream(RandomPurpose::Touch, index));
        let off = Vector3::from_fn(|_, _| normal.next()) * TOUCH_NOISE_MM;
        let shot = self.seed.child(RandomPurpose::Touch, index);
        Target {
            base_from_board,
            known_base_from_board: Rigid::from_isometry_unchecked(
                Translation3::from(off) * base_from_board.isometry(),
            ),
            base_from_flange,
            picture: Target::target_print().picture(camera, camera_from_board, (&self.pixels, shot)),
        }
    }
}

/// Returns the board's pose with its middle at a position, rotated by a rotation vector, rad.
fn board_pose_at<To: Frame>(middle_mm: [f64; 3], turn: [f64; 3]) -> Rigid<To, Board> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
    let shift = Vector3::from(middle_mm) - turn * Target::target_print().centre().mm.coords;
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(shift), turn))
}
