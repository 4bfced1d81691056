//! The service's Unix socket: who may ask, and what is asked, one line for each connection.
//!
//! The file's mode is the only lock on the door: its owner and group may ask (0660). A file that a killed service left
//! is replaced once nobody answers on it; any other file is not touched. Each connection has a thread, so that a slow
//! or silent one keeps nobody waiting; there are at most a few of them. Recipes are read here too, beside the loop.

use super::desk::{Asked, Letter};
use super::ports::Order;
use super::protocol::{Exit, MOST_BYTES, ProtocolError, RecordIn, Reply, Wish};
use super::who::user;
use crate::cycle::Request;
use crate::record::{Front, Wanted};
use crate::verdict::Reason;
use rustix::net::sockopt::socket_peercred;
use std::fs::{self, Permissions};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

/// Owner and group may ask.
const MODE: u32 = 0o660;
/// Connections at one time.
const MOST_CONNECTIONS: usize = 8;
/// A client says its line, and takes its answer, within this time.
const CLIENT_PATIENCE: Duration = Duration::from_secs(5);
/// The loop answers within this time, or something is wrong with it.
const LOOP_PATIENCE: Duration = Duration::from_secs(5);

/// Makes an order of a recipe's name and text and of where it is recorded, or says why not.
pub type Loader = dyn Fn(&str, &str, Option<RecordIn>) -> Result<Order, Vec<Reason>> + Send + Sync;

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another service.
    #[error("{}: another panelprep answers on this socket; stop it first", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// A file that is none.
    #[error("{}: is there and is not a socket; remove it, or name another `socket` in the cell's file", path.display())]
    NotASocket {
        /// The file.
        path: PathBuf,
    },
    /// The system refuses.
    #[error("cannot {doing} the socket {}: {source}", path.display())]
    System {
        /// What was tried.
        doing: &'static str,
        /// The socket.
        path: PathBuf,
        /// What it says.
        source: std::io::Error,
    },
}

/// A socket that is listened on; its file goes when this is dropped.
#[derive(Debug)]
pub struct Socket {
    path: PathBuf,
}

impl Socket {
    /// Listens, and hands what is asked to the desk.
    ///
    /// # Errors
    /// Where somebody answers on this socket already, the file is another, or the system refuses.
    pub fn listen(path: &Path, letters: Sender<Letter>, loader: Arc<Loader>) -> Result<Self, SocketError> {
        let failed = |doing| {
            let path = path.to_owned();
            move |source| SocketError::System { doing, path, source }
        };
        clear_the_way(path)?;
        let listener = UnixListener::bind(path).map_err(failed("make"))?;
        let socket = Socket { path: path.to_owned() };
        fs::set_permissions(path, Permissions::from_mode(MODE)).map_err(failed("set the mode of"))?;
        let thread = thread::Builder::new().name("socket".to_owned());
        thread.spawn(move || accept(&listener, &letters, &loader)).map_err(failed("serve"))?;
        Ok(socket)
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        // Best effort: a file that stays is replaced by the next service.
        let _ = fs::remove_file(&self.path);
    }
}

/// Removes what a killed service left.
fn clear_the_way(path: &Path) -> Result<(), SocketError> {
    let system = |doing, source| SocketError::System { doing, path: path.to_owned(), source };
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(system("look at", error)),
        Ok(found) if !found.file_type().is_socket() => {
            return Err(SocketError::NotASocket { path: path.to_owned() });
        }
        Ok(_) => {}
    }
    match UnixStream::connect(path) {
        Ok(_) => Err(SocketError::InUse { path: path.to_owned() }),
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|error| system("replace", error))
        }
        Err(error) => Err(system("look at", error)),
    }
}

