//! The service's Unix socket: an interface on which each connection carries one line from the client and one line in
//! reply.
//!
//! Owner, group and mode (0660) of the socket file decide who may connect. The socket file of a killed service is
//! replaced if no service answers on it; any other file is left unchanged.
//!
//! A client may be slow or silent, or send data continuously, because of a fault or on purpose; a stop must be executed
//! in every case. One thread reads all connections and never waits for a single one. Each connection has one deadline
//! for its whole line. If no slot is free, the connection that has been silent for the longest time must give up its
//! slot (`slots`). Only a start may be a long line. Each complete line is passed to the `gateway`, which queues it by
//! its urgency and reads recipes on a separate thread.
//!
//! The cell's file gives the users in the socket's group one role (`AccessRule`). The user who runs the service, and
//! root, may request everything, because they could do it without the socket as well. Every person with access to the
//! socket may request stop and abort.

use super::camera_lease::{SharedCameras, ShotRequest};
use super::gateway::Gateway;
use super::protocol::{MAX_BYTES, MAX_SHORT_BYTES, ProtocolError, is_long_line_allowed, read_request};
use super::request::{Reply, RequestKind, RequestResult};
use super::slots::{MaxConnections, Slot, Slots};
use super::{camera_lease, gateway};
use crate::setup::{RecipeTextPermission, StartRequest};
use panelprep_base::supervision::{SupervisedThread, Supervisor, supervise};
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::{Permission, Role};
use panelprep_cell::cycle::Request;
use panelprep_cell::record::RequestAuthor;
use std::fs::Permissions;
use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net as system;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::time::Duration;
use std::{fs, thread};
use tokio::net::{UnixListener, UnixStream};
use tokio::runtime::{Builder, Runtime};
use tokio::time::{interval, sleep, timeout};

/// File mode of the socket: owner and group may send requests.
const SOCKET_MODE: u32 = 0o660;
/// Time limit for a client to send its whole line, and again to receive the reply.
const CLIENT_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum number of connections that are read at the same time, of one user and in total.
const SLOTS: MaxConnections = MaxConnections { per_owner: 64, total: 256 };
/// Time limit for receiving the rest of a request on a connection whose slot another client needs.
const DRAIN_TIMEOUT: Duration = Duration::from_millis(50);
/// Interval at which the socket's thread reports that it works, and below it the maximum time without such a report.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(250);
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Number of threads that read recipes: while one reads, the other can report that a recipe is being read.
const READER_THREADS: usize = 2;
/// Nice value of the socket's thread, which gives it priority over other programs of the computer: it has little work,
/// and its input may be a stop.
const NICE: i32 = -5;

/// Errors when the socket is opened.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another service uses the socket.
    #[error("{}: another panelprep process uses this socket; stop that process first", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// The file at this path is not a socket.
    #[error("{}: the path already exists and is not a socket; remove the file, or set another path at `socket` in \
             the cell's file", path.display())]
    NotASocket {
        /// The file.
        path: PathBuf,
    },
    /// The operating system refused the operation.
    #[error("cannot {doing} the socket {}: {source}", path.display())]
    System {
        /// The operation that failed.
        doing: &'static str,
        /// The socket.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
}

/// A socket on which the service listens; dropping this value removes its file.
#[derive(Debug)]
pub struct Socket {
    path: PathBuf,
}

impl Socket {
    /// Listens on the socket, and passes the requests to the gateway. The supervisor monitors the socket's thread.
    /// `role` is the role of users who have access through the socket's group; without a role they may request
    /// everything.
    ///
    /// # Errors
    /// If another service answers on this socket, the file is not a socket, or the operating system refuses an
    /// operation.
    pub fn listen(
        path: &Path,
        role: Option<Role>,
        gateway: Gateway,
        supervisor: &Supervisor,
    ) -> Result<Self, SocketError> {
        let failed = |doing| {
            let path = path.to_owned();
            move |source| SocketError::System { doing, path, source }
        };
        remove_stale_socket(path)?;
        let listener = system::UnixListener::bind(path).map_err(failed("make"))?;
        let socket = Socket { path: path.to_owned() };
        fs::set_permissions(path, Permissions::from_mode(SOCKET_MODE)).map_err(failed("set the mode of"))?;
        listener.set_nonblocking(true).map_err(failed("serve"))?;
        let runtime =
            Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(READER_THREADS).build();
        let runtime = runtime.map_err(failed("serve"))?;
        let (sign, watched) = supervise("socket", HEARTBEAT_TIMEOUT);
        let served = {
            let _context = runtime.enter();
            UnixListener::from_std(listener).map_err(failed("serve"))?
        };
        let thread = thread::Builder::new().name("socket".to_owned());
        thread.spawn(move || serve(&runtime, &served, (&gateway, role), &sign)).map_err(failed("serve"))?;
        supervisor.add_thread(watched);
        Ok(socket)
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "a socket file that could not be removed is replaced by the next service"
        )]
        let _ = fs::remove_file(&self.path);
    }
}

