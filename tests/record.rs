//! Tests the record after an unplanned end: unknown facts are stated as unknown, and no page is missing.

use super::commands::json;
use super::service::{START, Service, taught};
use panelprep::cycle::Path as MotionPath;
use panelprep::record::{CycleId, CycleRecord, MotionRecord};
use panelprep::store::Store;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const TIMEOUT: Duration = Duration::from_secs(240);

fn record(folder: &Path, cycle: i64) -> CycleRecord {
    let store = Store::open(&folder.join("cell/store")).expect("the store opens");
    store.cycle(CycleId(cycle)).expect("the cycle is there")
}

fn page_file(folder: &Path, cycle: i64) -> PathBuf {
    folder.join(format!("cell/store/reports/cycle-{cycle:06}.html"))
}

/// Returns a page without the line with its creation time.
fn page(folder: &Path, cycle: i64) -> String {
    let text = std::fs::read_to_string(page_file(folder, cycle)).expect("its page");
    assert!(text.ends_with("</html>\n"), "it is whole");
    assert_eq!(text.matches("This page was made on ").count(), 1);
    text.lines().filter(|line| !line.contains("This page was made on ")).collect::<Vec<_>>().join("\n")
}

/// Returns the present phase, requested without a separate process, which would take longer than a contact.
fn phase(folder: &Path) -> String {
    let ask = || -> std::io::Result<String> {
        let mut socket = UnixStream::connect(folder.join("cell/store/panelprep.sock"))?;
        socket.write_all(b"{\"ask\":\"state\"}\n")?;
        let mut line = String::new();
        BufReader::new(socket).read_line(&mut line)?;
        Ok(line)
    };
    let state: serde_json::Value = serde_json::from_str(&ask().unwrap_or_default()).unwrap_or_default();
    state["phase"].as_str().unwrap_or_default().to_owned()
}

/// Starts a cycle, and kills the service this time after the beginning of the sanding.
fn killed_in_contact(folder: &Path, after: Duration) -> MotionRecord {
    let service = Service::start(folder);
    if service.state() == "aborted" {
        service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
        service.reach("stopped");
    }
    service.reset();
    let cycle = service.done(START)["cycle_id"].as_i64().expect("a cycle");
    let since = Instant::now();
    while phase(folder) != "abrade" {
        assert!(since.elapsed() < TIMEOUT, "it never abrades: {:?}", service.ctl("state"));
    }
    std::thread::sleep(after);
    service.kill_and_wait();
    let service = Service::start(folder);
    service.wait("its page is written", |_| page_file(folder, cycle).exists());
    drop(service);
    record(folder, cycle).motions.pop().expect("it moved")
}

/// After a kill in contact it is not known what happened on the panel. The page names the grids that may have been
/// touched, and states the minimum and maximum distance along the path. Later cycles of the panel count these grids as
/// sanded until no further pass is permitted.
#[test]
fn a_kill_in_contact_leaves_grids_that_are_counted_as_sanded() {
    let folder = taught("good");
    let folder = folder.path();
    let mut cycle = 0;
    let mut hits = Vec::new();
    for after_ms in [0, 70, 120, 200, 300, 150, 100, 250] {
        cycle += 1;
        let motion = killed_in_contact(folder, Duration::from_millis(after_ms));
        let page = page(folder, cycle);
        assert_eq!(page.matches("(interrupted)").count(), 2, "once as the reason, once where it was found: {page}");
        if motion.motion.path != MotionPath::Contact {
            // The kill came before the contact, or on a busy computer after it. In the second case the end of the
            // motion is known.
            let came_late = record(folder, cycle).motions.iter().any(|one| one.motion.path == MotionPath::Contact);
            assert_eq!(page.contains("Nothing: the tool touched no grid."), !came_late, "{motion:?}");
            if came_late {
                hits.push(cycle);
            }
            if hits.len() == 2 {
                break;
            }
            continue;
        }
        if motion.is_end_reported() {
            // The service was killed immediately after the robot had reported the end of the path.
            let done = format!("{} of {} waypoints", motion.done, motion.motion.waypoints);
            assert!(page.contains(&done), "no {done} in\n{page}");
            hits.push(cycle);
            if hits.len() == 2 {
                break;
            }
            continue;
        }
        let executed = motion.executed_bounds().expect("it was bounded");
        if executed.at_most == 0 {
            // The kill came between the journal's entry and the motion's row: nothing was permitted yet.
            assert!(page.contains("no part of the motion was released for sending"), "{page}");
            assert!(page.contains("Nothing: the tool touched no grid."), "{page}");
            continue;
        }
        let bounds = format!(
            "the end of the motion is unknown: at least {} and at most {} of {} waypoints were executed",
            executed.at_least, executed.at_most, motion.motion.waypoints
        );
        assert!(page.contains(&bounds), "no {bounds} in\n{page}");
        assert!(!page.contains("the tool touched no grid"), "{page}");
        let touched = motion.touched_grids().expect("it was kept");
        assert!(!touched.is_empty(), "{motion:?}");
        for grid in touched {
            let words = if grid.is_sure { "touched, extent unknown" } else { "possibly touched, not confirmed" };
            assert!(
                page.contains(&format!("<td>{}</td><td>pass 1: {words}", grid.grid)),
                "{} in\n{page}",
                grid.grid
            );
        }
        hits.push(cycle);
        if hits.len() == 2 {
            break;
        }
    }
    assert_eq!(hits.len(), 2, "kills hit contact");
    // The recipe permits two passes: the next cycle detects the grease and may not sand these grids again.
    let service = Service::start(folder);
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    service.reset();
    service.done(START);
    service.reach("complete");
    let ended = record(folder, cycle + 1);
    let store = Store::open(&folder.join("cell/store")).expect("opens");
    let twice: Vec<String> = {
        let earlier = store.earlier_abrasions(CycleId(cycle + 1)).expect("read");
        let count = |grid: &Option<String>| earlier.iter().filter(|other| other.grid == *grid).count();
        earlier.iter().filter(|one| count(&one.grid) >= 2).filter_map(|one| one.grid.clone()).collect()
    };
    assert!(!twice.is_empty(), "the same place was come to twice");
    for motion in ended.motions.iter().filter(|motion| motion.motion.path == MotionPath::Contact) {
        let grids = &motion.contact.as_ref().expect("kept").path.grids;
        assert!(grids.iter().all(|reached| !twice.contains(&reached.grid)), "{grids:?} of {twice:?}");
    }
}

