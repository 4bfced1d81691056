//! The clients of the service: those that send requests, and those that send nothing.

use super::asking::{RESPONSE_TIMEOUT, ask};
use super::cell::{Prepared, VIEWER};
use super::http;
use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, Scope};
use std::time::{Duration, Instant};

/// Number of programs that poll the socket.
const POLLERS: usize = 3;
/// Number of clients that read the events of a page.
const FOLLOWERS: usize = 4;
/// Number of clients that open and leave pages, as people do.
const READERS: usize = 2;
/// Number of connections of each kind that send nothing or half a request.
const SILENT_CLIENTS: usize = 6;
/// Time without an event after which the check fails; the service reports the state of the cell at least once per
/// second.
const EVENT_TIMEOUT: Duration = Duration::from_secs(20);

/// Counts that all clients share.
#[derive(Debug, Default)]
pub struct Counts {
    ends: AtomicBool,
    pub states: AtomicU64,
    pub orders: AtomicU64,
    pub pages: AtomicU64,
    pub refused_pages: AtomicU64,
    pub events: AtomicU64,
    pub silent: AtomicU64,
    pub refused_connections: AtomicU64,
    pub recordings: AtomicU64,
    unanswered: AtomicU64,
    verdicts: Mutex<BTreeMap<String, u64>>,
    orders_by_word: Mutex<BTreeMap<String, u64>>,
}

/// Ends all clients when this value is dropped.
pub struct Ends<'c>(&'c Counts);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.ends.store(true, Ordering::SeqCst);
    }
}

pub fn count(number: &AtomicU64) {
    number.fetch_add(1, Ordering::Relaxed);
}

impl Counts {
    pub fn ends_with_this(&self) -> Ends<'_> {
        Ends(self)
    }

    pub fn goes_on(&self) -> bool {
        !self.ends.load(Ordering::SeqCst)
    }

    /// Waits for this time, but not beyond the end of the run.
    pub fn rest(&self, time: Duration) {
        let since = Instant::now();
        while self.goes_on() && since.elapsed() < time {
            thread::sleep(Duration::from_millis(50).min(time));
        }
    }

    pub fn unanswered(&self) -> u64 {
        self.unanswered.load(Ordering::Relaxed)
    }

    pub fn cycles(&self) -> u64 {
        self.verdicts.lock().unwrap_or_else(PoisonError::into_inner).values().sum()
    }

    pub fn ended(&self, verdict: &str) {
        *self.verdicts.lock().unwrap_or_else(PoisonError::into_inner).entry(verdict.to_owned()).or_default() += 1;
    }

    pub fn ordered(&self, word: &str) {
        count(&self.orders);
        *self.orders_by_word.lock().unwrap_or_else(PoisonError::into_inner).entry(word.to_owned()).or_default() +=
            1;
    }

    /// Counts a request without a reply, or a connection that failed.
    pub fn failed(&self, what: &str, error: &io::Error) {
        let is_refused = matches!(
            error.kind(),
            io::ErrorKind::ConnectionRefused | io::ErrorKind::NotFound | io::ErrorKind::AddrNotAvailable
        );
        count(if is_refused { &self.refused_connections } else { &self.unanswered });
        println!("{what}: {error}");
        self.rest(Duration::from_secs(1));
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |number: &AtomicU64| number.load(Ordering::Relaxed);
        let table = |table: &Mutex<BTreeMap<String, u64>>| {
            let table = table.lock().unwrap_or_else(PoisonError::into_inner);
            table.iter().map(|(word, count)| format!("{word} {count}")).collect::<Vec<_>>().join(", ")
        };
        writeln!(f, "cycles by verdict: {}; recordings {}", table(&self.verdicts), number(&self.recordings))?;
        writeln!(f, "requests of the operator: {} ({})", number(&self.orders), table(&self.orders_by_word))?;
        write!(
            f,
            "answers of the socket {}, pages {} and {} that were refused, events {}, connections that sent nothing or half a request {}, connections that failed {}",
            number(&self.states),
            number(&self.pages),
            number(&self.refused_pages),
            number(&self.events),
            number(&self.silent),
            number(&self.refused_connections)
        )
    }
}

/// Starts all clients, each in its own thread.
pub fn spawn<'s>(scope: &'s Scope<'s, '_>, cell: &'s Prepared, counts: &'s Counts) {
    let repeat = move |many: usize, each: fn(&Prepared, &Counts)| {
        for _ in 0..many {
            scope.spawn(move || {
                while counts.goes_on() {
                    each(cell, counts);
                }
            });
        }
    };
    repeat(POLLERS, poll);
    repeat(FOLLOWERS, follow);
    repeat(READERS, read_pages);
    repeat(1, does_not_read);
    repeat(1, come_and_go);
    repeat(SILENT_CLIENTS, |cell, counts| silent_at_socket(cell, counts, b""));
    repeat(SILENT_CLIENTS, |cell, counts| silent_at_socket(cell, counts, b"{\"ask\":\"st"));
    repeat(SILENT_CLIENTS, |cell, counts| silent_at_page(cell, counts, ""));
    repeat(SILENT_CLIENTS, |cell, counts| silent_at_page(cell, counts, "x: "));
}

