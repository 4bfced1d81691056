//! The entry point of the service for its interfaces: an interface submits a request with its author, and waits for one
//! reply.
//!
//! The author is the operating system's user at the other end of a connection, by number and name. [`InterfaceContext`]
//! contains the parts that all interfaces share, so that page, plant and office server show the same cell.

use super::alarms::Alarms;
use super::camera_lease::SharedCameras;
use super::examination::low_disk_space;
use super::operator_texts;
use super::people::AccountService;
use super::request::{Reply, Request, RequestKind, RequestResult};
use super::request_queue::{RequestQueueError, RequestSender};
use super::transfer::RecordTransfers;
use crate::setup::{
    CellFiles, CycleLoader, PreparedCycle, RecipeText, StartRequest, clock::now_unix_ms, expiring_verifications,
    judge_health, unreadable_reason,
};
use panelprep_base::disk;
use panelprep_base::verdict::Reason;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{RequestAuthor, RequestSource, RequestedAction};
use panelprep_store::office::RecipeOffer;
use std::os::fd::AsFd;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::timeout;

/// Time limit for a reply of the loop; after a longer time the loop is treated as faulty.
const REPLY_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for reading the name of the user who sends a request, and below it the limit for a stop. A stop reaches
/// the robot when it enters the queue, so it waits for the name only as long as a working disk needs.
const NAME_TIMEOUT: Duration = Duration::from_secs(1);
const NAME_TIMEOUT_OF_STOP: Duration = Duration::from_millis(20);

/// The entry point through which interfaces submit requests. All clones share the same state.
#[derive(Clone)]
pub struct Gateway {
    queue: RequestSender,
    /// Prepares starts, or the reason why the cell cannot start a cycle at all.
    loader: Result<Arc<CycleLoader>, Reason>,
    /// The service's cameras, after they are opened.
    pub(super) cameras: Option<SharedCameras>,
    /// Looks up the names of users.
    names: Arc<NameLookup>,
}

impl Gateway {
    /// Creates a gateway: requests go to `queue`, `loader` prepares starts, and `cameras` are lent while the cell
    /// rests.
    pub fn new(queue: RequestSender, loader: Arc<CycleLoader>, cameras: SharedCameras) -> Self {
        Gateway { queue, loader: Ok(loader), cameras: Some(cameras), names: Arc::new(user_name) }
    }

    /// Creates the gateway of a service that has no cell yet: it refuses each start for this reason.
    pub fn without_cell(queue: RequestSender, reason: Reason) -> Self {
        Gateway { queue, loader: Err(reason), cameras: None, names: Arc::new(user_name) }
    }

    /// Submits a request and returns the reply. It must run on a tokio runtime that has a blocking thread for the
    /// loader.
    pub async fn request(&self, what: RequestKind, who: RequestAuthor) -> Reply {
        let (what, who) = match what {
            // The user's name is not read for this request: the state is requested many times a second, and the name is
            // read from a file.
            RequestKind::State => (RequestKind::State, who),
            // The files are read here and not in the loop, because the loop must answer the robot even if the disk is
            // slow.
            RequestKind::Start(start) => {
                let (recipe, who) = (start.recipe.clone(), self.named(who).await);
                match self.prepare(start).await {
                    Ok(prepared) => (RequestKind::Begin(Box::new(prepared)), who),
                    Err(refused) => {
                        self.keep_refused(RequestedAction::Start { recipe }, who, refused.reasons.clone());
                        return refused;
                    }
                }
            }
            RequestKind::Shoot(_) => {
                let message = "the service has not opened its cameras yet; wait until `panelprep ctl state` shows \
                               that the service is ready";
                return Reply::refused(RequestResult::Refused, vec![Reason::new("not_now", message)]);
            }
            RequestKind::Table(request) if request.is_operator_decision() => {
                return Reply::refused(RequestResult::Refused, vec![operator_texts::missing_step_reason(request)]);
            }
            what if what.is_urgent() => (what, named_within(who, self.names.clone(), NAME_TIMEOUT_OF_STOP).await),
            what => (what, self.named(who).await),
        };
        let in_log = (!matches!(what, RequestKind::State)).then(|| (what.describe(), format_for_log(&who)));
        let (reply, answer) = oneshot::channel();
        let failed = |code, message: &str| Reply::refused(RequestResult::Fault, vec![Reason::new(code, message)]);
        if let Err(error) = self.queue.send(Request { what, requester: who, reply: Some(reply) }) {
            let code = if error == RequestQueueError::Ended { "ended" } else { "busy" };
            return failed(code, &error.to_string());
        }
        if let Some((what, who)) = in_log {
            tracing::info!("{who} asks: {what}");
        }
        match timeout(REPLY_TIMEOUT, answer).await {
            Ok(Ok(reply)) => reply,
            Ok(Err(_)) => failed(
                "ended",
                "the service ended before it could answer; start the service and repeat \
                                           the request",
            ),
            // The reply is "failed", not "refused": the request is in the queue and may still be executed.
            Err(_) => failed(
                "silent",
                "the control loop of the service does not respond; check the state and the log of the service",
            ),
        }
    }

