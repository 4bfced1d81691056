//! The office's page: the present state of all cells, their cycles, statistics across cells, verifications and
//! recipes, from the archive. It only reads the archive, so everyone with an account of the office may view it.
//!
//! `access` controls the log-in, `frame` surrounds every page, and each page is a file.

mod access;
mod cells;
mod cycle;
mod cycles;
mod error;
mod frame;
mod numbers;
mod recipes;
mod routes;
mod shared;

pub use error::FleetError;

use super::web::{self, listen_and_serve};
use panelprep_interfaces::archive::reading::Reader;
use panelprep_store::office::{ArchiveSettings, FleetPage};
use shared::Shared;
use std::net::SocketAddr;
use tokio::net::TcpListener;

/// The address at which people open the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FleetAddress {
    /// Address that people open in the browser.
    pub url: String,
    /// The fingerprint of the program's own certificate, if it presents that one.
    pub fingerprint: Option<String>,
}

/// Serves the page until `ended` is received; the callback receives the address once the page listens.
///
/// # Errors
/// If the settings name no address, the address is not available, or a certificate cannot be used.
pub async fn serve(
    settings: &ArchiveSettings,
    on_listening: impl FnOnce(&FleetAddress),
    ended: impl Future<Output = ()>,
) -> Result<(), FleetError> {
    let Some(FleetPage { listen, certificate }) = &settings.fleet else { return Err(FleetError::NoAddress) };
    let failed = |source| FleetError::Listen { address: *listen, source };
    let is_local = listen.ip().is_loopback() && certificate.is_none();
    let certificate = match is_local {
        true => None,
        false => {
            std::fs::create_dir_all(&settings.files)
                .map_err(|source| FleetError::Folder { path: settings.files.clone(), source })?;
            Some(web::certificate(certificate.as_ref(), &settings.files, *listen)?)
        }
    };
    let listener = TcpListener::bind(listen).await.map_err(failed)?;
    let address: SocketAddr = listener.local_addr().map_err(failed)?;
    let is_tls = certificate.is_some();
    on_listening(&FleetAddress {
        url: format!("{}://{address}/", if is_tls { "https" } else { "http" }),
        fingerprint: certificate.as_ref().and_then(|certificate| certificate.fingerprint.clone()),
    });
    let router = routes::router(Shared::new(Reader::new(settings), is_tls));
    tokio::select! {
        () = listen_and_serve(listener, certificate, router) => {}
        () = ended => {}
    }
    Ok(())
}
