//! Errors of the office's page.

use crate::daemon::web::PageFileError;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Errors of the office's page.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// The settings name no address.
    #[error(
        "the archive's settings have no address for the office's page: set listen in [fleet], such as \
         \"127.0.0.1:8444\""
    )]
    NoAddress,
    /// The address cannot be used.
    #[error(
        "{address}: cannot serve the office's page at this address: {source}; set another address at [fleet] listen"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's message.
        source: std::io::Error,
    },
    /// The folder of the archive.
    #[error("cannot create the archive's folder {}: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
    /// The certificate.
    #[error("the office's page: {0}; check certificate and certificate_key in [fleet] of the archive's settings")]
    Certificate(#[from] PageFileError),
}
