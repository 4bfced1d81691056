//! Pages for a browser on the same computer.
//!
//! The server [`LocalServer`] listens only on a loopback address. The URL of its pages contains a key that is only
//! printed on the terminal. Requests that name another host are refused, so that no other page in the browser can send
//! a request. All files of a page are part of the program; nothing is loaded from other servers. A session counts how
//! many times the person has saved, and records whether the person has ended the page.
//!
//! - `drawing`: the region and the masked areas, drawn on the taught picture
//! - `label`: the breaks in a clip, drawn on its pictures

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

/// The reason why a page cannot be served.
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
    /// The operating system refuses to open the address.
    #[error("{address}: cannot serve the page at this address: {source}; use another port")]
    System {
        /// The requested address.
        address: SocketAddr,
        /// The error of the operating system.
        source: std::io::Error,
    },
}

/// A server that listens on a loopback address.
pub struct LocalServer {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    key: String,
}

/// The accepted host names: the names of the server in a browser on this computer.
struct HostFilter {
    hosts: [String; 2],
}

impl LocalServer {
    /// Listens on a loopback address; port 0 selects a free port.
    ///
    /// # Errors
    /// If other computers can reach the address, or the port is in use.
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

    /// Returns the URL that a person opens in the browser.
    pub fn url(&self) -> String {
        format!("http://{}/{}/", self.address, self.key)
    }

    /// Returns the path of a page, below the key.
    pub fn path(&self, page: &str) -> String {
        format!("/{}/{page}", self.key)
    }

    /// Serves the pages until `done` is signalled or dropped.
    ///
    /// # Errors
    /// If the server cannot be run.
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

/// Passes on requests that name this computer as their host, and refuses all others. Responses are not cached, and
/// cannot be displayed in a frame of another page.
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

/// The number of saves, and the channel that signals the end of the page.
struct Session(Mutex<(u32, Option<oneshot::Sender<()>>)>);

impl Session {
    /// Creates a session without saves, and the receiver that is notified when the session ends.
    pub fn new() -> (Self, oneshot::Receiver<()>) {
        let (tell, done) = oneshot::channel();
        (Session(Mutex::new((0, Some(tell)))), done)
    }

    /// Increases the number of saves.
    pub fn count_save(&self) {
        self.lock().0 += 1;
    }

    /// Returns how many times the person has saved.
    pub fn save_count(&self) -> u32 {
        self.lock().0
    }

    /// Signals once that the person has ended the page.
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
