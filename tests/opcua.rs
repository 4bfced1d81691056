//! Tests the OPC UA server with third-party clients: `asyncua` in a separate Python below `target/`, and bytes that are
//! not OPC UA.
//!
//! `make test` installs `asyncua` if it is available; the product needs neither `asyncua` nor Python.

use super::operator_page::add_account;
use super::service::{Service, taught};
use panelprep::accounts::{AuditEntry, Role};
use panelprep::packml::{METHODS, NODES};
use panelprep::record::{CycleId, RequestSource};
use panelprep::store::Store;
use rand::{RngExt, SeedableRng};
use serde_json::json;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use strum::VariantArray;

/// Returns the Python with `asyncua`; without it, prints that the server was not tested.
fn python() -> Option<PathBuf> {
    let python = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/opcua/bin/python");
    let has = Command::new(&python).args(["-c", "import asyncua"]).output().is_ok_and(|told| told.status.success());
    if has {
        return Some(python);
    }
    eprintln!(
        "not run: target/opcua has no Python with asyncua, so no client looked at the server; make opcua-peer installs it"
    );
    None
}

/// Adds the OPC UA server to the cell's file; returns its address.
fn with_opcua(folder: &Path, more: &str) -> String {
    let address = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("its address");
    let file = folder.join("cell/cell.toml");
    let cell = std::fs::read_to_string(&file).expect("a cell");
    let table = format!("{cell}\n[opcua]\nlisten = \"{address}\"\n{more}\n\n[page]\nrecipes = \".\"\n");
    std::fs::write(file, table).expect("written");
    address.to_string()
}

/// Writes the program's own tables for the client and returns the file.
fn write_tables(folder: &Path) -> PathBuf {
    let nodes = NODES.iter().map(
        |node| json!({ "path": node.path, "type": node.kind.name(), "unit": node.unit, "meaning": node.meaning }),
    );
    let methods = METHODS.iter().map(|method| {
        let arguments: Vec<_> = method.arguments.iter().map(|one| one.kind.name()).collect();
        let roles = Role::VARIANTS.iter().filter(|role| method.is_allowed(Some(**role)));
        let roles: Vec<_> = roles.map(|role| role.keyword()).collect();
        json!({ "name": method.name, "arguments": arguments, "roles": roles })
    });
    let tables = json!({ "nodes": nodes.collect::<Vec<_>>(), "methods": methods.collect::<Vec<_>>() });
    let file = folder.join("tables.json");
    std::fs::write(&file, tables.to_string()).expect("written");
    file
}

/// Waits until the server listens: it creates its certificate first, and the cell does not wait for it.
fn wait_until_listening(address: &str, service: &Service) {
    service.wait("the OPC UA server listens", |_| std::net::TcpStream::connect(address).is_ok());
}

/// Runs a client with this script, to its end.
fn client(python: &Path, script: &str, (address, folder): (&str, &Path), service: &Service) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/opcua");
    wait_until_listening(address, service);
    let told = Command::new(python)
        .arg(here.join(script))
        .arg(format!("opc.tcp://{address}/"))
        .arg(folder.join("cell/store/opcua"))
        .arg(write_tables(folder))
        .arg(env!("CARGO_BIN_EXE_panelprep"))
        .output()
        .expect("it starts");
    let [words, problems] = [&told.stdout, &told.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(told.status.success(), "{words}\n{problems}\n{}", service.log());
    assert_eq!(words.lines().last(), Some("whole"), "{words}\n{problems}");
    println!("{words}");
}

fn audit(folder: &Path) -> Vec<AuditEntry> {
    let store = Store::open(&folder.join("cell/store")).expect("a store");
    store.audit(None, 10_000).expect("read").into_iter().map(|line| line.entry).collect()
}

