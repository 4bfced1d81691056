//! The worker as a process: the same program in another role, with one end of a socket as its standard input. Also the
//! daemon's end of the socket: one request, then one reply, each with a time limit.
//!
//! The output of the SDK goes to standard error, which is the service's log. A worker that is released closes its
//! camera and ends. A worker is killed if it does not end within a short time, or if its daemon has ended without
//! notice. If a driver prevents a killed worker from ending, only a separate thread waits for its end.

use super::message::{Hello, Reply, Request, ShotInfo, Size, now_ns};
use super::sensor::ShotPlanes;
use super::wire::{self, FrameKind, OpenedFrame, WireError};
use std::ffi::OsString;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Maximum time for which the program waits until a killed worker has ended.
const KILL_TIMEOUT: Duration = Duration::from_secs(2);

/// Interval of the checks whether the worker has ended.
const EXIT_POLL_INTERVAL: Duration = Duration::from_millis(5);

/// Number of bytes per point: x, y, z as f32, three colours, and the signal to noise ratio as f32.
const POINT_BYTES: usize = 12 + 3 + 4;

/// Interval of the checks whether the program is ending.
const SHUTDOWN_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The worker at the other end of a socket: a process, or a thread in tests.
pub trait WorkerPeer: Send {
    /// Ends the worker immediately, in any state.
    fn kill(&mut self);
    /// Returns how the worker ended; `None` if it does not end within this time.
    fn wait_ended(&mut self, within: Duration) -> Option<String>;
    /// Returns the process ID of the worker, if it is a process.
    fn id(&self) -> Option<u32>;
}

/// A function that starts a worker, and returns the daemon's end of its socket.
pub type WorkerLauncher = Box<dyn FnMut() -> io::Result<(UnixStream, Box<dyn WorkerPeer>)> + Send>;

/// Returns a function that starts this program as a worker with these arguments.
pub fn command_launcher(program: PathBuf, arguments: Vec<OsString>) -> WorkerLauncher {
    Box::new(move || {
        let (ours, theirs) = UnixStream::pair()?;
        let child = Command::new(&program)
            .arg0(env!("CARGO_PKG_NAME"))
            .args(&arguments)
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::from(io::stderr().as_fd().try_clone_to_owned()?))
            .stderr(Stdio::inherit())
            // The worker has its own process group, so that signals of a terminal such as Ctrl-C reach only the daemon.
            .process_group(0)
            .spawn()?;
        Ok((ours, Box::new(WorkerProcess { child: Some(child) }) as Box<dyn WorkerPeer>))
    })
}

struct WorkerProcess {
    /// The child process; `None` once the process is no longer supervised.
    child: Option<Child>,
}

impl WorkerPeer for WorkerProcess {
    fn kill(&mut self) {
        let Some(child) = &mut self.child else { return };
        #[expect(clippy::let_underscore_must_use, reason = "killing fails only if the process has already ended")]
        let _ = child.kill();
        if self.wait_ended(KILL_TIMEOUT).is_some() {
            return;
        }
        if let Some(mut child) = self.child.take() {
            tracing::error!("the 3D camera's worker process {} cannot be killed: a driver blocks it", child.id());
            std::thread::spawn(move || child.wait());
        }
    }

    fn wait_ended(&mut self, within: Duration) -> Option<String> {
        let child = self.child.as_mut()?;
        let until = Instant::now() + within;
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return Some(status.to_string()),
                Ok(None) if Instant::now() < until => std::thread::sleep(EXIT_POLL_INTERVAL),
                Ok(None) => return None,
                Err(error) => return Some(format!("its exit status is not known: {error}")),
            }
        }
    }

    fn id(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }
}

impl Drop for WorkerProcess {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Returns the worker's end of the socket, which is its standard input. From now on the process ends when its daemon
/// ends.
///
/// # Errors
/// If standard input is not a socket, for example because a person has started the worker.
pub fn daemon() -> io::Result<UnixStream> {
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
    let input = io::stdin().as_fd().try_clone_to_owned()?;
    rustix::net::sockopt::socket_domain(&input)?;
    Ok(UnixStream::from(input))
}

/// The daemon's connection to a worker.
#[derive(Debug)]
pub struct Link {
    stream: UnixStream,
    sequence: u32,
    is_ending: Arc<AtomicBool>,
}

/// A reply of the worker with its data.
#[derive(Debug)]
pub enum Answer {
    /// A reply without image data.
    Words(Reply),
    /// A 3D shot.
    Scan(ShotDelivery, ShotPlanes),
    /// A picture.
    Picture(ShotDelivery, Vec<[u8; 3]>),
}

/// A 3D scan as it was received.
#[derive(Debug, Clone, PartialEq)]
pub struct ShotDelivery {
    /// The metadata of the scan.
    pub metadata: ShotInfo,
    /// The checksum of the payload.
    pub sum: u32,
    /// Time at which the scan was received completely, ns of the monotonic clock.
    pub arrived_ns: u64,
}

impl Link {
    /// Creates a connection over this socket. If `is_ending` becomes true, waiting ends with an error.
    pub fn new(stream: UnixStream, is_ending: Arc<AtomicBool>) -> Self {
        Link { stream, sequence: 0, is_ending }
    }

