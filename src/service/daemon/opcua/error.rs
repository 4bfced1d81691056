//! The reason why the OPC UA server cannot be served.

use std::path::{Path, PathBuf};

/// A certificate's file or folder cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("certificate file {}: {problem}; [opcua] certificates sets the folder", file.display())]
pub struct OpcUaError {
    /// The file.
    pub file: PathBuf,
    /// The problem.
    pub problem: String,
}

impl OpcUaError {
    pub(super) fn file_error(file: &Path, problem: impl ToString) -> Self {
        OpcUaError { file: file.to_owned(), problem: problem.to_string() }
    }
}
