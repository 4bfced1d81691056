//! The checks of a scenario: requirements on the arm and its outputs. They use the controller's own reports, and not
//! the messages that the service received.
//!
//! 1. An ended epoch moves nothing: while the controller reports that it has stopped, the arm is at rest, except for
//!    braking and the retraction.
//! 2. A stop that a person requests stops the controller within [`STOP_MS`], by the request, by closing the connection,
//!    or by the watchdog.
//! 3. Tool and water are off after the end of an epoch, and while the client is silent; outputs that may stay on are
//!    off after their time limit. A stop in contact is followed by a retraction, and the tool never stays on the panel
//!    without motion.
//! 4. A cycle passes only if the controller has executed every waypoint in contact that the service sent.

use super::lie::{Kind, MessageFault};
use super::person::{Cycle, Order};
use super::truth::{Contacts, EXTRACTION, Event, LIGHT, Side, State, TOOL, WATER, contacts, states};
use std::collections::BTreeMap;

/// Time from full speed to standstill, ms, as in `tests/link/oracles.rs`.
const BRAKE_MS: f64 = 260.0;
/// Time of a retraction of 50 mm, ms, as in `tests/link/oracles.rs`.
const RETRACT_MS: f64 = 800.0;
/// Timeout of the controller's and of the client's watchdog, ms.
const WATCHDOG_MS: f64 = 400.0;
/// Maximum time from the socket to the wire, ms.
const WIRE_MS: f64 = 100.0;
/// Additional time, ms, because a dozen processes share two cores.
const MACHINE_DELAY_MS: f64 = 400.0;
/// Time limit for a stop, ms. The client detects a lost abort after its watchdog's timeout. Then the client closes the
/// connection, or the controller's watchdog detects that messages are missing.
pub const STOP_MS: f64 = WIRE_MS + WATCHDOG_MS + WATCHDOG_MS + MACHINE_DELAY_MS;
/// Maximum time from one state to the next, ms; states are sent every 100 ms.
const MAX_STATE_INTERVAL_MS: f64 = 112.0;
/// Maximum time in contact without motion, ms.
const DWELL_MS: f64 = 200.0;
const MAX_STILL_DEG: f64 = 0.01;
/// Minimum rotation of an axis that is treated as a retraction, degrees; a retraction of 50 mm rotates at least one
/// axis by several degrees.
const MIN_RETRACT_DEG: f64 = 1.0;
/// Time after which the extraction must be off, ms: `[io.off_after_s]` of a rendered cell.
const EXTRACTION_MS: f64 = 30_000.0;
const LIGHT_MS: f64 = 60_000.0;

/// The results of the checks of a scenario.
#[derive(Debug, Default)]
pub struct Judged {
    pub violations: Vec<String>,
    pub worst_stop_ms: Option<f64>,
    /// Number of commands in contact that were changed in transmission and executed, in a cycle that passed. The
    /// protocol cannot detect such a change.
    pub unnoticed: usize,
}

impl Judged {
    fn wrong(&mut self, at_ms: f64, what: &str) {
        let count = self.violations.iter().filter(|text| text.contains(what)).count();
        if count == 0 {
            self.violations.push(format!("{what}, at {:.3} s", at_ms / 1_000.0));
        }
    }
}

/// Returns the times at which the controller's log reports the stop of an epoch, ms of the controller's clock.
pub fn logged_stops(log: &str) -> Vec<f64> {
    let of = |line: &str| {
        let (seconds, rest) = line.trim().split_once(" s ")?;
        rest.contains("stopped:").then(|| seconds.parse::<f64>().ok()).flatten().map(|seconds| seconds * 1_000.0)
    };
    log.lines().filter_map(of).collect()
}

pub fn judge(
    (events, stops_ms): (&[Event], &[f64]),
    lie: &MessageFault,
    orders: &[Order],
    cycles: &BTreeMap<i64, Cycle>,
) -> Judged {
    let (states, contacts) = (states(events), contacts(events));
    let mut judged = Judged::default();
    ended_epochs(&mut judged, &states, &contacts);
    presses(&mut judged, &states, stops_ms, lie, orders);
    silence(&mut judged, &states, events);
    on_the_panel(&mut judged, &states, &contacts);
    passes(&mut judged, &states, &contacts, cycles);
    judged
}

/// Checks motion and outputs after the end of each epoch.
fn ended_epochs(judged: &mut Judged, states: &[State], contacts: &Contacts) {
    let mut since_ms = None;
    let mut ends_ms = 0.0;
    for [before, state] in states.array_windows() {
        if !state.stopped() {
            since_ms = None;
            // The arm may still move to a contact point that the controller has already received.
            let is_near = contacts.contains_key(&(state.epoch, state.done))
                || contacts.range((state.epoch, state.done)..=(state.epoch, i64::MAX)).next().is_some();
            ends_ms = BRAKE_MS + MAX_STATE_INTERVAL_MS + if is_near { RETRACT_MS } else { 0.0 };
            continue;
        }
        let lasts_ms = state.time_ms - *since_ms.get_or_insert(state.time_ms);
        let moves = state.moving() || before.apart_deg(state) > MAX_STILL_DEG;
        if lasts_ms > ends_ms && moves {
            judged.wrong(state.at_ms, "the arm moves after the end of its epoch");
        }
        let late = |after_ms: f64| lasts_ms > after_ms + MAX_STATE_INTERVAL_MS;
        for (output, after_ms, name) in [
            (TOOL, 0.0, "tool"),
            (WATER, 0.0, "water"),
            (EXTRACTION, EXTRACTION_MS, "extraction"),
            (LIGHT, LIGHT_MS, "light"),
        ] {
            if state.is_on(output) && late(after_ms) {
                judged.wrong(state.at_ms, &format!("the {name} is on after the end of its epoch"));
            }
        }
    }
}

