//! The alarms of the cell, for every interface that shows them: alarms of the newest cycles, and alarms between cycles.
//!
//! An alarm between cycles reports a problem of the cell: a camera that delivers no picture, a disk that is nearly
//! full, a verification that soon expires. The checks run once a minute; the cameras are checked only while no cycle is
//! running. An alarm is active until its cause is no longer found. After a restart of the service the list is empty;
//! the store keeps who acknowledged which alarm.

use super::camera_lease::SharedCameras;
use super::people::AccountService;
use crate::setup::clock::now_unix_ms;
use panelprep_base::verdict::Reason;
use panelprep_cell::accounts::AuditEntry;
use panelprep_cell::record::CycleId;
use panelprep_store::history::{Acknowledgement, Alarm, Query};
use panelprep_store::store::{Store, StoreError};
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of newest cycles whose alarms are shown.
const MAX_ALARM_CYCLES: usize = 50;
/// Minimum interval between two checks of the cell, for all interfaces together.
const MIN_CHECK_INTERVAL: Duration = Duration::from_secs(60);

/// Identifies an alarm.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlarmId {
    /// The cycle of the alarm; `None` for an alarm between cycles.
    pub cycle: Option<CycleId>,
    /// Its code.
    pub code: String,
    /// The time at which the alarm was raised, ms since 1970.
    pub raised_unix_ms: i64,
}

/// The alarms of the cell. All interfaces share one instance.
#[derive(Debug)]
pub struct Alarms {
    people: Arc<AccountService>,
    active: StandingAlarms,
    last_check: Mutex<Option<Instant>>,
    /// The present problem of each connection to the plant, by the name of the connection.
    connection_problems: Mutex<BTreeMap<&'static str, String>>,
}

impl Alarms {
    /// Creates the alarms for the store that `people` opens.
    pub fn new(people: Arc<AccountService>) -> Self {
        Alarms {
            people,
            active: StandingAlarms::default(),
            last_check: Mutex::default(),
            connection_problems: Mutex::default(),
        }
    }

    /// Returns all alarms: active ones first, then by priority and time. The call blocks while it reads the disk.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn all(&self) -> Result<Vec<Alarm>, StoreError> {
        self.people.read(|store| self.all_from_store(store))
    }

    /// Like [`Alarms::all`], for a caller that has already opened this store.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn all_from_store(&self, store: &Store) -> Result<Vec<Alarm>, StoreError> {
        let newest = store.search(&Query { limit: MAX_ALARM_CYCLES, ..Query::default() })?;
        let mut all = self.active.alarms(&store.acknowledgements(None)?);
        for hit in newest.hits {
            all.extend(store.alarms(hit.cycle)?);
        }
        all.sort_by_key(|alarm| {
            Reverse((alarm.is_active(), alarm.is_active().then_some(alarm.priority), alarm.raised_unix_ms))
        });
        Ok(all)
    }

    /// Returns the active alarms in the order in which they were raised. The alarms of a cycle end when the next cycle
    /// begins, so only the newest cycle can have active alarms.
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

    /// Checks the cell if it was not checked within the last minute; the check of a camera may take some time.
    /// `obstacles` finds what prevents a cycle now or will soon prevent one, apart from the cameras.
    pub fn check_cell(&self, obstacles: impl FnOnce() -> Vec<Reason>, cameras: Option<&SharedCameras>) {
        {
            let mut looked = self.last_check.lock().unwrap_or_else(PoisonError::into_inner);
            if looked.is_some_and(|at| at.elapsed() < MIN_CHECK_INTERVAL) {
                return;
            }
            *looked = Some(Instant::now());
        }
        let mut cell = obstacles();
        let reason = |(of, problem): (&&str, &String)| Reason::new("plant_connection", format!("{of}: {problem}"));
        cell.extend(self.lock_connection_problems().iter().map(reason));
        let found = FoundProblems { cell, cameras: cameras.and_then(SharedCameras::check_cameras) };
        self.active.update_alarms(&found, now_unix_ms());
    }

    /// Records the present problem of a connection to the plant; `None` if the connection works. The problem becomes an
    /// alarm if it still exists at the next check of the cell. Returns whether the problem differs from the last
    /// recorded one.
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

    /// Records that a person has acknowledged an alarm, and adds this to the audit trail. Returns false if the alarm
    /// does not exist, or was already acknowledged.
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

/// Maximum number of cleared alarms in the list; the oldest ones are removed.
const MAX_CLEARED_ALARMS: usize = 100;
/// The reason code of a camera that delivers no picture.
const CAMERA_ALARM_CODE: &str = "camera";

/// All alarms between cycles.
#[derive(Debug, Default)]
struct StandingAlarms(Mutex<Vec<Alarm>>);

/// The problems found by one check of the cell. For the cameras, `None` means that they were not checked.
#[derive(Debug, Default)]
struct FoundProblems {
    pub cell: Vec<Reason>,
    pub cameras: Option<Vec<Reason>>,
}