#[test]
fn a_line_sees_and_runs_the_cell_as_each_role() {
    let Some(python) = python() else { return };
    let folder = taught("clean");
    let folder = folder.path();
    let address = with_opcua(folder, "");
    // A recipe that permits less shift than the panel has: its cycle is rejected.
    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("a recipe");
    let strict = recipe.replace("[locate]\n", "[locate]\nmax_shift_mm = 1.0\n");
    assert_ne!(strict, recipe);
    std::fs::write(folder.join("cell/strict.toml"), strict).expect("written");
    Role::VARIANTS.iter().for_each(|role| add_account(folder, role.keyword()));
    let service = Service::start(folder);
    client(&python, "everything.py", (&address, folder), &service);
    drop(service);

    let audit = audit(folder);
    let has = |what: &str, who: Option<&str>, subject: &str, refused: Option<&str>| {
        audit.iter().any(|line| {
            line.what == what
                && line.who.as_deref() == who
                && line.from.starts_with("OPC UA, 127.0.0.1")
                && line.subject.as_deref().unwrap_or_default().contains(subject)
                && match (&line.refused, refused) {
                    (None, None) => true,
                    (Some(found), Some(words)) => found.contains(words),
                    _ => false,
                }
        })
    };
    for role in Role::VARIANTS.iter().filter(|role| **role != Role::Display) {
        assert!(has("log in", Some(role.keyword()), "", None), "{role:?}: {audit:#?}");
    }
    assert!(has("log in", Some("viewer"), "", Some("wrong name or password")), "{audit:#?}");
    assert!(
        has("request", Some("viewer"), "Start", Some("the role viewer has no permission for this call")),
        "{audit:#?}"
    );
    assert!(
        has("request", Some("inspector"), "Unhold", Some("the role inspector has no permission")),
        "{audit:#?}"
    );
    assert!(has("request", Some("operator"), "Hold", Some("too many calls in a short time")), "{audit:#?}");
    assert!(has("acknowledge alarm", Some("inspector"), "raised", None), "{audit:#?}");
    let unknown = audit.iter().filter(|line| line.what == "connect");
    let names = |line: &&AuditEntry| line.subject.as_deref().is_some_and(|subject| subject.contains("CN=line"));
    let unknown = unknown.clone().find(names).expect("a certificate that was turned away");
    let todo = unknown.refused.as_deref().unwrap_or_default();
    assert!(todo.contains("move the certificate from rejected to trusted"), "{unknown:?}");

    // The record contains the caller, as for requests from the page.
    let store = Store::open(&folder.join("cell/store")).expect("a store");
    let record = store.cycle(CycleId(2)).expect("read");
    let who: Vec<String> = record
        .asked
        .iter()
        .filter_map(|asked| {
            asked.who.as_ref().filter(|who| who.front == RequestSource::OpcUa).map(ToString::to_string)
        })
        .collect();
    assert!(who.contains(&"operator, through OPC UA".to_owned()), "{who:?}");
    assert!(who.contains(&"viewer, through OPC UA".to_owned()), "a viewer stopped it: {who:?}");
    // A flood of a thousand calls causes only a few entries in the audit trail.
    let lines =
        audit.iter().filter(|line| line.refused.as_deref() == Some("too many calls in a short time")).count();
    assert!(lines <= 2, "{lines}");
}

#[test]
fn a_person_without_an_account_reads_and_stops_and_nothing_else() {
    let Some(python) = python() else { return };
    let folder = taught("clean");
    let folder = folder.path();
    let address = with_opcua(folder, "anonymous = \"read\"\nunencrypted = true");
    ["operator", "viewer", "administrator"].iter().for_each(|role| add_account(folder, role));
    let service = Service::start(folder);
    client(&python, "anonymous.py", (&address, folder), &service);
}

/// Returns the first message of a client, which states that the client uses OPC UA.
fn hello(address: &str) -> Vec<u8> {
    let url = format!("opc.tcp://{address}/");
    let mut body = Vec::new();
    for number in [0_u32, 65_535, 65_535, 0, 0] {
        body.extend(number.to_le_bytes());
    }
    body.extend(u32::try_from(url.len()).expect("short").to_le_bytes());
    body.extend(url.as_bytes());
    message(b"HELF", &body)
}

fn message(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
    let size = u32::try_from(body.len() + 8).expect("short");
    [kind.as_slice(), &size.to_le_bytes(), body].concat()
}

/// Returns the message by which a client opens a channel without security, to request the endpoints.
fn open_channel() -> Vec<u8> {
    let mut body = 0_u32.to_le_bytes().to_vec();
    let policy = b"http://opcfoundation.org/UA/SecurityPolicy#None";
    body.extend(u32::try_from(policy.len()).expect("short").to_le_bytes());
    body.extend(policy);
    body.extend([0xff; 8]);
    body.extend([1_u32, 1].iter().flat_map(|number| number.to_le_bytes()));
    // OpenSecureChannelRequest: its type, a header, protocol 0, issue, no security, no nonce, an hour.
    body.extend([1, 0, 0xbe, 0x01]);
    body.extend([0, 0]);
    body.extend([0; 8]);
    body.extend([1, 0, 0, 0, 0, 0, 0, 0]);
    body.extend([0xff; 4]);
    body.extend([0; 4]);
    body.extend([0, 0, 0]);
    body.extend([0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]);
    body.extend([0xff; 4]);
    body.extend(3_600_000_u32.to_le_bytes());
    message(b"OPNF", &body)
}

/// Returns whether the server answers a client that begins correctly.
fn acknowledges(address: &str) -> bool {
    let Ok(mut stream) = TcpStream::connect(address) else { return false };
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    let mut answer = [0; 4];
    stream.write_all(&hello(address)).and_then(|()| stream.read_exact(&mut answer)).is_ok() && answer == *b"ACKF"
}

