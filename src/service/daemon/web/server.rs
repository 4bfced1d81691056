//! The thread of the operator's page: it listens, handles TLS, and limits time and number of the connections. The time
//! for the body of a request is also limited, so that a client that sends only a head does not occupy a connection
//! slot.
//!
//! The certificate of the page is given in the cell's file, or the program creates one and stores it beside its store.
//! Once a minute the cell is checked for the alarms between cycles (`daemon::alarms`), and the number of requests that
//! were refused without an entry is written to the audit trail.

use super::live_state::{FrameEncoder, LiveState};
use super::page_texts::Translations;
use super::state::{MAX_PAGE_CONNECTIONS, ViewerSlots, Web, WebParts, connection_owner, run_blocking};
use super::{accounts, routes, run_page};
use crate::daemon::background::lower_priority;
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::live_view::LiveView;
use crate::daemon::slots::ActivityHandle;
use axum::Router;
use axum::body::{Body, HttpBody};
use axum::extract::{ConnectInfo, Request};
use axum::middleware::{Next, from_fn, map_request};
use futures_util::stream;
use futures_util::stream::StreamExt;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use panelprep_base::disk;
use panelprep_cell::cell;
use rcgen::{CertificateParams, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use sha2::{Digest, Sha256};
use std::io::{Error, ErrorKind, Write};
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use std::time::Duration;
use tempfile::NamedTempFile;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, oneshot, watch};
use tokio::time::{Instant, sleep, timeout, timeout_at};
use tokio_rustls::TlsAcceptor;

/// Maximum number of connections on which a request is still received although other clients need their slots. A
/// request that is sent in the meantime is processed.
const MAX_DRAINING: usize = 64;
/// Time limit for receiving the rest of a request on a connection whose slot another client needs.
const DRAIN_TIMEOUT: Duration = Duration::from_millis(50);
/// Time limit for the TLS handshake, and for the head of each request.
const REQUEST_HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Delay before an unavailable address is tried again.
const BIND_RETRY_DELAY: Duration = Duration::from_secs(1);
/// Time without accepting data after which a client is treated as disconnected.
const DISCONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Number of threads that wait for the store's disk, hash passwords and encode pictures. The cell's computer has two
/// cores. With twice as many threads, two threads remain for pictures and passwords while two wait for the disk. More
/// threads would only take processor time from the control loop, and a stop needs none of them.
const BLOCKING_THREADS: usize = 4;

/// Errors of the operator's page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The address.
    #[error(
        "{address}: cannot serve the operator's page at this address: {source}; set another address or port at \
         [page] listen"
    )]
    Listen {
        /// The address in the cell's file.
        address: SocketAddr,
        /// The system's message.
        source: std::io::Error,
    },
    /// A file.
    #[error("the operator's page: {0}; check the files that [page] in the cell's file names")]
    File(#[from] PageFileError),
    /// The operating system could not start a thread.
    #[error("cannot start the thread of the operator's page: {0}")]
    Thread(std::io::Error),
}

/// Error: a file of the page cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct PageFileError {
    /// The file.
    pub path: PathBuf,
    /// The problem with the file.
    pub problem: String,
}

impl PageFileError {
    pub(super) fn file_error(path: &Path, problem: impl ToString) -> Self {
        PageFileError { path: path.to_owned(), problem: problem.to_string() }
    }
}

/// The parts of the service that the page needs.
pub struct PageParts {
    /// The `[page]` table of the cell's file.
    pub page: cell::Page,
    /// The store's folder.
    pub folder: PathBuf,
    /// The parts that all interfaces share.
    pub front: InterfaceContext,
    /// The live view of the cameras.
    pub view: LiveView,
}

