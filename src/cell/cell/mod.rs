//! The cell: one TOML file for each robot cell, and the calibration files it names, checked like a recipe.
//!
//! It states what is connected, the arm's park pose, the names of inputs and outputs, which calibrations are valid,
//! and the limits for every panel. File names are relative to the cell file's folder. A file may omit what a command
//! does not need (offline work has no poses); the code that needs a missing value reports it. The caller reads the
//! files.
//!
//! This file joins the tables. It also contains `[limits]`, the values that are valid for every panel of the cell (a
//! recipe may override a number if its description states this), and `store`, the folder of the stored data with the
//! time for which clips and scans are kept in it.

mod arm;
mod arm_presets;
mod calibration;
mod devices;
mod lens;
mod listen;
mod names;
mod part;
mod proof_stage;
mod provenance;
mod robot_correction;
mod servers;
mod sparkplug;
mod tool;
mod zivid_settings;

#[cfg(test)]
mod tests;

pub use arm::{Arm, ArmModel, ArmTable, KeepOut};
pub use arm_presets::{ArmAxes, ArmGeometry, PRESETS, PerAxis, Preset};
pub use calibration::{
    FlangeCameraMount, Intrinsics, LensCovariance, MeasuredScanner, Mount, MountedPose, RoughMounts, ScannerMount,
    TargetMount, ToolMount,
};
pub use devices::{Camera, Gige, MockController, PIXEL_FORMATS, Robot, RobotKind, ZividCamera};
pub use lens::{LensExtent, SupportedArea};
pub use listen::{AnonymousAccess, OpcUa, Page};
pub use names::{Feedback, InputsOutputs, LINE_INPUTS, LOCAL_CONTROL, Line, LineSignal, Output, WARNING};
pub use part::{NameDemand, NameRule, PartNameError, PartRules};
pub use proof_stage::{ProofStage, SignedPage, Unsigned, UnsignedCause};
pub use provenance::{BoardSize, Date, Provenance};
pub use robot_correction::{
    CorrectionNumbers, GEOMETRY_NUMBERS, RemovalCalibration, RemovalNumbers, RobotCorrection, SMOOTH_NUMBERS,
};
pub use servers::{Broker, BrokerLogin, CellName, Office, PushSettings, WebFolder, authority};
pub use sparkplug::{BrokerTls, NodeCommands, SparkplugNode};
pub use tool::{CompliantTool, Tool, ToolAddress};
pub use zivid_settings::{MainsFrequency, ZividSettings, ZividUse};

use crate::accounts::Role;
use panelprep_base::config::{self, Problems, Section, settings};
use panelprep_base::geometry::{Base, Joints, Point};
use panelprep_base::number_text::list;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// `[calibration]`: the calibration files, each needed only by some commands.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CalibrationFiles {
    /// [`Intrinsics`] of the scanner's colour camera.
    pub scanner: Option<PathBuf>,
    /// [`Intrinsics`] of the flange camera.
    pub flange_camera: Option<PathBuf>,
    /// The [`ScannerMount`].
    pub base_from_camera: Option<PathBuf>,
    /// The [`FlangeCameraMount`].
    pub flange_from_camera: Option<PathBuf>,
    /// The [`ToolMount`].
    pub flange_from_tool: Option<PathBuf>,
    /// The [`RobotCorrection`], if the arm has one.
    pub robot_correction: Option<PathBuf>,
    /// The [`RemovalCalibration`], if a recipe states how much is to be removed.
    pub removal: Option<PathBuf>,
}

impl CalibrationFiles {
    /// Returns the files that are stated, each with its key.
    pub fn named_files(&self) -> Vec<(&'static str, &Path)> {
        let all = [
            ("scanner", &self.scanner),
            ("flange_camera", &self.flange_camera),
            ("base_from_camera", &self.base_from_camera),
            ("flange_from_camera", &self.flange_from_camera),
            ("flange_from_tool", &self.flange_from_tool),
            ("robot_correction", &self.robot_correction),
            ("removal", &self.removal),
        ];
        all.into_iter().filter_map(|(key, file)| Some((key, file.as_deref()?))).collect()
    }

