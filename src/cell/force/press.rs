//! How the tool presses along a path: the set-point with its ramp, the force on each part of a path, and the check
//! before a contact motion that the tool's stroke is sufficient for all errors of the path.
//!
//! The tool centre point is calibrated at half the stroke s. On the panel, the tool is extended by
//!
//! ```text
//! s/2 − press_in ± e,     e = e_tool + e_surface + e_chord                                        (1)
//! ```
//!
//! with e_tool the error at the tool, 95 %, e_surface the distance of the fitted surface from the scan, 95 %, and
//! e_chord the largest distance of a straight line between two waypoints from the surface. The whole range (1) must lie
//! within the middle two thirds of the stroke. The errors are added linearly, not as a root sum of squares, because a
//! systematic error does not average out along a path.
//!
//! Waypoints are those of the plan; the first one is in the air. The robot reports how many of the others it has
//! reached; it is then on the leg from the last reached waypoint to the next one. On legs in the air and over a hole,
//! the tool is held back. On the legs down and up, with one end on the panel, it presses with the landing force. It
//! also presses with the landing force on the last leg on the panel, so that the force is already reduced when the disc
//! lifts off. On all other legs, it presses with the recipe's force.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};
use panelprep_kuka::eki::Time;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A set-point: actuator forces that are already compensated for gravity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceSetPoint {
    /// Actuator force in contact, N; a negative force holds the tool back.
    pub force_n: f64,
    /// Actuator force without contact, N.
    pub no_contact_n: f64,
    /// Duration of the ramp from the previous set-point, s.
    pub ramp_s: f64,
}

impl ForceSetPoint {
    /// Returns a set-point that immediately holds the tool back with this actuator force, N.
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
    /// Returns a ramp that has already reached this set-point.
    pub fn constant(press: ForceSetPoint) -> Self {
        SetPointRamp { from_n: press.force_n, to: press, since: Time::default() }
    }

    /// Starts a ramp to this set-point at the time `now`.
    pub fn start_towards(&mut self, press: ForceSetPoint, now: Time) {
        // The ramp starts from the present force, even within another ramp, because a jump of the force would mark the
        // panel.
        *self = SetPointRamp { from_n: self.force_n(now), to: press, since: now };
    }

    /// Returns the set-point at the end of the ramp.
    pub fn target(&self) -> ForceSetPoint {
        self.to
    }

    /// Returns the actuator force at this time, N.
    pub fn force_n(&self, now: Time) -> f64 {
        let SetPointRamp { from_n, to, since } = self;
        let passed_s = now.since(*since).as_secs_f64();
        let share = if to.ramp_s > 0.0 { (passed_s / to.ramp_s).min(1.0) } else { 1.0 };
        from_n + (to.force_n - from_n) * share
    }

    /// Returns the smallest and the largest force within the last `delay`, N, because the tool follows its set-point
    /// with a delay.
    pub fn force_range_n(&self, now: Time, delay: Duration) -> [f64; 2] {
        let before = Time::from_start(now.since_start().saturating_sub(delay));
        // The ramp is linear, so both extremes are at the ends of the interval. Before the ramp, the force is constant.
        let (before_n, now_n) = (self.force_n(before), self.force_n(now));
        let before_n = if before < self.since { self.from_n } else { before_n };
        [before_n.min(now_n), before_n.max(now_n)]
    }
}

/// Fraction of the stroke, around its middle, that may be used in contact.
pub const CONTACT_STROKE_FRACTION: f64 = 2.0 / 3.0;

/// The name of the check that the stroke is sufficient.
pub const TOOL_STROKE: &str = "compliant tool, from the middle of its stroke at most";

/// Returns the range of the stroke that may be used in contact, mm from fully back.
pub fn middle_mm(stroke_mm: f64) -> [f64; 2] {
    let half = CONTACT_STROKE_FRACTION / 2.0;
    [(0.5 - half) * stroke_mm, (0.5 + half) * stroke_mm]
}

