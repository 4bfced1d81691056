//! The restart budget of the worker process: a maximum number of restarts within a period. When the budget is used up,
//! the worker is not restarted until a person requests it. Any clock can be used.
//!
//! If a worker ends repeatedly, restarting it does not remove the cause, and each start exposes and heats the camera.
//! The first start is not counted.

use std::collections::VecDeque;
use std::time::Duration;

/// The maximum number of restarts, and the period in which they are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restarts {
    /// Restarts, at most.
    pub max_restarts: usize,
    /// The length of the period; it is a sliding window.
    pub within: Duration,
}

impl Default for Restarts {
    /// `faults.md`, C11.
    fn default() -> Self {
        Restarts { max_restarts: 3, within: Duration::from_secs(600) }
    }
}

/// The remaining restarts.
#[derive(Debug, Clone)]
pub struct RestartBudget {
    allowed: Restarts,
    /// The times of the counted restarts, oldest first.
    used_at: VecDeque<Duration>,
    is_spent: bool,
}

/// The decision whether a worker process that has ended is restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RestartDecision {
    /// The worker is restarted.
    Restart {
        /// The number of this restart within the period, from 1.
        number: usize,
    },
    /// The worker is not restarted.
    StayDown,
}

impl RestartBudget {
    /// Creates a budget of which nothing is used.
    pub fn new(allowed: Restarts) -> Self {
        RestartBudget { allowed, used_at: VecDeque::new(), is_spent: false }
    }

    /// Records that the worker has ended at `now` (the time since any fixed instant), and returns whether it is
    /// restarted.
    pub fn on_worker_ended(&mut self, now: Duration) -> RestartDecision {
        self.forget(now);
        if self.is_spent || self.used_at.len() >= self.allowed.max_restarts {
            self.is_spent = true;
            return RestartDecision::StayDown;
        }
        self.used_at.push_back(now);
        RestartDecision::Restart { number: self.used_at.len() }
    }

    /// Returns whether a worker that is down may be started at the request of a person. The start is counted as a
    /// restart, so it is refused until the oldest counted restart is outside of the period.
    pub fn on_person_request(&mut self, now: Duration) -> RestartDecision {
        self.forget(now);
        self.is_spent = false;
        self.on_worker_ended(now)
    }

    /// Returns the time after which a person's request for a restart is accepted; zero if it is accepted now.
    pub fn wait(&self, now: Duration) -> Duration {
        let oldest = (self.used_at.len() >= self.allowed.max_restarts).then(|| self.used_at.front()).flatten();
        oldest.map_or(Duration::ZERO, |oldest| (*oldest + self.allowed.within).saturating_sub(now))
    }

    /// Returns the limit of restarts.
    pub fn allowed_restarts(&self) -> Restarts {
        self.allowed
    }

    fn forget(&mut self, now: Duration) {
        let is_over = |used: &Duration| now.saturating_sub(*used) >= self.allowed.within;
        while self.used_at.front().is_some_and(is_over) {
            self.used_at.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::RestartDecision::{Restart, StayDown};
    use super::*;
    use proptest::prelude::*;

    fn at(minutes: u64) -> Duration {
        Duration::from_secs(60 * minutes)
    }

    /// Expected decisions, derived by hand: the worker is restarted after it ends at minutes 0, 3 and 6. It is not
    /// restarted when it ends at minute 9, nor at minute 30 without a request. Then a person's request restarts it,
    /// because all three counted restarts are more than 10 minutes ago.
    #[test]
    fn after_the_fourth_end_in_ten_minutes_the_worker_stays_down() {
        let mut budget = RestartBudget::new(Restarts::default());
        let ends = [0, 3, 6].map(|minute| budget.on_worker_ended(at(minute)));
        assert_eq!(ends, [1, 2, 3].map(|number| Restart { number }));
        assert_eq!((budget.on_worker_ended(at(9)), budget.wait(at(9))), (StayDown, at(1)));
        assert_eq!(budget.on_person_request(at(9)), StayDown, "asking does not make more of it");
        assert_eq!(budget.on_worker_ended(at(30)), StayDown, "time alone does not start it");
        assert_eq!(
            (budget.wait(at(30)), budget.on_person_request(at(30))),
            (Duration::ZERO, Restart { number: 1 })
        );
    }

    /// Expected decisions, derived by hand: of the ends at 0, 4, 8 and 12 minutes, never four are within ten minutes,
    /// so the worker is always restarted.
    #[test]
    fn old_restarts_are_not_counted() {
        let mut budget = RestartBudget::new(Restarts::default());
        let numbers = [0, 4, 8, 12, 16].map(|minute| budget.on_worker_ended(at(minute)));
        assert_eq!(numbers, [1, 2, 3, 3, 3].map(|number| Restart { number }));
    }

    proptest! {
        /// For any times at which workers end and persons request a start, no period of ten minutes has more than three
        /// starts.
        #[test]
        fn no_period_has_more_restarts_than_allowed(
            steps in proptest::collection::vec((0_u64..400, any::<bool>()), 1..60),
        ) {
            let mut budget = RestartBudget::new(Restarts::default());
            let (mut now, mut starts) = (Duration::ZERO, Vec::new());
            for (seconds, person) in steps {
                now += Duration::from_secs(seconds);
                let verdict = if person { budget.on_person_request(now) } else { budget.on_worker_ended(now) };
                if verdict != StayDown {
                    starts.push(now);
                }
                for first in &starts {
                    let within = starts.iter().filter(|start| *start >= first && **start < *first + at(10));
                    prop_assert!(within.count() <= 3, "{starts:?}");
                }
            }
        }
    }
}