fn poll(cell: &Prepared, counts: &Counts) {
    match ask(&cell.socket(), "{\"ask\":\"state\"}\n") {
        Ok(_) => count(&counts.states),
        Err(error) => counts.failed("state", &error),
    }
    counts.rest(Duration::from_millis(200));
}

/// A client that opens a page for some time and reads its events as they arrive.
fn follow(cell: &Prepared, counts: &Counts) {
    let (since, stays) = (Instant::now(), Duration::from_secs(5 + counts.events.load(Ordering::Relaxed) % 60));
    let read = || {
        let mut stream = http::connect(cell.page)?;
        stream.set_read_timeout(Some(EVENT_TIMEOUT))?;
        stream.write_all(format!("{}\r\n", http::head(cell.page, "GET /events", None)).as_bytes())?;
        let mut lines = BufReader::new(stream).lines();
        while counts.goes_on() && since.elapsed() < stays {
            let line = lines.next().unwrap_or_else(|| Err(io::Error::other("the events ended")))?;
            if line.starts_with("data:") {
                count(&counts.events);
            }
        }
        Ok(())
    };
    if let Err(error) = read() {
        counts.failed("events", &error);
    }
}

/// A browser that requests events and does not read them.
fn does_not_read(cell: &Prepared, counts: &Counts) {
    let asked = http::connect(cell.page).and_then(|mut stream| {
        stream.write_all(format!("{}\r\n", http::head(cell.page, "GET /events", None)).as_bytes())?;
        Ok(stream)
    });
    match asked {
        Ok(_stream) => counts.rest(Duration::from_secs(60)),
        Err(error) => counts.failed("a browser that does not read", &error),
    }
    count(&counts.silent);
}

/// A person who logs in, reads all pages several times, and logs in again. The service forgets the abandoned session.
fn read_pages(cell: &Prepared, counts: &Counts) {
    let (name, password) = VIEWER;
    let words = format!("{{\"name\":\"{name}\",\"password\":\"{password}\"}}");
    let session = match http::post(cell.page, "/login", &words) {
        Ok(answer) => answer.session,
        Err(error) => return counts.failed("log in", &error),
    };
    count(&counts.pages);
    for _ in 0..20 {
        let last = format!("/cycle/{}", counts.cycles().max(1));
        let of_last =
            ["", "/record.json", "/record.pdf", "/scene.json", "/scene.bin"].map(|part| format!("{last}{part}"));
        let others = ["/", "/now.json", "/frame.jpg", "/history", "/history.json", "/trends", "/alarms", "/setup"];
        let paths = others.iter().map(|path| (*path).to_owned()).chain(of_last);
        for path in paths {
            match http::get(cell.page, &path, session.as_deref()) {
                Ok(answer) if answer.status == 200 => count(&counts.pages),
                // The picture or the cycle does not exist yet.
                Ok(_) => count(&counts.refused_pages),
                Err(error) => counts.failed(&path, &error),
            }
            counts.rest(Duration::from_secs(2));
            if !counts.goes_on() {
                return;
            }
        }
    }
}

/// A client that opens connections and closes them at once, and sends lines that are not a request.
fn come_and_go(cell: &Prepared, counts: &Counts) {
    for _ in 0..5 {
        drop(UnixStream::connect(cell.socket()));
        drop(http::connect(cell.page));
        count(&counts.silent);
    }
    match ask(&cell.socket(), "abort\n") {
        Ok(_) => count(&counts.states),
        Err(error) => counts.failed("a line that is no request", &error),
    }
    counts.rest(Duration::from_secs(1));
}

/// Checks that a silent client receives a message that it was too slow, and is disconnected.
fn silent_at_socket(cell: &Prepared, counts: &Counts, begins: &[u8]) {
    let hears = || {
        let mut stream = UnixStream::connect(cell.socket())?;
        stream.set_read_timeout(Some(RESPONSE_TIMEOUT))?;
        stream.write_all(begins)?;
        stream.read_to_end(&mut Vec::new())
    };
    match hears() {
        Ok(_) => count(&counts.silent),
        Err(error) => counts.failed("silent at the socket", &error),
    }
}

/// Checks that the page closes a connection that sends no request.
fn silent_at_page(cell: &Prepared, counts: &Counts, begins: &str) {
    let hears = || {
        let mut stream = http::connect(cell.page)?;
        if !begins.is_empty() {
            stream.write_all(format!("{}{begins}", http::head(cell.page, "GET /", None)).as_bytes())?;
        }
        match stream.read_to_end(&mut Vec::new()) {
            // The service closed the connection with unread bytes.
            Err(error) if error.kind() == io::ErrorKind::ConnectionReset => Ok(0),
            read => read,
        }
    };
    match hears() {
        Ok(_) => count(&counts.silent),
        Err(error) => counts.failed("silent at the page", &error),
    }
}
