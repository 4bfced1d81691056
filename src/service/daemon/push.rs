//! Transfer of signed records by HTTP to a quality system: the files that `panelprep record export` writes are sent
//! with PUT, each to its own address below the configured address.
//!
//! The transfer runs on a separate thread; no other part of the service waits for it. The files of each signature are
//! sent in this order: the files that the record names, the page, the signature, and finally the record itself. So if
//! the server has a record, it also has everything that the record names. A file is sent again if the server's response
//! was lost. The repeated file has the same address and the same bytes; only the page may differ, because it also shows
//! later signatures.
//!
//! `Connection` is the HTTP connection to the server, and one round of
//! `Sender` puts the next file. The progress is stored in the store's folder (`transfer`).

use super::background::{Background, Plan, Rounds};
use crate::setup::{CellFiles, RecordPdf, cycle_pdf};

use super::transfer;
use super::transfer::PushStatus;
use axum::body::{Body, Bytes, to_bytes};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, HOST, HeaderValue, LOCATION};
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use panelprep_base::trust;
use panelprep_cell::cell::{PushSettings, WebFolder};
use panelprep_cell::record::CycleId;
use panelprep_store::signing;
use panelprep_store::signing::{Statement, StatementContent};
use panelprep_store::store::{SignatureRow, Store};
use rustls::pki_types::ServerName;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

/// The thread that sends to the server; dropping this value ends the thread.
#[derive(Debug)]
pub struct PushSender {
    _background: Background,
}

impl PushSender {
    /// Starts the sender.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn start(parts: PushParts) -> std::io::Result<Self> {
        let plan = Plan {
            name: "push",
            task: "the transfer of signed records to the quality system",
            blocking_threads: 2,
            stack_bytes: None,
        };
        Ok(PushSender { _background: Background::spawn_rounds(plan, move || Sender::new(&parts))? })
    }
}

/// The parts of the service that the sender needs.
pub struct PushParts {
    /// The `[push]` table of the cell's file.
    pub push: PushSettings,
    /// The cell's files, with the pages of cycles.
    pub files: Arc<CellFiles>,
    /// The status that is shown to people.
    pub status: PushStatus,
}

/// Timeout for connecting.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for sending one file and receiving the response.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum number of bytes of a response that are read, and below it maximum number of its characters that are
/// reported.
const MAX_BYTES: usize = 16 * 1_024;
const MAX_REPORTED_CHARACTERS: usize = 200;

/// The HTTP connection to the quality system.
struct Connection {
    target_folder: WebFolder,
    authorization: Option<HeaderValue>,
    tls: Option<TlsConnector>,
    sender: Option<SendRequest<Body>>,
}

impl Connection {
    /// Creates a connection to the address in the cell's file; the server is not contacted yet.
    ///
    /// # Errors
    /// If the token or the certificate cannot be read.
    pub fn new(push: &PushSettings) -> Result<Self, String> {
        let token = push.token_file.as_deref().map(trust::secret).transpose().map_err(|error| error.to_string())?;
        let authorization = token.map(|token| HeaderValue::try_from(format!("Bearer {token}"))).transpose();
        let authorization = authorization.map_err(|_| {
            "the token in the file of [push] contains characters that are not valid in an HTTP header; \
                          write the token again"
                .to_owned()
        })?;
        let config = push.ca_certificate.as_deref().map(|file| trust::client_config(file, None)).transpose();
        let config = config.map_err(|error| error.to_string())?;
        let tls = config.map(|config| TlsConnector::from(Arc::new(config)));
        Ok(Connection { target_folder: push.target_folder.clone(), authorization, tls, sender: None })
    }

    /// Sends a file to its address below the configured address. If the connection of an earlier request is found to be
    /// closed, a new connection is opened.
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
        let late = |_| {
            format!(
                "the server of the quality system did not respond within {} s; the file is sent again \
                                automatically",
                CONNECT_TIMEOUT.as_secs()
            )
        };
        timeout(CONNECT_TIMEOUT, connecting).await.map_err(late)?
    }

    /// Sends a file and returns the response. The connection stays open if it can be used again.
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
        let late = |_| {
            format!(
                "the server of the quality system did not respond within {} s; the file is sent again \
                                automatically",
                RESPONSE_TIMEOUT.as_secs()
            )
        };
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
            reason = "the connection has ended; see the error of the request that used it"
        )]
        let _ = connection.await;
    });
    Ok(sender)
}

