//! Compares the tool's measured values with their expected values while the arm is on a contact path. Also computes the
//! effect of the weight of the parts on the tool.
//!
//! A deviation begins with the first measured value that shows it, and is reported after it has lasted longer than the
//! limit in the cell's file; for a tool that does not retract the limit is `RETRACT_TIMEOUT`. The deviations are: a
//! force outside of its band around the set-point; no contact while the tool presses; a position outside of the middle
//! two thirds of the stroke; a tool that does not retract. Error bits and a lost link are reported immediately. During
//! a ramp of the set-point, the band also contains the set-points of the last moments, because the tool may follow with
//! a delay.
//!
//! The effect of the weight depends on the orientation of the tool:
//!
//! ```text
//! F_contact = F_actuator + m g (a · d)                                                       (1)
//! F_actuator = F_contact − m g (a · d)                                                       (2)
//! F_actuator = F_reading − zero                                                              (3)
//! ```
//!
//! `a` is the direction in which the tool presses, its +Z axis, and `d` the direction of gravity, −Z of the robot's
//! base, both with length 1; therefore the base must be level. If the tool points down (`a · d` = 1), the weight adds
//! to the force; if it points up, the weight reduces the force. The payload that is sent to the tool is 0 kg, so that
//! the weight is not compensated twice.

use super::press::{ForcePhase, middle_mm};
use super::telegram::ToolReading;
use crate::cell::CompliantTool;
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Rigid, STANDARD_GRAVITY_M_S2, Tool, Vector};
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Reason;
use panelprep_kuka::eki::Time;
use std::time::Duration;

/// Maximum extension of a retracted tool, as a fraction of its stroke.
const MAX_RETRACTED_STROKE_FRACTION: f64 = 1.0 / 6.0;
/// Maximum time until the tool is retracted: sufficient for the longest stroke of the slowest tool.
const RETRACT_TIMEOUT: Duration = Duration::from_millis(600);

/// The limits from the cell's file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchLimits {
    /// The tool's stroke, mm.
    pub stroke_mm: f64,
    /// Maximum difference between the force and its set-point, N.
    pub band_n: f64,
    /// Maximum time for which the force may be outside of this band, or the position outside of its range.
    pub band_within: Duration,
    /// Maximum time for which the tool may press without contact.
    pub contact_within: Duration,
}

/// The expected values at one moment of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedForce {
    /// How the tool presses at this moment.
    pub force_phase: ForcePhase,
    /// Smallest and largest set-point of the contact force within the tool's delay, N.
    pub force_range_n: [f64; 2],
}

/// The start time of each deviation that is in progress.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ForceWatch {
    force_phase: Option<(ForcePhase, Time)>,
    out_of_band_since: Option<Time>,
    out_of_stroke_since: Option<Time>,
    no_contact_since: Option<Time>,
}

