//! Combined faults, with effects that no single random fault has: two simultaneous faults, or a fault in a certain
//! state. They are drawn separately, so that the other script entries of a seed do not change.

use super::script::{Entry, Fault, Harm, Odds, Power, Press};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Fraction of the worlds that have such faults.
const COMBINED_FAULT_FRACTION: f64 = 0.65;

/// States of the state machine in which an epoch is open and a motion or another command is in progress.
const MOVES: [&str; 6] = ["refine", "wet", "verify", "abrade", "retract", "rinse"];
/// States of the state machine in which the arm is stationary, and a computation is running or time passes.
const COMPUTES: [&str; 6] = ["locate", "dry", "wet", "inspect", "plan", "rinse"];
/// States of the state machine in which nothing is queued at the controller.
const RESTS: [&str; 7] = ["stopped", "idle", "locate", "dry", "inspect", "held", "aborted"];

/// Draws the script entries of a seed.
pub fn draw(seed: u64, odds: Odds) -> Vec<Entry> {
    let mut draw = Pcg64::seed_from_u64(seed ^ 0x9a12);
    if !draw.random_bool(COMBINED_FAULT_FRACTION) {
        return vec![];
    }
    let draw = &mut draw;
    let mut drawn = match draw.random_range(0..if odds.disk { 18 } else { 14 }) {
        0 => ends_early(draw),
        1 => held_in_light(draw),
        2 => not_ready(draw),
        3 => stuck(draw),
        4 => started_while_held(draw),
        5 => short_stop(draw),
        6 => foreign_abort(draw),
        7 => nobody_there(draw),
        8 => unheeded(draw),
        9 => lost_command(draw),
        10 => long_silence(draw),
        11 => unseen_stop(draw),
        12 | 13 => far_epochs(draw, odds),
        14 | 15 => slow_permit(draw),
        16 => full_disk(draw),
        _ => new_controller_and_process(draw),
    };
    if odds.disk && draw.random_bool(0.06) {
        drawn.extend(full_disk(draw));
    }
    if draw.random_bool(0.05) {
        drawn.push(dead_in_contact(draw));
    }
    drawn
}

fn entry(place: &str, after_ms: u64, fault: Fault) -> Entry {
    Entry { place: place.to_owned(), visit: 1, after_ms, fault }
}

/// Draws an entry in one of these states, at most this number of ms after its beginning.
fn within(draw: &mut Pcg64, places: &[&str], most_ms: u64, fault: Fault) -> Entry {
    entry(places.choose(draw).copied().unwrap_or("wet"), draw.random_range(0..most_ms), fault)
}

fn controller(text: &str, ms: u64) -> Fault {
    Fault::Controller(format!("{text}/{ms}ms"))
}

fn lost() -> Fault {
    Fault::Bytes { to_robot: true, channel: 0, harm: Harm::Lose }
}

/// Draws an end of the epoch by the client, while the cell is reset or cleared.
fn ends_early(draw: &mut Pcg64) -> Vec<Entry> {
    let fault = [Fault::Controller("refuse=8".to_owned()), lost(), Fault::Foreign { operation: 11, number: 0 }];
    let fault = fault[draw.random_range(0..3)].clone();
    vec![within(draw, &["resetting", "resetting", "clearing"], 1_200, fault)]
}

/// Draws a hold while the light is on, after which the panel is dried immediately and located again.
fn held_in_light(draw: &mut Pcg64) -> Vec<Entry> {
    let hold = within(draw, &["dry", "wet", "inspect", "inspect"], 3_000, Fault::Press(Press::Hold));
    vec![hold, entry("held", draw.random_range(0..200), Fault::Press(Press::UnholdDried))]
}

/// Draws a robot that is not ready for longer than the program needs to detect this.
fn not_ready(draw: &mut Pcg64) -> Vec<Entry> {
    let text = ["mode=T1", "mode=T2", "guard", "drives", "e-stop"][draw.random_range(0..5)];
    let fault = controller(text, draw.random_range(1_500..4_000));
    vec![within(draw, &COMPUTES, 800, fault)]
}

/// Draws a random feedback that stays wrong for longer than the response timeout.
fn stuck(draw: &mut Pcg64) -> Vec<Entry> {
    let (input, on) = (draw.random_range(1..6), draw.random_bool(0.5));
    let fault = Fault::Feedback { input, on, for_ms: draw.random_range(7_000..12_000) };
    vec![within(draw, &["starting", "locate", "dry", "wet", "verify", "abrade", "rinse"], 1_500, fault)]
}

/// Draws a stop of the tool or the extraction while the pad is on its path, for a short time or permanently.
fn dead_in_contact(draw: &mut Pcg64) -> Entry {
    let for_ms = if draw.random_bool(0.2) { draw.random_range(100..400) } else { draw.random_range(2_000..12_000) };
    let fault = Fault::Feedback { input: draw.random_range(3..5), on: false, for_ms };
    within(draw, &["abrade"], 6_000, fault)
}

/// Draws a restart of the controller while the cell is held.
fn started_while_held(draw: &mut Pcg64) -> Vec<Entry> {
    let hold =
        within(draw, &["refine", "wet", "inspect", "plan", "verify", "abrade"], 1_500, Fault::Press(Press::Hold));
    vec![hold, entry("held", draw.random_range(0..150), controller("reboot", draw.random_range(300..3_000)))]
}

/// Draws a short stop of the arm by the safety controller while the client is stalled, so that the client is not
/// informed of the stop.
fn short_stop(draw: &mut Pcg64) -> Vec<Entry> {
    let text = ["e-stop", "guard", "drives"][draw.random_range(0..3)];
    let fault = controller(text, draw.random_range(60..250));
    let stop = within(draw, &MOVES, 2_500, fault);
    let stall = Entry { fault: Fault::Stall(draw.random_range(300..390)), ..stop.clone() };
    vec![stall, stop]
}