/// Removes the socket file of a killed service.
fn remove_stale_socket(path: &Path) -> Result<(), SocketError> {
    let failed = |doing, source| SocketError::System { doing, path: path.to_owned(), source };
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed("look at", error)),
        Ok(found) if !found.file_type().is_socket() => {
            return Err(SocketError::NotASocket { path: path.to_owned() });
        }
        Ok(_) => {}
    }
    // A connection is tried, because the file alone proves nothing: it remains after a kill, but only a running service
    // accepts connections.
    match system::UnixStream::connect(path) {
        Ok(_) => Err(SocketError::InUse { path: path.to_owned() }),
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|error| failed("replace", error))
        }
        Err(error) => Err(failed("look at", error)),
    }
}

fn serve(
    runtime: &Runtime,
    listener: &UnixListener,
    (gateway, role): (&Gateway, Option<Role>),
    sign: &SupervisedThread,
) {
    let slots = Slots::new(SLOTS);
    let service_uid = rustix::process::geteuid().as_raw();
    #[expect(
        clippy::let_underscore_must_use,
        reason = "if the priority cannot be changed, the system schedules this thread like any other process"
    )]
    let _ = rustix::process::setpriority_process(None, NICE);
    runtime.block_on(async {
        let mut signs = interval(HEARTBEAT_INTERVAL);
        loop {
            let accepted = tokio::select! {
                _ = signs.tick() => {
                    sign.report_working();
                    continue;
                }
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, _)) => {
                    // The user is read from the kernel and not from the message, because a client could write any name
                    // into the message.
                    let who = gateway::socket_peer(&stream);
                    let slot = slots.acquire(who.uid);
                    let rule = AccessRule { role, service_uid };
                    tokio::spawn(serve_request((stream, who), slot, gateway.clone(), rule));
                }
                // For example, no file descriptor is free; the client tries again.
                Err(_) => sleep(Duration::from_millis(50)).await,
            }
        }
    });
}

/// Reads one line, passes its request to the gateway, and sends the reply.
async fn serve_request(
    (stream, who): (UnixStream, RequestAuthor),
    mut slot: Slot<Option<u32>>,
    gateway: Gateway,
    rule: AccessRule,
) {
    let parsed = {
        let mut reading = pin!(read(&stream));
        tokio::select! {
            biased;
            parsed = timeout(CLIENT_TIMEOUT, &mut reading) => parsed.unwrap_or(Err(ProtocolError::Slow)),
            // A line that is being sent is read to its end: a client that sends nothing must give up its slot, but a
            // stop must not be lost.
            () = slot.wait_until_wanted() => timeout(DRAIN_TIMEOUT, &mut reading).await.unwrap_or(Err(ProtocolError::GaveWay)),
        }
    };
    // The slot is released after the line is read, because a reply may take seconds, and the limit applies only to
    // clients that send nothing.
    drop(slot);
    let parsed = parsed.map(|what| match what {
        RequestKind::Start(start) => {
            RequestKind::Start(StartRequest { own_text: rule.recipe_text_permission(&who), ..start })
        }
        what => what,
    });
    if let Some(reason) = parsed.as_ref().ok().and_then(|what| rule.refusal(&who, what)) {
        let who = gateway.named(who).await;
        tracing::warn!("refused to {}: {}", gateway::format_for_log(&who), reason.message);
        if let Some(wanted) = parsed.as_ref().ok().and_then(RequestKind::wanted) {
            gateway.keep_refused(wanted, who, vec![reason.clone()]);
        }
        return send_reply(&stream, &Reply::refused(RequestResult::Refused, vec![reason])).await;
    }
    if let (Ok(RequestKind::Shoot(shot)), Some(cameras)) = (&parsed, &gateway.cameras) {
        return lend_cameras(stream, *shot, cameras.clone(), &gateway.named(who).await);
    }
    let reply = match parsed {
        Ok(what) => gateway.request(what, who).await,
        Err(error @ (ProtocolError::Slow | ProtocolError::GaveWay)) => {
            Reply::refused(RequestResult::Fault, vec![Reason::new("busy", error.to_string())])
        }
        Err(error) => Reply::refused(RequestResult::Refused, vec![Reason::new("bad_request", error.to_string())]),
    };
    send_reply(&stream, &reply).await;
}

