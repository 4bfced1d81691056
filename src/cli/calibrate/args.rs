//! Options of `panelprep calibrate`.

use super::super::args::Simulation;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What to calibrate, or to look at again.
#[derive(Debug, Clone, Args)]
pub struct Calibrate {
    /// The calibration.
    #[command(subcommand)]
    pub what: What,
}

/// The calibrations.
#[derive(Debug, Clone, Subcommand)]
pub enum What {
    /// The lens, from pictures of a board (thesis 3.6).
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate intrinsics --board 9x6 --square-mm 25 --out target/cell/found/flange_camera.toml \
        --pictures target/cell/pictures target/cell/boards/lens/*.png\n\
        Example, by twelve pictures that are taken now; without --count one at each Enter, which leaves the time to move the board:\n  \
        panelprep calibrate intrinsics --live target/shots --count 12 --every-s 0 --camera flange-camera --board 9x6 --square-mm 25 \
        --cell target/cell/cell.toml --out target/cell/found/flange_camera.toml")]
    Intrinsics(Intrinsics),
    /// Where a camera is mounted: from three touched points (thesis 3.7), or from many poses.
    #[command(
        after_help = "Example, three points, after `panelprep render --boards --out target/cell`; without --points it \
        writes the picture with the corners to touch:\n  \
        panelprep calibrate hand-eye --mount eye-to-hand --board 9x6 --square-mm 25 \
        --intrinsics target/cell/scanner.toml --image target/cell/boards/touched.png \
        --points target/cell/boards/touched.toml --out target/cell/found/base_from_camera.toml\n\
        Example, many poses:\n  \
        panelprep calibrate hand-eye --mount eye-in-hand --board 9x6 --square-mm 25 \
        --intrinsics target/cell/flange_camera.toml --poses target/cell/boards/flange/poses.toml \
        --images target/cell/boards/flange --out target/cell/found/flange_from_camera.toml\n\
        Example, by an arm that moves by itself from where it sees the board:\n  \
        panelprep calibrate hand-eye --live target/poses --move --count 14 --mount eye-in-hand --board 9x6 --square-mm 25 \
        --cell target/cell/cell.toml --intrinsics target/cell/flange_camera.toml --out target/cell/found/flange_from_camera.toml"
    )]
    HandEye(HandEye),
    /// The arm's own errors, from pictures of boards and from touches; without axis angles, a smooth correction.
    #[command(
        after_help = "The pictures lie in the folder of their poses file: [[poses]] with image, and base_from_flange, \
        axes_deg = [A1, …, A6], or both. Touches: [[touches]] with such a pose and spot = 0, 1, …, or corner = [COLUMN, ROW] of \
        the board that stands still before the camera on the flange, or with image = \"FILE\" beside, of the board that lies \
        still in that picture of the fixed camera: the camera and the tool are then tied to each other.\n\
        Example, after `panelprep render --boards --out target/cell`; that arm is good as it is:\n  \
        panelprep calibrate robot --board 9x6 --square-mm 25 --eye-in-hand target/cell/boards/flange/poses.toml \
        --flange-camera-lens target/cell/flange_camera.toml --out target/cell/found/robot.toml"
    )]
    Robot(Robot),
    /// What the disc takes off, from measured depths on flat test coupons.
    #[command(
        after_help = "COUPONS is a CSV file with one measured place a line; its first line names the columns, in any order:\n  \
        coupon        its name, and in the column place where on it (may be left out)\n  \
        force_n       force of the tool, N\n  \
        feed_mm_s     feed, mm/s\n  \
        passes        how often the disc passed\n  \
        step_over_mm  distance of the rows, mm, for a field of rows, measured as the mean over a row in its middle;\n                \
        empty, or no such column, for a single line, measured in its middle\n  \
        worn_mm2      what the disc had swept when it came there, mm², as `panelprep plan` tells it; a new disc has 0\n  \
        depth_um      what is gone, µm; or before_um and after_um, thickness before and after\n\
        Lines that begin with # are remarks. Six places at least, with loads and discs that differ: passes 1, 2 and 4, by a new disc \
        and by used ones. A coupon that the others contradict is named and stays in the fit: measure it again.\n\
        The stiffness of the pad is its modulus over its thickness: press the disc onto a scale, and divide the force by its area \
        and by the way.\n\
        Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate removal target/cell/boards/coupons.csv --disc-diameter-mm 30 --pad-n-mm3 0.05 --orbit-mm 5 \
        --orbit-rev-min 10000 --out target/cell/found/removal.toml"
    )]
    Removal(Removal),
    /// The 3D camera's own errors from scans of a flat board: noise, smooth errors, and what is the same in each scan, which is taken
    /// off from then on.
    #[command(after_help = "\
        Hold a stiff flat board in at least eight places of the working volume, sixteen are better: near and far, in the picture's \
        corners too, leant by up to 30° to all sides, and turned upright in half of them. `panelprep shoot scan --count 16` \
        takes them. The board's white rim must be seen. The numbers are kept in the lens's own file; teach no panel anew for them: \
        a taught scan of the same camera is corrected as well. Verify the camera again afterwards: its file has changed.\n\
        Example, after `panelprep render --board-scans 16 --scanner-error-mm 1 --out target/cell3`:\n  \
        panelprep calibrate scanner --intrinsics target/cell3/scanner.toml --board 8x6 --square-mm 30 --out target/cell3/scanner.toml \
        target/cell3/boards/scanner/*.pcd")]
    Scanner(Scanner),
    /// The tool's point, and its axis, from poses that hold the tip at one spot.
    #[command(after_help = "Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate tcp --poses target/cell/boards/tip.toml --out target/cell/found/flange_from_tool.toml\n\
        With --live DIR it asks for one pose after the other at the terminal and reads each from the controller.")]
    Tcp(Tcp),
    /// Payload and zero of a compliant tool, from its readings without contact; with --verify, whether they still hold.
    #[command(
        after_help = "The readings: [[readings]] with base_from_flange and force_n, at least three, with the tool pointing down, level and \
        up as far as the arm allows. For --verify one is enough.\n\
        Example, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate force --cell target/cell/cell.toml --readings target/cell/boards/force.toml"
    )]
    Force(Force),
    /// Look at a board that stands still and compare with where it is known to be; kept in the store.
    #[command(after_help = "Examples, after `panelprep render --out target/cell`; a cycle needs both:\n  \
        panelprep calibrate verify --cell target/cell/cell.toml --camera scanner --board 5x4 --square-mm 40 \
        --target target/cell/target/scanner.toml --image target/cell/target/scanner.png\n  \
        panelprep calibrate verify --cell target/cell/cell.toml --camera flange-camera --board 5x4 --square-mm 40 \
        --target target/cell/target/flange_camera.toml --image target/cell/target/flange_camera.png \
        --flange target/cell/target/flange.json --pictures target/cell/pictures\n\
        What is left over the working volume, after `panelprep render --boards --out target/cell`:\n  \
        panelprep calibrate verify --cell target/cell/cell.toml --camera flange-camera \
        --target target/cell/boards/flange/target.toml --poses target/cell/boards/flange/poses.toml \
        --pictures target/cell/pictures\n\
        By a taught corner, after the one of `panelprep teach --help`:\n  \
        panelprep calibrate verify --cell target/cell/cell.toml --camera flange-camera \
        --recipe target/cell/recipe.toml --image target/cell/taught_corner.png --flange target/cell/taught_flange.json\n\
        By a picture that is taken now:\n  \
        panelprep calibrate verify --cell target/cell/cell.toml --camera scanner --target target/cell/target/scanner.toml \
        --live target/shots")]
    Verify(Verify),
    /// Touch known corners of that board with the calibrated tool and compare; kept in the store.
    #[command(after_help = "Example, after `panelprep render --out target/cell`:\n  \
        panelprep calibrate touch --cell target/cell/cell.toml --board 5x4 --square-mm 40 \
        --target target/cell/target/scanner.toml --points target/cell/target/touched.toml")]
    Touch(Touch),
    /// List the looks and touches that the store keeps, with their numbers; those that were struck out, by whom and why.
    #[command(after_help = "Example:\n  panelprep calibrate history --cell target/cell/cell.toml")]
    History,
    /// Strike out a look or touch that says nothing of the calibration: it stays in the store, with who and why, and counts
    /// no more. An older one does not take its place: look or touch again.
    #[command(
        after_help = "Example:\n  panelprep calibrate strike 3 --by \"A. Smith\" --why \"the board was moved\" \
        --cell target/cell/cell.toml"
    )]
    Strike(StrikeOut),
}

/// The board.
#[derive(Debug, Clone, Args)]
pub struct BoardArgs {
    /// Inner corners of a chessboard, 9x6; squares of a ChArUco board, charuco:8x6:15:4X4_50[:legacy]; circles,
    /// circles:7x11:40 (7 in each of 11 rows, 40 mm apart both ways), acircles:4x11:20 (4 in each of 11 rows, rows 20 mm
    /// apart, circles of a row 40 mm, each second row shifted by 20 mm).
    #[arg(long)]
    pub board: String,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM")]
    pub square_mm: Option<f64>,
    /// Half the side of the window that refines a corner, px; without it, from the distance of corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

/// The board, where a file says it as well.
#[derive(Debug, Clone, Default, Args)]
pub struct NamedBoard {
    /// Inner corners of a chessboard, 9x6; squares of a ChArUco board, charuco:8x6:15:4X4_50[:legacy]; circles,
    /// circles:7x11:40 or acircles:4x11:20.
    #[arg(long)]
    pub board: Option<String>,
    /// Side of a square, mm; measure it over many squares. Not needed for circles.
    #[arg(long, value_name = "MM", requires = "board")]
    pub square_mm: Option<f64>,
    /// Half the side of the window that refines a corner, px; without it, from the distance of corners.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub subpix: Option<u32>,
}

impl NamedBoard {
    /// The board that the command names; `None` where it names none.
    pub fn named(&self) -> Option<BoardArgs> {
        Some(BoardArgs { board: self.board.clone()?, square_mm: self.square_mm, subpix: self.subpix })
    }
}

impl From<BoardArgs> for NamedBoard {
    fn from(BoardArgs { board, square_mm, subpix }: BoardArgs) -> Self {
        NamedBoard { board: Some(board), square_mm, subpix }
    }
}

/// The distortion coefficients of a lens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelName {
    /// The simplest one that foretells left-out pictures as well as any other.
    Auto,
    /// None.
    Pinhole,
    /// k1.
    K1,
    /// k1, k2.
    K1k2,
    /// k1, k2, p1, p2.
    K1k2p1p2,
    /// k1, k2, p1, p2, k3, as OpenCV has by default.
    K1k2p1p2k3,
}

/// Options of `calibrate intrinsics`.
#[derive(Debug, Clone, Args)]
pub struct Intrinsics {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The lens model; by default auto, and k1k2p1p2k3 where --keep-all and --subpix ask for what OpenCV does. Whatever it
    /// is, the lens has one ray for each pixel.
    #[arg(long, value_enum)]
    pub model: Option<ModelName>,
    /// Set no picture aside for its residuals.
    #[arg(long)]
    pub keep_all: bool,
    /// Serial number of the camera, for the file.
    #[arg(long)]
    pub serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for a picture of the residuals.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Pictures of the board.
    #[arg(required_unless_present = "live", value_name = "IMAGE", conflicts_with = "live")]
    pub images: Vec<PathBuf>,
    /// With --live: the camera.
    #[arg(long, value_enum, requires = "live")]
    pub camera: Option<CameraName>,
    /// Pictures that are taken now.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// Options of a calibration that takes its pictures itself.
#[derive(Debug, Clone, Args)]
pub struct LiveArgs {
    /// Take the pictures now, by the cell's camera, and keep them and their poses in this folder; it says what each shows and
    /// which one to take next.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// With --live: take so many pictures, and ask nobody; without it, one at each Enter.
    #[arg(long, value_name = "N", requires = "live", value_parser = clap::value_parser!(u32).range(1..=60))]
    pub count: Option<u32>,
    /// With --count: the time between two pictures, s, in which a person brings the board to its next place.
    #[arg(long, value_name = "S", requires = "count", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub every_s: u32,
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
}

impl LiveArgs {
    /// Nothing is taken now.
    pub fn none() -> Self {
        LiveArgs { live: None, count: None, every_s: 0, simulation: Simulation::default() }
    }
}

/// Where the camera sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MountName {
    /// Fixed in the cell.
    EyeToHand,
    /// On the flange.
    EyeInHand,
}

/// Options of `calibrate hand-eye`.
#[derive(Debug, Clone, Args)]
pub struct HandEye {
    /// Where the camera sits.
    #[arg(long, value_enum)]
    pub mount: MountName,
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The camera's intrinsics.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// Three points: the picture of the board, or the 3D camera's shot of it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"], required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Three points: where the corners were touched.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"])]
    pub points: Option<PathBuf>,
    /// Many poses: the flange's pose at each picture.
    #[arg(long, value_name = "FILE", requires = "images", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Many poses: the arm's own errors, as `calibrate robot` found them; the poses are corrected by them.
    #[arg(long, value_name = "FILE", conflicts_with = "image")]
    pub robot: Option<PathBuf>,
    /// Many poses: the folder of the pictures.
    #[arg(long, value_name = "DIR", requires = "poses")]
    pub images: Option<PathBuf>,
    /// Many poses, fixed camera: a point of the panel in the base, at which the uncertainty is stated.
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub at_mm: Option<[f64; 3]>,
    /// Serial number of the camera, for the file.
    #[arg(long)]
    pub serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for pictures; without it, the folder of `--out`.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// With --live: the arm moves by itself, each time through the gate of `panelprep robot move-j`.
    #[arg(long, requires = "live")]
    pub r#move: bool,
    /// Many poses that are taken now.
    #[command(flatten)]
    pub live: LiveArgs,
}

fn place(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let allowed = || "allowed are three numbers in mm, 560,0,360".to_owned();
    <[f64; 3]>::try_from(numbers.map_err(|_| allowed())?).map_err(|_| allowed())
}

/// Options of `calibrate robot`.
#[derive(Debug, Clone, Args)]
#[command(group(clap::ArgGroup::new("pictures of boards").required(true).multiple(true).args(["eye_to_hand", "eye_in_hand"])))]
pub struct Robot {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// Poses of the pictures of the fixed camera, the board on the flange.
    #[arg(long, value_name = "POSES", requires = "scanner_lens")]
    pub eye_to_hand: Option<PathBuf>,
    /// Intrinsics of the fixed camera.
    #[arg(long, value_name = "FILE", requires = "eye_to_hand")]
    pub scanner_lens: Option<PathBuf>,
    /// Poses of the pictures of the camera on the flange, the board standing still.
    #[arg(long, value_name = "POSES", requires = "flange_camera_lens")]
    pub eye_in_hand: Option<PathBuf>,
    /// Intrinsics of the camera on the flange.
    #[arg(long, value_name = "FILE", requires = "eye_in_hand")]
    pub flange_camera_lens: Option<PathBuf>,
    /// Poses in which the tip touched spots, or corners of boards that stand still.
    #[arg(long, value_name = "FILE")]
    pub touches: Option<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Options of `calibrate removal`.
#[derive(Debug, Clone, Args)]
pub struct Removal {
    /// Measured depths.
    #[arg(value_name = "COUPONS.csv")]
    pub coupons: PathBuf,
    /// Diameter of the disc's contact, mm.
    #[arg(long, value_name = "MM", value_parser = within::<2, 300>)]
    pub disc_diameter_mm: f64,
    /// Stiffness of the pad, N/mm³: its modulus over its thickness.
    #[arg(long, value_name = "N/MM3", value_parser = stiffness)]
    pub pad_n_mm3: f64,
    /// Diameter of the orbit, mm; 0 for a disc that does not orbit.
    #[arg(long, value_name = "MM", value_parser = within::<0, 50>)]
    pub orbit_mm: f64,
    /// Orbits a minute.
    #[arg(long, value_name = "N", value_parser = within::<0, 100_000>)]
    pub orbit_rev_min: f64,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

fn within<const LOW: i32, const HIGH: i32>(text: &str) -> Result<f64, String> {
    number(text, f64::from(LOW)..=f64::from(HIGH))
}

fn stiffness(text: &str) -> Result<f64, String> {
    number(text, 1e-4..=1_000.0)
}

fn number(text: &str, allowed: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| allowed.contains(number));
    number.ok_or_else(|| format!("allowed is a number from {} to {}", allowed.start(), allowed.end()))
}

/// Options of `calibrate scanner`.
#[derive(Debug, Clone, Args)]
pub struct Scanner {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The lens of the 3D camera, as `calibrate intrinsics` wrote it or the camera states it.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// The file to write: the lens and the errors; it may be the same.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Scans of the board.
    #[arg(required = true, value_name = "SCAN")]
    pub scans: Vec<PathBuf>,
}

/// Options of `calibrate tcp`.
#[derive(Debug, Clone, Args)]
pub struct Tcp {
    /// Flange poses that hold the tip at one spot, and those that tell the axis.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Read the poses from the controller now, one at each Enter, and keep them in this folder.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// The arm's correction, by `calibrate robot`; without it, the one that the cell's file names.
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of the force of a compliant tool.
#[derive(Debug, Clone, Args)]
pub struct Force {
    /// Readings without contact, each with the flange's pose.
    #[arg(long, value_name = "FILE")]
    pub readings: PathBuf,
    /// Compare with payload_kg and zero_n of the cell's file, and keep that in the store: a cycle needs it each day.
    #[arg(long)]
    pub verify: bool,
}

/// Which camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraName {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    FlangeCamera,
}

/// Options of `calibrate strike`.
#[derive(Debug, Clone, Args)]
pub struct StrikeOut {
    /// Its number in `panelprep calibrate history`.
    #[arg(value_name = "NUMBER")]
    pub number: i64,
    /// Who strikes it out.
    #[arg(long, value_name = "NAME", value_parser = said)]
    pub by: String,
    /// Why.
    #[arg(long, value_name = "TEXT", value_parser = said)]
    pub why: String,
}

fn said(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("must not be empty".to_owned()),
        text => Ok(text.to_owned()),
    }
}

/// Options of `calibrate verify`.
#[derive(Debug, Clone, Args)]
pub struct Verify {
    /// The camera to verify.
    #[arg(long, value_enum)]
    pub camera: CameraName,
    /// The board that stands still; the file of `--target` says which one it is, and the command may say so too.
    #[command(flatten)]
    pub board: NamedBoard,
    /// In place of a board: the recipe of a panel that stands at its nominal place, with its first taught corner.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["board", "square_mm", "target", "learn"])]
    pub recipe: Option<PathBuf>,
    /// A picture of the target, or the 3D camera's shot.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Take the picture now, by the cell's camera, and keep it in this folder; of the scanner a 3D shot.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["image", "poses", "flange"])]
    pub live: Option<PathBuf>,
    /// What a simulated cell shows.
    #[command(flatten)]
    pub simulation: Simulation,
    /// Many pictures of the still board by the camera on the flange, in this file's folder: what is left of the error over the
    /// working volume, with a map.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["image", "flange", "recipe", "learn"])]
    pub poses: Option<PathBuf>,
    /// The flange's pose at that picture, for the camera on the flange.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Option<PathBuf>,
    /// Where the board is known to be.
    #[arg(long, value_name = "FILE")]
    pub target: Option<PathBuf>,
    /// Write the target from this picture, right after calibrating.
    #[arg(long)]
    pub learn: bool,
    /// Folder for the trend of all verifications, and with --poses for the map.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `calibrate touch`.
#[derive(Debug, Clone, Args)]
pub struct Touch {
    /// The board; the file of `--target` says which one it is, and the command may say so too.
    #[command(flatten)]
    pub board: NamedBoard,
    /// Where the board is known to be.
    #[arg(long, value_name = "FILE")]
    pub target: PathBuf,
    /// Where the tool's tip was when it touched the corners, with the cell's own tool selected on the pendant. With
    /// p1_axes_deg = [A1, …, A6] the tip is computed from the axes, the arm's correction and the cell's tool; a cell with
    /// a correction needs them.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub points: Option<PathBuf>,
    /// Read where the tip is from the controller now, at one corner after the other, and keep it in this folder.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// Folder for a map of what is left, and the trend of all touches.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}
