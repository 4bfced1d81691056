//! `panelprep calibrate`: reads pictures and poses, writes calibration files with their evidence.
//!
//! A rejected calibration is not written; one under review is written, and its doubts are reported.

pub mod args;
mod arm_correction;
mod board_image;
mod boards;
pub mod date;
mod files;
pub mod force;
mod hand_eye;
mod history;
mod intrinsics;
pub mod live;
mod mounted;
mod output;
mod over_volume;
pub mod removal;
mod robot;
mod robot_advice;
mod scan_lens;
mod scanner;
mod target;
mod taught_corner;
mod tcp;
mod three_points;
mod tips;
mod verification;
pub mod verify;

pub use date::now_unix_s;
pub use files::pose_keys;

use super::args::Common;
use super::fault::Fault;
use super::outcome::Outcome;
use args::{Calibrate, CalibrationTask};

/// Runs a calibration; `progress` reports long work.
///
/// # Errors
/// If a file is invalid, or the data do not determine a calibration. Nothing is written then.
pub fn run(args: &Calibrate, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    match &args.what {
        CalibrationTask::Intrinsics(args) if args.live.live.is_some() => live::lens(args, common, progress),
        CalibrationTask::Intrinsics(args) => match &args.from_scan {
            Some(scan) => scan_lens::run(args, scan),
            None => intrinsics::run(args, progress),
        },
        CalibrationTask::HandEye(args) if args.live.live.is_some() => live::mount(args, common, progress),
        CalibrationTask::HandEye(args) if args.poses.is_some() => hand_eye::run(args, common, progress),
        CalibrationTask::HandEye(args) => three_points::run(args, common, progress),
        CalibrationTask::Robot(args) => robot::run(args, common, progress),
        CalibrationTask::Removal(args) => removal::run(args),
        CalibrationTask::Scanner(args) => scanner::run(args, progress),
        CalibrationTask::Tcp(args) => match &args.live {
            Some(folder) => live::tool((args, folder), common),
            None => tcp::run(args, common),
        },
        CalibrationTask::Force(args) => force::run(args, common),
        CalibrationTask::Verify(args) => match &args.live {
            Some(folder) => live::take_target_picture((args, folder), common, progress),
            None => verify::run(args, common, progress),
        },
        CalibrationTask::Touch(args) => match &args.live {
            Some(folder) => live::touch((args, folder), common),
            None => verify::touch(args, common),
        },
        CalibrationTask::History => history::run(common),
        CalibrationTask::Strike(args) => history::strike_out(args, common),
    }
}
