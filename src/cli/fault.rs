//! The errors that stop a command, with their messages. This is the only place that knows the errors of all modules.

mod cell;
mod data;

pub use cell::{CalibrationFault, DeviceFault};
pub use data::{ClipFault, RecordFault, TeachingFault};

use panelprep_base::config::Problems;
use panelprep_service::daemon::{ClientError, DaemonError};
use panelprep_service::setup::SetupFault;
use std::error::Error;
use std::path::{Path, PathBuf};

/// The reason why a command failed: invalid input, or a disk error. The exit code is 2 unless stated otherwise.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The cell's set-up, a file or a stage's input cannot be used.
    #[error(transparent)]
    Setup(#[from] SetupFault),
    /// A calibration failed.
    #[error(transparent)]
    Calibration(#[from] CalibrationFault),
    /// A device failed.
    #[error(transparent)]
    Device(#[from] DeviceFault),
    /// A panel cannot be taught, or its taught data cannot be used.
    #[error(transparent)]
    Teaching(#[from] TeachingFault),
    /// A clip or its labels cannot be used or written.
    #[error(transparent)]
    Clip(#[from] ClipFault),
    /// The records do not contain what was requested, or do not accept a part.
    #[error(transparent)]
    Record(#[from] RecordFault),
    /// No message has this code.
    #[error("no message has the code {found}{}; `panelprep explain` lists all codes", nearest.as_ref().map_or(String::new(), |nearest| format!(": did you mean {nearest}?")))]
    NoSuchCode {
        /// The code as the user typed it.
        found: String,
        /// The existing code that is most similar to the typed one.
        nearest: Option<String>,
    },
    /// A text on the command line is not a pose.
    #[error("\"{found}\" is not a {what}: {problem}")]
    NotSixNumbers {
        /// The text that the user typed.
        found: String,
        /// The kind of pose that is expected.
        what: &'static str,
        /// The problem.
        problem: String,
    },
    /// A decision does not state the step on which it is based.
    #[error(
        "{command}: not requested, because the step is missing; read the step with `panelprep ctl state`, then run \
         `panelprep ctl {command} --step N`"
    )]
    NoStep {
        /// The command.
        command: &'static str,
    },
    /// The service does not answer.
    #[error(transparent)]
    Service(#[from] ClientError),
    /// A folder that contains other files.
    #[error("{}: is not empty and was not written by `panelprep render`; name a new folder", folder.display())]
    NotOwnFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// The page of the demo would be accessible from other computers.
    #[error(
        "{address}: the demo has accounts with known passwords, so its page must listen on a loopback address; give an address such as 127.0.0.1:8090"
    )]
    DemoPage {
        /// The requested address.
        address: std::net::SocketAddr,
    },
    /// An account of the operator's page has a problem.
    #[error("account {name}: {problem}")]
    Account {
        /// The name of the account.
        name: String,
        /// The problem.
        problem: String,
    },
    /// The cycle for which the command waited is no longer the last cycle of the service.
    #[error("{} was expected, but the last cycle of the service is {}; see the page of the expected cycle", format_cycle(*waited_for), format_cycle(*found))]
    OtherCycle {
        /// The number of the cycle that was started.
        waited_for: Option<i64>,
        /// The number of the service's last cycle.
        found: Option<i64>,
    },
    /// A new file would be written over another one.
    #[error("{} already exists and is not overwritten; name another file with --out, or move the existing file", file.display())]
    AlreadyExists {
        /// The file.
        file: PathBuf,
    },
    /// A question was not answered.
    #[error("{question} has no answer: give {option}{}", if *is_proposed { ", or --yes to accept the proposed value" } else { "" })]
    NoAnswer {
        /// The question.
        question: String,
        /// The option that answers the question.
        option: &'static str,
        /// Whether there is a proposed value that can be accepted with --yes.
        is_proposed: bool,
    },
    /// The answer to a question is not valid.
    #[error("{option} \"{found}\": {problem}")]
    BadAnswer {
        /// The option.
        option: &'static str,
        /// The answer that was given.
        found: String,
        /// The problem of the answer, and what is valid.
        problem: String,
    },
    /// A thread of the program failed; the exit code is 3.
    #[error(transparent)]
    Broken(#[from] panelprep_base::supervision::ThreadFault),
}

impl From<Problems> for Fault {
    fn from(problems: Problems) -> Self {
        SetupFault::from(problems).into()
    }
}

impl Fault {
    /// Returns the exit code of the command, and the code word for scripts.
    pub fn code(&self) -> (u8, &'static str) {
        match self {
            Fault::Broken(_) => (3, "program_fault"),
            Fault::Device(DeviceFault::Unsigned(_)) => (2, "stage_not_signed"),
            _ => (2, "bad_input"),
        }
    }

    /// Creates the error for a file with a problem.
    pub fn file_fault(file: &Path, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        SetupFault::file_fault(file, cause).into()
    }

    /// Converts the error that ended the control loop.
    pub fn from_loop_error(error: DaemonError) -> Self {
        match error {
            DaemonError::Broken(fault) => Fault::Broken(fault),
            other => Fault::stage(other),
        }
    }

    /// Converts the error of a stage.
    pub fn stage(cause: impl Error + Send + Sync + 'static) -> Self {
        SetupFault::stage(cause).into()
    }
}

fn format_cycle(cycle: Option<i64>) -> String {
    cycle.map_or("no cycle".to_owned(), |cycle| format!("cycle {cycle}"))
}