/// Returns the status code and a text for people: the first line of the response, or the address to which the server
/// redirects.
async fn read_response(response: Response<hyper::body::Incoming>) -> (StatusCode, String) {
    let status = response.status();
    if status.is_redirection() {
        let place = response.headers().get(LOCATION).and_then(|place| place.to_str().ok()).unwrap_or("nowhere");
        let words =
            format!("the server redirects to {place}; write the address that accepts records as `to` in [push]");
        return (status, words.chars().filter(|c| !c.is_control()).collect());
    }
    let bytes = to_bytes(Body::new(response.into_body()), MAX_BYTES).await.unwrap_or_default();
    let text = String::from_utf8_lossy(&bytes);
    let line = text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    (status, line.chars().filter(|c| !c.is_control()).take(MAX_REPORTED_CHARACTERS).collect())
}

/// Name of the file in the store's folder that contains the number of the signature up to which the files were sent.
const PROGRESS_FILE_NAME: &str = "push.json";
/// Prefix of the names of pictures, recipes and calibrations.
const FILES_PREFIX: &str = "files/";
/// Maximum number of remembered names of such files: most records name the same recipe and calibrations.
const MAX_REMEMBERED_FILES: usize = 50_000;
const JSON: &str = "application/json";
const PDF: &str = "application/pdf";
const BYTES: &str = "application/octet-stream";

/// The last signature for which the server has all files.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
struct Progress {
    to: String,
    number: u64,
    /// SHA-256 of the statement of the last signature.
    record_hash: String,
}

/// A file that must be sent to the server.
#[derive(Clone)]
struct File {
    name: String,
    kind: &'static str,
    bytes: Bytes,
}

/// Returns the files of a cycle's page: the PDF, the page that the cell signs, and the signature.
fn page_files(cycle: CycleId, RecordPdf { pdf, page, signature }: RecordPdf) -> Vec<File> {
    let stem = signing::page_stem(cycle);
    let file = |name: String, kind, bytes: Vec<u8>| File { name, kind, bytes: bytes.into() };
    vec![
        file(signing::pdf_name(cycle), PDF, pdf),
        file(format!("{stem}.sig"), BYTES, signature),
        file(format!("{stem}.json"), JSON, page),
    ]
}

/// Sends the signed records to the server.
struct Sender {
    push: PushSettings,
    folder: PathBuf,
    files: Arc<CellFiles>,
    status: PushStatus,
    progress: Progress,
    store: Option<Store>,
    connection: Option<Connection>,
    /// Names of the files that the server already has.
    stored_names: BTreeSet<String>,
    /// The page of the signature with this number: its files.
    page: Option<(u64, Vec<File>)>,
}

impl Sender {
    pub fn new(parts: &PushParts) -> Self {
        let PushParts { push, files, status } = parts;
        let (push, files, status) = (push.clone(), files.clone(), status.clone());
        let folder = files.store_folder().to_owned();
        let mut progress: Progress = transfer::read_progress(&folder, PROGRESS_FILE_NAME);
        let to = push.target_folder.to_string();
        if progress.to != to {
            progress = Progress { to, ..Progress::default() };
        }
        Sender {
            push,
            folder,
            files,
            status,
            progress,
            store: None,
            connection: None,
            stored_names: BTreeSet::new(),
            page: None,
        }
    }
}

