//! A minimal HTTP client for the soak test: one request per connection, with the response read to its end.

use super::asking::RESPONSE_TIMEOUT;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};

/// The status of a response, and the session that the response begins.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub session: Option<String>,
}

pub fn connect(page: SocketAddr) -> io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(&page, RESPONSE_TIMEOUT)?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT))?;
    stream.set_write_timeout(Some(RESPONSE_TIMEOUT))?;
    Ok(stream)
}

/// Returns the header of a request, including the empty line at its end.
pub fn head(page: SocketAddr, what: &str, session: Option<&str>) -> String {
    let cookie = session.map(|session| format!("cookie: {session}\r\n")).unwrap_or_default();
    format!("{what} HTTP/1.1\r\nhost: {page}\r\n{cookie}")
}

pub fn get(page: SocketAddr, path: &str, session: Option<&str>) -> io::Result<Answer> {
    let head = head(page, &format!("GET {path}"), session);
    ask(page, &format!("{head}connection: close\r\n\r\n"))
}

/// Sends a form as the page's own script does.
pub fn post(page: SocketAddr, path: &str, body: &str) -> io::Result<Answer> {
    let head = head(page, &format!("POST {path}"), None);
    let length = body.len();
    ask(
        page,
        &format!(
            "{head}origin: http://{page}\r\ncontent-type: application/json\r\ncontent-length: {length}\r\n\
             connection: close\r\n\r\n{body}"
        ),
    )
}

fn ask(page: SocketAddr, request: &str) -> io::Result<Answer> {
    let mut stream = connect(page)?;
    stream.write_all(request.as_bytes())?;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes)?;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4_096)]);
    let status = text.split_whitespace().nth(1).and_then(|status| status.parse().ok());
    let session =
        text.lines().find_map(|line| Some(line.strip_prefix("set-cookie: ")?.split_once(';')?.0.to_owned()));
    let status = status.ok_or_else(|| io::Error::other(format!("no answer: {text}")))?;
    Ok(Answer { status, session })
}