    /// Returns the user with a name, if this computer's list of users contains the user and can be read in time.
    pub(super) async fn named(&self, who: RequestAuthor) -> RequestAuthor {
        named_within(who, self.names.clone(), NAME_TIMEOUT).await
    }

    /// Passes a request that was refused here or in an interface to the loop, which records it.
    pub(super) fn keep_refused(&self, wanted: RequestedAction, who: RequestAuthor, reasons: Vec<Reason>) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the refused request is not recorded: the service has ended, or too many requests of this user \
                      are waiting"
        )]
        let _ = self.queue.send(Request::new(RequestKind::Refused { wanted, reasons }, who));
    }

    /// Reads the files that a cycle needs, on a separate thread, because the disk may be slow.
    async fn prepare(&self, start: StartRequest) -> Result<PreparedCycle, Reply> {
        let refused = |reason| Reply::refused(RequestResult::Refused, vec![reason]);
        let loader = self.loader.clone().map_err(refused)?;
        match tokio::task::spawn_blocking(move || loader.load(&start)).await {
            Ok(prepared) => prepared.map_err(|reasons| Reply::refused(RequestResult::Refused, reasons)),
            Err(error) => {
                let message = format!("the recipe could not be read: {error}");
                Err(Reply::refused(RequestResult::Fault, vec![Reason::new("fault", message)]))
            }
        }
    }
}

/// Returns the name of the user with this number; may wait for the disk.
type NameLookup = dyn Fn(u32) -> Option<String> + Send + Sync;

/// Returns the user at the other end of this connection to the service's socket, without the name.
pub(super) fn socket_peer(connection: impl AsFd) -> RequestAuthor {
    let uid = rustix::net::sockopt::socket_peercred(connection).ok().map(|peer| peer.uid.as_raw());
    RequestAuthor { front: RequestSource::Socket, uid, user: None, from: None }
}

/// Returns the user who runs this program, for a command that runs one cycle or clears an abort.
pub fn current_user() -> RequestAuthor {
    with_name(RequestAuthor {
        front: RequestSource::Command,
        uid: Some(rustix::process::getuid().as_raw()),
        user: None,
        from: None,
    })
}

/// Returns the user with the name, if this computer's list of users contains the user.
fn with_name(who: RequestAuthor) -> RequestAuthor {
    match who.uid {
        Some(uid) => RequestAuthor { user: user_name(uid), ..who },
        None => who,
    }
}

/// Returns the user with the name from the look-up, which runs on a separate thread, so that a disk that hangs does not
/// delay any request. If the look-up exceeds the time limit, the user is identified by the number only.
async fn named_within(who: RequestAuthor, lookup: Arc<NameLookup>, limit: Duration) -> RequestAuthor {
    let Some(uid) = who.uid else { return who };
    let found = timeout(limit, tokio::task::spawn_blocking(move || lookup(uid))).await;
    RequestAuthor { user: found.ok().and_then(Result::ok).flatten(), ..who }
}

/// Formats a user for a line of the log: `anna (uid 1001)`.
pub(super) fn format_for_log(who: &RequestAuthor) -> String {
    match (&who.user, who.uid) {
        (Some(user), Some(uid)) => format!("{user} (uid {uid})"),
        (None, Some(uid)) => format!("uid {uid}"),
        (Some(user), None) => user.clone(),
        (None, None) => "an unknown user".to_owned(),
    }
}

/// Returns the name for a number in this computer's list of users. A directory service is not queried, because it may
/// hang.
fn user_name(uid: u32) -> Option<String> {
    let list = disk::read(Path::new("/etc/passwd")).ok()?;
    find_user_name(&String::from_utf8_lossy(&list), uid)
}

fn find_user_name(list: &str, uid: u32) -> Option<String> {
    let of_line = |line: &str| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        let is_plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_graphic());
        (number.parse() == Ok(uid) && is_plain).then(|| name.to_owned())
    };
    list.lines().find_map(of_line)
}

/// The parts that all interfaces share. Clones share the same parts.
#[derive(Clone)]
pub struct InterfaceContext {
    /// The entry point for requests.
    pub gateway: Gateway,
    /// The accounts of people who may log in; they also open the store for the interfaces.
    pub people: Arc<AccountService>,
    /// The alarms of the cell.
    pub alarms: Arc<Alarms>,
    /// Recipes, calibrations and the rest of the set-up.
    pub setup: Arc<CellFiles>,
    /// The status of the transfers of records out of the cell.
    pub transfers: RecordTransfers,
}

impl InterfaceContext {
    /// Checks for alarms between cycles if they were not checked within the last minute. The check of a camera may take
    /// some seconds.
    pub(super) fn check_alarms(&self) {
        self.alarms.check_cell(|| self.cycle_obstacles(), self.gateway.cameras.as_ref());
    }

