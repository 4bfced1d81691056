//! The armed deadlines. Arming a deadline replaces an armed one of the same kind.

use panelprep_cell::cycle::{Deadline, Id, Report};
use panelprep_kuka::eki::Time;
use panelprep_store::tape;
use std::time::Duration;

#[derive(Debug, Clone, Copy)]
struct ArmedDeadline {
    id: Id,
    deadline: Deadline,
    time: Time,
}

/// The armed deadlines.
#[derive(Debug, Default)]
pub(super) struct Deadlines {
    armed: Vec<ArmedDeadline>,
}

impl Deadlines {
    pub fn arm(&mut self, id: Id, which: Deadline, at: Time) {
        // One deadline of each kind: an older one belongs to an action that has ended.
        self.armed.retain(|armed| armed.deadline != which);
        self.armed.push(ArmedDeadline { id, deadline: which, time: at });
    }

    /// Disarms the deadline of an action that was answered.
    pub fn disarm(&mut self, id: Id) {
        self.armed.retain(|armed| !(armed.id == id && armed.deadline == Deadline::Answer));
    }

    /// The armed deadlines, for a recording.
    pub fn to_recording(&self) -> Vec<tape::ArmedDeadline> {
        let to_armed = |armed: &ArmedDeadline| {
            let at_ns = u64::try_from(armed.time.since_start().as_nanos()).unwrap_or(u64::MAX);
            tape::ArmedDeadline { id: armed.id, which: armed.deadline, at_ns }
        };
        self.armed.iter().map(to_armed).collect()
    }

    /// The deadlines from a recording.
    pub fn from_recording(recorded: &[tape::ArmedDeadline]) -> Self {
        let mut deadlines = Deadlines::default();
        for armed in recorded {
            deadlines.arm(armed.id, armed.which, Time::from_start(Duration::from_nanos(armed.at_ns)));
        }
        deadlines
    }

    /// Returns the earliest deadline that is over, and disarms it.
    pub fn take_expired(&mut self, now: Time) -> Option<Report> {
        let first = self
            .armed
            .iter()
            .enumerate()
            .filter(|(_, armed)| armed.time <= now)
            .min_by_key(|(_, armed)| armed.time);
        let ArmedDeadline { id, deadline: which, .. } = self.armed.remove(first?.0);
        Some(Report::Deadline { id, which })
    }
}

/// Returns this number of seconds as a duration; zero if it is not a valid time.
pub(super) fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_earliest_comes_first_and_a_new_one_replaces_the_old() {
        let mut deadlines = Deadlines::default();
        deadlines.arm(Id(1), Deadline::Spray, Time::from_ms(300));
        deadlines.arm(Id(2), Deadline::Answer, Time::from_ms(200));
        deadlines.arm(Id(3), Deadline::Spray, Time::from_ms(250));
        deadlines.arm(Id(4), Deadline::Token, Time::from_ms(400));
        deadlines.disarm(Id(4));
        assert_eq!(deadlines.take_expired(Time::from_ms(199)), None);
        let over = |deadlines: &mut Deadlines| deadlines.take_expired(Time::from_ms(400));
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(over(&mut deadlines), report(2, Deadline::Answer));
        assert_eq!(over(&mut deadlines), report(3, Deadline::Spray));
        assert_eq!(over(&mut deadlines), report(4, Deadline::Token), "an answer disarms its own deadline alone");
        assert_eq!(over(&mut deadlines), None);
    }

    /// A recording contains the armed deadlines, and a replay arms them again.
    #[test]
    fn what_was_reported_is_armed_again() {
        let mut deadlines = Deadlines::default();
        deadlines.arm(Id(1), Deadline::Drain, Time::from_ms(300));
        deadlines.arm(Id(2), Deadline::Settle, Time::from_ms(200));
        let mut again = Deadlines::from_recording(&deadlines.to_recording());
        assert_eq!(again.take_expired(Time::from_ms(199)), None);
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(again.take_expired(Time::from_ms(300)), report(2, Deadline::Settle));
        assert_eq!(again.take_expired(Time::from_ms(300)), report(1, Deadline::Drain));
    }
}
