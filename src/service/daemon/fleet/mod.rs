//! The web page of the office server, from its archive: the present state of all cells, their cycles, statistics across
//! cells, verifications and recipes. The page only reads the archive, so every person with an account there may view
//! it.
//!
//! This file contains the server and the router. `access` controls the log-in; `shared` contains the parts that all
//! pages share, such as the frame around every page; each other file contains the pages of one subject.

mod access;
mod cells;
mod cycles;
mod numbers;
mod shared;

use super::web;
use super::web::{PageFileError, listen_and_serve};
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::{get, post};
use axum::{Router, middleware};
use panelprep_interfaces::archive::reading::Reader;
use panelprep_store::office::{ArchiveSettings, FleetPage};
use shared::Shared;
use std::net::SocketAddr;
use std::path::PathBuf;
use tokio::net::TcpListener;

/// The address of the page, and the fingerprint of its certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FleetAddress {
    /// URL that people open in the browser.
    pub url: String,
    /// Fingerprint of the certificate, if the server uses the certificate of this program.
    pub fingerprint: Option<String>,
}

/// Serves the page until `ended` is received. Calls the callback with the page's address when the server listens.
///
/// # Errors
/// If the settings contain no address, the address is not available, or a certificate cannot be used.
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
    let router = router(Shared::new(Reader::new(settings), is_tls));
    tokio::select! {
        () = listen_and_serve(listener, certificate, router) => {}
        () = ended => {}
    }
    Ok(())
}

/// Errors of the web page of the office server.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// The settings contain no address for the page.
    #[error(
        "the archive's settings have no address for the web page of the office server: set listen in [fleet], such \
         as \"127.0.0.1:8444\""
    )]
    NoAddress,
    /// The server cannot listen at the address.
    #[error(
        "{address}: cannot serve the web page of the office server at this address: {source}; set another address at \
         [fleet] listen"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The system's message.
        source: std::io::Error,
    },
    /// The folder of the archive cannot be created.
    #[error("cannot create the archive's folder {}: {source}; check its path and its permissions", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
    /// The certificate.
    #[error(
        "the web page of the office server cannot be encrypted: {0}; check certificate and certificate_key in \
             [fleet] of the archive's settings"
    )]
    Certificate(#[from] PageFileError),
}

/// Returns the router of all addresses; each request first passes the access check.
fn router(shared: Shared) -> Router {
    Router::new()
        .route("/", get(cells::page))
        .route("/cells.json", get(cells::json))
        .route("/cycles", get(cycles::page))
        .route("/cycles.csv", get(cycles::csv))
        .route("/cycles.json", get(cycles::json))
        .route("/cycle", get(cycles::cycle_page))
        .route("/cycle.json", get(cycles::cycle_json))
        .route("/file/{hash}", get(cycles::serve_file))
        .route("/numbers", get(numbers::page))
        .route("/numbers.csv", get(numbers::csv))
        .route("/numbers.json", get(numbers::json))
        .route("/verifications", get(numbers::verifications_page))
        .route("/verifications.csv", get(numbers::verifications_csv))
        .route("/verifications.json", get(numbers::verifications_json))
        .route("/recipes", get(numbers::recipes_page))
        .route("/recipe", get(numbers::recipe_text))
        .route("/login", get(access::page).post(access::log_in))
        .route("/logout", post(access::log_out))
        .route("/page.css", get(style_sheet))
        .route("/fleet.js", get(script))
        .layer(middleware::from_fn_with_state(shared.clone(), access::require_session))
        .with_state(shared)
}

async fn script() -> impl IntoResponse {
    let headers =
        [(header::CONTENT_TYPE, "text/javascript; charset=utf-8"), (header::CACHE_CONTROL, "max-age=3600")];
    (headers, include_str!("fleet.js"))
}

async fn style_sheet() -> impl IntoResponse {
    let headers = [(header::CONTENT_TYPE, "text/css; charset=utf-8"), (header::CACHE_CONTROL, "max-age=3600")];
    (headers, crate::daemon::web::STYLE_SHEET)
}
