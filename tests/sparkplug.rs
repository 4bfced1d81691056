//! Tests the cell at an MQTT broker: Debian's mosquitto, the program's own service, and two host applications of other
//! authors.

mod manual;
mod peers;

use super::service::{START, Service, taught};
use panelprep::cycle::Request;
use panelprep::record::{Answer, RequestRecord, RequestSource, RequestedAction};
use panelprep::sparkplug::{METRICS, NodeCommand};
use panelprep::store::{NumberedEntry, Store};
use peers::{Broker, Host, PASSWORD, USER, are_there, free_port};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

/// Adds `[sparkplug]` to the cell's file.
fn with_broker(folder: &Path, more: &str) {
    let file = folder.join("cell/cell.toml");
    let cell = fs::read_to_string(&file).expect("a cell");
    let table = format!("\n[sparkplug]\ngroup_id = \"plant\"\nedge_node_id = \"cell\"\n{more}\n");
    fs::write(file, cell + &table).expect("written");
}

fn audit(folder: &Path) -> Vec<NumberedEntry> {
    Store::open(&folder.join("cell/store")).expect("a store").audit(None, 10_000).expect("read")
}

/// Returns the requests of hosts to the cell, the newest first.
fn requests(folder: &Path) -> Vec<RequestRecord> {
    let store = Store::open(&folder.join("cell/store")).expect("a store");
    let all = store.requests(None, 10_000).expect("read").into_iter().map(|numbered| numbered.request);
    let is_host =
        |asked: &RequestRecord| asked.who.as_ref().is_some_and(|who| who.front == RequestSource::Sparkplug);
    all.filter(is_host).collect()
}

/// The data of the cell as a host knows them after these messages, metric by metric. Each message is checked against
/// the rules of a session.
#[derive(Default)]
struct Known {
    values: BTreeMap<String, Value>,
    /// The number of the newest message since the birth, and below it the number of the connection.
    seq: Option<u64>,
    bd_seq: Option<Value>,
    /// Every value of this metric, in order of arrival.
    words: Vec<Value>,
    deaths: Vec<Value>,
}

impl Known {
    fn from_messages(messages: &[Value]) -> Self {
        let mut known = Known::default();
        messages.iter().for_each(|message| known.hears(message));
        known
    }

    fn hears(&mut self, message: &Value) {
        let metrics = message["metrics"].as_object();
        match message["kind"].as_str() {
            Some("NBIRTH") => {
                assert_eq!(message["seq"], 0, "{message}");
                let metrics = metrics.expect("metrics");
                for known in &METRICS {
                    assert_eq!(
                        metrics[known.name]["type"],
                        known.datatype.type_name().to_uppercase(),
                        "{}",
                        known.name
                    );
                }
                self.values =
                    metrics.iter().map(|(name, metric)| (name.clone(), metric["value"].clone())).collect();
                (self.seq, self.bd_seq) = (Some(0), Some(metrics["bdSeq"]["value"].clone()));
            }
            Some("NDATA") => {
                let next = self.seq.expect("a birth before data") + 1;
                assert_eq!(message["seq"], next % 256, "{message}");
                self.seq = Some(next % 256);
                for (name, metric) in metrics.expect("metrics") {
                    self.values.insert(name.clone(), metric["value"].clone());
                }
            }
            Some("NDEATH") => {
                assert_eq!(Some(&message["metrics"]["bdSeq"]["value"]), self.bd_seq.as_ref(), "{message}");
                self.deaths.push(message.clone());
                self.seq = None;
            }
            _ => return,
        }
        let qos = u64::from(message["kind"] == "NDEATH");
        assert_eq!((&message["qos"], &message["retain"]), (&json!(qos), &json!(false)), "{message}");
        let word = self.values["State/word"].clone();
        if self.words.last() != Some(&word) {
            self.words.push(word);
        }
    }

