//! Why the cell cannot be an edge node.

use std::path::{Path, PathBuf};

/// Why the cell cannot be an edge node. A broker that is not there is none: it is tried again.
#[derive(Debug, thiserror::Error)]
pub enum SparkplugError {
    /// A file.
    #[error("MQTT Sparkplug: {}: {problem}; [sparkplug] in the cell's file names what it uses", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The system gives no thread.
    #[error("MQTT Sparkplug has no thread: {0}")]
    Thread(std::io::Error),
}

impl SparkplugError {
    pub(super) fn file(path: &Path, problem: impl ToString) -> Self {
        SparkplugError::File { path: path.to_owned(), problem: problem.to_string() }
    }
}
