//! The ports without a cell: each call of the loop is answered with what came when it was recorded.
//!
//! The loop makes its calls in an order that follows from what it hears. So the recording's next entry is what the loop
//! does next, or what comes to it next: a report only where the next entry is one, and nothing otherwise. Where the loop
//! says something else in the same call, that is a difference and the replay goes on with what was recorded; where it
//! makes another call, or none, the two have parted, and the replay ends there.

use super::super::ports::{
    Eyes, Figure, Finding, Journal, Kept, Picture2d, Record, RecordError, Requests, Robot, SightError,
};
use super::super::request::{Request, What};
use super::difference::{Difference, differences, short};
use super::{Blind, Seen, told};
use crate::cycle::{self, Event, Id, Motion, Outcome, Refusal, State};
use crate::eki::{Command, CommandId, Epoch, MoveLin, QueueError, Report, Time};
use crate::geometry::{Camera, ColorPicture, OrganizedCloud};
use crate::phase::Phase;
use crate::record::{Asked, Budget, Clock, ContactPath, CycleId, EarlierPass, Front, Who};
use crate::store::CycleStart;
use crate::supervision::ThreadFault;
use crate::tape::{Entry, Shot, TapeError, Topic};
use crate::verdict::{Reason, Verdict};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

/// Entries of a recording.
type Source<'a> = Box<dyn Iterator<Item = Result<Entry, TapeError>> + 'a>;

/// Rounds of the loop in which nothing of the recording comes to it; then it waits for what did not come.
const MOST_ROUNDS: u32 = 3;

/// A recording that is played. Its clones are the same player, so that each port may have one.
#[derive(Clone)]
pub struct Player<'a>(Rc<RefCell<Deck<'a>>>);

/// What a replay came to.
#[derive(Debug)]
pub struct Played {
    /// Where it differs, in order.
    pub differences: Vec<Difference>,
    /// Whether the two went the same way to the end.
    pub to_the_end: bool,
    /// What could not be read.
    pub error: Option<TapeError>,
    /// Entries that were played.
    pub entries: u64,
}

struct Deck<'a> {
    source: Source<'a>,
    lock_step: bool,
    /// When the last result was let in.
    result_ns: Option<u64>,
    /// Read ahead: what the loop does and hears, and what cameras gave. Cameras may be looked at beside the loop.
    ahead: VecDeque<Entry>,
    seen: VecDeque<Entry>,
    now: Time,
    at_ns: u64,
    rounds: u32,
    entries: u64,
    differences: Vec<Difference>,
    parted: bool,
    error: Option<TapeError>,
}

impl<'a> Player<'a> {
    /// Plays these entries of a recording in which time was, or was not, the robot's own.
    pub fn new(entries: impl Iterator<Item = Result<Entry, TapeError>> + 'a, lock_step: bool) -> Self {
        Player(Rc::new(RefCell::new(Deck {
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
            parted: false,
            error: None,
        })))
    }

    /// What it came to, once the loop has left.
    pub fn played(&self) -> Played {
        let mut deck = self.0.borrow_mut();
        if !deck.parted && deck.peek(false).is_some() {
            deck.part("the loop has left");
        }
        // A look that nobody needs any more, where its work has come to its result: one may be under way when the loop leaves.
        let (parted, until_ns) = (deck.parted, deck.result_ns);
        let left =
            deck.peek(true).filter(|left| !parted && until_ns.is_some_and(|result_ns| left.at_ns < result_ns));
        if let Some((at_ns, recorded)) = left.map(|left| (left.at_ns, short(&left.said))) {
            let (what, now) = ("what the cameras were asked".to_owned(), "nothing".to_owned());
            deck.differences.push(Difference { at_s: at_ns as f64 / 1e9, what, recorded, now });
            deck.parted = true;
        }
        Played {
            differences: std::mem::take(&mut deck.differences),
            to_the_end: !deck.parted,
            error: deck.error.take(),
            entries: deck.entries,
        }
    }

    /// What came to this call; `None` where the two have parted.
    fn call<T: DeserializeOwned>(&self, topic: Topic, said: Value) -> Option<T> {
        let mut deck = self.0.borrow_mut();
        let heard = deck.call(topic, &said)?.heard;
        deck.understood(topic, heard)
    }

    /// The same for what is kept.
    fn keep<T: DeserializeOwned>(&self, topic: Topic, said: Value) -> Result<T, RecordError> {
        match self.call::<Result<T, String>>(topic, said) {
            Some(came) => came.map_err(|words| RecordError(words.into())),
            None => Err(RecordError("the replay has parted from the recording".into())),
        }
    }

