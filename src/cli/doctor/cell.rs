//! Facts of the cell's files: the store, the calibrations with their age, the controller's EthernetKRL files.

use super::check::Check;
use crate::calib::health::{Demands, health};
use crate::cell::{Cell, RobotKind};
use crate::check::check_files;
use crate::cli::args::Common;
use crate::cli::calibrate::now_unix_s;
use crate::cli::disk;
use crate::cli::fault::{CalibrationFault, Fault};
use crate::cli::load::{CellFiles, last_touch};
use crate::eki::{CELLCMD, CELLSTAT, ChannelFile};
use crate::requirements::{Lack, Purpose, Unmet, incomplete};
use crate::store::{Store, StoreError, calibration_hash};
use std::path::Path;

/// Keys whose files have a check of their own, [`calibrations`] and that of the scanner.
const CHECKED_BELOW: [&str; 7] = [
    "calibration.scanner",
    "calibration.base_from_camera",
    "calibration.flange_camera",
    "calibration.flange_from_camera",
    "calibration.flange_from_tool",
    "scanner.settings",
    "scanner.settings_2d",
];

/// The cell's file, which was read, and the other files that it names.
pub(super) fn file(common: &Common, files: &CellFiles) -> Vec<Check> {
    let name = common.cell.display().to_string();
    let mut unmet = incomplete(&files.cell, Purpose::Cycle, &disk::read_named);
    unmet.retain(|unmet| unmet.lack == Lack::Value || !CHECKED_BELOW.contains(&unmet.key.as_str()));
    if unmet.is_empty() {
        return vec![Check::right("cell file", name)];
    }
    let advice = format!("change it in {name}; {} need it", Purpose::Cycle.commands());
    let wrong = |Unmet { key, message, .. }| Check::wrong("cell file", format!("{key}: {message}"), &*advice);
    unmet.into_iter().map(wrong).collect()
}

/// The store: can it be read, and does it wait for a person?
pub(super) fn store(files: &CellFiles) -> (Check, Option<Store>) {
    let folder = files.store_folder().display().to_string();
    let store = match Store::open(files.store_folder()) {
        Ok(store) => store,
        Err(StoreError::Missing { .. }) => {
            let found = format!("none yet in {folder}");
            return (Check::wrong("store", found, "it is made by `panelprep teach`: teach the panel"), None);
        }
        Err(error) => {
            let advice = "nothing was changed; look at the folder, or bring back its last copy";
            return (Check::wrong("store", error.to_string(), advice), None);
        }
    };
    let check = match store.has_open_motion() {
        Ok(false) => Check::right("store", format!("{folder}, no motion open")),
        Ok(true) => Check::wrong(
            "store",
            "a motion is open: a program ended while the robot moved",
            "look at the cell, start `panelprep run`, then `panelprep ctl clear`",
        ),
        Err(error) => Check::wrong("store", error.to_string(), "bring back the store's last copy"),
    };
    (check, Some(store))
}

/// Each taught panel: are its scan and its pictures still those that were taught, by their hashes?
pub(super) fn taught(store: &Store) -> Vec<Check> {
    let name = "taught panels";
    let panels = match store.panels() {
        Ok(panels) => panels,
        Err(error) => return vec![Check::wrong(name, error.to_string(), "bring back the store's last copy")],
    };
    if panels.is_empty() {
        return vec![Check::wrong(name, "none", "teach the panel: `panelprep teach`")];
    }
    let check = |panel: String| match store.taught(&panel, None) {
        Ok(taught) => {
            let corners = taught.teaching.corners.len();
            let found =
                format!("version {}, its scan and {corners} corner pictures as they were taught", taught.version);
            Check::right(format!("taught panel {panel}"), found)
        }
        Err(error) => Check::wrong(
            format!("taught panel {panel}"),
            error.to_string(),
            "a cycle would refuse it: teach it again, or bring back the store's last copy",
        ),
    };
    panels.into_iter().map(check).collect()
}

/// Each calibration: is it there, and was it verified lately, as the store says?
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
                    format!("the last touch was {:.3} mm off", touch.error),
                    "run `panelprep calibrate tcp` again, then `panelprep calibrate touch`",
                )
            }
            Some(touch) => Check::right("calibration of the tool", format!("last touch {:.3} mm off", touch.error)),
            None => Check::right("calibration of the tool", "never touched: the robot's own error is not measured"),
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
        // How it is made is the advice.
        Fault::Calibration(CalibrationFault::CalibrationAway { file, .. }) => {
            format!("{} is not there", file.display())
        }
        other => other.to_string(),
    };
    Check::wrong(format!("calibration of the {name}"), found, "run `panelprep calibrate --help` for how it is made")
}

