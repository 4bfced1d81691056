//! Sends requests to the service's socket.

use serde_json::Value;
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Time after which a reply is treated as missing.
pub const RESPONSE_TIMEOUT: Duration = Duration::from_secs(30);

/// Sends one line to the socket and returns the reply.
pub fn ask(socket: &Path, line: &str) -> io::Result<Value> {
    let mut stream = UnixStream::connect(socket)?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT))?;
    stream.write_all(line.as_bytes())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    serde_json::from_str(&answer).map_err(|error| io::Error::other(format!("{error}: {answer}")))
}
