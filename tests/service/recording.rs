//! Tests cycles of the service that are recorded, and replayed without a difference.

use super::super::commands::json;
use super::{START, Service, taught};
use panelprep::tape::{TapeError, check_recording};
use serde_json::Value;
use std::path::Path;

/// Sets two pictures of the film per second in the cell's recipe, and adds tables. With one picture per second or
/// fewer, some films do not decide whether a sanded place is clean. The time at which a person accepts the plan would
/// then decide which film is captured.
fn slow_film(folder: &Path, more: &str) {
    let file = folder.join("cell/recipe.toml");
    let text = std::fs::read_to_string(&file).expect("rendered");
    let slow = text.replace("frames_per_second = 5.0", "frames_per_second = 2.0");
    assert_ne!(text, slow);
    std::fs::write(file, format!("{slow}\n{more}")).expect("written");
}

/// Waits until the recording of the last cycle is written, and replays it.
pub fn replays(service: &Service, folder: &Path, verdict: &str) -> String {
    service.wait("its recording is written", |service| service.done("state")["recording"]["is"] != "under_way");
    let recording = service.done("state")["recording"].clone();
    assert_eq!(recording["is"], "whole", "{recording}");
    let file = recording["file"].as_str().expect("a file").to_owned();
    let (exit, told) = json(folder, &format!("replay {file}"));
    assert_eq!((exit, &told["same"], &told["cycle_verdict"]), (0, &true.into(), &verdict.into()), "{told}");
    file
}

/// One cycle that a person holds, and one whose result a person accepts, are recorded while the service continues; both
/// replay without a difference. Pages and `ctl state` name the files.
#[test]
fn cycles_of_the_service_are_recorded_and_replay() {
    let folder = taught("good");
    let folder = folder.path();
    // The disc is worn before the cycle begins, so that a person must decide about the plan.
    slow_film(folder, "[path]\ndisc_life_mm2 = 1000.0\n");
    let service = Service::start(folder);
    service.reset();
    let taken = "already exists; remove it, or record to another file";
    service.refused(&format!("{START} --record cell/cell.toml"), 2, taken);
    service.refused(&format!("{START} --record nowhere/at/all/a.mcap"), 2, "no such folder");
    assert_eq!(service.done("state")["recording"], Value::Null, "nothing began");

    let started = service.done(&format!("{START} --record"));
    let named = started["recording"]["file"].as_str().expect("a file").to_owned();
    assert!(named.ends_with("cell/store/recordings/cycle-000001.mcap"), "{named}");
    service.reach("held");
    assert!(service.done("state")["reasons"].to_string().contains("disc"), "a worn disc");
    service.refused(START, 2, "start is not possible in state held");
    service.done("new-disc");
    // A person accepts the reach of the arm and each plan.
    service.wait("its end", |service| {
        let state = service.state();
        if state == "held" {
            service.done("accept");
        }
        state == "complete"
    });
    assert_eq!(replays(&service, folder, "pass"), named);
    let page = std::fs::read_to_string(folder.join("cell/store/reports/cycle-000001.html")).expect("its page");
    assert!(page.contains("Recording") && page.contains("cycle-000001.mcap"));

    service.reset();
    service.done(&format!("{START} --record here.mcap"));
    service.wait("work", |service| service.state() == "execute");
    service.done("hold");
    service.reach("held");
    service.done("stop");
    service.reach("stopped");
    assert_eq!(
        replays(&service, folder, "aborted"),
        folder.canonicalize().expect("it is there").join("here.mcap").display().to_string()
    );
    service.reset();
    assert_eq!(service.done(START)["recording"], Value::Null, "the next one is not recorded");
    service.done("abort");
}

/// A service that is killed leaves a recording up to its last complete chunk, and a replay reports that it is
/// truncated.
#[test]
fn a_killed_service_leaves_a_truncated_recording() {
    let folder = taught("good");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done(&format!("{START} --record cut.mcap"));
    let file = folder.join("cut.mcap");
    let whole = || match check_recording(&std::fs::read(&file).unwrap_or_default()[..]) {
        Err(TapeError::Unfinished { entries, .. }) => entries,
        Err(TapeError::NotMcap { .. }) => 0,
        other => panic!("the cycle has ended: {other:?}"),
    };
    service.wait("some entries", |_| whole() > 50);
    service.kill_and_wait();
    let entries = whole();
    assert!(entries > 50, "{entries}");
    let (exit, output) = json(folder, "replay cut.mcap");
    let reason = output["reasons"][0]["message"].as_str().expect("words");
    let words = format!("with {entries} complete entries; the program that wrote it ended too early");
    assert!(exit == 2 && reason.contains("cut.mcap") && reason.contains(&words), "{output}");
    // The next service may record again, and its cycle has another number.
    let service = Service::start(folder);
    if service.state() == "aborted" {
        service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
        service.reach("stopped");
    }
    service.reset();
    service.refused(&format!("{START} --record cut.mcap"), 2, "already exists");
}