fn verified((files, store): (&CellFiles, Option<&Store>), subject: &str, hash: &str) -> Check {
    let name = format!("calibration of the {subject}");
    let last = match store.map(|store| store.last_verification(subject)) {
        Some(Ok(last)) => last,
        _ => {
            return Check::wrong(name, "not verified: there is no store that says so", "teach and verify first");
        }
    };
    let (now, demands) = (now_unix_s(), Demands::of(files.cell.limits()));
    let judgement = health(subject, last.as_ref(), hash, now, demands);
    match (judgement.reasons.first(), &last) {
        (Some(reason), _) => {
            let (found, advice) = reason.message.rsplit_once("; ").unwrap_or((&reason.message, "verify it again"));
            Check::wrong(name, found, advice)
        }
        (None, Some(last)) => {
            let age_h = (now - last.at_unix_s) as f64 / 3600.0;
            Check::right(name, format!("{:.3} mm off, verified {age_h:.1} h ago", last.error))
        }
        (None, None) => Check::wrong(name, "never verified", "run `panelprep calibrate verify`"),
    }
}

/// What the files for the controller say.
pub(super) struct Programs {
    pub checks: Vec<Check>,
    /// Checksum of the KRL programs, as their data list states it.
    pub sum: Option<i32>,
}

const KUKA: &str = "EthernetKRL files";

/// The files for the controller: right, the same as this program speaks, on the ports of the cell's file.
pub(super) fn kuka(folder: Option<&Path>, cell: &Cell) -> Programs {
    let nothing = |check| Programs { checks: vec![check], sum: None };
    let Some(folder) = folder else {
        return nothing(match cell.robot().kind() {
            RobotKind::Mock => Check::right(KUKA, "not needed: the mock robot has its own"),
            RobotKind::Eki => Check::wrong(
                KUKA,
                "not looked at",
                "copy the controller's CELLCMD.xml, CELLSTAT.xml and cell_data.dat into a folder and name it by --kuka",
            ),
        });
    };
    let ports = [cell.robot().command_port(), cell.robot().state_port()];
    let channels = [("CELLCMD.xml", CELLCMD, ports[0]), ("CELLSTAT.xml", CELLSTAT, ports[1])];
    let checks = channels.map(|(name, ours, port)| channel(folder, (name, ours), port)).to_vec();
    let data = disk::read_controller_text(&folder.join("cell_data.dat")).unwrap_or_default();
    let stated = data.split("CELL_PROGRAM_SUM=").nth(1).map(|rest| rest.lines().next().unwrap_or_default().trim());
    Programs { checks, sum: stated.and_then(|digits| digits.parse().ok()) }
}

fn channel(folder: &Path, (name, ours): (&str, &str), port: u16) -> Check {
    let (file, title) = (folder.join(name), format!("{KUKA}: {name}"));
    let copy = format!("copy {name} of this program's config/kuka to the controller and make it read its I/O anew");
    let text = match disk::read_controller_text(&file) {
        Ok(text) => text,
        Err(error) => return Check::wrong(title, error.to_string(), copy),
    };
    let report = check_files(&[(name, &text)], None).swap_remove(0);
    if let [problem, ..] = report.problems.as_slice() {
        return Check::wrong(title, format!("line {}: {}: {}", problem.line, problem.key, problem.message), copy);
    }
    let (theirs, ours) = match (ChannelFile::parse(&text), ChannelFile::parse(ours)) {
        (Ok(theirs), Ok(ours)) => (theirs, ours),
        (Err(error), _) | (_, Err(error)) => return Check::wrong(title, error.to_string(), copy),
    };
    if theirs.port != port {
        let found = format!("listens on port {}, the cell's file says {port}", theirs.port);
        return Check::wrong(
            title,
            found,
            "make both the same: PORT in the file, command_port and state_port in [robot]",
        );
    }
    // Address and port are the cell's own business.
    let as_ours = ChannelFile { address: ours.address.clone(), port: ours.port, ..theirs };
    if as_ours != ours {
        let what = if as_ours.received != ours.received {
            "what the controller receives"
        } else if as_ours.sent != ours.sent {
            "what the controller sends"
        } else {
            "the channel's settings"
        };
        return Check::wrong(title, format!("{what}: other than this program's own file says"), copy);
    }
    Check::right(title, format!("as this program speaks, on port {port}"))
}
