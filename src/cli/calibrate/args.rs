//! Options of `panelprep calibrate`: the board; the lens, the mount and the errors of the cameras; the errors of the
//! arm; the TCP, the force and the removal of the tool; the verification of calibrations with pictures and touches, and
//! striking out a verification.

use crate::cli::args::{Simulation, parse_non_empty};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// The calibration to perform or to verify.
#[derive(Debug, Clone, Args)]
pub struct Calibrate {
    /// The calibration.
    #[command(subcommand)]
    pub what: CalibrationTask,
}

/// The calibrations.
#[derive(Debug, Clone, Subcommand)]
pub enum CalibrationTask {
    /// Calibrate a camera lens from pictures of a board (thesis 3.6).
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  panelprep calibrate \
                            intrinsics --board 9x6 --square-mm 25 --out target/cell/found/flange_camera.toml \
                            --pictures target/cell/pictures target/cell/boards/lens/*.png\nExample, with twelve \
                            pictures that are taken now; without --count, one picture each time Enter is \
                            pressed, so that there is time to move the board:\n  panelprep calibrate intrinsics --live target/shots --count 12 \
                            --every-s 0 --camera flange-camera --board 9x6 --square-mm 25 --cell \
                            target/cell/cell.toml --out target/cell/found/flange_camera.toml")]
    Intrinsics(Intrinsics),
    /// Calibrate the mount of a camera (hand-eye), from three touched points (thesis 3.7) or from many poses.
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
    /// Calibrate the errors of the arm from pictures of boards and from touches; without axis angles, the result is a
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
    /// Calibrate the removal of the disc from measured depths on flat test coupons.
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
    /// Calibrate the errors of the 3D camera from scans of a flat board: noise, smooth errors, and the systematic
    /// error, which is equal in all scans and is subtracted from new scans.
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
    /// Calibrate the TCP and the axis of the tool, from poses with the tool's tip at one fixed point.
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate tcp --poses target/cell/boards/tip.toml --out target/cell/found/flange_from_tool.toml\n\
        With --live DIR the command asks for one pose after the other at the terminal and reads each pose from the controller.")]
    Tcp(Tcp),
    /// Calibrate payload and force zero of a compliant tool from its measurements without contact; with --verify, check
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
    /// Touch known corners of a fixed board with the calibrated tool and compare the positions; the result is stored.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep calibrate touch --cell target/cell/cell.toml --board 5x4 --square-mm 40 \
        --target target/cell/target/scanner.toml --points target/cell/target/touched.toml")]
    Touch(Touch),
    /// List the verifications by pictures and by touches in the store, with their numbers, including those that were
    /// struck out, with person and reason.
    #[command(after_help = "Example:\n  panelprep calibrate history --cell target/cell/cell.toml")]
    History,
    /// Strike out a wrong verification by picture or touch. It stays in the store with the person and the reason, but
    /// is no longer used. No older verification replaces it: verify again.
    #[command(
        after_help = "Example:\n  panelprep calibrate strike 3 --by \"A. Smith\" --why \"the board was moved\" \
        --cell target/cell/cell.toml"
    )]
    Strike(StrikeOut),
}

/// The board.
#[derive(Debug, Clone, Args)]
pub struct BoardArgs {
    /// The kind of board. Chessboard: inner corners, 9x6. ChArUco board: squares, charuco:8x6:15:4X4_50[:legacy].
    /// Circles: circles:7x11:40 (11 rows of 7 circles, 40 mm apart in both directions) or acircles:4x11:20 (11 rows of
    /// 4 circles, rows 20 mm apart, circles of a row 40 mm apart, each second row shifted by 20 mm).
    #[arg(long)]
    pub board: String,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM")]
    pub square_mm: Option<f64>,
    /// Half the side of the window in which a corner is refined, px; without this option, calculated from the distance
    /// between corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

/// The kind of board; optional if a file states it.
#[derive(Debug, Clone, Default, Args)]
pub struct NamedBoard {
    /// The kind of board. Chessboard: inner corners, 9x6. ChArUco board: squares, charuco:8x6:15:4X4_50[:legacy].
    /// Circles: circles:7x11:40 or acircles:4x11:20.
    #[arg(long)]
    pub board: Option<String>,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM", requires = "board")]
    pub square_mm: Option<f64>,
    /// Half the side of the window in which a corner is refined, px; without this option, calculated from the distance
    /// between corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

impl NamedBoard {
    /// Returns the board that the command line states; `None` if it states none.
    pub fn board(&self) -> Option<BoardArgs> {
        Some(BoardArgs { board: self.board.clone()?, square_mm: self.square_mm, subpix: self.subpix })
    }
}

impl From<BoardArgs> for NamedBoard {
    fn from(BoardArgs { board, square_mm, subpix }: BoardArgs) -> Self {
        NamedBoard { board: Some(board), square_mm, subpix }
    }
}

/// A camera of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraName {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    FlangeCamera,
}

/// Options of a calibration that captures its own pictures.
#[derive(Debug, Clone, Args)]
pub struct LiveArgs {
    /// Capture the pictures now with the cell's camera, and keep them and their poses in this folder. The command
    /// reports what each picture shows, and which picture to capture next.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// With --live: capture this number of pictures without asking; without this option, one each time Enter is
    /// pressed.
    #[arg(long, value_name = "N", requires = "live", value_parser = clap::value_parser!(u32).range(1..=60))]
    pub count: Option<u32>,
    /// With --count: the time between two pictures, s, in which a person moves the board to its next pose.
    #[arg(long, value_name = "S", requires = "count", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub every_s: u32,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

impl LiveArgs {
    /// Returns the options for a calibration from files.
    pub fn without_live() -> Self {
        LiveArgs { live: None, count: None, every_s: 0, simulation: Simulation::default() }
    }
}

/// The lens model, by its distortion coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelName {
    /// The simplest model that predicts excluded pictures as well as any other model does.
    Auto,
    /// No distortion.
    Pinhole,
    /// k1.
    K1,
    /// k1, k2.
    K1k2,
    /// The coefficients k1, k2, p1, p2.
    K1k2p1p2,
    /// The coefficients k1, k2, p1, p2, k3, the default of OpenCV.
    K1k2p1p2k3,
}

/// Options of `calibrate intrinsics`.
#[derive(Debug, Clone, Args)]
pub struct Intrinsics {
    /// The board.
    #[command(flatten)]
    pub board: NamedBoard,
    /// Compute the lens from a scan of the 3D camera itself, because each point of a scan is on the ray of its pixel.
    /// No board is needed.
    #[arg(long, value_name = "SCAN", conflicts_with_all = ["live", "images", "board", "model", "keep_all", "subpix"], required_unless_present = "board")]
    pub from_scan: Option<PathBuf>,
    /// The lens model. The default is auto, or k1k2p1p2k3 if --keep-all and --subpix select the behaviour of OpenCV. In
    /// every model, each pixel has exactly one ray.
    #[arg(long, value_enum)]
    pub model: Option<ModelName>,
    /// Do not exclude pictures because of their residuals.
    #[arg(long)]
    pub keep_all: bool,
    /// Serial number of the camera, which is written to the file.
    #[arg(long)]
    pub serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for a picture of the residuals.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Pictures of the board.
    #[arg(required_unless_present_any = ["live", "from_scan"], value_name = "IMAGE", conflicts_with = "live")]
    pub images: Vec<PathBuf>,
    /// With --live: the camera to calibrate.
    #[arg(long, value_enum, requires = "live")]
    pub camera: Option<CameraName>,
    /// Options for pictures that are captured now.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// How the camera is mounted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MountName {
    /// The camera is fixed in the cell.
    EyeToHand,
    /// The camera is mounted on the flange.
    EyeInHand,
}

/// Options of `calibrate hand-eye`.
#[derive(Debug, Clone, Args)]
pub struct HandEye {
    /// How the camera is mounted.
    #[arg(long, value_enum)]
    pub mount: MountName,
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The camera's intrinsics.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// Three points: the picture of the board, or the scan of the board by the 3D camera.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"], required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Three points: file with the positions at which the corners were touched.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"])]
    pub points: Option<PathBuf>,
    /// Many poses: file with the flange pose of each picture.
    #[arg(long, value_name = "FILE", requires = "images", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Many poses: file with the errors of the arm from `calibrate robot`, by which the poses are corrected.
    #[arg(long, value_name = "FILE", conflicts_with = "image")]
    pub robot: Option<PathBuf>,
    /// Many poses: the folder with the pictures.
    #[arg(long, value_name = "DIR", requires = "poses")]
    pub images: Option<PathBuf>,
    /// Many poses, fixed camera: a point of the panel in the robot's base, at which the uncertainty is stated.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub at_mm: Option<[f64; 3]>,
    /// Serial number of the camera, which is written to the file.
    #[arg(long)]
    pub serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for pictures; without this option, the folder of `--out`.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// With --live: move the arm automatically; each motion is checked as in `panelprep robot move-j`.
    #[arg(long, requires = "live")]
    pub r#move: bool,
    /// Options for pictures and poses that are captured now.
    #[command(flatten)]
    pub live: LiveArgs,
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let allowed = || "valid: three numbers in mm, such as 560,0,360".to_owned();
    <[f64; 3]>::try_from(numbers.map_err(|_| allowed())?).map_err(|_| allowed())
}

/// Options of `calibrate scanner`.
#[derive(Debug, Clone, Args)]
pub struct Scanner {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The lens file of the 3D camera, from `calibrate intrinsics` or from the camera itself.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// The file to write, with the lens and the errors; it may be the lens file itself.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for pictures of the result: the systematic error, and the remaining error in each part of the camera's
    /// picture.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Scans of the board.
    #[arg(required = true, value_name = "SCAN")]
    pub scans: Vec<PathBuf>,
}

/// Options of `calibrate robot`.
#[derive(Debug, Clone, Args)]
#[command(group(clap::ArgGroup::new("pictures of boards").required(true).multiple(true).args(["eye_to_hand", "eye_in_hand"])))]
pub struct Robot {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// File with the poses of the pictures of the fixed camera, with the board on the flange.
    #[arg(long, value_name = "POSES", requires = "scanner_lens")]
    pub eye_to_hand: Option<PathBuf>,
    /// The lens file of the fixed camera.
    #[arg(long, value_name = "FILE", requires = "eye_to_hand")]
    pub scanner_lens: Option<PathBuf>,
    /// File with the poses of the pictures of the flange camera, with a fixed board.
    #[arg(long, value_name = "POSES", requires = "flange_camera_lens")]
    pub eye_in_hand: Option<PathBuf>,
    /// The lens file of the flange camera.
    #[arg(long, value_name = "FILE", requires = "eye_in_hand")]
    pub flange_camera_lens: Option<PathBuf>,
    /// File with the poses in which the tool's tip touched points, or corners of fixed boards.
    #[arg(long, value_name = "FILE")]
    pub touches: Option<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Options of `calibrate tcp`.
#[derive(Debug, Clone, Args)]
pub struct Tcp {
    /// File with flange poses in which the tool's tip is at one fixed point, and poses that determine the axis.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Read the poses from the controller now, one each time Enter is pressed, and store them in this folder.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// The correction of the arm from `calibrate robot`; without this option, the correction that the cell file names.
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `calibrate force`.
#[derive(Debug, Clone, Args)]
pub struct Force {
    /// File with measurements without contact, each with the flange pose.
    #[arg(long, value_name = "FILE")]
    pub readings: PathBuf,
    /// Compare with payload_kg and zero_n of the cell file, and store the result: a cycle needs this verification each
    /// day.
    #[arg(long)]
    pub verify: bool,
}

/// Options of `calibrate removal`.
#[derive(Debug, Clone, Args)]
pub struct Removal {
    /// The CSV file with the measured depths.
    #[arg(value_name = "COUPONS.csv")]
    pub coupons: PathBuf,
    /// Diameter of the contact area of the disc, mm.
    #[arg(long, value_name = "MM", value_parser = parse_in_range::<2, 300>)]
    pub disc_diameter_mm: f64,
    /// Stiffness of the pad, N/mm³: its modulus divided by its thickness.
    #[arg(long, value_name = "N/MM3", value_parser = parse_stiffness)]
    pub pad_n_mm3: f64,
    /// Diameter of the orbit, mm; 0 for a disc that does not orbit.
    #[arg(long, value_name = "MM", value_parser = parse_in_range::<0, 50>)]
    pub orbit_mm: f64,
    /// Orbits of the disc per minute.
    #[arg(long, value_name = "N", value_parser = parse_in_range::<0, 100_000>)]
    pub orbit_rev_min: f64,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

fn parse_in_range<const LOW: i32, const HIGH: i32>(text: &str) -> Result<f64, String> {
    number(text, f64::from(LOW)..=f64::from(HIGH))
}

fn parse_stiffness(text: &str) -> Result<f64, String> {
    number(text, 1e-4..=1_000.0)
}

fn number(text: &str, allowed: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| allowed.contains(number));
    number.ok_or_else(|| format!("valid: a number from {} to {}", allowed.start(), allowed.end()))
}

/// Options of `calibrate verify`.
#[derive(Debug, Clone, Args)]
pub struct Verify {
    /// The camera to verify.
    #[arg(long, value_enum)]
    pub camera: CameraName,
    /// The kind of the fixed board; optional, because the file of `--target` states it.
    #[command(flatten)]
    pub board: NamedBoard,
    /// Instead of a board: the recipe of a panel at its nominal pose, whose first taught corner is used.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["board", "square_mm", "target", "learn"])]
    pub recipe: Option<PathBuf>,
    /// A picture of the target, or a scan of the 3D camera.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Capture the picture now with the cell's camera, and keep it in this folder; for the scanner, a 3D scan.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["image", "poses", "flange"])]
    pub live: Option<PathBuf>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
    /// Poses file with many pictures of a fixed board by the flange camera, in the same folder: shows the remaining
    /// error over the working volume, with a map.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["image", "flange", "recipe", "learn"])]
    pub poses: Option<PathBuf>,
    /// The flange pose of the picture, for the flange camera.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Option<PathBuf>,
    /// The target file with the known pose of the board.
    #[arg(long, value_name = "FILE")]
    pub target: Option<PathBuf>,
    /// Write the target file from this picture; use this immediately after the calibration.
    #[arg(long)]
    pub learn: bool,
    /// Folder for the trend of all verifications, and with --poses for the map.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `calibrate touch`.
#[derive(Debug, Clone, Args)]
pub struct Touch {
    /// The kind of the fixed board; optional, because the file of `--target` states it.
    #[command(flatten)]
    pub board: NamedBoard,
    /// The target file with the known pose of the board.
    #[arg(long, value_name = "FILE")]
    pub target: PathBuf,
    /// File with the positions of the TCP when it touched the corners, with the cell's own tool selected on the
    /// pendant. With p1_axes_deg = [A1, …, A6] the position is computed from the axis angles, the correction of the arm
    /// and the cell's tool; a cell with a correction needs the axis angles.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub points: Option<PathBuf>,
    /// Read the position of the TCP from the controller now, at one corner after the other, and keep the positions in
    /// this folder.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// Folder for a map of the remaining errors, and for the trend of all touches.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `calibrate strike`.
#[derive(Debug, Clone, Args)]
pub struct StrikeOut {
    /// Number of the verification in `panelprep calibrate history`.
    #[arg(value_name = "NUMBER")]
    pub number: i64,
    /// The person who strikes the verification out.
    #[arg(long, value_name = "NAME", value_parser = parse_non_empty)]
    pub by: String,
    /// The reason.
    #[arg(long, value_name = "TEXT", value_parser = parse_non_empty)]
    pub why: String,
}
