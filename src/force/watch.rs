//! Compares the readings with their expected values while the arm is on a contact path.
//!
//! Each deviation counts from the reading that first shows it, and is reported once it has lasted longer than the
//! limit of the cell's file; a tool that does not go back has a limit of its own, `RETRACT_TIMEOUT`. Deviations are: a
//! force out of its band around the set-point; no contact although the tool presses; a position outside of the
//! middle two thirds of the stroke; a tool that does not go back. Error bits and a lost link count at once. While
//! the set-point ramps, the band includes its values of the last moment, by which the tool may follow later.

use super::force_profile::ForcePhase;
use super::stroke::middle_mm;
use super::telegram::Reading;
use crate::eki::Time;
use crate::number_text::fixed;
use crate::verdict::Reason;
use std::time::Duration;

/// Largest extension of a retracted tool, as a fraction of its stroke.
const BACK_SHARE: f64 = 1.0 / 6.0;
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
pub struct Expected {
    /// The tool's task.
    pub aim: ForcePhase,
    /// The range of contact forces that contains the set-point, lower value first, N.
    pub between_n: [f64; 2],
}

/// The deviations so far, and since when.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Watch {
    aim: Option<(ForcePhase, Time)>,
    out_of_band: Option<Time>,
    out_of_stroke: Option<Time>,
    without_contact: Option<Time>,
}

impl Watch {
    /// Evaluates a reading and its contact force, N, received at this time. Returns the reason if the path must
    /// end.
    pub fn see(
        &mut self,
        (reading, contact_n): (&Reading, f64),
        expected: Expected,
        limits: &WatchLimits,
        now: Time,
    ) -> Option<Reason> {
        if !reading.errors.is_none() {
            return Some(of_errors(reading));
        }
        let since = match self.aim {
            Some((aim, since)) if aim == expected.aim => since,
            _ => self.aim.insert((expected.aim, now)).1,
        };
        let presses = expected.aim == ForcePhase::Pressing;
        let [low_n, high_n] = [expected.between_n[0] - limits.band_n, expected.between_n[1] + limits.band_n];
        // Without contact there is no force to judge. The upper limit applies in every contact phase, the lower limit
        // only while the tool presses.
        let out = (presses && reading.contact && contact_n < low_n)
            || (expected.aim != ForcePhase::HeldBack && reading.contact && contact_n > high_n);
        let [nearest_mm, farthest_mm] = middle_mm(limits.stroke_mm);
        let outside = presses && reading.contact && !(nearest_mm..=farthest_mm).contains(&reading.position_mm);
        let lasts = |began: &mut Option<Time>, is_so: bool, within: Duration| {
            // One good reading ends the span: peaks of a rough surface or of the landing are no fault of the tool.
            let first = is_so.then(|| began.unwrap_or(now));
            *began = first;
            first.is_some_and(|first| now.since(first) >= within)
        };
        let no_contact = lasts(&mut self.without_contact, presses && !reading.contact, limits.contact_within);
        let out = lasts(&mut self.out_of_band, out, limits.band_within);
        let outside = lasts(&mut self.out_of_stroke, outside, limits.band_within);
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
            return Some(of_force(contact_n, expected, limits));
        }
        if outside {
            let words = format!(
                "the compliant tool is extended by {} mm, but the limits in contact are {} to {} mm of its stroke \
                 of {} mm; check whether the panel was moved, and touch a known target: `panelprep calibrate \
                 touch`",
                fixed(reading.position_mm, 1),
                fixed(nearest_mm, 1),
                fixed(farthest_mm, 1),
                fixed(limits.stroke_mm, 1)
            );
            return Some(Reason::new("tool_stroke", words));
        }
        let is_held = expected.aim == ForcePhase::HeldBack && now.since(since) >= RETRACT_TIMEOUT;
        // In the air, after enough time to retract, the tool must be back and touch nothing; its force is not checked.
        if is_held { unready(reading, limits.stroke_mm) } else { None }
    }
}

/// Returns why a path may not begin with this reading of a tool that is held back; none if it may.
pub fn unready(reading: &Reading, stroke_mm: f64) -> Option<Reason> {
    if !reading.errors.is_none() {
        return Some(of_errors(reading));
    }
    if reading.contact {
        let words = "the compliant tool reports contact in the air; check what the tool touches, and its own \
                     settings";
        return Some(Reason::new("contact_in_air", words));
    }
    not_back(reading, stroke_mm)
}

fn of_errors(reading: &Reading) -> Reason {
    let words = format!(
        "the compliant tool reports: {}; check its controller, its compressed air and its cable",
        reading.errors.words()
    );
    Reason::new("tool_errors", words)
}

fn of_force(contact_n: f64, expected: Expected, limits: &WatchLimits) -> Reason {
    let [low_n, high_n] = [expected.between_n[0] - limits.band_n, expected.between_n[1] + limits.band_n];
    let words = format!(
        "the compliant tool pressed with {} N for {} ms (limits {} to {} N); check its air pressure and that it \
         moves freely, and measure its zero: `panelprep calibrate force`",
        fixed(contact_n, 1),
        limits.band_within.as_millis(),
        fixed(low_n, 1),
        fixed(high_n, 1)
    );
    Reason::new("force_band", words)
}

fn not_back(reading: &Reading, stroke_mm: f64) -> Option<Reason> {
    let allowed_mm = BACK_SHARE * stroke_mm;
    let words = || {
        format!(
            "the compliant tool is commanded to retract, but is still extended by {} mm (limit {} mm); check that \
             it moves freely and has compressed air",
            fixed(reading.position_mm, 1),
            fixed(allowed_mm, 1)
        )
    };
    (reading.position_mm > allowed_mm).then(|| Reason::new("tool_stuck", words()))
}

#[cfg(test)]
mod tests;
