//! The worker as a process: the same program in another role, with one end of a socket as its standard input.
//!
//! The SDK's output goes to standard error, with the service's own log. A worker that is released closes its camera
//! and ends. The worker is killed if it does not end within a short time, or if its daemon ends without notice. If a
//! driver keeps a killed worker in the kernel, only a separate thread waits for its end.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The process or thread at the other end of a socket.
pub trait WorkerPeer: Send {
    /// Ends the peer at once, whatever its state.
    fn kill(&mut self);
    /// Returns how the peer ended, if it ends within this time.
    fn wait_ended(&mut self, within: Duration) -> Option<String>;
    /// Its process.
    fn id(&self) -> Option<u32>;
}

/// Starts a worker and returns the daemon's end of its socket.
pub type WorkerLauncher = Box<dyn FnMut() -> io::Result<(UnixStream, Box<dyn WorkerPeer>)> + Send>;

/// Returns a launcher that starts this program with these arguments.
pub fn command_launcher(program: PathBuf, arguments: Vec<OsString>) -> WorkerLauncher {
    Box::new(move || {
        let (ours, theirs) = UnixStream::pair()?;
        let child = Command::new(&program)
            .arg0(env!("CARGO_PKG_NAME"))
            .args(&arguments)
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::from(io::stderr().as_fd().try_clone_to_owned()?))
            .stderr(Stdio::inherit())
            // Signals that a terminal sends to its foreground processes, such as Ctrl-C, are handled by the daemon.
            .process_group(0)
            .spawn()?;
        Ok((ours, Box::new(WorkerProcess { child: Some(child) }) as Box<dyn WorkerPeer>))
    })
}

struct WorkerProcess {
    /// `None` once the process is no longer supervised.
    child: Option<Child>,
}

/// How long the program waits for a killed worker to end.
const KILL_TIMEOUT: Duration = Duration::from_secs(2);

/// Interval of checks whether the worker has ended.
const EXIT_POLL_INTERVAL: Duration = Duration::from_millis(5);

impl WorkerPeer for WorkerProcess {
    fn kill(&mut self) {
        let Some(child) = &mut self.child else { return };
        #[expect(clippy::let_underscore_must_use, reason = "fails only where it has ended already")]
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

/// Returns the worker's end of its socket: its standard input. From here on the process ends with its daemon.
///
/// # Errors
/// If standard input is not a socket, as when a person starts the worker.
pub fn daemon() -> io::Result<UnixStream> {
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
    let input = io::stdin().as_fd().try_clone_to_owned()?;
    rustix::net::sockopt::socket_domain(&input)?;
    Ok(UnixStream::from(input))
}
