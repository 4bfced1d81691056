//! The service while its store cannot be opened, as on a full disk: it answers requests, does nothing else, and
//! tries again.

use super::reply::{Reply, RequestResult};
use super::request::{Request, RequestKind};
use super::request_queue::RequestQueue;
use panelprep_base::verdict::Reason;
use sd_notify::NotifyState;
use std::time::Duration;

/// Time between two attempts to open the store.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);

/// Answers each request with the reason why nothing can be done, until `attempt` succeeds; `None` if a signal ends the
/// wait. The state in the reply is Aborted: nothing moves, and the last action of the cell cannot be read.
pub fn wait_for<T>(queue: &RequestQueue, mut attempt: impl FnMut() -> Result<T, Reason>) -> Option<T> {
    let mut is_reported = false;
    loop {
        let why = match attempt() {
            Ok(opened) => return Some(opened),
            Err(why) => why,
        };
        if !std::mem::replace(&mut is_reported, true) {
            tracing::error!("the service waits: {}", why.message);
            notify(&[NotifyState::Ready, NotifyState::Status(&why.message)]);
        }
        notify(&[NotifyState::Watchdog]);
        let Some(Request { what, reply, .. }) = queue.next(RETRY_INTERVAL) else { continue };
        if matches!(what, RequestKind::Leave) {
            return None;
        }
        // A request without a reply channel was answered already, and there is no open store that could record it.
        for reply in queue.take_followers().into_iter().chain(reply) {
            let answer =
                if matches!(what, RequestKind::State) { RequestResult::Done } else { RequestResult::Fault };
            let state = Some("aborted".to_owned());
            #[expect(clippy::let_underscore_must_use, reason = "a client that disconnected needs no reply")]
            let _ = reply.send(Reply { state, ..Reply::refused(answer, vec![why.clone()]) });
        }
    }
}

/// Notifies systemd; has no effect without systemd.
fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("systemd cannot be notified: {error}");
    }
}
