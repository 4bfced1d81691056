//! The files that a cell's file names: whether they exist, and the results of their own checks.

use super::findings::{ProblemKind, Purpose, UnmetRequirement};
use panelprep_base::config::{Problem, Problems, key_line};
use panelprep_cell::cell::{
    Camera, Cell, FlangeCameraMount, Intrinsics, Mount, MountedPose, RemovalCalibration, RobotCorrection,
    ScannerMount, ToolMount, ZividSettings, ZividUse,
};
use panelprep_cell::files::content_hash;
use std::path::Path;

/// Advice on how to make calibrations.
pub const CALIBRATION_ADVICE: &str = "`panelprep demo` creates this file for config/cell.toml, `panelprep render` for \
                                      another simulated cell, `panelprep calibrate` for a real cell";

/// A file that a cell's file names, as its reader found it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamedFile {
    /// Its text.
    Text(String),
    /// The file does not exist.
    Missing,
    /// The file exists and cannot be read: the reason.
    Unreadable(String),
    /// The reader did not look for the file.
    NotChecked,
}

/// Reads a named file.
pub type ReadNamed<'a> = &'a dyn Fn(&Path) -> NamedFile;

/// Returns [`NamedFile::NotChecked`] for any file.
pub fn skip_file(_: &Path) -> NamedFile {
    NamedFile::NotChecked
}

/// The keys of files that every command reads if it reads the cell.
const ALWAYS_READ_KEYS: [&str; 1] = ["calibration.robot_correction"];
/// Keys of `[scanner]`.
const SETTINGS: [(&str, ZividUse); 2] =
    [("scanner.settings", ZividUse::Scan), ("scanner.settings_2d", ZividUse::Film)];