    /// Returns the first message of the worker.
    ///
    /// # Errors
    /// If the message does not arrive in time or cannot be read.
    pub fn receive_hello(&mut self, within: Duration) -> Result<Hello, WireError> {
        let mut timed = self.with_deadline(Instant::now() + within);
        let opened = wire::open(&mut timed, FrameKind::Hello)?;
        let hello = serde_json::from_slice(&opened.head)?;
        opened.finish_without_payload(&mut timed)?;
        Ok(hello)
    }

    /// Sends a request and waits for the reply.
    ///
    /// # Errors
    /// If the reply does not arrive in time or cannot be read. Then the connection must not be used any more, because
    /// it is unknown what the worker is doing.
    pub fn send_and_receive(&mut self, request: &Request, within: Duration) -> Result<Answer, WireError> {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let mut timed = self.with_deadline(Instant::now() + within);
        wire::write(&mut timed, (FrameKind::Request, sequence), &serde_json::to_vec(request)?, &[])?;
        let opened = wire::open(&mut timed, FrameKind::Reply)?;
        if opened.sequence != sequence {
            return Err(WireError::Sequence { found: opened.sequence, allowed: sequence });
        }
        match serde_json::from_slice(&opened.head)? {
            Reply::Scan(taken) => scan(opened, &mut timed, taken),
            Reply::Picture(taken) => {
                opened.check_payload_size(bytes(taken.size, 3))?;
                let mut rgb = vec![[0; 3]; taken.size.pixels()];
                let sum = opened.payload(&mut timed, &mut [rgb.as_flattened_mut()])?;
                Ok(Answer::Picture(ShotDelivery { metadata: taken, sum, arrived_ns: now_ns() }, rgb))
            }
            words => {
                opened.finish_without_payload(&mut timed)?;
                Ok(Answer::Words(words))
            }
        }
    }

    fn with_deadline(&self, until: Instant) -> TimedSocket<'_> {
        TimedSocket { stream: &self.stream, until, is_ending: &self.is_ending }
    }
}

fn bytes(size: Size, each: usize) -> usize {
    size.pixels().saturating_mul(each)
}

fn scan(opened: OpenedFrame, timed: &mut TimedSocket<'_>, taken: ShotInfo) -> Result<Answer, WireError> {
    opened.check_payload_size(bytes(taken.size, POINT_BYTES))?;
    // The scan is read directly into its final memory.
    let mut planes = ShotPlanes::with_size(taken.size);
    let into = &mut [
        bytemuck::cast_slice_mut(planes.points_mm.as_mut_slice()),
        planes.colors.as_flattened_mut(),
        bytemuck::cast_slice_mut(planes.snr.as_mut_slice()),
    ];
    let sum = opened.payload(timed, into)?;
    Ok(Answer::Scan(ShotDelivery { metadata: taken, sum, arrived_ns: now_ns() }, planes))
}

/// A socket with one time limit for all reads and writes.
struct TimedSocket<'a> {
    stream: &'a UnixStream,
    until: Instant,
    is_ending: &'a AtomicBool,
}

impl TimedSocket<'_> {
    /// Returns the time for the next wait, or an error if the time limit is exceeded.
    fn remaining_wait(&self) -> std::io::Result<Duration> {
        if self.is_ending.load(Ordering::Relaxed) {
            return Err(std::io::Error::other("the program ends"));
        }
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left.min(SHUTDOWN_POLL_INTERVAL)) }
    }
}

impl Read for TimedSocket<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        loop {
            self.stream.set_read_timeout(Some(self.remaining_wait()?))?;
            match (&*self.stream).read(bytes) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                other => return other,
            }
        }
    }
}

impl Write for TimedSocket<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        loop {
            self.stream.set_write_timeout(Some(self.remaining_wait()?))?;
            match (&*self.stream).write(bytes) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                other => return other,
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
