//! The queue when nobody empties it, and what a player says when the loop does something else.

use super::super::ports::{Ask, Record, Requests, Robot};
use super::queue::{Recorder, Recording};
use super::*;
use crate::cycle::State;
use crate::eki::{Command, CommandId, QueueError, Report};
use crate::geometry::{ColorPicture, KukaPose};
use crate::record::{Finding, Kind, Number};
use crate::tape::{Entry, Shot, Start, TapeError, Topic, Writer, check};
use crate::verdict::Judgement;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

/// A disk that waits for a word before each write, keeps what is written, or refuses.
#[derive(Clone)]
struct Disk {
    written: Arc<Mutex<Vec<u8>>>,
    go: Option<Arc<Mutex<Receiver<()>>>>,
    refuses_after: usize,
}

impl Disk {
    fn new() -> Self {
        Disk { written: Arc::default(), go: None, refuses_after: usize::MAX }
    }

    fn bytes(&self) -> Vec<u8> {
        self.written.lock().expect("whole").clone()
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(go) = &self.go {
            // Once nobody holds it up any more, it writes on.
            let _ = go.lock().expect("whole").recv();
        }
        let mut written = self.written.lock().expect("whole");
        if written.len() >= self.refuses_after {
            return Err(io::Error::new(io::ErrorKind::StorageFull, "no space left on device"));
        }
        written.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn start() -> Start {
    let (hand_eye_mm, robot_mm) = (None, None);
    Start { program: "0.0.0".to_owned(), unix_ns: 1, state: State::NEW, lock_step: true, hand_eye_mm, robot_mm }
}

fn begun(disk: &Disk) -> Writer<Disk> {
    Writer::begin(disk.clone(), &start(), &[], &[]).expect("begun")
}

fn line(topic: Topic, said: Value, heard: Value) -> Entry {
    Entry { topic, at_ns: 0, said, heard, shot: None }
}

/// A picture of 30 kB in a queue of 40 kB.
fn put_pictures(recorder: &Recorder, count: u64) {
    for index in 0..count {
        recorder.clock((1 + index) * 100_000_000);
        // No two bytes alike: what is packed is as large as what is not.
        let noise = |pixel: u64| (pixel + 10_000 * index).wrapping_mul(0x9E37_79B9_7F4A_7C15).to_be_bytes();
        let rgb = (0..10_000).map(|pixel| [noise(pixel)[2], noise(pixel)[3], noise(pixel)[4]]).collect();
        let picture = Arc::new(ColorPicture { width: 100, height: 100, rgb });
        let heard = json!({ "Ok": { "size_px": [100, 100] } });
        let shot = Some(Shot::Scanner(picture));
        recorder.put(Entry { shot, ..line(Topic::Camera, json!("picture"), heard) });
    }
}

/// Its beginning is written before the queue starts; then the disk hangs until it is let go.
fn hanging() -> (Disk, Sender<()>, Writer<Disk>) {
    let disk = Disk::new();
    let (go, wait) = channel();
    // As many words as the beginning needs, however many those are.
    (0..10_000).for_each(|_| go.send(()).expect("sent"));
    let wait = Arc::new(Mutex::new(wait));
    let disk = Disk { go: Some(wait.clone()), ..disk };
    let writer = begun(&disk);
    wait.lock().expect("whole").try_iter().for_each(drop);
    (disk, go, writer)
}

#[test]
fn by_the_wall_clock_nobody_waits_and_a_full_queue_is_a_gap() {
    let (disk, go, writer) = hanging();
    let recording = Recording::bounded(writer, false, 40_000).expect("started");
    put_pictures(&recording.recorder(), 200);
    drop(go);
    let written = recording.finish().expect("finished");
    let [lost] = written.lost.as_slice() else { panic!("{written:?}") };
    assert_eq!((lost.topic, lost.count + written.entries), (Topic::Camera, 200));
    let error = check(&disk.bytes()[..]).expect_err("a gap");
    assert!(matches!(error, TapeError::Lost { topic: "/camera", .. }), "{error}");
}

#[test]
fn in_lock_step_a_full_queue_is_waited_for() {
    let disk = Disk::new();
    let recording = Recording::bounded(begun(&disk), true, 40_000).expect("started");
    put_pictures(&recording.recorder(), 50);
    let written = recording.finish().expect("finished");
    assert_eq!((written.entries, written.lost.len()), (50, 0));
    assert_eq!(check(&disk.bytes()[..]).expect("whole").entries, 50);
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let disk = Disk { refuses_after: 20_000, ..Disk::new() };
    let recording = Recording::bounded(begun(&disk), true, 40_000).expect("started");
    // It returns: a queue that nobody empties any more is not waited for.
    put_pictures(&recording.recorder(), 2_000);
    let error = recording.finish().expect_err("no space");
    assert!(error.to_string().contains("no space left"), "{error}");
}

fn player(entries: Vec<Entry>) -> Player<'static> {
    Player::new(entries.into_iter().map(Ok), true)
}

fn ended(said: &str) -> Command {
    let pose = KukaPose { x_mm: if said == "same" { 1.5 } else { 1.75 }, ..KukaPose::default() };
    Command::SetBase(pose)
}

#[test]
fn the_same_words_are_no_difference_and_come_with_their_answer() {
    let sent = || line(Topic::Command, json!({ "send": ended("same") }), json!({ "Ok": 4 }));
    let refused =
        line(Topic::Command, json!("abort"), told(&Err::<(), _>(QueueError::FramesNotSet { missing: "a recipe" })));
    let report = line(Topic::Report, Value::Null, told(&Report::Progress { done: CommandId(4) }));
    let mut player = player(vec![sent(), report, refused]);
    assert!(Robot::next(&mut player).is_none(), "a command comes first");
    assert_eq!(player.send(ended("same")), Ok(CommandId(4)));
    assert_eq!(Robot::next(&mut player), Some(Report::Progress { done: CommandId(4) }));
    assert_eq!(player.abort(), Err(QueueError::FramesNotSet { missing: "a recipe" }));
    let played = player.played();
    assert!(played.to_the_end && played.differences.is_empty() && played.error.is_none(), "{played:?}");
}

#[test]
fn another_number_is_a_difference_and_the_replay_goes_on() {
    let sent = line(Topic::Command, json!({ "send": ended("same") }), json!({ "Ok": 4 }));
    let mut player = player(vec![sent]);
    assert_eq!(player.send(ended("other")), Ok(CommandId(4)));
    let played = player.played();
    assert!(played.to_the_end);
    let [difference] = played.differences.as_slice() else { panic!("{played:?}") };
    assert_eq!(difference.to_string(), "0.000 s, /robot/command send.set_base.x_mm: recorded 1.5, now 1.75");
}

#[test]
fn another_call_or_none_parts_them() {
    let abort = || line(Topic::Command, json!("abort"), json!({ "Ok": null }));
    let mut other = player(vec![abort()]);
    assert!(other.send(ended("same")).is_err());
    assert!(Robot::next(&mut other).is_none() && matches!(Requests::next(&mut other, &State::NEW), Ask::For(_)));
    let played = other.played();
    assert!(!played.to_the_end && played.differences.len() == 1, "{played:?}");
    assert!(played.differences[0].now.starts_with("/robot/command {\"send\""), "{played:?}");

    let mut waiting = player(vec![abort()]);
    let asks: Vec<Ask> = (0..10).map(|_| Requests::next(&mut waiting, &State::NEW)).collect();
    assert!(matches!(asks.last(), Some(Ask::For(_))), "it does not wait for ever");
    assert!(waiting.played().differences[0].now.contains("waits"));

    let left = player(vec![abort()]).played();
    assert!(!left.to_the_end && left.differences[0].now.contains("left"), "{left:?}");
}

#[test]
fn a_stop_watch_is_no_finding_but_its_limit_is() {
    let found = |ms: f64, mm: f64| {
        let numbers = [Number::new(name::SCAN_TO_VERDICT, "ms", ms), Number::new("residual", "mm", mm)];
        Finding::new(Kind::Locate, 0, Judgement::of(vec![], vec![])).with(numbers)
    };
    let recorded = || line(Topic::Finding, told(&found(10.0, 0.25)), json!({ "Ok": null }));
    let mut same = player(vec![recorded()]);
    same.finding(&found(99.0, 0.25)).expect("kept");
    assert!(same.played().differences.is_empty());
    let mut other = player(vec![recorded()]);
    other.finding(&found(10.0, 0.25000000000000006)).expect("kept");
    let played = other.played();
    assert_eq!(played.differences.len(), 1);
    assert_eq!(played.differences[0].what, "/cycle/finding numbers.residual.value");
}