    fn parse(folder: &Path, section: &Section<'_, '_>) -> Option<Self> {
        let file =
            |key| section.parse::<Option<String>>(key, (), Some(None)).map(|name| name.map(|n| folder.join(n)));
        let [scanner, flange_camera] = ["scanner", "flange_camera"].map(file);
        let [base_from_camera, flange_from_camera] = ["base_from_camera", "flange_from_camera"].map(file);
        let [flange_from_tool, robot_correction] = ["flange_from_tool", "robot_correction"].map(file);
        let removal = file("removal");
        section.finish();
        Some(CalibrationFiles {
            scanner: scanner?,
            flange_camera: flange_camera?,
            base_from_camera: base_from_camera?,
            flange_from_camera: flange_from_camera?,
            flange_from_tool: flange_from_tool?,
            robot_correction: robot_correction?,
            removal: removal?,
        })
    }
}

/// A checked cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    store: PathBuf,
    retention: Retention,
    record_key: Option<PathBuf>,
    socket: Option<PathBuf>,
    socket_role: Option<Role>,
    scanner: Camera<ZividCamera>,
    flange_camera: Camera<Gige>,
    robot: Robot,
    tool: Tool,
    poses: BTreeMap<String, Joints>,
    inputs_outputs: InputsOutputs,
    calibration: CalibrationFiles,
    limits: Limits,
    rough_mounts: RoughMounts,
    arm: Arm,
    page: Page,
    office: Option<Office>,
    push: Option<PushSettings>,
    sparkplug: Option<SparkplugNode>,
    opcua: OpcUa,
    line: Option<Line>,
    part: PartRules,
}

/// The keys at the top of a cell's file, by which it is distinguished from other files.
pub const CELL_KEYS: [&str; 21] = [
    "store",
    "socket",
    "socket_role",
    "scanner",
    "flange_camera",
    "robot",
    "tool",
    "poses",
    "io",
    "calibration",
    "limits",
    "rough",
    "arm",
    "keep_out",
    "page",
    "office",
    "push",
    "sparkplug",
    "opcua",
    "line",
    "part",
];

impl Cell {
    /// Checks the text of a cell's file; `file` is its name in messages, and relative names start at its folder.
    ///
    /// # Errors
    /// Every problem of the file with its line and key.
    pub fn check(file: &str, text: &str) -> Result<Self, Problems> {
        let folder = Path::new(file).parent().unwrap_or(Path::new(""));
        config::parse_file(file, text, |top| Self::parse(folder, top))
    }

    fn parse(folder: &Path, top: &Section<'_, '_>) -> Option<Self> {
        let store = parse_store(top);
        let socket = top.parse::<Option<String>>("socket", (), Some(None));
        let socket_role = top.parse::<Option<Role>>("socket_role", (), Some(None));
        let scanner = devices::parse_camera(folder, &top.section("scanner"), devices::zivid_kind(folder));
        let flange_camera = devices::parse_camera(folder, &top.section("flange_camera"), devices::GIGE);
        let robot = devices::parse_robot(&top.section("robot"));
        let tool = tool::parse_tool(&top.section("tool"));
        let poses = names::parse_poses(&top.section("poses"));
        let io = names::parse_io(&top.section("io"));
        let calibration = CalibrationFiles::parse(folder, &top.section("calibration"));
        let limits = parse_limits(&top.section("limits"));
        let rough = calibration::parse_rough(&top.section("rough"));
        let arm = arm::parse_arm(&top.section("arm"), &top.sections("keep_out"));
        let page = listen::parse_page(folder, &top.section("page"));
        let office = servers::parse_office(folder, &top.section("office"));
        let push = servers::parse_push(folder, &top.section("push"));
        let sparkplug = sparkplug::parse_sparkplug(folder, &top.section("sparkplug"));
        let opcua = listen::parse_opcua(folder, &top.section("opcua"));
        let line = names::parse_line(folder, &top.section("line"), io.as_ref());
        let part = part::parse_part(&top.section("part"));
        top.finish();
        let store = store?;
        let store_folder = folder.join(&store.folder);
        Some(Cell {
            opcua: opcua?.with_store_certificates(&store_folder),
            store: store_folder,
            retention: store.retention,
            record_key: store.record_key.map(|name| folder.join(name)),
            socket: socket?.map(|name| folder.join(name)),
            socket_role: socket_role?,
            scanner: scanner?,
            flange_camera: flange_camera?,
            robot: robot?,
            tool: tool?,
            poses: poses?,
            inputs_outputs: io?,
            calibration: calibration?,
            limits: limits?,
            rough_mounts: rough?,
            arm: arm?,
            page: page?,
            office: office?,
            push: push?,
            sparkplug: sparkplug?,
            line: line?,
            part: part?,
        })
    }

