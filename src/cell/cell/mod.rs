//! The cell: one TOML file for each robot cell, and the calibration files that it names. Both are checked when they are
//! read.
//!
//! The file states the connected devices, the arm's park pose, the names of inputs and outputs, the valid calibrations,
//! and the limits for every panel. File names are relative to the folder of the cell's file. A file may omit values
//! that a command does not need (offline commands need no poses); the code that needs a missing value reports it. This
//! module only parses text; the caller reads the files.
//!
//! This file joins the tables. It also contains two of them: `[limits]`, the values for every panel of the cell (a
//! recipe may override a value if its description states this), and `store`, the folder of the stored data and how long
//! clips and scans are kept.

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
pub use part::{NameDemand, NameRule, PartNameError, PartRules, check_serial_form};
pub use proof_stage::{ProofStage, SignedPage, Unsigned, UnsignedCause};
pub use provenance::{BoardSize, Date, Provenance};
pub use robot_correction::{
    CorrectionNumbers, GEOMETRY_PARAMETER_COUNT, RemovalCalibration, RemovalNumbers, RobotCorrection,
    SMOOTH_PARAMETER_COUNT,
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

/// `[calibration]`: the names of the calibration files. Each file is needed only by some commands.
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
    /// The [`RobotCorrection`] of the arm, if it was measured.
    pub robot_correction: Option<PathBuf>,
    /// The [`RemovalCalibration`], needed if a recipe states the depth to be removed.
    pub removal: Option<PathBuf>,
}

impl CalibrationFiles {
    /// Returns the calibration files that the cell's file names, each with its key.
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

/// A cell: the contents of its file after all checks.
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

/// Top-level keys that distinguish a cell's file from other TOML files.
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
    /// Parses and checks a cell's file. `file` is its path: messages contain it, and relative file names start at its
    /// folder.
    ///
    /// # Errors
    /// All problems of the file, each with its line and key.
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

    /// Returns the file of the key that signs records. `None` if the cell's file does not name one: the key is then a
    /// systemd credential, or a file in the store.
    pub fn record_key(&self) -> Option<&Path> {
        self.record_key.as_deref()
    }

    /// Returns the path of the service's socket; `None` if the cell's file does not name one: the socket is then in the
    /// store.
    pub fn socket(&self) -> Option<&Path> {
        self.socket.as_deref()
    }

    /// Returns the role of clients that connect to the socket as members of its Unix group. `None` if they may send
    /// every request of the socket.
    pub fn socket_role(&self) -> Option<Role> {
        self.socket_role
    }

    /// Returns the fixed 3D camera.
    pub fn scanner(&self) -> &Camera<ZividCamera> {
        &self.scanner
    }

    /// Returns the camera on the flange; a real one is a GigE Vision camera.
    pub fn flange_camera(&self) -> &Camera<Gige> {
        &self.flange_camera
    }

    /// Returns the settings of the robot controller.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Returns the tool that presses the disc onto the panel.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// Returns the park pose, in which the arm does not obstruct the panel or the view of a camera. Shots are made only
    /// in this pose.
    pub fn park_pose(&self) -> Option<Joints> {
        self.pose("park")
    }

    /// Returns the pose with this name.
    pub fn pose(&self, name: &str) -> Option<Joints> {
        self.poses.get(name).copied()
    }

    /// Returns all named poses.
    pub fn poses(&self) -> &BTreeMap<String, Joints> {
        &self.poses
    }

    /// Returns the names of the controller's digital outputs and inputs.
    pub fn inputs_outputs(&self) -> &InputsOutputs {
        &self.inputs_outputs
    }

    /// Returns the names of the calibration files.
    pub fn calibration(&self) -> &CalibrationFiles {
        &self.calibration
    }

    /// Returns the camera poses, measured with a tape; a three-point calibration is compared with them.
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

    /// Returns the office server that receives the cell's records, if one is set.
    pub fn office(&self) -> Option<&Office> {
        self.office.as_ref()
    }

    /// Returns the HTTP server that receives signed records, if one is set.
    pub fn push(&self) -> Option<&PushSettings> {
        self.push.as_ref()
    }

    /// Returns the settings of the operator's page.
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the settings of the MQTT Sparkplug edge node, if there are any.
    pub fn sparkplug(&self) -> Option<&SparkplugNode> {
        self.sparkplug.as_ref()
    }

    /// Returns the settings of the OPC UA server.
    pub fn opcua(&self) -> &OpcUa {
        &self.opcua
    }

    /// Returns the names of the tables that connect the cell to systems of the plant: the office server, the MQTT
    /// broker, OPC UA clients.
    pub fn plant_tables(&self) -> Vec<&'static str> {
        let named = [
            ("[office]", self.office.is_some()),
            ("[opcua] listen", self.opcua.listen.is_some()),
            ("[sparkplug]", self.sparkplug.is_some()),
        ];
        named.into_iter().filter_map(|(table, is_named)| is_named.then_some(table)).collect()
    }

    /// Returns the settings of the handshake with a production line by digital signals, if there are any.
    pub fn line(&self) -> Option<&Line> {
        self.line.as_ref()
    }

    /// Returns the rules for the names of the part that a start request must state.
    pub fn part(&self) -> &PartRules {
        &self.part
    }

    /// Returns the cell with this correction of the arm, which the caller reads from the file that `[calibration]`
    /// names.
    #[must_use]
    pub fn with_arm_correction(self, correction: CorrectionNumbers) -> Self {
        Cell { arm: self.arm.with_correction(correction), ..self }
    }

    /// Returns the cell with the newest signed page of the acceptance tests in the store. Without this page, no stage
    /// is treated as signed.
    #[must_use]
    pub fn with_signed_page(self, page: Option<SignedPage>) -> Self {
        Cell { robot: self.robot.with_signed_page(page), ..self }
    }
}