impl Rounds for Sender {
    async fn run_round(&mut self) -> Result<bool, String> {
        // The certificate and the token are read even if there is no file to send, so that errors in them are reported
        // immediately.
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::new(&self.push)?,
        };
        let store = match self.store.take() {
            Some(store) => store,
            None => Store::open(&self.folder).map_err(|error| error.to_string())?,
        };
        self.resume_position(&store)?;
        let waiting = store.next_signature(self.progress.number).map_err(|error| error.to_string())?;
        let Some((row, behind)) = waiting else {
            self.status.lock_waiting().record_backlog(0, None);
            (self.store, self.connection) = (Some(store), Some(connection));
            return Ok(false);
        };
        self.status.lock_waiting().record_backlog(behind, Some(row.unix_ms));
        match self.next_file(&store, &row).await? {
            Some(File { name, kind, bytes }) => {
                connection.put_file(&name, kind, bytes).await?;
                self.stored_names.insert(name);
            }
            None => {
                let (to, number, record_hash) = (self.progress.to.clone(), row.number, row.record_hash.clone());
                self.progress = Progress { to, number, record_hash };
                transfer::write_progress(&self.folder, PROGRESS_FILE_NAME, &self.progress)?;
                // Pictures, recipes and calibrations have the same name in every record, so these names remain in the
                // set.
                self.stored_names.retain(|name| name.starts_with(FILES_PREFIX));
                if self.stored_names.len() >= MAX_REMEMBERED_FILES {
                    self.stored_names.clear();
                }
            }
        }
        (self.store, self.connection) = (Some(store), Some(connection));
        Ok(true)
    }

    fn forget(&mut self) {
        (self.store, self.connection) = (None, None);
    }

    fn report_result(&self, problem: Option<&str>) -> bool {
        self.status.lock_waiting().record_problem(problem)
    }
}

impl Sender {
    /// Continues after the last signature whose files were all sent. If the store was restored from a backup, other
    /// signatures may have the same numbers; all signatures are then sent again.
    fn resume_position(&mut self, store: &Store) -> Result<(), String> {
        let Progress { number, record_hash, .. } = &self.progress;
        if *number == 0 {
            return Ok(());
        }
        let last = store.next_signature(number - 1).map_err(|error| error.to_string())?;
        if last.is_none_or(|(row, _)| row.number != *number || row.record_hash != *record_hash) {
            tracing::warn!(
                "record number {number} in the store differs from the record that was sent last, so the store was \
                 restored: all records are sent again"
            );
            self.progress = Progress { to: self.progress.to.clone(), ..Progress::default() };
        }
        Ok(())
    }

    /// Returns the first file of a cycle's page that the server does not have yet. The page is created once for each
    /// signature.
    async fn next_page_file(&mut self, row: &SignatureRow) -> Result<Option<File>, String> {
        if self.page.as_ref().is_none_or(|(number, _)| *number != row.number) {
            let (files, cycle) = (self.files.clone(), row.cycle);
            let made = tokio::task::spawn_blocking(move || cycle_pdf(&files, cycle)).await;
            let made = made.map_err(|error| error.to_string())?.unwrap_or_else(|problem| {
                tracing::warn!(
                    "cannot send the page of cycle {cycle} to the quality system: {problem}; it is sent \
                                again automatically"
                );
                None
            });
            self.page = Some((row.number, made.map_or(vec![], |made| page_files(cycle, made))));
        }
        let files = self.page.iter().flat_map(|(_, files)| files);
        Ok(files.into_iter().find(|file| !self.stored_names.contains(&file.name)).cloned())
    }

    /// Returns the first file of a signature that the server does not have yet. A file that is damaged, or was deleted
    /// after its retention time, is omitted; `record verify` reports it.
    async fn next_file(&mut self, store: &Store, row: &SignatureRow) -> Result<Option<File>, String> {
        let record = store.blob(&row.record_hash).map_err(|error| error.to_string())?;
        if let StatementContent::Cycle(cycle) = Statement::read(&record).map_err(|error| error.to_string())?.says {
            for (what, hash) in signing::exported_files(&cycle) {
                let name = format!("{FILES_PREFIX}{hash}");
                if self.stored_names.contains(&name) {
                    continue;
                }
                match store.blob(&hash) {
                    Ok(bytes) => return Ok(Some(File { name, kind: BYTES, bytes: bytes.into() })),
                    Err(error) => {
                        tracing::warn!("cannot send {what} of cycle {} to the quality system: {error}", row.cycle);
                        self.stored_names.insert(name);
                    }
                }
            }
        }
        if let Some(file) = self.next_page_file(row).await? {
            return Ok(Some(file));
        }
        let stem = match row.is_of_person {
            false => signing::cycle_stem(row.cycle),
            true => signing::person_signature_stem(row.cycle, row.number),
        };
        let last = [("sig", BYTES, row.signature.clone()), ("json", JSON, record)];
        let mut last = last.into_iter().map(|(ending, kind, bytes)| File {
            name: format!("{stem}.{ending}"),
            kind,
            bytes: bytes.into(),
        });
        Ok(last.find(|file| !self.stored_names.contains(&file.name)))
    }
}