    /// Returns the folder of the store.
    pub fn store(&self) -> &Path {
        &self.store
    }

    /// Returns how long clips and scans are kept in the store.
    pub fn retention(&self) -> &Retention {
        &self.retention
    }

    /// Returns the file of the key that signs records, if the cell's file names one; else the key is a credential,
    /// or is in the store.
    pub fn record_key(&self) -> Option<&Path> {
        self.record_key.as_deref()
    }

    /// Returns the service's socket, if the file names one; else it is in the store.
    pub fn socket(&self) -> Option<&Path> {
        self.socket.as_deref()
    }

    /// Returns the role of the clients that may open the socket as members of its group; without a role they may
    /// request everything that the socket offers.
    pub fn socket_role(&self) -> Option<Role> {
        self.socket_role
    }

    /// Returns the fixed 3D camera.
    pub fn scanner(&self) -> &Camera<ZividCamera> {
        &self.scanner
    }

    /// Returns the camera on the flange; a device is a GigE Vision camera.
    pub fn flange_camera(&self) -> &Camera<Gige> {
        &self.flange_camera
    }

    /// Returns the robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Returns the device that presses the disc onto the panel.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// Returns the pose in which the arm is clear of the panel and of both cameras' view: a shot is made only from
    /// there.
    pub fn park_pose(&self) -> Option<Joints> {
        self.pose("park")
    }

    /// Returns a named pose.
    pub fn pose(&self, name: &str) -> Option<Joints> {
        self.poses.get(name).copied()
    }

    /// Returns all named poses.
    pub fn poses(&self) -> &BTreeMap<String, Joints> {
        &self.poses
    }

    /// Returns the names of the controller's outputs and inputs.
    pub fn inputs_outputs(&self) -> &InputsOutputs {
        &self.inputs_outputs
    }

    /// Returns the calibration files.
    pub fn calibration(&self) -> &CalibrationFiles {
        &self.calibration
    }

    /// Returns the poses of the cameras, measured by hand: a three-point calibration is compared with them.
    pub fn rough_mounts(&self) -> &RoughMounts {
        &self.rough_mounts
    }

    /// Returns the limits that apply to every panel.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Returns the arm and its keep-out boxes.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the destination of records, if one is set.
    pub fn office(&self) -> Option<&Office> {
        self.office.as_ref()
    }

    /// Returns the destination of signed records by HTTP, if one is set.
    pub fn push(&self) -> Option<&PushSettings> {
        self.push.as_ref()
    }

    /// Returns the operator's page.
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the cell as an edge node of MQTT Sparkplug, if it is one.
    pub fn sparkplug(&self) -> Option<&SparkplugNode> {
        self.sparkplug.as_ref()
    }

    /// Returns the OPC UA server.
    pub fn opcua(&self) -> &OpcUa {
        &self.opcua
    }

    /// Returns the tables of the plant's systems that the file names: the office, the MQTT broker, OPC UA clients.
    pub fn plant_tables(&self) -> Vec<&'static str> {
        let named = [
            ("[office]", self.office.is_some()),
            ("[opcua] listen", self.opcua.listen.is_some()),
            ("[sparkplug]", self.sparkplug.is_some()),
        ];
        named.into_iter().filter_map(|(table, is_named)| is_named.then_some(table)).collect()
    }

    /// Returns the handshake with a line by digital signals, if there is one.
    pub fn line(&self) -> Option<&Line> {
        self.line.as_ref()
    }

    /// Returns how a start must name its part.
    pub fn part(&self) -> &PartRules {
        &self.part
    }

    /// Returns the cell with its arm corrected by `correction`, which comes from the file that `[calibration]` names.
    #[must_use]
    pub fn with_arm_correction(self, correction: CorrectionNumbers) -> Self {
        Cell { arm: self.arm.with_correction(correction), ..self }
    }

    /// Adds the newest signed page of proofs in the store: without it, no stage of the controller counts as signed.
    #[must_use]
    pub fn with_signed_page(self, page: Option<SignedPage>) -> Self {
        Cell { robot: self.robot.with_signed_page(page), ..self }
    }
}