    /// What comes on this topic, where it comes next.
    fn heard<T: DeserializeOwned>(&self, topic: Topic) -> Option<T> {
        let mut deck = self.0.borrow_mut();
        let is_next = deck.peek(false).is_some_and(|next| next.topic == topic && next.said.is_null());
        if !is_next {
            return None;
        }
        let heard = deck.take(false)?.heard;
        deck.understood(topic, heard)
    }

    /// What a camera gave to this: a shot with its time, or none.
    fn look(&self, asked: &'static str) -> Result<Option<(Shot, Option<f64>)>, SightError> {
        let (heard, shot) = {
            let mut deck = self.0.borrow_mut();
            let entry = deck.call(Topic::Camera, &json!(asked)).ok_or_else(missing)?;
            (deck.understood::<Result<Option<Seen>, Blind>>(Topic::Camera, entry.heard), entry.shot)
        };
        let seen = heard.ok_or_else(missing)?.map_err(Blind::error)?;
        match (seen, shot) {
            (None, _) => Ok(None),
            (Some(seen), Some(shot)) => Ok(Some((shot, seen.time_s))),
            (Some(_), None) => Err(missing()),
        }
    }

    /// What a camera answered to this, where that is no shot.
    fn answered<T: DeserializeOwned>(&self, said: Value) -> Result<T, SightError> {
        let came: Option<Result<T, Blind>> = self.call(Topic::Camera, said);
        came.ok_or_else(missing)?.map_err(Blind::error)
    }
}

impl Deck<'_> {
    /// The next entry for the loop, or for the cameras.
    fn peek(&mut self, cameras: bool) -> Option<&Entry> {
        while !self.parted {
            let is_there = if cameras { !self.seen.is_empty() } else { !self.ahead.is_empty() };
            if is_there {
                break;
            }
            match self.source.next() {
                Some(Ok(entry)) if entry.topic == Topic::Camera => self.seen.push_back(entry),
                Some(Ok(entry)) => self.ahead.push_back(entry),
                Some(Err(error)) => {
                    self.error = Some(error);
                    self.parted = true;
                }
                None => break,
            }
        }
        if cameras { self.seen.front() } else { self.ahead.front() }
    }

    fn take(&mut self, cameras: bool) -> Option<Entry> {
        self.peek(cameras)?;
        let entry = if cameras { self.seen.pop_front() } else { self.ahead.pop_front() }?;
        (self.rounds, self.at_ns) = (0, entry.at_ns);
        self.entries += 1;
        Some(entry)
    }

    /// The loop makes a call.
    fn call(&mut self, topic: Topic, said: &Value) -> Option<Entry> {
        if self.parted {
            return None;
        }
        let cameras = topic == Topic::Camera;
        let fits = |next: &Entry| next.topic == topic && !next.said.is_null() && same_call(&next.said, said);
        if !self.peek(cameras).is_some_and(fits) {
            self.part(&format!("{} {}", topic.name(), short(said)));
            return None;
        }
        let entry = self.take(cameras)?;
        let (recorded, now) = match topic {
            Topic::Finding => {
                let now = super::form::in_form_of(&entry.said, said.clone());
                (super::timeless(entry.said.clone()), super::timeless(now))
            }
            _ => (entry.said.clone(), said.clone()),
        };
        let at_s = self.at_s();
        for (place, recorded, now) in differences(&recorded, &now) {
            let what = if place.is_empty() { topic.name().to_owned() } else { format!("{} {place}", topic.name()) };
            self.differences.push(Difference { at_s, what, recorded, now });
        }
        Some(entry)
    }

    /// The loop does not what was recorded: the replay ends.
    fn part(&mut self, now: &str) {
        let next = self.peek(false).map(|next| {
            let what = if next.said.is_null() { &next.heard } else { &next.said };
            (next.at_ns, format!("{} {}", next.topic.name(), short(what)))
        });
        let (at_ns, recorded) = next.unwrap_or_else(|| (self.at_ns, "the end".to_owned()));
        let (at_s, now) = (at_ns as f64 / 1e9, now.to_owned());
        self.differences.push(Difference { at_s, what: "what comes next".to_owned(), recorded, now });
        self.parted = true;
    }

    fn understood<T: DeserializeOwned>(&mut self, topic: Topic, heard: Value) -> Option<T> {
        match serde_json::from_value(heard) {
            Ok(value) => Some(value),
            Err(error) => {
                let (topic, from_s) = (topic.name(), self.at_s());
                self.error.get_or_insert(TapeError::Message { topic, from_s, problem: error.to_string() });
                self.parted = true;
                None
            }
        }
    }

    fn at_s(&self) -> f64 {
        self.at_ns as f64 / 1e9
    }
}