impl ForceWatch {
    /// Evaluates measured values and their contact force, N, which were received at the time `now`. Returns the reason
    /// if the path must be interrupted.
    pub fn evaluate(
        &mut self,
        (reading, contact_n): (&ToolReading, f64),
        expected: ExpectedForce,
        limits: &WatchLimits,
        now: Time,
    ) -> Option<Reason> {
        if !reading.errors.is_empty() {
            return Some(error_reason(reading));
        }
        let since = match self.force_phase {
            Some((aim, since)) if aim == expected.force_phase => since,
            _ => self.force_phase.insert((expected.force_phase, now)).1,
        };
        let presses = expected.force_phase == ForcePhase::Pressing;
        let [low_n, high_n] =
            [expected.force_range_n[0] - limits.band_n, expected.force_range_n[1] + limits.band_n];
        // Without contact there is no force to compare. The upper limit applies in every contact phase, the lower limit
        // only while the tool presses.
        let out = (presses && reading.contact && contact_n < low_n)
            || (expected.force_phase != ForcePhase::HeldBack && reading.contact && contact_n > high_n);
        let [nearest_mm, farthest_mm] = middle_mm(limits.stroke_mm);
        let outside = presses && reading.contact && !(nearest_mm..=farthest_mm).contains(&reading.position_mm);
        let lasts = |began: &mut Option<Time>, is_so: bool, within: Duration| {
            // One value within the limits ends a deviation: short peaks on a rough surface or at the landing are not a
            // fault of the tool.
            let first = is_so.then(|| began.unwrap_or(now));
            *began = first;
            first.is_some_and(|first| now.since(first) >= within)
        };
        let no_contact = lasts(&mut self.no_contact_since, presses && !reading.contact, limits.contact_within);
        let out = lasts(&mut self.out_of_band_since, out, limits.band_within);
        let outside = lasts(&mut self.out_of_stroke_since, outside, limits.band_within);
        // Contact is checked before the force: without contact the force is wrong as well, but the missing panel is the
        // cause.
        if no_contact {
            let ms = limits.contact_within.as_millis();
            let words = format!(
                "the compliant tool has reported no contact for {ms} ms while it presses; check that the panel has not moved since it was located, and that the tool moves freely over its stroke"
            );
            return Some(Reason::new("no_contact", words));
        }
        if out {
            return Some(force_reason(contact_n, expected, limits));
        }
        if outside {
            let words = format!(
                "the compliant tool is extended by {} mm, but the limits in contact are {} to {} mm of its stroke \
                 of {} mm; check whether the panel was moved, and touch a known target: `panelprep calibrate \
                 touch`",
                fixed_decimals(reading.position_mm, 1),
                fixed_decimals(nearest_mm, 1),
                fixed_decimals(farthest_mm, 1),
                fixed_decimals(limits.stroke_mm, 1)
            );
            return Some(Reason::new("tool_stroke", words));
        }
        let is_held = expected.force_phase == ForcePhase::HeldBack && now.since(since) >= RETRACT_TIMEOUT;
        // In the air, after the time limit for the retract, the tool must be retracted without contact; its force is
        // not compared.
        if is_held { not_ready_reason(reading, limits.stroke_mm) } else { None }
    }
}

/// Returns the reason why a path must not begin with these values of a tool that is held back; `None` if it may begin.
pub fn not_ready_reason(reading: &ToolReading, stroke_mm: f64) -> Option<Reason> {
    if !reading.errors.is_empty() {
        return Some(error_reason(reading));
    }
    if reading.contact {
        let words = "the compliant tool reports contact in the air; check what the tool touches, and its own \
                     settings";
        return Some(Reason::new("contact_in_air", words));
    }
    not_retracted_reason(reading, stroke_mm)
}

fn error_reason(reading: &ToolReading) -> Reason {
    let words = format!(
        "the compliant tool reports: {}; check its controller, its compressed air and its cable",
        reading.errors.describe()
    );
    Reason::new("tool_errors", words)
}

fn force_reason(contact_n: f64, expected: ExpectedForce, limits: &WatchLimits) -> Reason {
    let [low_n, high_n] = [expected.force_range_n[0] - limits.band_n, expected.force_range_n[1] + limits.band_n];
    let words = format!(
        "the compliant tool pressed with {} N for {} ms (limits {} to {} N); check its air pressure and that it \
         moves freely, and measure its zero: `panelprep calibrate force`",
        fixed_decimals(contact_n, 1),
        limits.band_within.as_millis(),
        fixed_decimals(low_n, 1),
        fixed_decimals(high_n, 1)
    );
    Reason::new("force_band", words)
}

fn not_retracted_reason(reading: &ToolReading, stroke_mm: f64) -> Option<Reason> {
    let allowed_mm = MAX_RETRACTED_STROKE_FRACTION * stroke_mm;
    let words = || {
        format!(
            "the compliant tool is commanded to retract, but is still extended by {} mm (limit {} mm); check that \
             it moves freely and has compressed air",
            fixed_decimals(reading.position_mm, 1),
            fixed_decimals(allowed_mm, 1)
        )
    };
    (reading.position_mm > allowed_mm).then(|| Reason::new("tool_stuck", words()))
}

/// The mass on the actuator and the zero of the force sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorLoad {
    /// Mass on the actuator: the sander with its disc, kg.
    pub payload_kg: f64,
    /// The force that the sensor measures without an actuator force, N.
    pub zero_n: f64,
}

impl SensorLoad {
    /// Returns the part of the contact force that is caused by the weight, N. `downwards` is the cosine of the angle
    /// between the tool's +Z axis and gravity, −1…1.
    pub fn weight_force_n(&self, downwards: f64) -> f64 {
        self.payload_kg * STANDARD_GRAVITY_M_S2 * downwards
    }

