//! Checks whether a program listens at an address. Nothing is sent.

use std::io::{Error, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Connects to the first of the addresses of `place` that accepts the connection. Each attempt has this time limit;
/// the look-up of the name has the same limit.
///
/// # Errors
/// The reason, as text, if no address accepted the connection.
pub(super) fn connected(place: impl ToSocketAddrs + Send + 'static, within: Duration) -> Result<(), String> {
    let (sender, receiver) = mpsc::channel();
    // A separate thread, because the look-up of a name may last minutes.
    thread::spawn(move || {
        let connect = || {
            let mut last = Error::new(ErrorKind::NotFound, "the host name has no address");
            for address in place.to_socket_addrs()? {
                match TcpStream::connect_timeout(&address, within) {
                    Ok(_) => return Ok(()),
                    Err(error) => last = error,
                }
            }
            Err(last)
        };
        sender.send(connect().map_err(|error: Error| error.to_string()))
    });
    receiver
        .recv_timeout(2 * within)
        .unwrap_or_else(|_| Err(format!("no answer within {} s", 2 * within.as_secs())))
}