async fn send_reply(stream: &UnixStream, reply: &Reply) {
    let Ok(mut line) = serde_json::to_vec(reply) else { return };
    line.push(b'\n');
    #[expect(
        clippy::let_underscore_must_use,
        reason = "a client that disconnected or does not read needs no reply"
    )]
    let _ = timeout(CLIENT_TIMEOUT, write(stream, &line)).await;
}

async fn read(stream: &UnixStream) -> Result<RequestKind, ProtocolError> {
    let (mut line, mut bytes) = (Vec::new(), [0; 4 * 1_024]);
    loop {
        let most = if is_long_line_allowed(&line) { MAX_BYTES } else { MAX_SHORT_BYTES };
        if line.len() > most {
            return Err(ProtocolError::TooLong { most });
        }
        let ready = stream.readable().await.and_then(|()| stream.try_read(&mut bytes));
        let count = match ready {
            Err(error) if error.kind() == ErrorKind::WouldBlock => continue,
            other => other.map_err(|error| ProtocolError::NotUnderstood { problem: error.to_string() })?,
        };
        let part = &bytes[..count];
        match part.iter().position(|byte| *byte == b'\n') {
            Some(end) => {
                line.extend_from_slice(&part[..=end]);
                return read_request(&line);
            }
            None if count == 0 => return read_request(&line),
            None => line.extend_from_slice(part),
        }
    }
}

async fn write(stream: &UnixStream, mut line: &[u8]) -> std::io::Result<()> {
    while !line.is_empty() {
        stream.writable().await?;
        match stream.try_write(line) {
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            count => line = &line[count?..],
        }
    }
    Ok(())
}

/// Lends the cameras to the client at the other end, on a separate thread.
fn lend_cameras(stream: UnixStream, shot: ShotRequest, cameras: SharedCameras, who: &RequestAuthor) {
    tracing::info!("{} asks: {}", gateway::format_for_log(who), shot.describe());
    let lent = stream.into_std().and_then(|stream| {
        thread::Builder::new().name("shots".to_owned()).spawn(move || camera_lease::serve(stream, shot, &cameras))
    });
    if let Err(error) = lent {
        tracing::warn!("no shot: {error}");
    }
}

/// The rule that determines which requests a role permits.
#[derive(Debug, Clone, Copy)]
struct AccessRule {
    /// The role of the socket's users; without a role they may request everything.
    pub role: Option<Role>,
    /// The number (UID) of the user who runs the service.
    pub service_uid: u32,
}

impl AccessRule {
    /// Returns whether a start by this user may contain a recipe that is not in the recipes' folder. This requires the
    /// permission to change the folder.
    pub fn recipe_text_permission(self, who: &RequestAuthor) -> RecipeTextPermission {
        match self.limiting_role(who) {
            Some(role) if !role.has_permission(Permission::Configure) => RecipeTextPermission::Refused,
            _ => RecipeTextPermission::Allowed,
        }
    }

    /// Returns the role that limits this user; `None` if the user has no limits.
    fn limiting_role(self, who: &RequestAuthor) -> Option<Role> {
        self.role.filter(|_| who.uid.is_none_or(|uid| uid != 0 && uid != self.service_uid))
    }

    /// Returns the reason why this user may not send this request; `None` if it is permitted.
    pub fn refusal(self, who: &RequestAuthor, what: &RequestKind) -> Option<Reason> {
        let role = self.limiting_role(who)?;
        let needed = needed_permission(what)?;
        if role.has_permission(needed) {
            return None;
        }
        let may: Vec<&str> = Role::roles_with_permission(needed).map(Role::keyword).collect();
        let message = format!(
            "\"{}\" is not permitted through the socket: its users have the role {} (socket_role in the cell's \
             file); permitted roles: {}",
            what.describe(),
            role.keyword(),
            may.join(", ")
        );
        Some(Reason::new("not_permitted", message))
    }
}

