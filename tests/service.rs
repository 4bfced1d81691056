//! Tests the service as its users see it: `panelprep run` on a simulated cell, with `panelprep ctl` and signals.
//!
//! `killed` tests the end by SIGKILL, `recording` the replay of recordings, `disk` a store that is full or was restored
//! from the day before.

mod disk;
mod killed;
mod recording;

pub use recording::replays;

use super::commands::{TEACH, VERIFY, json, rendered, taught_and_verified};
use panelprep::cycle::{At, Event, Request};
use panelprep::store::Store;
use serde_json::Value;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Time limit of the tests, long enough for a busy machine; no test here measures time.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A service that is running; it is killed when the test ends.
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
    /// Starts the service and waits until it answers.
    pub fn start(folder: &Path) -> Self {
        Service::start_with(folder, &[])
    }

    /// Starts the service with additional environment variables and waits until it answers.
    pub fn start_with(folder: &Path, environment: &[(&str, &str)]) -> Self {
        Service::start_from(env!("CARGO_BIN_EXE_panelprep").as_ref(), folder, environment)
    }

    /// Starts the service from this program file and waits until it answers.
    pub fn start_from(program: &Path, folder: &Path, environment: &[(&str, &str)]) -> Self {
        let mut command = Command::new(program);
        command.envs(environment.iter().copied());
        Service::start_command(command, folder, &[])
    }

    /// Starts the service with additional options for the simulation and waits until it answers.
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

    /// Sends a request to the service. A decision refers to the step that was read immediately before, unless the test
    /// gives a step.
    pub fn ctl(&self, ask: &str) -> (i32, Value) {
        let is_decision = ["accept", "unhold", "clear"].contains(&ask.split(' ').next().unwrap_or_default());
        if is_decision && !ask.contains("--step") {
            let step = self.ctl("state").1["step"].as_u64().unwrap_or_default();
            return self.ctl(&format!("{ask} --step {step}"));
        }
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
            assert!(since.elapsed() < TIMEOUT, "{what} never came; {:?}\n{}", self.ctl("state"), self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn reach(&self, state: &str) {
        self.wait(state, |service| service.state() == state);
    }

    /// Sends a request and checks that it is done.
    pub fn done(&self, ask: &str) -> Value {
        let (exit, answer) = self.ctl(ask);
        assert_eq!(exit, 0, "{ask}: {answer}\n{}", self.log());
        answer
    }

    /// Sends a request and checks that it is refused with these words.
    pub fn refused(&self, ask: &str, exit: i32, words: &str) {
        let (found, answer) = self.ctl(ask);
        let message = answer["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(found == exit && message.contains(words), "{ask}: {found} {answer}");
    }

    pub fn reset(&self) {
        // The robot may not be connected yet.
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

    pub fn wait_for_end(mut self) -> ExitStatus {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("its status") {
                return status;
            }
            assert!(since.elapsed() < TIMEOUT, "it does not end\n{}", self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn kill_and_wait(mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("gone");
    }
}

pub const START: &str = "start --recipe cell/recipe.toml";

/// Returns a taught cell with verified cameras in a separate folder.
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

/// The service has the cameras open while it runs: it captures the pictures, but none during a cycle.
#[test]
fn shots_are_taken_by_the_service_while_the_cell_rests() {
    let folder = taught("good");
    let folder = folder.path();
    let service = Service::start(folder);
    let shoot = |what: &str| json(folder, &format!("shoot --cell cell/cell.toml {what}"));
    service.reset();
    let (exit, output) = shoot("corner --out shots");
    assert!(exit == 0 && folder.join("shots/corner_0001.json").is_file(), "{output}");
    // On a busy computer two pictures of the simulated film may have the same time, which a clip refuses.
    let film = (1..=3).find_map(|attempt| {
        let film = format!("film_{attempt}");
        let (exit, output) = shoot(&format!("film --seconds 1 --pictures-per-second 4 --out {film}"));
        println!("{output}");
        (exit == 0 && output["pictures"].as_f64() >= Some(3.0) && output["dropped"] == 0).then_some(film)
    });
    assert!(folder.join(film.expect("a whole film")).join("clip.csv").is_file());
    let (exit, output) = shoot("scan --out shots");
    assert!(
        exit == 2 && output["reasons"].to_string().contains("at standstill in its park pose"),
        "the arm is in the way: {output}"
    );
    assert!(json(folder, "doctor --cell cell/cell.toml").1.to_string().contains("idle"));

    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    let (exit, output) = shoot("corner --out during");
    assert!(
        exit == 2 && output["reasons"].to_string().contains("the service is using the cameras for a cycle"),
        "{output}"
    );
    assert!(!folder.join("during").exists());
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass", "no person disturbed it");

    // The arm is parked now.
    let (exit, output) = shoot("scan --out shots");
    assert!(exit == 0 && output["shots"][0]["points"].as_f64() > Some(10_000.0), "{output}");
    let is_there = |ending: &str| folder.join(format!("shots/scan_0001.{ending}")).is_file();
    assert!(["pcd", "ply", "png"].into_iter().all(is_there));
    let axes = service.done("state")["axes_deg"].as_array().map(Vec::len);
    assert_eq!(axes, Some(6), "and where it stands is reported");
}

/// Two cycles run on one service. The second is ended by a hold and a stop, and the service by SIGTERM. The cameras are
/// verified while the service runs.
#[test]
fn cycles_run_one_after_the_other_and_each_request_is_answered() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    let (exit, answer) = json(folder, "ctl state --cell cell/cell.toml");
    let words = answer["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && words.contains("panelprep run"), "{answer}");

    let service = Service::start(folder);
    assert_eq!(service.done("state")["state"], "stopped");
    service.refused(START, 2, "scanner has never been verified; run `panelprep calibrate verify --camera scanner`");
    assert_eq!(VERIFY.map(|look| json(folder, look).0), [0, 0], "the service keeps no person from looking");
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
    service.wait("work continues", |service| service.state() == "execute");
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
    // The same panel was wiped dry: the film now holds on the sanded places.
    service.done(START);
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass");

    service.signal(rustix::process::Signal::TERM);
    let log = folder.join("run.log");
    assert_eq!(service.wait_for_end().code(), Some(0), "{}", std::fs::read_to_string(log).unwrap_or_default());
    assert!(!socket(folder).exists(), "the socket goes with its service");
    assert_eq!(panelprep::cycle::recover(journal(folder)).at, At::Stopped);
    let store = Store::open(&folder.join("cell/store")).expect("the store opens");
    assert_eq!(store.open_cycles().expect("cycles"), []);
    let pages = std::fs::read_dir(folder.join("cell/store/reports")).expect("pages").count();
    assert_eq!(pages, 4, "one for each cycle");
}

/// SIGTERM in the middle of a cycle acts as a stop, and the cycle is concluded.
#[test]
fn a_signal_stops_the_cycle_and_ends_in_stopped() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));
    let events = journal(folder);
    assert!(events.contains(&Event::Asked(Request::Stop)));
    let state = panelprep::cycle::fold_journal(events);
    assert_eq!((state.at, state.intent), (At::Stopped, None));
}

/// Each store has one service. Input that does not follow the protocol is refused with a message and does not delay
/// other clients.
#[test]
fn invalid_requests_at_the_socket_do_no_harm() {
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
        // The service closes the connection after it has read the maximum length.
        let _ = stream.write_all(line);
        let mut answer = String::new();
        let _ = stream.read_to_string(&mut answer);
        assert!(answer.contains(words) && answer.contains("\"refused\""), "{answer}");
    }
    assert_eq!(service.state(), "stopped", "nothing was done");
    use std::os::unix::fs::PermissionsExt;
    let mode = std::fs::metadata(socket(folder)).expect("the socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o660);
    service.kill_and_wait();
    assert!(socket(folder).exists(), "what a killed service leaves");
    let service = Service::start(folder);
    assert_eq!(service.state(), "stopped", "is replaced by the next one");
}