/// The running operator's page; dropping this value ends it.
#[derive(Debug)]
pub struct OperatorPage {
    /// URL that people open in the browser.
    pub url: String,
    /// Fingerprint of the certificate, if the server uses the certificate of this program.
    pub fingerprint: Option<String>,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl OperatorPage {
    /// Serves the page; `None` if the cell's file contains no address for it. If an address is not available now,
    /// because another program uses it or the network is down, it is tried again; the cell does not wait for its page.
    ///
    /// # Errors
    /// If the certificate or the translation table cannot be used, or the operating system cannot start a thread.
    pub fn serve(parts: PageParts) -> Result<Option<Self>, PageError> {
        let PageParts { page, folder, front, view } = parts;
        let gateway = front.gateway.clone();
        let Some(address) = page.listen else { return Ok(None) };
        let words = load_translations(&page)?;
        let is_local = address.ip().is_loopback() && page.certificate.is_none();
        let certificate = match is_local {
            true => None,
            false => Some(certificate(page.certificate.as_ref(), &folder, address)?),
        };
        let failed = |source| PageError::Listen { address, source };
        let mut builder = Builder::new_current_thread();
        let runtime =
            builder.enable_io().enable_time().max_blocking_threads(BLOCKING_THREADS).build().map_err(failed)?;
        let (listener, address) = match runtime.block_on(TcpListener::bind(address)) {
            Ok(listener) => {
                let address = listener.local_addr().map_err(failed)?;
                (Some(listener), address)
            }
            Err(source) => {
                tracing::warn!("{}; retrying every second", failed(source));
                (None, address)
            }
        };
        let (tell, live) = watch::channel(Arc::new(LiveState::default()));
        let frames = Arc::new(FrameEncoder::new(view));
        let is_tls = certificate.is_some();
        let (idle_min, sessions) = (page.idle_min, page.sessions);
        let hosts = is_local.then(|| [address.to_string(), format!("localhost:{}", address.port())]);
        let parts = WebParts {
            front,
            live,
            frames: frames.clone(),
            translations: words,
            is_tls,
            hosts,
            idle_min,
            sessions,
        };
        let web = Arc::new(Web::new(parts));
        accounts::begin_displays(&web);
        let router = routes::router(&web);
        let (end, ended) = oneshot::channel();
        let fingerprint = certificate.as_ref().and_then(|certificate| certificate.fingerprint.clone());
        let acceptor = certificate.map(|certificate| TlsAcceptor::from(certificate.config));
        let serve = move || {
            lower_priority();
            runtime.spawn(run_page::poll_loop(gateway, frames, tell));
            runtime.spawn(repeat_check(web));
            run(&runtime, (listener, address), (acceptor, router), ended);
        };
        let thread = thread::Builder::new().name("page".to_owned()).spawn(serve).map_err(PageError::Thread)?;
        let url = format!("{}://{address}/", if is_tls { "https" } else { "http" });
        Ok(Some(OperatorPage { url, fingerprint, end: Some(end), thread: Some(thread) }))
    }
}

impl Drop for OperatorPage {
    fn drop(&mut self) {
        drop(self.end.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn load_translations(page: &cell::Page) -> Result<Translations, PageError> {
    let more = match &page.translations {
        None => None,
        Some(file) => {
            let bytes = disk::read(file).map_err(|error| PageFileError::file_error(file, error))?;
            Some(
                String::from_utf8(bytes)
                    .map_err(|_| PageFileError::file_error(file, "the file is not valid UTF-8 text"))?,
            )
        }
    };
    let file = page.translations.clone().unwrap_or_default();
    Ok(Translations::read(more.as_deref()).map_err(|error| PageFileError::file_error(&file, error))?)
}

fn run(
    runtime: &Runtime,
    (listener, address): (Option<TcpListener>, SocketAddr),
    (acceptor, router): (Option<TlsAcceptor>, Router),
    ended: oneshot::Receiver<()>,
) {
    runtime.block_on(async {
        tokio::select! {
            () = async {
                let listener = match listener {
                    Some(listener) => listener,
                    None => bind_with_retries(address).await,
                };
                accept(listener, acceptor, router).await;
            } => {}
            _ = ended => {}
        }
    });
}

/// Tries until the address is free and the network is available, for example after a power failure; meanwhile the cell
/// works without a page.
async fn bind_with_retries(address: SocketAddr) -> TcpListener {
    loop {
        sleep(BIND_RETRY_DELAY).await;
        if let Ok(listener) = TcpListener::bind(address).await {
            tracing::info!("the operator's page is served at {address} now");
            return listener;
        }
    }
}

/// Serves these pages at an address, with or without a certificate, until the returned future is dropped.
#[cfg(feature = "plant")]
pub(in crate::daemon) async fn listen_and_serve(
    listener: TcpListener,
    certificate: Option<Certificate>,
    router: Router,
) {
    accept(listener, certificate.map(|certificate| TlsAcceptor::from(certificate.config)), router).await;
}

async fn accept(listener: TcpListener, acceptor: Option<TlsAcceptor>, router: Router) {
    let places = ViewerSlots::new(MAX_PAGE_CONNECTIONS);
    let attended = Arc::new(Semaphore::new(MAX_PAGE_CONNECTIONS.total + MAX_DRAINING));
    loop {
        let Ok(attended) = attended.clone().acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, from)) => {
                let (acceptor, router) = (acceptor.clone(), router.clone());
                let mut place = places.acquire(connection_owner(from.ip()));
                tokio::spawn(async move {
                    let activity = place.activity_handle();
                    tokio::select! {
                        () = serve_connection(stream, from, acceptor, (router, activity)) => {}
                        () = async {
                            place.wait_until_wanted().await;
                            sleep(DRAIN_TIMEOUT).await;
                        } => {}
                    }
                    drop((place, attended));
                });
            }
            // For example, no file descriptor is free; the client tries again.
            Err(_) => sleep(Duration::from_millis(50)).await,
        }
    }
}

/// The pages for one connection, and the handle that marks the connection as active.
type MonitoredPages = (Router, ActivityHandle<IpAddr>);

async fn serve_connection(
    stream: TcpStream,
    from: SocketAddr,
    acceptor: Option<TlsAcceptor>,
    router: MonitoredPages,
) {
    let socket = socket2::SockRef::from(&stream);
    if socket.set_tcp_user_timeout(Some(DISCONNECT_TIMEOUT)).and_then(|()| socket.set_tcp_nodelay(true)).is_err() {
        return;
    }
    match acceptor {
        None => serve_http(stream, from, router).await,
        Some(acceptor) => {
            if let Ok(Ok(stream)) = timeout(REQUEST_HEAD_TIMEOUT, acceptor.accept(stream)).await {
                serve_http(stream, from, router).await;
            }
        }
    }
}

async fn serve_http(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    from: SocketAddr,
    (router, heard): MonitoredPages,
) {
    let router = router.layer(map_request(with_body_timeout)).layer(axum::Extension(ConnectInfo(from)));
    let heeded = from_fn(move |request: Request, next: Next| {
        heard.mark_active();
        next.run(request)
    });
    let service = TowerToHyperService::new(router.layer(heeded));
    let mut server = http1::Builder::new();
    server.timer(TokioTimer::new()).header_read_timeout(REQUEST_HEAD_TIMEOUT).max_buf_size(64 * 1_024);
    #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
    let _ = server.serve_connection(TokioIo::new(stream), service).await;
}

/// Names of the certificate and key files that the program creates.
const OWN_FILE_NAMES: [&str; 2] = ["page-certificate.pem", "page-key.pem"];

/// The certificate that a server uses for TLS.
pub struct Certificate {
    /// The TLS configuration of the server.
    pub config: Arc<ServerConfig>,
    /// The SHA-256 of the certificate, as browsers show it, if the program created the certificate.
    pub fingerprint: Option<String>,
}

/// Reads the certificate that the cell's file names. If it names none, the program's own certificate is read, which is
/// created if it is missing.
///
/// # Errors
/// If a file cannot be read or written, or does not contain a certificate with its key.
pub fn certificate(
    given: Option<&[PathBuf; 2]>,
    folder: &Path,
    listen: SocketAddr,
) -> Result<Certificate, PageFileError> {
    let own = OWN_FILE_NAMES.map(|name| folder.join(name));
    let files = match given {
        Some(files) => files,
        None => {
            if !own.iter().all(|file| file.is_file()) {
                make_certificate(&own, listen)?;
            }
            &own
        }
    };
    let [text, key] = files;
    let read = |file: &Path| disk::read(file).map_err(|error| PageFileError::file_error(file, error));
    let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_slice_iter(&read(text)?)
        .collect::<Result<_, _>>()
        .map_err(|error| PageFileError::file_error(text, format!("the file is not a PEM certificate: {error}")))?;
    let private = PrivateKeyDer::from_pem_slice(&read(key)?)
        .map_err(|error| PageFileError::file_error(key, format!("the file is not a PEM private key: {error}")))?;
    let first = chain.first().ok_or_else(|| PageFileError::file_error(text, "the file contains no certificate"))?;
    let is_own = given.is_none();
    let fingerprint = is_own.then(|| {
        let bytes = Sha256::digest(first.as_ref());
        bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(":")
    });
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, private))
        .map_err(|error| {
            PageFileError::file_error(text, format!("the certificate cannot be used with its private key: {error}"))
        })?;
    Ok(Certificate { config: Arc::new(config), fingerprint })
}

