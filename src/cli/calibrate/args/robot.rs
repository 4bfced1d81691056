//! Options for calibrating the arm and its tool: the arm's errors, the tool's point and force, the removal by its
//! disc.

use super::board::BoardArgs;
use clap::Args;
use std::path::PathBuf;

/// Options of `calibrate robot`.
#[derive(Debug, Clone, Args)]
#[command(group(clap::ArgGroup::new("pictures of boards").required(true).multiple(true).args(["eye_to_hand", "eye_in_hand"])))]
pub struct Robot {
    /// The board.
    #[command(flatten)]
    pub board: BoardArgs,
    /// Poses for the pictures of the fixed camera, with the board on the flange.
    #[arg(long, value_name = "POSES", requires = "scanner_lens")]
    pub eye_to_hand: Option<PathBuf>,
    /// Intrinsics of the fixed camera.
    #[arg(long, value_name = "FILE", requires = "eye_to_hand")]
    pub scanner_lens: Option<PathBuf>,
    /// Poses for the pictures of the camera on the flange, with the board at rest.
    #[arg(long, value_name = "POSES", requires = "flange_camera_lens")]
    pub eye_in_hand: Option<PathBuf>,
    /// Intrinsics of the camera on the flange.
    #[arg(long, value_name = "FILE", requires = "eye_in_hand")]
    pub flange_camera_lens: Option<PathBuf>,
    /// Poses in which the tip touched spots, or corners of fixed boards.
    #[arg(long, value_name = "FILE")]
    pub touches: Option<PathBuf>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Options of `calibrate tcp`.
#[derive(Debug, Clone, Args)]
pub struct Tcp {
    /// Flange poses that hold the tip at one spot, and poses that determine the axis.
    #[arg(long, value_name = "FILE", required_unless_present = "live", conflicts_with = "live")]
    pub poses: Option<PathBuf>,
    /// Read the poses from the controller now, one each time Enter is pressed, and store them in this folder.
    #[arg(long, value_name = "DIR")]
    pub live: Option<PathBuf>,
    /// The arm's correction from `calibrate robot`; without this option, the correction that the cell's file names.
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
    /// Compare with payload_kg and zero_n of the cell's file, and store the result: a cycle needs this verification
    /// each day.
    #[arg(long)]
    pub verify: bool,
}

/// Options of `calibrate removal`.
#[derive(Debug, Clone, Args)]
pub struct Removal {
    /// The file of the measured depths.
    #[arg(value_name = "COUPONS.csv")]
    pub coupons: PathBuf,
    /// Diameter of the disc's contact, mm.
    #[arg(long, value_name = "MM", value_parser = parse_in_range::<2, 300>)]
    pub disc_diameter_mm: f64,
    /// Stiffness of the pad, N/mm³: its modulus divided by its thickness.
    #[arg(long, value_name = "N/MM3", value_parser = parse_stiffness)]
    pub pad_n_mm3: f64,
    /// Diameter of the orbit, mm; 0 for a disc that does not orbit.
    #[arg(long, value_name = "MM", value_parser = parse_in_range::<0, 50>)]
    pub orbit_mm: f64,
    /// Orbits a minute.
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
