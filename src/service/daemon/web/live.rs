//! The state of the cell for all viewers: requested once, sent to all.

use super::frame::FrameEncoder;
use super::guard::VisitorExtension;
use super::live_state::LiveState;
use super::places::owner;
use super::state::Web;
use crate::daemon::gateway::Gateway;
use crate::daemon::request::RequestKind;
use axum::Extension;
use axum::extract::{ConnectInfo, State};
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::stream::{self, Stream};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use serde::Serialize;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// Interval at which the loop is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Longest time without a change until the connected pages are informed that the server is still working.
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(1);

/// Polls the loop and reports changes, until no receiver is left.
pub(super) async fn poll_loop(gateway: Gateway, frames: Arc<FrameEncoder>, tell: watch::Sender<Arc<LiveState>>) {
    let mut last_sent = tokio::time::Instant::now();
    loop {
        let reply = gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::Page)).await;
        let was = tell.borrow().clone();
        let now = match reply.state {
            // If the page itself is the only receiver, there is no viewer: then no picture is requested or made.
            Some(_) if tell.receiver_count() <= 1 => {
                LiveState::from_reply(reply, (was.frame, was.frame_name.clone()))
            }
            Some(_) => LiveState::from_reply(reply, frames.newest_frame()),
            // The last known values are retained, with their time.
            None => LiveState { answers: false, reasons: reply.reasons, possible: vec![], ..(*was).clone() },
        };
        if !now.is_unchanged(&was) || last_sent.elapsed() >= KEEP_ALIVE_INTERVAL {
            last_sent = tokio::time::Instant::now();
            if tell.send(Arc::new(now)).is_err() {
                return;
            }
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

/// An event of a page.
#[derive(Serialize)]
struct Seen<'l> {
    #[serde(flatten)]
    live: &'l LiveState,
    /// The account whose session the page has; `None` after its end. A page that was made for another one shows
    /// nothing more.
    by: Option<String>,
}

/// The events of a page: the state of the cell, now and at each change. A browser that does not read occupies only its
/// connection: it receives the newest state when it reads again. If there are too many viewers, the one that has
/// watched for longest gives way; a browser reconnects automatically.
pub(super) async fn events(
    State(web): State<Arc<Web>>,
    Extension(visitor): VisitorExtension,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let place = web.viewer_slots.acquire(owner(from.ip()));
    let mut live = web.live.clone();
    live.mark_changed();
    let token = visitor.person.map(|person| person.token);
    let stream = stream::unfold((live, place, web, token), |(mut live, mut place, web, token)| async move {
        tokio::select! {
            biased;
            () = place.wait_until_wanted() => return None,
            changed = live.changed() => changed.ok()?,
        }
        let now = live.borrow_and_update().clone();
        let session = token.as_deref().and_then(|token| web.sessions().find(token, web.now_s(), false));
        let now = if session.is_some() { now } else { Arc::new(now.for_strangers()) };
        let seen = Seen { live: &now, by: session.map(|session| session.name) };
        let event = Event::default().json_data(seen).unwrap_or_default();
        Some((Ok(event), (live, place, web, token)))
    });
    Sse::new(stream).keep_alive(KeepAlive::new().interval(Duration::from_secs(15)))
}
