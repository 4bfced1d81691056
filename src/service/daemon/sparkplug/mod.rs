//! The cell as an edge node of Sparkplug B at an MQTT broker: a live view whose data may be lost.
//!
//! ```text
//! the loop ─ state, twice a second ─ CellView ─────────┐
//! the store ─ every ten seconds, and at each change ───┤
//! broker ─ TLS ─ connection ─ packets ─ session ─ panelprep_interfaces::sparkplug::EdgeNode ─ actions ─ publish
//!                                                                              └──── requests → Gateway → the loop, audit trail
//! ```
//!
//! The edge node has its own thread and runtime. Whatever the broker does, the loop, the connection to the robot and
//! the cameras never wait for it. Commands pass through the gateway, as those of every interface do.
//!
//! This file contains the thread that keeps the cell connected to its broker, and the cell's state for the broker: the
//! state is requested from the loop twice a second; the store is read if something has changed or ten seconds have
//! passed.

mod session;
#[cfg(test)]
mod tests;

use self::session::{BrokerConnection, HostRequests, NAME, SessionEnd, SessionParts, run_connection};
use super::alarms::Alarms;
use super::background::{Background, Plan};
use super::gateway::InterfaceContext;
use super::request::{Reply, RequestKind};
use crate::setup::clock::now_unix_ms;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::{NodeCommands, SparkplugNode};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use panelprep_interfaces::sparkplug::{CellIds, CellView, EdgeNode, LoopView, NodeSetup, StoreView};
use panelprep_store::history::{Query, summary};
use panelprep_store::store::{Store, StoreError, free_mb};
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

/// Delays before the next attempt to connect: the first value at the beginning, then twice as long each time, up to the
/// second value.
const RETRY_DELAYS: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(60)];
/// Time after which a connection is treated as stable.
const MIN_STABLE_TIME: Duration = Duration::from_secs(30);
/// Number of threads that wait for the store's disk and for the look-up of host names.
const BLOCKING_THREADS: usize = 3;

/// The parts of the service that the edge node needs.
pub struct SparkplugParts {
    /// The `[sparkplug]` table of the cell's file.
    pub node: SparkplugNode,
    /// The parts that all interfaces share.
    pub front: InterfaceContext,
}

/// The running edge node. Dropping this value ends it and reports the node's death to the broker.
#[derive(Debug)]
pub struct SparkplugEdge {
    _background: Background,
}

impl SparkplugEdge {
    /// Connects the cell to its broker, and tries again if the connection is lost or a file cannot be used; the cell
    /// does not wait for the connection.
    ///
    /// # Errors
    /// If the operating system cannot start a thread.
    pub fn serve(SparkplugParts { node, front }: SparkplugParts) -> std::io::Result<Self> {
        let plan = Plan { name: "sparkplug", task: NAME, blocking_threads: BLOCKING_THREADS, stack_bytes: None };
        let begin = async move |leave: &mut oneshot::Receiver<()>| run((&node, &front), leave).await;
        Ok(SparkplugEdge { _background: Background::start(plan, begin)? })
    }
}

async fn run((node, front): (&SparkplugNode, &InterfaceContext), leave: &mut oneshot::Receiver<()>) {
    let address = format!("{}:{}", node.broker, node.port);
    let from = format!("MQTT broker {address}");
    let asking = HostRequests { gateway: front.gateway.clone(), people: front.people.clone(), origin: from };
    let (tell, view) = watch::channel(None);
    tokio::spawn(poll_cell(front.clone(), tell));
    let session = SessionParts {
        host_requests: asking,
        view,
        started: Instant::now(),
        address,
        alarms: front.alarms.clone(),
    };
    let mut edge = EdgeNode::new(NodeSetup {
        commands_allowed: node.commands == NodeCommands::Operator,
        aliases: node.aliases,
        ids: CellIds {
            group_id: node.group_id.clone(),
            edge_node_id: node.edge_node_id.clone(),
            primary_host_id: node.primary_host_id.clone(),
        },
    });
    let mut pause = RETRY_DELAYS[0];
    loop {
        let begun = Instant::now();
        let ended = match BrokerConnection::read(node) {
            Ok(broker) => run_connection((&session, &broker), &mut edge, leave).await,
            Err(problem) => SessionEnd::Lost(format!(
                "{problem}; check the files that [sparkplug] in the cell's file \
                                                 names"
            )),
        };
        match ended {
            SessionEnd::Leaving => return,
            SessionEnd::HostOffline => {
                tracing::info!(
                    "MQTT Sparkplug: the primary host is offline; the cell disconnects from {} and connects again \
                     later",
                    session.address
                );
            }
            SessionEnd::Lost(why) => session.report_failure(&why),
        }
        pause = if begun.elapsed() >= MIN_STABLE_TIME { RETRY_DELAYS[0] } else { pause };
        tokio::select! {
            _ = &mut *leave => return,
            () = sleep(pause) => {}
        }
        pause = (2 * pause).min(RETRY_DELAYS[1]);
    }
}

/// Interval at which the state is requested from the loop.
const POLL_INTERVAL: Duration = Duration::from_millis(500);
/// Maximum interval between two readings of the store: the end of a cycle may be stored shortly after the state has
/// changed, and the reported ages increase.
const MAX_STORE_POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Reads the state of the cell repeatedly, until no receiver is left.
async fn poll_cell(parts: InterfaceContext, tell: watch::Sender<Option<CellView>>) {
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

/// Returns whether the store may contain new data, because a phase, a state, a pass or a cycle has changed.
fn has_store_changed(was: &LoopView, now: &LoopView) -> bool {
    let key = |view: &LoopView| (view.table.map(|state| state.at), view.phase.clone(), view.cycle, view.pass);
    key(was) != key(now)
}

fn loop_view(reply: Reply) -> LoopView {
    // If the loop does not answer, its state is unknown, and its former values are not reported as present values.
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

/// Returns the data of the store and the disk. The call blocks while it reads the disk. If the store cannot be read,
/// none of its data are reported.
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
    // Only the newest cycle can still be running, so at least one of the two newest cycles has ended.
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
