//! Ports without a cell: each call of the loop is answered with recorded data.
//!
//! The order of the loop's calls follows from the data that the loop receives. So the recording's next entry is the
//! next call of the loop, or the next data for it: the loop receives a report only if the next entry is a report, and
//! otherwise nothing. If the loop makes the same call with other content, this is a difference, and the replay
//! continues with the recorded data. If the loop makes another call, or none, the replay has diverged from the
//! recording and ends there.

use super::form::{Recordable, RecordedAnswer, film_role, without_measured_times};
use crate::daemon::ports::Port;
use panelprep_kuka::eki::Time;
use panelprep_store::tape::{Entry, TapeError, Topic};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The entries of a recording, in order.
type Source<'a> = Box<dyn Iterator<Item = Result<Entry, TapeError>> + Send + 'a>;

/// Maximum number of iterations of the loop without an entry of the recording. After more iterations the replay has
/// diverged: the loop waits for an entry that is not in the recording.
const MAX_IDLE_ROUNDS: u32 = 3;

/// A player of a recording. Clones share the same player, so that each port may have one.
#[derive(Clone)]
pub struct Player<'a>(Arc<Mutex<Playback<'a>>>);

/// The result of a replay.
#[derive(Debug)]
pub struct ReplayResult {
    /// The differences between replay and recording, in the order of their times.
    pub differences: Vec<Difference>,
    /// Whether the replay agrees with the recording up to its end.
    pub is_complete: bool,
    /// The error because of which the recording could not be read, if any.
    pub error: Option<TapeError>,
    /// Number of entries that were played.
    pub entries: u64,
}

struct Playback<'a> {
    source: Source<'a>,
    lock_step: bool,
    /// The time at which the last computed result was passed to the loop, ns.
    result_ns: Option<u64>,
    /// Entries that were read ahead: the calls and answers of the loop. The next field contains those of the cameras,
    /// which may be read in parallel with the loop.
    ahead: VecDeque<Entry>,
    seen: VecDeque<Entry>,
    now: Time,
    at_ns: u64,
    rounds: u32,
    entries: u64,
    differences: Vec<Difference>,
    has_diverged: bool,
    error: Option<TapeError>,
}

