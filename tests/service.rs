//! The service as its users meet it: `panelprep run` on a simulated cell, `panelprep ctl` beside it, signals, and the
//! end that no program can catch.

use super::commands::{TEACH, VERIFY, json, rendered, taught_and_verified};
use panelprep::cycle::Path::Corner;
use panelprep::cycle::{At, Event, Report, Request, State};
use panelprep::store::Store;
use panelprep::tape::{TapeError, check};
use rand::{RngExt, SeedableRng};
use serde_json::Value;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Long enough for a busy machine; nothing here measures time.
const PATIENCE: Duration = Duration::from_secs(120);

/// A service that runs; killed when the test ends.
pub struct Service {
    child: Child,
    folder: PathBuf,
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Service {
    /// Starts it and waits until it answers.
    pub fn start(folder: &Path) -> Self {
        Service::start_with(folder, &[])
    }

    /// The same with more in its environment.
    pub fn start_with(folder: &Path, environment: &[(&str, &str)]) -> Self {
        Service::start_from(env!("CARGO_BIN_EXE_panelprep").as_ref(), folder, environment)
    }

    /// The same from a file of its own.
    pub fn start_from(program: &Path, folder: &Path, environment: &[(&str, &str)]) -> Self {
        let mut command = Command::new(program);
        command.envs(environment.iter().copied());
        Service::start_command(command, folder, &[])
    }

    /// The same with more in what is simulated.
    pub fn start_simulating(folder: &Path, more: &[&str]) -> Self {
        Service::start_command(Command::new(env!("CARGO_BIN_EXE_panelprep")), folder, more)
    }

    fn start_command(mut command: Command, folder: &Path, more: &[&str]) -> Self {
        let log =
            std::fs::OpenOptions::new().create(true).append(true).open(folder.join("run.log")).expect("a log");
        let child = command
            .args(["run", "--cell", "cell/cell.toml", "--seed", "3"])
            .args(more)
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("the program starts");
        let service = Service { child, folder: folder.to_owned() };
        service.wait("it answers", |service| service.ctl("state").0 == 0);
        service
    }

    pub fn ctl(&self, ask: &str) -> (i32, Value) {
        json(&self.folder, &format!("ctl {ask} --cell cell/cell.toml"))
    }

    pub fn state(&self) -> String {
        self.ctl("state").1["state"].as_str().unwrap_or_default().to_owned()
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("run.log")).unwrap_or_default()
    }

