//! The checks of `panelprep doctor` for the files of the cell: the store, the calibrations with their age, and the
//! controller's EthernetKRL files.

use super::check::ExaminedItem;
use crate::check::check_files;
use crate::requirements::{ProblemKind, Purpose, UnmetRequirement, incomplete_files};
use crate::setup::{CellFiles, SetupFault, clock::now_unix_s, disk, force_verification, last_touch_check};
use panelprep_base::config::Problem;
use panelprep_cell::cell::{Cell, ProofStage, RobotKind, Unsigned};
use panelprep_cell::controller::{
    COMMANDS, CONFIG, Comparison, ControllerFiles, PROGRAMS, STATES, SUBMIT, SumError, USER, compare, program_sum,
};
use panelprep_store::store::{Store, StoreError, calibration_hash};
use panelprep_vision::calib::health::{TOOL_FORCE, VerificationLimits, health, unit};
use std::net::{IpAddr, ToSocketAddrs};
use std::path::Path;

/// Keys of the cell file whose files have their own check: [`calibrations`] and the check of the scanner.
const SEPARATELY_CHECKED_KEYS: [&str; 7] = [
    "calibration.scanner",
    "calibration.base_from_camera",
    "calibration.flange_camera",
    "calibration.flange_from_camera",
    "calibration.flange_from_tool",
    "scanner.settings",
    "scanner.settings_2d",
];

const RESTORE_ADVICE: &str = "restore the last backup of the store";

/// Checks the cell's file, which was already read, and the other files that it names.
pub(super) fn check_cell_file(files: &CellFiles) -> Vec<ExaminedItem> {
    let name = files.paths().cell.display().to_string();
    let mut unmet = incomplete_files(&files.cell, Purpose::Cycle, &disk::read_referenced);
    unmet
        .retain(|unmet| unmet.kind == ProblemKind::Value || !SEPARATELY_CHECKED_KEYS.contains(&unmet.key.as_str()));
    if unmet.is_empty() {
        return vec![ExaminedItem::passed("cell file", name)];
    }
    let advice = format!("correct this entry in {name}; {} need it", Purpose::Cycle.commands());
    let wrong = |UnmetRequirement { key, message, .. }| {
        ExaminedItem::failed("cell file", format!("{key}: {message}"), &*advice)
    };
    unmet.into_iter().map(wrong).collect()
}

/// Checks whether the store can be read, and whether it waits for a person.
pub(super) fn store(files: &CellFiles) -> (ExaminedItem, Option<Store>) {
    let folder = files.store_folder().display().to_string();
    let store = match Store::open(files.store_folder()) {
        Ok(store) => store,
        Err(StoreError::Missing { .. }) => {
            let found = format!("no store exists yet in {folder}");
            return (
                ExaminedItem::failed("store", found, "teach the panel: `panelprep teach` creates the store"),
                None,
            );
        }
        Err(error) => {
            let advice = "check the folder, or restore the last backup of the store";
            return (ExaminedItem::failed("store", error.to_string(), advice), None);
        }
    };
    let check = match store.has_open_motion() {
        Ok(false) => ExaminedItem::passed("store", format!("{folder}, no motion open")),
        Ok(true) => ExaminedItem::failed(
            "store",
            "a motion is open: a program ended while the robot moved",
            "check the cell, start `panelprep run`, then run `panelprep ctl clear`",
        ),
        Err(error) => ExaminedItem::failed("store", error.to_string(), RESTORE_ADVICE),
    };
    (check, Some(store))
}

/// Checks by the hashes whether the scan and the pictures of each taught panel are still those of the teaching.
pub(super) fn taught(store: &Store) -> Vec<ExaminedItem> {
    let name = "taught panels";
    let panels = match store.panel_names() {
        Ok(panels) => panels,
        Err(error) => {
            return vec![ExaminedItem::failed(name, error.to_string(), RESTORE_ADVICE)];
        }
    };
    if panels.is_empty() {
        return vec![ExaminedItem::failed(name, "none", "teach the panel: `panelprep teach`")];
    }
    let check = |panel: String| match store.taught(&panel, None) {
        Ok(taught) => {
            let corners = taught.teaching.corners.len();
            let found =
                format!("version {}, scan and {corners} corner pictures unchanged since teaching", taught.version);
            ExaminedItem::passed(format!("taught panel {panel}"), found)
        }
        Err(error) => ExaminedItem::failed(
            format!("taught panel {panel}"),
            error.to_string(),
            "a cycle would refuse this panel: teach the panel again, or restore the last backup of the store",
        ),
    };
    panels.into_iter().map(check).collect()
}

