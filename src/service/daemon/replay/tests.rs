//! Tests the queue of a recording when its thread does not empty it, and the player's report when the loop acts
//! differently.

use super::form::to_json;
use super::queue::{QueueBounds, Recorder};
use super::*;
use crate::daemon::ports::{Note, RecordCommand, RecordPort, RequestPort, RobotPort};
use crate::daemon::request::{Request, RequestKind};
use crate::setup::{MIN_FREE_SPACE_FOR_RECORDING_MB, RecordingStatus};
use panelprep_base::geometry::{ColorPicture, KukaPose};
use panelprep_base::verdict::Judgement;
use panelprep_cell::cycle::{Id, State};
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_kuka::eki::{Command, CommandId, QueueError, Report};
use panelprep_store::tape::{
    Entry, LoopMemoryStart, RecordingStart, Shot, TapeError, Topic, Writer, check_recording,
};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A simulated disk that waits for a permission before each write, and then stores the data or refuses them.
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
            // Waits for the permission; after `go` is dropped, the disk writes without waiting.
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

fn start() -> RecordingStart {
    let (hand_eye_mm, robot_mm) = (None, None);
    let (program, state) = ("0.0.0".to_owned(), State::INITIAL);
    RecordingStart {
        program,
        unix_ns: 1,
        state,
        lock_step: true,
        begin: LoopMemoryStart::Boot,
        hand_eye_mm,
        robot_mm,
    }
}

fn begun(disk: &Disk) -> Writer<Disk> {
    Writer::begin_recording(disk.clone(), &start(), &[], &[], &[]).expect("begun")
}

fn bounds(waits: bool, hangs_at_the_end: Duration) -> QueueBounds {
    QueueBounds {
        is_blocking: waits,
        max_bytes: 40_000,
        disk_timeout: Duration::from_millis(20),
        final_disk_timeout: hangs_at_the_end,
    }
}

/// Starts a recording to this disk with a queue of 40 kB; the recording continues while there is free space.
fn recording(writer: Writer<Disk>, waits: bool, room_mb: impl FnMut() -> u64 + Send + 'static) -> Recording {
    let bounds = bounds(waits, Duration::from_secs(600));
    let mut room_mb = room_mb;
    let room = Box::new(move || Ok(room_mb()));
    Recording::start("a.mcap".to_owned(), move || Ok(writer), (bounds, None), room).expect("started")
}

fn line(topic: Topic, said: Value, heard: Value) -> Entry {
    Entry { topic, at_ns: 0, action: said, reply: heard, shot: None }
}

/// Puts pictures of 30 kB into a queue of 40 kB.
fn put_pictures(recorder: &Recorder, count: u64) {
    for index in 0..count {
        recorder.clock((1 + index) * 100_000_000);
        // The pixels are pseudo-random, so that compression does not make them smaller.
        let noise = |pixel: u64| (pixel + 10_000 * index).wrapping_mul(0x9E37_79B9_7F4A_7C15).to_be_bytes();
        let rgb = (0..10_000).map(|pixel| [noise(pixel)[2], noise(pixel)[3], noise(pixel)[4]]).collect();
        let picture = Arc::new(ColorPicture { width: 100, height: 100, rgb });
        let heard = json!({ "Ok": { "size_px": [100, 100] } });
        let shot = Some(Shot::Scanner(picture));
        recorder.record_entry(Entry { shot, ..line(Topic::Camera, json!("picture"), heard) });
    }
}

/// Returns a disk that hangs until it is released; the beginning of the file is written before.
fn hanging() -> (Disk, Sender<()>, Writer<Disk>) {
    let disk = Disk::new();
    let (go, wait) = channel();
    // More permissions than the beginning of the file needs.
    (0..10_000).for_each(|_| go.send(()).expect("sent"));
    let wait = Arc::new(Mutex::new(wait));
    let disk = Disk { go: Some(wait.clone()), ..disk };
    let writer = begun(&disk);
    wait.lock().expect("whole").try_iter().for_each(drop);
    (disk, go, writer)
}