/// Creates a certificate for this computer, valid for ten years, because each browser must be configured to trust a new
/// one.
fn make_certificate([text, key]: &[PathBuf; 2], listen: SocketAddr) -> Result<(), PageFileError> {
    let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let mut names = vec![host, "localhost".to_owned(), "127.0.0.1".to_owned()];
    names.extend((!listen.ip().is_unspecified()).then(|| listen.ip().to_string()));
    let failed =
        |error: rcgen::Error| PageFileError::file_error(text, format!("cannot create a certificate: {error}"));
    let pair = KeyPair::generate().map_err(failed)?;
    let mut params = CertificateParams::new(names).map_err(failed)?;
    params.distinguished_name.push(rcgen::DnType::CommonName, "Panelprep operator's page");
    let certificate = params.self_signed(&pair).map_err(failed)?;
    write_private_file(key, &pair.serialize_pem())?;
    write_private_file(text, &certificate.pem())
}

/// Writes a file that only its owner can read.
fn write_private_file(file: &Path, text: &str) -> Result<(), PageFileError> {
    let folder = file.parent().unwrap_or(Path::new("."));
    let written = NamedTempFile::new_in(folder).and_then(|mut new| new.write_all(text.as_bytes()).map(|()| new));
    let placed = written.and_then(|new| new.persist(file).map_err(|error| error.error));
    placed.map(drop).map_err(|error| PageFileError::file_error(file, error))
}