settings! {
    /// `[limits]`. The program sets the bounds of these limits: a cell may be stricter, never less strict.
    pub struct Limits {
        /// Maximum duration of motion that is sent and not yet executed, s: the motion that the arm can still make
        /// when the link fails.
        window_s: f64, 0.1..=1.0, default 1.0;
        /// Maximum number of commands that are sent and not yet executed.
        window_commands: usize, 5..=50, default 50;
        /// Minimum number of points that are queued before a path starts.
        min_points: usize, 2..=50, default 5;
        /// Time between heartbeats of the application, in both directions, ms.
        heartbeat_ms: usize, 10..=100, default 100;
        /// Time without a message after which PC and controller each stop if commands are queued, ms.
        watchdog_ms: usize, 40..=400, default 400;
        /// How long a localization may be used before Verify must renew it, s.
        token_s: f64, 10.0..=600.0, default 600.0;
        /// The time limit for a stop, after which it is a fault, s.
        stop_deadline_s: f64, 0.5..=10.0, default 10.0;
        /// How long the output `warning` of `[io.outputs]` is on before the first motion after a standstill, s.
        warning_s: f64, 0.5..=30.0, default 3.0;
        /// How long a film is watched after it is fully wet, s (ASTM F22: up to a minute); a recipe may override it.
        observation_s: f64, 5.0..=600.0, default 60.0;
        /// Area of broken film from which a grid fails, mm²; a recipe may override it.
        min_break_mm2: f64, 0.1..=10_000.0, default 5.0;
        /// Error at the tool that is used while not all parts of the error budget are measured, mm; stated, not
        /// measured.
        tool_error_mm: Option<f64>, 0.01..=20.0, default None;
        /// Largest error of the last verification of a calibration with which a cycle may start, mm.
        verify_limit_mm: f64, 0.05..=10.0, default 0.5;
        /// Maximum age of the last verification of a calibration with which a cycle may start, h.
        verify_max_age_h: f64, 0.1..=8_760.0, default 24.0;
        /// Lower corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_min_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Upper corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_max_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Longest distance from one waypoint to the next, mm.
        max_step_mm: f64, 1.0..=1_000.0, default 100.0;
        /// Largest rotation of the tool from one waypoint to the next, degrees.
        max_turn_deg: f64, 0.1..=180.0, default 15.0;
        /// Largest angle between the tool's axis and the direction in which it was taught, degrees.
        max_tilt_deg: f64, 1.0..=90.0, default 45.0;
        /// Highest speed of the tool's tip, mm/s.
        max_speed_mm_s: f64, 1.0..=2_000.0, default 250.0;
    }
}

/// The box that the tool's tip must not leave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// Lower corner, mm.
    pub min: Point<Base>,
    /// Upper corner, mm; it exceeds the lower corner in every axis.
    pub max: Point<Base>,
}

impl Workspace {
    /// Returns whether the box contains this point.
    pub fn contains(&self, point: Point<Base>) -> bool {
        (0..3).all(|axis| (self.min.mm[axis]..=self.max.mm[axis]).contains(&point.mm[axis]))
    }
}

impl Limits {
    /// Returns the box for waypoints, `box_min_mm` to `box_max_mm`; `None` if the file states none.
    pub fn workspace(&self) -> Option<Workspace> {
        let corner = |[x_mm, y_mm, z_mm]: [f64; 3]| Point::at(x_mm, y_mm, z_mm);
        Some(Workspace { min: corner(self.box_min_mm?), max: corner(self.box_max_mm?) })
    }
}