#[test]
fn by_the_wall_clock_no_thread_waits_and_a_full_queue_is_a_gap() {
    let (disk, go, writer) = hanging();
    let recording = recording(writer, false, || u64::MAX);
    put_pictures(&recording.recorder(), 200);
    drop(go);
    let written = recording.finish();
    let TapeError::Lost { topic: "/camera", count, .. } = check_recording(&disk.bytes()[..]).expect_err("a gap")
    else {
        panic!("{written:?}")
    };
    assert_eq!((written.is, written.entries + count), (RecordingStatus::NotWhole, 200));
    assert!(
        written
            .message
            .contains(&format!("a.mcap cannot be replayed: the recording has a gap; not recorded: {count} of"))
    );
}

#[test]
fn in_lock_step_the_loop_waits_while_the_queue_is_full() {
    let disk = Disk::new();
    let recording = recording(begun(&disk), true, || u64::MAX);
    put_pictures(&recording.recorder(), 50);
    let written = recording.finish();
    assert_eq!((written.entries, written.is), (50, RecordingStatus::Whole), "{}", written.message);
    assert_eq!(check_recording(&disk.bytes()[..]).expect("whole").entries, 50);
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let disk = Disk { refuses_after: 20_000, ..Disk::new() };
    let recording = recording(begun(&disk), true, || u64::MAX);
    // The call returns, because it does not wait for a queue that is no longer emptied.
    put_pictures(&recording.recorder(), 2_000);
    let written = recording.finish();
    assert!(written.is == RecordingStatus::NotWhole && written.message.contains("no space left"), "{written:?}");
}

/// Even in lock step, the loop does not wait a second time for a disk that accepts no data.
#[test]
fn a_disk_that_hangs_makes_a_gap_in_lock_step_too() {
    let (disk, go, writer) = hanging();
    let recording = recording(writer, true, || u64::MAX);
    put_pictures(&recording.recorder(), 200);
    drop(go);
    assert_eq!(recording.finish().is, RecordingStatus::NotWhole);
    assert!(matches!(check_recording(&disk.bytes()[..]), Err(TapeError::Lost { .. })));
}

/// The caller that ends the recording (the end of the service, or the page of the next cycle) does not wait for a disk
/// that hangs.
#[test]
fn the_end_does_not_wait_for_a_disk_that_hangs() {
    let (_disk, go, writer) = hanging();
    let room = Box::new(|| Ok(u64::MAX));
    let bounds = bounds(false, Duration::from_millis(50));
    let recording =
        Recording::start("a.mcap".to_owned(), move || Ok(writer), (bounds, None), room).expect("started");
    put_pictures(&recording.recorder(), 3);
    let written = recording.finish();
    assert!(
        written.is == RecordingStatus::NotWhole
            && written.message.ends_with("the disk of the recording accepted no data for 0.05 s; check the disk"),
        "{written:?}"
    );
    drop(go);
}