/// Checks for each calibration whether it exists, and whether the store contains a recent verification.
pub(super) fn calibrations(files: &CellFiles, store: Option<&Store>) -> Vec<ExaminedItem> {
    let camera =
        |name: &str, lens: Result<String, SetupFault>, mount: Result<String, SetupFault>| match (lens, mount) {
            (Ok(lens), Ok(mount)) => {
                let hash = match name {
                    "flange_camera" => files.hash_with_arm(&[&lens, &mount]),
                    _ => calibration_hash(&[&lens, &mount]),
                };
                verification_check(store, (name, name), &hash, VerificationLimits::from_limits(files.cell.limits()))
            }
            (Err(fault), _) | (_, Err(fault)) => unreadable_check(name, &fault),
        };
    let tool = match files.flange_from_tool() {
        Ok(tool) => touch_check((files, store), &files.hash_with_arm(&[&tool.text])),
        Err(fault) => unreadable_check("tool", &fault),
    };
    let force = force_verification(&files.cell)
        .map(|(hash, demands)| verification_check(store, ("tool's force", TOOL_FORCE), &hash, demands));
    let (scanner, flange_camera) = (files.scanner(), files.flange_camera());
    let all = [
        camera("scanner", scanner.map(|c| c.text), files.base_from_camera().map(|c| c.text)),
        camera("flange_camera", flange_camera.map(|c| c.text), files.flange_from_camera().map(|c| c.text)),
        tool,
    ];
    all.into_iter().chain(force).collect()
}

/// Checks the last touch of the tool; a touch is not required.
fn touch_check((files, store): (&CellFiles, Option<&Store>), hash: &str) -> ExaminedItem {
    let name = "calibration of the tool";
    match store.map_or(Ok(None), |store| last_touch_check(store, hash)) {
        Ok(Some(touch)) if touch.error.is_nan() || touch.error > files.cell.limits().verify_limit_mm() => {
            ExaminedItem::failed(
                name,
                format!("the last touch deviated by {:.3} mm", touch.error),
                "run `panelprep calibrate tcp` again, then `panelprep calibrate touch`",
            )
        }
        Ok(Some(touch)) => ExaminedItem::passed(name, format!("the last touch deviated by {:.3} mm", touch.error)),
        Ok(None) => ExaminedItem::passed(name, "no touch is recorded: the robot's own error was not measured"),
        Err(error) => ExaminedItem::failed(name, error.to_string(), RESTORE_ADVICE),
    }
}

fn unreadable_check(name: &str, fault: &SetupFault) -> ExaminedItem {
    let found = match fault {
        // The advice of the check states how the file is made.
        SetupFault::CalibrationAway { file, .. } => {
            format!("{} does not exist", file.display())
        }
        other => other.to_string(),
    };
    ExaminedItem::failed(
        format!("calibration of the {name}"),
        found,
        "`panelprep calibrate --help` describes how to make this calibration",
    )
}

/// Checks the last verification of a subject as a start checks it.
fn verification_check(
    store: Option<&Store>,
    (what, subject): (&str, &str),
    hash: &str,
    demands: VerificationLimits,
) -> ExaminedItem {
    let name = format!("calibration of the {what}");
    let last = match store.map(|store| store.newest_verification(subject)) {
        Some(Ok(last)) => last,
        Some(Err(error)) => return ExaminedItem::failed(name, error.to_string(), RESTORE_ADVICE),
        None => {
            return ExaminedItem::failed(
                name,
                "not verified: the store contains no verification",
                "teach the panel, then verify",
            );
        }
    };
    let now = now_unix_s();
    let judgement = health(subject, last.as_ref(), hash, now, demands);
    match (judgement.reasons.first(), &last) {
        (Some(reason), _) => {
            let (found, advice) =
                reason.message.rsplit_once("; ").unwrap_or((&reason.message, "verify this calibration again"));
            ExaminedItem::failed(name, found, advice)
        }
        (None, Some(last)) => {
            let age_h = (now - last.at_unix_s) as f64 / 3600.0;
            let found = format!("deviation {:.3} {}, verified {age_h:.1} h ago", last.error, unit(subject));
            ExaminedItem::passed(name, found)
        }
        (None, None) => ExaminedItem::failed(name, "never verified", "run `panelprep calibrate verify`"),
    }
}

