//! The reason why a cycle cannot begin or continue.

use super::ports::RecordError;
use crate::requirements::recipe_fits::ForceMismatch;
use panelprep_base::supervision::ThreadFault;

/// The reason why a cycle cannot begin, or had to end without a verdict.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// A required input or output has no name in the cell's file.
    #[error("the cell's file has no \"{name}\" in [{table}]; a cycle needs it")]
    NotWired {
        /// The table.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A key that a cycle needs is not stated.
    #[error("the cell's file does not state {key}; a cycle needs it")]
    NotStated {
        /// The key.
        key: &'static str,
    },
    /// No corner was taught.
    #[error("no corner of this panel was taught; teach a corner with --corner and --flange")]
    NoCorner,
    /// A corner was taught in an area of the picture in which measuring is not permitted.
    #[error("a taught corner: {0}")]
    CornerOutsideOfLens(String),
    /// The forces of the recipe and of the tool state do not agree.
    #[error(transparent)]
    Force(#[from] ForceMismatch),
    /// The system provides no thread for computing.
    #[error("cannot start the computing thread: {0}")]
    Thread(std::io::Error),
    /// A thread of the program failed; the robot was commanded to stop.
    #[error(transparent)]
    Broken(#[from] ThreadFault),
    /// The store cannot write.
    #[error(transparent)]
    Record(#[from] RecordError),
}