    /// Returns whether these states were received in this order; other states may be in between.
    fn has_received_in_order(&self, states: &[&str]) -> bool {
        let mut seen = self.words.iter();
        states.iter().all(|state| seen.any(|word| word == state))
    }
}

/// Connects to the broker by TLS and password. Nothing is published before the primary host is online. Then follow a
/// whole cycle, a rebirth, a host's hold and refused commands. A death certificate is published after a host goes
/// offline, after a signal and after a kill; finally the broker itself ends.
#[test]
fn a_primary_host_sees_the_cell_and_may_hold_it() {
    if !are_there(&["pysparkplug"]) {
        return;
    }
    let folder = taught("good");
    let folder = folder.path();
    let mut broker = Broker::start(folder);
    let tls_port = broker.tls_port;
    with_broker(
        folder,
        &format!(
            "broker = \"localhost\"\nport = {tls_port}\nca_certificate = \"../ca.pem\"\nuser = \"{USER}\"\n\
             password_file = \"../password\"\nprimary_host_id = \"scada\"\ncommands = \"operator\""
        ),
    );
    let port = broker.port.to_string();
    let mut host = Host::start("pysparkplug", "host.py", &[&port, USER, PASSWORD, "plant", "cell", "scada"]);
    let service = Service::start(folder);
    let subscribed = "spBv1.0/STATE/scada";
    let log = || fs::read_to_string(folder.join("mosquitto.log")).unwrap_or_default();
    service.wait("the node has subscribed", |_| log().contains(&format!("{subscribed} (QoS 1)")));
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(Known::from_messages(host.so_far()).seq, None, "nothing without the primary host");
    host.does("state {\"online\": true, \"timestamp\": 1000}");
    let birth = host.until("a birth", |message| message["kind"] == "NBIRTH");
    assert_eq!(birth["metrics"]["Node Control/Rebirth"]["value"], false, "{birth}");
    assert_eq!(birth["metrics"]["bdSeq"]["value"], 0);

    let is = |name: &'static str, value: Value| {
        move |message: &Value| message["metrics"][name]["value"] == value && message["kind"] != "NDEATH"
    };
    service.reset();
    host.until("it is reported", is("State/word", json!("idle")));
    service.done(START);
    service.reach("complete");
    host.until("the verdict", is("LastCycle/verdict", json!("pass")));
    let known = Known::from_messages(&host.heard);
    assert!(known.has_received_in_order(&["stopped", "idle", "execute", "complete"]), "{:?}", known.words);
    let numbers = ["Cycle/number", "LastCycle/number", "Counters/cycles", "Counters/passed"];
    assert_eq!(
        numbers.map(|name| known.values[name].clone()),
        [1, 1, 1, 1].map(Value::from),
        "{:#?}",
        known.values
    );
    assert!(known.values["Counters/abrasions"].as_i64() >= Some(1), "{:#?}", known.values);
    assert_eq!(known.values["Cycle/grids_failed"], 0, "after the last film");
    assert!(known.values["Disc/worn_mm2"].as_f64() > Some(0.0));
    assert_eq!(known.values["Calibration/scanner_verified_h"], 0);
    assert!(known.values["Disk/free_MB"].as_i64() > Some(0));

    host.does("write Node Control/Rebirth");
    let birth = host.until("another birth", |message| message["kind"] == "NBIRTH");
    assert_eq!(birth["metrics"]["State/word"]["value"], "complete");

    // A host holds a cycle. A command that the cell's state machine does not accept is refused for a host as for every
    // other client.
    host.does("write Node Control/Hold");
    let asked = |request| requests(folder).into_iter().find(|asked| asked.wanted == RequestedAction::For(request));
    service.wait("a refusal", |_| asked(Request::Hold).is_some());
    let refused = asked(Request::Hold).expect("it was recorded");
    assert!(refused.reasons.iter().any(|why| why.message.contains("hold is not possible in state complete")));
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    host.does("write Node Control/Hold");
    service.reach("held");
    host.until("it is reported", is("State/word", json!("held")));
    host.does("write Node Control/Stop");
    service.reach("stopped");
    for written in ["Node Control/Start", "State/word"] {
        host.does(&format!("write {written}"));
    }
    host.does("write-false Node Control/Abort");
    service
        .wait("three refusals", |_| audit(folder).iter().filter(|line| line.entry.refused.is_some()).count() >= 3);
    assert_eq!(service.state(), "stopped");
    let done: Vec<_> = audit(folder).into_iter().filter(|line| line.entry.refused.is_none()).collect();
    let words: Vec<&str> = done.iter().rev().map(|line| line.entry.what.as_str()).collect();
    // Requests to the cell are recorded once each, among the requests; only the rebirth never reached the cell.
    assert_eq!(words, ["rebirth"]);
    let origin = format!("MQTT broker localhost:{tls_port}");
    assert!(done.iter().all(|line| line.entry.from == origin));
    let of_hosts: Vec<_> = requests(folder).into_iter().rev().map(|asked| (asked.wanted, asked.answer)).collect();
    let [hold, stop] = [Request::Hold, Request::Stop].map(RequestedAction::For);
    let done = Some(Answer::Done);
    assert_eq!(of_hosts, [(hold.clone(), Some(Answer::Refused)), (hold, done), (stop, done)]);
    let from = |asked: &RequestRecord| asked.who.as_ref().and_then(|who| who.from.clone());
    assert!(requests(folder).iter().all(|asked| from(asked).as_deref() == Some(&*origin)));
    let store = Store::open(&folder.join("cell/store")).expect("a store");
    let asked = store.cycle(panelprep::record::CycleId(2)).expect("read").asked;
    let who: Vec<String> = asked.iter().filter_map(|asked| asked.who.as_ref()).map(ToString::to_string).collect();
    assert!(who.iter().any(|who| who.contains("an unknown host application, through MQTT Sparkplug")), "{who:?}");

    // The host goes offline, and connects again.
    host.does("state {\"online\": false, \"timestamp\": 1000}");
    host.until("the death", |message| message["kind"] == "NDEATH");
    host.does("state {\"online\": true, \"timestamp\": 2000}");
    let birth = host.until("a birth", |message| message["kind"] == "NBIRTH");
    assert_eq!(birth["metrics"]["bdSeq"]["value"], 1);

    // The broker stops and starts again.
    broker.restart(Duration::from_secs(1));
    host.until("it is connected again", |message| message["kind"] == "connected");
    host.does("state {\"online\": true, \"timestamp\": 3000}");
    let birth = host.until("a birth", |message| message["kind"] == "NBIRTH");
    assert!(birth["metrics"]["bdSeq"]["value"].as_i64() >= Some(2), "{birth}");

    service.signal(rustix::process::Signal::TERM);
    host.until("the death", |message| message["kind"] == "NDEATH");
    assert_eq!(service.wait_for_end().code(), Some(0));
    // A killed program cannot report its end. The broker reports it by the last will.
    let service = Service::start(folder);
    let birth = host.until("a birth", |message| message["kind"] == "NBIRTH");
    assert_eq!(birth["metrics"]["bdSeq"]["value"], 0);
    service.kill_and_wait();
    host.until("the death", |message| message["kind"] == "NDEATH");
    assert_eq!(Known::from_messages(&host.heard).deaths.len(), 3);
}