fn accept(listener: &UnixListener, letters: &Sender<Letter>, loader: &Arc<Loader>) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        let Ok(mut stream) = stream else {
            // Such as no file descriptor left: whoever asks tries again.
            thread::sleep(Duration::from_millis(50));
            continue;
        };
        let place = Place::take(&open);
        let (letters, loader) = (letters.clone(), loader.clone());
        let Some(place) = place else {
            let busy = format!("{MOST_CONNECTIONS} others are asking; try again");
            answer(&mut stream, &Reply::refused(Exit::Fault, vec![Reason::new("busy", busy)]));
            continue;
        };
        let serve = move || {
            let _place = place;
            let reply = hear(&stream, &letters, &*loader);
            answer(&mut stream, &reply);
        };
        if let Err(error) = thread::Builder::new().name("connection".to_owned()).spawn(serve) {
            tracing::warn!("a connection could not be served: {error}");
        }
    }
}

/// One of the places for connections; free again when it is dropped.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn take(open: &Arc<AtomicUsize>) -> Option<Self> {
        let place = Place(open.clone());
        (open.fetch_add(1, Ordering::Relaxed) < MOST_CONNECTIONS).then_some(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Reads one line and has it answered.
fn hear(stream: &UnixStream, letters: &Sender<Letter>, loader: &Loader) -> Reply {
    let wish = match read(stream) {
        Ok(wish) => wish,
        Err(error) => return Reply::refused(Exit::Refused, vec![Reason::new("bad_request", error.to_string())]),
    };
    let who = user(Front::Socket, socket_peercred(stream).ok().map(|who| who.uid.as_raw()));
    let asked = match wish {
        Wish::State {} => Asked::State,
        Wish::Start { recipe, text, record } => match loader(&recipe, &text, record) {
            Ok(order) => Asked::Begin(Box::new(order)),
            Err(reasons) => {
                // A service that has ended keeps no record.
                let wanted = Wanted::Start { recipe };
                let _ = letters.send(Letter::Refused { wanted, who, reasons: reasons.clone() });
                return Reply::refused(Exit::Refused, reasons);
            }
        },
        Wish::Hold {} => Asked::For(Request::Hold),
        Wish::Unhold { dried } => Asked::For(Request::Unhold { dried }),
        Wish::Accept {} => Asked::For(Request::Accept),
        Wish::Stop {} => Asked::For(Request::Stop),
        Wish::Abort {} => Asked::For(Request::Abort),
        Wish::Clear {} => Asked::For(Request::Clear),
        Wish::Reset {} => Asked::For(Request::Reset),
        Wish::NewDisc {} => Asked::NewDisc,
    };
    if !matches!(asked, Asked::State) {
        tracing::info!(?asked, %who, "asked");
    }
    let (reply, answer) = mpsc::sync_channel(1);
    let failed = |code, message: &str| Reply::refused(Exit::Fault, vec![Reason::new(code, message)]);
    if letters.send(Letter::Asked { asked, who, reply }).is_err() {
        return failed("ended", "the service has ended");
    }
    match answer.recv_timeout(LOOP_PATIENCE) {
        Ok(reply) => reply,
        Err(RecvTimeoutError::Disconnected) => failed("ended", "the service ended before it could answer"),
        Err(RecvTimeoutError::Timeout) => {
            failed("silent", "the service's loop does not answer; ask for the state, and look at its log")
        }
    }
}

fn read(stream: &UnixStream) -> Result<Wish, ProtocolError> {
    let silent = |error: std::io::Error| ProtocolError::NotUnderstood { problem: error.to_string() };
    stream.set_read_timeout(Some(CLIENT_PATIENCE)).map_err(silent)?;
    let mut line = Vec::new();
    BufReader::new(stream).take(MOST_BYTES as u64 + 1).read_until(b'\n', &mut line).map_err(silent)?;
    Wish::read(&line)
}

/// Whoever hung up does not want to know.
fn answer(stream: &mut UnixStream, reply: &Reply) {
    let Ok(mut line) = serde_json::to_vec(reply) else { return };
    line.push(b'\n');
    let _ = stream.set_write_timeout(Some(CLIENT_PATIENCE)).and_then(|()| stream.write_all(&line));
}
