//! The alarms of the cell, for every interface that shows them: those of the newest cycles, and those between cycles.

use super::active_alarms::{FoundProblems, StandingAlarms};
use super::camera_lease::SharedCameras;
use super::clock::now_unix_ms;
use super::people::AccountService;
use super::setup_source::SetupSource;
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::record::CycleId;
use panelprep_store::history::{Acknowledgement, Alarm, Query};
use panelprep_store::store::{Store, StoreError};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of newest cycles for which alarms are shown.
const MAX_CYCLES: usize = 50;
/// Shortest interval between checks of the cell, for the requests of all interfaces.
const MIN_CHECK_INTERVAL: Duration = Duration::from_secs(60);

/// The identification of an alarm by a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlarmId {
    /// The alarm's cycle; `None` for an alarm between cycles.
    pub cycle: Option<CycleId>,
    /// Its code.
    pub code: String,
    /// The time at which the alarm was raised, ms since 1970.
    pub raised_unix_ms: i64,
}

/// The alarms of the cell. One instance serves all interfaces.
#[derive(Debug)]
pub struct Alarms {
    people: Arc<AccountService>,
    active: StandingAlarms,
    last_check: Mutex<Option<Instant>>,
    /// The current problems of the connections to the plant, by the connection's name.
    connection_problems: Mutex<BTreeMap<&'static str, String>>,
}

impl Alarms {
    /// Creates the alarms for the store that `people` uses.
    pub fn new(people: Arc<AccountService>) -> Self {
        Alarms {
            people,
            active: StandingAlarms::default(),
            last_check: Mutex::default(),
            connection_problems: Mutex::default(),
        }
    }

    /// All alarms: active ones first, then by priority and time. This runs on the calling thread, which may wait
    /// for the disk.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn all(&self) -> Result<Vec<Alarm>, StoreError> {
        self.people.read(|store| self.all_from_store(store))
    }

    /// As [`Alarms::all`], for a caller that already reads this store.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn all_from_store(&self, store: &Store) -> Result<Vec<Alarm>, StoreError> {
        let newest = store.search(&Query { limit: MAX_CYCLES, ..Query::default() })?;
        let mut all = self.active.alarms(&store.acknowledgements(None)?);
        for hit in newest.hits {
            all.extend(store.alarms(hit.cycle)?);
        }
        all.sort_by_key(|alarm| {
            Reverse((alarm.is_active(), alarm.is_active().then_some(alarm.priority), alarm.raised_unix_ms))
        });
        Ok(all)
    }

    /// The active alarms, in the order in which they were raised. An alarm of a cycle ends when the next cycle
    /// begins, so only the newest cycle can have any.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn active_in_order(&self, store: &Store) -> Result<Vec<Alarm>, StoreError> {
        let mut all = self.active.alarms(&store.acknowledgements(None)?);
        if let Some(newest) = store.newest_cycle()? {
            all.extend(store.alarms(newest)?);
        }
        all.retain(Alarm::is_active);
        all.sort_by_key(|alarm| alarm.raised_unix_ms);
        Ok(all)
    }

    /// Checks the cell if it was not checked within the last minute; a camera may need some time.
    pub fn check_cell(&self, setup: &dyn SetupSource, cameras: Option<&SharedCameras>) {
        {
            let mut looked = self.last_check.lock().unwrap_or_else(PoisonError::into_inner);
            if looked.is_some_and(|at| at.elapsed() < MIN_CHECK_INTERVAL) {
                return;
            }
            *looked = Some(Instant::now());
        }
        let mut cell = setup.cycle_obstacles();
        let reason = |(of, problem): (&&str, &String)| Reason::new("plant_connection", format!("{of}: {problem}"));
        cell.extend(self.lock_connection_problems().iter().map(reason));
        let found = FoundProblems { cell, cameras: cameras.and_then(SharedCameras::check_cameras) };
        self.active.update_alarms(&found, now_unix_ms());
    }

    /// Records that a connection to the plant has this problem, or no problem any more. The problem becomes an alarm
    /// if it still exists when the cell is checked. Returns whether it differs from the last recorded one.
    pub fn set_connection_problem(&self, of: &'static str, problem: Option<&str>) -> bool {
        let mut troubles = self.lock_connection_problems();
        match problem {
            Some(problem) => troubles.insert(of, problem.to_owned()).is_none_or(|before| before != problem),
            None => troubles.remove(of).is_some(),
        }
    }

    fn lock_connection_problems(&self) -> MutexGuard<'_, BTreeMap<&'static str, String>> {
        self.connection_problems.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records that a person has seen an alarm, and adds this to the audit trail. Returns false if there is no such
    /// alarm, or it was already acknowledged.
    ///
    /// # Errors
    /// If the store cannot be read or written.
    pub fn acknowledge(&self, alarm: &AlarmId, who: String, line: AuditEntry) -> Result<bool, StoreError> {
        let AlarmId { cycle, code, raised_unix_ms } = alarm;
        let (cycle, raised_unix_ms) = (*cycle, *raised_unix_ms);
        let alarms = match cycle {
            None => self.people.read(|store| Ok(self.active.alarms(&store.acknowledgements(None)?)))?,
            Some(cycle) => match self.people.read(|store| store.alarms(cycle)) {
                Err(StoreError::UnknownCycle { .. }) => return Ok(false),
                read => read?,
            },
        };
        let is_meant = |alarm: &&Alarm| alarm.code == *code && alarm.raised_unix_ms == raised_unix_ms;
        let Some(alarm) = alarms.iter().find(is_meant).filter(|alarm| alarm.acknowledged.is_none()) else {
            return Ok(false);
        };
        let acknowledgement = Acknowledgement { unix_ms: 0, cycle, code: alarm.code.clone(), raised_unix_ms, who };
        self.people.write(|store| store.acknowledge(&acknowledgement))?;
        let of = cycle.map_or("between cycles".to_owned(), |cycle| format!("of cycle {cycle}"));
        let subject = format!("{code} {of}, raised {raised_unix_ms}");
        self.people.audit(&AuditEntry { subject: Some(subject), ..line });
        Ok(true)
    }
}
