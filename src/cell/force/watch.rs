//! Compares the readings with their expected values while the arm is on a contact path.
//!
//! Each deviation counts from the reading that first shows it, and is reported once it has lasted longer than the
//! limit of the cell's file; a tool that does not go back has a limit of its own, `RETRACT_TIMEOUT`. Deviations are: a
//! force out of its band around the set-point; no contact although the tool presses; a position outside of the
//! middle two thirds of the stroke; a tool that does not go back. Error bits and a lost link count at once. While
//! the set-point ramps, the band includes its values of the last moment, by which the tool may follow later.

use super::force_profile::ForcePhase;
use super::stroke::middle_mm;
use super::telegram::ToolReading;
use panelprep_base::number_text::fixed_decimals;
use panelprep_base::verdict::Reason;
use panelprep_kuka::eki::Time;
use std::time::Duration;

/// Largest extension of a retracted tool, as a fraction of its stroke.
const MAX_RETRACTED_SHARE: f64 = 1.0 / 6.0;
/// Time limit for a tool to retract: enough for the longest stroke of the slowest tool.
const RETRACT_TIMEOUT: Duration = Duration::from_millis(600);

/// The limits from the cell's file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchLimits {
    /// The tool's stroke, mm.
    pub stroke_mm: f64,
    /// Largest allowed difference between the force and its set-point, N.
    pub band_n: f64,
    /// How long the force may be outside this band, or the position outside its range.
    pub band_within: Duration,
    /// How long the tool may press without contact.
    pub contact_within: Duration,
}

/// The expected values for a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedForce {
    /// The tool's task.
    pub force_phase: ForcePhase,
    /// The range of contact forces that contains the set-point, lower value first, N.
    pub force_range_n: [f64; 2],
}

/// The deviations so far, and since when.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ForceWatch {
    force_phase: Option<(ForcePhase, Time)>,
    out_of_band_since: Option<Time>,
    out_of_stroke_since: Option<Time>,
    no_contact_since: Option<Time>,
}

impl ForceWatch {
    /// Evaluates a reading and its contact force, N, received at this time. Returns the reason if the path must
    /// end.
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
        // Without contact there is no force to judge. The upper limit applies in every contact phase, the lower limit
        // only while the tool presses.
        let out = (presses && reading.contact && contact_n < low_n)
            || (expected.force_phase != ForcePhase::HeldBack && reading.contact && contact_n > high_n);
        let [nearest_mm, farthest_mm] = middle_mm(limits.stroke_mm);
        let outside = presses && reading.contact && !(nearest_mm..=farthest_mm).contains(&reading.position_mm);
        let lasts = |began: &mut Option<Time>, is_so: bool, within: Duration| {
            // One good reading ends the span: peaks of a rough surface or of the landing are not a fault of the tool.
            let first = is_so.then(|| began.unwrap_or(now));
            *began = first;
            first.is_some_and(|first| now.since(first) >= within)
        };
        let no_contact = lasts(&mut self.no_contact_since, presses && !reading.contact, limits.contact_within);
        let out = lasts(&mut self.out_of_band_since, out, limits.band_within);
        let outside = lasts(&mut self.out_of_stroke_since, outside, limits.band_within);
        // Before the force: a pad in the air also has a wrong force, but the panel that is missing is the cause.
        if no_contact {
            let ms = limits.contact_within.as_millis();
            let words = format!(
                "the compliant tool has reported no contact for {ms} ms while it presses; check that the panel is \
                 where it was found, and that the tool moves freely over its stroke"
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
        // In the air, after enough time to retract, the tool must be back and touch nothing; its force is not checked.
        if is_held { not_ready_reason(reading, limits.stroke_mm) } else { None }
    }
}

/// Returns why a path may not begin with this reading of a tool that is held back; none if it may.
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
    let allowed_mm = MAX_RETRACTED_SHARE * stroke_mm;
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

#[cfg(test)]
mod tests;
