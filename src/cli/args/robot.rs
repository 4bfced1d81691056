//! Arguments of the commands that use single devices: `panelprep robot` and `panelprep shoot`.

use super::simulation::Simulation;
use super::storage::{parse_non_empty, parse_stage};
use clap::{Args, Subcommand, ValueEnum};
use panelprep_cell::cell::ProofStage;
use std::path::PathBuf;

/// Options of `robot`.
#[derive(Debug, Clone, Args)]
pub struct Robot {
    /// The function.
    #[command(subcommand)]
    pub function: RobotFunction,
}

/// The functions of thesis Table 3.1. Each function has its own epoch, and base, tool and speed are valid only within
/// the epoch.
#[derive(Debug, Clone, Subcommand)]
pub enum RobotFunction {
    /// get_current_state: show the state that the controller reports.
    State,
    /// move_j: move each axis to its angle.
    MoveJ {
        /// The name of a pose in the cell's [poses], or the six angles A1,…,A6 in degrees.
        #[arg(value_name = "NAME|A1,…,A6", allow_hyphen_values = true)]
        to: String,
        /// Speed of the axes, % of their maximum speed.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_speed_percent: u8,
    },
    /// move_lin: move the TCP in a straight line, which is divided into steps that are checked one by one.
    MoveLin {
        /// The target pose: X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        to: String,
        /// The base frame of the pose, for example the output of `locate`; without this option, the robot's own base.
        #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
        base: Option<String>,
        /// The TCP to use.
        #[arg(long, value_enum, default_value_t)]
        tool: TipName,
        /// Speed of the TCP, mm/s; at most the limit of the cell.
        #[arg(long, value_name = "MM/S", default_value_t = 50.0)]
        speed_mm_s: f64,
    },
    /// set_base: set a base and read it back.
    SetBase {
        /// The base frame: X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        base: String,
    },
    /// set_tcp: set a TCP and read it back.
    SetTcp {
        /// The TCP in the flange frame: X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        flange_from_tool: String,
    },
    /// set_acc_speed: set the speeds of subsequent motions in the same epoch; shows whether the controller accepts
    /// these speeds.
    SetSpeed {
        /// Speed of the TCP, mm/s; at most the limit of the cell.
        speed_mm_s: f64,
        /// Acceleration of the TCP, m/s².
        #[arg(long, value_name = "M/S2", default_value_t = 1.0)]
        acceleration_m_s2: f64,
        /// Speed of the axes, % of their maximum speed.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_percent: u8,
    },
    /// set_digout: switch an output if its interlocks are satisfied.
    SetOut {
        /// The name of the output in the cell's [io.outputs], for example `light`.
        name: String,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
        /// Time to wait before the epoch ends, s; the end of the epoch switches the tool off.
        #[arg(long, value_name = "SECONDS", default_value_t = 0)]
        keep_s: u16,
    },
    /// set_digin: set an input. Inputs of a KRC are read-only, so this is refused unless the cell's [io.mapped_inputs]
    /// names the input.
    SetIn {
        /// The number of the input on the controller.
        number: u16,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
    },
    /// call_subroutine: call a subroutine of the controller's own list.
    Call {
        /// The index of the subroutine in this list.
        index: u16,
    },
    /// Not one of the nine functions: guide a person through the acceptance tests of the controller that the
    /// installation page requires for a stage, and write a page to be signed. The command tests what a client can test,
    /// and asks the person for the rest; it causes no motion.
    Prove(Prove),
}

/// Options of `robot prove`.
#[derive(Debug, Clone, Args)]
pub struct Prove {
    /// The stage to be tested, A, B or C; the previous stage must be signed. Default: the first stage that `[robot]
    /// signed_stage` of the cell file does not state as signed.
    #[arg(long, value_name = "STAGE", value_parser = parse_stage)]
    pub stage: Option<ProofStage>,
    /// The HTML page to write. It must not exist yet, and is written again after each answer. With --sign: the existing
    /// page, which is not changed.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Store the signature of a page on which every test has passed, with the person and the date. No test is run, and
    /// no controller is needed. `[robot] signed_stage` is valid only after this signature.
    #[arg(long)]
    pub sign: bool,
    /// The person at the controller; with --sign: the person who signed the page.
    #[arg(long, value_name = "NAME", value_parser = parse_non_empty)]
    pub by: String,
}

/// The TCP that is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TipName {
    /// The flange itself.
    #[default]
    Flange,
    /// The calibrated frame of the flange camera.
    Camera,
    /// The calibrated TCP of the sanding tool.
    Sanding,
}

/// A signal's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OnOff {
    /// On.
    On,
    /// Off.
    Off,
}

/// The kind of picture or scan that `shoot` captures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shot {
    /// A 3D scan: an organised cloud as PCD and PLY, and its colours as PNG.
    Scan,
    /// A picture of the 3D camera's colour sensor in the light of the cell.
    Picture,
    /// A sequence of pictures of the 3D camera's colour sensor in the light of the cell.
    Film,
    /// A picture of the camera on the flange.
    Corner,
}

impl Shot {
    /// Returns whether the capture needs the light of the cell.
    pub fn needs_light(self) -> bool {
        matches!(self, Shot::Picture | Shot::Film)
    }

    /// Returns whether the capture is a 3D scan.
    pub fn is_scan(self) -> bool {
        self == Shot::Scan
    }
}

/// Options of `shoot`.
#[derive(Debug, Clone, Args)]
pub struct Shoot {
    /// What to capture.
    #[arg(value_enum)]
    pub what: Shot,
    /// Folder for the files.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of captures; a film is one capture.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub count: u32,
    /// Duration of a film, s.
    #[arg(long, default_value_t = 10.0, value_parser = film_seconds)]
    pub seconds: f64,
    /// Maximum number of pictures per second that are requested for a film.
    #[arg(long, value_name = "N", default_value_t = 5.0, value_parser = film_rate)]
    pub pictures_per_second: f64,
    /// Time at which the spray begins, s. Pictures from this time on are marked as taken under the spray, earlier
    /// pictures as dry.
    #[arg(long, value_name = "S")]
    pub spray_from_s: Option<f64>,
    /// Time from which the panel is wet, s. Pictures from this time on are marked as wet. Without this option, a film
    /// without spray is marked as wet from its start.
    #[arg(long, value_name = "S")]
    pub wet_from_s: Option<f64>,
    /// Settings of the simulated cell.
    #[command(flatten)]
    pub simulation: Simulation,
}

fn film_seconds(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0.1 to 600 s".to_owned();
    text.parse().ok().filter(|seconds| (0.1..=600.0).contains(seconds)).ok_or_else(allowed)
}

fn film_rate(text: &str) -> Result<f64, String> {
    let allowed = || "the limits are 0.1 to 60 per second".to_owned();
    text.parse().ok().filter(|rate| (0.1..=60.0).contains(rate)).ok_or_else(allowed)
}
