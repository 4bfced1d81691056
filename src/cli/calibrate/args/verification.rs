//! Options for the verification of existing calibrations with pictures and touches, and for striking a verification
//! out.

use super::board::NamedBoard;
use super::camera::CameraName;
use crate::cli::args::{Simulation, parse_non_empty};
use clap::Args;
use std::path::PathBuf;

/// Options of `calibrate verify`.
#[derive(Debug, Clone, Args)]
pub struct Verify {
    /// The camera to verify.
    #[arg(long, value_enum)]
    pub camera: CameraName,
    /// The fixed board; the file of `--target` states its kind, and the command may also state it.
    #[command(flatten)]
    pub board: NamedBoard,
    /// Instead of a board: the recipe of a panel that is at its nominal pose, with its first taught corner.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["board", "square_mm", "target", "learn"])]
    pub recipe: Option<PathBuf>,
    /// A picture of the target, or the 3D camera's shot.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["poses", "live"])]
    pub image: Option<PathBuf>,
    /// Take the picture now, with the cell's camera, and keep it in this folder; for the scanner, a 3D shot.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["image", "poses", "flange"])]
    pub live: Option<PathBuf>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
    /// Many pictures of the board at rest by the camera on the flange, in this file's folder: shows the remaining
    /// error over the working volume, with a map.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["image", "flange", "recipe", "learn"])]
    pub poses: Option<PathBuf>,
    /// The flange's pose at the picture, for the camera on the flange.
    #[arg(long, value_name = "POSE.json")]
    pub flange: Option<PathBuf>,
    /// The known pose of the board.
    #[arg(long, value_name = "FILE")]
    pub target: Option<PathBuf>,
    /// Write the target from this picture, immediately after the calibration.
    #[arg(long)]
    pub learn: bool,
    /// Folder for the trend of all verifications, and with --poses for the map.
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
}

/// Options of `calibrate touch`.
#[derive(Debug, Clone, Args)]
pub struct Touch {
    /// The board; the file of `--target` states its kind, and the command may also state it.
    #[command(flatten)]
    pub board: NamedBoard,
    /// The known pose of the board.
    #[arg(long, value_name = "FILE")]
    pub target: PathBuf,
    /// The positions of the tool's tip when it touched the corners, with the cell's own tool selected on the pendant.
    /// With p1_axes_deg = [A1, …, A6] the tip is computed from the axes, the arm's correction and the cell's tool; a
    /// cell with a correction needs them.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub points: Option<PathBuf>,
    /// Read the tip's position from the controller now, at one corner after the other, and keep it in this folder.
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