settings! {
    /// `[limits]`. The ranges of these limits are fixed in the program: a cell may be stricter, never less strict.
    pub struct Limits {
        /// Maximum duration of the motion that is sent and not yet executed, s. The arm can still make this motion when
        /// the link fails.
        window_s: f64, 0.1..=1.0, default 1.0;
        /// Maximum number of commands that are sent and not yet executed.
        window_commands: usize, 5..=50, default 50;
        /// Minimum number of points in the queue before a path starts.
        min_points: usize, 2..=50, default 5;
        /// Time between heartbeats of the application, in each direction, ms.
        heartbeat_ms: usize, 10..=100, default 100;
        /// Time without a message after which the PC and the controller both stop if commands are queued, ms.
        watchdog_ms: usize, 40..=400, default 400;
        /// Maximum age of a localization, s; then Verify must renew it.
        token_s: f64, 10.0..=600.0, default 600.0;
        /// Maximum duration of a stop, s; a longer one is a fault.
        stop_deadline_s: f64, 0.5..=10.0, default 10.0;
        /// Time for which the output `warning` of `[io.outputs]` is on before the first motion after a standstill, s.
        warning_s: f64, 0.5..=30.0, default 3.0;
        /// Time for which a film is observed after the panel is completely wet, s (ASTM F22: up to a minute); a recipe
        /// may override it.
        observation_s: f64, 5.0..=600.0, default 60.0;
        /// Minimum area of broken film at which a grid fails, mm²; a recipe may override it.
        min_break_mm2: f64, 0.1..=10_000.0, default 5.0;
        /// Assumed error at the tool, mm, which is used as long as a part of the error budget is not measured.
        tool_error_mm: Option<f64>, 0.01..=20.0, default None;
        /// Maximum error in the last verification of a calibration at which a cycle may start, mm.
        verify_limit_mm: f64, 0.05..=10.0, default 0.5;
        /// Maximum age of the last verification of a calibration at which a cycle may start, h.
        verify_max_age_h: f64, 0.1..=8_760.0, default 24.0;
        /// Lower corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_min_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Upper corner of the box that the tool's tip must not leave, in the base frame, mm.
        box_max_mm: Option<[f64; 3]>, -5_000.0..=5_000.0, default None;
        /// Maximum distance between consecutive waypoints, mm.
        max_step_mm: f64, 1.0..=1_000.0, default 100.0;
        /// Maximum rotation of the tool between consecutive waypoints, degrees.
        max_turn_deg: f64, 0.1..=180.0, default 15.0;
        /// Maximum angle between the tool's axis and its taught direction, degrees.
        max_tilt_deg: f64, 1.0..=90.0, default 45.0;
        /// Maximum speed of the tool's tip, mm/s.
        max_speed_mm_s: f64, 1.0..=2_000.0, default 250.0;
    }
}

/// The box that the tool's tip must not leave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// Lower corner in the base frame, mm.
    pub min: Point<Base>,
    /// Upper corner, mm; each of its coordinates is larger than that of the lower corner.
    pub max: Point<Base>,
}

impl Workspace {
    /// Returns whether the box contains the point.
    pub fn contains(&self, point: Point<Base>) -> bool {
        (0..3).all(|axis| (self.min.mm[axis]..=self.max.mm[axis]).contains(&point.mm[axis]))
    }
}

impl Limits {
    /// Returns the box from `box_min_mm` to `box_max_mm` for waypoints; `None` if the file states no box.
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

/// How long the clips and scans of a class of cycles are kept. An absent value sets no limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RetentionTime {
    /// Number of days before the end of the newest cycle.
    pub days: Option<usize>,
    /// Number of newest cycles whose data are kept.
    pub cycles: Option<usize>,
}

/// `[store.keep]`: how long clips and scans are kept. Pages, records and taught data are kept for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retention {
    /// Retention of cycles that passed.
    pub passed: RetentionTime,
    /// Retention of cycles with any other result.
    pub failed: RetentionTime,
}

impl Retention {
    /// Returns whether all clips and scans are kept for ever.
    pub fn is_unlimited(&self) -> bool {
        *self == Retention::default()
    }
}

const DAYS: std::ops::RangeInclusive<usize> = 1..=36_500;
const CYCLES: std::ops::RangeInclusive<usize> = 1..=1_000_000;

/// The contents of `[store]`.
struct StoreTable {
    /// The folder of the store.
    pub folder: String,
    /// How long clips and scans are kept.
    pub retention: Retention,
    /// The file of the key that signs records; `None` if the key is in the folder of the store.
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
