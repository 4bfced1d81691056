//! Tests method calls up to the requests to the service; a queue replaces the loop.

use super::*;
use crate::daemon::gateway::InterfaceContext;
use crate::daemon::people::AccountService;
use crate::daemon::request::Request as CellRequest;
use crate::daemon::request_queue::request_queue;
use crate::daemon::transfer::RecordTransfers;
use crate::daemon::{Alarms, Gateway};
use crate::setup::testing::write_cell;
use panelprep_cell::accounts::Role;
use panelprep_cell::cell::AnonymousAccess;
use panelprep_interfaces::packml::{ArgumentKind, METHODS, method};
use panelprep_store::store::Store;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use strum::VariantArray;
use tempfile::TempDir;

/// The calls, and the requests that reached the loop.
struct Cell {
    calls: Calls,
    asked: Arc<Mutex<Vec<String>>>,
    /// Number of further requests that the loop refuses.
    refuses: Arc<AtomicUsize>,
    _folder: TempDir,
}

impl Cell {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        drop(Store::create(&folder.path().join("store")).expect("a store"));
        let people = Arc::new(AccountService::new(folder.path().join("store")));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let (sender, queue) = request_queue();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let refuses = Arc::new(AtomicUsize::new(0));
        let (heard, refused) = (asked.clone(), refuses.clone());
        thread::spawn(move || {
            while let Some(CellRequest { what, requester: who, reply }) = queue.next(Duration::from_secs(60)) {
                heard.lock().expect("whole").push(format!("{} by {who}", what.describe()));
                let left = refused.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(1));
                let exit = if left.is_ok() { RequestResult::Refused } else { RequestResult::Done };
                let reported = Reply { state: Some("idle".to_owned()), ..Reply::refused(exit, vec![]) };
                reply.into_iter().for_each(|reply| drop(reply.send(reported.clone())));
            }
        });
        let setup = write_cell(folder.path(), "", &[("door.toml", "panel = \"door\"")]);
        let access = Arc::new(Access::new(people.clone(), Arc::default(), AnonymousAccess::Read));
        let calls = Calls::new(
            access,
            InterfaceContext {
                gateway: Gateway::without_cell(sender, Reason::new("bad_input", "no cell here")),
                people,
                alarms,
                setup,
                transfers: RecordTransfers::default(),
            },
        );
        Cell { calls, asked, refuses, _folder: folder }
    }

    fn asked(&self) -> Vec<String> {
        self.asked.lock().expect("whole").clone()
    }

    fn audit(&self) -> Vec<AuditEntry> {
        let lines = self.calls.access.accounts_with_audit().read(|store| store.audit(None, 10_000)).expect("read");
        lines.into_iter().map(|line| line.entry).collect()
    }

    async fn call(&self, name: &str, arguments: &[Variant], role: Option<Role>) -> CallOutcome {
        let caller = role.map_or(Caller::Anonymous, person);
        self.calls.call(method(name).expect("such a method"), arguments, Some(&caller), "OPC UA, 10.0.0.1").await
    }
}

fn person(role: Role) -> Caller {
    Caller::Person { name: role.keyword().to_owned(), printed_name: "Ada B".to_owned(), role }
}

fn status(outcome: &CallOutcome) -> StatusCode {
    match outcome {
        CallOutcome::Done(_) => StatusCode::Good,
        CallOutcome::Refused(status, _) => *status,
    }
}

