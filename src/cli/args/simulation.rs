//! The content of a simulated cell, and the arguments of the commands that simulate a cell.

use clap::{Args, ValueEnum};
use panelprep_devices::acf::PlannedToolFault;
use panelprep_devices::mock::FaultSpec;
use panelprep_sim::{RealArm, ScannerDistortion};
use std::path::PathBuf;

/// The scene in the simulated cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum SceneName {
    /// The correct panel, displaced from its nominal pose, with greasy spots.
    #[default]
    Good,
    /// The correct panel without grease.
    Clean,
    /// The fixture without a panel.
    NoPanel,
    /// Another panel.
    WrongPanel,
}

/// The content of a simulated cell; it has no effect on devices that are not simulated.
#[derive(Debug, Clone, Copy, Args)]
pub struct Simulation {
    /// Random seed of the simulated cell.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The content of the simulated cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// The number of the panel's displacement, for this seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub place: u32,
    /// Position error of the simulated arm at the tool, rms, mm; 0 is an arm with its nominal geometry.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
    /// Inject a fault of the simulated compliant tool during the path: NAME[=VALUE]@N, from the Nth waypoint in contact
    /// on, for example `silent@40`.
    #[arg(long, value_name = "FAULT")]
    pub tool_fault: Option<PlannedToolFault>,
    /// Number of parts that a simulated production line brings to the cell, with a request for a cycle for each part;
    /// requires [line] in the cell file.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub line_parts: u32,
}

impl Default for Simulation {
    fn default() -> Self {
        Simulation { seed: 1, scene: SceneName::Good, place: 0, arm_error_mm: 0.0, tool_fault: None, line_parts: 0 }
    }
}

/// Parses the position error of the simulated arm, mm.
pub(super) fn arm_error(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0 to 5 mm".to_owned();
    text.parse().ok().filter(|mm| (0.0..=5.0).contains(mm)).ok_or_else(allowed)
}

/// How difficult the films of a simulated cell are to evaluate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum FilmName {
    /// Constant light and no glints.
    Calm,
    /// The usual conditions in a good cell: some drift, glints, drops.
    #[default]
    Usual,
    /// Drift, flicker, a shadow, glints, drops, a dark or bright exposure, depending on the seed.
    Hard,
}

/// The tool that presses the disc on the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ToolName {
    /// A tool with its own force control, calibrated on coupons: the recipe states the required removal in µm.
    #[default]
    Compliant,
    /// A spring on the flange: the dwell time of the disc is uniform, and the removal is not known.
    Spring,
}

/// What is sanded on a grid that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TreatName {
    /// The whole grid.
    #[default]
    Grid,
    /// Only areas around the breaks.
    Break,
}

/// Options of `demo`.
#[derive(Debug, Clone, Args)]
pub struct Demo {
    /// Random seed of the simulated cell.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Scene of the simulated cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// Folder for pictures, files and the page.
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    pub out: PathBuf,
    /// Factor by which the pictures have fewer pixels in each direction; 1 is full size.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub reduction: u32,
    /// Position error of the simulated arm at the tool, rms, mm, which is calibrated before the cycle; 0 is an arm with
    /// its nominal geometry.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
    /// Calibrate cameras and tool, but not the errors of the arm.
    #[arg(long, requires = "arm_error_mm")]
    pub uncorrected: bool,
    /// The tool that presses the disc on the panel.
    #[arg(long, value_enum, default_value_t)]
    pub tool: ToolName,
    /// What is sanded on a grid that failed: `[treat] by` in the rendered recipe.
    #[arg(long, value_enum, default_value_t)]
    pub treat: TreatName,
    /// Inject a fault of the compliant tool during the path: NAME[=VALUE]@N, from the Nth waypoint in contact on, for
    /// example `silent@40`. The score then states how long the sander was on after the fault.
    #[arg(long, value_name = "FAULT", conflicts_with = "page")]
    pub tool_fault: Option<PlannedToolFault>,
    /// Record the cycle in a new file, for `panelprep replay` and Foxglove; at full size, a minute of film needs a
    /// gigabyte.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Instead of one cycle, serve the simulated cell with the operator's page until the command is interrupted; open
    /// the address in a browser on this computer.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:8090", conflicts_with = "record")]
    pub page: Option<std::net::SocketAddr>,
}

/// Options of `render`.
#[derive(Debug, Clone, Args)]
pub struct Render {
    /// Random seed of the simulated cell.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Scene of the simulated cell.
    #[arg(long, value_enum, default_value_t)]
    pub scene: SceneName,
    /// The number of the panel's displacement. With the same seed, each number is the same panel with the same grease,
    /// displaced differently. The data for teaching are the same for all numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub place: u32,
    /// Also write the drawing of the panel, drawing.stl, and a recipe for teaching the panel from the drawing.
    #[arg(long)]
    pub drawing: bool,
    /// Also write pictures of boards, poses and touched points, for `panelprep calibrate`.
    #[arg(long)]
    pub boards: bool,
    /// Number of additional scans of a board, for `panelprep calibrate scanner`.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub board_scans: u32,
    /// How difficult the films of the cell are to evaluate.
    #[arg(long, value_enum, default_value_t)]
    pub film: FilmName,
    /// Add a labelled set with this number of clips in `set`, for `panelprep inspect --truth`. Each clip has other
    /// grease, and every third clip is clean.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1_000))]
    pub clips: u32,
    /// Duration of a wet film, s.
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u32).range(5..=600))]
    pub seconds: u32,
    /// The folder to write; it must be empty, new, or written by `render`.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Factor by which the pictures have fewer pixels in each direction; 1 is full size.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub reduction: u32,
    /// Position error of the simulated arm at the tool, rms, mm; 0 is an arm with its nominal geometry.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub arm_error_mm: f64,
    /// Systematic error of the simulated 3D camera, mm: all its scans are bent by this amount in the same way.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = arm_error)]
    pub scanner_error_mm: f64,
}

/// Options of `mock-robot`.
#[derive(Debug, Clone, Args)]
pub struct MockRobot {
    /// Folder with CELLCMD.xml and CELLSTAT.xml; without this option, the shipped files with the cell's ports.
    #[arg(long, value_name = "DIR")]
    pub config: Option<PathBuf>,
    /// The faults to inject and their times: see below.
    #[arg(long, value_name = "SPEC")]
    pub fault: Option<FaultSpec>,
    /// Execute the controller's KRL programs instead of the built-in model: the shipped programs or, with a folder, its
    /// .src, .sub and .dat files. Each file in the folder replaces the shipped file with the same name. Parts of the
    /// programs that are not executed are listed.
    #[arg(long, value_name = "FOLDER")]
    pub programs: Option<Option<PathBuf>>,
    /// Address on which the mock controller listens.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    pub host: std::net::IpAddr,
}

/// Returns the systematic error of the simulated 3D camera; `None` if it has no error.
pub fn scanner_distortion(seed: u64, error_mm: f64) -> Option<ScannerDistortion> {
    (error_mm > 0.0).then(|| ScannerDistortion::new(seed, error_mm))
}

/// Returns the simulated arm for this seed; `None` if it has its nominal geometry.
pub fn real_arm(seed: u64, error_mm: f64) -> Option<RealArm> {
    (error_mm > 0.0).then(|| RealArm::new(seed, error_mm))
}