/// Whether two are the same call, whatever they say in it: the same word, or objects of the same first key.
fn same_call(recorded: &Value, now: &Value) -> bool {
    match (recorded, now) {
        (Value::Object(before), Value::Object(after)) => {
            let is_call = before.len() == 1 && after.len() == 1;
            !is_call || before.keys().eq(after.keys())
        }
        (before, after) => before == after,
    }
}

impl Robot for Player<'_> {
    fn send(&mut self, command: Command) -> Result<CommandId, QueueError> {
        self.call(Topic::Command, json!({ "send": command })).unwrap_or(Err(QueueError::NotConnected))
    }

    fn send_path(&mut self, points: Vec<MoveLin>) -> Result<CommandId, QueueError> {
        self.call(Topic::Command, json!({ "path": points })).unwrap_or(Err(QueueError::NotConnected))
    }

    fn send_path_within(&mut self, points: Vec<MoveLin>, _: u32) -> Result<CommandId, QueueError> {
        self.send_path(points)
    }

    fn permit(&mut self, _: Option<CommandId>) -> Result<(), QueueError> {
        Ok(())
    }

    fn open_epoch(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        let opened = self.call(Topic::Command, json!({ "open_epoch_above": above }));
        opened.unwrap_or(Err(QueueError::NotConnected))
    }

    fn abort(&mut self) -> Result<(), QueueError> {
        self.call(Topic::Command, json!("abort")).unwrap_or(Err(QueueError::NotConnected))
    }

    fn next(&mut self) -> Option<Report> {
        self.heard(Topic::Report)
    }

    fn now(&self) -> Time {
        if let Some(since) = self.heard(Topic::Clock) {
            self.0.borrow_mut().now = Time::after_start(since);
        }
        self.0.borrow().now
    }

    fn is_lock_step(&self) -> bool {
        self.0.borrow().lock_step
    }
}

impl Eyes for Player<'_> {
    fn scan(&mut self) -> Result<OrganizedCloud<Camera>, SightError> {
        match self.look("scan")? {
            Some((Shot::Points(cloud), _)) => Ok(Arc::unwrap_or_clone(cloud)),
            _ => Err(another("points")),
        }
    }

    fn picture(&mut self) -> Result<Picture2d, SightError> {
        self.look("picture")?.map(timed).unwrap_or_else(|| Err(missing()))
    }

    fn begin_film(&mut self, pictures_per_second: f64) -> Result<f64, SightError> {
        self.answered(json!({ "begin_film": pictures_per_second }))
    }

    fn next_of_film(&mut self) -> Result<Option<Picture2d>, SightError> {
        self.look("next_of_film")?.map(timed).transpose()
    }

    fn end_film(&mut self) -> Result<u64, SightError> {
        self.answered(json!("end_film"))
    }

    fn corner_picture(&mut self) -> Result<ColorPicture, SightError> {
        match self.look("corner_picture")? {
            Some((Shot::Flange(picture), _)) => Ok(Arc::unwrap_or_clone(picture)),
            _ => Err(another("a picture of the flange camera")),
        }
    }

    fn check(&mut self) -> Vec<SightError> {
        let wrong: Vec<Blind> = self.call(Topic::Camera, json!("check")).unwrap_or_default();
        wrong.into_iter().map(Blind::error).collect()
    }
}

fn timed((shot, time_s): (Shot, Option<f64>)) -> Result<Picture2d, SightError> {
    match (shot, time_s) {
        (Shot::Scanner(picture), Some(time_s)) => Ok(Picture2d { picture: Arc::unwrap_or_clone(picture), time_s }),
        _ => Err(another("a picture of the scanner with its time")),
    }
}

fn missing() -> SightError {
    SightError { camera: "a camera", why: "the recording has no more pictures".to_owned() }
}

fn another(wanted: &str) -> SightError {
    SightError { camera: "a camera", why: format!("the recording has something else where {wanted} was due") }
}

impl Record for Player<'_> {
    fn finding(&mut self, finding: &Finding) -> Result<(), RecordError> {
        self.keep(Topic::Finding, told(finding))
    }

    fn picture(&mut self, name: &str, _: &ColorPicture) -> Result<(), RecordError> {
        self.keep(Topic::Store, super::said_picture(name))
    }

    fn frame(&mut self, _: &Arc<ColorPicture>, time_s: f64, phase: Phase) -> Result<(), RecordError> {
        self.keep(Topic::Store, super::said_frame(time_s, phase))
    }

    fn figure(&mut self, figure: &Figure) -> Result<(), RecordError> {
        self.keep(Topic::Store, super::said_figure(&figure.name, &figure.caption))
    }

    fn budget(&mut self, measured: &Budget) -> Result<(), RecordError> {
        self.keep(Topic::Store, json!({ "budget": measured }))
    }
}

