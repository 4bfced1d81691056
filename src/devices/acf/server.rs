//! The mock behind a TCP port of this machine, for tests of the link and of the doctor. One client at a time.

use super::mock::{MockAcf, ToolFault, ToolSurroundings};
use panelprep_cell::cell::CompliantTool;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long the mock waits for bytes or a client.
const POLL_TIMEOUT: Duration = Duration::from_millis(2);

/// A mock that listens; when it is dropped, it ends.
pub struct MockAcfServer {
    address: SocketAddr,
    fault: Arc<Mutex<Option<ToolFault>>>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MockAcfServer {
    /// Starts to listen, with the panel at this distance in front of the tool, mm, and the tool level.
    ///
    /// # Errors
    /// If there is no port or thread.
    pub fn start(tool: &CompliantTool, touches_at_mm: f64) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let (fault, ends) = (Arc::new(Mutex::new(None)), Arc::new(AtomicBool::new(false)));
        let (of_thread, ended, mut mock) = (fault.clone(), ends.clone(), MockAcf::new(tool));
        let run = move || {
            let since = Instant::now();
            while !ended.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, _)) => serve(stream, &mut mock, (&of_thread, &ended), (since, touches_at_mm)),
                    Err(_) => std::thread::sleep(POLL_TIMEOUT),
                }
            }
        };
        let thread = std::thread::Builder::new().name("mock tool".to_owned()).spawn(run)?;
        Ok(MockAcfServer { address, fault, ending: ends, thread: Some(thread) })
    }

    /// Returns the address at which it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sets the fault that the mock has from now on.
    pub fn set_fault(&self, fault: Option<ToolFault>) {
        *self.fault.lock().unwrap_or_else(PoisonError::into_inner) = fault;
    }
}

impl Drop for MockAcfServer {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "a panic in there was reported where it happened")]
            let _ = thread.join();
        }
    }
}

type Control<'a> = (&'a Mutex<Option<ToolFault>>, &'a AtomicBool);

/// Serves one client, until the client leaves or the mock cuts the connection.
fn serve(
    mut stream: TcpStream,
    mock: &mut MockAcf,
    (fault, ends): Control<'_>,
    (since, touches_at_mm): (Instant, f64),
) {
    mock.connect();
    if stream.set_nonblocking(false).and_then(|()| stream.set_read_timeout(Some(POLL_TIMEOUT))).is_err() {
        return;
    }
    let mut buffer = [0; 256];
    while !ends.load(Ordering::Relaxed) {
        mock.set_fault(*fault.lock().unwrap_or_else(PoisonError::into_inner));
        let time_ms = u64::try_from(since.elapsed().as_millis()).unwrap_or(u64::MAX);
        mock.advance(ToolSurroundings { time_ms, contact_extension_mm: touches_at_mm, downwards: 0.0 });
        match stream.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => mock.receive(&buffer[..count], time_ms),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        let Some(bytes) = mock.sent_bytes(time_ms) else { return };
        if stream.write_all(&bytes).is_err() {
            return;
        }
    }
}
