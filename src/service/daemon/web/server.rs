//! The page's thread: listens, handles TLS, and limits every connection in time and number.

use super::error::{PageError, PageFileError};
use super::frame::FrameEncoder;
use super::live_state::LiveState;
use super::page_texts::Translations;
use super::places::{CONNECTIONS, ViewerSlots, owner};
use super::state::{Web, WebParts};
use super::tls::Certificate;
use super::{bodies, live, login, routes, tls, watching};
use crate::daemon::background::lower_priority;
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::live_view::LiveView;
use crate::daemon::slots::ActivityHandle;
use crate::daemon::sources::RecordSource;
use axum::Router;
use axum::extract::{ConnectInfo, Request};
use axum::middleware::{Next, from_fn, map_request};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use panelprep_base::disk;
use panelprep_cell::cell;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, oneshot, watch};
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;

/// Largest number of connections that must give way and are still read: a request that was sent in the meantime is
/// processed.
const MAX_DRAINING: usize = 64;
/// How long a connection that must give way is still read.
const DRAIN_TIMEOUT: Duration = Duration::from_millis(50);
/// Time within which the TLS handshake, and the head of each request, must arrive.
const REQUEST_HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Time after which an unavailable address is tried again.
const BIND_RETRY_DELAY: Duration = Duration::from_secs(1);
/// A peer that accepts no data for this time is gone.
const DISCONNECT_TIMEOUT: Duration = Duration::from_secs(30);
/// Number of threads that wait for the store's disk, hash passwords and encode pictures. The cell's computer has two
/// cores: with twice as many threads, two readers that wait for the disk leave two for pictures and passwords. More
/// would only take time from the control loop, and a stop needs none of them.
const BLOCKING_THREADS: usize = 4;

/// The parts that the page needs.
pub struct PageParts {
    /// The `[page]` table of the cell's file.
    pub page: cell::Page,
    /// The store's folder.
    pub folder: PathBuf,
    /// The parts that every interface uses.
    pub front: InterfaceContext,
    /// The live view of the cameras.
    pub view: LiveView,
    /// The source of the cycles' pages and of their signatures.
    pub records: Arc<dyn RecordSource>,
}

/// The operator's page; it is served until this is dropped.
#[derive(Debug)]
pub struct OperatorPage {
    /// Address that people open in the browser.
    pub url: String,
    /// The fingerprint of the program's own certificate, if it presents that one.
    pub fingerprint: Option<String>,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl OperatorPage {
    /// Serves the page; `None` if the cell's file names no address. If an address is not available now, since another
    /// program uses it or the network is down, it tries again: the cell does not wait for its page.
    ///
    /// # Errors
    /// If the certificate or the translation table cannot be used, or the system refuses.
    pub fn serve(parts: PageParts) -> Result<Option<Self>, PageError> {
        let PageParts { page, folder, front, view, records } = parts;
        let gateway = front.gateway.clone();
        let Some(address) = page.listen else { return Ok(None) };
        let words = load_translations(&page)?;
        let is_local = address.ip().is_loopback() && page.certificate.is_none();
        let certificate = match is_local {
            true => None,
            false => Some(tls::certificate(page.certificate.as_ref(), &folder, address)?),
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
            records,
            is_tls,
            hosts,
            idle_min,
            sessions,
        };
        let web = Arc::new(Web::new(parts));
        login::begin_displays(&web);
        let router = routes::router(&web);
        let (end, ended) = oneshot::channel();
        let fingerprint = certificate.as_ref().and_then(|certificate| certificate.fingerprint.clone());
        let acceptor = certificate.map(|certificate| TlsAcceptor::from(certificate.config));
        let serve = move || {
            lower_priority();
            runtime.spawn(live::poll_loop(gateway, frames, tell));
            runtime.spawn(watching::repeat_check(web));
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

/// Tries until the address is free and the network is up, as after a power cut: the cell continues without a page
/// meanwhile.
async fn bind_with_retries(address: SocketAddr) -> TcpListener {
    loop {
        sleep(BIND_RETRY_DELAY).await;
        if let Ok(listener) = TcpListener::bind(address).await {
            tracing::info!("the operator's page is served at {address} now");
            return listener;
        }
    }
}

/// Serves these pages on an address, with or without a certificate, until the returned future is dropped.
pub(in crate::daemon) async fn listen_and_serve(
    listener: TcpListener,
    certificate: Option<Certificate>,
    router: Router,
) {
    accept(listener, certificate.map(|certificate| TlsAcceptor::from(certificate.config)), router).await;
}

async fn accept(listener: TcpListener, acceptor: Option<TlsAcceptor>, router: Router) {
    let places = ViewerSlots::new(CONNECTIONS);
    let attended = Arc::new(Semaphore::new(CONNECTIONS.total + MAX_DRAINING));
    loop {
        let Ok(attended) = attended.clone().acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, from)) => {
                let (acceptor, router) = (acceptor.clone(), router.clone());
                let mut place = places.acquire(owner(from.ip()));
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
            // For example, no file descriptor is left: the client tries again.
            Err(_) => sleep(Duration::from_millis(50)).await,
        }
    }
}

/// The pages of one connection, and the handle that marks it as active.
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
    let router = router.layer(map_request(bodies::with_body_timeout)).layer(axum::Extension(ConnectInfo(from)));
    let heeded = from_fn(move |request: Request, next: Next| {
        heard.now();
        next.run(request)
    });
    let service = TowerToHyperService::new(router.layer(heeded));
    let mut server = http1::Builder::new();
    server.timer(TokioTimer::new()).header_read_timeout(REQUEST_HEAD_TIMEOUT).max_buf_size(64 * 1_024);
    #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
    let _ = server.serve_connection(TokioIo::new(stream), service).await;
}
