//! The values and files that a cell's file must contain for a purpose: decided here for all commands.
//!
//! A cell's file may omit values that offline work does not need. If a value is missing without which a motion or a
//! cycle would be refused later, the command refuses it before anything begins, and `panelprep check` reports it in
//! advance. [`unmet_requirements`] examines only the cell's file; [`incomplete_files`] also examines the files that it
//! names: whether they exist, and the results of their own checks. `check`, `doctor`, `run` and `cycle` use these two
//! functions. `panelprep doctor` also checks whether the devices answer.

pub mod recipe_fits;

use nalgebra::Isometry3;
use panelprep_base::config::{Problem, Problems, key_line};
use panelprep_base::geometry::{Joints, Rigid};
use panelprep_base::number_text::{fixed_decimals, shortest_text};
use panelprep_cell::cell::{
    Camera, Cell, FlangeCameraMount, Intrinsics, Mount, MountedPose, Output, RemovalCalibration, Robot,
    RobotCorrection, RobotKind, ScannerMount, ToolMount, ZividSettings, ZividUse,
};
use panelprep_cell::files::content_hash;
use panelprep_toolpath::path::Kinematics;
use panelprep_toolpath::path::reach::joint_motion;
use std::path::Path;

/// The purpose for which a cell's file must be complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A single function of the robot.
    Robot,
    /// A cycle, or an air-run of its path.
    Cycle,
}

impl Purpose {
    /// Returns the commands for this purpose.
    pub fn commands(self) -> &'static str {
        match self {
            Purpose::Robot => "`panelprep robot` and `mock-robot`",
            Purpose::Cycle => "`panelprep cycle`, `air-run` and `run`",
        }
    }
}

/// A value that a purpose needs and that is missing or impossible in the cell's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnmetRequirement {
    /// The key with its tables, such as `poses.park.a1_deg`.
    pub key: String,
    /// The value found, the value needed, and what to do.
    pub message: String,
    /// The kind of the problem.
    pub kind: ProblemKind,
}

/// The kind of problem in a cell's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProblemKind {
    /// A value is missing or impossible.
    Value,
    /// A file that the cell's file names does not exist; it may be created later.
    MissingFile,
    /// A file that the cell's file names exists, but is not valid.
    WrongFile,
    /// The programs of a real controller were not accepted: the cell may be commissioned, but no cycle can start.
    Acceptance,
}

impl UnmetRequirement {
    fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        UnmetRequirement { key: key.into(), message: message.into(), kind: ProblemKind::Value }
    }
}

/// Advice how to create a missing calibration file.
pub const CALIBRATION_ADVICE: &str = "`panelprep demo` creates this file for config/cell.toml, `panelprep render` for \
                                      another simulated cell, `panelprep calibrate` for a real cell";

/// The result of reading a file that is named in a cell's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamedFile {
    /// Its text.
    Text(String),
    /// The file does not exist.
    Missing,
    /// The file exists but cannot be read, for this reason.
    Unreadable(String),
    /// The reader did not search for the file.
    NotChecked,
}

/// A function that reads a file named in a cell's file.
pub type ReadNamed<'a> = &'a dyn Fn(&Path) -> NamedFile;

/// Returns all requirements of this purpose that the cell's file does not meet; empty if it is complete.
pub fn unmet_requirements(cell: &Cell, purpose: Purpose) -> Vec<UnmetRequirement> {
    let is_mock = cell.robot().kind() == RobotKind::Mock;
    match purpose {
        Purpose::Robot if is_mock => {
            missing_outputs_and_feedbacks(cell, true).into_iter().chain(check_park(cell)).collect()
        }
        Purpose::Robot => Vec::new(),
        Purpose::Cycle => {
            let simulates = is_mock || simulated_cameras(cell).iter().any(|(_, is)| *is);
            let parts = [
                missing_outputs_and_feedbacks(cell, simulates),
                check_park(cell),
                check_poses(cell),
                check_box(cell),
                missing_calibrations(cell),
                check_cameras(cell),
            ];
            parts.concat()
        }
    }
}