/// Draws an abort of another client, with numbers that may follow and numbers that may not. A client that receives the
/// answer to this abort aborts too, unless it is stalled.
fn foreign_abort(draw: &mut Pcg64) -> Vec<Entry> {
    let number = [i32::MIN, -1, 0, 1, 2_000_000, i32::MAX][draw.random_range(0..6)];
    let abort = within(draw, &MOVES, 2_500, Fault::Foreign { operation: 11, number });
    let stall = Entry { fault: Fault::Stall(draw.random_range(300..390)), ..abort.clone() };
    vec![stall, abort]
}

/// Draws an interruption of the work, after which no person comes for some time: outputs that may stay on are switched
/// off automatically.
fn nobody_there(draw: &mut Pcg64) -> Vec<Entry> {
    let press = [Press::Stop, Press::Abort, Press::Hold][draw.random_range(0..3)];
    let place =
        if press == Press::Stop { "stopping" } else { ["aborting", "held"][usize::from(press == Press::Hold)] };
    let left = within(draw, &["dry", "inspect", "abrade", "abrade", "retract"], 2_500, Fault::Press(press));
    vec![left, entry(place, 0, Fault::Away(draw.random_range(35_000..75_000)))]
}

/// Draws an abort that the controller answers without stopping.
fn unheeded(draw: &mut Pcg64) -> Vec<Entry> {
    let press = [Press::Stop, Press::Abort, Press::Abort, Press::Abort, Press::Hold][draw.random_range(0..5)];
    let places = ["abrade", "verify", "wet", "wet", "wet", "wet", "rinse"];
    let left = within(draw, &places, 3_000, Fault::Press(press));
    vec![Entry { fault: Fault::Unheeded(draw.random_range(1..3)), ..left.clone() }, left]
}

/// Draws a command that is lost in transit, while the following commands arrive.
fn lost_command(draw: &mut Pcg64) -> Vec<Entry> {
    vec![within(draw, &["refine", "verify", "abrade", "abrade", "abrade"], 3_500, lost())]
}

/// Draws a silence in one direction, longer than a connection may be silent.
fn long_silence(draw: &mut Pcg64) -> Vec<Entry> {
    let ms = draw.random_range(1_300..3_900);
    let mute = controller("mute", ms);
    let fault = [Fault::Deaf(ms + 2_500), Fault::Stall(ms + 2_500), mute.clone(), mute];
    let fault = fault[draw.random_range(0..4)].clone();
    vec![within(draw, &RESTS, 1_000, fault)]
}

/// Draws an end of the epoch by the controller while nothing is queued: either water runs and no message arrives, or
/// the arm is stopped for a short time.
fn unseen_stop(draw: &mut Pcg64) -> Vec<Entry> {
    let text = ["e-stop", "guard", "drives"][draw.random_range(0..3)];
    let fault = if draw.random_bool(0.5) {
        Fault::Deaf(draw.random_range(450..800))
    } else {
        controller(text, draw.random_range(13..90))
    };
    vec![within(draw, &["wet", "inspect", "rinse", "locate", "idle"], 2_500, fault)]
}

/// Draws a request of another client that raises the count of epochs to a high number, and then a restart of the
/// controller, which resets the count to zero. The process that knows the number may end in between.
fn far_epochs(draw: &mut Pcg64, odds: Odds) -> Vec<Entry> {
    let number = draw.random_range(10_000..=1_000_000);
    let foreign = Fault::Foreign { operation: draw.random_range(11..13), number };
    let far = within(draw, &["idle", "starting", "locate"], 500, foreign);
    let fault = controller("reboot", draw.random_range(300..1_500));
    let reboot = within(draw, &["refine", "dry", "wet", "aborted"], 1_500, fault);
    let kill = Fault::Power { writing: draw.random_range(0..4), power: Power::Kill };
    let kill = Some(Entry { fault: kill, ..reboot.clone() }).filter(|_| odds.disk && draw.random_bool(0.5));
    [far, reboot].into_iter().chain(kill).collect()
}

/// Draws a slow disk while waypoints in contact wait for their permission.
fn slow_permit(draw: &mut Pcg64) -> Vec<Entry> {
    let late_ms = [1_200, 2_500, 6_000][draw.random_range(0..3)];
    let fault = Fault::SlowDisk { late_ms, for_ms: draw.random_range(1_000..6_000) };
    vec![within(draw, &["abrade"], 4_000, fault)]
}

/// Draws a disk that is full when pictures are written, and when events are written.
fn full_disk(draw: &mut Pcg64) -> Vec<Entry> {
    let harm = super::script::DiskHarm::Full;
    let fault = Fault::Disk { writing: draw.random_range(0..40), harm, times: [1, 2, 10][draw.random_range(0..3)] };
    vec![within(draw, &["locate", "dry", "wet", "inspect", "inspect", "inspect", "plan"], 2_000, fault)]
}

/// Draws a restart of the controller and a restart of the process, so that one restarts while the other is down. The
/// controller has forgotten all epochs, and the process knows them only from its store.
fn new_controller_and_process(draw: &mut Pcg64) -> Vec<Entry> {
    let power =
        if draw.random_bool(0.5) { Power::Kill } else { Power::Cut { seed: draw.random_range(0..1 << 32) } };
    let fault = controller("reboot", draw.random_range(300..1_500));
    let reboot = within(draw, &MOVES, 2_000, fault);
    let power = Fault::Power { writing: draw.random_range(0..4), power };
    vec![reboot.clone(), Entry { fault: power, ..reboot }]
}
