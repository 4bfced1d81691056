//! The true events at the controller's end of the cable: the states as the controller sent them, and the commands and
//! requests as the controller received them. Also the service's messages before any change.

use super::message;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The process that sent or received a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The service sent the message.
    Said,
    /// The controller received the message, possibly changed.
    Given,
    /// The controller sent the message.
    True,
    /// The service received the message, possibly changed.
    Shown,
}

#[derive(Debug, Clone)]
pub struct Event {
    pub at_ms: f64,
    pub side: Side,
    pub text: String,
}

/// Identifies a motion on the panel: epoch and command id.
pub type Key = (i64, i64);

/// A state that the controller reported.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Time of the bench's clock, ms.
    pub at_ms: f64,
    /// Time of the controller's clock, ms.
    pub time_ms: f64,
    pub epoch: i64,
    pub done: i64,
    flags: i64,
    outputs: i64,
    pub joints: [f64; 6],
}

/// Bit number of an output, in the order of the outputs' numbers in the cell's file.
pub const LIGHT: u32 = 0;
pub const WATER: u32 = 1;
pub const EXTRACTION: u32 = 3;
pub const TOOL: u32 = 4;

impl State {
    fn read(at_ms: f64, text: &str) -> Option<Self> {
        let joints = ["A1", "A2", "A3", "A4", "A5", "A6"].map(|axis| message::number(text, &format!("J/{axis}")));
        let whole = |name| message::whole(text, name);
        Some(State {
            at_ms,
            time_ms: message::number(text, "T")?,
            epoch: whole("Ep"),
            done: whole("Done"),
            flags: whole("Flags"),
            outputs: whole("Out"),
            joints: joints.map(|angle| angle.unwrap_or(f64::NAN)),
        })
    }

    pub fn moving(&self) -> bool {
        self.flags & 8 != 0
    }

    /// Returns whether the controller reports that the last epoch has been stopped.
    pub fn stopped(&self) -> bool {
        self.flags & 128 != 0
    }

    pub fn is_on(&self, output: u32) -> bool {
        self.outputs >> output & 1 == 1
    }

    /// Returns the largest difference of an axis angle between two states, degrees.
    pub fn apart_deg(&self, other: &State) -> f64 {
        self.joints.iter().zip(other.joints).fold(0.0, |most, (one, other)| most.max((one - other).abs()))
    }
}

/// Commands in contact: each as the service sent it, and as the controller received it.
pub type Contacts = BTreeMap<Key, [Option<String>; 2]>;

#[derive(Debug, Default)]
struct Inside {
    events: Vec<Event>,
    last: Option<State>,
    given: BTreeMap<Key, bool>,
    was_in_contact: bool,
}

#[derive(Debug)]
pub struct Truth {
    begun: Instant,
    inside: Mutex<Inside>,
}

impl Truth {
    pub fn new() -> Self {
        Truth { begun: Instant::now(), inside: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn now_ms(&self) -> f64 {
        self.begun.elapsed().as_secs_f64() * 1_000.0
    }

    pub fn record(&self, side: Side, document: &[u8]) {
        let at_ms = self.now_ms();
        let text = String::from_utf8_lossy(document).into_owned();
        let mut inside = self.lock();
        if side == Side::True
            && text.contains("<St ")
            && let Some(state) = State::read(at_ms, &text)
        {
            inside.last = Some(state);
            inside.was_in_contact |= inside.is_in_contact(&state);
        }
        if side == Side::Given && text.contains("<Cmd ") {
            let key = (message::whole(&text, "Ep"), message::whole(&text, "Id"));
            inside.given.insert(key, is_contact(&text));
        }
        inside.events.push(Event { at_ms, side, text });
    }

    pub fn last(&self) -> Option<State> {
        self.lock().last
    }

    /// Returns whether the tool runs and is on the panel.
    pub fn is_in_contact(&self) -> bool {
        let inside = self.lock();
        inside.last.is_some_and(|state| inside.is_in_contact(&state))
    }

    /// Returns whether the tool was on the panel and is moving away from it.
    pub fn has_left_contact(&self) -> bool {
        let inside = self.lock();
        let left = |state: State| {
            let last = inside.given.iter().rev().find(|((epoch, _), contact)| **contact && *epoch == state.epoch);
            last.is_some_and(|((_, id), _)| state.done >= *id)
        };
        inside.was_in_contact && inside.last.is_some_and(left)
    }

    pub fn events(&self) -> Vec<Event> {
        self.lock().events.clone()
    }
}

impl Inside {
    fn is_in_contact(&self, state: &State) -> bool {
        state.is_on(TOOL) && self.given.get(&(state.epoch, state.done)) == Some(&true)
    }
}

fn is_contact(text: &str) -> bool {
    message::whole(text, "Op") == 2 && message::whole(text, "N2") == 1
}

/// Returns the states that the controller sent, from these events.
pub fn states(events: &[Event]) -> Vec<State> {
    let of = |event: &Event| {
        let is_state = event.side == Side::True && event.text.contains("<St ");
        is_state.then(|| State::read(event.at_ms, &event.text)).flatten()
    };
    events.iter().filter_map(of).collect()
}

/// Returns the commands in contact from these events. A command is identified by the epoch and id that the service
/// sent.
pub fn contacts(events: &[Event]) -> Contacts {
    let mut contacts = Contacts::new();
    for event in events.iter().filter(|event| event.text.contains("<Cmd ")) {
        let place = match event.side {
            Side::Said if is_contact(&event.text) => 0,
            Side::Given => 1,
            _ => continue,
        };
        let text = event.text[event.text.find("<Cmd ").unwrap_or(0)..].to_owned();
        let key = (message::whole(&text, "Ep"), message::whole(&text, "Id"));
        // The service sends each command once; the controller refuses a second command with the same id.
        contacts.entry(key).or_default()[place].get_or_insert(text);
    }
    contacts.retain(|_, [said, given]| said.is_some() || given.as_ref().is_some_and(|text| is_contact(text)));
    contacts
}
