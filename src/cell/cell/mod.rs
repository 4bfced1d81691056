//! The cell: one TOML file for each robot cell, and the calibration files it names, checked like a recipe.
//!
//! It states what is connected, the arm's park pose, the names of inputs and outputs, which calibrations are valid,
//! and the limits for every panel. File names are relative to the cell file's folder. A file may omit what a command
//! does not need (offline work has no poses); the code that needs a missing value reports it. The caller reads the
//! files.

mod address;
mod arm;
mod arm_geometry;
mod arm_presets;
mod board_size;
mod broker;
mod calibration;
mod date;
mod devices;
mod foreign_lens;
mod gige;
mod lens_extent;
mod limits;
mod line;
mod line_signal;
mod names;
mod office;
mod opcua;
mod page;
mod part;
mod proof_stage;
mod provenance;
mod push;
mod removal;
mod retention;
mod robot_correction;
mod rough;
mod scanner_errors;
mod sparkplug;
mod tool;
mod zivid;
mod zivid_settings;

#[cfg(test)]
mod tests;

pub use address::authority;
pub use arm::{Arm, ArmModel, ArmTable, KeepOut};
pub use arm_geometry::{ArmAxes, ArmGeometry, PerAxis};
pub use arm_presets::{PRESETS, Preset};
pub use board_size::BoardSize;
pub use broker::{Broker, BrokerLogin};
pub use calibration::{
    FlangeCameraMount, Intrinsics, LensCovariance, Mount, MountedPose, ScannerMount, TargetMount, ToolMount,
};
pub use date::Date;
pub use devices::{Camera, MockController, Robot, RobotKind};
pub use gige::{Gige, PIXEL_FORMATS};
pub use lens_extent::{LensExtent, SupportedArea};
pub use limits::{Limits, Workspace};
pub use line::{LINE_INPUTS, Line};
pub use line_signal::LineSignal;
pub use names::{Feedback, InputsOutputs, LOCAL_CONTROL, Output, WARNING};
pub use office::{CellName, Office};
pub use opcua::{AnonymousAccess, OpcUa};
pub use page::Page;
pub use part::{NameDemand, NameRule, PartNameError, PartRules};
pub use proof_stage::{ProofStage, SignedPage, Unsigned, UnsignedCause};
pub use provenance::Provenance;
pub use push::{PushSettings, WebFolder};
pub use removal::{RemovalCalibration, RemovalNumbers};
pub use retention::{Retention, RetentionTime};
pub use robot_correction::{CorrectionNumbers, GEOMETRY_NUMBERS, RobotCorrection, SMOOTH_NUMBERS};
pub use rough::RoughMounts;
pub use scanner_errors::MeasuredScanner;
pub use sparkplug::{BrokerTls, NodeCommands, SparkplugNode};
pub use tool::{CompliantTool, Tool, ToolAddress};
pub use zivid::ZividCamera;
pub use zivid_settings::{MainsFrequency, ZividSettings, ZividUse};

use crate::accounts::Role;
use panelprep_base::config::{self, Problems, Section};
use panelprep_base::geometry::Joints;
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
    /// The files that are stated, each with its key.
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
        let store = retention::parse_store(top);
        let socket = top.parse::<Option<String>>("socket", (), Some(None));
        let socket_role = top.parse::<Option<Role>>("socket_role", (), Some(None));
        let scanner = devices::parse_camera(folder, &top.section("scanner"), zivid::kind(folder));
        let flange_camera = devices::parse_camera(folder, &top.section("flange_camera"), gige::KIND);
        let robot = devices::parse_robot(&top.section("robot"));
        let tool = tool::parse_tool(&top.section("tool"));
        let poses = names::parse_poses(&top.section("poses"));
        let io = names::parse_io(&top.section("io"));
        let calibration = CalibrationFiles::parse(folder, &top.section("calibration"));
        let limits = limits::parse_limits(&top.section("limits"));
        let rough = rough::parse_rough(&top.section("rough"));
        let arm = arm::parse_arm(&top.section("arm"), &top.sections("keep_out"));
        let page = page::parse_page(folder, &top.section("page"));
        let office = office::parse_office(folder, &top.section("office"));
        let push = push::parse_push(folder, &top.section("push"));
        let sparkplug = sparkplug::parse_sparkplug(folder, &top.section("sparkplug"));
        let opcua = opcua::parse_opcua(folder, &top.section("opcua"));
        let line = line::parse_line(folder, &top.section("line"), io.as_ref());
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

    /// The folder of the store.
    pub fn store(&self) -> &Path {
        &self.store
    }

    /// How long clips and scans are kept in the store.
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

    /// Returns the role of the clients that the socket's group lets in; without it they may request everything that
    /// the socket offers.
    pub fn socket_role(&self) -> Option<Role> {
        self.socket_role
    }

    /// The fixed 3D camera.
    pub fn scanner(&self) -> &Camera<ZividCamera> {
        &self.scanner
    }

    /// The camera on the flange; a device is a GigE Vision camera.
    pub fn flange_camera(&self) -> &Camera<Gige> {
        &self.flange_camera
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The device that presses the disc onto the panel.
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// Returns the pose in which the arm is clear of the panel and of both cameras' view: a shot is made only from
    /// there.
    pub fn park_pose(&self) -> Option<Joints> {
        self.pose("park")
    }

    /// A named pose.
    pub fn pose(&self, name: &str) -> Option<Joints> {
        self.poses.get(name).copied()
    }

    /// All named poses.
    pub fn poses(&self) -> &BTreeMap<String, Joints> {
        &self.poses
    }

    /// The names of the controller's outputs and inputs.
    pub fn inputs_outputs(&self) -> &InputsOutputs {
        &self.inputs_outputs
    }

    /// The calibration files.
    pub fn calibration(&self) -> &CalibrationFiles {
        &self.calibration
    }

    /// Returns the poses of the cameras, measured by hand: a three-point calibration is compared with them.
    pub fn rough_mounts(&self) -> &RoughMounts {
        &self.rough_mounts
    }

    /// The limits that apply to every panel.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The arm and its keep-out boxes.
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

    /// The operator's page.
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the cell as an edge node of MQTT Sparkplug, if it is one.
    pub fn sparkplug(&self) -> Option<&SparkplugNode> {
        self.sparkplug.as_ref()
    }

    /// The OPC UA server.
    pub fn opcua(&self) -> &OpcUa {
        &self.opcua
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
