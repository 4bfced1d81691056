//! How the cell stands, for everybody who looks on: asked for once, told to all.

use super::frame::Frames;
use super::state::Web;
use crate::daemon::gateway::Gateway;
use crate::daemon::reply::Reply;
use crate::daemon::request::What;
use crate::record::{Front, Who};
use crate::verdict::{Reason, Verdict};
use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::stream::{self, Stream};
use serde::Serialize;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::watch;

/// The loop is asked so often.
const EVERY: Duration = Duration::from_millis(200);
/// Without a change, a page hears at least so often that all is well.
const SIGN: Duration = Duration::from_secs(1);

/// How the cell stands.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(super) struct Live {
    /// The service's clock when the loop answered last, ms since 1970.
    pub answered_ms: u64,
    /// Whether the loop answers now.
    pub answers: bool,
    pub state: Option<String>,
    pub phase: Option<String>,
    pub panel: Option<String>,
    pub pass: Option<u8>,
    pub film_s: Option<f64>,
    pub film_total_s: Option<f64>,
    pub waypoint: Option<u32>,
    pub of: Option<u32>,
    pub cycle: Option<i64>,
    pub verdict: Option<Verdict>,
    pub reasons: Vec<Reason>,
    /// What the table would take now.
    pub possible: Vec<&'static str>,
    pub is_review: bool,
    pub has_page: bool,
    pub grids: Vec<String>,
    /// The newest picture, by its number and name.
    pub frame: u64,
    pub frame_name: Option<String>,
}

impl Live {
    fn of(reply: Reply, (frame, frame_name): (u64, Option<String>)) -> Self {
        Live {
            answered_ms: unix_ms(),
            answers: reply.state.is_some(),
            state: reply.state,
            phase: reply.phase,
            panel: reply.panel,
            pass: reply.pass,
            film_s: reply.film_s,
            film_total_s: reply.extras.film_total_s,
            waypoint: reply.waypoint,
            of: reply.of,
            cycle: reply.cycle_id,
            verdict: reply.verdict,
            reasons: reply.reasons,
            possible: reply.extras.possible,
            is_review: reply.extras.is_review,
            has_page: reply.page.is_some(),
            grids: reply.extras.grids.iter().map(ToString::to_string).collect(),
            frame,
            frame_name,
        }
    }

    /// Whether nothing changed but the time.
    fn says_the_same(&self, other: &Live) -> bool {
        Live { answered_ms: 0, ..self.clone() } == Live { answered_ms: 0, ..other.clone() }
    }
}

fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

/// Asks the loop again and again, and tells what changed, until nobody listens.
pub(super) async fn follow(gateway: Gateway, frames: Arc<Frames>, tell: watch::Sender<Arc<Live>>) {
    let mut told = tokio::time::Instant::now();
    loop {
        let reply = gateway.request(What::State, Who::by(Front::Page)).await;
        let was = tell.borrow().clone();
        let now = match reply.state {
            Some(_) => Live::of(reply, frames.newest()),
            // What was last known stays, with the time when it was.
            None => Live { answers: false, reasons: reply.reasons, possible: vec![], ..(*was).clone() },
        };
        if !now.says_the_same(&was) || told.elapsed() >= SIGN {
            told = tokio::time::Instant::now();
            if tell.send(Arc::new(now)).is_err() {
                return;
            }
        }
        tokio::time::sleep(EVERY).await;
    }
}

/// The events of a page: how the cell stands, now and at each change. A browser that does not read holds nothing but its
/// connection: it gets the newest state when it reads again.
pub(super) async fn events(State(web): State<Arc<Web>>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let mut live = web.live.clone();
    live.mark_changed();
    let stream = stream::unfold(live, |mut live| async move {
        live.changed().await.ok()?;
        let now = live.borrow_and_update().clone();
        let event = Event::default().json_data(&*now).unwrap_or_default();
        Some((Ok(event), live))
    });
    Sse::new(stream).keep_alive(KeepAlive::new().interval(Duration::from_secs(15)))
}