/// The file ends with the reason; the entries before the reason can be read.
#[test]
fn too_little_free_space_ends_the_recording_with_its_reason() {
    let disk = Disk::new();
    let recording = recording(begun(&disk), true, || MIN_FREE_SPACE_FOR_RECORDING_MB - 1);
    put_pictures(&recording.recorder(), 2_000);
    let written = recording.finish();
    let words = "the disk of the recording has 1999 MB of free space (minimum 2000 MB); delete files";
    assert!(written.is == RecordingStatus::NotWhole && written.message.ends_with(words), "{written:?}");
    let error = check_recording(&disk.bytes()[..]).expect_err("stopped");
    assert!(matches!(error, TapeError::Stopped { .. }) && error.to_string().ends_with(words), "{error}");

    let disk = Disk::new();
    let mut looks = 0_u64;
    let fills = move || {
        looks += 1;
        MIN_FREE_SPACE_FOR_RECORDING_MB + 2 - looks
    };
    let recording = recording_of(&disk, fills);
    // The free space is measured again once a second.
    while recording.status().is == RecordingStatus::UnderWay {
        put_pictures(&recording.recorder(), 1);
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(recording.finish().entries > 0);
    assert!(matches!(check_recording(&disk.bytes()[..]), Err(TapeError::Stopped { until_s, .. }) if until_s > 0.0));
}

fn recording_of(disk: &Disk, room_mb: impl FnMut() -> u64 + Send + 'static) -> Recording {
    recording(begun(disk), true, room_mb)
}

#[test]
fn a_file_that_cannot_be_made_is_reported() {
    let open = || -> Result<Writer<Disk>, TapeError> {
        let source = io::Error::from(io::ErrorKind::AlreadyExists).into();
        Err(TapeError::Disk { doing: "made", source })
    };
    let room = Box::new(|| Ok(u64::MAX));
    let recording =
        Recording::start("a.mcap".to_owned(), open, (QueueBounds::new(true), None), room).expect("started");
    put_pictures(&recording.recorder(), 50);
    let written = recording.finish();
    assert!(
        written.is == RecordingStatus::NotWhole && written.message.contains("the recording cannot be made"),
        "{written:?}"
    );
}

/// A loop that has run for an hour begins a recording. Expected: the times of the recording begin at zero.
#[test]
fn time_begins_with_the_recording() {
    let disk = Disk::new();
    let recording = recording(begun(&disk), true, || u64::MAX);
    let hour_ns = 3_600_000_000_000;
    let recorder = recording.recorder();
    assert!(recorder.clock(hour_ns) && !recorder.clock(hour_ns), "the first reading is news");
    assert!(recorder.clock(hour_ns + 250_000_000));
    recorder.record_entry(line(Topic::Request, Value::Null, json!("leave")));
    assert_eq!(recording.finish().is, RecordingStatus::Whole);
    let length_s = check_recording(&disk.bytes()[..]).expect("whole").length_s;
    assert!((length_s - 0.25).abs() < 1e-6, "{length_s}");
}

fn player(entries: Vec<Entry>) -> Player<'static> {
    Player::new(entries.into_iter().map(Ok), true)
}

fn ended(said: &str) -> Command {
    let pose = KukaPose { x_mm: if said == "same" { 1.5 } else { 1.75 }, ..KukaPose::default() };
    Command::SetBase(pose)
}

#[test]
fn equal_commands_are_no_difference_and_have_the_recorded_answer() {
    let sent = || line(Topic::Command, json!({ "send": ended("same") }), json!({ "Ok": 4 }));
    let refused = line(
        Topic::Command,
        json!("abort"),
        to_json(&Err::<(), _>(QueueError::FramesNotSet { missing: "a recipe" })),
    );
    let report = line(Topic::Report, Value::Null, to_json(&Report::Progress { done: CommandId(4) }));
    let mut player = player(vec![sent(), report, refused]);
    assert!(next_report(&mut player).is_none(), "a command comes first");
    assert_eq!(player.send(ended("same")), Ok(CommandId(4)));
    assert_eq!(next_report(&mut player), Some(Report::Progress { done: CommandId(4) }));
    assert_eq!(player.abort(), Err(QueueError::FramesNotSet { missing: "a recipe" }));
    let played = player.replay_result();
    assert!(played.is_complete && played.differences.is_empty() && played.error.is_none(), "{played:?}");
}

#[test]
fn another_number_is_a_difference_and_the_replay_continues() {
    let sent = line(Topic::Command, json!({ "send": ended("same") }), json!({ "Ok": 4 }));
    let mut player = player(vec![sent]);
    assert_eq!(player.send(ended("other")), Ok(CommandId(4)));
    let played = player.replay_result();
    assert!(played.is_complete);
    let [difference] = played.differences.as_slice() else { panic!("{played:?}") };
    assert_eq!(difference.to_string(), "0.000 s, /robot/command send.set_base.x_mm: recorded 1.5, now 1.75");
}

