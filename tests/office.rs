//! Tests the transfer of records from a cell to the office server and back, with a real broker and a real database, as
//! people use them.
//!
//! `losses` contains the tests in which records are lost or servers are killed, `contradictions` those with false
//! records, `people` those with people who view the records.

mod contradictions;
mod losses;
mod offices;
mod people;

use super::commands::json;
use super::operator_page::{one_cycle, trace};
use super::service::{START, Service, taught};
use offices::{Plant, count};
use panelprep::store::Store;
use std::fs;
use std::path::{Path, PathBuf};

/// Sets the broker to which a rendered cell sends its records.
fn with_office(folder: &Path, broker_port: u16) {
    let file = folder.join("cell/cell.toml");
    let cell = fs::read_to_string(&file).expect("a cell");
    let office = format!("\n[office]\nbroker = \"nats://127.0.0.1:{broker_port}\"\ncell = \"cell-1\"\n");
    fs::write(file, cell + &office).expect("written");
}

/// Runs a cell with `[office]` as people use it: one cycle, and the verification of its records afterwards.
#[test]
fn a_cycle_of_the_service_is_in_the_office_with_its_pictures_and_is_proven_there() {
    let Some(plant) = Plant::start() else { return };
    let folder = taught("good");
    with_office(folder.path(), plant.broker_port);
    let service = Service::start(folder.path());
    service.reset();
    service.done(&format!("{START} --part SN-0017 --wait"));
    let store = Store::open(&folder.path().join("cell/store")).expect("a store");
    service.wait("its record is signed", |_| !store.signatures().expect("read").is_empty());
    let found = plant.wait_until_archived("cell-1", &folder.path().join("cell/store"));
    assert!(count(&found, "records") >= 3 && count(&found, "signatures") == 1, "{found}");
    assert_eq!(found["cells"][0]["same"], found["cells"][0]["records"]);
    assert!(count(&found, "files") > 5, "pictures: {found}");
    // With a list that a person carries to the office server, the verification gives the same result as over the
    // network.
    let (exit, list) = json(folder.path(), "store list --cell cell/cell.toml");
    assert_eq!(exit, 0, "{list}");
    let carried = plant.folder.path().join("cell-1.json");
    fs::write(&carried, list.to_string()).expect("written");
    assert_eq!(plant.check(&format!("cell-1={}", carried.display())).0, 0);
    // A picture that a person changed on the office server is reported.
    let files: Vec<PathBuf> = walk(&plant.folder.path().join("files"));
    fs::write(&files[0], b"another picture").expect("spoilt");
    let (exit, found) = plant.check("");
    assert!(exit == 1 && found.to_string().contains("is damaged: its SHA-256 is"), "{found}");
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("an entry").path());
    let mut files: Vec<PathBuf> = Vec::new();
    for path in entries {
        if path.is_dir() { files.extend(walk(&path)) } else { files.push(path) }
    }
    files.sort();
    files
}

/// A robot moves in the same way without an office server, with one whose broker never answers, and with one that
/// accepts everything.
#[test]
fn the_office_server_does_not_change_the_robots_motion() {
    let Some(plant) = Plant::start() else { return };
    let with = |broker_port: Option<u16>| {
        let folder = taught("good");
        if let Some(port) = broker_port {
            with_office(folder.path(), port);
        }
        one_cycle(&Service::start(folder.path()));
        trace(folder.path())
    };
    // This server accepts connections and sends nothing.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let without = with(None);
    assert!(without.iter().any(|line| line.contains("Contact")), "it abrades: {without:#?}");
    assert_eq!(with(Some(silent.local_addr().expect("its port").port())), without);
    assert_eq!(with(Some(plant.broker_port)), without);
}
