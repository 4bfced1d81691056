//! Why a cycle cannot begin or go on.

use super::ports::RecordError;
use crate::supervision::ThreadFault;
use crate::words::fixed;

/// Why a cycle cannot begin, or had to end where no verdict is possible.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// An input or output without a name.
    #[error("the cell's file has no \"{name}\" in [{table}]; a cycle needs it")]
    NotWired {
        /// The table.
        table: &'static str,
        /// The name.
        name: &'static str,
    },
    /// A key that a cycle needs.
    #[error("the cell's file does not state {key}; a cycle needs it")]
    NotStated {
        /// The key.
        key: &'static str,
    },
    /// No corner was taught.
    #[error("no corner of this panel was taught; teach it with --corner and --flange")]
    NoCorner,
    /// A corner was taught where nothing may be measured.
    #[error("a taught corner: {0}")]
    CornerOutsideOfLens(String),
    /// A compliant tool without a force.
    #[error("the recipe states no [path] force_n; the cell's compliant tool needs the force with which it presses")]
    NoForce,
    /// A force that nothing presses with.
    #[error(
        "the recipe states [path] force_n = {found_n}, which has no effect: the cell's [tool] is a spring; take the key out, or use a \
         cell with a compliant tool"
    )]
    ForceOfSpring {
        /// What is stated, N.
        found_n: f64,
    },
    /// More than the tool has.
    #[error(
        "the recipe states [path] force_n = {found_n}; with its band of {band_n} N and the weight of its payload, {} N, which \
         a tool that points up lifts as well, it exceeds [tool] max_force_n, {most_n}",
        fixed(*weight_n, 1)
    )]
    TooMuchForce {
        /// What is stated, N.
        found_n: f64,
        /// The band, N.
        band_n: f64,
        /// The weight of what hangs on it, N.
        weight_n: f64,
        /// The tool's strongest push, N.
        most_n: f64,
    },
    /// The system gives no thread to compute on.
    #[error("the thread that computes cannot start: {0}")]
    Thread(std::io::Error),
    /// A thread of the program failed; the robot was told to stop.
    #[error(transparent)]
    Broken(#[from] ThreadFault),
    /// The store does not write.
    #[error(transparent)]
    Record(#[from] RecordError),
}