/// The results of the checks of the controller's files.
pub(super) struct Programs {
    pub checks: Vec<ExaminedItem>,
    /// The checksum that a controller with these files reports.
    pub sum: Option<i32>,
    /// Whether all files exist and agree with each other and with the cell file.
    pub agree: bool,
}

const KUKA: &str = "controller files";

/// Checks the files of the controller: they must be valid, match the protocol of this program, and agree with the cell
/// file.
pub(super) fn kuka(folder: Option<&Path>, cell: &Cell) -> Programs {
    let nothing = |check| Programs { checks: vec![check], sum: None, agree: false };
    let Some(folder) = folder else {
        return nothing(match cell.robot().kind() {
            RobotKind::Mock => ExaminedItem::passed(KUKA, "not needed: the mock robot uses built-in files"),
            RobotKind::Eki => ExaminedItem::open(
                KUKA,
                "",
                "copy CELLCMD.xml, CELLSTAT.xml and all .src and .dat files of Panelprep from the controller into a folder and name this folder with --kuka",
            ),
        });
    };
    let (texts, mut checks) = read_files(folder);
    let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (*name, text.as_str())).collect();
    let addresses = addresses_of(cell.robot().host());
    let files = ControllerFiles { host_addresses: &addresses, ..ControllerFiles::among(&named) };
    let reports = check_files(&named, None);
    let Comparison { differences, not_compared } = compare(&files, cell);
    for ((name, _), report) in named.iter().zip(&reports) {
        let of_file = differences.iter().filter(|difference| difference.file == *name);
        let mut problems: Vec<&Problem> = report.problems.iter().collect();
        problems.extend(
            of_file.map(|difference| &difference.problem).filter(|problem| !report.problems.contains(problem)),
        );
        checks.extend(problems.into_iter().map(|problem| {
            let found = format!("line {}: {}: {}", problem.line, problem.key, problem.message);
            ExaminedItem::failed(
                format!("{KUKA}: {name}"),
                found,
                "correct the file of the controller or the cell's file, so that both agree",
            )
        }));
    }
    checks.extend(not_compared.into_iter().map(|why| {
        ExaminedItem::failed(
            format!("{KUKA}: not compared"),
            why,
            "write the controller's address as host of [robot]",
        )
    }));
    let is_wrong = checks.iter().any(|check| !check.is_passed());
    let sum = match program_sum(&named) {
        Ok(sum) => Some(sum),
        // Each missing file, each missing value and an edited cell_user.src was already reported by its own check.
        Err(SumError::Missing(_) | SumError::Value { .. } | SumError::UserEdited { .. }) if is_wrong => None,
        Err(error) => {
            let advice = "copy all KRL programs of one release of this program's config/kuka to the controller";
            checks.push(ExaminedItem::failed(format!("{KUKA}: programs"), error.to_string(), advice));
            None
        }
    };
    let agree = sum.is_some() && !is_wrong;
    checks.extend(sum.map(|sum| check_program_checksum(sum, cell.robot().programs_sum())));
    if checks.iter().all(|check| check.is_passed()) {
        checks.insert(
            0,
            ExaminedItem::passed(KUKA, "agree with the cell's file and with the protocol of this program"),
        );
    }
    Programs { checks, sum, agree }
}