/// A host that knows no aliases receives names; its commands are accepted as well.
#[test]
fn a_second_host_decodes_every_message() {
    if !are_there(&["wrapper"]) {
        return;
    }
    let folder = taught("clean");
    let folder = folder.path();
    let broker = Broker::start(folder);
    with_broker(
        folder,
        &format!(
            "broker = \"127.0.0.1\"\nport = {}\nuser = \"{USER}\"\npassword_file = \"../password\"\ncommands = \"operator\"\n\
             aliases = false",
            broker.port
        ),
    );
    let port = broker.port.to_string();
    let mut host = Host::start("wrapper", "second_host.py", &[&port, USER, PASSWORD, "plant"]);
    let service = Service::start(folder);
    let has = |message: &Value, name: &str, value: &str| {
        let metrics = message["metrics"].as_array();
        metrics.is_some_and(|all| all.iter().any(|metric| metric["name"] == name && metric["value"] == value))
    };
    host.until("a birth", |message| message["kind"] == "NBIRTH");
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    host.does("write cell Node Control/Stop");
    service.reach("stopped");
    host.until("the verdict", |message| has(message, "LastCycle/verdict", "aborted"));
    service.signal(rustix::process::Signal::TERM);
    host.until("the death", |message| message["kind"] == "NDEATH");
    assert_eq!(service.wait_for_end().code(), Some(0));
    let all: Vec<&Value> = host.heard.iter().filter(|message| message["metrics"].is_array()).collect();
    let kinds =
        ["NBIRTH", "NDATA", "NDEATH"].map(|kind| all.iter().filter(|message| message["kind"] == kind).count());
    assert!(kinds.iter().all(|count| *count > 0), "{all:#?}");
    for message in all {
        for metric in message["metrics"].as_array().expect("metrics") {
            assert!(metric["name"].is_string() && metric["alias"].is_null(), "{message}");
            assert_eq!(metric["value"].is_null(), metric["isNull"] == true, "{metric}");
        }
    }
}