/// Returns the next report that the player sends.
fn next_report(player: &mut Player) -> Option<Report> {
    RobotPort::next(player).expect("no thread is lost")
}

/// Returns whether the player sends a request to the state table; with this request, a replay that has diverged ends
/// the loop.
fn asks(player: &mut Player) -> bool {
    let next = RequestPort::next(player, &State::INITIAL).expect("no thread is lost");
    matches!(next, Some(Request { what: RequestKind::Table(_), .. }))
}

#[test]
fn another_call_or_none_ends_the_replay() {
    let abort = || line(Topic::Command, json!("abort"), json!({ "Ok": null }));
    let mut other = player(vec![abort()]);
    assert!(other.send(ended("same")).is_err());
    assert!(next_report(&mut other).is_none() && asks(&mut other));
    let played = other.replay_result();
    assert!(!played.is_complete && played.differences.len() == 1, "{played:?}");
    assert!(played.differences[0].now.starts_with("/robot/command {\"send\""), "{played:?}");

    let mut waiting = player(vec![abort()]);
    let asked: Vec<bool> = (0..10).map(|_| asks(&mut waiting)).collect();
    assert_eq!(asked.last(), Some(&true), "it does not wait for ever");
    assert!(waiting.replay_result().differences[0].now.contains("waits"));

    let left = player(vec![abort()]).replay_result();
    assert!(!left.is_complete && left.differences[0].now.contains("ended"), "{left:?}");
}

/// A camera call that the loop no longer makes is a difference, even if it had no result at that time.
#[test]
fn a_missing_camera_call_is_a_difference() {
    let look = || line(Topic::Camera, json!("picture"), to_json(&Err::<(), _>("blind")));
    let result = || Entry { at_ns: 5, ..line(Topic::Result, Value::Null, json!(7)) };
    let mut later = player(vec![look(), result()]);
    assert!(later.admit_requests(Id(7)));
    let played = later.replay_result();
    assert!(!played.is_complete, "{played:?}");
    assert_eq!(
        played.differences[0].to_string(),
        "0.000 s, request to the cameras: recorded \"picture\", now nothing"
    );
    // With the wall clock, the loop may end while a camera command is in progress.
    assert!(player(vec![look()]).replay_result().differences.is_empty());
}

/// A result that is computed in parallel with the loop arrives at the recorded time and not before. A different result
/// does not arrive.
#[test]
fn a_result_arrives_at_its_recorded_time() {
    let reports = || line(Topic::Report, Value::Null, to_json(&Report::Progress { done: CommandId(4) }));
    let result = line(Topic::Result, Value::Null, json!(7));
    let mut player = player(vec![reports(), result]);
    assert!(!player.admit_requests(Id(7)), "a report comes first");
    assert!(next_report(&mut player).is_some());
    assert!(!player.admit_requests(Id(8)) && player.admit_requests(Id(7)) && !player.admit_requests(Id(7)));
    assert!(player.replay_result().is_complete);
}

#[test]
fn elapsed_times_are_not_compared_but_their_limits_are() {
    let found = |ms: f64, mm: f64| {
        let numbers = [Check::new(name::SCAN_TO_VERDICT, "ms", ms), Check::new("residual", "mm", mm)];
        Finding::new(Kind::Locate, 0, Judgement::new(vec![], vec![])).with_checks(numbers)
    };
    let finding = |ms, mm| RecordCommand::Note(Note::Finding(found(ms, mm)));
    let recorded = || line(Topic::Finding, to_json(&found(10.0, 0.25)), json!({ "Ok": null }));
    let mut same = player(vec![recorded()]);
    same.perform_and_forget(finding(99.0, 0.25)).expect("kept");
    assert!(same.replay_result().differences.is_empty());
    let mut other = player(vec![recorded()]);
    other.perform_and_forget(finding(10.0, 0.25000000000000006)).expect("kept");
    let played = other.replay_result();
    assert_eq!(played.differences.len(), 1);
    assert_eq!(played.differences[0].what, "/cycle/finding numbers.residual.value");
}