    /// Returns the contact force for a force measured by the sensor, N: equations (1) and (3).
    pub fn contact_n(&self, reading_n: f64, downwards: f64) -> f64 {
        reading_n - self.zero_n + self.weight_force_n(downwards)
    }

    /// Returns the actuator force for a contact force, N: equation (2).
    pub fn actuator_n(&self, contact_n: f64, downwards: f64) -> f64 {
        contact_n - self.weight_force_n(downwards)
    }
}

impl From<&CompliantTool> for SensorLoad {
    fn from(tool: &CompliantTool) -> Self {
        SensorLoad { payload_kg: tool.payload_kg, zero_n: tool.zero_n }
    }
}

/// Returns the cosine of the angle between the tool's +Z axis and gravity.
pub fn down_cosine(base_from_tool: &Rigid<Base, Tool>) -> f64 {
    -(*base_from_tool * Vector::<Tool>::new(Vector3::z())).mm.z
}

#[cfg(test)]
mod tests {
    use super::super::telegram::ErrorBits;
    use super::*;
    use panelprep_base::geometry::KukaPose;

    fn turned(b_deg: f64) -> f64 {
        down_cosine(&KukaPose { b_deg, ..KukaPose::default() }.to_rigid())
    }

    /// Expected values, calculated by hand: 2 kg weigh 19.6133 N. For a contact force of 20 N, the actuator needs
    /// 0.3867 N if the tool points down, 39.6133 N if it points up, 20 N if it is horizontal, and 10.19335 N at 60°
    /// from down, where half of the weight acts.
    #[test]
    fn the_weight_acts_as_a_function_of_the_orientation() {
        let weight = SensorLoad { payload_kg: 2.0, zero_n: 0.0 };
        for (b_deg, actuator_n) in [(180.0, 0.3867), (0.0, 39.6133), (90.0, 20.0), (120.0, 10.193_35)] {
            let found = weight.actuator_n(20.0, turned(b_deg));
            assert!((found - actuator_n).abs() < 1e-9, "{b_deg}: {found}");
        }
    }

    /// Expected values, calculated by hand: a measured force of 21.5 N with a zero of 1.5 N is a contact force of 20 N
    /// for a horizontal tool, and of 39.6133 N for a tool that points down.
    #[test]
    fn a_reading_is_a_contact_force() {
        let weight = SensorLoad { payload_kg: 2.0, zero_n: 1.5 };
        assert!((weight.contact_n(21.5, turned(90.0)) - 20.0).abs() < 1e-9);
        assert!((weight.contact_n(21.5, turned(180.0)) - 39.6133).abs() < 1e-9);
    }

    // Limits for the tests below.
    const LIMITS: WatchLimits = WatchLimits {
        stroke_mm: 30.0,
        band_n: 5.0,
        band_within: Duration::from_millis(150),
        contact_within: Duration::from_millis(200),
    };

    const PRESSED: ToolReading =
        ToolReading { force_n: 20.0, position_mm: 15.0, contact: true, errors: ErrorBits(0) };

    fn pressing(low_n: f64, high_n: f64) -> ExpectedForce {
        ExpectedForce { force_phase: ForcePhase::Pressing, force_range_n: [low_n, high_n] }
    }

    /// Evaluates one measured value every 50 ms, and returns the time and the text of the first reason.
    fn first_reason(readings: impl Fn(u64) -> (ToolReading, f64, ExpectedForce)) -> Option<(u64, String)> {
        let mut watch = ForceWatch::default();
        (0..=2_000).step_by(50).find_map(|ms| {
            let (reading, contact_n, expected) = readings(ms);
            let reason = watch.evaluate((&reading, contact_n), expected, &LIMITS, Time::from_ms(ms))?;
            Some((ms, reason.code.to_string()))
        })
    }

    fn at(ms: u64, code: &str) -> Option<(u64, String)> {
        Some((ms, code.to_owned()))
    }