/// The files needed for the purpose that are missing or invalid. The message of the first missing calibration
/// states what to do.
pub(super) fn unmet_files(cell: &Cell, purpose: Purpose, read: ReadNamed<'_>) -> Vec<UnmetRequirement> {
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

/// Lists the named files with their keys.
fn named_files(cell: &Cell) -> Vec<(String, &Path)> {
    let calibrations =
        cell.calibration().named_files().into_iter().map(|(key, file)| (format!("calibration.{key}"), file));
    let settings = match cell.scanner() {
        Camera::Device(zivid) => [zivid.settings.as_deref(), zivid.settings_2d.as_deref()],
        Camera::Simulated | Camera::Recorded { .. } => [None, None],
    };
    let settings = SETTINGS.into_iter().zip(settings).filter_map(|((key, _), file)| Some((key.to_owned(), file?)));
    calibrations.chain(settings).collect()
}

/// The file of the arm's correction.
enum Correction {
    /// The file's hash, by which calibrations name it; `None` if the cell names no such file.
    Known(Option<String>),
    /// The file was not read.
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

/// Returns whether a mount that was measured with the robot was measured with this correction of the arm, named by
/// its hash. If this cell has no correction, the mount must have been measured without one.
pub fn is_same_correction<M: Mount>(mount: &MountedPose<M>, correction: Option<&str>) -> bool {
    // A mount that a person wrote by hand was not measured with the robot.
    let is_measured = mount.provenance.program.is_some() || mount.robot_correction.is_some();
    !is_measured || mount.robot_correction.as_deref() == correction
}

/// Checks a file according to the key that names it.
fn check_named_file(key: &str, name: &str, text: &str, correction: &Correction) -> Result<(), Problems> {
    if let Some((_, usage)) = SETTINGS.into_iter().find(|(settings, _)| *settings == key) {
        return ZividSettings::check(name, text, usage).map(drop);
    }
    match key.trim_start_matches("calibration.") {
        "scanner" | "flange_camera" => Intrinsics::check(name, text).map(drop),
        ScannerMount::TABLE => check_mount::<ScannerMount>(name, text, correction).map(drop),
        FlangeCameraMount::TABLE => check_mount::<FlangeCameraMount>(name, text, correction).map(drop),
        ToolMount::TABLE => tool(name, text, correction),
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

/// Checks a tool's file: the tool's point is not enough for a cycle, its axis must also be measured.
fn tool(name: &str, text: &str, correction: &Correction) -> Result<(), Problems> {
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

/// Returns the first problem with its file and line, and the number of problems.
fn first_problem(problems: &Problems) -> String {
    let all = problems.to_string();
    let first = all.lines().next().unwrap_or_default().to_owned();
    match problems.list.len() {
        0 | 1 => first,
        count => format!("{first} (the first of {count} problems)"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Purpose, incomplete_files};
    use super::*;

    const WHOLE: &str = include_str!("../../../config/cell.toml");

    fn found(cell: &str, read: ReadNamed<'_>) -> Vec<(String, String)> {
        let cell = Cell::check("cell.toml", cell).unwrap_or_else(|problems| panic!("{problems}"));
        incomplete_files(&cell, Purpose::Cycle, read).into_iter().map(|unmet| (unmet.key, unmet.message)).collect()
    }

    /// Each file is reported once, and the remedy is stated once; an existing file is checked as the kind of file that
    /// its key names.
    #[test]
    fn files_that_are_not_there_or_not_right_are_named_once() {
        assert_eq!(found(WHOLE, &skip_file), []);
        let missing = found(WHOLE, &|_| NamedFile::Missing);
        let keys: Vec<&str> = missing.iter().map(|(key, _)| key.as_str()).collect();
        assert!(keys.len() >= 5 && keys.iter().all(|key| key.starts_with("calibration.")), "{keys:?}");
        let advised = missing.iter().filter(|(_, message)| message.contains("panelprep calibrate")).count();
        assert_eq!(
            (advised, missing[0].1.contains("which does not exist; `panelprep demo` creates this file")),
            (1, true)
        );
        let wrong = found(WHOLE, &|_| NamedFile::Text("wavelength = 3".to_owned()));
        assert_eq!(wrong.len(), missing.len(), "{wrong:?}");
        assert!(wrong[0].1.contains("scanner.toml:1: wavelength: unknown key"), "{wrong:?}");
        let unreadable = found(WHOLE, &|_| NamedFile::Unreadable("line 1 is not UTF-8".to_owned()));
        assert!(unreadable[0].1.ends_with("which cannot be read: line 1 is not UTF-8"), "{unreadable:?}");
    }

    /// Calibrations that were measured with the nominal arm, in a cell that corrects the arm.
    #[test]
    fn a_mount_measured_with_another_correction_is_not_right() {
        let cell = "[calibration]\nrobot_correction = \"arm.toml\"\nflange_from_tool = \"tool.toml\"\n";
        let correction = "[robot_correction]\n";
        let tool = |by: &str| {
            format!(
                "[flange_from_tool]\nx_mm = 0\ny_mm = 0\nz_mm = 120\na_deg = 0\nb_deg = 0\nc_deg = 0\naxis_measured = true\n\
                 {by}"
            )
        };
        let of_tool = |by: &str| {
            let read = |file: &Path| match file.ends_with("arm.toml") {
                true => NamedFile::Text(correction.to_owned()),
                false => NamedFile::Text(tool(by)),
            };
            let all = found(cell, &read);
            let of_tool = all.into_iter().filter(|(key, message)| {
                key == "calibration.flange_from_tool" && message.contains("another robot correction")
            });
            of_tool.count()
        };
        let ours = content_hash(correction.as_bytes());
        assert_eq!(of_tool(&format!("robot_correction = \"{ours}\"\n")), 0);
        assert_eq!(of_tool(&format!("robot_correction = \"{}\"\n", content_hash(b"other"))), 1);
        assert_eq!(of_tool(""), 0, "a person wrote it by hand");
    }

    #[test]
    fn settings_of_a_zivid_are_looked_at() {
        let zivid = WHOLE.replacen(
            "[scanner]\nkind = \"simulated\"",
            "[scanner]\nkind = \"zivid\"\nsettings = \"a.yml\"\nsettings_2d = \"b.yml\"",
            1,
        );
        let read = |file: &Path| match file.extension().is_some_and(|ending| ending == "yml") {
            true => NamedFile::Missing,
            false => NamedFile::NotChecked,
        };
        let keys: Vec<String> = found(&zivid, &read).into_iter().map(|(key, _)| key).collect();
        assert_eq!(keys, ["scanner.settings", "scanner.settings_2d"]);
    }
}
