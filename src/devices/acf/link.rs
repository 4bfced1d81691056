//! The link to a tool over TCP: a thread of its own, for which nothing waits.

use super::tool::{ConnectedTool, ToolReport, session_limits};
use crate::cell::{CompliantTool, ToolAddress};
use crate::eki::Time;
use crate::force::{Loss, Press, Reading, Session, SessionLimits, State};
use crate::supervision::{Supervised, Watched, supervised};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time limit for making a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(1_000);
/// Time after which a lost link is tried again.
const RECONNECT_DELAY: Duration = Duration::from_millis(300);
/// Longest time until the thread checks for new commands and sends them.
const COMMAND_POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Longest time between two life signs of the thread.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(5);

/// Why no link was started.
#[derive(Debug, thiserror::Error)]
#[error("the thread for the connection to the compliant tool cannot be started: {0}")]
pub struct AcfStartError(#[from] io::Error);

/// A link that its thread keeps connected; when it is dropped, the connection is closed.
pub struct AcfLink {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    watched: Watched,
    told: Option<Instant>,
}

#[derive(Default)]
struct Shared {
    inside: Mutex<Inside>,
    ends: AtomicBool,
}

#[derive(Default)]
struct Inside {
    pressed: Option<Press>,
    newest: Option<(Instant, Reading)>,
    loss: Option<Loss>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}

impl AcfLink {
    /// Starts to connect to the tool that listens there.
    ///
    /// # Errors
    /// If the system provides no thread.
    pub fn start(tool: &CompliantTool, address: &ToolAddress) -> Result<Self, AcfStartError> {
        let (sign, watched) = supervised("compliant tool", HEARTBEAT_TIMEOUT);
        let shared = Arc::new(Shared::default());
        let kept = LinkThread {
            address: address.clone(),
            limits: session_limits(tool),
            shared: shared.clone(),
            since: Instant::now(),
        };
        let run = move || {
            kept.run(&sign);
            sign.done();
        };
        let thread = std::thread::Builder::new().name("compliant tool".to_owned()).spawn(run)?;
        Ok(AcfLink { shared, thread: Some(thread), watched, told: None })
    }

    /// Returns the link's thread, for its supervisor.
    pub fn watched(&self) -> Watched {
        self.watched.clone()
    }
}

impl ConnectedTool for AcfLink {
    fn press(&mut self, press: Press) {
        self.shared.lock().pressed = Some(press);
    }

    fn news(&mut self) -> Option<ToolReport> {
        let mut inside = self.shared.lock();
        if let Some(loss) = inside.loss.take() {
            return Some(ToolReport::Lost(loss));
        }
        let (at, reading) = inside.newest.filter(|(at, _)| self.told != Some(*at))?;
        self.told = Some(at);
        let age_ms = u32::try_from(at.elapsed().as_millis()).unwrap_or(u32::MAX);
        Some(ToolReport::Reading { reading, age_ms })
    }
}

impl Drop for AcfLink {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            #[expect(clippy::let_underscore_must_use, reason = "a panic in there was reported where it happened")]
            let _ = thread.join();
        }
    }
}

/// The data of the link's thread.
struct LinkThread {
    address: ToolAddress,
    limits: SessionLimits,
    shared: Arc<Shared>,
    since: Instant,
}

impl LinkThread {
    fn now(&self) -> Time {
        Time::after_start(self.since.elapsed())
    }

    fn run(&self, sign: &Supervised) {
        let mut told: Option<Loss> = None;
        while !self.shared.ends() {
            sign.works();
            let loss = match self.connected() {
                Ok(stream) => self.keep(stream, sign, &mut told),
                Err(error) => Some(Loss::Unreachable { problem: error.to_string() }),
            };
            // A repeated loss for the same reason is reported only once.
            if let Some(loss) = loss.filter(|loss| told.as_ref() != Some(loss)) {
                self.shared.lock().loss = Some(loss.clone());
                told = Some(loss);
            }
            if !self.shared.ends() {
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

    /// Runs a session on this connection until its end.
    fn keep(&self, mut stream: TcpStream, sign: &Supervised, told: &mut Option<Loss>) -> Option<Loss> {
        let mut session = Session::new(self.limits.clone());
        let login = session.connected(self.now());
        // Set-points for the previous session do not apply to this one.
        self.shared.lock().pressed = None;
        if stream.write_all(&login).is_err() {
            return Some(Loss::Closed);
        }
        while !self.shared.ends() {
            sign.works();
            if let Err(loss) = self.round(&mut session, &mut stream) {
                return Some(loss);
            }
            if session.is_live() {
                *told = None;
            }
        }
        None
    }

    fn round(&self, session: &mut Session, stream: &mut TcpStream) -> Result<(), Loss> {
        let pressed = self.shared.lock().pressed.take();
        if let Some(press) = pressed {
            session.press(press, self.now());
        }
        if let Some(bytes) = session.tick(self.now()) {
            stream.write_all(&bytes).map_err(|_| Loss::Closed)?;
        }
        let wait = session
            .due()
            .map_or(COMMAND_POLL_INTERVAL, |due| due.since(self.now()))
            .clamp(Duration::from_millis(1), COMMAND_POLL_INTERVAL);
        let mut buffer = [0; 256];
        let read = stream.set_read_timeout(Some(wait)).and_then(|()| stream.read(&mut buffer));
        match read {
            Ok(0) => return Err(Loss::Closed),
            Ok(count) => session.received(&buffer[..count], self.now()),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
            }
            Err(_) => return Err(Loss::Closed),
        }
        if let Some((at, reading)) = session.newest() {
            let age = self.now().since(at);
            let mut inside = self.shared.lock();
            let at = Instant::now().checked_sub(age).unwrap_or(self.since);
            if inside
                .newest
                .is_none_or(|(known, _)| at.saturating_duration_since(known) > Duration::from_micros(500))
            {
                inside.newest = Some((at, reading));
            }
        }
        match session.state() {
            State::Lost(loss) => Err(loss.clone()),
            _ => Ok(()),
        }
    }
}
