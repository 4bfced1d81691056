//! The page's own server: its address, and connections that keep it waiting.

use super::PageFixture;
use crate::daemon::web::server::{OperatorPage, PageParts};
use panelprep_cell::cell;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

fn parts(site: &PageFixture, listen: SocketAddr) -> PageParts {
    let page = cell::Page {
        listen: Some(listen),
        certificate: None,
        recipes: site.folder.path().to_owned(),
        translations: None,
        idle_min: 30,
        sessions: 3,
    };
    site.parts(page)
}

/// Returns the answer to a request for the page of the cell; `None` if no server answers.
fn asked(address: SocketAddr) -> Option<String> {
    answered(address, &format!("GET /login HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n"))
}

/// Returns the answer to a stop by a visitor without an account.
fn stopped(address: SocketAddr) -> Option<String> {
    let head = format!(
        "POST /request/stop HTTP/1.1\r\nhost: {address}\r\norigin: http://{address}\r\nconnection: close\r\n"
    );
    answered(address, &format!("{head}content-type: application/json\r\ncontent-length: 2\r\n\r\n{{}}"))
}

fn answered(address: SocketAddr, request: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(20))).ok()?;
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    Some(answer)
}

#[test]
fn an_address_that_is_taken_delays_nothing_and_is_served_once_it_is_free() {
    let site = PageFixture::new();
    let other = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = other.local_addr().expect("its address");
    let page = OperatorPage::serve(parts(&site, address)).expect("it continues").expect("an address");
    drop(other);
    let since = Instant::now();
    while !asked(address).is_some_and(|answer| answer.starts_with("HTTP/1.1 200")) {
        assert!(since.elapsed() < Duration::from_secs(30), "never served");
        std::thread::sleep(Duration::from_millis(50));
    }
    drop(page);
    assert_eq!(asked(address), None, "it ends with the service");
}

fn served(site: &PageFixture) -> (OperatorPage, SocketAddr) {
    let page = OperatorPage::serve(parts(site, ([127, 0, 0, 1], 0).into())).expect("served").expect("an address");
    let address = page.url.trim_start_matches("http://").trim_end_matches('/').parse().expect("one");
    (page, address)
}

/// Opens this many connections that each begin with this text.
fn connected(count: usize, address: SocketAddr, begins: &str) -> Vec<TcpStream> {
    let one = |_| {
        let mut stream = TcpStream::connect(address).expect("it listens");
        // The first connections may have been closed already.
        drop(stream.write_all(begins.as_bytes()));
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
        stream
    };
    (0..count).map(one).collect()
}

/// Requests whose bodies never arrive do not block a slot: a stop at the same time is executed at once, and these
/// requests end automatically.
#[test]
fn bodies_that_never_come_keep_no_stop_waiting() {
    let site = PageFixture::new();
    let (_page, address) = served(&site);
    let head = format!("POST /login HTTP/1.1\r\nhost: {address}\r\norigin: http://{address}\r\n");
    let begins = format!("{head}content-type: application/json\r\ncontent-length: 50\r\n\r\n{{");
    let mut silent = connected(520, address, &begins);
    let since = Instant::now();
    let answer = stopped(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(since.elapsed() < Duration::from_secs(10), "{:?}", since.elapsed());
    assert_eq!(site.asked().iter().filter(|asked| asked.starts_with("stop")).count(), 1);
    let mut rest = String::new();
    silent.last_mut().expect("one of them").read_to_string(&mut rest).expect("it is ended");
    assert!(rest.starts_with("HTTP/1.1 4"), "{rest}");
}

/// Viewers of the events without an account keep no one out.
#[test]
fn many_spectators_keep_no_stop_waiting() {
    let site = PageFixture::new();
    let (_page, address) = served(&site);
    let begins = format!("GET /events HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let mut lookers = connected(100, address, &begins);
    let mut rest = String::new();
    lookers[0].read_to_string(&mut rest).expect("the first one has given way");
    assert!(rest.starts_with("HTTP/1.1 200") && rest.contains("text/event-stream"), "{rest}");
    lookers.extend(connected(520, address, &begins));
    let since = Instant::now();
    let answer = stopped(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(since.elapsed() < Duration::from_secs(10), "{:?}", since.elapsed());
    let mut bytes = [0; 1_024];
    assert!(lookers.last_mut().expect("one").read(&mut bytes).expect("open") > 0, "the last one looks on");
}

/// Two hundred unfinished requests do not delay other clients, and are closed.
#[test]
fn slow_clients_delay_no_other_client() {
    let site = PageFixture::new();
    let (_page, address) = served(&site);
    let mut slow: Vec<TcpStream> = (0..200)
        .map(|_| {
            let mut stream = TcpStream::connect(address).expect("it listens");
            stream.write_all(b"POST /request/stop HTTP/1.1\r\nhost: ").expect("sent");
            stream
        })
        .collect();
    let answer = asked(address).expect("answered beside them");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    let stream = slow.last_mut().expect("one of them");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
    let mut rest = String::new();
    stream.read_to_string(&mut rest).expect("it is ended");
    assert!(!rest.contains("200 OK"), "{rest}");
    assert_eq!(site.asked().iter().filter(|asked| asked.starts_with("stop")).count(), 0);
}
