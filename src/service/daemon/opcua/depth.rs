//! The data read from the store and from files, in addition to the state that the loop reports. They are read at
//! longer intervals, on a separate thread, so that a slow disk only makes these values old.

use super::access::Access;
use super::certificates::{self, RejectedFiles, TrustedFiles};
use super::connection_limit::ConnectionLimiter;
use crate::daemon::interface_context::InterfaceContext;
use crate::daemon::setup_source::recipe_hashes;
use panelprep_base::verdict::Verdict;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::record::{CycleId, PartNames};
use panelprep_interfaces::packml::{CycleCounts, GridState, RecipeHash, Verified};
use panelprep_store::history::{Alarm, Priority, grid_states};
use panelprep_store::store::{Store, StoreError};
use std::cmp::Reverse;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum number of rejected certificates that are logged individually.
const MAX_LOGGED: usize = 3;
/// Interval at which calibration files are read.
const FILE_POLL_INTERVAL: Duration = Duration::from_secs(30);

/// The values that are read from the store and from files.
#[derive(Debug, Clone, Default)]
pub(super) struct StoreValues {
    pub part: PartNames,
    /// The state of each grid that was seen, by its name.
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

/// The newest cycle, and whether it has ended.
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
    /// The folder of the certificates.
    pub folder: PathBuf,
    pub rejected: RejectedFiles,
    pub trusted: TrustedFiles,
    pub files_read: Option<Instant>,
    /// The newest cycle up to which the cycles were counted.
    pub counted: Option<NewestCycle>,
    pub last: StoreValues,
}

impl StoreReader {
    /// Reads all data that are old enough; a value that cannot be read stays as it was, and the log states why.
    pub fn read(&mut self, cycle: NewestCycle) -> StoreValues {
        self.front.check_alarms();
        let (alarms, people) = (self.front.alarms.clone(), self.access.accounts_with_audit().clone());
        let mut now = self.last.clone();
        let read = people.read(|store| {
            let accounts = store.accounts()?;
            read_store(store, cycle.id, &mut now)?;
            // Counting reads all cycles, so it is done only if the newest cycle has begun or ended since the last
            // count.
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
            Ok((verdict, reasons, equipment)) => {
                now.may_start = Some(verdict != Verdict::Reject);
                now.calibration_reasons = reasons;
                now.calibrations =
                    equipment.into_iter().map(|one| format!("{}: {}", one.name, one.calibration)).collect();
            }
            Err(problem) => (now.may_start, now.calibration_reasons) = (Some(false), vec![problem]),
        }
        now.recipes = recipe_hashes(&*self.front.setup).unwrap_or_default();
    }

    /// Writes the connections and certificates that were rejected since the last call to the audit trail.
    fn log_rejected(&mut self) {
        for words in self.trusted.rename_new_certificates(&self.folder) {
            tracing::warn!("OPC UA server: {words}");
        }
        let new = self.rejected.take_new_files(&self.folder);
        for file in new.iter().take(MAX_LOGGED) {
            let words = certificates::describe_certificate(file);
            let todo = format!(
                "unknown certificate; to trust the client, move the certificate from {} to {} in {}",
                certificates::REJECTED,
                certificates::TRUSTED,
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
            self.audit_refusal(None, format!("{turned_away} connections rejected: too many connections"));
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
