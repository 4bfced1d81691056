//! Faults that make positions, counts and decisions differ from the data of the program: another override, a pose with
//! a measurement error, an arm that a person jogs, a restored store, and a second screen that shows an outdated step.
//! They are drawn separately, so that the other script entries of a seed do not change.

use super::script::{Entry, Fault, Odds, PLACES, Press};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Fraction of worlds with one of these faults, and below it the fraction with a restore among those with a disk:
/// packing and verifying a store takes as long as a few cycles.
const FAULT_FRACTION: f64 = 0.5;
const RESTORE_FRACTION: f64 = 0.08;

/// States of the state machine in which the arm is stationary, or soon will be.
const AT_REST: [&str; 12] = [
    "held", "held", "stopped", "aborted", "aborted", "holding", "stopping", "aborting", "wet", "inspect", "idle",
    "complete",
];
/// States of the state machine in which a person decides.
const DECIDED: [&str; 6] = ["held", "held", "aborted", "unholding", "clearing", "stopped"];

/// Draws the script entries of a seed.
pub fn draw(seed: u64, odds: Odds) -> Vec<Entry> {
    let draw = &mut Pcg64::seed_from_u64(seed ^ 0x0e15e);
    let mut drawn = Vec::new();
    if draw.random_bool(FAULT_FRACTION) {
        drawn.extend(match draw.random_range(0..8) {
            0..3 => vec![overridden(draw)],
            3 => vec![measured(draw)],
            4 => vec![jog(draw, &AT_REST)],
            5 => jogged_after_contact(draw),
            6 => stale(draw),
            _ => vec![overridden(draw), jog(draw, &["held", "aborted", "stopped"])],
        });
    }
    if odds.disk && draw.random_bool(RESTORE_FRACTION) {
        drawn.extend(restored(draw));
    }
    drawn
}

fn entry(draw: &mut Pcg64, (places, most_ms): (&[&str], u64), fault: Fault) -> Entry {
    let place = places.choose(draw).copied().unwrap_or("abrade").to_owned();
    let visit = if draw.random_bool(0.8) { 1 } else { 2 };
    Entry { place, visit, after_ms: draw.random_range(0..most_ms), fault }
}

fn lasts_ms(draw: &mut Pcg64) -> u64 {
    if draw.random_bool(0.25) { draw.random_range(20..400) } else { draw.random_range(400..4_000) }
}

/// Draws an entry whose fault usually occurs while the tip is on the panel, some seconds after the phase begins;
/// otherwise in one of these states.
fn in_contact_or(draw: &mut Pcg64, places: &[&str], fault: Fault) -> Entry {
    if draw.random_bool(0.3) {
        return entry(draw, (places, 3_000), fault);
    }
    Entry { place: "abrade".to_owned(), visit: 1, after_ms: draw.random_range(0..7_000), fault }
}

/// Draws another override, before contact or from some moment of the contact on.
fn overridden(draw: &mut Pcg64) -> Entry {
    let percent = [1, 10, 50, 75, 90, 99][draw.random_range(0..6)];
    let fault = Fault::Controller(format!("override={percent}/{}ms", lasts_ms(draw)));
    in_contact_or(draw, &["plan", "verify", "retract", "wet", "refine", "held"], fault)
}

/// Draws a deviation of the measured pose from the arm's true pose, below or above the limit at which the path is ended
/// immediately.
fn measured(draw: &mut Pcg64) -> Entry {
    let off_mm = [3, 20, 60, 120][draw.random_range(0..4)];
    let fault = Fault::Controller(format!("measured={off_mm}/{}ms", lasts_ms(draw)));
    in_contact_or(draw, &["refine", "plan", "verify", "retract", "held"], fault)
}

/// Draws a jog to a position between the vicinity of the panel and the park pose.
fn jog(draw: &mut Pcg64, places: &[&str]) -> Entry {
    let percent = match draw.random_range(0..4) {
        0 | 1 => 0,
        2 => draw.random_range(1..100),
        _ => 100,
    };
    let height_mm = [1, 2, 4, 15, 40][draw.random_range(0..5)];
    let fault = Fault::Jog { percent, height_mm, for_ms: draw.random_range(1_000..4_000) };
    entry(draw, (places, 2_000), fault)
}

/// Draws an interruption of the work during or after contact, followed by a jog of the arm.
fn jogged_after_contact(draw: &mut Pcg64) -> Vec<Entry> {
    let left = [
        Fault::Press(Press::Hold),
        Fault::Press(Press::Stop),
        Fault::Press(Press::Abort),
        Fault::Controller(format!("e-stop/{}ms", draw.random_range(300..2_000))),
        Fault::Controller(format!("reboot/{}ms", draw.random_range(300..2_000))),
    ];
    let left = left[draw.random_range(0..left.len())].clone();
    let left = entry(draw, (&["abrade", "abrade", "retract", "rinse"], 4_000), left);
    vec![left, jog(draw, &["held", "stopped", "aborted", "holding", "aborting"])]
}

/// Draws a decision on a screen that was not updated, based on an earlier step or on the present step.
fn stale(draw: &mut Pcg64) -> Vec<Entry> {
    let hold = entry(draw, (&["wet", "inspect", "plan", "abrade"], 3_000), Fault::Press(Press::Hold));
    let count = draw.random_range(1..4);
    let decides = (0..count).map(|_| {
        let press = [Press::Accept, Press::Unhold, Press::UnholdDried, Press::Clear][draw.random_range(0..4)];
        let back = [0, 1, 2, 5, 30][draw.random_range(0..5)];
        entry(draw, (&DECIDED, 600), Fault::Stale { press, back })
    });
    let decides: Vec<Entry> = decides.collect();
    [hold].into_iter().chain(decides).collect()
}

/// Draws a backup at some moment, and a restore at a later moment.
fn restored(draw: &mut Pcg64) -> Vec<Entry> {
    let before = ["stopped", "idle", "locate", "wet", "plan", "abrade", "rinse", "complete"];
    let behind = ["abrade", "abrade", "retract", "rinse", "held", "aborted", "complete", "stopped", "inspect"];
    let backup = entry(draw, (&before, 2_000), Fault::Backup);
    let places: &[&str] = if draw.random_bool(0.8) { &behind } else { &PLACES };
    vec![backup, entry(draw, (places, 3_000), Fault::Restore)]
}
