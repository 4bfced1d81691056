//! The cell's state for the broker: the loop is polled twice a second, and the store if something has changed or
//! ten seconds have passed.

use crate::daemon::alarms::Alarms;
use crate::daemon::clock::now_unix_ms;
use crate::daemon::interface_context::InterfaceContext;
use crate::daemon::reply::Reply;
use crate::daemon::request::RequestKind;
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_interfaces::sparkplug::{CellView, LoopView, StoreView};
use panelprep_store::history::{Query, summary};
use panelprep_store::store::{Store, StoreError, free_mb};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio::time::sleep;

/// Interval at which the loop is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Longest time between two readings of the store: the record of a cycle's end may come a little after its state,
/// and ages increase.
const MAX_STORE_POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Reads the cell repeatedly, until no receiver is left.
pub(super) async fn poll_cell(parts: InterfaceContext, tell: watch::Sender<Option<CellView>>) {
    let (mut kept, mut read) = (StoreView::default(), None::<(Instant, LoopView)>);
    while !tell.is_closed() {
        let reply =
            parts.gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::Sparkplug)).await;
        let now = loop_view(reply);
        let is_due = read
            .as_ref()
            .is_none_or(|(at, was)| at.elapsed() >= MAX_STORE_POLL_INTERVAL || has_store_changed(was, &now));
        if is_due {
            let shared = parts.clone();
            kept = tokio::task::spawn_blocking(move || read_store_view(&shared)).await.unwrap_or_default();
            read = Some((Instant::now(), now.clone()));
        }
        tell.send_replace(Some(CellView { now, kept: kept.clone() }));
        sleep(POLL_INTERVAL).await;
    }
}

/// Returns whether the store may contain something new: a phase, a state, a pass or a cycle has changed.
fn has_store_changed(was: &LoopView, now: &LoopView) -> bool {
    let key = |view: &LoopView| (view.table.map(|state| state.at), view.phase.clone(), view.cycle, view.pass);
    key(was) != key(now)
}

fn loop_view(reply: Reply) -> LoopView {
    // If the loop does not answer, its state is unknown, and no former value is reported as the present one.
    if reply.state.is_none() {
        return LoopView::default();
    }
    LoopView {
        table: reply.extras.table,
        phase: reply.phase,
        cycle: reply.cycle_id,
        panel: reply.panel,
        pass: reply.pass,
        film_s: reply.film_s,
        film_total_s: reply.extras.film_total_s,
        waypoint: reply.waypoint,
        waypoints: reply.of,
    }
}

/// Returns the data of the store and the disk; runs on the calling thread, which may wait for the disk. If the
/// store cannot be read, none of its data is reported.
fn read_store_view(parts: &InterfaceContext) -> StoreView {
    parts.check_alarms();
    match parts.people.read(|store| read(store, &parts.alarms)) {
        Ok(view) => view,
        Err(error) => {
            tracing::warn!("MQTT Sparkplug cannot report data of the store: {error}");
            StoreView::default()
        }
    }
}

fn read(store: &Store, alarms: &Alarms) -> Result<StoreView, StoreError> {
    let now_unix_s = now_unix_ms() / 1_000;
    let newest = store.newest_cycle()?.map(|id| store.past_cycle(id)).transpose()?.map(|past| summary(&past));
    let newest = newest.as_ref();
    // Only the newest cycle can still be running, so if there are two cycles, at least one is over.
    let hits = store.search(&Query { limit: 2, ..Query::default() })?.hits;
    let last = hits.iter().find_map(|hit| Some((hit.cycle.0, hit.verdict?)));
    let lasting = alarms.active_in_order(store)?;
    let verified_h = |subject: &str| -> Result<Option<i64>, StoreError> {
        Ok(store.newest_verification(subject)?.map(|last| (now_unix_s - last.at_unix_s).div_euclid(3_600)))
    };
    let counts = store.cycle_counts()?;
    Ok(StoreView {
        serial: newest.and_then(|newest| newest.part.serial.clone()),
        work_order: newest.and_then(|newest| newest.part.order.clone()),
        failed_grids: newest.and_then(|newest| newest.films.failed_at_end.clone()),
        last_cycle: last.map(|(number, _)| number),
        last_verdict: last.map(|(_, verdict)| Verdict::keyword(verdict)),
        active_alarms: Some(lasting.len()),
        newest_alarm: lasting.last().map(|alarm| alarm.code.clone()),
        scanner_verified_h: verified_h("scanner")?,
        flange_camera_verified_h: verified_h("flange_camera")?,
        tool_verified_h: verified_h("tool")?,
        disc_worn_mm2: store.disc_worn_mm2().ok(),
        free_mb: free_mb(store.folder()).ok(),
        cycles: Some(counts.ended),
        passed: Some(counts.passed),
        abrasions: Some(counts.contacts),
    })
}
