//! The examination of a cell from the bottom up, with advice for each item that is not right: for `panelprep doctor`, the
//! operator's page and the alarms.
//!
//! It moves nothing and writes nothing. A check with a failed prerequisite is reported as skipped and counts as a
//! failure. `check` contains one item and finds the facts of the computer, `cell` those of the cell's files, `devices`
//! those of connected devices, and `plant` those outside the cell.

mod cell;
mod check;
mod devices;
mod plant;

use super::client::service_state;
use crate::setup::{CellFiles, CellPaths};
pub(super) use check::low_disk_space;
pub use check::{ExaminedItem, ItemStatus};
pub use plant::accept_connection;
use std::path::PathBuf;

/// What an examination does besides looking at the cell as it is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ExaminationOptions {
    /// The folder with the controller's files.
    pub kuka: Option<PathBuf>,
    /// Whether the 3D camera takes shots for ten minutes to warm up.
    pub warm_up: bool,
    /// Whether the controller's programs are to be accepted.
    pub accept: bool,
}

/// Returns all items in order: the computer, the cell's files, the devices, and the systems outside the cell. The
/// examination may take some seconds. If something cannot be read, an item states it.
pub fn examine_cell(options: &ExaminationOptions, paths: &CellPaths) -> Vec<ExaminedItem> {
    let mut checks = vec![check::program(), check::check_time_sync()];
    match CellFiles::read(paths) {
        Ok(files) => checks.extend(cell_checks(options, &files)),
        Err(fault) => {
            checks.push(ExaminedItem::failed(
                "cell file",
                fault.to_string(),
                "correct this problem; `panelprep check` with this file lists every problem",
            ));
            let rest = ": the cell's file cannot be used";
            checks.push(ExaminedItem::open(
                "everything else",
                rest,
                "correct the cell's file, then run this again",
            ));
        }
    }
    checks
}

fn cell_checks(options: &ExaminationOptions, files: &CellFiles) -> Vec<ExaminedItem> {
    let mut checks = cell::check_cell_file(files);
    checks.push(check::disk(files.store_folder()));
    checks.extend(check::recordings(files.store_folder()));
    let (check, store) = cell::store(files);
    checks.push(check);
    checks.extend(check::check_clock_order(files.store_folder()));
    checks.extend(store.iter().flat_map(cell::taught));
    checks.extend(cell::calibrations(files, store.as_ref()));
    let programs = cell::kuka(options.kuka.as_deref(), &files.cell);
    checks.extend(programs.checks.iter().cloned());
    checks.extend(devices::cameras(files, options.warm_up));
    let (of_robot, reported) = devices::robot_and_service(files, programs.sum);
    checks.extend(of_robot);
    checks.push(cell::proofs(&files.cell));
    if options.accept {
        checks.push(cell::acceptance(&programs, reported, &files.paths().cell));
    }
    checks.extend(plant::check_connections(&files.cell));
    checks.extend(devices::check_tool(&files.cell, service_state(&files.socket()).is_some()));
    checks
}