/// Time limit for the whole body of a request, after its head.
const BODY_TIMEOUT: Duration = Duration::from_secs(5);

/// Returns the request with a body that ends with an error if it does not arrive in time.
async fn with_body_timeout(request: Request) -> Request {
    let until = Instant::now() + BODY_TIMEOUT;
    request.map(|body| match body.is_end_stream() {
        true => body,
        false => limit_body(body, until),
    })
}

fn limit_body(body: Body, until: Instant) -> Body {
    let parts = stream::unfold(Some(body.into_data_stream()), move |body| async move {
        let mut body = body?;
        match timeout_at(until, body.next()).await {
            Ok(part) => part.map(|part| (part, Some(body))),
            Err(_) => {
                let late = Error::new(ErrorKind::TimedOut, "the request body was not received in time");
                Some((Err(axum::Error::new(late)), None))
            }
        }
    });
    Body::from_stream(parts)
}

/// Interval at which the cell is checked for alarms.
const CHECK_INTERVAL: Duration = Duration::from_secs(60);

/// Repeats the check of the cell while the page is served.
async fn repeat_check(web: Arc<Web>) {
    loop {
        let shared = web.clone();
        run_blocking(move || {
            shared.front.check_alarms();
            shared.count_refusals(shared.now_ms());
        })
        .await;
        tokio::time::sleep(CHECK_INTERVAL).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_certificate_is_made_once_and_its_key_is_private() {
        let folder = tempfile::tempdir().expect("a folder");
        let listen = SocketAddr::from(([0, 0, 0, 0], 8_443));
        let of = || certificate(None, folder.path(), listen).expect("made").fingerprint.expect("its own");
        let first = of();
        assert_eq!((first.len(), of()), (32 * 3 - 1, first.clone()), "the same after a restart");
        let key = folder.path().join(OWN_FILE_NAMES[1]);
        assert_eq!(std::fs::metadata(&key).expect("there").permissions().mode() & 0o777, 0o600);
        std::fs::write(&key, "no key").expect("written");
        let error = certificate(None, folder.path(), listen).err().expect("refused").to_string();
        assert!(error.contains("page-key.pem") && error.contains("not a PEM private key"), "{error}");
    }
}