impl Journal for Player<'_> {
    fn kept(&mut self, kept: Kept) -> Result<(), RecordError> {
        self.keep(Topic::Store, super::said_kept(&kept))
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.keep(Topic::Event, told(event))
    }

    fn open_intent(&mut self, motion: &Motion) -> Result<(), RecordError> {
        self.keep(Topic::Store, json!({ "open_intent": motion }))
    }

    fn open_contact(&mut self, motion: &Motion, _: &ContactPath, _: u32) -> Result<(), RecordError> {
        self.open_intent(motion)
    }

    fn permit(&mut self, _: u32) -> Result<(), RecordError> {
        Ok(())
    }

    fn abraded_before(&mut self) -> Result<Vec<EarlierPass>, RecordError> {
        let said = json!(super::ABRADED_BEFORE);
        let is_next = self.0.borrow_mut().peek(false).is_some_and(|next| next.said == said);
        if is_next { self.keep(Topic::Store, said) } else { Ok(Vec::new()) }
    }

    fn asked(&mut self, _: &Asked) -> Result<(), RecordError> {
        Ok(())
    }

    fn clock(&mut self, _: Clock) -> Result<(), RecordError> {
        Ok(())
    }

    fn close_intent(&mut self, motion: &Motion, outcome: Outcome, done: u32) -> Result<(), RecordError> {
        self.keep(Topic::Store, super::said_closed(motion, outcome, done))
    }

    fn conclude(&mut self, verdict: Verdict) -> Result<(), RecordError> {
        self.keep(Topic::Store, json!({ "conclude": verdict }))
    }

    fn begin(&mut self, _: &CycleStart) -> Result<CycleId, RecordError> {
        self.keep(Topic::Store, json!("begin"))
    }

    fn between_cycles(&mut self) {
        let _: Option<Value> = self.call(Topic::Store, json!("between_cycles"));
    }

    fn disc_worn_mm2(&mut self) -> Result<f64, RecordError> {
        self.keep(Topic::Store, json!("disc_worn_mm2"))
    }

    fn wear_disc(&mut self, swept_mm2: f64) -> Result<(), RecordError> {
        self.keep(Topic::Store, json!({ "wear_disc_mm2": swept_mm2 }))
    }

    fn mount_disc(&mut self) -> Result<(), RecordError> {
        self.keep(Topic::Store, json!("mount_disc"))
    }

    fn check(&mut self) -> Vec<Reason> {
        self.call(Topic::Store, json!("check")).unwrap_or_default()
    }

    fn filled(&mut self) -> Option<Reason> {
        self.heard(Topic::Store)
    }
}

impl Requests for Player<'_> {
    fn next(&mut self, _: &State) -> Result<Option<Request>, ThreadFault> {
        let request = |what| Ok(Some(Request::new(what, Who::by(Front::Program))));
        {
            let mut deck = self.0.borrow_mut();
            deck.rounds += 1;
            if !deck.parted && deck.rounds > MOST_ROUNDS {
                deck.part("the loop waits");
            }
            if deck.parted {
                // Its journal refuses it, and so ends the loop.
                return request(What::Table(cycle::Request::Abort));
            }
        }
        match self.heard::<Value>(Topic::Request) {
            None => Ok(None),
            Some(Value::String(word)) if word == "leave" => request(What::Leave),
            Some(Value::String(word)) if word == "new_disc" => request(What::NewDisc),
            Some(mut asked) => {
                let asked = asked.get_mut("for").map(Value::take).unwrap_or_default();
                let asked = self.0.borrow_mut().understood(Topic::Request, asked);
                asked.map_or(Ok(None), |asked| request(What::Table(asked)))
            }
        }
    }

    fn lets_in(&mut self, result: Id) -> bool {
        let mut deck = self.0.borrow_mut();
        let came_now = |next: &Entry| next.topic == Topic::Result && next.heard == json!(result);
        if !deck.peek(false).is_some_and(came_now) {
            return false;
        }
        let taken = deck.take(false);
        deck.result_ns = taken.as_ref().map(|entry| entry.at_ns).or(deck.result_ns);
        taken.is_some()
    }

    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        let said = json!({ "refused": [told(&request), told(&refusal)] });
        let _: Option<Value> = self.call(Topic::Request, said);
    }

    fn unable(&mut self, reasons: Vec<Reason>) {
        let _: Option<Value> = self.call(Topic::Request, json!({ "unable": reasons }));
    }
}
