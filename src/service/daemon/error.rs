//! Errors: why a cycle cannot begin or continue.

use super::ports::RecordError;
use panelprep_base::supervision::ThreadFault;

/// The reason why a cycle cannot begin, or why it ended without a verdict.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The system provides no thread for computing.
    #[error("cannot start the computing thread: {0}; check the memory of the computer and restart the service")]
    Thread(std::io::Error),
    /// A thread of the program failed; the robot was commanded to stop.
    #[error(transparent)]
    Broken(#[from] ThreadFault),
    /// The store cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}
