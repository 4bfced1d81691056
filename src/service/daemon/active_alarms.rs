//! Alarms for problems of the cell between cycles: a camera that delivers nothing, a disk that is nearly full, a
//! verification that soon expires.
//!
//! The checks run once a minute; the cameras are checked only while the cell rests without a cycle. An alarm is active
//! until its cause is no longer found. The list is empty again after a restart of the service; the store retains who
//! acknowledged an alarm.

use panelprep_base::verdict::Reason;
use panelprep_store::history::{Acknowledgement, Alarm};
use std::sync::{Mutex, PoisonError};

/// Largest number of cleared alarms in the list: the newest ones stay.
const MAX_CLEARED_ALARMS: usize = 100;
/// The code of a camera that gives no picture.
const CAMERA: &str = "camera";

/// The alarms between cycles.
#[derive(Debug, Default)]
pub(super) struct StandingAlarms(Mutex<Vec<Alarm>>);

/// The problems found; `None` for the cameras if they were not checked.
#[derive(Debug, Default)]
pub(super) struct FoundProblems {
    pub cell: Vec<Reason>,
    pub cameras: Option<Vec<Reason>>,
}

impl StandingAlarms {
    /// Raises an alarm for each new problem, and clears the alarms whose cause is no longer found.
    pub fn update_alarms(&self, found: &FoundProblems, now_unix_ms: i64) {
        let mut alarms = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let reasons = || found.cell.iter().chain(found.cameras.iter().flatten());
        for alarm in alarms.iter_mut().filter(|alarm| alarm.is_active()) {
            let was_looked_at = alarm.code != CAMERA || found.cameras.is_some();
            if was_looked_at && !reasons().any(|reason| is_same_problem(alarm, reason)) {
                alarm.gone_unix_ms = Some(now_unix_ms.max(alarm.raised_unix_ms));
            }
        }
        for reason in reasons() {
            if alarms.iter().any(|alarm| alarm.is_active() && is_same_problem(alarm, reason)) {
                continue;
            }
            // An alarm is acknowledged by its code and time: two alarms must not have the same code and the same time.
            let after = alarms.iter().map(|alarm| alarm.raised_unix_ms + 1).max().unwrap_or(now_unix_ms);
            tracing::warn!("alarm {}: {}", reason.code, reason.message);
            alarms.push(Alarm::new_between_cycles(reason, now_unix_ms.max(after)));
        }
        while alarms.iter().filter(|alarm| !alarm.is_active()).count() > MAX_CLEARED_ALARMS {
            let Some(oldest) = alarms.iter().position(|alarm| !alarm.is_active()) else { return };
            alarms.remove(oldest);
        }
    }

    /// Returns all alarms, with the persons who acknowledged them.
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

/// Returns whether an alarm and a reason describe the same problem: the numbers in the text change with time, the
/// words do not.
fn is_same_problem(alarm: &Alarm, reason: &Reason) -> bool {
    let words = |text: &str| text.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect::<String>();
    alarm.code == reason.code && words(&alarm.message) == words(&reason.message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(cell: &[(&'static str, &str)], cameras: Option<&[&str]>) -> FoundProblems {
        let cell = cell.iter().map(|(code, message)| Reason::new(code, *message)).collect();
        let cameras = cameras.map(|all| all.iter().map(|message| Reason::new(CAMERA, *message)).collect());
        FoundProblems { cell, cameras }
    }

    fn summary(standing: &StandingAlarms) -> Vec<(String, i64, Option<i64>)> {
        let alarms = standing.alarms(&[]).into_iter();
        alarms.map(|alarm| (alarm.code, alarm.raised_unix_ms, alarm.gone_unix_ms)).collect()
    }

    #[test]
    fn an_alarm_lasts_until_what_gave_it_is_gone() {
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
    fn a_camera_that_was_not_looked_at_stays_as_it_was() {
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
        let seen = Acknowledgement { unix_ms: 50, cycle: None, code: CAMERA.to_owned(), raised_unix_ms: 10, who };
        let seen: Vec<bool> = standing.alarms(&[seen]).iter().map(|alarm| alarm.acknowledged.is_some()).collect();
        assert_eq!(seen, [true, false]);
    }

    #[test]
    fn the_list_does_not_grow_for_ever() {
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
