//! A client of the service, for a command of this program.

use super::protocol::{MAX_BYTES, ProtocolError, request_line};
use super::request::{Reply, RequestKind};
use panelprep_base::geometry::Joints;
use std::error::Error;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The reason why there is no reply of the service.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No service listens on the socket.
    #[error(
        "{}: no service answers; start `panelprep run` with the same --cell and --store (or `systemctl start panelprep`), \
         then try again", socket.display()
    )]
    NoService {
        /// The socket.
        socket: PathBuf,
    },
    /// The connection failed, or the answer is not a reply.
    #[error("{}: {cause}", socket.display())]
    Failed {
        /// The socket.
        socket: PathBuf,
        /// The problem.
        cause: Box<dyn Error + Send + Sync>,
    },
    /// The request cannot be written as a line.
    #[error(transparent)]
    Request(#[from] ProtocolError),
}

/// Sends a request to the service that listens on this socket, and returns its reply.
///
/// # Errors
/// If no service answers, or its answer is not a reply.
pub fn send_to_service(socket: &Path, what: &RequestKind) -> Result<Reply, ClientError> {
    let named = |cause: std::io::Error| ClientError::Failed { socket: socket.to_owned(), cause: cause.into() };
    let mut stream = UnixStream::connect(socket).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => ClientError::NoService { socket: socket.to_owned() },
        _ => named(error),
    })?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT)).map_err(named)?;
    stream.set_write_timeout(Some(RESPONSE_TIMEOUT)).map_err(named)?;
    let line = request_line(what)?;
    // The service answers a line that is too long before it has read the whole line.
    let written = stream.write_all(line.as_bytes());
    let mut answer = Vec::new();
    let read = BufReader::new(stream).take(MAX_BYTES as u64).read_until(b'\n', &mut answer);
    if answer.is_empty() {
        written.and(read.map(drop)).map_err(named)?;
    }
    serde_json::from_slice(&answer)
        .map_err(|cause| ClientError::Failed { socket: socket.to_owned(), cause: cause.into() })
}

/// Returns the state of the service, if one answers.
pub fn service_state(socket: &Path) -> Option<String> {
    send_to_service(socket, &RequestKind::State).ok()?.state.map(|state| state.to_string())
}

/// Returns the arm's axis angles, if a service answers and has them.
pub fn service_axes(socket: &Path) -> Option<Joints> {
    send_to_service(socket, &RequestKind::State).ok()?.axes_deg.map(Joints::from)
}

/// Time limit for an answer: the service answers a start only after it has loaded the taught data.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);
