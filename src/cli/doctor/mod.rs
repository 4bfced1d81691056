//! `panelprep doctor`: checks the whole cell and prints one line per check, with advice if a check failed.
//!
//! The command moves nothing and writes nothing. If a prerequisite of a check failed, the check is reported as skipped,
//! which is treated as a failure. `check` contains the checks of the computer, `cell` those of the cell's files,
//! `devices` those of connected devices, and `plant` those of systems outside the cell.

mod cell;
mod check;
mod devices;
mod plant;

use super::args::{Common, Doctor};
use super::ctl;
use super::fault::Fault;
use super::load::CellFiles;
use super::output::Outcome;
pub(in crate::cli) use check::check_low_disk_space;
use check::{Check, Status};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use serde_json::json;

/// Runs all checks and reports their results.
///
/// # Errors
/// Never; what cannot be read is a failed check.
pub fn run(args: &Doctor, common: &Common) -> Result<Outcome, Fault> {
    Ok(outcome(&run_checks(args, common)))
}

/// Runs all checks in order: the computer, the files of the cell, the devices, and the systems outside the cell.
pub(in crate::cli) fn run_checks(args: &Doctor, common: &Common) -> Vec<Check> {
    let mut checks = vec![check::program(), check::check_time_sync()];
    match CellFiles::read(common) {
        Ok(files) => checks.extend(cell_checks(args, common, &files)),
        Err(fault) => {
            checks.push(Check::failed(
                "cell file",
                fault.to_string(),
                "correct this problem; `panelprep check` with this file lists every problem",
            ));
            let rest = ": the cell's file cannot be used";
            checks.push(Check::open("everything else", rest, "correct the cell's file, then run this again"));
        }
    }
    checks
}

fn cell_checks(args: &Doctor, common: &Common, files: &CellFiles) -> Vec<Check> {
    let mut checks = cell::check_cell_file(common, files);
    checks.push(check::disk(files.store_folder()));
    checks.extend(check::recordings(files.store_folder()));
    let (check, store) = cell::store(files);
    checks.push(check);
    checks.extend(check::check_clock_order(files.store_folder()));
    checks.extend(store.iter().flat_map(cell::taught));
    checks.extend(cell::calibrations(files, store.as_ref()));
    let programs = cell::kuka(args.kuka.as_deref(), &files.cell);
    checks.extend(programs.checks.iter().cloned());
    checks.extend(devices::cameras(files, args.warm_up));
    let (of_robot, reported) = devices::robot_and_service(files, programs.sum);
    checks.extend(of_robot);
    checks.push(cell::proofs(&files.cell));
    if args.accept {
        checks.push(cell::acceptance(&programs, reported, &common.cell));
    }
    checks.extend(plant::check_connections(&files.cell));
    checks.extend(devices::check_tool(&files.cell, ctl::service_state(&files.socket()).is_some()));
    checks
}

fn outcome(checks: &[Check]) -> Outcome {
    let wrong: Vec<&Check> = checks.iter().filter(|check| !check.is_passed()).collect();
    let reason = |check: &&Check| Reason::new("not_right", format!("{}: {}", check.name, check.found));
    let verdict = if wrong.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons: wrong.iter().map(reason).collect() });
    let width = checks.iter().map(|check| check.name.chars().count()).max().unwrap_or(0);
    outcome.lines = Vec::new();
    for check in checks {
        let mark = match check.status {
            Status::Right => "ok   ",
            Status::Wrong => "WRONG",
            Status::Open => "open ",
        };
        outcome.add_line(format!("{mark}  {:width$}  {}", check.name, check.found));
        if !check.advice.is_empty() {
            outcome.add_line(format!("       {:width$}  → {}", "", check.advice));
        }
    }
    let (all, right) = (checks.len(), checks.len() - wrong.len());
    outcome.add_line(match wrong.len() {
        0 => format!("all {all} checks passed"),
        _ => format!("{right} of {all} checks passed; correct the first failed check first"),
    });
    let of_check = |check: &Check| {
        let advice = Some(&check.advice).filter(|advice| !advice.is_empty());
        json!({"name": check.name, "ok": check.is_passed(), "found": check.found, "advice": advice})
    };
    outcome.add_value("checks", json!(checks.iter().map(of_check).collect::<Vec<_>>()));
    outcome
}
