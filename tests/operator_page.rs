//! Tests the operator's page in a browser, with the service of the program.
//!
//! The browser is the Chromium of the machine, controlled by playwright-core, which waits for what a page shows and not
//! for a fixed time. axe-core, which checks the accessibility of each page, also runs there. `make setup` installs both
//! below `target/`; the product needs neither.

use super::commands::json;
use super::service::{Service, taught};
use panelprep::cycle::Request;
use panelprep::record::{Answer, RequestedAction};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A post in front of the lower left grids: a person must decide whether the panel is tested in spite of the post.
const POST: &str = "\n[[keep_out]]\nname = \"post\"\nmin_mm = [480, 60, 0]\nmax_mm = [700, 260, 270]\n";

/// Adds an account, as a person at a terminal does.
pub fn add_account(folder: &Path, role: &str) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["user", "add", role, "--role", role, "--cell", "cell/cell.toml"])
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    child.stdin.take().expect("its input").write_all(b"correct horse\n").expect("it reads");
    assert!(child.wait().expect("it ends").success());
}

/// Adds the operator's page to the cell's file; returns its address.
pub fn with_page(folder: &Path, more: &str) -> String {
    let address = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("its address");
    let file = folder.join("cell/cell.toml");
    let cell = std::fs::read_to_string(&file).expect("a cell");
    std::fs::write(file, format!("{cell}{more}\n[page]\nlisten = \"{address}\"\n")).expect("written");
    format!("http://{address}")
}

/// Returns the folder of the browser's modules if they and a browser are installed. Otherwise prints that the page was
/// not tested.
pub fn modules() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/browser");
    let is_there =
        ["playwright-core", "axe-core"].iter().all(|name| folder.join("node_modules").join(name).is_dir());
    let runs =
        |program: &str| Command::new(program).arg("--version").output().is_ok_and(|told| told.status.success());
    if is_there && runs("node") && runs("chromium") {
        return Some(folder);
    }
    eprintln!(
        "not run: node, chromium or target/browser is missing, so the page was not looked at; make setup installs what it can"
    );
    None
}