    /// Expected values, calculated by hand: a band of 5 N around 20 N contains 15 and 25 N. A force of 25.1 N from 500
    /// ms on is reported at 650 ms.
    #[test]
    fn a_force_out_of_its_band_is_reported_once_it_lasts() {
        let force = |contact_n: f64| {
            first_reason(|ms| (PRESSED, if ms < 500 { 20.0 } else { contact_n }, pressing(20.0, 20.0)))
        };
        assert_eq!((force(25.0), force(15.0)), (None, None));
        assert_eq!((force(25.1), force(14.9)), (at(650, "force_band"), at(650, "force_band")));
        // Short peaks are not reported, even if they are repeated.
        assert_eq!(
            first_reason(|ms| (PRESSED, if ms % 200 < 150 { 30.0 } else { 20.0 }, pressing(20.0, 20.0))),
            None
        );
        // During the ramp from 5 N to 20 N, all forces between the two are expected.
        assert_eq!(first_reason(|_| (PRESSED, 2.0, pressing(5.0, 20.0))), None);
    }

    #[test]
    fn contact_stroke_and_errors_are_reported() {
        let lost = ToolReading { contact: false, ..PRESSED };
        let from_500 =
            |reading: ToolReading| move |ms| (if ms < 500 { PRESSED } else { reading }, 20.0, pressing(20.0, 20.0));
        assert_eq!(first_reason(from_500(lost)), at(700, "no_contact"));
        assert_eq!(
            first_reason(|_| (lost, 0.0, pressing(20.0, 20.0))),
            at(200, "no_contact"),
            "a path that never touched"
        );
        // Expected limits, calculated by hand: the middle two thirds of 30 mm are 5 to 25 mm.
        for (position_mm, found) in
            [(5.01, None), (24.99, None), (4.9, at(650, "tool_stroke")), (25.1, at(650, "tool_stroke"))]
        {
            assert_eq!(first_reason(from_500(ToolReading { position_mm, ..PRESSED })), found, "{position_mm}");
        }
        assert_eq!(first_reason(from_500(ToolReading { errors: ErrorBits(1), ..PRESSED })), at(500, "tool_errors"));
    }

    /// During the landing, a force below the set-point or no contact is accepted, but a force above the limit is
    /// reported.
    #[test]
    fn landing_may_have_no_contact_yet_and_never_too_much() {
        let landing = ExpectedForce { force_phase: ForcePhase::Landing, force_range_n: [5.0, 5.0] };
        let air = ToolReading { contact: false, ..PRESSED };
        assert_eq!(first_reason(|_| (air, 0.0, landing)), None);
        assert_eq!(first_reason(|_| (PRESSED, 10.1, landing)), at(150, "force_band"));
        // Expected limit, calculated by hand: a sixth of 30 mm is 5 mm. The tool must reach it within 600 ms.
        let held = ExpectedForce { force_phase: ForcePhase::HeldBack, force_range_n: [-30.0, -30.0] };
        let out = ToolReading { position_mm: 5.1, ..air };
        assert_eq!(first_reason(|_| (out, 0.0, held)), at(600, "tool_stuck"));
        assert_eq!(
            first_reason(|ms| (if ms < 500 { out } else { ToolReading { position_mm: 5.0, ..air } }, 0.0, held)),
            None
        );
    }

    #[test]
    fn a_path_begins_with_a_retracted_tool() {
        let back = ToolReading { force_n: -30.0, position_mm: 0.2, contact: false, errors: ErrorBits(0) };
        assert_eq!(not_ready_reason(&back, 30.0), None);
        let code = |reading: ToolReading| not_ready_reason(&reading, 30.0).map(|reason| reason.code.to_string());
        assert_eq!(code(ToolReading { contact: true, ..back }).as_deref(), Some("contact_in_air"));
        assert_eq!(code(ToolReading { position_mm: 6.0, ..back }).as_deref(), Some("tool_stuck"));
        assert_eq!(code(ToolReading { errors: ErrorBits(128), ..back }).as_deref(), Some("tool_errors"));
    }

    /// If the tool reports contact after the time limit for the retract, it touches an object other than the panel.
    /// This is reported at any force.
    #[test]
    fn contact_in_the_air_is_reported() {
        let held = ExpectedForce { force_phase: ForcePhase::HeldBack, force_range_n: [-30.0, -30.0] };
        let touches = ToolReading { position_mm: 5.0, contact: true, ..PRESSED };
        assert_eq!(first_reason(|_| (touches, 200.0, held)), at(600, "contact_in_air"));
    }
}
