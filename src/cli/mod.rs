//! The command line: reads files, calls the phases, writes files and texts. Besides the store, it is the only module
//! that uses a clock and a disk, and it is the only one that turns errors into text.
//!
//! Each command is in a file of its name: `run` reads and reports, `stage` computes.

mod archive;
pub mod args;
mod backup;
mod calibrate;
mod check;
mod clear;
mod commissioned;
mod connecting;
mod controller_kind;
mod ctl;
mod cycle;
mod cycle_files;
pub mod demo;
mod demo_tool;
mod disk;
mod doctor;
mod explain;
mod fault;
mod flange_pose;
mod follow;
mod health;
mod history;
mod inspect;
mod inspected;
mod interfaces;
mod interrupts;
mod label;
mod labels;
mod live;
mod load;
mod locate;
mod log;
mod look;
mod mock_robot;
mod new;
mod outcome;
mod output;
mod package_files;
mod page;
mod part;
mod person;
mod pictures;
mod plan;
mod plan_places;
mod prove;
mod record;
mod record_data;
mod record_source;
mod recording;
mod refine;
mod render;
mod render_boards;
mod render_coupons;
mod rendered;
mod replay;
mod report;
mod retention;
mod robot;
mod run;
mod score;
mod score_runs;
mod service_request;
mod setup_source;
mod shoot;
mod store;
mod teach;
mod tool_fault_score;
mod tune;
mod user;
mod validate;
mod work_done;
mod zivid;

pub use fault::Fault;
pub use outcome::Outcome;

use args::{Arguments, Command};
use std::process::ExitCode;
use tracing::level_filters::LevelFilter;

/// Runs a command, prints its result and returns the process's exit code.
pub fn run(arguments: &Arguments) -> ExitCode {
    // Commands that report their progress log only problems.
    let usual = match &arguments.command {
        Command::Demo(_) | Command::Cycle(_) | Command::AirRun(_) | Command::Replay(_) => LevelFilter::WARN,
        _ => LevelFilter::INFO,
    };
    log::start(usual);
    let common = &arguments.common;
    let outcome = match &arguments.command {
        Command::Demo(args) => demo::run(args, &|line| output::write_progress(line)),
        Command::Render(args) => render::run(args),
        Command::ZividWorker(args) => return zivid::worker(args),
        Command::Check(args) => check::run(args),
        Command::Doctor(args) => doctor::run(args, common),
        Command::Explain(args) => explain::run(args),
        Command::Cycle(args) => cycle::run(args, common, &|line| output::write_progress(line)),
        Command::AirRun(args) => cycle::air_run(args, common, &|line| output::write_progress(line)),
        Command::Robot(args) => robot::run(args, common),
        Command::MockRobot(args) => mock_robot::run(args, common, &|line| output::write_progress(line)),
        Command::Run(args) => run::run(args, common),
        Command::Clear => clear::run(common),
        Command::Ctl(args) => ctl::run(args, common),
        Command::Calibrate(args) => calibrate::run(args, common, &|line| output::write_progress(line)),
        Command::Teach(args) => teach::run(args, common),
        Command::Shoot(args) => shoot::run(args, common, &|line| output::write_progress(line)),
        Command::Look(args) => look::run(args, common),
        Command::Locate(args) => locate::run(args, common),
        Command::Refine(args) => refine::run(args, common),
        Command::Inspect(args) => inspect::run(args, common),
        Command::Tune(args) => tune::run(args, common),
        Command::Label(args) => label::run(args, common),
        Command::Plan(args) => plan::run(args, common),
        Command::Page(args) => page::run(args, common),
        Command::History(args) => history::run(args, common),
        Command::Record(args) => record::run(args, common),
        Command::Store(args) => store::run(args, common),
        Command::Archive(args) => archive::run(args),
        Command::Fleet(args) => archive::run_fleet(args),
        Command::User(args) => user::run(args, common),
        Command::Backup(args) => backup::run(args, common),
        Command::Restore(args) => backup::restore(args, common),
        Command::New(args) => new::run(args, common),
        Command::PackageFiles(args) => package_files::run(args),
        Command::Replay(args) => replay::run(args),
    };
    match outcome {
        Ok(outcome) => outcome.print(common.json),
        Err(fault) => outcome::print_fault(&fault, common.json),
    }
}