/// Returns bytes that are nearly valid: whole messages that were changed, truncated or repeated.
fn nearly_valid_bytes(random: &mut impl rand::Rng, address: &str) -> Vec<u8> {
    let mut bytes =
        [hello(address), open_channel(), message(b"MSGF", &[7; 200]), message(b"CLOF", &[0; 16])].concat();
    match random.random_range(0..4) {
        0 => bytes.truncate(random.random_range(0..bytes.len())),
        1 => (0..random.random_range(1..20)).for_each(|_| {
            let at = random.random_range(0..bytes.len());
            bytes[at] = random.random();
        }),
        2 => {
            // Overwrites a length with a wrong value: the length of the message, or of a text in the message.
            let at = random.random_range(0..bytes.len() - 4);
            bytes[at..at + 4].copy_from_slice(&random.random::<u32>().to_le_bytes());
        }
        _ => bytes = (0..random.random_range(1..500)).map(|_| random.random()).collect(),
    }
    bytes
}

/// Two thousand connections with invalid data, a hundred silent ones, and one that never ends, while a cycle runs to
/// its end.
#[test]
fn invalid_data_on_the_port_has_no_effect() {
    let folder = taught("clean");
    let folder = folder.path();
    let address = with_opcua(folder, "");
    let service = Service::start(folder);
    service.wait("it listens", |_| acknowledges(&address));
    assert!(check_open_channel_is_answered(&address), "the channel of this test is one that the server opens");
    std::thread::scope(|scope| {
        for seed in 0..4 {
            let address = &address;
            scope.spawn(move || {
                let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
                for _ in 0..500 {
                    let bytes = nearly_valid_bytes(&mut random, address);
                    let Ok(mut stream) = TcpStream::connect(address) else { continue };
                    // The server may already have closed the connection.
                    let _ = stream.write_all(&bytes);
                    let _ = stream.set_read_timeout(Some(Duration::from_millis(5)));
                    let _ = stream.read(&mut [0; 512]);
                }
            });
        }
        let silent: Vec<_> = (0..100).filter_map(|_| TcpStream::connect(&address).ok()).collect();
        service.reset();
        service.done("start --recipe cell/recipe.toml");
        service.reach("complete");
        drop(silent);
    });
    service.wait("it answers as before", |_| acknowledges(&address));
    let log = service.log();
    assert!(!log.contains("fault of the program"), "{log}");
    let turned_away = audit(folder)
        .iter()
        .any(|line| line.refused.as_ref().is_some_and(|refused| refused.contains("connections rejected, because")));
    assert!(turned_away, "a hundred connections of one address are too many, and the audit trail says so");
}

fn check_open_channel_is_answered(address: &str) -> bool {
    let mut stream = TcpStream::connect(address).expect("it listens");
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    stream.write_all(&[hello(address), open_channel()].concat()).expect("sent");
    let mut answer = [0; 32];
    stream.read_exact(&mut answer).is_ok() && answer.windows(4).any(|part| part == b"OPNF")
}

/// The tables in the manual agree with the program's own tables.
#[test]
fn the_manual_has_every_node_and_method() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/manual/opcua.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let dash = |text: &str| if text.is_empty() { "–".to_owned() } else { text.to_owned() };
    let nodes = NODES
        .iter()
        .map(|node| format!("| `{}` | {} | {} | {} |", node.path, node.kind.name(), dash(node.unit), node.meaning));
    let methods = METHODS.iter().map(|method| {
        let arguments = method.arguments.iter().map(|one| format!("{}: {}", one.name, one.kind.name()));
        let roles: Vec<&str> = Role::VARIANTS
            .iter()
            .filter(|role| method.is_allowed(Some(**role)))
            .map(|role| role.keyword())
            .collect();
        let who = if method.required_permission.is_none() { "every session".to_owned() } else { roles.join(", ") };
        let arguments = dash(&arguments.collect::<Vec<_>>().join(", "));
        format!("| `{}` | {arguments} | {who} | {} |", method.name, method.meaning)
    });
    let expected: Vec<String> = methods.chain(nodes).collect();
    let missing: Vec<&String> = expected.iter().filter(|row| !page.lines().any(|line| line == **row)).collect();
    assert!(missing.is_empty(), "no such rows in opcua.md:\n{missing:#?}");
    let rows = page
        .lines()
        .filter(|line| line.starts_with("| `") && !line.contains("/`,") && !line.starts_with("| `trusted/`"));
    let rows = rows.filter(|line| !line.starts_with("| `rejected/`"));
    let more: Vec<&str> = rows.filter(|row| !expected.iter().any(|one| one == row)).collect();
    assert!(more.is_empty(), "nothing is as these rows of opcua.md say:\n{more:#?}");
}