/// Returns the result of [`unmet_requirements`], the named files that are missing or not valid, and the missing
/// acceptance of a real controller's programs.
pub fn incomplete_files(cell: &Cell, purpose: Purpose, read: ReadNamed<'_>) -> Vec<UnmetRequirement> {
    let of_files = unmet_files(cell, purpose, read);
    unmet_requirements(cell, purpose).into_iter().chain(of_files).chain(missing_acceptance(cell, purpose)).collect()
}

/// Converts unmet requirements of the file with this text to problems, each at the line of its key, ordered by line.
pub fn to_problems(text: &str, unmet: Vec<UnmetRequirement>) -> Vec<Problem> {
    let problem = |UnmetRequirement { key, message, .. }| Problem { line: key_line(text, &key), key, message };
    let mut problems: Vec<Problem> = unmet.into_iter().map(problem).collect();
    problems.sort_by_key(|problem| problem.line);
    problems
}

/// Returns an unmet requirement if the checksum of the accepted programs is missing for a cycle on a real controller. A
/// rehearsal with `mock-robot` on this computer needs none. This is an early message and not the safety check: the
/// daemon recognises a real controller behind a tunnel by its state, and in automatic mode nothing moves without signed
/// acceptance tests, which require the checksum.
fn missing_acceptance(cell: &Cell, purpose: Purpose) -> Option<UnmetRequirement> {
    let robot = cell.robot();
    let message = "is missing, so it is NOT PROVEN with which programs of the controller this cell was accepted, and other programs \
                   would not be noticed; run `panelprep doctor --kuka DIR --accept` with the controller's files and add the \
                   line that it prints";
    let lacks = purpose == Purpose::Cycle && is_on_another_machine(robot) && robot.programs_sum().is_none();
    lacks.then(|| UnmetRequirement {
        kind: ProblemKind::Acceptance,
        ..UnmetRequirement::new("robot.programs_sum", message)
    })
}

/// Returns whether the controller runs on another machine, according to its address.
fn is_on_another_machine(robot: &Robot) -> bool {
    robot.kind() == RobotKind::Eki && !robot.is_local_controller()
}

