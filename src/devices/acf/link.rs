//! The TCP link to a compliant tool. The link has its own thread, and no other thread waits for it.

use super::tool::{ConnectedTool, ToolReport, session_limits};
use panelprep_base::supervision::{SupervisedThread, WatchedThread, supervise};
use panelprep_cell::cell::{CompliantTool, ToolAddress};
use panelprep_cell::force::{ForceSetPoint, LinkLossCause, Session, SessionLimits, State, ToolReading};
use panelprep_kuka::eki::Time;
use std::io;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time limit for opening a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(1_000);
/// Delay before a lost connection is opened again.
const RECONNECT_DELAY: Duration = Duration::from_millis(300);
/// Maximum interval at which the thread checks for new commands and sends them.
const COMMAND_POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Maximum time between two heartbeats of the link's thread; after this time its supervisor reports it as hanging.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(5);

/// The reason why the link could not be started.
#[derive(Debug, thiserror::Error)]
#[error("the thread for the connection to the compliant tool cannot be started: {0}")]
pub struct AcfStartError(#[from] io::Error);

/// The link to a compliant tool. Its thread opens a lost connection again; dropping the link closes the connection.
pub struct AcfLink {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    watched: WatchedThread,
    last_report: Option<Instant>,
}

#[derive(Default)]
struct Shared {
    inside: Mutex<Inside>,
    ending: AtomicBool,
}

#[derive(Default)]
struct Inside {
    set_point: Option<ForceSetPoint>,
    last_reading: Option<(Instant, ToolReading)>,
    loss: Option<LinkLossCause>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Relaxed)
    }
}

impl AcfLink {
    /// Starts the thread, which connects to the tool at this address.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn start(tool: &CompliantTool, address: &ToolAddress) -> Result<Self, AcfStartError> {
        let (sign, watched) = supervise("compliant tool", HEARTBEAT_TIMEOUT);
        let shared = Arc::new(Shared::default());
        let kept = LinkThread {
            address: address.clone(),
            limits: session_limits(tool),
            shared: shared.clone(),
            since: Instant::now(),
        };
        let run = move || {
            kept.run(&sign);
            sign.report_done();
        };
        let thread = std::thread::Builder::new().name("compliant tool".to_owned()).spawn(run)?;
        Ok(AcfLink { shared, thread: Some(thread), watched, last_report: None })
    }

    /// Returns the handle by which a supervisor watches the link's thread.
    pub fn supervision_handle(&self) -> WatchedThread {
        self.watched.clone()
    }
}

impl ConnectedTool for AcfLink {
    fn set_force(&mut self, press: ForceSetPoint) {
        self.shared.lock().set_point = Some(press);
    }

    fn next_report(&mut self) -> Option<ToolReport> {
        let mut inside = self.shared.lock();
        if let Some(loss) = inside.loss.take() {
            return Some(ToolReport::Lost(loss));
        }
        let (at, reading) = inside.last_reading.filter(|(at, _)| self.last_report != Some(*at))?;
        self.last_report = Some(at);
        let age_ms = u32::try_from(at.elapsed().as_millis()).unwrap_or(u32::MAX);
        Some(ToolReport::Reading { reading, age_ms })
    }
}

impl Drop for AcfLink {
    fn drop(&mut self) {
        self.shared.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "the panic of the thread was already reported")]
            let _ = thread.join();
        }
    }
}

/// The data of the thread that runs the link.
struct LinkThread {
    address: ToolAddress,
    limits: SessionLimits,
    shared: Arc<Shared>,
    since: Instant,
}

impl LinkThread {
    fn now(&self) -> Time {
        Time::from_start(self.since.elapsed())
    }

    fn run(&self, sign: &SupervisedThread) {
        let mut last_loss: Option<LinkLossCause> = None;
        while !self.shared.is_ending() {
            sign.report_working();
            let loss = match self.connected() {
                Ok(stream) => self.run_session(stream, sign, &mut last_loss),
                Err(error) => Some(LinkLossCause::Unreachable { problem: error.to_string() }),
            };
            // If a connection is lost again for the same reason, the loss is not reported again.
            if let Some(loss) = loss.filter(|loss| last_loss.as_ref() != Some(loss)) {
                self.shared.lock().loss = Some(loss.clone());
                last_loss = Some(loss);
            }
            if !self.shared.is_ending() {
                std::thread::sleep(RECONNECT_DELAY);
            }
        }
    }

    fn connected(&self) -> io::Result<TcpStream> {
        let ToolAddress { host, port } = &self.address;
        let address = (host.as_str(), *port).to_socket_addrs()?.next();
        let address = address.ok_or_else(|| io::Error::from(ErrorKind::AddrNotAvailable))?;
        let stream = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(self.limits.reply_within))?;
        Ok(stream)
    }

    /// Runs a session with the tool on this connection until the connection ends.
    fn run_session(
        &self,
        mut stream: TcpStream,
        sign: &SupervisedThread,
        last_loss: &mut Option<LinkLossCause>,
    ) -> Option<LinkLossCause> {
        let mut session = Session::new(self.limits.clone());
        let login = session.connected(self.now());
        // A set-point that was commanded for the previous session must not apply to the new one.
        self.shared.lock().set_point = None;
        if stream.write_all(&login).is_err() {
            return Some(LinkLossCause::Closed);
        }
        while !self.shared.is_ending() {
            sign.report_working();
            if let Err(loss) = self.exchange_once(&mut session, &mut stream) {
                return Some(loss);
            }
            if session.is_receiving() {
                *last_loss = None;
            }
        }
        None
    }

    fn exchange_once(&self, session: &mut Session, stream: &mut TcpStream) -> Result<(), LinkLossCause> {
        let pressed = self.shared.lock().set_point.take();
        if let Some(press) = pressed {
            session.set_point_now(press, self.now());
        }
        if let Some(bytes) = session.tick(self.now()) {
            stream.write_all(&bytes).map_err(|_| LinkLossCause::Closed)?;
        }
        let wait = session
            .next_tick()
            .map_or(COMMAND_POLL_INTERVAL, |due| due.since(self.now()))
            .clamp(Duration::from_millis(1), COMMAND_POLL_INTERVAL);
        let mut buffer = [0; 256];
        let read = stream.set_read_timeout(Some(wait)).and_then(|()| stream.read(&mut buffer));
        match read {
            Ok(0) => return Err(LinkLossCause::Closed),
            Ok(count) => session.received(&buffer[..count], self.now()),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
            }
            Err(_) => return Err(LinkLossCause::Closed),
        }
        if let Some((at, reading)) = session.last_reading() {
            let age = self.now().since(at);
            let mut inside = self.shared.lock();
            let at = Instant::now().checked_sub(age).unwrap_or(self.since);
            if inside
                .last_reading
                .is_none_or(|(known, _)| at.saturating_duration_since(known) > Duration::from_micros(500))
            {
                inside.last_reading = Some((at, reading));
            }
        }
        match session.state() {
            State::Lost(loss) => Err(loss.clone()),
            _ => Ok(()),
        }
    }
}