/// Returns whether a state is safe: the arm may brake or retract, but no new motion begins.
fn is_safe(state: &State) -> bool {
    state.stopped() || !(state.moving() || state.is_on(TOOL) || state.is_on(WATER))
}

fn presses(judged: &mut Judged, states: &[State], stops_ms: &[f64], lie: &MessageFault, orders: &[Order]) {
    let late_ms = if matches!(lie.kind, Kind::Delay | Kind::Jitter) { lie.amount_ms as f64 } else { 0.0 };
    for (place, press) in orders.iter().enumerate().filter(|(_, order)| matches!(&*order.word, "stop" | "abort")) {
        let end_ms = orders[place + 1..]
            .iter()
            .find(|order| order.done && order.word != "clear")
            .map_or(f64::MAX, |order| order.at_ms);
        let after: Vec<&State> =
            states.iter().filter(|state| state.at_ms > press.at_ms && state.at_ms < end_ms).collect();
        let Some(last) = after.iter().rposition(|state| !is_safe(state)) else { continue };
        let stood_ms = after.get(last + 1).map(|state| state.at_ms);
        // If the connection was lost first, the time of the stop is in the controller's log; the last state gives the
        // offset between the two clocks.
        let offset_ms = after[last].at_ms - after[last].time_ms;
        let logged_ms =
            stops_ms.iter().map(|at| at + offset_ms).find(|at| *at >= press.at_ms - MAX_STATE_INTERVAL_MS);
        let stopped_ms = [stood_ms, logged_ms].into_iter().flatten().fold(f64::MAX, f64::min);
        let latency_ms = (stopped_ms - press.at_ms).max(0.0);
        if stopped_ms == f64::MAX {
            judged.wrong(press.at_ms, &format!("{} has stopped nothing", press.word));
            continue;
        }
        if latency_ms > STOP_MS + late_ms {
            judged.wrong(press.at_ms, &format!("{} has stopped after {latency_ms:.0} ms", press.word));
        }
        judged.worst_stop_ms = Some(judged.worst_stop_ms.unwrap_or(0.0).max(latency_ms));
    }
}

/// Checks that the controller does not wait longer than its watchdog's timeout for a message of the client while tool
/// or water is on.
fn silence(judged: &mut Judged, states: &[State], events: &[Event]) {
    let given: Vec<f64> =
        events.iter().filter(|event| event.side == Side::Given).map(|event| event.at_ms).collect();
    for state in states.iter().filter(|state| !state.stopped() && (state.is_on(TOOL) || state.is_on(WATER))) {
        let heard = given.partition_point(|at_ms| *at_ms <= state.at_ms);
        let silent_ms = given[..heard].last().map_or(0.0, |at_ms| state.at_ms - at_ms);
        if silent_ms > WATCHDOG_MS + MAX_STATE_INTERVAL_MS + MACHINE_DELAY_MS {
            judged.wrong(state.at_ms, "tool or water is on although the client is silent");
        }
    }
}

fn on_the_panel(judged: &mut Judged, states: &[State], contacts: &Contacts) {
    let is_contact = |epoch: i64, id: i64| contacts.get(&(epoch, id)).is_some_and(|[_, given]| given.is_some());
    let mut stood: Option<&State> = None;
    for (place, [before, state]) in states.array_windows().enumerate() {
        let touches = !state.stopped() && is_contact(state.epoch, state.done);
        if !touches || before.apart_deg(state) > MAX_STILL_DEG {
            stood = touches.then_some(state);
        } else if let Some(first) = stood
            && state.time_ms - first.time_ms > DWELL_MS + MAX_STATE_INTERVAL_MS + MACHINE_DELAY_MS
        {
            judged.wrong(state.at_ms, "the tool stays on the panel without motion");
        }
        let was_on = is_contact(before.epoch, before.done) && is_contact(before.epoch, before.done + 1);
        if before.stopped()
            || !state.stopped()
            || !was_on
            || state.time_ms - before.time_ms > 3.0 * MAX_STATE_INTERVAL_MS
        {
            continue;
        }
        let behind = states[place + 1..].iter().take_while(|later| later.stopped());
        let behind: Vec<&State> = behind.collect();
        let seen_ms = behind.last().map_or(0.0, |last| last.time_ms - state.time_ms);
        let farthest = behind.iter().map(|later| later.apart_deg(before)).fold(0.0, f64::max);
        if seen_ms > BRAKE_MS + RETRACT_MS + MAX_STATE_INTERVAL_MS && farthest < MIN_RETRACT_DEG {
            judged.wrong(state.at_ms, "a stop in contact is not followed by a retract");
        }
    }
}

fn passes(judged: &mut Judged, states: &[State], contacts: &Contacts, cycles: &BTreeMap<i64, Cycle>) {
    let passed = cycles.values().filter(|cycle| cycle.verdict.as_deref() == Some("pass"));
    for epoch in passed.flat_map(|cycle| &cycle.epochs) {
        let done = states.iter().filter(|state| state.epoch == *epoch).map(|state| state.done).max().unwrap_or(0);
        let waypoints = contacts.range((*epoch, 0)..=(*epoch, i64::MAX));
        let left: Vec<i64> = waypoints
            .clone()
            .filter(|((_, id), [said, given])| said.is_some() && (done < *id || given.is_none()))
            .map(|((_, id), _)| *id)
            .collect();
        if let Some(first) = left.first() {
            let count = left.len();
            judged.violations.push(format!(
                "the cycle passed, and {count} waypoints of epoch {epoch} were not executed, the first of them is {first}"
            ));
        }
        judged.unnoticed +=
            waypoints.filter(|((_, id), [said, given])| done >= *id && given.is_some() && given != said).count();
    }
}
