//! Monitors the cell and reports changes to the OPC UA clients: the state five times a second, the data of the store
//! once a second.
//!
//! In addition to the state that the loop reports, data are read from the store and from files. They are read at longer
//! intervals on a separate thread, so that a slow disk only delays these values.

use super::access::Access;
use super::address_space::{data_value, time};
use super::certificates;
use super::certificates::{RejectedFiles, TrustedFiles};
use super::conditions::AlarmConditions;
use super::connection_limit::ConnectionLimiter;
use super::nodes::{CellNodes, CoreNodes};
use crate::daemon::gateway::{Gateway, InterfaceContext};
use crate::daemon::request::{Reply, RequestKind};
use crate::setup::{EquipmentList, clock::now_unix_ms};
use opcua::server::node_manager::memory::InMemoryNodeManager;
use opcua::server::{ServerHandle, SubscriptionCache};
use opcua::types::NodeId;
use panelprep_base::verdict::Verdict;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::cycle::State;
use panelprep_cell::record::{CycleId, PartNames, RequestAuthor, RequestSource};
use panelprep_interfaces::packml::{
    CycleCounts, GridState, NODES, RecipeHash, Snapshot, UnitMode, UnitState, Value, Verified,
};
use panelprep_store::history::{Alarm, Priority, grid_states};
use panelprep_store::store::{Store, StoreError};
use std::cmp::Reverse;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio::time::sleep;

/// Interval at which the state is requested from the loop.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Interval at which the store is read.
const STORE_POLL_INTERVAL: Duration = Duration::from_secs(1);

/// Reads the store repeatedly and sends the data to the [`Follower`].
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

