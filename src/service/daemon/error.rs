//! Errors: why a cycle cannot begin or continue.

use super::ports::RecordError;
use crate::requirements::recipe_fits::ForceMismatch;
use panelprep_base::supervision::ThreadFault;

/// The reason why a cycle cannot begin, or why it ended without a verdict.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// A required input or output has no name in the cell's file.
    #[error("the cell's file has no \"{name}\" in [{table}], which a cycle needs; add it")]
    NotWired {
        /// The table.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A key that a cycle needs is missing in the cell's file.
    #[error("the cell's file does not contain {key}, which a cycle needs; add it")]
    NotStated {
        /// The key.
        key: &'static str,
    },
    /// No corner of the panel was taught.
    #[error("no corner of this panel was taught; teach a corner with --corner and --flange")]
    NoCorner,
    /// A corner was taught in an area of the picture in which measurements are not permitted.
    #[error("a taught corner: {0}")]
    CornerOutsideOfLens(String),
    /// The forces in the recipe and those of the tool contradict each other.
    #[error(transparent)]
    Force(#[from] ForceMismatch),
    /// The operating system cannot start the computing thread.
    #[error("cannot start the computing thread: {0}; check the memory of the computer and restart the service")]
    Thread(std::io::Error),
    /// A thread of the program failed; the robot was commanded to stop.
    #[error(transparent)]
    Broken(#[from] ThreadFault),
    /// The store cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
}
