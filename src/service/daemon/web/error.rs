//! Errors of the operator's page.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Errors of the operator's page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The address.
    #[error(
        "{address}: cannot serve the operator's page at this address: {source}; set another address or port at \
         [page] listen"
    )]
    Listen {
        /// The address that the cell's file states.
        address: SocketAddr,
        /// The system's message.
        source: std::io::Error,
    },
    /// A file.
    #[error("the operator's page: {0}; check the files that [page] in the cell's file names")]
    File(#[from] PageFileError),
    /// The system could not start a thread.
    #[error("cannot start the thread of the operator's page: {0}")]
    Thread(std::io::Error),
}

/// A file of the page that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct PageFileError {
    /// The file.
    pub path: PathBuf,
    /// The problem in the file.
    pub problem: String,
}

impl PageFileError {
    pub(super) fn file_error(path: &Path, problem: impl ToString) -> Self {
        PageFileError { path: path.to_owned(), problem: problem.to_string() }
    }
}