impl StandingAlarms {
    /// Raises an alarm for each new problem, and clears the alarms whose cause is no longer found.
    pub fn update_alarms(&self, found: &FoundProblems, now_unix_ms: i64) {
        let mut alarms = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let reasons = || found.cell.iter().chain(found.cameras.iter().flatten());
        for alarm in alarms.iter_mut().filter(|alarm| alarm.is_active()) {
            let was_looked_at = alarm.code != CAMERA_ALARM_CODE || found.cameras.is_some();
            if was_looked_at && !reasons().any(|reason| is_same_problem(alarm, reason)) {
                alarm.gone_unix_ms = Some(now_unix_ms.max(alarm.raised_unix_ms));
            }
        }
        for reason in reasons() {
            if alarms.iter().any(|alarm| alarm.is_active() && is_same_problem(alarm, reason)) {
                continue;
            }
            // Alarms are identified by code and time, so two alarms must not have the same code and the same time.
            let after = alarms.iter().map(|alarm| alarm.raised_unix_ms + 1).max().unwrap_or(now_unix_ms);
            tracing::warn!("alarm {}: {}", reason.code, reason.message);
            alarms.push(Alarm::new_between_cycles(reason, now_unix_ms.max(after)));
        }
        while alarms.iter().filter(|alarm| !alarm.is_active()).count() > MAX_CLEARED_ALARMS {
            let Some(oldest) = alarms.iter().position(|alarm| !alarm.is_active()) else { return };
            alarms.remove(oldest);
        }
    }

    /// Returns all alarms between cycles, with the persons who acknowledged them.
    pub fn alarms(&self, seen: &[Acknowledgement]) -> Vec<Alarm> {
        let alarms = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let of = |alarm: &Alarm| {
            let is_meant =
                |one: &&Acknowledgement| one.code == alarm.code && one.raised_unix_ms == alarm.raised_unix_ms;
            seen.iter().find(is_meant).cloned()
        };
        alarms.into_iter().map(|alarm| Alarm { acknowledged: of(&alarm), ..alarm }).collect()
    }
}

/// Returns whether an alarm and a reason describe the same problem. The numbers in the text change with time, the words
/// do not.
fn is_same_problem(alarm: &Alarm, reason: &Reason) -> bool {
    let words = |text: &str| text.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect::<String>();
    alarm.code == reason.code && words(&alarm.message) == words(&reason.message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(cell: &[(&'static str, &str)], cameras: Option<&[&str]>) -> FoundProblems {
        let cell = cell.iter().map(|(code, message)| Reason::new(code, *message)).collect();
        let cameras =
            cameras.map(|all| all.iter().map(|message| Reason::new(CAMERA_ALARM_CODE, *message)).collect());
        FoundProblems { cell, cameras }
    }

    fn summary(standing: &StandingAlarms) -> Vec<(String, i64, Option<i64>)> {
        let alarms = standing.alarms(&[]).into_iter();
        alarms.map(|alarm| (alarm.code, alarm.raised_unix_ms, alarm.gone_unix_ms)).collect()
    }

    #[test]
    fn an_alarm_lasts_until_its_cause_is_gone() {
        let standing = StandingAlarms::default();
        let scarce = "disk_scarce";
        standing.update_alarms(&found(&[(scarce, "9999.5 MB are free")], Some(&[])), 10);
        standing.update_alarms(&found(&[(scarce, "8 MB are free")], None), 20);
        assert_eq!(summary(&standing), [(scarce.to_owned(), 10, None)], "another number is the same alarm");
        standing.update_alarms(&found(&[], None), 30);
        standing.update_alarms(&found(&[(scarce, "7 MB are free")], None), 40);
        assert_eq!(summary(&standing), [(scarce.to_owned(), 10, Some(30)), (scarce.to_owned(), 40, None)]);
    }

    #[test]
    fn alarms_of_an_unchecked_camera_are_unchanged() {
        let standing = StandingAlarms::default();
        standing.update_alarms(&found(&[], Some(&["the scanner: no answer", "the flange camera: no answer"])), 10);
        standing.update_alarms(&found(&[], None), 20);
        let times: Vec<i64> = standing.alarms(&[]).iter().map(|alarm| alarm.raised_unix_ms).collect();
        assert_eq!(times, [10, 11], "each is acknowledged by itself");
        assert!(standing.alarms(&[]).iter().all(Alarm::is_active), "a cycle runs: no person looked");
        standing.update_alarms(&found(&[], Some(&["the scanner: no answer"])), 30);
        let active: Vec<bool> = standing.alarms(&[]).iter().map(Alarm::is_active).collect();
        assert_eq!(active, [true, false]);
        let who = "Ada (ada)".to_owned();
        let seen = Acknowledgement {
            unix_ms: 50,
            cycle: None,
            code: CAMERA_ALARM_CODE.to_owned(),
            raised_unix_ms: 10,
            who,
        };
        let seen: Vec<bool> = standing.alarms(&[seen]).iter().map(|alarm| alarm.acknowledged.is_some()).collect();
        assert_eq!(seen, [true, false]);
    }

    #[test]
    fn the_number_of_cleared_alarms_is_limited() {
        let standing = StandingAlarms::default();
        for at in 0..500 {
            standing.update_alarms(&found(&[("disk_scarce", "little is free")], None), 2 * at);
            standing.update_alarms(&found(&[], None), 2 * at + 1);
        }
        standing.update_alarms(&found(&[("disk_scarce", "little is free")], None), 2_000);
        let alarms = standing.alarms(&[]);
        assert_eq!(
            (alarms.len(), alarms.iter().filter(|alarm| alarm.is_active()).count()),
            (MAX_CLEARED_ALARMS + 1, 1)
        );
        assert_eq!(alarms[0].raised_unix_ms, 800, "the oldest went");
    }
}