fn parse_limits(section: &Section<'_, '_>) -> Option<Limits> {
    let limits = Limits::parse(section)?;
    let mut wrong = Vec::new();
    if limits.min_points > limits.window_commands {
        let (found, allowed) = (limits.min_points, limits.window_commands);
        wrong.push(("min_points", format!("found {found}, the limit is window_commands, {allowed}")));
    }
    if limits.watchdog_ms < 2 * limits.heartbeat_ms {
        let (found, allowed) = (limits.watchdog_ms, 2 * limits.heartbeat_ms);
        wrong.push(("watchdog_ms", format!("found {found}, the minimum is {allowed}, twice heartbeat_ms")));
    }
    match (limits.box_min_mm, limits.box_max_mm) {
        (Some(low), Some(high)) if (0..3).any(|axis| low[axis] >= high[axis]) => {
            wrong.push((
                "box_max_mm",
                format!("{} must exceed box_min_mm {} in every axis", list(&high), list(&low)),
            ));
        }
        (Some(_), None) => wrong.push(("box_max_mm", "is missing; box_min_mm is given".to_owned())),
        (None, Some(_)) => wrong.push(("box_min_mm", "is missing; box_max_mm is given".to_owned())),
        _ => {}
    }
    wrong.iter().for_each(|(key, message)| section.problem(key, message));
    wrong.is_empty().then_some(limits)
}

/// The time for which clips and scans of a class of cycles are kept; an absent value sets no limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RetentionTime {
    /// Number of days before the newest cycle's end.
    pub days: Option<usize>,
    /// Number of newest cycles.
    pub cycles: Option<usize>,
}

/// `[store.keep]`: how long clips and scans are kept. Pages, records and taught data are kept for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retention {
    /// The limit for cycles that passed.
    pub passed: RetentionTime,
    /// The limit for cycles that ended otherwise.
    pub failed: RetentionTime,
}

impl Retention {
    /// Returns whether no file is ever removed.
    pub fn is_unlimited(&self) -> bool {
        *self == Retention::default()
    }
}

const DAYS: std::ops::RangeInclusive<usize> = 1..=36_500;
const CYCLES: std::ops::RangeInclusive<usize> = 1..=1_000_000;

/// `[store]`.
struct StoreTable {
    /// Its folder.
    pub folder: String,
    /// How long clips and scans are kept.
    pub retention: Retention,
    /// The file of the key that signs records; `None` if the key is in the folder.
    pub record_key: Option<String>,
}

/// Reads `store = "folder"`, or `[store]` with `folder`, `record_key` and `keep`.
fn parse_store(top: &Section<'_, '_>) -> Option<StoreTable> {
    let default = || Some("store".to_owned());
    if !top.is_table("store") {
        let folder = top.parse::<String>("store", (), default())?;
        return Some(StoreTable { folder, retention: Retention::default(), record_key: None });
    }
    let section = top.section("store");
    let folder = section.parse::<String>("folder", (), default());
    let record_key = section.parse::<Option<String>>("record_key", (), Some(None));
    let keep = parse_retention(&section.section("keep"));
    section.finish();
    Some(StoreTable { folder: folder?, retention: keep?, record_key: record_key? })
}

fn parse_retention(section: &Section<'_, '_>) -> Option<Retention> {
    let [days, failed_days] =
        ["days", "failed_days"].map(|key| section.parse::<Option<usize>>(key, DAYS, Some(None)));
    let [cycles, failed_cycles] =
        ["cycles", "failed_cycles"].map(|key| section.parse::<Option<usize>>(key, CYCLES, Some(None)));
    section.finish();
    let passed = RetentionTime { days: days?, cycles: cycles? };
    let failed = RetentionTime { days: failed_days?, cycles: failed_cycles? };
    let mut right = true;
    for (key, of, min) in
        [("failed_days", failed.days, passed.days), ("failed_cycles", failed.cycles, passed.cycles)]
    {
        if let (Some(found), Some(min)) = (of, min)
            && found < min
        {
            let name = key.trim_start_matches("failed_");
            section.problem(
                key,
                format!(
                    "found {found}, the minimum is {min}, the value of {name}: the data of failed cycles must be \
                     kept at least as long"
                ),
            );
            right = false;
        }
    }
    right.then_some(Retention { passed, failed })
}