/// Calls every method with every role and without an account: permitted calls reach the loop with the caller's name;
/// other calls never reach it.
#[tokio::test]
async fn each_method_reaches_the_loop_as_the_table_states() {
    for method in METHODS {
        for role in Role::VARIANTS.iter().copied().map(Some).chain([None]) {
            let cell = Cell::new();
            let argument = |kind| match kind {
                ArgumentKind::String => Variant::from("door.toml"),
                ArgumentKind::Boolean => Variant::from(true),
                ArgumentKind::UInt32 => Variant::from(7_u32),
            };
            let door = cell.calls.front.setup.recipe("door.toml").expect("it is offered");
            let mut arguments: Vec<Variant> = method.arguments.iter().map(|one| argument(one.kind)).collect();
            if method.command == Command::Start {
                arguments[1] = Variant::from(door.sha256());
            }
            let outcome = cell.call(method.name, &arguments, role).await;
            let who = role.map_or("a client that was not logged in".to_owned(), |role| role.keyword().to_owned());
            let word = match method.command {
                Command::Start => &format!("start by {}", door.name),
                Command::Unhold => "unhold --dried",
                Command::NewDisc => "new-disc",
                Command::Reset => "reset",
                Command::Hold => "hold",
                Command::Stop => "stop",
                Command::Abort => "abort",
                Command::Clear => "clear",
                Command::Accept => "accept",
                Command::AcknowledgeAlarm => "",
            };
            let is_allowed = method.is_allowed(role);
            assert_eq!(
                status(&outcome) == StatusCode::BadUserAccessDenied,
                !is_allowed,
                "{} {role:?}",
                method.name
            );
            let expected = match method.command {
                // An acknowledgement sends no request to the loop.
                Command::AcknowledgeAlarm => vec![],
                _ if is_allowed => vec![format!("{word} by {who}, through OPC UA")],
                _ => vec![],
            };
            // The test cell has no files, so the loop receives a start that is not prepared and for which no client
            // waits.
            let since = Instant::now();
            while cell.asked() != expected && since.elapsed() < Duration::from_secs(5) {
                thread::sleep(Duration::from_millis(5));
            }
            assert_eq!(cell.asked(), expected, "{} {role:?}", method.name);
            let refused = cell.audit().iter().any(|line| {
                line.what == "request"
                    && line.subject.as_deref() == Some(method.name)
                    && line.from == "OPC UA, 10.0.0.1"
                    && line.refused.is_some()
            });
            assert_eq!(refused, !is_allowed, "{} {role:?}", method.name);
        }
    }
}

#[tokio::test]
async fn wrong_arguments_cause_no_request() {
    let cell = Cell::new();
    let engineer = Some(Role::Engineer);
    let text = |text: &str| Variant::from(text);
    let no = || Variant::from(false);
    let hash = cell.calls.front.setup.recipe("door.toml").expect("it is offered").sha256();
    for (name, arguments) in [
        ("Hold", vec![text("now")]),
        ("Unhold", vec![]),
        ("Unhold", vec![text("true"), Variant::from(7_u32)]),
        // Refused, because a decision must contain the number of the step, as an unsigned integer.
        ("Unhold", vec![Variant::from(true)]),
        ("Accept", vec![]),
        ("Clear", vec![]),
        ("Clear", vec![Variant::from(7_i32)]),
        ("Start", vec![text("door.toml")]),
        ("Start", vec![text("door.toml"), text(&hash), Variant::from(7_i32), text(""), no()]),
        ("Start", vec![text("door.toml"), text(&hash), text("a\nb"), text(""), no()]),
        ("Start", vec![text("../cell.toml"), text(&hash), text(""), text(""), no()]),
        // Refused: a start with the hash of another recipe, and a start without a hash.
        ("Start", vec![text("door.toml"), text(&"0".repeat(64)), text(""), text(""), no()]),
        ("Start", vec![text("door.toml"), text(""), text(""), text(""), no()]),
        ("AcknowledgeAlarm", vec![text("1/none/2")]),
        ("AcknowledgeAlarm", vec![text("nonsense")]),
    ] {
        let outcome = cell.call(name, &arguments, engineer).await;
        assert_eq!(status(&outcome), StatusCode::BadInvalidArgument, "{name} {arguments:?}: {outcome:?}");
        let refusal = cell.calls.last_refusal().expect("it is reported");
        assert_eq!((refusal.method, refusal.user.as_str()), (name, "engineer"));
    }
    // Refused starts reach the loop only to be recorded: those with an unknown or changed recipe.
    let since = Instant::now();
    while cell.asked().len() < 3 && since.elapsed() < Duration::from_secs(20) {
        tokio::task::yield_now().await;
    }
    let [unknown, changed] =
        ["../cell.toml", "door.toml"].map(|name| format!("start by {name} by engineer, through OPC UA"));
    assert_eq!(cell.asked(), [unknown, changed.clone(), changed]);
    let gone = cell.calls.call(method("Hold").expect("it"), &[], None, "OPC UA").await;
    assert_eq!(status(&gone), StatusCode::BadUserAccessDenied, "the account was changed");
}

#[tokio::test]
async fn excess_calls_do_not_reach_the_loop_and_give_one_line() {
    let cell = Cell::new();
    for _ in 0..500 {
        cell.call("Hold", &[], Some(Role::Operator)).await;
    }
    let holds = cell.asked().len();
    assert!((20..60).contains(&holds), "{holds}");
    let floods = cell
        .audit()
        .iter()
        .filter(|line| line.refused.as_deref() == Some("too many calls in a short time"))
        .count();
    assert_eq!(floods, 1);
    // Calls of another person are still accepted, and stops are always accepted.
    assert_eq!(status(&cell.call("Hold", &[], Some(Role::Engineer)).await), StatusCode::Good);
    assert_eq!(status(&cell.call("Stop", &[], Some(Role::Operator)).await), StatusCode::Good);
    let before = cell.asked().len();
    let since = Instant::now();
    for _ in 0..500 {
        assert_eq!(status(&cell.call("Abort", &[], Some(Role::Viewer)).await), StatusCode::Good);
    }
    let most = 2 + since.elapsed().as_millis() / MERGE_INTERVAL.as_millis();
    let aborts = cell.asked().len() - before;
    assert!(aborts >= 1 && aborts as u128 <= most, "{aborts} of at most {most}");
}