/// Checks that the errors along the path fit into the stroke, (1), all in mm. A missing error fails the check.
pub fn check_stroke(stroke_mm: f64, press_in_mm: f64, errors_mm: [Option<f64>; 3]) -> Check {
    let allowed_mm = CONTACT_STROKE_FRACTION / 2.0 * stroke_mm;
    // Errors are added linearly: the errors of tool, surface and lines may have the same direction along a whole path.
    let sum_mm = errors_mm.into_iter().try_fold(press_in_mm.abs(), |sum_mm, error_mm| Some(sum_mm + error_mm?));
    let check = Check::new(TOOL_STROKE, "mm", sum_mm).with_max(allowed_mm, LimitSource::cell("tool.stroke_mm"));
    let is_within = sum_mm.is_some() && check.is_met();
    check.with_consequence_if(!is_within, Severity::Reject, "tool_stroke", || match sum_mm {
        Some(sum_mm) => {
            let [found, allowed] = distinguishable_texts(sum_mm, allowed_mm, 2);
            format!(
                "the compliant tool may be {found} mm from the middle of its stroke, by the errors of tool, \
                 surface and lines, and the press-in (limit {allowed} mm for a stroke of {} mm); use a smaller \
                 press_in_mm or chord_error_mm, or calibrate the tool more accurately",
                fixed_decimals(stroke_mm, 1)
            )
        }
        None => "a compliant tool requires the error at the tool: state [limits] tool_error_mm in the cell's file"
            .to_owned(),
    })
}

/// How the tool presses on a leg of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ForcePhase {
    /// The tool is held back.
    HeldBack,
    /// The tool lands on the panel or leaves it, with the landing force.
    Landing,
    /// The tool presses with the recipe's force.
    Pressing,
}

/// Returns how the tool presses on the leg that begins at the waypoint `reached`. `contact` is whether each waypoint is
/// on the panel.
pub fn force_phase(contact: &[bool], reached: usize) -> ForcePhase {
    let on = |index: usize| contact.get(index).copied().unwrap_or(false);
    match (on(reached), on(reached + 1)) {
        (false, false) => ForcePhase::HeldBack,
        (true, true) if on(reached + 2) => ForcePhase::Pressing,
        _ => ForcePhase::Landing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};
    use proptest::prelude::*;

    /// Expected values, calculated by hand: a ramp from 5 to 20 N in 0.3 s has 10 N after 0.1 s. A new set-point of 0 N
    /// without a ramp applies immediately.
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

    /// Expected values, calculated by hand: a stroke of 30 mm permits 10 mm on both sides of its middle, so 5 to 25 mm.
    /// The errors 8 + 1 + 0.5 + 0.4 are 9.9 mm; with 0.6 instead of 0.4 they are 10.1 mm.
    #[test]
    fn errors_and_press_in_must_stay_in_the_middle() {
        assert_eq!(middle_mm(30.0).map(|mm| (mm * 1e9).round() / 1e9), [5.0, 25.0]);
        let verdict = |errors| Judgement::from_checks([&check_stroke(30.0, 8.0, errors)]).verdict;
        assert_eq!(verdict([Some(1.0), Some(0.5), Some(0.4)]), Verdict::Accept);
        assert_eq!(verdict([Some(1.0), Some(0.5), Some(0.6)]), Verdict::Reject);
        let unknown = check_stroke(30.0, 0.0, [None, Some(0.1), Some(0.1)]);
        assert!(unknown.reason().is_some_and(|reason| reason.message.contains("tool_error_mm")));
    }

    /// Expected values, calculated by hand, for eight waypoints: in air, low, four on the panel, low, in air. The tool
    /// is held back down to the low waypoint, lands on the way down, and presses on two legs. It has the landing force
    /// on the last leg on the panel and on the way up, and is then held back again.
    #[test]
    fn forces_follow_the_path() {
        let contact = [false, false, true, true, true, true, false, false];
        use ForcePhase::{HeldBack as H, Landing as L, Pressing as P};
        let aims: Vec<ForcePhase> = (0..9).map(|reached| force_phase(&contact, reached)).collect();
        assert_eq!(aims, [H, L, P, P, L, L, H, H, H]);
        assert_eq!(force_phase(&[], 0), H, "nothing is known of the plan");
    }

    proptest! {
        /// The recipe's force is never used if either end of the leg, or the end of the next leg, is off the panel.
        #[test]
        fn nothing_presses_beside_the_panel(contact in prop::collection::vec(any::<bool>(), 0..20), at in 0_usize..25) {
            let on = |index: usize| contact.get(index) == Some(&true);
            let presses = force_phase(&contact, at) == ForcePhase::Pressing;
            prop_assert_eq!(presses, on(at) && on(at + 1) && on(at + 2));
            prop_assert_eq!(force_phase(&contact, at) == ForcePhase::HeldBack, !on(at) && !on(at + 1));
        }
    }
}
