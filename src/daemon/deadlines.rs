//! The armed deadlines. Arming a deadline replaces an armed one of the same kind.

use crate::cycle::{Deadline, Id, Report};
use crate::eki::Time;
use crate::tape;
use std::time::Duration;

#[derive(Debug, Clone, Copy)]
struct Armed {
    id: Id,
    which: Deadline,
    at: Time,
}

/// What is armed.
#[derive(Debug, Default)]
pub(super) struct Deadlines {
    armed: Vec<Armed>,
}

impl Deadlines {
    pub fn arm(&mut self, id: Id, which: Deadline, at: Time) {
        // One deadline of each kind: an older one belongs to an act that has ended.
        self.armed.retain(|armed| armed.which != which);
        self.armed.push(Armed { id, which, at });
    }

    /// The answer came.
    pub fn disarm(&mut self, id: Id) {
        self.armed.retain(|armed| !(armed.id == id && armed.which == Deadline::Answer));
    }

    /// The armed deadlines, for a recording.
    pub fn to_recording(&self) -> Vec<tape::Armed> {
        let told = |armed: &Armed| {
            let at_ns = u64::try_from(armed.at.since_start().as_nanos()).unwrap_or(u64::MAX);
            tape::Armed { id: armed.id, which: armed.which, at_ns }
        };
        self.armed.iter().map(told).collect()
    }

    /// The deadlines from a recording.
    pub fn from_recording(told: &[tape::Armed]) -> Self {
        let mut deadlines = Deadlines::default();
        for armed in told {
            deadlines.arm(armed.id, armed.which, Time::after_start(Duration::from_nanos(armed.at_ns)));
        }
        deadlines
    }

    /// Returns the earliest deadline that is over, and disarms it.
    pub fn over(&mut self, now: Time) -> Option<Report> {
        let first =
            self.armed.iter().enumerate().filter(|(_, armed)| armed.at <= now).min_by_key(|(_, armed)| armed.at);
        let Armed { id, which, .. } = self.armed.remove(first?.0);
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
        deadlines.arm(Id(1), Deadline::Spray, Time::at_ms(300));
        deadlines.arm(Id(2), Deadline::Answer, Time::at_ms(200));
        deadlines.arm(Id(3), Deadline::Spray, Time::at_ms(250));
        deadlines.arm(Id(4), Deadline::Token, Time::at_ms(400));
        deadlines.disarm(Id(4));
        assert_eq!(deadlines.over(Time::at_ms(199)), None);
        let over = |deadlines: &mut Deadlines| deadlines.over(Time::at_ms(400));
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(over(&mut deadlines), report(2, Deadline::Answer));
        assert_eq!(over(&mut deadlines), report(3, Deadline::Spray));
        assert_eq!(over(&mut deadlines), report(4, Deadline::Token), "an answer disarms its own deadline alone");
        assert_eq!(over(&mut deadlines), None);
    }

    /// A recording contains the armed deadlines, and a replay arms them again.
    #[test]
    fn what_was_told_is_armed_again() {
        let mut deadlines = Deadlines::default();
        deadlines.arm(Id(1), Deadline::Drain, Time::at_ms(300));
        deadlines.arm(Id(2), Deadline::Settle, Time::at_ms(200));
        let mut again = Deadlines::from_recording(&deadlines.to_recording());
        assert_eq!(again.over(Time::at_ms(199)), None);
        let report = |id, which| Some(Report::Deadline { id: Id(id), which });
        assert_eq!(again.over(Time::at_ms(300)), report(2, Deadline::Settle));
        assert_eq!(again.over(Time::at_ms(300)), report(1, Deadline::Drain));
    }
}
