//! `panelprep zivid-worker`: this program as the worker of the Zivid camera.

use super::args::ZividWorker;
use panelprep_devices::zivid::library::Sdk;
use panelprep_devices::zivid::{process, worker};
use std::path::Path;
use std::process::ExitCode;

/// Serves the daemon at the other end of standard input until the daemon closes the connection.
pub fn run(args: &ZividWorker) -> ExitCode {
    match serve_worker(&args.library) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("the worker process of the 3D camera stopped: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve_worker(library: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let mut daemon =
        process::daemon().map_err(|error| format!("only the panelprep service may start this command: {error}"))?;
    match Sdk::open(library) {
        Ok(sdk) => Ok(worker::serve(daemon, Box::new(sdk))?),
        Err(error) => {
            worker::send_hello(&mut daemon, Err(error.to_string()))?;
            Err(error.into())
        }
    }
}