/// Verdict and page are written one after the other. If the program ends in between, the next start creates the page
/// that the first program would have written. `panelprep page` creates the same page.
#[test]
fn a_page_that_was_not_written_is_made_at_the_next_start() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done("new-disc");
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    assert_eq!(service.ctl("accept").0, 2, "nothing waits for a person");
    service.reach("complete");
    service.wait("its page", |_| page_file(folder, 1).exists());
    let written = page(folder, 1);
    for part in
        ["<td>new-disc: done", "REFUSED: accept", "start: done", "through the service's socket", "Simulated time: "]
            .map(|part| part.replace("<td>", ""))
    {
        assert!(written.contains(&part), "no {part} in\n{written}");
    }
    // The disk does not accept the page, and the process ends: the verdict is stored without a page.
    let reports = folder.join("cell/store/reports");
    std::fs::remove_dir_all(&reports).expect("removed");
    std::fs::write(&reports, "no folder").expect("in its place");
    service.reset();
    service.done(START);
    service.reach("complete");
    assert_eq!(record(folder, 2).judgement.map(|judgement| judgement.verdict.keyword()), Some("pass"));
    service.kill_and_wait();
    std::fs::remove_file(&reports).expect("removed");
    // After a power failure, one page is half written, and the other page is missing.
    std::fs::create_dir_all(&reports).expect("made");
    std::fs::write(page_file(folder, 1), &written[..written.len() / 2]).expect("half of it");

    let service = Service::start(folder);
    let is_whole =
        |cycle| std::fs::read_to_string(page_file(folder, cycle)).is_ok_and(|text| text.ends_with("</html>\n"));
    service.wait("both pages", |_| is_whole(1) && is_whole(2));
    assert_eq!(page(folder, 1), written, "the same page");
    let second = page(folder, 2);
    let (exit, made) = json(folder, "page 2 --cell cell/cell.toml --out again.html");
    assert_eq!((exit, &made["ok"], &made["found"]), (0, &true.into(), &serde_json::json!([])), "{made}");
    assert_eq!((&made["cycle_verdict"], &made["cycle_id"]), (&"pass".into(), &2.into()), "{made}");
    std::fs::copy(folder.join("again.html"), page_file(folder, 2)).expect("copied");
    assert_eq!(page(folder, 2), second, "the command makes the same");
    let (exit, none) = json(folder, "page 9 --cell cell/cell.toml");
    let words = none["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && words.contains("no cycle 9"), "{none}");
}

/// The service is killed as soon as the store contains the verdict, whatever the state of the page is then.
#[test]
fn a_kill_at_the_verdict_leaves_no_cycle_without_a_page() {
    let folder = taught("clean");
    let folder = folder.path();
    for cycle in 1..=2 {
        let service = Service::start(folder);
        if service.state() == "aborted" {
            service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
            service.reach("stopped");
        }
        service.reset();
        service.done(START);
        let since = Instant::now();
        while record(folder, cycle).judgement.is_none() {
            assert!(since.elapsed() < TIMEOUT, "no verdict");
        }
        service.kill_and_wait();
        let had = page_file(folder, cycle).exists();
        let service = Service::start(folder);
        service.wait("its page", |_| page_file(folder, cycle).exists());
        eprintln!("cycle {cycle}: the page was {}", if had { "written" } else { "not written" });
        assert!(page(folder, cycle).contains("<b>pass</b>"));
    }
}
