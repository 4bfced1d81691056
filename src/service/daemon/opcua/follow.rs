//! Follows the cell and reports changes: the state five times a second, the data of the store once a second.

use super::cell_nodes::CellNodes;
use super::conditions::AlarmConditions;
use super::core_nodes::CoreNodes;
use super::depth::{NewestCycle, StoreReader, StoreValues};
use super::values::{data_value, time};
use crate::daemon::clock::now_unix_ms;
use crate::daemon::gateway::Gateway;
use crate::daemon::reply::Reply;
use crate::daemon::request::RequestKind;
use opcua::server::node_manager::memory::InMemoryNodeManager;
use opcua::server::{ServerHandle, SubscriptionCache};
use opcua::types::NodeId;
use panelprep_cell::cycle::State;
use panelprep_cell::record::{CycleId, RequestAuthor, RequestSource};
use panelprep_interfaces::packml::{GridState, NODES, Snapshot, UnitMode, UnitState, Value};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio::time::sleep;

/// Interval at which the loop is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Interval at which the store is read.
const STORE_POLL_INTERVAL: Duration = Duration::from_secs(1);

/// Reads the store repeatedly and sends the data to the follower of the cell.
pub(super) async fn poll_store(
    mut reader: StoreReader,
    cycle: watch::Receiver<NewestCycle>,
    tell: watch::Sender<StoreValues>,
) {
    loop {
        let of = *cycle.borrow();
        let read = tokio::task::spawn_blocking(move || {
            let depth = reader.read(of);
            (reader, depth)
        });
        let Ok((returned, depth)) = read.await else { return };
        reader = returned;
        if tell.send(depth).is_err() {
            return;
        }
        sleep(STORE_POLL_INTERVAL).await;
    }
}

/// The times at which the unit entered its state and its mode.
#[derive(Debug, Default)]
struct UnitTimes {
    state: Option<(UnitState, Instant)>,
    mode: Option<(UnitMode, Instant)>,
}

impl UnitTimes {
    fn seconds<T: PartialEq + Copy>(of: &mut Option<(T, Instant)>, now: T) -> u32 {
        let since = match *of {
            Some((was, since)) if was == now => since,
            _ => of.insert((now, Instant::now())).1,
        };
        u32::try_from(since.elapsed().as_secs()).unwrap_or(u32::MAX)
    }

    fn update(&mut self, state: &State) -> (u32, u32) {
        let in_state = Self::seconds(&mut self.state, UnitState::from_state(state.at));
        (in_state, Self::seconds(&mut self.mode, UnitMode::from_state(state)))
    }
}

/// The parts needed for reporting.
pub(super) struct Follower {
    pub gateway: Gateway,
    pub nodes: Arc<InMemoryNodeManager<CellNodes>>,
    pub core: Arc<InMemoryNodeManager<CoreNodes>>,
    pub conditions: Arc<AlarmConditions>,
    pub handle: ServerHandle,
    pub depth: watch::Receiver<StoreValues>,
    pub cycle: watch::Sender<NewestCycle>,
}

impl Follower {
    /// Updates the nodes until the server ends.
    pub async fn update_nodes(self) {
        let ids: Vec<NodeId> = NODES
            .iter()
            .map(|node| super::address_space::node_id(self.nodes.inner().namespace, node.path))
            .collect();
        let (mut published, mut since) = (vec![None::<(Value, bool)>; NODES.len()], UnitTimes::default());
        let (mut now, mut linked) = (Snapshot::default(), Vec::new());
        loop {
            let reply =
                self.gateway.request(RequestKind::State, RequestAuthor::from_source(RequestSource::OpcUa)).await;
            let depth = self.depth.borrow().clone();
            now = snapshot(now, reply, depth, &mut since);
            now.refusal = self.nodes.inner().calls.last_refusal();
            let newest = NewestCycle { id: now.cycle.map(CycleId), has_ended: now.verdict.is_some() };
            self.cycle.send_if_modified(|was| std::mem::replace(was, newest) != newest);
            self.publish(&ids, &now, &mut published);
            self.conditions.update_conditions(&now.alarms, self.handle.subscriptions());
            let conditions = self.conditions.nodes();
            if conditions != linked {
                CoreNodes::link(&mut self.core.address_space().write(), &linked, &conditions);
                linked = conditions;
            }
            sleep(POLL_INTERVAL).await;
        }
    }

    /// Sets the values that changed.
    fn publish(&self, ids: &[NodeId], now: &Snapshot, published: &mut [Option<(Value, bool)>]) {
        let at = time(now.now_unix_ms);
        let mut changed = Vec::new();
        for ((node, id), published) in NODES.iter().zip(ids).zip(published) {
            let value = (node.value)(now);
            // The service's own data is known even if its loop does not answer.
            let is_known = now.answers || node.path.starts_with("Service/");
            let next = Some((value, is_known));
            if *published != next {
                *published = next;
                changed.extend(published.as_ref().map(|(value, known)| (id, None, data_value(value, *known, at))));
            }
        }
        let subscriptions: &SubscriptionCache = self.handle.subscriptions();
        if let Err(status) = self.nodes.set_values(subscriptions, changed.into_iter()) {
            tracing::warn!("cannot update the values of the OPC UA server: {status}");
        }
    }
}

fn snapshot(was: Snapshot, reply: Reply, depth: StoreValues, since: &mut UnitTimes) -> Snapshot {
    let now_unix_ms = now_unix_ms();
    let StoreValues {
        part,
        grids,
        scanner,
        flange_camera,
        tool,
        alarms,
        counts,
        may_start,
        calibration_reasons,
        calibrations,
        recipes,
    } = depth;
    let of_store = Snapshot {
        part,
        scanner,
        flange_camera,
        tool,
        alarms,
        counts,
        may_start,
        calibration_reasons,
        calibrations,
        recipes,
        now_unix_ms,
        ..was
    };
    let Some(state) = reply.extras.table else {
        // The last known values are retained; no command is possible.
        return Snapshot { answers: false, possible: vec![], ..of_store };
    };
    let (in_state_s, in_mode_s) = since.update(&state);
    let grid = |id: String| {
        let state = grids.iter().find(|seen| seen.id == id).map_or("untested", |seen| seen.state);
        GridState { id, state }
    };
    Snapshot {
        answers: true,
        state: Some(state),
        in_state_s,
        in_mode_s,
        phase: reply.phase,
        cycle: reply.cycle_id,
        panel: reply.panel,
        pass: reply.pass,
        film_s: reply.film_s,
        film_total_s: reply.extras.film_total_s,
        waypoint: reply.waypoint,
        waypoints: reply.of,
        verdict: reply.verdict,
        reasons: reply.reasons,
        possible: reply.extras.possible,
        is_review: reply.extras.is_review,
        grids: reply.extras.grids.iter().map(|id| grid(id.to_string())).collect(),
        ..of_store
    }
}
