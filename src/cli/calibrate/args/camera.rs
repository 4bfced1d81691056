//! Options of the camera calibrations: the lens, the mount, the errors of a 3D camera.

use super::board::{BoardArgs, NamedBoard};
use crate::cli::args::Simulation;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Which camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraName {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    FlangeCamera,
}

/// Options of a calibration that takes its own pictures.
#[derive(Debug, Clone, Args)]
pub struct LiveArgs {
    /// Take the pictures now, with the cell's camera, and keep them and their poses in this folder. The command
    /// reports what each picture shows and which picture to take next.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// With --live: take this number of pictures without asking; without this option, one each time Enter is pressed.
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
    /// Returns arguments without live pictures.
    pub fn without_live() -> Self {
        LiveArgs { live: None, count: None, every_s: 0, simulation: Simulation::default() }
    }
}

/// The distortion coefficients of a lens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelName {
    /// The simplest model that predicts left-out pictures as well as any other model.
    Auto,
    /// No distortion.
    Pinhole,
    /// k1.
    K1,
    /// k1, k2.
    K1k2,
    /// k1, k2, p1, p2.
    K1k2p1p2,
    /// k1, k2, p1, p2, k3, as in OpenCV by default.
    K1k2p1p2k3,
}

/// Options of `calibrate intrinsics`.
#[derive(Debug, Clone, Args)]
pub struct Intrinsics {
    /// The board.
    #[command(flatten)]
    pub board: NamedBoard,
    /// Read the lens from a scan of the 3D camera itself: each point of the scan lies on the ray of its pixel. No
    /// board is needed.
    #[arg(long, value_name = "SCAN", conflicts_with_all = ["live", "images", "board", "model", "keep_all", "subpix"], required_unless_present = "board")]
    pub from_scan: Option<PathBuf>,
    /// The lens model; by default auto, and k1k2p1p2k3 if --keep-all and --subpix request what OpenCV does. With
    /// any model, the lens has one ray for each pixel.
    #[arg(long, value_enum)]
    pub model: Option<ModelName>,
    /// Do not exclude pictures because of their residuals.
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
    #[arg(required_unless_present_any = ["live", "from_scan"], value_name = "IMAGE", conflicts_with = "live")]
    pub images: Vec<PathBuf>,
    /// With --live: the camera.
    #[arg(long, value_enum, requires = "live")]
    pub camera: Option<CameraName>,
    /// Pictures that are taken now.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// How the camera is mounted.
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
    /// How the camera is mounted.
    #[arg(long, value_enum)]
    pub mount: MountName,
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// The camera's intrinsics.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// Three points: the picture of the board, or the 3D camera's shot of the board.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"], required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Three points: the positions at which the corners were touched.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["poses", "live"])]
    pub points: Option<PathBuf>,
    /// Many poses: the flange's pose at each picture.
    #[arg(long, value_name = "FILE", requires = "images", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Many poses: the file with the arm's own errors from `calibrate robot`, with which the poses are corrected.
    #[arg(long, value_name = "FILE", conflicts_with = "image")]
    pub robot: Option<PathBuf>,
    /// Many poses: the folder of the pictures.
    #[arg(long, value_name = "DIR", requires = "poses")]
    pub images: Option<PathBuf>,
    /// Many poses, fixed camera: a point of the panel in the base, at which the uncertainty is stated.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub at_mm: Option<[f64; 3]>,
    /// Serial number of the camera, for the file.
    #[arg(long)]
    pub serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Folder for pictures; without this option, the folder of `--out`.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// With --live: the arm moves automatically, each time through the gate of `panelprep robot move-j`.
    #[arg(long, requires = "live")]
    pub r#move: bool,
    /// Many poses that are taken now.
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
    /// The lens of the 3D camera, as written by `calibrate intrinsics` or as stated by the camera.
    #[arg(long, value_name = "FILE")]
    pub intrinsics: PathBuf,
    /// The file to write, with the lens and the errors; it may be the same as the lens's file.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Write a picture of the result: the error that is the same in each scan, and the remaining error in each part
    /// of the camera's picture.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Scans of the board.
    #[arg(required = true, value_name = "SCAN")]
    pub scans: Vec<PathBuf>,
}
