//! A client for the pages on this computer, used in tests.

use std::io::{Read, Write};
use std::net::TcpStream;

/// Returns the address and port in the URL of a page.
pub fn address(url: &str) -> &str {
    url.trim_start_matches("http://").split('/').next().expect("an address")
}

/// Sends a request with this host name to an address, and returns the status and the complete response.
pub fn ask(address: &str, host: &str, request: [&str; 3]) -> (u16, String) {
    let [method, path, body] = request;
    let mut stream = TcpStream::connect(address).expect("it listens");
    let request = format!(
        "{method} {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-type: application/json\r\n\
         content-length: {}\r\n\r\n{body}",
        body.len()
    );
    stream.write_all(request.as_bytes()).expect("sent");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("answered");
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let status = answer.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a status");
    (status, answer)
}
