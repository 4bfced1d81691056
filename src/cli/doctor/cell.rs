//! Checks of the cell's files: the store, the calibrations with their age, the controller's EthernetKRL files.

use super::check::Check;
use crate::calib::health::{VerificationLimits, health};
use crate::cell::{Cell, RobotKind};
use crate::check::check_files;
use crate::cli::args::Common;
use crate::cli::calibrate::now_unix_s;
use crate::cli::disk;
use crate::cli::fault::{CalibrationFault, Fault};
use crate::cli::load::{CellFiles, last_touch};
use crate::config::Problem;
use crate::controller::{
    COMMANDS, CONFIG, ControllerFiles, MOTION, PROGRAMS, STATES, SumError, differences, program_sum,
};
use crate::requirements::{Lack, Purpose, Unmet, incomplete};
use crate::store::{Store, StoreError, calibration_hash};
use std::path::Path;

/// Keys with files that have their own check, [`calibrations`] and the scanner's check.
const CHECKED_BELOW: [&str; 7] = [
    "calibration.scanner",
    "calibration.base_from_camera",
    "calibration.flange_camera",
    "calibration.flange_from_camera",
    "calibration.flange_from_tool",
    "scanner.settings",
    "scanner.settings_2d",
];

/// Checks the cell's file, which was already read, and the other files that it names.
pub(super) fn file(common: &Common, files: &CellFiles) -> Vec<Check> {
    let name = common.cell.display().to_string();
    let mut unmet = incomplete(&files.cell, Purpose::Cycle, &disk::read_named);
    unmet.retain(|unmet| unmet.lack == Lack::Value || !CHECKED_BELOW.contains(&unmet.key.as_str()));
    if unmet.is_empty() {
        return vec![Check::right("cell file", name)];
    }
    let advice = format!("correct this entry in {name}; {} need it", Purpose::Cycle.commands());
    let wrong = |Unmet { key, message, .. }| Check::wrong("cell file", format!("{key}: {message}"), &*advice);
    unmet.into_iter().map(wrong).collect()
}

/// Checks whether the store can be read, and whether it waits for a person.
pub(super) fn store(files: &CellFiles) -> (Check, Option<Store>) {
    let folder = files.store_folder().display().to_string();
    let store = match Store::open(files.store_folder()) {
        Ok(store) => store,
        Err(StoreError::Missing { .. }) => {
            let found = format!("no store exists yet in {folder}");
            return (Check::wrong("store", found, "teach the panel: `panelprep teach` creates the store"), None);
        }
        Err(error) => {
            let advice = "check the folder, or restore the last backup of the store";
            return (Check::wrong("store", error.to_string(), advice), None);
        }
    };
    let check = match store.has_open_motion() {
        Ok(false) => Check::right("store", format!("{folder}, no motion open")),
        Ok(true) => Check::wrong(
            "store",
            "a motion is open: a program ended while the robot moved",
            "check the cell, start `panelprep run`, then run `panelprep ctl clear`",
        ),
        Err(error) => Check::wrong("store", error.to_string(), "restore the last backup of the store"),
    };
    (check, Some(store))
}

/// Checks by the hashes whether the scan and the pictures of each taught panel are still those of the teaching.
pub(super) fn taught(store: &Store) -> Vec<Check> {
    let name = "taught panels";
    let panels = match store.panels() {
        Ok(panels) => panels,
        Err(error) => return vec![Check::wrong(name, error.to_string(), "restore the last backup of the store")],
    };
    if panels.is_empty() {
        return vec![Check::wrong(name, "none", "teach the panel: `panelprep teach`")];
    }
    let check = |panel: String| match store.taught(&panel, None) {
        Ok(taught) => {
            let corners = taught.teaching.corners.len();
            let found =
                format!("version {}, scan and {corners} corner pictures unchanged since teaching", taught.version);
            Check::right(format!("taught panel {panel}"), found)
        }
        Err(error) => Check::wrong(
            format!("taught panel {panel}"),
            error.to_string(),
            "a cycle would refuse this panel: teach the panel again, or restore the last backup of the store",
        ),
    };
    panels.into_iter().map(check).collect()
}

/// Checks for each calibration whether it exists, and whether the store contains a recent verification.
pub(super) fn calibrations(files: &CellFiles, store: Option<&Store>) -> Vec<Check> {
    let camera = |name: &str, lens: Result<String, Fault>, mount: Result<String, Fault>| match (lens, mount) {
        (Ok(lens), Ok(mount)) => {
            let hash = match name {
                "flange_camera" => files.hash_with_arm(&[&lens, &mount]),
                _ => calibration_hash(&[&lens, &mount]),
            };
            verified((files, store), name, &hash)
        }
        (Err(fault), _) | (_, Err(fault)) => unread(name, &fault),
    };
    let tool = match files.flange_from_tool() {
        Ok(tool) => match store.and_then(|store| last_touch(store, &files.hash_with_arm(&[&tool.text]))) {
            Some(touch) if touch.error.is_nan() || touch.error > files.cell.limits().verify_limit_mm() => {
                Check::wrong(
                    "calibration of the tool",
                    format!("the last touch deviated by {:.3} mm", touch.error),
                    "run `panelprep calibrate tcp` again, then `panelprep calibrate touch`",
                )
            }
            Some(touch) => {
                Check::right("calibration of the tool", format!("the last touch deviated by {:.3} mm", touch.error))
            }
            None => Check::right(
                "calibration of the tool",
                "no touch is recorded: the robot's own error was not measured",
            ),
        },
        Err(fault) => unread("tool", &fault),
    };
    let (scanner, flange_camera) = (files.scanner(), files.flange_camera());
    vec![
        camera("scanner", scanner.map(|c| c.text), files.base_from_camera().map(|c| c.text)),
        camera("flange_camera", flange_camera.map(|c| c.text), files.flange_from_camera().map(|c| c.text)),
        tool,
    ]
}

