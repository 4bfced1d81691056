//! `panelprep calibrate`: reads pictures and poses, and writes calibration files with the evidence for them.
//!
//! A rejected calibration is not written. A calibration for review is written, and the reasons for the review are
//! reported.

pub mod args;
mod arm_correction;
mod boards;
mod files;
mod hand_eye;
mod intrinsics;
pub mod live;
mod output;
mod robot;
mod scanner;
pub mod tool;
pub mod verify;

pub use files::pose_keys;

use super::args::Common;
use super::fault::Fault;
use super::output::Outcome;
use args::{Calibrate, CalibrationTask};

/// Runs a calibration; `progress` is called with messages during long computations.
///
/// # Errors
/// If a file is invalid, or the data do not determine a calibration. In this case nothing is written.
pub fn run(args: &Calibrate, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    match &args.what {
        CalibrationTask::Intrinsics(args) if args.live.live.is_some() => live::lens(args, common, progress),
        CalibrationTask::Intrinsics(args) => match &args.from_scan {
            Some(scan) => intrinsics::run_from_scan(args, scan),
            None => intrinsics::run(args, progress),
        },
        CalibrationTask::HandEye(args) if args.live.live.is_some() => live::mount(args, common, progress),
        CalibrationTask::HandEye(args) if args.poses.is_some() => hand_eye::run(args, common, progress),
        CalibrationTask::HandEye(args) => hand_eye::run_with_three_points(args, common, progress),
        CalibrationTask::Robot(args) => robot::run(args, common, progress),
        CalibrationTask::Removal(args) => tool::run_removal(args),
        CalibrationTask::Scanner(args) => scanner::run(args, progress),
        CalibrationTask::Tcp(args) => match &args.live {
            Some(folder) => live::tool((args, folder), common),
            None => tool::run_tcp(args, common),
        },
        CalibrationTask::Force(args) => tool::run_force(args, common),
        CalibrationTask::Verify(args) => match &args.live {
            Some(folder) => live::take_target_picture((args, folder), common, progress),
            None => verify::run(args, common, progress),
        },
        CalibrationTask::Touch(args) => match &args.live {
            Some(folder) => live::touch((args, folder), common),
            None => verify::touch(args, common),
        },
        CalibrationTask::History => output::run_history(common),
        CalibrationTask::Strike(args) => output::strike_out(args, common),
    }
}
