//! Pages that this program serves to a browser on the same computer.
//!
//! [`LocalServer`] is the server. It listens only on a loopback address and identifies its pages by a key in their
//! address that only the terminal shows. It refuses requests that name another host, so that no other page in the
//! browser can send a request. All that a page needs is in the program; nothing is loaded from other servers. A session
//! with a page counts how often the person saved, and records whether the person is done.
//!
//! - `drawing`: the region and the masked areas, drawn on the taught picture
//! - `label`: the breaks in a clip, marked over its pictures

pub mod drawing;
pub mod label;
#[cfg(test)]
mod local_client;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::{Json, Router, middleware};
use panelprep_base::random;
use serde_json::json;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;

/// The reason why a page is not served.
#[derive(Debug, thiserror::Error)]
pub enum LocalError {
    /// Other computers could open the page.
    #[error(
        "{address}: this page can be opened only by a browser on this computer; use a loopback address such as \
         127.0.0.1:8090"
    )]
    NotLoopback {
        /// The requested address.
        address: SocketAddr,
    },
    /// The system refuses.
    #[error("{address}: cannot serve the page at this address: {source}; use another port")]
    System {
        /// The requested address.
        address: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
}

/// A server that listens.
pub struct LocalServer {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    key: String,
}

/// The accepted host names: those by which a browser on this computer addresses the server.
struct HostFilter {
    hosts: [String; 2],
}

impl LocalServer {
    /// Listens on a loopback address; port 0 selects a free one.
    ///
    /// # Errors
    /// If other computers can reach the address, or it is in use.
    pub fn listen(address: SocketAddr) -> Result<Self, LocalError> {
        if !address.ip().is_loopback() {
            return Err(LocalError::NotLoopback { address });
        }
        let failed = |source| LocalError::System { address, source };
        let runtime = Builder::new_current_thread().enable_io().enable_time().build().map_err(failed)?;
        let listener = runtime.block_on(TcpListener::bind(address)).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let key = random::token().map_err(failed)?;
        Ok(LocalServer { runtime, listener, address, key })
    }

    /// Returns the address that a person opens in the browser.
    pub fn url(&self) -> String {
        format!("http://{}/{}/", self.address, self.key)
    }

    /// Returns the path of one of the server's pages, below the key.
    pub fn path(&self, page: &str) -> String {
        format!("/{}/{page}", self.key)
    }

    /// Serves these pages until `done` is signalled or dropped.
    ///
    /// # Errors
    /// If the operating system reports an error of the server.
    pub fn serve(self, pages: Router, done: oneshot::Receiver<()>) -> Result<(), LocalError> {
        let LocalServer { runtime, listener, address, .. } = self;
        let gate = Arc::new(HostFilter { hosts: [address.to_string(), format!("localhost:{}", address.port())] });
        let router = pages.layer(middleware::from_fn_with_state(gate, filter_host));
        let until = async {
            #[expect(clippy::let_underscore_must_use, reason = "if the sender is dropped, the page ends as well")]
            let _ = done.await;
        };
        let served = runtime.block_on(async { axum::serve(listener, router).with_graceful_shutdown(until).await });
        served.map_err(|source| LocalError::System { address, source })
    }
}

/// Passes on a request that names this computer as its host, and refuses others. Responses are not cached, and another
/// page cannot show them in a frame.
async fn filter_host(State(gate): State<Arc<HostFilter>>, request: Request<Body>, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    if !host.is_some_and(|host| gate.hosts.iter().any(|own| own == host)) {
        return (StatusCode::FORBIDDEN, "this page can be opened only by a browser on this computer")
            .into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let policy = "default-src 'self'; img-src 'self'; style-src 'self'; script-src 'self'; frame-ancestors 'none'";
    for (name, value) in [
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, header::HeaderValue::from_static(value));
    }
    response
}

/// The number of saves, and the channel that signals that the person is done.
struct Session(Mutex<(u32, Option<oneshot::Sender<()>>)>);

impl Session {
    /// Creates a session in which nothing was saved yet, and the receiver that is notified when the session ends.
    pub fn new() -> (Self, oneshot::Receiver<()>) {
        let (tell, done) = oneshot::channel();
        (Session(Mutex::new((0, Some(tell)))), done)
    }

    /// Counts one save.
    pub fn count_save(&self) {
        self.lock().0 += 1;
    }

    /// Returns how often the person saved.
    pub fn save_count(&self) -> u32 {
        self.lock().0
    }

    /// Signals, once, that the person is done.
    pub fn end(&self) -> Response {
        if let Some(tell) = self.lock().1.take() {
            #[expect(clippy::let_underscore_must_use, reason = "fails if the session has already ended")]
            let _ = tell.send(());
        }
        Json(json!({ "done": true })).into_response()
    }

    fn lock(&self) -> MutexGuard<'_, (u32, Option<oneshot::Sender<()>>)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
