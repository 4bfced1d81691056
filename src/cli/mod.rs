//! The command line: arguments, the call of a phase or of the service, and the words for people.
//!
//! A file contains one command, or the commands of one subject: `run` reads files and reports, `stage` computes.

#[cfg(feature = "plant")]
mod archive;
#[cfg(not(feature = "plant"))]
#[path = "without_plant.rs"]
mod archive;
pub mod args;
mod calibrate;
mod check;
mod connecting;
mod ctl;
mod cycle;
pub mod demo;
mod disk;
mod doctor;
mod explain;
mod fault;
mod flange_pose;
mod history;
mod identify;
mod inspect;
mod inspected;
mod label;
mod live;
mod load;
mod locate;
mod mock_robot;
mod new;
mod output;
mod plan;
mod prove;
mod record;
mod render;
mod render_boards;
mod replay;
mod report;
mod robot;
mod run;
mod score;
mod shoot;
mod simulated;
mod store;
mod teach;
mod tune;
mod user;
mod zivid;

pub use fault::Fault;
pub use output::Outcome;

use args::{Arguments, Command};
use std::process::ExitCode;
use tracing::level_filters::LevelFilter;

/// Runs a command, prints its result, and returns the exit code of the process.
pub fn run(arguments: &Arguments) -> ExitCode {
    // Commands that print their own progress log only warnings and errors.
    let usual = match &arguments.command {
        Command::Demo(_) | Command::Cycle(_) | Command::AirRun(_) | Command::Replay(_) => LevelFilter::WARN,
        _ => LevelFilter::INFO,
    };
    output::start_log(usual);
    let common = &arguments.common;
    let outcome = match &arguments.command {
        Command::Demo(args) => demo::run(args, &|line| output::write_progress(line)),
        Command::Render(args) => render::run(args),
        Command::ZividWorker(args) => return zivid::run(args),
        Command::Check(args) => check::run(args),
        Command::Doctor(args) => doctor::run(args, common),
        Command::Explain(args) => explain::run(args),
        Command::Cycle(args) => cycle::run(args, common, &|line| output::write_progress(line)),
        Command::AirRun(args) => cycle::air_run(args, common, &|line| output::write_progress(line)),
        Command::Robot(args) => robot::run(args, common),
        Command::MockRobot(args) => mock_robot::run(args, common, &|line| output::write_progress(line)),
        Command::Run(args) => run::run(args, common),
        Command::Clear => ctl::clear(common),
        Command::Ctl(args) => ctl::run(args, common),
        Command::Calibrate(args) => calibrate::run(args, common, &|line| output::write_progress(line)),
        Command::Teach(args) => teach::run(args, common),
        Command::Shoot(args) => shoot::run(args, common, &|line| output::write_progress(line)),
        Command::Look(args) => locate::run_look(args, common),
        Command::Identify(args) => locate::run_identify(args, common),
        Command::Locate(args) => locate::run(args, common),
        Command::Refine(args) => locate::run_refine(args, common),
        Command::Inspect(args) => inspect::run(args, common),
        Command::Tune(args) => tune::run(args, common),
        Command::Label(args) => label::run(args, common),
        Command::Plan(args) => plan::run(args, common),
        Command::Page(args) => report::run_page(args, common),
        Command::History(args) => history::run(args, common),
        Command::Record(args) => record::run(args, common),
        Command::Store(args) => store::run(args, common),
        Command::Archive(args) => archive::run(args),
        Command::Fleet(args) => archive::run_fleet(args),
        Command::User(args) => user::run(args, common),
        Command::Backup(args) => store::back_up(args, common),
        Command::Restore(args) => store::restore(args, common),
        Command::New(args) => new::run(args, common),
        Command::PackageFiles(args) => explain::write_package_files(args),
        Command::Replay(args) => replay::run(args),
    };
    match outcome {
        Ok(outcome) => outcome.print(common.json),
        Err(fault) => output::print_fault(&fault, common.json),
    }
}
