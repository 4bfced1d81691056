//! What keeps the OPC UA server from being served.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// What keeps the OPC UA server from being served.
#[derive(Debug, thiserror::Error)]
pub enum OpcUaError {
    /// A certificate's file or folder cannot be used.
    #[error("the OPC UA server's certificates: {}: {problem}", file.display())]
    File {
        /// Which.
        file: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// The system refuses the runtime or the address.
    #[error("the OPC UA server cannot be served at {address}: {source}")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// The system gives no thread.
    #[error("the OPC UA server has no thread: {0}")]
    Thread(std::io::Error),
}

impl OpcUaError {
    pub(super) fn file(file: &Path, problem: impl ToString) -> Self {
        OpcUaError::File { file: file.to_owned(), problem: problem.to_string() }
    }
}