/// Reads the controller's files; a missing one is a check that failed. Without KUKA's own program of the submit
/// interpreter it is not known whether a stop is received at all.
fn read_files(folder: &Path) -> (Vec<(&'static str, String)>, Vec<ExaminedItem>) {
    let (mut texts, mut checks) = (Vec::new(), Vec::new());
    for name in [CONFIG].into_iter().chain(PROGRAMS).chain([USER, COMMANDS, STATES]) {
        match disk::read_controller_text(&folder.join(name)) {
            Ok(text) => texts.push((name, text)),
            Err(error) => {
                let advice = format!("copy {name} as it is on the controller into this folder");
                checks.push(ExaminedItem::failed(format!("{KUKA}: {name}"), error.to_string(), advice));
            }
        }
    }
    let submit = format!("{KUKA}: {SUBMIT}");
    if !folder.join(SUBMIT).exists() {
        let why =
            ": not in the folder, so not compared; whether it calls CELL_INIT( ) and CELL_CYCLE( ) is not known";
        let advice = "copy KRC/R1/System/sps.sub as it is on the controller into this folder";
        checks.push(ExaminedItem::open(submit, why, advice));
        return (texts, checks);
    }
    match disk::read_controller_text(&folder.join(SUBMIT)) {
        Ok(text) => texts.push((SUBMIT, text)),
        Err(error) => {
            checks.push(ExaminedItem::failed(submit, error.to_string(), "copy it again as it is on the controller"))
        }
    }
    (texts, checks)
}

/// Returns the IP addresses of a host name; none if the name cannot be resolved on this computer.
fn addresses_of(host: &str) -> Vec<[u8; 4]> {
    let resolved = (host, 0_u16).to_socket_addrs().map(Iterator::collect::<Vec<_>>).unwrap_or_default();
    let four = resolved.into_iter().filter_map(|address| match address.ip() {
        IpAddr::V4(address) => Some(address.octets()),
        IpAddr::V6(_) => None,
    });
    four.collect()
}

/// Checks which stage of the controller's proofs is signed, and what is missing for a cycle on a panel.
pub(super) fn proofs(cell: &Cell) -> ExaminedItem {
    let (name, robot) = ("proofs", cell.robot());
    if robot.kind() == RobotKind::Mock {
        return ExaminedItem::passed(name, "not needed: the mock robot inside the program moves no arm");
    }
    match robot.check_stage_signed(ProofStage::C) {
        Ok(()) => ExaminedItem::passed(
            name,
            "stage C is signed for the accepted programs: a cycle on a panel is permitted",
        ),
        Err(Unsigned { signed, why, .. }) => {
            let permitted = signed.map_or("no motion in automatic mode", ProofStage::permits);
            let next = ProofStage::after(signed).letter();
            ExaminedItem::failed(
                name,
                format!("{why}; permitted: {permitted}"),
                format!(
                    "test stage {next} with `panelprep robot prove --stage {next} --out FILE --by NAME`, sign its page, store the \
                     signature with --sign, then set signed_stage = \"{next}\" in [robot]; a mock controller needs none"
                ),
            )
        }
    }
}

/// Judges whether the controller's programs can be accepted: the files must agree with the cell's file, and a real
/// controller must report their checksum. The result then contains the line for the cell's file; nothing is written.
pub(super) fn acceptance(programs: &Programs, reported: Option<i32>, cell_file: &Path) -> ExaminedItem {
    let name = "acceptance";
    let advice = "correct the checks that failed above, then run this again with --accept";
    match (programs.sum.filter(|_| programs.agree), reported) {
        (None, _) => ExaminedItem::failed(
            name,
            "refused: the controller's files do not all agree with the cell's file, or were not all compared",
            advice,
        ),
        (Some(sum), None) => ExaminedItem::failed(
            name,
            format!("refused: the files have the checksum {sum}, and no real controller reports a checksum"),
            "connect the controller, and stop the service meanwhile, because a controller serves one client",
        ),
        (Some(sum), Some(reported)) if sum != reported => ExaminedItem::failed(
            name,
            format!("refused: the files have the checksum {sum}, and the controller reports {reported}"),
            "cold-start the controller with these files, or copy its files again",
        ),
        (Some(sum), Some(_)) => ExaminedItem::passed(
            name,
            format!(
                "the files agree, and the controller reports their checksum; add to [robot] of {}: programs_sum = {sum}",
                cell_file.display()
            ),
        ),
    }
}

/// Compares the checksum of the files with the one with which the cell was accepted.
fn check_program_checksum(sum: i32, kept: Option<i32>) -> ExaminedItem {
    let name = format!("{KUKA}: programs");
    match kept {
        Some(kept) if kept == sum => {
            ExaminedItem::passed(name, format!("checksum {sum}, the same as at the acceptance of the cell"))
        }
        Some(kept) => ExaminedItem::failed(
            name,
            format!(
                "checksum {sum}, but the cell was accepted with {kept}: programs or cell_config.dat have changed since \
                 the acceptance"
            ),
            "accept the cell again, then set programs_sum in [robot]; or restore the files of the acceptance",
        ),
        None => ExaminedItem::failed(
            name,
            format!(
                "checksum {sum}, but the cell's file states none: a change of the programs would not be detected"
            ),
            "accept these files: run this again with --accept and add the line that it prints",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::write_cell;
    use panelprep_cell::controller::planted::{MISTAKES, texts, unreported_mistakes};
    use panelprep_vision::calib::health::Verification;

    /// Checks these files with the cell file, as if a person had copied them from the controller.
    fn checked(texts: &[(&'static str, String)]) -> Programs {
        let folder = tempfile::tempdir().expect("a folder");
        let mut cell = None;
        for (name, text) in texts {
            match *name {
                "cell" => {
                    cell = Some(Cell::check("cell.toml", text).unwrap_or_else(|problems| panic!("{problems}")))
                }
                name => std::fs::write(folder.path().join(name), text).expect("written"),
            }
        }
        kuka(Some(folder.path()), &cell.expect("a cell"))
    }

    fn wrong(texts: &[(&'static str, String)]) -> Vec<String> {
        let checks = checked(texts).checks.into_iter().filter(|check| !check.is_passed());
        checks.map(|check| check.found).collect()
    }

    #[test]
    fn doctor_reports_each_inserted_error() {
        let [none] = &wrong(&texts())[..] else { panic!("only the sum is not kept") };
        assert!(none.contains("the cell's file states none"), "{none}");
        let missed = unreported_mistakes(wrong);
        assert!(missed.is_empty(), "{} of {}:\n{}", missed.len(), MISTAKES.len(), missed.join("\n"));
    }

    /// A start is refused if the force of a real tool was never verified or with another payload, so doctor reports it.
    #[test]
    fn doctor_checks_the_verification_of_the_force() {
        let folder = tempfile::tempdir().expect("a folder");
        let tool = "[tool]\nkind = 'acf'\nhost = '127.0.0.1'\nstroke_mm = 30\nmin_force_n = -60\nmax_force_n = 100\n\
                    payload_kg = 1.5\n";
        let files = write_cell(folder.path(), tool, &[]);
        let force = |store: Option<&Store>| calibrations(&files, store).pop().expect("an item");
        let missing = force(None);
        assert!(!missing.is_passed() && missing.name == "calibration of the tool's force", "{missing:?}");
        let (hash, demands) = force_verification(&files.cell).expect("needed");
        let verified = |hash: &str| {
            let verification = Verification {
                subject: TOOL_FORCE.to_owned(),
                error: 0.1,
                limit: demands.limit,
                calibration_hash: hash.to_owned(),
                at_unix_s: now_unix_s(),
                struck: None,
            };
            let (store, _) = Store::store_verification_in(files.store_folder(), &verification).expect("kept");
            force(Some(&store))
        };
        let other = verified("ab");
        assert!(!other.is_passed() && other.advice.contains("calibrate force --verify"), "{other:?}");
        let right = verified(&hash);
        assert!(right.is_passed() && right.found.starts_with("deviation 0.100 N"), "{right:?}");
    }

    /// A checksum is accepted only if the files agree and a real controller reports the same checksum.
    #[test]
    fn programs_are_accepted_only_with_the_same_checksum() {
        let programs = checked(&texts());
        let sum = programs.sum.expect("a sum");
        let file = Path::new("cell.toml");
        let accepted = acceptance(&programs, Some(sum), file);
        assert!(accepted.is_passed() && accepted.found.ends_with(&format!("cell.toml: programs_sum = {sum}")));
        for reported in [None, Some(sum + 1)] {
            assert!(!acceptance(&programs, reported, file).is_passed(), "{reported:?}");
        }
        let disagree = Programs { agree: false, ..programs };
        assert!(!acceptance(&disagree, Some(sum), file).is_passed());
        // If sps.sub is missing, doctor reports that it was not compared, and nothing is accepted.
        let mut without = texts();
        without.retain(|(name, _)| *name != SUBMIT);
        let programs = checked(&without);
        let said = programs.checks.iter().find(|check| check.name.ends_with(SUBMIT)).expect("a row");
        assert!(!said.is_passed() && said.found.contains("not compared"), "{said:?}");
        assert!(!acceptance(&programs, Some(sum), file).is_passed());
    }
}