impl<'a> Player<'a> {
    /// Creates a player of these entries of a recording. `lock_step` states whether the recorded cycle used the robot's
    /// time.
    pub fn new(entries: impl Iterator<Item = Result<Entry, TapeError>> + Send + 'a, lock_step: bool) -> Self {
        Player(Arc::new(Mutex::new(Playback {
            source: Box::new(entries),
            lock_step,
            result_ns: None,
            ahead: VecDeque::new(),
            seen: VecDeque::new(),
            now: Time::default(),
            at_ns: 0,
            rounds: 0,
            entries: 0,
            differences: Vec::new(),
            has_diverged: false,
            error: None,
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Playback<'a>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the result of the replay after the loop has ended.
    pub fn replay_result(&self) -> ReplayResult {
        let mut playback = self.lock();
        if !playback.has_diverged && playback.peek_entry(false).is_some() {
            playback.end_replay("the loop has ended");
        }
        playback.skip_film(true);
        // A camera call that remains in the recording is a difference if its action had a result before the end,
        // because the loop no longer makes this call. If the action had no result, the call may have been in progress
        // when the loop ended.
        let (parted, until_ns) = (playback.has_diverged, playback.result_ns);
        let left = playback
            .peek_entry(true)
            .filter(|left| !parted && until_ns.is_some_and(|result_ns| left.at_ns < result_ns));
        if let Some((at_ns, recorded)) = left.map(|left| (left.at_ns, shorten_value(&left.action))) {
            let (what, now) = ("request to the cameras".to_owned(), "nothing".to_owned());
            playback.differences.push(Difference { at_s: at_ns as f64 / 1e9, what, recorded, now });
            playback.has_diverged = true;
        }
        ReplayResult {
            differences: std::mem::take(&mut playback.differences),
            is_complete: !playback.has_diverged,
            error: playback.error.take(),
            entries: playback.entries,
        }
    }
}

impl Playback<'_> {
    /// Returns the next entry for the loop, or for the cameras, without removing it.
    fn peek_entry(&mut self, cameras: bool) -> Option<&Entry> {
        while !self.has_diverged {
            let is_there = if cameras { !self.seen.is_empty() } else { !self.ahead.is_empty() };
            if is_there {
                break;
            }
            match self.source.next() {
                Some(Ok(entry)) if entry.topic == Topic::Camera => self.seen.push_back(entry),
                Some(Ok(entry)) => self.ahead.push_back(entry),
                Some(Err(error)) => {
                    self.error = Some(error);
                    self.has_diverged = true;
                }
                None => break,
            }
        }
        if cameras { self.seen.front() } else { self.ahead.front() }
    }

    fn pop_entry(&mut self, cameras: bool) -> Option<Entry> {
        self.peek_entry(cameras)?;
        let entry = if cameras { self.seen.pop_front() } else { self.ahead.pop_front() }?;
        (self.rounds, self.at_ns) = (0, entry.at_ns);
        self.entries += 1;
        Some(entry)
    }

    /// Answers a command of the loop.
    fn perform<C: Recordable>(&mut self, command: &C) -> C::Answer {
        let Some((topic, said)) = command.recorded_command() else {
            return command.default_answer(self.now, self.has_diverged);
        };
        if topic == Topic::Request && said.is_null() {
            self.rounds += 1;
            if !self.has_diverged && self.rounds > MAX_IDLE_ROUNDS {
                self.end_replay("the loop waits");
            }
        }
        let entry = match said.is_null() || command.is_optional() {
            true => self.take_data(topic, &said, |heard| command.is_matching_answer(heard)),
            false => self.take_matching_call(topic, &said),
        };
        let Some(Entry { reply: value, shot, .. }) = entry else {
            return command.default_answer(self.now, self.has_diverged);
        };
        command.parse_answer(RecordedAnswer { value, shot }).unwrap_or_else(|error| {
            let (topic, from_s) = (topic.name(), self.time_s());
            self.error.get_or_insert(TapeError::Message { topic, from_s, problem: error.to_string() });
            self.has_diverged = true;
            command.default_answer(self.now, true)
        })
    }

    /// Returns the next entry if it contains data on this topic.
    fn take_data(&mut self, topic: Topic, said: &Value, fits: impl Fn(&Value) -> bool) -> Option<Entry> {
        let is_next = |next: &Entry| next.topic == topic && next.action == *said && fits(&next.reply);
        if self.has_diverged || !self.peek_entry(false).is_some_and(is_next) {
            return None;
        }
        let entry = self.pop_entry(false)?;
        match topic {
            Topic::Clock => self.now = Duration::deserialize(&entry.reply).map_or(self.now, Time::from_start),
            Topic::Result => self.result_ns = Some(entry.at_ns),
            _ => {}
        }
        Some(entry)
    }

    /// Skips the rest of a film. With the wall clock a film is evaluated on a separate thread, and the pictures that
    /// were recorded after the film was ended early are not needed.
    fn skip_film(&mut self, with_its_begin: bool) {
        let is_left = |next: &Entry| {
            let (begins, goes_on) = film_role(&next.action);
            goes_on || begins && with_its_begin
        };
        while !self.lock_step && self.peek_entry(true).is_some_and(is_left) {
            self.pop_entry(true);
        }
    }

    /// Compares a call of the loop with the next entry; returns the entry if both match.
    fn take_matching_call(&mut self, topic: Topic, said: &Value) -> Option<Entry> {
        if self.has_diverged {
            return None;
        }
        let cameras = topic == Topic::Camera;
        if let (true, (begins, false)) = (cameras, film_role(said)) {
            self.skip_film(!begins);
        }
        let fits = |next: &Entry| next.topic == topic && !next.action.is_null() && is_same_call(&next.action, said);
        if !self.peek_entry(cameras).is_some_and(fits) {
            self.end_replay(&format!("{} {}", topic.name(), shorten_value(said)));
            return None;
        }
        let entry = self.pop_entry(cameras)?;
        let (recorded, now) = match topic {
            Topic::Finding => (without_measured_times(entry.action.clone()), without_measured_times(said.clone())),
            _ => (entry.action.clone(), said.clone()),
        };
        let at_s = self.time_s();
        for (place, recorded, now) in differences(&recorded, &now) {
            let what = if place.is_empty() { topic.name().to_owned() } else { format!("{} {place}", topic.name()) };
            self.differences.push(Difference { at_s, what, recorded, now });
        }
        Some(entry)
    }

    /// Ends the replay, because the loop makes a call other than the recorded one.
    fn end_replay(&mut self, now: &str) {
        let next = self.peek_entry(false).map(|next| {
            let what = if next.action.is_null() { &next.reply } else { &next.action };
            (next.at_ns, format!("{} {}", next.topic.name(), shorten_value(what)))
        });
        let (at_ns, recorded) = next.unwrap_or_else(|| (self.at_ns, "the end".to_owned()));
        let (at_s, now) = (at_ns as f64 / 1e9, now.to_owned());
        self.differences.push(Difference { at_s, what: "next entry".to_owned(), recorded, now });
        self.has_diverged = true;
    }

    fn time_s(&self) -> f64 {
        self.at_ns as f64 / 1e9
    }
}

/// Returns whether two commands are the same call, whatever their content: they have the same word, or are objects with
/// the same first key.
fn is_same_call(recorded: &Value, now: &Value) -> bool {
    match (recorded, now) {
        (Value::Object(before), Value::Object(after)) => {
            let is_call = before.len() == 1 && after.len() == 1;
            !is_call || before.keys().eq(after.keys())
        }
        (before, after) => before == after,
    }
}

impl<C: Recordable> Port<C> for Player<'_> {
    fn perform(&mut self, command: C) -> C::Answer {
        self.lock().perform(&command)
    }
}

/// One difference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The time of the difference since the beginning of the recording, s.
    pub at_s: f64,
    /// The topic, and the path of the value within the topic.
    pub what: String,
    /// The recorded value.
    pub recorded: String,
    /// The value in the replay.
    pub now: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Difference { at_s, what, recorded, now } = self;
        write!(f, "{at_s:.3} s, {what}: recorded {recorded}, now {now}")
    }
}

/// Returns each value that differs between the recorded and the new form, with its path, such as
/// `send.move_lin.pose.x_mm`. Numbers are equal if all their digits are equal.
fn differences(recorded: &Value, now: &Value) -> Vec<(String, String, String)> {
    let mut found = Vec::new();
    compare(String::new(), recorded, now, &mut found);
    found
}

fn compare(place: String, recorded: &Value, now: &Value, found: &mut Vec<(String, String, String)>) {
    let below = |key: &str| if place.is_empty() { key.to_owned() } else { format!("{place}.{key}") };
    match (recorded, now) {
        (Value::Object(before), Value::Object(after)) if before.keys().eq(after.keys()) => {
            for (key, value) in before {
                compare(below(key), value, &after[key], found);
            }
        }
        (Value::Array(before), Value::Array(after)) if before.len() == after.len() => {
            for (index, (value, other)) in before.iter().zip(after).enumerate() {
                compare(below(&name(index, value)), value, other, found);
            }
        }
        (before, after) if before == after => {}
        (before, after) => found.push((place, shorten_value(before), shorten_value(after))),
    }
}

/// Returns the name of a list entry: the value of its field `name`, or its index.
fn name(index: usize, value: &Value) -> String {
    value.get("name").and_then(Value::as_str).map_or_else(|| index.to_string(), str::to_owned)
}

/// Maximum length of each of the two shown values, characters.
const MAX_TEXT_LENGTH: usize = 200;

/// Returns a value as text; a long text is truncated.
fn shorten_value(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= MAX_TEXT_LENGTH {
        return text;
    }
    let cut: String = text.chars().take(MAX_TEXT_LENGTH).collect();
    format!("{cut}…")
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};
    use panelprep_cell::record::{Check, Finding, Kind, LimitSource};
    use serde_json::json;