    pub fn wait(&self, what: &str, mut until: impl FnMut(&Self) -> bool) {
        let since = Instant::now();
        while !until(self) {
            assert!(since.elapsed() < PATIENCE, "{what} never came; {:?}\n{}", self.ctl("state"), self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn reach(&self, state: &str) {
        self.wait(state, |service| service.state() == state);
    }

    /// Asks, and it is done.
    pub fn done(&self, ask: &str) -> Value {
        let (exit, answer) = self.ctl(ask);
        assert_eq!(exit, 0, "{ask}: {answer}\n{}", self.log());
        answer
    }

    /// Asks, and it is refused with these words.
    pub fn refused(&self, ask: &str, exit: i32, words: &str) {
        let (found, answer) = self.ctl(ask);
        let message = answer["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(found == exit && message.contains(words), "{ask}: {found} {answer}");
    }

    pub fn reset(&self) {
        // The robot's link may still be on its way.
        self.wait("a reset is taken", |service| service.ctl("reset --wait").0 == 0);
        assert_eq!(self.state(), "idle", "it was waited for");
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        let id = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(id, signal).expect("it is there");
    }

    pub fn ended(mut self) -> ExitStatus {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("its status") {
                return status;
            }
            assert!(since.elapsed() < PATIENCE, "it does not end\n{}", self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn killed(mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("gone");
    }
}

pub const START: &str = "start --recipe cell/recipe.toml";

/// A taught cell with verified cameras in a folder of its own.
pub fn taught(scene: &str) -> TempDir {
    let folder = rendered(scene);
    taught_and_verified(folder.path());
    folder
}

fn journal(folder: &Path) -> Vec<Event> {
    Store::open(&folder.join("cell/store")).expect("the store opens").journal().expect("its journal is whole")
}

pub fn socket(folder: &Path) -> PathBuf {
    folder.join("cell/store/panelprep.sock")
}

/// The cameras are the service's while it runs: it takes the pictures, and none while a cycle is under way.
#[test]
fn shots_are_taken_by_the_service_while_the_cell_rests() {
    let folder = taught("good");
    let folder = folder.path();
    let service = Service::start(folder);
    let shoot = |what: &str| json(folder, &format!("shoot --cell cell/cell.toml {what}"));
    service.reset();
    let (exit, told) = shoot("corner --out shots");
    assert!(exit == 0 && folder.join("shots/corner_0001.json").is_file(), "{told}");
    let (exit, told) = shoot("film --seconds 1 --pictures-per-second 4 --out film");
    assert!(exit == 0 && told["pictures"].as_f64() >= Some(3.0) && told["dropped"] == 0, "{told}");
    assert!(folder.join("film/clip.csv").is_file());
    let (exit, told) = shoot("scan --out shots");
    assert!(exit == 2 && told["reasons"].to_string().contains("standing parked"), "the arm is in the way: {told}");
    assert!(json(folder, "doctor --cell cell/cell.toml").1.to_string().contains("idle"));

    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    let (exit, told) = shoot("corner --out during");
    assert!(exit == 2 && told["reasons"].to_string().contains("the cell is at work"), "{told}");
    assert!(!folder.join("during").exists());
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass", "nobody disturbed it");

    // The arm is parked now.
    let (exit, told) = shoot("scan --out shots");
    assert!(exit == 0 && told["shots"][0]["points"].as_f64() > Some(10_000.0), "{told}");
    let is_there = |ending: &str| folder.join(format!("shots/scan_0001.{ending}")).is_file();
    assert!(["pcd", "ply", "png"].into_iter().all(is_there));
    let axes = service.done("state")["axes_deg"].as_array().map(Vec::len);
    assert_eq!(axes, Some(6), "and where it stands is told");
}

/// Two cycles on one service; the second is left by a hold and a stop, and the service by SIGTERM. The cameras are
/// verified while it runs.
#[test]
fn cycles_run_one_after_the_other_and_each_request_is_answered() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    let (exit, nobody) = json(folder, "ctl state --cell cell/cell.toml");
    let words = nobody["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && words.contains("panelprep run"), "{nobody}");

    let service = Service::start(folder);
    assert_eq!(service.done("state")["state"], "stopped");
    service.refused(START, 2, "scanner was never verified; run `panelprep calibrate verify --camera scanner`");
    assert_eq!(VERIFY.map(|look| json(folder, look).0), [0, 0], "the service keeps nobody from looking");
    service.refused(START, 2, "start is not possible in state stopped");
    service.refused("hold", 2, "possible now");
    service.refused("start --recipe cell/cell.toml", 2, "cell/cell.toml");
    service.reset();
    service.refused("clear", 2, "clear is not possible in state idle; possible now: start");
    let started = service.done(START);
    assert_eq!((started["cycle_id"].as_i64(), &started["verdict"]), (Some(1), &Value::Null), "{started}");
    service.refused(START, 2, "start is not possible");
    service.reach("complete");
    let ended = service.done("state");
    assert_eq!((ended["verdict"].as_str(), ended["cycle_id"].as_i64()), (Some("pass"), Some(1)), "{ended}");

    service.reset();
    assert_eq!(service.done(START)["cycle_id"], 2);
    service.wait("work", |service| service.state() == "execute");
    service.done("hold");
    service.reach("held");
    assert!(service.done("state")["reasons"][0]["message"].as_str().is_some_and(|text| text.contains("unhold")));
    service.done("unhold --dried");
    service.wait("work goes on", |service| service.state() == "execute");
    service.done("stop");
    service.reach("stopped");
    assert_eq!(service.done("state")["verdict"], "aborted");
    service.reset();
    service.done(START);
    service.done("abort");
    service.reach("aborted");
    service.refused("reset", 2, "possible now: clear");
    service.done("clear");
    service.reach("stopped");
    service.reset();
    // The same panel, wiped dry: what was abraded holds its film now.
    service.done(START);
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass");

    service.signal(rustix::process::Signal::TERM);
    let log = folder.join("run.log");
    assert_eq!(service.ended().code(), Some(0), "{}", std::fs::read_to_string(log).unwrap_or_default());
    assert!(!socket(folder).exists(), "the socket goes with its service");
    assert_eq!(panelprep::cycle::recover(journal(folder)).at, At::Stopped);
    let store = Store::open(&folder.join("cell/store")).expect("the store opens");
    assert_eq!(store.open_cycles().expect("cycles"), []);
    let pages = std::fs::read_dir(folder.join("cell/store/reports")).expect("pages").count();
    assert_eq!(pages, 4, "one for each cycle");
}

/// SIGTERM in the middle of a cycle is a stop, and its cycle has an end.
#[test]
fn a_signal_stops_the_cycle_and_ends_in_stopped() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.ended().code(), Some(0));
    let events = journal(folder);
    assert!(events.contains(&Event::Asked(Request::Stop)));
    let state = panelprep::cycle::fold(events);
    assert_eq!((state.at, state.intent), (At::Stopped, None));
}

/// One service for each store; what is not the protocol is refused in words and keeps nobody waiting.
#[test]
fn strangers_at_the_socket_do_no_harm() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    let (exit, second) = json(folder, "run --cell cell/cell.toml");
    assert_eq!(exit, 2, "{second}");
    let mut silent: Vec<UnixStream> =
        (0..20).map(|_| UnixStream::connect(socket(folder)).expect("it listens")).collect();
    silent.truncate(3);
    for (line, words) in [
        (&b"abort\n"[..], "not understood"),
        (b"{\"ask\":\"jump\"}\n", "`hold`"),
        (b"{\"ask\":\"abort\",\"now\":1}\n", "now"),
        (&[b'x'; 300_000][..], "longer"),
        (b"\xff\xfe\x00\n", "not understood"),
    ] {
        service.wait("a place is free", |service| service.ctl("state").0 == 0);
        let mut stream = UnixStream::connect(socket(folder)).expect("it listens");
        // It hangs up once it has read enough.
        let _ = stream.write_all(line);
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        assert!(answer.contains(words) && answer.contains("\"refused\""), "{answer}");
    }
    assert_eq!(service.state(), "stopped", "nothing was done");
    use std::os::unix::fs::PermissionsExt;
    let mode = std::fs::metadata(socket(folder)).expect("the socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o660);
    service.killed();
    assert!(socket(folder).exists(), "what a killed service leaves");
    let service = Service::start(folder);
    assert_eq!(service.state(), "stopped", "is replaced by the next one");
}

/// The cell's recipe with one picture of the film every two seconds, and with more tables.
fn slow_film(folder: &Path, more: &str) {
    let file = folder.join("cell/recipe.toml");
    let text = std::fs::read_to_string(&file).expect("rendered");
    let slow = text.replace("frames_per_second = 5.0", "frames_per_second = 0.5");
    assert_ne!(text, slow);
    std::fs::write(file, format!("{slow}\n{more}")).expect("written");
}

/// Waits until the last cycle's recording is written, and runs it again.
pub fn replays(service: &Service, folder: &Path, verdict: &str) -> String {
    service.wait("its recording is written", |service| service.done("state")["recording"]["is"] != "under_way");
    let recording = service.done("state")["recording"].clone();
    assert_eq!(recording["is"], "whole", "{recording}");
    let file = recording["file"].as_str().expect("a file").to_owned();
    let (exit, told) = json(folder, &format!("replay {file}"));
    assert_eq!((exit, &told["same"], &told["cycle_verdict"]), (0, &true.into(), &verdict.into()), "{told}");
    file
}

/// One cycle that a person holds and one whose result a person accepts, each recorded while the service goes on; both run
/// again without a difference. Pages and `ctl state` name the files.
#[test]
fn cycles_of_the_service_are_recorded_and_replay() {
    let folder = taught("good");
    let folder = folder.path();
    // A disc that is worn before it began: the plan is for a person to see.
    slow_film(folder, "[path]\ndisc_life_mm2 = 1000.0\n");
    let service = Service::start(folder);
    service.reset();
    let taken = "is there already; remove it, or record in another file";
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
    // Of what the arm reaches, and of each plan.
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

/// A service that is killed leaves a recording up to its last whole chunk, and a replay says that it was cut.
#[test]
fn a_killed_service_leaves_a_recording_that_is_cut() {
    let folder = taught("good");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done(&format!("{START} --record cut.mcap"));
    let file = folder.join("cut.mcap");
    let whole = || match check(&std::fs::read(&file).unwrap_or_default()[..]) {
        Err(TapeError::Unfinished { entries, .. }) => entries,
        Err(TapeError::NotMcap { .. }) => 0,
        other => panic!("the cycle has ended: {other:?}"),
    };
    service.wait("some entries", |_| whole() > 50);
    service.killed();
    let entries = whole();
    assert!(entries > 50, "{entries}");
    let (exit, told) = json(folder, "replay cut.mcap");
    let reason = told["reasons"][0]["message"].as_str().expect("words");
    let words = format!("with {entries} whole entries; the program that wrote it ended before");
    assert!(exit == 2 && reason.contains("cut.mcap") && reason.contains(&words), "{told}");
    // The next one may record again, and its cycle is another.
    let service = Service::start(folder);
    if service.state() == "aborted" {
        service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
        service.reach("stopped");
    }
    service.reset();
    service.refused(&format!("{START} --record cut.mcap"), 2, "is there already");
}

/// How long a whole cycle takes here, from its start.
fn whole_cycle(folder: &Path) -> Duration {
    let service = Service::start(folder);
    service.reset();
    let since = Instant::now();
    service.done(START);
    service.reach("complete");
    let took = since.elapsed();
    service.killed();
    took
}

/// Kills a service after this much of its cycle, and holds the next one to its promise; says whether a motion was open.
fn survives(folder: &Path, after: Duration) -> bool {
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    std::thread::sleep(after);
    service.killed();
    let before = journal(folder);
    let expected = panelprep::cycle::recover(before.iter().copied());

    let service = Service::start(folder);
    let found = service.done("state");
    assert_eq!(found["state"], expected.at.word(), "after {after:?}: {found}");
    assert!(matches!(expected.at, At::Aborted { .. } | At::Stopped), "{expected:?}");
    // It only hears: a start, what the robot's condition is, and that its outputs are off.
    std::thread::sleep(Duration::from_millis(300));
    let since = journal(folder)[before.len()..].to_vec();
    assert!(since.contains(&Event::Told(Report::Boot)), "{since:?}");
    let hears = |event: &Event| matches!(event, Event::Told(Report::Boot | Report::Robot(_) | Report::OutputsOff));
    assert!(since.iter().all(hears), "it acts unasked: {since:?}");
    if expected.intent.is_some() {
        let (exit, cycle) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml");
        assert!(exit == 2, "a second writer is refused: {cycle}");
    }
    if found["state"] == "aborted" {
        let words = found["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(words.contains("ctl clear"), "{found}");
        service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
        service.reach("stopped");
    }
    service.reset();
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.ended().code(), Some(0));
    let mut store = Store::create(&folder.join("cell/store")).expect("nobody holds it");
    assert_eq!(store.recover().expect("it is whole").intent, None);
    assert_eq!(store.open_cycles().expect("cycles"), [], "every cycle has its end");
    expected.intent.is_some()
}

fn kills(moments: u32, seed: u64) {
    let folder = taught("good");
    let folder = folder.path();
    let whole = whole_cycle(folder);
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let shares = (0..moments).map(|moment| (f64::from(moment) + random.random::<f64>()) / f64::from(moments));
    let open = shares.map(|share| survives(folder, whole.mul_f64(share))).filter(|open| *open).count();
    eprintln!("{open} of {moments} kills left a motion open; a cycle takes {whole:?}");
}

/// A process may end anywhere; the store opens, the next one rests and moves nothing until told.
#[test]
fn a_killed_service_leaves_a_cell_at_rest() {
    kills(3, 1);
}

/// The same at more moments: `cargo test -- --ignored killed`.
#[test]
#[ignore = "some minutes"]
fn a_service_killed_anywhere_leaves_a_cell_at_rest() {
    kills(24, 2);
}

/// The journal of a cycle that broke off on its way to the corner, in a store of its own.
fn broken_off(folder: &Path) -> PathBuf {
    let (store, left) = (folder.join("cell/store"), folder.join("left"));
    std::fs::create_dir_all(left.join("blobs")).expect("a folder");
    for part in ["", "blobs"] {
        for entry in std::fs::read_dir(store.join(part)).expect("the store") {
            let entry = entry.expect("an entry");
            if entry.path().is_file() {
                std::fs::copy(entry.path(), left.join(part).join(entry.file_name())).expect("copied");
            }
        }
    }
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
    let (exit, whole) = json(folder, cycle);
    assert_eq!(exit, 0, "{whole}");
    let mut state = State::NEW;
    let mut copy = Store::create(&left).expect("nobody holds it");
    for event in journal(folder) {
        copy.append(&event, None).expect("written");
        state = panelprep::cycle::step(state, event).0;
        if state.intent.is_some_and(|intent| matches!(intent.motion.path, Corner { .. })) {
            return left;
        }
    }
    panic!("no way to the corner in {:?}", journal(folder));
}

/// A store with an open motion is refused by the command that runs one cycle, which names the way out; that is one.
#[test]
fn a_motion_that_was_left_open_is_cleared_through_the_service_alone() {
    let folder = taught("clean");
    let folder = folder.path();
    let left = broken_off(folder);
    let (exit, refused) = json(folder, "cycle --cell cell/cell.toml --store left --recipe cell/recipe.toml");
    let words = refused["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && words.contains("motion is open") && words.contains("panelprep clear"), "{refused}");

    std::fs::remove_dir_all(folder.join("cell/store")).expect("removed");
    std::fs::rename(left, folder.join("cell/store")).expect("in its place");
    let service = Service::start(folder);
    let found = service.done("state");
    let words = found["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(found["state"] == "aborted" && words.contains("while a motion was open"), "{found}");
    service.refused("reset", 2, "possible now: clear");
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    service.reset();
}

/// A database of yesterday beside the head of today: the service rests in Aborted and says why, until a person clears it.
#[test]
fn a_store_that_was_rolled_back_rests_until_a_person_clears_it() {
    let folder = taught("clean");
    let folder = folder.path();
    let (database, verify) = (folder.join("cell/store/panelprep.sqlite"), "store verify --cell cell/cell.toml");
    let yesterday = std::fs::read(&database).expect("a database");
    let service = Service::start(folder);
    service.reset();
    let (exit, beside) = json(folder, verify);
    assert_eq!((exit, &beside["ok"]), (0, &true.into()), "beside the service: {beside}");
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.ended().code(), Some(0));
    std::fs::write(&database, yesterday).expect("rolled back");

    let (exit, told) = json(folder, verify);
    let found = told["found"].to_string();
    assert!(exit == 1 && told["ok"] == false && found.contains("rolled back"), "{told}");
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml";
    let (exit, refused) = json(folder, cycle);
    assert!(exit == 2 && refused["reasons"].to_string().contains("panelprep store verify"), "{refused}");
    let service = Service::start(folder);
    let found = service.done("state");
    assert!(found["state"] == "aborted" && found["reasons"][0]["code"] == "store_changed", "{found}");
    service.refused("reset", 2, "possible now: clear");
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    service.reset();
    let (exit, told) = json(folder, verify);
    let known = told["known"].to_string();
    assert!(exit == 0 && told["ok"] == true && known.contains("rolled back"), "it stays on record: {told}");
}

/// Some other program fills the store's disk in the middle of a cycle: the cell is held, says what to delete, and a restart
/// on the full disk does too. With room again it goes on.
#[test]
fn a_full_disk_holds_the_cell_and_a_start_on_it_says_what_to_delete() {
    let folder = rendered("good");
    let folder = folder.path();
    let store = folder.join("cell/store");
    std::fs::create_dir_all(&store).expect("made");
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=1400m", "none"]).arg(&store).output();
    if !mount.as_ref().is_ok_and(|said| said.status.success()) {
        eprintln!("not run: no disk can be mounted here: {mount:?}");
        return;
    }
    let _mounted = Mounted(store.clone());
    taught_and_verified(folder);
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    fill(&store);
    service.reach("held");
    let held = service.done("state")["reasons"].to_string();
    assert!(held.contains("disk_full") && held.contains("delete"), "{held}");
    service.refused("unhold --dried", 3, "is full");
    service.killed();

    fill(&store);
    let service = Service::start(folder);
    let told = service.done("state");
    assert!(told["reasons"].to_string().contains("delete"), "{told}");
    assert!(["stopped", "aborted"].contains(&told["state"].as_str().unwrap_or_default()), "{told}");
    service.ctl("reset");
    service.wait("it is refused", |service| ["stopped", "aborted"].contains(&&*service.state()));
    assert_ne!(service.ctl(START).0, 0, "nothing starts on a full disk");
    std::fs::remove_file(store.join("ballast")).expect("room");
    service.wait("it goes on", |service| {
        if service.state() == "aborted" {
            service.ctl("clear");
        }
        service.ctl("reset");
        service.state() == "idle"
    });
    let (exit, told) = json(folder, "store verify --cell cell/cell.toml");
    assert_eq!((exit, &told["ok"]), (0, &true.into()), "{told}");
}

struct Mounted(PathBuf);

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

/// Takes all that is left of a disk.
fn fill(disk: &Path) {
    let file = disk.join("ballast");
    let mut ballast = std::fs::OpenOptions::new().create(true).append(true).open(file).expect("made");
    for block in [vec![7; 1 << 20], vec![7; 1]] {
        while ballast.write_all(&block).is_ok() {}
    }
}
