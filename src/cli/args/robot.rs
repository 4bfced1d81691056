//! Arguments of the commands on single devices: `panelprep robot` and `panelprep shoot`.

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

/// The functions of thesis Table 3.1. Each function has its own epoch: base, tool and speed are valid only within
/// this epoch.
#[derive(Debug, Clone, Subcommand)]
pub enum RobotFunction {
    /// get_current_state: the state that the controller reports.
    State,
    /// move_j: moves each axis to its angle.
    MoveJ {
        /// A name of the cell's [poses], or the six angles A1,…,A6 in degrees.
        #[arg(value_name = "NAME|A1,…,A6", allow_hyphen_values = true)]
        to: String,
        /// Share of the axes' full speed, %.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_speed_percent: u8,
    },
    /// move_lin: moves the tip in a straight line, which is divided into steps that the gate checks.
    MoveLin {
        /// X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        to: String,
        /// The base in which the pose is given, for example the output of `locate`; without this option the robot's
        /// own base.
        #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
        base: Option<String>,
        /// The point that is used as the tip.
        #[arg(long, value_enum, default_value_t)]
        tool: TipName,
        /// Speed of the tip, mm/s; at most the limit of the cell.
        #[arg(long, value_name = "MM/S", default_value_t = 50.0)]
        speed_mm_s: f64,
    },
    /// set_base: sets a base and reads it back.
    SetBase {
        /// X,Y,Z,A,B,C in mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        base: String,
    },
    /// set_tcp: sets a tool and reads it back.
    SetTcp {
        /// X,Y,Z,A,B,C of the tip in the flange, mm and degrees, or a POSE.json.
        #[arg(value_name = "POSE", allow_hyphen_values = true)]
        flange_from_tool: String,
    },
    /// set_acc_speed: sets the speeds of later motions in the same epoch; shows whether the controller accepts
    /// these speeds.
    SetSpeed {
        /// Speed of the tip, mm/s; at most the limit of the cell.
        speed_mm_s: f64,
        /// Acceleration of the tip, m/s².
        #[arg(long, value_name = "M/S2", default_value_t = 1.0)]
        acceleration_m_s2: f64,
        /// Share of the axes' full speed, %.
        #[arg(long, value_name = "PERCENT", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=100))]
        axis_percent: u8,
    },
    /// set_digout: switches an output, named as in the cell's [io.outputs], if its interlocks are satisfied.
    SetOut {
        /// The name of the output, for example `light`.
        name: String,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
        /// Time to wait before the epoch ends; the end of the epoch switches the tool off.
        #[arg(long, value_name = "SECONDS", default_value_t = 0)]
        keep_s: u16,
    },
    /// set_digin: refused, because inputs of a KRC are read-only, unless the cell's [io.mapped_inputs] names the
    /// input.
    SetIn {
        /// The number of the input.
        number: u16,
        /// On or off.
        #[arg(value_enum)]
        value: OnOff,
    },
    /// call_subroutine: calls a subroutine of the controller's own list.
    Call {
        /// The index of the subroutine in that list.
        index: u16,
    },
    /// Not one of the nine functions: goes through the proofs that the installation page requires on the controller for
    /// a stage, and writes a page to sign. It tests what a client can test and asks the person for the rest; it causes
    /// no motion.
    Prove(Prove),
}

/// Options of `robot prove`.
#[derive(Debug, Clone, Args)]
pub struct Prove {
    /// The stage to be proven, A, B or C; the stage before it must be signed. By default the first stage that
    /// `[robot] signed_stage` of the cell's file does not state as signed.
    #[arg(long, value_name = "STAGE", value_parser = parse_stage)]
    pub stage: Option<ProofStage>,
    /// The page to write, HTML; it must not exist yet, and is written again after each answer. With --sign the page
    /// that was written, which is not changed.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Store the signature of a page on which every row is proven, with the person and the date. No test is run, and no
    /// controller is needed. `[robot] signed_stage` is valid only after this.
    #[arg(long)]
    pub sign: bool,
    /// The person at the controller; with --sign the person who signed the page.
    #[arg(long, value_name = "NAME", value_parser = parse_non_empty)]
    pub by: String,
}

/// The point that is used as the tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum TipName {
    /// The flange itself.
    #[default]
    Flange,
    /// The flange camera, as calibrated.
    Camera,
    /// The sanding tool, as calibrated.
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

/// Kinds of shots that `shoot` can take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shot {
    /// A 3D scan: organised PCD and PLY, and its colours as PNG.
    Scan,
    /// A picture by the 3D camera's colour sensor, under the cell's own light.
    Picture,
    /// A sequence of pictures by the 3D camera's colour sensor, under the cell's own light.
    Film,
    /// A picture by the camera on the flange.
    Corner,
}

impl Shot {
    /// Returns whether the shot is taken under the cell's own light.
    pub fn needs_light(self) -> bool {
        matches!(self, Shot::Picture | Shot::Film)
    }

    /// Returns whether the shot is a 3D scan.
    pub fn is_scan(self) -> bool {
        self == Shot::Scan
    }
}

/// Options of `shoot`.
#[derive(Debug, Clone, Args)]
pub struct Shoot {
    /// The kind of shot.
    #[arg(value_enum)]
    pub what: Shot,
    /// Folder for the files.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of shots, one after the other; a film counts as one.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub count: u32,
    /// Length of a film, s.
    #[arg(long, default_value_t = 10.0, value_parser = film_seconds)]
    pub seconds: f64,
    /// Maximum number of pictures per second that are requested for a film.
    #[arg(long, value_name = "N", default_value_t = 5.0, value_parser = film_rate)]
    pub pictures_per_second: f64,
    /// Time at which the spray begins, s: pictures from this time on are marked as taken under the spray, earlier
    /// pictures as dry.
    #[arg(long, value_name = "S")]
    pub spray_from_s: Option<f64>,
    /// Time from which the panel is wet, s: pictures from this time on are marked as wet. Without this option, a film
    /// without spray is marked as wet from its beginning.
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