/// Returns the permission that a role must have for this request; `None` if every user may send it.
fn needed_permission(what: &RequestKind) -> Option<Permission> {
    match what {
        RequestKind::Table(Request::Stop | Request::Abort) => None,
        RequestKind::State => Some(Permission::View),
        RequestKind::Table(Request::Accept)
        | RequestKind::Decided { request: Request::Accept, .. }
        | RequestKind::Outdated { request: Request::Accept, .. } => Some(Permission::Accept),
        RequestKind::Decided { .. } | RequestKind::Outdated { .. } => Some(Permission::Operate),
        RequestKind::Start(_)
        | RequestKind::Begin(_)
        | RequestKind::Refused { .. }
        | RequestKind::NewDisc
        | RequestKind::Shoot(_)
        | RequestKind::Hold { .. }
        | RequestKind::Leave
        | RequestKind::Table(
            Request::Start { .. }
            | Request::AirRun { .. }
            | Request::Hold
            | Request::Unhold { .. }
            | Request::Clear
            | Request::Reset,
        ) => Some(Permission::Operate),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::record::RequestSource;
    use strum::VariantArray;

    const SERVICE: u32 = 990;

    fn refusal(role: Option<Role>, who: &RequestAuthor, what: &RequestKind) -> Option<Reason> {
        AccessRule { role, service_uid: SERVICE }.refusal(who, what)
    }

    fn author_with_uid(uid: u32) -> RequestAuthor {
        RequestAuthor { front: RequestSource::Socket, uid: Some(uid), user: None, from: None }
    }

    /// Tests every role with every request of the protocol. A viewer can only read, stop and abort. An inspector can
    /// also accept. An operator can do everything except accept. An engineer can do everything.
    #[test]
    fn users_of_the_socket_have_the_permissions_of_its_role() {
        let table = |request: Request| match request.is_operator_decision() {
            true => RequestKind::Decided { request, step: 3 },
            false => RequestKind::Table(request),
        };
        let all = || {
            let unhold = Request::Unhold { dried: true };
            let rows = [
                Request::Stop,
                Request::Abort,
                Request::Accept,
                Request::Hold,
                unhold,
                Request::Clear,
                Request::Reset,
            ];
            rows.into_iter().map(table).chain([RequestKind::State, RequestKind::NewDisc])
        };
        for (role, allowed) in [
            (Role::Viewer, vec!["stop", "abort", "state"]),
            (Role::Administrator, vec!["stop", "abort", "state"]),
            (Role::Inspector, vec!["stop", "abort", "accept", "state"]),
            (
                Role::Operator,
                vec!["stop", "abort", "hold", "unhold --dried", "clear", "reset", "state", "new-disc"],
            ),
        ] {
            let open = all().filter(|what| refusal(Some(role), &author_with_uid(1_001), what).is_none());
            assert_eq!(open.map(|what| what.describe()).collect::<Vec<_>>(), allowed, "{role:?}");
        }
        for role in [Some(Role::Engineer), None] {
            assert!(all().all(|what| refusal(role, &author_with_uid(1_001), &what).is_none()), "{role:?}");
        }
        for uid in [0, SERVICE] {
            assert!(all().all(|what| refusal(Some(Role::Viewer), &author_with_uid(uid), &what).is_none()), "{uid}");
        }
        let unknown = RequestAuthor { front: RequestSource::Socket, uid: None, user: None, from: None };
        assert!(
            refusal(Some(Role::Viewer), &unknown, &RequestKind::NewDisc).is_some(),
            "an unknown user is not root"
        );
        let reported = refusal(Some(Role::Viewer), &author_with_uid(1_001), &RequestKind::Table(Request::Hold))
            .expect("refused");
        assert!(
            reported.code == "not_permitted" && reported.message.contains("permitted roles: operator, engineer"),
            "{reported:?}"
        );
        assert_eq!(Role::VARIANTS.len(), 6);
    }

    /// An operator, or a person with fewer permissions, can only start recipes from the folder.
    #[test]
    fn a_recipe_text_needs_the_permission_to_change_the_folder() {
        let own =
            |role, uid| AccessRule { role, service_uid: SERVICE }.recipe_text_permission(&author_with_uid(uid));
        for role in Role::VARIANTS.iter().copied() {
            let expected =
                if role == Role::Engineer { RecipeTextPermission::Allowed } else { RecipeTextPermission::Refused };
            assert_eq!(own(Some(role), 1_001), expected, "{role:?}");
            assert_eq!(own(Some(role), 0), RecipeTextPermission::Allowed, "root can do it without the socket");
        }
        assert_eq!(own(None, 1_001), RecipeTextPermission::Allowed, "the cell's file sets no limit");
    }
}