fn unread(name: &str, fault: &Fault) -> Check {
    let found = match fault {
        // The advice of the check states how the file is made.
        Fault::Calibration(CalibrationFault::CalibrationAway { file, .. }) => {
            format!("{} does not exist", file.display())
        }
        other => other.to_string(),
    };
    Check::wrong(
        format!("calibration of the {name}"),
        found,
        "`panelprep calibrate --help` describes how to make this calibration",
    )
}

fn verified((files, store): (&CellFiles, Option<&Store>), subject: &str, hash: &str) -> Check {
    let name = format!("calibration of the {subject}");
    let last = match store.map(|store| store.last_verification(subject)) {
        Some(Ok(last)) => last,
        _ => {
            return Check::wrong(
                name,
                "not verified: the store contains no verification",
                "teach the panel, then verify",
            );
        }
    };
    let (now, demands) = (now_unix_s(), VerificationLimits::from_limits(files.cell.limits()));
    let judgement = health(subject, last.as_ref(), hash, now, demands);
    match (judgement.reasons.first(), &last) {
        (Some(reason), _) => {
            let (found, advice) =
                reason.message.rsplit_once("; ").unwrap_or((&reason.message, "verify this calibration again"));
            Check::wrong(name, found, advice)
        }
        (None, Some(last)) => {
            let age_h = (now - last.at_unix_s) as f64 / 3600.0;
            Check::right(name, format!("deviation {:.3} mm, verified {age_h:.1} h ago", last.error))
        }
        (None, None) => Check::wrong(name, "never verified", "run `panelprep calibrate verify`"),
    }
}

/// The checks of the files for the controller.
pub(super) struct Programs {
    pub checks: Vec<Check>,
    /// The checksum that a controller with these files reports.
    pub sum: Option<i32>,
}

const KUKA: &str = "controller files";

/// Checks the files from the controller: they must be valid, match this program's protocol and agree with the
/// cell's file.
pub(super) fn kuka(folder: Option<&Path>, cell: &Cell) -> Programs {
    let nothing = |check| Programs { checks: vec![check], sum: None };
    let Some(folder) = folder else {
        return nothing(match cell.robot().kind() {
            RobotKind::Mock => Check::right(KUKA, "not needed: the mock robot uses built-in files"),
            RobotKind::Eki => Check::open(
                KUKA,
                "",
                "copy CELLCMD.xml, CELLSTAT.xml and all .src and .dat files of Panelprep from the controller into a folder and name this folder with --kuka",
            ),
        });
    };
    let mut checks = Vec::new();
    let mut texts: Vec<(&str, String)> = Vec::new();
    for name in [CONFIG].into_iter().chain(PROGRAMS).chain([COMMANDS, STATES]) {
        match disk::read_controller_text(&folder.join(name)) {
            Ok(text) => texts.push((name, text)),
            Err(error) => {
                let advice = format!("copy {name} as it is on the controller into this folder");
                checks.push(Check::wrong(format!("{KUKA}: {name}"), error.to_string(), advice));
            }
        }
    }
    let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let text = |name: &str| named.iter().find(|(of, _)| *of == name).map(|(_, text)| *text);
    let files = ControllerFiles {
        config: text(CONFIG),
        motion: text(MOTION),
        commands: text(COMMANDS),
        states: text(STATES),
    };
    let reports = check_files(&named, None);
    let of_differences = differences(&files, cell);
    for ((name, _), report) in named.iter().zip(&reports) {
        let of_file = of_differences.iter().filter(|difference| difference.file == *name);
        let mut problems: Vec<&Problem> = report.problems.iter().collect();
        problems.extend(
            of_file.map(|difference| &difference.problem).filter(|problem| !report.problems.contains(problem)),
        );
        checks.extend(problems.into_iter().map(|problem| {
            let found = format!("line {}: {}: {}", problem.line, problem.key, problem.message);
            Check::wrong(
                format!("{KUKA}: {name}"),
                found,
                "correct the file of the controller or the cell's file, so that both agree",
            )
        }));
    }
    let sum = match program_sum(&named) {
        Ok(sum) => Some(sum),
        // Each missing file has its own line above.
        Err(SumError::Missing(_)) => None,
        Err(error) => {
            let advice = "copy all KRL programs of one release of this program's config/kuka to the controller";
            checks.push(Check::wrong(format!("{KUKA}: programs"), error.to_string(), advice));
            None
        }
    };
    checks.extend(sum.map(|sum| kept_sum(sum, cell.robot().programs_sum())));
    if checks.iter().all(|check| check.is_right()) {
        checks.insert(0, Check::right(KUKA, "agree with the cell's file and with the protocol of this program"));
    }
    Programs { checks, sum }
}

/// Compares the checksum of the files with the one with which the cell was accepted.
fn kept_sum(sum: i32, kept: Option<i32>) -> Check {
    let name = format!("{KUKA}: programs");
    match kept {
        Some(kept) if kept == sum => {
            Check::right(name, format!("checksum {sum}, the same as at the acceptance of the cell"))
        }
        Some(kept) => Check::wrong(
            name,
            format!(
                "checksum {sum}, but the cell was accepted with {kept}: programs or cell_config.dat have changed since \
                 the acceptance"
            ),
            "accept the cell again, then set programs_sum in [robot]; or restore the files of the acceptance",
        ),
        None => Check::wrong(
            name,
            format!(
                "checksum {sum}, but the cell's file states no programs_sum: changed programs would not be detected"
            ),
            format!("once the cell is accepted with these files, set programs_sum = {sum} in [robot]"),
        ),
    }
}
