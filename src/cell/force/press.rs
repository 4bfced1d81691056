//! The tool's set-point, and the ramp from one set-point to the next.

use panelprep_kuka::eki::Time;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A set-point: forces of the actuator, already without gravity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSetPoint {
    /// The actuator's force in contact, N; negative holds the tool back.
    pub force_n: f64,
    /// Its force without contact, N.
    pub no_contact_n: f64,
    /// Duration of the ramp from the previous set-point to this one, s.
    pub ramp_s: f64,
}

impl ForceSetPoint {
    /// Returns a set-point that holds the tool back at once with this force of the actuator, N.
    pub fn retracted(force_n: f64) -> Self {
        ForceSetPoint { force_n, no_contact_n: force_n, ramp_s: 0.0 }
    }
}

/// A linear ramp to a set-point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetPointRamp {
    from_n: f64,
    to: ForceSetPoint,
    since: Time,
}

impl SetPointRamp {
    /// Returns a ramp that is already at this set-point.
    pub fn constant(press: ForceSetPoint) -> Self {
        SetPointRamp { from_n: press.force_n, to: press, since: Time::default() }
    }

    /// Starts a ramp to this set-point now.
    pub fn start_towards(&mut self, press: ForceSetPoint, now: Time) {
        // From the present force, also in the middle of another ramp: a jump of the force marks the panel.
        *self = SetPointRamp { from_n: self.force_n(now), to: press, since: now };
    }

    /// Returns the set-point at the end of the ramp.
    pub fn target(&self) -> ForceSetPoint {
        self.to
    }

    /// Returns the actuator's force at this time, N.
    pub fn force_n(&self, now: Time) -> f64 {
        let SetPointRamp { from_n, to, since } = self;
        let passed_s = now.since(*since).as_secs_f64();
        let share = if to.ramp_s > 0.0 { (passed_s / to.ramp_s).min(1.0) } else { 1.0 };
        from_n + (to.force_n - from_n) * share
    }

    /// Returns the range of the force during the last `delay` before now, lower value first, N: a tool follows with
    /// some delay.
    pub fn force_range_n(&self, now: Time, delay: Duration) -> [f64; 2] {
        let before = Time::from_start(now.since_start().saturating_sub(delay));
        // The ramp is a straight line. Before its start the force is its starting value.
        let (before_n, now_n) = (self.force_n(before), self.force_n(now));
        let before_n = if before < self.since { self.from_n } else { before_n };
        [before_n.min(now_n), before_n.max(now_n)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: from 5 to 20 N in 0.3 s is 10 N after 0.1 s; a new set-point of 0 N then applies at
    /// once.
    #[test]
    fn a_ramp_is_a_straight_line_from_where_it_is() {
        let at = |ms| Time::from_ms(ms);
        let mut ramp = SetPointRamp::constant(ForceSetPoint { force_n: 5.0, no_contact_n: 5.0, ramp_s: 0.0 });
        assert_eq!(ramp.force_n(at(10)), 5.0);
        ramp.start_towards(ForceSetPoint { force_n: 20.0, no_contact_n: 5.0, ramp_s: 0.3 }, at(1_000));
        assert!((ramp.force_n(at(1_100)) - 10.0).abs() < 1e-9);
        assert_eq!(ramp.force_n(at(1_300)), 20.0);
        let delay = Duration::from_millis(100);
        assert_eq!(ramp.force_range_n(at(1_050), delay).map(f64::round), [5.0, 8.0]);
        assert_eq!(ramp.force_range_n(at(1_200), delay).map(f64::round), [10.0, 15.0]);
        assert_eq!(ramp.force_range_n(at(1_400), delay), [20.0, 20.0]);
        ramp.start_towards(ForceSetPoint::retracted(-30.0), at(1_100));
        assert_eq!(ramp.force_n(at(1_100)), -30.0);
        assert_eq!(ramp.force_range_n(at(1_150), delay).map(f64::round), [-30.0, 10.0]);
    }
}