/// Without a role no host may request anything except a rebirth. A retained command and a flood of others only cause a
/// limited number of entries in the audit trail, and the service continues to answer.
#[test]
fn a_flood_of_commands_does_nothing() {
    if !are_there(&["pysparkplug"]) {
        return;
    }
    let folder = taught("clean");
    let folder = folder.path();
    let broker = Broker::start(folder);
    with_broker(
        folder,
        &format!(
            "broker = \"127.0.0.1\"\nport = {}\nuser = \"{USER}\"\npassword_file = \"../password\"",
            broker.port
        ),
    );
    let port = broker.port.to_string();
    let mut host = Host::start("pysparkplug", "host.py", &[&port, USER, PASSWORD, "plant", "cell", "scada"]);
    host.does("write-retained Node Control/Abort");
    let service = Service::start(folder);
    let birth = host.until("a birth", |message| message["kind"] == "NBIRTH");
    assert!(birth["metrics"].get(NodeCommand::Stop.name()).is_none(), "it is not offered: {birth}");
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    host.does("flood 20000");
    let mut slowest = Duration::ZERO;
    for _ in 0..20 {
        let since = Instant::now();
        service.done("state");
        slowest = slowest.max(since.elapsed());
    }
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass", "{}", service.log());
    assert!(slowest < Duration::from_secs(3), "{slowest:?}");
    service.wait("a line that counts the others", |_| audit(folder).iter().any(|line| line.entry.what == "flood"));
    let lines = audit(folder);
    assert!(lines.len() <= 60 && lines.iter().all(|line| line.entry.refused.is_some()), "{}", lines.len());
    let has =
        |words: &str| lines.iter().any(|line| line.entry.refused.as_ref().is_some_and(|why| why.contains(words)));
    assert!(
        has("its age is unknown")
            && has("is not permitted by [sparkplug] commands")
            && has("the metric \"Start\" cannot be written")
    );
}

/// Without a broker the cell works, and reports the missing broker in its log.
#[test]
fn without_a_broker_the_cell_runs() {
    let folder = taught("clean");
    let folder = folder.path();
    with_broker(folder, &format!("broker = \"127.0.0.1\"\nport = {}", free_port()));
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.reach("complete");
    assert_eq!(service.done("state")["verdict"], "pass");
    assert!(service.log().contains("MQTT Sparkplug: no connection to 127.0.0.1"), "{}", service.log());
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));
}