/// Writes the values of the cell to the nodes.
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
                CoreNodes::link_conditions(&mut self.core.address_space().write(), &linked, &conditions);
                linked = conditions;
            }
            sleep(POLL_INTERVAL).await;
        }
    }

    /// Writes the values that have changed to the nodes.
    fn publish(&self, ids: &[NodeId], now: &Snapshot, published: &mut [Option<(Value, bool)>]) {
        let at = time(now.now_unix_ms);
        let mut changed = Vec::new();
        for ((node, id), published) in NODES.iter().zip(ids).zip(published) {
            let value = (node.value)(now);
            // The service's own values are known even if its loop does not answer.
            let is_known = now.answers || node.path.starts_with("Service/");
            let next = Some((value, is_known));
            if *published != next {
                *published = next;
                changed.extend(published.as_ref().map(|(value, known)| (id, None, data_value(value, *known, at))));
            }
        }
        let subscriptions: &SubscriptionCache = self.handle.subscriptions();
        if let Err(status) = self.nodes.set_values(subscriptions, changed.into_iter()) {
            tracing::warn!(
                "cannot update the values of the OPC UA server: {status}; they are written again at the \
                            next change"
            );
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
        // The last known values remain; no command is possible.
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

/// Maximum number of rejected certificates that are logged individually.
const MAX_LOGGED: usize = 3;
/// Interval at which the calibration files are read.
const FILE_POLL_INTERVAL: Duration = Duration::from_secs(30);

/// The values that are read from the store and from files.
#[derive(Debug, Clone, Default)]
pub(super) struct StoreValues {
    pub part: PartNames,
    /// The state of each grid, by the grid's name.
    pub grids: Vec<GridState>,
    pub scanner: Option<Verified>,
    pub flange_camera: Option<Verified>,
    pub tool: Option<Verified>,
    pub alarms: Vec<Alarm>,
    pub counts: CycleCounts,
    pub may_start: Option<bool>,
    pub calibration_reasons: Vec<String>,
    pub calibrations: Vec<String>,
    pub recipes: Vec<RecipeHash>,
}

/// The number of the newest cycle, and whether it has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct NewestCycle {
    pub id: Option<CycleId>,
    pub has_ended: bool,
}

/// Reads it.
pub(super) struct StoreReader {
    pub access: Arc<Access>,
    pub front: InterfaceContext,
    pub connections: Arc<ConnectionLimiter>,
    /// The folder of certificates.
    pub folder: PathBuf,
    pub rejected: RejectedFiles,
    pub trusted: TrustedFiles,
    pub files_read: Option<Instant>,
    /// The newest cycle at the time of the last count of cycles.
    pub counted: Option<NewestCycle>,
    pub last: StoreValues,
}

impl StoreReader {
    /// Reads all data whose polling interval is over. A value that cannot be read stays unchanged, and the reason is
    /// logged.
    pub fn read(&mut self, cycle: NewestCycle) -> StoreValues {
        self.front.check_alarms();
        let (alarms, people) = (self.front.alarms.clone(), self.access.accounts_with_audit().clone());
        let mut now = self.last.clone();
        let read = people.read(|store| {
            let accounts = store.accounts()?;
            read_store(store, cycle.id, &mut now)?;
            // To count the cycles, all of them are read; therefore they are counted only if a cycle has begun or ended
            // since the last count.
            if self.counted != Some(cycle) {
                now.counts = counts(&store.verdict_counts()?);
                self.counted = Some(cycle);
            }
            now.alarms = alarms.active_in_order(store)?;
            now.alarms.retain(|alarm| alarm.priority > Priority::Note);
            now.alarms.sort_by_key(|alarm| Reverse((alarm.priority, alarm.raised_unix_ms)));
            Ok(accounts)
        });
        match read {
            Ok(accounts) => self.access.update_accounts(&accounts),
            Err(error) => tracing::warn!("the OPC UA server continues with old values: {error}"),
        }
        if self.files_read.is_none_or(|at| at.elapsed() >= FILE_POLL_INTERVAL) {
            self.files_read = Some(Instant::now());
            self.read_files(&mut now);
        }
        self.log_rejected();
        self.last = now.clone();
        now
    }

    fn read_files(&self, now: &mut StoreValues) {
        match self.front.setup.list_equipment() {
            Ok(EquipmentList { verdict, reasons, items }) => {
                now.may_start = Some(verdict != Verdict::Reject);
                now.calibration_reasons = reasons;
                now.calibrations =
                    items.into_iter().map(|one| format!("{}: {}", one.name, one.calibration)).collect();
            }
            Err(problem) => (now.may_start, now.calibration_reasons) = (Some(false), vec![problem]),
        }
        now.recipes = self.front.setup.recipe_hashes().unwrap_or_default();
    }

    /// Adds the connections and certificates that were rejected since the last call to the audit trail.
    fn log_rejected(&mut self) {
        for words in self.trusted.rename_new_certificates(&self.folder) {
            tracing::warn!("OPC UA server: {words}");
        }
        let new = self.rejected.take_new_files(&self.folder);
        for file in new.iter().take(MAX_LOGGED) {
            let words = certificates::describe_certificate(file);
            let todo = format!(
                "unknown certificate; to trust the client, move the certificate from {} to {} in {}",
                certificates::REJECTED_FOLDER,
                certificates::TRUSTED_FOLDER,
                self.folder.display()
            );
            tracing::warn!("OPC UA client rejected: {words}: {todo}");
            self.audit_refusal(Some(words), todo);
        }
        if new.len() > MAX_LOGGED {
            self.audit_refusal(None, format!("{} more unknown certificates", new.len() - MAX_LOGGED));
        }
        let turned_away = self.connections.take_rejected_count();
        if turned_away > 0 {
            self.audit_refusal(
                None,
                format!(
                    "{turned_away} connections rejected, because the maximum number of \
                                              connections is reached: close connections that are not needed"
                ),
            );
        }
    }

    /// Records a refused connection in the audit trail.
    fn audit_refusal(&self, subject: Option<String>, refused: String) {
        let line = AuditEntry::for_completed_action(None, None, self.access.addresses(), "connect");
        self.access.accounts_with_audit().audit(&AuditEntry { subject, refused: Some(refused), ..line });
    }
}

fn read_store(store: &Store, cycle: Option<CycleId>, now: &mut StoreValues) -> Result<(), StoreError> {
    let verified = |subject| -> Result<Option<Verified>, StoreError> {
        let last = store.newest_verification(subject)?;
        Ok(last.map(|last| Verified { at_unix_s: last.at_unix_s, error_mm: last.error, limit_mm: last.limit }))
    };
    now.scanner = verified("scanner")?;
    now.flange_camera = verified("flange_camera")?;
    now.tool = verified("tool")?;
    (now.part, now.grids) = match cycle {
        None => (PartNames::default(), Vec::new()),
        Some(cycle) => {
            let states = grid_states(&store.cycle(cycle)?.findings).into_iter();
            let grids = states.map(|(id, state)| GridState { id, state }).collect();
            (store.cycle_part(cycle)?.unwrap_or_default(), grids)
        }
    };
    Ok(())
}

fn counts(of_verdicts: &[(Verdict, u32)]) -> CycleCounts {
    let mut counts = CycleCounts::default();
    for (verdict, count) in of_verdicts {
        let place = match verdict {
            Verdict::Pass => &mut counts.passed,
            Verdict::Fail => &mut counts.failed,
            Verdict::Reject => &mut counts.rejected,
            Verdict::Invalid => &mut counts.invalid,
            Verdict::Aborted => &mut counts.aborted,
            Verdict::Accept | Verdict::Review => &mut counts.other,
        };
        *place += count;
    }
    counts
}
