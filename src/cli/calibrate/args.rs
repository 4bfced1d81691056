//! Options of `panelprep calibrate`.

mod board;
mod camera;
mod robot;
mod verification;

pub use board::{BoardArgs, NamedBoard};
pub use camera::{CameraName, HandEye, Intrinsics, LiveArgs, ModelName, MountName, Scanner};
pub use robot::{Force, Removal, Robot, Tcp};
pub use verification::{StrikeOut, Touch, Verify};

use clap::{Args, Subcommand};

/// The calibration to make, or to verify again.
#[derive(Debug, Clone, Args)]
pub struct Calibrate {
    /// The calibration.
    #[command(subcommand)]
    pub what: CalibrationTask,
}

/// The calibrations.
#[derive(Debug, Clone, Subcommand)]
pub enum CalibrationTask {
    /// Calibrate the lens from pictures of a board (thesis 3.6).
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  panelprep calibrate \
                            intrinsics --board 9x6 --square-mm 25 --out target/cell/found/flange_camera.toml \
                            --pictures target/cell/pictures target/cell/boards/lens/*.png\nExample, with twelve \
                            pictures that are taken now; without --count, one picture each time Enter is \
                            pressed, so that there is time to move the board:\n  panelprep calibrate intrinsics --live target/shots --count 12 \
                            --every-s 0 --camera flange-camera --board 9x6 --square-mm 25 --cell \
                            target/cell/cell.toml --out target/cell/found/flange_camera.toml")]
    Intrinsics(Intrinsics),
    /// Calibrate the mount of a camera (hand-eye): from three touched points (thesis 3.7), or from many poses.
    #[command(
        after_help = "Example, three points, after `panelprep render --boards --out target/cell`; without --points \
                      the command writes the picture with the corners to touch:\n  panelprep calibrate hand-eye --mount \
                      eye-to-hand --board 9x6 --square-mm 25 --intrinsics target/cell/scanner.toml --image \
                      target/cell/boards/touched.png --points target/cell/boards/touched.toml --out \
                      target/cell/found/base_from_camera.toml\nExample, many poses:\n  panelprep calibrate \
                      hand-eye --mount eye-in-hand --board 9x6 --square-mm 25 --intrinsics \
                      target/cell/flange_camera.toml --poses target/cell/boards/flange/poses.toml --images \
                      target/cell/boards/flange --out target/cell/found/flange_from_camera.toml\nExample, with an \
                      arm that moves by itself, from a pose that sees the board:\n  panelprep calibrate hand-eye \
                      --live target/poses --move --count 14 --mount eye-in-hand --board 9x6 --square-mm 25 --cell \
                      target/cell/cell.toml --intrinsics target/cell/flange_camera.toml --out \
                      target/cell/found/flange_from_camera.toml"
    )]
    HandEye(HandEye),
    /// Calibrate the arm's own errors from pictures of boards and from touches; without axis angles, the result is a
    /// smooth correction.
    #[command(after_help = "The pictures are in the folder of their poses file: [[poses]] with image, and \
                      base_from_flange, axes_deg = [A1, …, A6], or both. Touches: [[touches]] with such a pose and \
                      spot = 0, 1, …, or corner = [COLUMN, ROW] of the fixed board in front of the camera on the \
                      flange. With image = \"FILE\" as well, the corner is of the board at rest in that picture of \
                      the fixed camera: this connects the calibrations of camera and tool.\nExample, after \
                      `panelprep render --boards --out target/cell`; that arm needs no correction:\n  panelprep \
                      calibrate robot --board 9x6 --square-mm 25 --eye-in-hand \
                      target/cell/boards/flange/poses.toml --flange-camera-lens target/cell/flange_camera.toml \
                      --out target/cell/found/robot.toml")]
    Robot(Robot),
    /// Calibrate the removal by the disc from measured depths on flat test coupons.
    #[command(
        after_help = "COUPONS is a CSV file with one measured place per line; its first line names the columns, in \
                      any order:\n  coupon        its name; the column place states the position on the \
                      coupon (may be left out)\n  force_n       force of the tool, N\n  feed_mm_s     feed, mm/s\n  passes        how \
                      often the disc passed\n  disc          name of the disc; without this column the scatter from \
                      disc to disc is not known\n  step_over_mm  distance of the rows, mm, for an area of rows, \
                      measured as the mean over a row in its middle;\n                empty, or no such column, \
                      for a single line, measured in its middle\n  worn_mm2      area that the disc had swept \
                      before this place, mm², as `panelprep plan` reports it; a new disc has 0\n  depth_um      \
                      depth that was removed, µm; or before_um and after_um, thickness before and after\nLines \
                      that begin with # are comments. At least six places are needed, with different loads and \
                      discs: passes 1, 2 and 4, by a new disc and by used discs. A coupon that disagrees with the \
                      others is named and stays in the fit: measure this coupon again.\nThe stiffness of the pad is its \
                      modulus over its thickness: press the disc onto a scale, and divide the force by the disc's \
                      area and by the travel.\nExample, after `panelprep render --boards --out target/cell`:\n  \
                      panelprep calibrate removal target/cell/boards/coupons.csv --disc-diameter-mm 30 --pad-n-mm3 \
                      0.05 --orbit-mm 5 --orbit-rev-min 10000 --out target/cell/found/removal.toml"
    )]
    Removal(Removal),
    /// Calibrate the 3D camera's own errors from scans of a flat board: noise, smooth errors, and the systematic error,
    /// which is the same in each scan and is subtracted from later scans.
    #[command(after_help = "Hold a stiff flat board at eight or more places of the working volume, better at \
                            sixteen: near and far, also in the picture's corners, tilted by up to 30° to all \
                            sides, and turned upright in half of them. `panelprep shoot scan --count 16` takes the \
                            scans. The board's white rim must be visible. The result is stored in the lens's file. \
                            No panel must be taught again: a taught scan of the same camera is corrected as \
                            well. Verify the camera again afterwards: its file has changed.\nExample, after \
                            `panelprep render --board-scans 16 --scanner-error-mm 1 --out target/cell3`:\n  \
                            panelprep calibrate scanner --intrinsics target/cell3/scanner.toml --board 8x6 \
                            --square-mm 30 --out target/cell3/scanner.toml --pictures target/cell3/found \
                            target/cell3/boards/scanner/*.pcd")]
    Scanner(Scanner),
    /// Calibrate the tool's tip (TCP) and its axis from poses with the tip at one spot.
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate tcp --poses target/cell/boards/tip.toml --out target/cell/found/flange_from_tool.toml\n\
        With --live DIR the command asks for one pose after the other at the terminal and reads each pose from the controller.")]
    Tcp(Tcp),
    /// Calibrate payload and force zero of a compliant tool from its readings without contact; with --verify, check
    /// whether both are still valid.
    #[command(
        after_help = "The readings: [[readings]] with base_from_flange and force_n, at least three, with the tool pointing down, level and \
        up as far as the arm allows. For --verify one reading is enough.\n\
        Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate force --cell target/cell/cell.toml --readings target/cell/boards/force.toml"
    )]
    Force(Force),
    /// Measure a fixed board with a camera and compare the board's pose with its known pose; the result is stored.
    #[command(
        after_help = "Examples, after `panelprep render --out target/cell`; a cycle needs both:\n  panelprep \
                            calibrate verify --cell target/cell/cell.toml --camera scanner --board 5x4 --square-mm \
                            40 --target target/cell/target/scanner.toml --image target/cell/target/scanner.png\n  \
                            panelprep calibrate verify --cell target/cell/cell.toml --camera flange-camera --board \
                            5x4 --square-mm 40 --target target/cell/target/flange_camera.toml --image \
                            target/cell/target/flange_camera.png --flange target/cell/target/flange.json \
                            --pictures target/cell/pictures\nThe remaining error over the working volume, after \
                            `panelprep render --boards --out target/cell`:\n  panelprep calibrate verify --cell \
                            target/cell/cell.toml --camera flange-camera --target \
                            target/cell/boards/flange/target.toml --poses target/cell/boards/flange/poses.toml \
                            --pictures target/cell/pictures\nWith a taught corner, after the example of `panelprep \
                            teach --help`:\n  panelprep calibrate verify --cell target/cell/cell.toml --camera \
                            flange-camera --recipe target/cell/recipe.toml --image target/cell/taught_corner.png \
                            --flange target/cell/taught_flange.json\nWith a picture that is taken now:\n  \
                            panelprep calibrate verify --cell target/cell/cell.toml --camera scanner --target \
                            target/cell/target/scanner.toml --live target/shots"
    )]
    Verify(Verify),
    /// Touch known corners of a fixed board with the calibrated tool and compare; the result is stored.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep calibrate touch --cell target/cell/cell.toml --board 5x4 --square-mm 40 \
        --target target/cell/target/scanner.toml --points target/cell/target/touched.toml")]
    Touch(Touch),
    /// List the verifications by pictures and by touches in the store, with their numbers; also those that were
    /// struck out, by whom and why.
    #[command(after_help = "Example:\n  panelprep calibrate history --cell target/cell/cell.toml")]
    History,
    /// Strike out a wrong verification by picture or touch. It stays in the store with the person and the reason, but is
    /// no longer used. An older verification does not replace it: verify again.
    #[command(
        after_help = "Example:\n  panelprep calibrate strike 3 --by \"A. Smith\" --why \"the board was moved\" \
        --cell target/cell/cell.toml"
    )]
    Strike(StrikeOut),
}
