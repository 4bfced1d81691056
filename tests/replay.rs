//! Tests the replay of recorded cycles: `fixtures/` contains recordings that `--record` wrote.

use panelprep::tape::{Entry, EntryReader, RecordingEnd, Shot, Topic, Writer, check_recording};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

/// The recording of a whole cycle, in which grease is detected, sanded and tested again; `REJECTED` is the recording of
/// another panel, which is rejected.
const WHOLE_CYCLE: &str = "cycle.mcap";
const REJECTED: &str = "rejected.mcap";

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn replay(file: &Path) -> (i32, Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    let output = command.args(["replay", "--json"]).arg(file).stderr(Stdio::null()).output().expect("it starts");
    let told = serde_json::from_slice(&output.stdout).expect("one JSON object");
    (output.status.code().expect("an exit code"), told)
}

/// Copies a recording with changed entries into a separate folder.
fn changed(name: &str, mut change: impl FnMut(&mut Entry)) -> (tempfile::TempDir, PathBuf) {
    let bytes = fs::read(fixture(name)).expect("the fixture");
    let checked = check_recording(&bytes[..]).expect("whole");
    let files: Vec<_> = checked.files.into_iter().collect();
    let mut writer = Writer::begin_recording(Vec::new(), &checked.start, &files, &[], &[]).expect("begun");
    for entry in EntryReader::new(&bytes[..], checked.start.unix_ns) {
        let mut entry = entry.expect("read");
        change(&mut entry);
        writer.write(&entry).expect("written");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("changed.mcap");
    fs::write(&file, writer.finish(&RecordingEnd::default()).expect("finished")).expect("written");
    (folder, file)
}

fn differences(told: &Value) -> Vec<&str> {
    let differences = told["differences"].as_array().expect("a list").iter();
    differences.map(|difference| difference["what"].as_str().expect("words")).collect()
}

#[test]
fn a_recorded_cycle_replays_twice_without_a_difference() {
    for _ in 0..2 {
        let (exit, told) = replay(&fixture(WHOLE_CYCLE));
        assert_eq!((exit, &told["same"], &told["verdict"]), (0, &true.into(), &"pass".into()), "{told}");
        assert_eq!((&told["cycle_verdict"], &told["to_the_end"]), (&"pass".into(), &true.into()), "{told}");
        assert!(told["entries"].as_u64().is_some_and(|entries| entries > 100), "{told}");
    }
}

/// The replay passes. The cycle of the other panel was rejected, and the reported verdict is that of the cycle.
#[test]
fn the_verdict_of_a_replayed_cycle_is_reported_as_the_cycles() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    let output = command.arg("replay").arg(fixture(REJECTED)).stderr(Stdio::null()).output().expect("it starts");
    let told = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(told.starts_with("replay: the same as recorded\n"), "{told}");
    assert!(told.contains("the cycle's verdict: reject\n") && !told.contains("verdict: pass"), "{told}");
}

#[test]
fn a_recording_written_again_is_the_same_cycle() {
    let (_folder, file) = changed(REJECTED, |_| {});
    let (exit, told) = replay(&file);
    assert_eq!((exit, &told["same"], &told["cycle_verdict"]), (0, &true.into(), &"reject".into()), "{told}");
}

/// Each point of the scan is 0.01 mm farther away: the findings differ, and the replay reports this.
#[test]
fn a_changed_scan_changes_the_findings() {
    let (_folder, file) = changed(REJECTED, |entry| {
        if let Some(Shot::Points(cloud)) = &mut entry.shot {
            let farther = cloud.raw_points_mm().iter().map(|&[x, y, z]| [x, y, z + 0.01]).collect();
            let (width, height, colors) = (cloud.width(), cloud.height(), cloud.picture().rgb);
            let moved = panelprep::geometry::OrganizedCloud::new(width, height, farther, colors);
            *cloud = Arc::new(moved.expect("organised"));
        }
    });
    let (exit, told) = replay(&file);
    assert_eq!((exit, &told["same"], &told["verdict"]), (1, &false.into(), &"fail".into()), "{told}");
    // The differences are in findings and in the pictures and values stored with them, not in commands or events.
    let kept = |what: &&str| ["/cycle/finding", "/cycle/store"].iter().any(|topic| what.starts_with(topic));
    assert!(differences(&told).iter().all(kept), "{told}");
    assert!(differences(&told).iter().any(|what| what.starts_with("/cycle/finding")), "{told}");
}

/// The recorded command sends the robot to another position: exactly this number differs.
#[test]
fn a_changed_command_is_reported_with_both_numbers() {
    let mut done = false;
    let (_folder, file) = changed(REJECTED, |entry| {
        if let Some(angle) = entry.action.pointer_mut("/send/move_j/joints/a2_deg").filter(|_| !done) {
            (*angle, done) = (12.5.into(), true);
        }
    });
    assert!(done, "the arm parks");
    let (exit, told) = replay(&file);
    assert_eq!((exit, differences(&told)), (1, vec!["/robot/command send.move_j.joints.a2_deg"]), "{told}");
    assert_eq!(told["differences"][0]["recorded"], "12.5");
    assert_eq!(told["to_the_end"], true);
}

/// A person's request is changed: recording and replay diverge, and the replay reports the point at which they diverge.
#[test]
fn a_changed_request_makes_recording_and_replay_diverge() {
    let (_folder, file) = changed(REJECTED, |entry| {
        if entry.topic == Topic::Request && entry.reply.pointer("/for/start").is_some() {
            entry.reply = serde_json::json!({ "for": "abort" });
        }
    });
    let (exit, told) = replay(&file);
    assert_eq!((exit, &told["same"], &told["to_the_end"]), (1, &false.into(), &false.into()), "{told}");
    assert!(told["differences"][0]["what"].as_str().is_some_and(|what| what.starts_with("/cycle/event")), "{told}");
}

#[test]
fn a_recording_that_cannot_be_replayed_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("bad.mcap");
    let bytes = fs::read(fixture(REJECTED)).expect("the fixture");
    let cut = bytes.len() * 3 / 4;
    let scan = fs::read(fixture("pcl/shot_ascii.pcd")).expect("the fixture");
    for (bytes, words) in
        [(&bytes[..cut], "was not finished"), (&scan[..], "not an MCAP file"), (&bytes[..0], "not an MCAP")]
    {
        fs::write(&file, bytes).expect("written");
        let (exit, told) = replay(&file);
        assert_eq!((exit, &told["verdict"]), (2, &Value::Null), "{told}");
        let reason = told["reasons"][0]["message"].as_str().expect("words");
        assert!(reason.contains(words) && reason.contains("bad.mcap"), "{reason}");
    }
    assert_eq!(replay(&folder.path().join("none.mcap")).0, 2);
}