    fn found(checks: impl IntoIterator<Item = Check>) -> Value {
        let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
        json!(Finding::new(Kind::Inspect, 1, judgement).with_checks(checks))
    }

    fn rms(mm: f64, allowed_mm: f64) -> Check {
        let check = Check::new("residual", "mm", mm).with_max(allowed_mm, LimitSource::recipe("locate.max_rms_mm"));
        check.or_reject("poor_fit", || "too much".to_owned())
    }

    fn shift() -> Check {
        Check::new("shift", "mm", 12.5)
    }

    fn differing(recorded: &Value, now: Value) -> Vec<String> {
        differences(recorded, &now).into_iter().map(|(place, ..)| place).collect()
    }

    #[test]
    fn another_number_limit_or_verdict_is_a_difference() {
        let recorded = found([rms(0.1, 0.25), shift()]);
        assert_eq!(differing(&recorded, found([rms(0.11, 0.25), shift()])), ["numbers.residual.value"]);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.26), shift()])), ["numbers.residual.limit.at_most"]);
        let mut rejected = found([rms(0.1, 0.25), shift()]);
        rejected["judgement"]["verdict"] = json!("reject");
        assert_eq!(differing(&recorded, rejected), ["judgement.verdict"]);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.25)])), ["numbers"], "one is missing");
    }

    /// Findings are compared completely, including order and codes.
    #[test]
    fn findings_are_compared_completely() {
        let recorded = found([rms(0.1, 0.25), shift()]);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.25), shift()])), Vec::<String>::new());
        let other_code = rms(0.1, 0.25).or_review("poor_fit", String::new);
        assert_eq!(differing(&recorded, found([other_code, shift()])), ["numbers.residual.severity"]);
        let more = Check::new("another", "mm", 1.0);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.25), shift(), more])), ["numbers"], "one is added");
        assert_ne!(differing(&recorded, found([shift(), rms(0.1, 0.25)])), Vec::<String>::new(), "another order");
    }
}
