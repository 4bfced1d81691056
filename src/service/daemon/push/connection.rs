//! One connection to the server: the files are put one after the other.

use axum::body::{Body, Bytes, to_bytes};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, HOST, HeaderValue, LOCATION};
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use panelprep_base::trust;
use panelprep_cell::cell::{PushSettings, WebFolder};
use rustls::pki_types::ServerName;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

/// Timeout for connecting.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for one file and its answer.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum number of bytes of an answer that are read, and that are reported.
const MAX_BYTES: usize = 16 * 1_024;
const MAX_CHARACTERS: usize = 200;

/// The HTTP connection to the quality system.
pub(super) struct Connection {
    target_folder: WebFolder,
    authorization: Option<HeaderValue>,
    tls: Option<TlsConnector>,
    sender: Option<SendRequest<Body>>,
}

impl Connection {
    /// Creates a connection to the address in the cell's file; the server is not contacted yet.
    ///
    /// # Errors
    /// If a file cannot be used.
    pub fn new(push: &PushSettings) -> Result<Self, String> {
        let token = push.token_file.as_deref().map(trust::secret).transpose().map_err(|error| error.to_string())?;
        let authorization = token.map(|token| HeaderValue::try_from(format!("Bearer {token}"))).transpose();
        let authorization = authorization
            .map_err(|_| "the token contains characters that are not valid in an HTTP header".to_owned())?;
        let config = push.ca_certificate.as_deref().map(|file| trust::client_config(file, None)).transpose();
        let config = config.map_err(|error| error.to_string())?;
        let tls = config.map(|config| TlsConnector::from(Arc::new(config)));
        Ok(Connection { target_folder: push.target_folder.clone(), authorization, tls, sender: None })
    }

    /// Puts a file below the folder. If an open connection of an earlier request turns out to be closed, a new one is
    /// opened.
    ///
    /// # Errors
    /// If the server cannot be reached, or does not accept the file.
    pub async fn put_file(&mut self, name: &str, kind: &'static str, bytes: Bytes) -> Result<(), String> {
        let kept = self.sender.take().filter(|sender| !sender.is_closed());
        if let Some(sender) = kept
            && let Ok(response) = self.send_file(sender, (name, kind), bytes.clone()).await
        {
            return self.check_response(name, response);
        }
        let sender = self.connect().await.map_err(|problem| format!("{}: {problem}", self.target_folder))?;
        match self.send_file(sender, (name, kind), bytes).await {
            Ok(response) => self.check_response(name, response),
            Err(problem) => Err(format!("{}/{name}: {problem}", self.target_folder)),
        }
    }

    async fn connect(&self) -> Result<SendRequest<Body>, String> {
        let WebFolder { host, port, .. } = &self.target_folder;
        let connecting = async {
            let stream = TcpStream::connect((host.as_str(), *port)).await.map_err(|error| error.to_string())?;
            let Some(tls) = &self.tls else { return begin_connection(stream).await };
            let name = ServerName::try_from(host.clone()).map_err(|error| error.to_string())?;
            begin_connection(tls.connect(name, stream).await.map_err(|error| error.to_string())?).await
        };
        let late = |_| format!("the server did not respond within {} s", CONNECT_TIMEOUT.as_secs());
        timeout(CONNECT_TIMEOUT, connecting).await.map_err(late)?
    }

    /// Sends a file and returns the answer. The connection is retained if it can be used again.
    async fn send_file(
        &mut self,
        mut sender: SendRequest<Body>,
        (name, kind): (&str, &'static str),
        bytes: Bytes,
    ) -> Result<(StatusCode, String), String> {
        let mut request = Request::new(Body::from(bytes));
        *request.method_mut() = Method::PUT;
        let address = format!("{}/{name}", self.target_folder.path);
        *request.uri_mut() = address.parse().map_err(|error| format!("{error}"))?;
        let headers = request.headers_mut();
        headers.insert(
            HOST,
            HeaderValue::try_from(self.target_folder.authority()).map_err(|error| error.to_string())?,
        );
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
        if let Some(authorization) = &self.authorization {
            headers.insert(AUTHORIZATION, authorization.clone());
        }
        let asking = async {
            sender.ready().await.map_err(|error| error.to_string())?;
            let response = sender.send_request(request).await.map_err(|error| error.to_string())?;
            Ok::<_, String>(read_response(response).await)
        };
        let late = |_| format!("no answer within {} s", RESPONSE_TIMEOUT.as_secs());
        let answered = timeout(RESPONSE_TIMEOUT, asking).await.map_err(late)??;
        self.sender = Some(sender);
        Ok(answered)
    }

    fn check_response(&self, name: &str, (status, words): (StatusCode, String)) -> Result<(), String> {
        if status.is_success() {
            return Ok(());
        }
        let colon = if words.is_empty() { "" } else { ": " };
        Err(format!("{}/{name}: the server responded {status}{colon}{words}", self.target_folder))
    }
}

async fn begin_connection(
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
) -> Result<SendRequest<Body>, String> {
    let (sender, connection) = handshake(TokioIo::new(stream)).await.map_err(|error| error.to_string())?;
    tokio::spawn(async move {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the request on this connection reports how the connection ended"
        )]
        let _ = connection.await;
    });
    Ok(sender)
}

/// Returns the status, and the answer's text for people: its first line, or the address to which the server redirects.
async fn read_response(response: Response<hyper::body::Incoming>) -> (StatusCode, String) {
    let status = response.status();
    if status.is_redirection() {
        let place = response.headers().get(LOCATION).and_then(|place| place.to_str().ok()).unwrap_or("nowhere");
        let words =
            format!("the server redirects to {place}; write the address that accepts records into [push] to");
        return (status, words.chars().filter(|c| !c.is_control()).collect());
    }
    let bytes = to_bytes(Body::new(response.into_body()), MAX_BYTES).await.unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    let line = text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    (status, line.chars().filter(|c| !c.is_control()).take(MAX_CHARACTERS).collect())
}