/// The reply to a refused stop is not used for the next stop: the next stop is requested again, even immediately after
/// the refusal.
#[tokio::test]
async fn only_an_executed_stop_answers_the_next_one() {
    let cell = Cell::new();
    for name in ["Stop", "Abort"] {
        let before = cell.asked().len();
        cell.refuses.store(1, Relaxed);
        assert_eq!(status(&cell.call(name, &[], Some(Role::Viewer)).await), StatusCode::BadInvalidState);
        assert_eq!(status(&cell.call(name, &[], Some(Role::Viewer)).await), StatusCode::Good, "{name}");
        assert_eq!(cell.asked().len() - before, 2, "{name}");
    }
}

#[tokio::test]
async fn an_alarm_is_acknowledged_by_its_name_once() {
    let cell = Cell::new();
    cell.calls.front.alarms.check_cell(|| vec![Reason::new("disk_scarce", "5 MB are free")], None);
    let alarm = cell.calls.front.alarms.all().expect("read").remove(0);
    let name = Variant::from(panelprep_interfaces::packml::alarm_id(&alarm).as_str());
    assert_eq!(
        status(&cell.call("AcknowledgeAlarm", std::slice::from_ref(&name), Some(Role::Viewer)).await),
        StatusCode::BadUserAccessDenied
    );
    assert_eq!(
        status(&cell.call("AcknowledgeAlarm", std::slice::from_ref(&name), Some(Role::Inspector)).await),
        StatusCode::Good
    );
    let seen = cell.calls.front.alarms.all().expect("read").remove(0).acknowledged.expect("it is kept");
    assert_eq!(seen.who, "Ada B (inspector)");
    assert_eq!(
        status(&cell.call("AcknowledgeAlarm", &[name], Some(Role::Inspector)).await),
        StatusCode::BadInvalidArgument
    );
}

#[test]
fn the_name_of_an_alarm_is_parsed() {
    let of = |cycle, code: &str, raised_unix_ms| Some(AlarmId { cycle, code: code.to_owned(), raised_unix_ms });
    assert_eq!(alarm_id("3/low_overlap/1700"), of(Some(CycleId(3)), "low_overlap", 1_700));
    assert_eq!(alarm_id("0/disk_scarce/5"), of(None, "disk_scarce", 5));
    for wrong in ["", "3", "3/low_overlap", "3/low_overlap/x", "x/low_overlap/1", "3/low_overlap/1/2"] {
        assert_eq!(alarm_id(wrong), None, "{wrong}");
    }
}

#[test]
fn a_text_is_plain_and_short() {
    assert_eq!(text(&Variant::from(" SN 7 ")), Some("SN 7".to_owned()));
    assert_eq!(text(&Variant::from("a\nb")), None);
    assert_eq!(text(&Variant::from("x".repeat(201))), None);
    assert_eq!(text(&Variant::from(7_i32)), None);
}

/// Expected values, calculated by hand: 20 calls are accepted at once, and 10 more after 2 s. Another caller is not
/// affected. The excess is reported once a minute.
#[test]
fn calls_above_the_limit_are_refused_and_reported_once() {
    let mut flood = CallLimiter::default();
    let mut taken =
        |caller: &str, now_s| (0..100).filter(|_| flood.call(caller, now_s) == CallDecision::Accepted).count();
    assert_eq!(taken("anna", 0.0), 20);
    assert_eq!(taken("anna", 2.0), 10);
    assert_eq!(taken("ben", 2.0), 20);
    let mut flood = CallLimiter::default();
    let told: Vec<usize> = (0..12_000)
        .filter(|n| flood.call("anna", *n as f64 / 100.0) == CallDecision::TooMany { must_report: true })
        .collect();
    assert_eq!(told.len(), 2, "{told:?}: twelve thousand calls in two minutes");
}

#[test]
fn the_number_of_remembered_callers_is_limited() {
    let mut flood = CallLimiter::default();
    for n in 0..2_000 {
        flood.call(&format!("n{n}"), f64::from(n));
    }
    assert_eq!(flood.0.len(), MAX_CALLERS);
}