/// Starts a browser with this script, which contains the actions of people.
pub fn in_browser(script: &str, base: &str, modules: &Path) -> Child {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pictures = here.join("target/page");
    Command::new("node")
        .arg(here.join("tests/page").join(script))
        .args([base.as_ref(), pictures.as_os_str(), modules.as_os_str()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("node starts")
}

/// Waits until the script has reached its end without errors.
fn wait_for_script_end(browser: Child, service: &Service) {
    let browser = browser.wait_with_output().expect("it ends");
    let [told, problems] = [&browser.stdout, &browser.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(browser.status.success(), "{told}\n{problems}\n{}", service.log());
    assert_eq!(told.lines().last(), Some("whole"), "{told}\n{problems}");
}

/// Returns the author of each hold, with the reasons that were given.
fn holds(store: &panelprep::store::Store) -> Vec<(Option<String>, Vec<String>)> {
    let asked = store.requests(None, 1_000).expect("read").into_iter().map(|asked| asked.request);
    let holds = asked.filter(|asked| asked.wanted == RequestedAction::For(Request::Hold));
    let user = |hold: &panelprep::record::RequestRecord| hold.who.as_ref().and_then(|who| who.user.clone());
    holds.map(|hold| (user(&hold), hold.reasons.into_iter().map(|reason| reason.message).collect())).collect()
}

/// Returns the codes of the remarks on each accepted start.
fn remarks_on_starts(store: &panelprep::store::Store) -> Vec<Vec<String>> {
    let asked = store.requests(None, 1_000).expect("read").into_iter().map(|asked| asked.request);
    let is_start = |wanted: &RequestedAction| matches!(wanted, RequestedAction::For(Request::Start { .. }));
    let starts = asked.filter(|asked| is_start(&asked.wanted) && asked.answer == Some(Answer::Done));
    starts.map(|start| start.reasons.into_iter().map(|reason| reason.code.into_owned()).collect()).collect()
}

/// A part is processed from start to signature without a mouse; the focus is always visible.
#[test]
fn a_part_is_run_and_signed_with_the_keyboard_alone() {
    let Some(modules) = modules() else { return };
    let folder = taught("clean");
    let folder = folder.path();
    let base = with_page(folder, POST);
    ["operator", "inspector"].iter().for_each(|role| add_account(folder, role));
    let service = Service::start(folder);
    wait_for_script_end(in_browser("keyboard.mjs", &base, &modules), &service);
    drop(service);
    let store = panelprep::store::Store::open(&folder.join("cell/store")).expect("a store");
    let signed = store.person_signatures(panelprep::record::CycleId(1)).expect("read");
    assert!(signed.iter().any(|(_, signature)| signature.user == "inspector"), "{signed:?}");
    assert_eq!(holds(&store), [(Some("operator".to_owned()), vec!["a hair on the lens".to_owned()])]);
    // The person who started the cycle confirmed that no person is inside, and this is recorded.
    assert_eq!(remarks_on_starts(&store), [["stated_clear"]]);
}

/// With one pass or two, the page draws and reports the executed part of each.
#[test]
fn scan_and_path_are_seen_in_three_dimensions() {
    let Some(modules) = modules() else { return };
    let folder = taught("good");
    let folder = folder.path();
    let base = with_page(folder, "");
    add_account(folder, "viewer");
    let service = Service::start(folder);
    one_cycle(&service);
    wait_for_script_end(in_browser("scene.mjs", &base, &modules), &service);
}

#[test]
fn people_run_judge_and_sign_a_part_in_a_browser() {
    let Some(modules) = modules() else { return };
    let folder = taught("clean");
    let folder = folder.path();
    let base = with_page(folder, POST);
    for role in ["display", "viewer", "operator", "inspector", "engineer", "administrator"] {
        add_account(folder, role);
    }
    let mut service = Some(Service::start(folder));
    let mut browser = in_browser("browser.mjs", &base, &modules);
    let mut reported = Vec::new();
    for line in BufReader::new(browser.stdout.take().expect("its words")).lines() {
        let line = line.expect("text");
        let mut reply = || browser.stdin.as_mut().expect("its input").write_all(b"continue\n").expect("it reads");
        let signal = |signal| service.as_ref().expect("it runs").signal(signal);
        if line == "hang" {
            signal(rustix::process::Signal::STOP);
            reply();
        }
        if line == "wake" {
            signal(rustix::process::Signal::CONT);
            reply();
        }
        if line == "restart" {
            let before = service.take().expect("it runs");
            before.signal(rustix::process::Signal::TERM);
            before.wait_for_end();
            std::thread::sleep(std::time::Duration::from_secs(4));
            service = Some(Service::start(folder));
            reply();
        }
        reported.push(line);
    }
    let mut problems = String::new();
    browser.stderr.take().expect("its words").read_to_string(&mut problems).expect("text");
    let log = service.as_ref().map(Service::log).unwrap_or_default();
    assert!(browser.wait().expect("it ends").success(), "{reported:#?}\n{problems}\n{log}");
    assert_eq!(reported.last().map(String::as_str), Some("whole"), "{reported:#?}\n{problems}");
    drop(service);

    // The actions of people are in the store: signed, verified, and with the right names.
    let (exit, verified) = json(folder, "store verify --cell cell/cell.toml");
    assert_eq!((exit, &verified["ok"]), (0, &serde_json::json!(true)), "{verified}");
    let store = panelprep::store::Store::open(&folder.join("cell/store")).expect("a store");
    let audit = store.audit(None, 1_000).expect("read");
    let has = |what: &str, who: &str, refused: bool| {
        audit.iter().any(|line| {
            let entry = &line.entry;
            entry.what == what && entry.who.as_deref() == Some(who) && entry.refused.is_some() == refused
        })
    };
    for (what, who, refused) in [
        ("sign record", "inspector", true),
        ("sign record", "inspector", false),
        ("change recipe", "engineer", true),
        ("change recipe", "engineer", false),
    ] {
        // A save that would have overwritten the change of another person was attempted; an invalid recipe was only
        // checked.
        assert!(has(what, who, refused), "{what} by {who}: {audit:#?}");
    }
    assert_eq!(holds(&store), [(Some("operator".to_owned()), vec!["water on the lens".to_owned()])]);
    let asked = store.cycle(panelprep::record::CycleId(2)).expect("read").asked;
    let abort = asked.iter().find(|asked| format!("{:?}", asked.wanted).contains("Abort")).expect("it is kept");
    let who = abort.who.as_ref().expect("by whom").to_string();
    assert_eq!(who, "a person who was not logged in, on the operator's page at 127.0.0.1");
}

/// Returns the trace of the cycle: each event, every motion with its end, and the verdict of each phase.
pub fn trace(folder: &Path) -> Vec<String> {
    let store = panelprep::store::Store::open(&folder.join("cell/store")).expect("a store");
    let record = store.cycle(panelprep::record::CycleId(1)).expect("read");
    let events = store.journal().expect("a journal").into_iter().map(|event| format!("{event:?}"));
    let from_start = events.skip_while(|event| !event.contains("Start {"));
    let motions = record.motions.iter().map(|motion| format!("{:?} {:?}", motion.motion, motion.outcome));
    // Only the verdicts of the findings are compared: the time at which a person starts the cycle is not synchronised
    // with the clock of the cell, and the drops and glints of the simulated film depend on this time.
    let findings = record
        .findings
        .iter()
        .map(|finding| format!("{:?} {:?} {:?}", finding.kind, finding.judgement.verdict, finding.names("failed")));
    from_start.chain(motions).chain(findings).collect()
}

pub fn one_cycle(service: &Service) {
    service.reset();
    service.done("start --recipe cell/recipe.toml");
    service.reach("complete");
}

/// Two hundred viewers open the page and leave, one reads nothing, and one begins an endless request. In virtual time
/// the robot moves in the same way as without a page.
#[test]
fn a_spectator_does_not_change_the_robots_motion() {
    let folder = taught("good");
    one_cycle(&Service::start(folder.path()));
    let without = trace(folder.path());
    assert!(without.iter().any(|line| line.contains("Contact")), "it abrades: {without:#?}");

    let folder = taught("good");
    let base = with_page(folder.path(), "");
    let address = base.trim_start_matches("http://");
    let service = Service::start(folder.path());
    let ask = |text: String| {
        let mut stream = std::net::TcpStream::connect(address).expect("it listens");
        stream.write_all(text.as_bytes()).expect("sent");
        stream
    };
    let events = format!("GET /events HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let _reads_nothing = ask(events.clone());
    let _never_ends = ask(format!("GET / HTTP/1.1\r\nhost: {address}\r\nx: "));
    std::thread::scope(|scope| {
        for _ in 0..200 {
            let mut stream = ask(events.clone());
            scope.spawn(move || {
                stream.set_read_timeout(Some(std::time::Duration::from_secs(5))).expect("set");
                let (mut bytes, mut heard) = ([0; 4_096], 0);
                // Each connection is closed in the middle of the cycle.
                while heard < 20 && stream.read(&mut bytes).is_ok_and(|count| count > 0) {
                    heard += 1;
                }
                assert!(heard > 0, "it saw something");
            });
        }
        one_cycle(&service);
    });
    drop(service);
    let with = trace(folder.path());
    for (one, other) in without.iter().zip(&with) {
        assert_eq!(one, other);
    }
    assert_eq!(without.len(), with.len());
}