/// Returns the names of the cameras, each with a flag that states whether the camera is simulated.
fn simulated_cameras(cell: &Cell) -> [(&'static str, bool); 2] {
    [
        ("scanner", matches!(cell.scanner(), Camera::Simulated)),
        ("flange_camera", matches!(cell.flange_camera(), Camera::Simulated)),
    ]
}

/// Returns the missing outputs and feedbacks. The simulation reports the effect of each output by a feedback, so a
/// simulated cell needs all feedbacks.
fn missing_outputs_and_feedbacks(cell: &Cell, simulates: bool) -> Vec<UnmetRequirement> {
    let io = cell.inputs_outputs();
    let mut missing = Vec::new();
    for output in Output::ALL.iter().copied() {
        let (name, feedback) = (output.name(), output.feedback());
        if io.output(output).is_none() {
            let message = "is missing; a cycle switches this output: state the number n of its $OUT[n]";
            missing.push(UnmetRequirement::new(format!("io.outputs.{name}"), message));
        }
        // On a real controller, the reported output proves the light; the feedback `light_on` is optional.
        let is_read = simulates || output != Output::Light;
        if is_read && io.feedback(feedback).is_none() {
            let message = format!(
                "is missing; this feedback proves that {name} was switched: state the number n of its $IN[n]"
            );
            missing.push(UnmetRequirement::new(format!("io.feedbacks.{}", feedback.name()), message));
        }
    }
    missing.extend(io.undecided().into_iter().map(|name| {
        let message = "does not state what a stop does with it; state its time in [io.off_after_s] (0 for an output \
                       that moves something or lets water run), or name it in [io] may_stay_on";
        UnmetRequirement::new(format!("io.outputs.{name}"), message)
    }));
    missing
}

fn check_park(cell: &Cell) -> Vec<UnmetRequirement> {
    let message = "is missing; every cycle starts from this pose: state the axis angles with the arm clear of the \
                   panel and of both cameras' view";
    let missing = cell.park_pose().is_none().then(|| UnmetRequirement::new("poses.park", message));
    missing.into_iter().collect()
}

/// Checks that the arm can reach the park pose and the ready pose, and that its axes can move from one to the other
/// without a collision with an obstacle.
fn check_poses(cell: &Cell) -> Vec<UnmetRequirement> {
    let (park, ready) = (cell.park_pose(), cell.pose("ready"));
    let named: Vec<(&str, Joints)> =
        [("park", park), ("ready", ready)].into_iter().filter_map(|(name, pose)| Some((name, pose?))).collect();
    let beyond: Vec<UnmetRequirement> =
        named.iter().flat_map(|(name, pose)| axes_beyond_limits(cell, name, pose)).collect();
    if !beyond.is_empty() {
        return beyond;
    }
    // Checked without the tool, which is known only after a calibration: an obstacle for the arm alone is an obstacle
    // for the arm with a tool, too.
    let (arm, no_tool) = (Kinematics::new(cell.arm()), Rigid::from_isometry_unchecked(Isometry3::identity()));
    let first = named.first().map(|first| (*first, *first));
    let both = named.first().zip(named.get(1)).into_iter();
    let ways = first.into_iter().chain(both.flat_map(|(park, ready)| [(*park, *ready), (*ready, *park)]));
    let unmet_poses = |((from, start), (to, end)): ((&str, Joints), (&str, Joints))| {
        let obstacle = joint_motion(&arm, no_tool, &start, &end).err()?;
        let way =
            if from == to { "in this pose,".to_owned() } else { format!("on the motion from [poses] {from}:") };
        Some(UnmetRequirement::new(
            format!("poses.{to}"),
            format!("the arm cannot reach this pose: {way} {obstacle}"),
        ))
    };
    let mut unmet_poses: Vec<UnmetRequirement> = ways.filter_map(unmet_poses).collect();
    unmet_poses.truncate(1);
    unmet_poses
}

/// Returns a problem for each axis of a pose that is beyond the arm's limits.
fn axes_beyond_limits(cell: &Cell, name: &str, pose: &Joints) -> Vec<UnmetRequirement> {
    let axes = cell.arm().axes();
    let angles = pose.degrees();
    let of_axis = |(axis, angle): (usize, f64)| {
        let (low, high) = (axes.min_deg[axis], axes.max_deg[axis]);
        let message = || {
            let [angle, low, high] = [angle, low, high].map(shortest_text);
            format!(
                "found {angle}, but the limits of the arm's axis {} are {low} to {high}: state an angle within the limits",
                axis + 1
            )
        };
        (!(low..=high).contains(&angle))
            .then(|| UnmetRequirement::new(format!("poses.{name}.a{}_deg", axis + 1), message()))
    };
    angles.into_iter().enumerate().filter_map(of_axis).collect()
}

fn check_box(cell: &Cell) -> Vec<UnmetRequirement> {
    let Some(space) = cell.limits().workspace() else {
        let message = "is missing, and so is box_max_mm: without this box for the tool centre point (TCP), the robot \
                       makes no linear motions; state both corners of the box";
        return vec![UnmetRequirement::new("limits.box_min_mm", message)];
    };
    let [low, high] = [space.min, space.max].map(|corner| [corner.mm.x, corner.mm.y, corner.mm.z]);
    check_box_unit("limits.box_max_mm", low, high).into_iter().collect()
}

/// Minimum length of the longest edge of a working volume, mm; the values of a smaller box are treated as metres.
const MIN_LONGEST_EDGE_MM: f64 = 10.0;

/// Returns a problem if all edges of a box are so short that its values must be metres.
fn check_box_unit(key: &str, low: [f64; 3], high: [f64; 3]) -> Option<UnmetRequirement> {
    let edges = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let message = || {
        let [x, y, z] = edges.map(|edge| fixed_decimals(edge, 2));
        format!("found a box of {x} × {y} × {z} mm; are these metres? write millimetres")
    };
    edges.iter().all(|edge| *edge < MIN_LONGEST_EDGE_MM).then(|| UnmetRequirement::new(key, message()))
}

fn missing_calibrations(cell: &Cell) -> Vec<UnmetRequirement> {
    let files = cell.calibration();
    let named = [
        ("scanner", files.scanner.is_some()),
        ("flange_camera", files.flange_camera.is_some()),
        ("base_from_camera", files.base_from_camera.is_some()),
        ("flange_from_camera", files.flange_from_camera.is_some()),
        ("flange_from_tool", files.flange_from_tool.is_some()),
    ];
    let missing = named.into_iter().filter(|(_, is_named)| !is_named);
    let message =
        "is missing; name the file that `panelprep calibrate` writes, or `panelprep render` for a simulated cell";
    missing.map(|(key, _)| UnmetRequirement::new(format!("calibration.{key}"), message)).collect()
}

/// Checks whether the cameras match the robot, and whether the settings for a shot are named.
fn check_cameras(cell: &Cell) -> Vec<UnmetRequirement> {
    let mut wrong = Vec::new();
    let robot = cell.robot();
    if is_on_another_machine(robot) {
        let message = format!(
            "found \"simulated\", a camera of the simulated cell, but [robot] is a controller at {}; configure the \
             real camera or a recording, or test with `panelprep mock-robot` and host = \"127.0.0.1\"",
            robot.host()
        );
        let simulated = simulated_cameras(cell).into_iter().filter(|(_, is)| *is);
        wrong.extend(simulated.map(|(table, _)| UnmetRequirement::new(format!("{table}.kind"), message.clone())));
    }
    if let Camera::Device(zivid) = cell.scanner() {
        for (key, is_named) in
            [("settings", zivid.settings.is_some()), ("settings_2d", zivid.settings_2d.is_some())]
        {
            let message = "is missing; kind = \"zivid\" needs it to take a shot: name the file that Zivid Studio saved \
                           (settings for 3D shots with colour, settings_2d for pictures)";
            wrong.extend((!is_named).then(|| UnmetRequirement::new(format!("scanner.{key}"), message)));
        }
    }
    if cfg!(not(feature = "gige")) && matches!(cell.flange_camera(), Camera::Device(_)) {
        let message = "found \"gige\", but this program was built without the cargo feature gige; use a build with \
                       this feature; valid without it: \"simulated\" and \"recorded\"";
        wrong.push(UnmetRequirement::new("flange_camera.kind", message));
    }
    wrong
}

/// Returns [`NamedFile::NotChecked`] for each file.
pub fn skip_file(_: &Path) -> NamedFile {
    NamedFile::NotChecked
}

/// Keys of the files that every command reads together with the cell's file.
const ALWAYS_READ_KEYS: [&str; 1] = ["calibration.robot_correction"];
/// Keys of `[scanner]` that name files with settings, and the use of each file.
const ZIVID_SETTINGS: [(&str, ZividUse); 2] =
    [("scanner.settings", ZividUse::Scan), ("scanner.settings_2d", ZividUse::Film)];

/// Returns the files for this purpose that are missing or not valid. Only the message about the first missing
/// calibration contains the advice.
fn unmet_files(cell: &Cell, purpose: Purpose, read: ReadNamed<'_>) -> Vec<UnmetRequirement> {
    let needs = |key: &str| purpose == Purpose::Cycle || ALWAYS_READ_KEYS.contains(&key);
    let correction = Correction::from_cell(cell, read);
    let mut has_advised = false;
    let judge = |(key, file): (String, &Path)| {
        let name = file.display().to_string();
        let (lack, message) = match read(file) {
            NamedFile::NotChecked => return None,
            NamedFile::Missing if key.starts_with("calibration.") && !std::mem::replace(&mut has_advised, true) => {
                (
                    ProblemKind::MissingFile,
                    format!("names the file {name}, which does not exist; {CALIBRATION_ADVICE}"),
                )
            }
            NamedFile::Missing => {
                (ProblemKind::MissingFile, format!("names the file {name}, which does not exist"))
            }
            NamedFile::Unreadable(why) => {
                (ProblemKind::WrongFile, format!("names the file {name}, which cannot be read: {why}"))
            }
            NamedFile::Text(text) => {
                let problems = check_named_file(&key, &name, &text, &correction).err()?;
                (ProblemKind::WrongFile, format!("names a file that is not valid: {}", first_problem(&problems)))
            }
        };
        Some(UnmetRequirement { key, message, kind: lack })
    };
    named_files(cell).into_iter().filter(|(key, _)| needs(key)).filter_map(judge).collect()
}

/// Lists the files that the cell's file names, with their keys.
fn named_files(cell: &Cell) -> Vec<(String, &Path)> {
    let calibrations =
        cell.calibration().named_files().into_iter().map(|(key, file)| (format!("calibration.{key}"), file));
    let settings = match cell.scanner() {
        Camera::Device(zivid) => [zivid.settings.as_deref(), zivid.settings_2d.as_deref()],
        Camera::Simulated | Camera::Recorded { .. } => [None, None],
    };
    let settings =
        ZIVID_SETTINGS.into_iter().zip(settings).filter_map(|((key, _), file)| Some((key.to_owned(), file?)));
    calibrations.chain(settings).collect()
}

/// The robot correction that the cell uses.
enum Correction {
    /// The hash of the correction's file, by which calibrations refer to it; `None` if the cell has no correction.
    Known(Option<String>),
    /// The file of the correction was not read.
    Unknown,
}

impl Correction {
    fn from_cell(cell: &Cell, read: ReadNamed<'_>) -> Self {
        match cell.calibration().robot_correction.as_deref().map(read) {
            None => Correction::Known(None),
            Some(NamedFile::Text(text)) => Correction::Known(Some(content_hash(text.as_bytes()))),
            Some(_) => Correction::Unknown,
        }
    }
}

/// Returns whether a mount that was measured with the robot was measured with this robot correction, given by its hash.
/// `None` means that the mount must have been measured without a correction.
pub fn is_same_correction<M: Mount>(mount: &MountedPose<M>, correction: Option<&str>) -> bool {
    // A mount whose values a person entered was not measured with the robot.
    let is_measured = mount.provenance.program.is_some() || mount.robot_correction.is_some();
    !is_measured || mount.robot_correction.as_deref() == correction
}

/// Checks a file as the kind of file that its key requires.
fn check_named_file(key: &str, name: &str, text: &str, correction: &Correction) -> Result<(), Problems> {
    if let Some((_, usage)) = ZIVID_SETTINGS.into_iter().find(|(settings, _)| *settings == key) {
        return ZividSettings::check(name, text, usage).map(drop);
    }
    match key.trim_start_matches("calibration.") {
        "scanner" | "flange_camera" => Intrinsics::check(name, text).map(drop),
        ScannerMount::TABLE => check_mount::<ScannerMount>(name, text, correction).map(drop),
        FlangeCameraMount::TABLE => check_mount::<FlangeCameraMount>(name, text, correction).map(drop),
        ToolMount::TABLE => check_tool_file(name, text, correction),
        "robot_correction" => RobotCorrection::check(name, text).map(drop),
        _ => RemovalCalibration::check(name, text).map(drop),
    }
}

fn check_mount<M: Mount>(name: &str, text: &str, correction: &Correction) -> Result<MountedPose<M>, Problems> {
    let mount = MountedPose::<M>::check(name, text)?;
    let is_ours = match correction {
        Correction::Known(ours) => is_same_correction(&mount, ours.as_deref()),
        Correction::Unknown => true,
    };
    if is_ours {
        return Ok(mount);
    }
    let message = "the calibration was measured with another robot correction than [calibration] robot_correction, or \
                   with none: calibrate again, or name that robot correction";
    Err(problem(name, text, format!("{}.robot_correction", M::TABLE), message))
}

/// Checks a tool's file. In addition to the tool centre point, a cycle needs the measured axis of the tool.
fn check_tool_file(name: &str, text: &str, correction: &Correction) -> Result<(), Problems> {
    if check_mount::<ToolMount>(name, text, correction)?.axis_measured == Some(true) {
        return Ok(());
    }
    let message = "the tool's axis was not measured, and a path needs it: run `panelprep calibrate tcp` with [[axis]], or with \
                   [[plate]] and [[flat]]";
    Err(problem(name, text, format!("{}.axis_measured", ToolMount::TABLE), message))
}

fn problem(name: &str, text: &str, key: String, message: &str) -> Problems {
    let problem = Problem { line: key_line(text, &key), key, message: message.to_owned() };
    Problems { file: name.to_owned(), list: vec![problem] }
}

/// Returns the first problem with its file and line, and the number of all problems.
fn first_problem(problems: &Problems) -> String {
    let all = problems.to_string();
    let first = all.lines().next().unwrap_or_default().to_owned();
    match problems.list.len() {
        0 | 1 => first,
        count => format!("{first} (the first of {count} problems)"),
    }
}

#[cfg(test)]
mod tests;
