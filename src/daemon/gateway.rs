//! The service as its fronts see it: a front passes on a request and its origin, and waits for one reply.

use super::caller;
use super::camera_lease::SharedCameras;
use super::operator_texts;
use super::reply::{Exit, Reply};
use super::request::{PreparedCycle, Request, RequestKind, StartRequest};
use super::request_queue::{RequestQueueError, RequestSender};
use crate::record::Who;
use crate::verdict::Reason;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::time::timeout;

/// Time limit for the loop's reply; a longer time means that the loop is faulty.
const REPLY_TIMEOUT: Duration = Duration::from_secs(5);

/// Reads and checks the files of a requested cycle, or returns why the cycle cannot begin.
pub type Loader = dyn Fn(StartRequest) -> Result<PreparedCycle, Vec<Reason>> + Send + Sync;

/// The entry point through which fronts submit requests. All clones share the same state.
#[derive(Clone)]
pub struct Gateway {
    queue: RequestSender,
    loader: Arc<Loader>,
    /// The service's cameras, after they are opened.
    pub(super) cameras: Option<SharedCameras>,
}

impl Gateway {
    /// Creates a gateway. Requests go to this queue, this loader prepares starts, and these cameras are lent while
    /// the cell rests.
    pub fn new(queue: RequestSender, loader: Arc<Loader>, cameras: Option<SharedCameras>) -> Self {
        Gateway { queue, loader, cameras }
    }

    /// Passes on a request and returns the reply. It runs on a runtime of tokio that has a blocking thread for the
    /// loader.
    pub async fn request(&self, what: RequestKind, who: Who) -> Reply {
        let (what, who) = match what {
            // The user's name is not looked up here: the state is requested many times a second, and the name is read
            // from a file.
            RequestKind::State => (RequestKind::State, who),
            // The files are read here and not in the loop, which must answer the robot while the disk is slow.
            RequestKind::Start(start) => {
                let (recipe, who) = (start.recipe.clone(), caller::named(who));
                match self.prepare(start).await {
                    Ok(prepared) => (RequestKind::Begin(Box::new(prepared)), who),
                    Err(refused) => {
                        let what = RequestKind::Unprepared { recipe, reasons: refused.reasons.clone() };
                        #[expect(
                            clippy::let_underscore_must_use,
                            reason = "if the request is not accepted, the service has ended, or this user has too \
                                      many requests waiting"
                        )]
                        let _ = self.queue.send(Request::new(what, who));
                        return refused;
                    }
                }
            }
            RequestKind::Shoot(_) => {
                let message = "the service has not opened its cameras yet; wait until `panelprep ctl state` shows \
                               that the service is ready";
                return Reply::refused(Exit::Refused, vec![Reason::new("not_now", message)]);
            }
            RequestKind::Table(request) if request.is_decision() => {
                return Reply::refused(Exit::Refused, vec![operator_texts::no_step(request)]);
            }
            what => (what, caller::named(who)),
        };
        let in_log = (!matches!(what, RequestKind::State)).then(|| (what.words(), caller::in_log(&who)));
        let (reply, answer) = oneshot::channel();
        let failed = |code, message: &str| Reply::refused(Exit::Fault, vec![Reason::new(code, message)]);
        if let Err(error) = self.queue.send(Request { what, who, reply: Some(reply) }) {
            let code = if error == RequestQueueError::Ended { "ended" } else { "busy" };
            return failed(code, &error.to_string());
        }
        if let Some((what, who)) = in_log {
            tracing::info!("{who} asks: {what}");
        }
        match timeout(REPLY_TIMEOUT, answer).await {
            Ok(Ok(reply)) => reply,
            Ok(Err(_)) => failed("ended", "the service ended before it could answer"),
            // Not "refused": the request is in the queue and may still happen.
            Err(_) => failed(
                "silent",
                "the control loop of the service does not respond; check the state and the log of the service",
            ),
        }
    }

    /// Reads the files that a cycle needs, on a separate thread, because the disk may be slow.
    async fn prepare(&self, start: StartRequest) -> Result<PreparedCycle, Reply> {
        let loader = self.loader.clone();
        match tokio::task::spawn_blocking(move || loader(start)).await {
            Ok(prepared) => prepared.map_err(|reasons| Reply::refused(Exit::Refused, reasons)),
            Err(error) => {
                let message = format!("the recipe could not be read: {error}");
                Err(Reply::refused(Exit::Fault, vec![Reason::new("fault", message)]))
            }
        }
    }
}