    /// Returns what prevents a cycle now or will soon prevent one, apart from the cameras: the disk, the age of
    /// verifications, and transfers that are behind.
    fn cycle_obstacles(&self) -> Vec<Reason> {
        let (files, RecordTransfers { office, push }) = (&self.setup, &self.transfers);
        let verified = judge_health(files).map_or_else(|fault| vec![unreadable_reason(&fault)], |it| it.reasons);
        let ending = expiring_verifications(files).unwrap_or_default();
        let now_unix_ms = now_unix_ms();
        let office = files.cell.office().map(|it| office.reasons(it.alarm_delay_min, now_unix_ms));
        let push = files.cell.push().map(|it| push.reasons(it.alarm_delay_min, now_unix_ms));
        let behind = office.into_iter().chain(push).flatten();
        low_disk_space(files.store_folder()).into_iter().chain(verified).chain(ending).chain(behind).collect()
    }

    /// Returns the recipe that the office offers in place of this one; `None` if it offers none, or the same.
    ///
    /// # Errors
    /// If there is no such recipe or it cannot be read; the error is a text for people.
    pub(super) fn recipe_offer(&self, name: &str) -> Result<Option<RecipeOffer>, String> {
        let RecipeText { name, text } = self.setup.recipe(name)?;
        // The problems of the recipe are reported next to it.
        let Ok(recipe) = Recipe::check(&name, &text) else { return Ok(None) };
        Ok(self.transfers.office.recipe_offer(recipe.panel()).filter(|offer| offer.text != text))
    }
}

#[cfg(test)]
mod tests {
    use super::super::request_queue::request_queue;
    use super::*;
    use panelprep_cell::cycle;
    use panelprep_cell::record::RequestSource;

    /// If the list of users is on a disk that hangs, a stop is in the queue, and so at the robot, within 100 ms, with
    /// the user's number instead of a name. If the disk answers, the stop has the name.
    #[test]
    fn a_stop_does_not_wait_for_the_disk_with_the_names() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().expect("a runtime");
        let named = |names: Arc<NameLookup>| {
            let (sender, queue) = request_queue();
            let gateway = Gateway { names, ..Gateway::without_cell(sender, Reason::new("not_now", "no cell")) };
            let who = RequestAuthor { uid: Some(1_001), ..RequestAuthor::from_source(RequestSource::Socket) };
            let answered = gateway.request(RequestKind::Table(cycle::Request::Stop), who);
            let asked = runtime.block_on(async {
                let taken = tokio::task::spawn_blocking(move || queue.next(Duration::from_millis(100)));
                tokio::join!(timeout(Duration::from_millis(200), answered), taken).1.expect("no panic")
            });
            asked.expect("the stop is in the queue").requester.user
        };
        assert_eq!(named(Arc::new(|uid| Some(format!("user {uid}")))), Some("user 1001".to_owned()));
        let (disk, hangs) = std::sync::mpsc::channel::<()>();
        let hangs = std::sync::Mutex::new(hangs);
        assert_eq!(named(Arc::new(move |_| hangs.lock().ok()?.recv().ok().map(|()| String::new()))), None);
        // The waiting thread ends when its channel is dropped; then the runtime can end.
        drop(disk);
    }

    /// A request that an interface refuses because of the user's role is recorded, too, with its author and reason.
    #[test]
    fn a_refusal_by_an_interface_is_recorded() {
        let (sender, queue) = request_queue();
        let gateway = Gateway::without_cell(sender, Reason::new("not_now", "no cell"));
        let wanted = RequestKind::Hold { why: "a hair".to_owned() }.wanted().expect("it is for the cell");
        let who =
            RequestAuthor { user: Some("ada".to_owned()), ..RequestAuthor::from_source(RequestSource::Socket) };
        gateway.keep_refused(wanted.clone(), who.clone(), vec![Reason::new("not_permitted", "no")]);
        let kept = queue.next(Duration::ZERO).expect("a request");
        assert_eq!((kept.requester, kept.what.describe().as_str()), (who, "hold"));
        let RequestKind::Refused { wanted: found, reasons } = kept.what else { panic!("another request") };
        assert_eq!((found, reasons.len()), (wanted, 1));
        assert_eq!(RequestKind::State.wanted(), None);
    }

    #[test]
    fn a_number_is_identified_by_its_name() {
        let list =
            "root:x:0:0:root:/root:/bin/bash\nbroken\nanna:x:1001:1001:Anna:/home/anna:/bin/sh\n:x:7:7::/:\n";
        let who = |uid| RequestAuthor {
            front: RequestSource::Socket,
            uid,
            user: uid.and_then(|uid| find_user_name(list, uid)),
            from: None,
        };
        let told = |uid| format_for_log(&who(Some(uid)));
        assert_eq!((told(0), told(1_001)), ("root (uid 0)".to_owned(), "anna (uid 1001)".to_owned()));
        assert_eq!((told(7), told(5)), ("uid 7".to_owned(), "uid 5".to_owned()), "no name, no such user");
        assert_eq!(format_for_log(&who(None)), "an unknown user");
    }
}
