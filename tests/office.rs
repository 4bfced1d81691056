//! Records from a cell to the office and back, with a real broker and a real database, and what kills, lies and mistakes do to them.

use super::commands::json;
use super::operator_page::{in_browser, modules, one_cycle, trace};
use super::plant::{Server, archive_settings, broker, database, free_port, nats_server, postgres_programs};
use super::service::{START, Service, taught};
use panelprep::broker::CellLink;
use panelprep::cell::{Broker, BrokerLogin, CellName, Office};
use panelprep::daemon::{OfficeParts, OfficeSender, OfficeStatus};
use panelprep::office::{Body, Chunk, Message, Position, What, chunks};
use panelprep::record::CycleId;
use panelprep::signing::CellKey;
use panelprep::store::{CycleStart, Store};
use panelprep::verdict::Verdict;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(120);

/// Broker, database and archive.
struct Plant {
    folder: TempDir,
    settings: PathBuf,
    broker_port: u16,
    broker: Server,
    database: Server,
    archive: Option<Child>,
}

impl Drop for Plant {
    fn drop(&mut self) {
        self.kill_archive();
    }
}

impl Plant {
    /// `None`, and it says so, where the servers are not installed.
    fn start() -> Option<Self> {
        let (Some(_), Some(programs)) = (nats_server(), postgres_programs()) else {
            eprintln!("not run: nats-server or PostgreSQL is not installed");
            return None;
        };
        let folder = tempfile::tempdir().expect("a folder");
        let (broker_port, database_port) = (free_port(), free_port());
        let broker = broker(folder.path(), broker_port);
        let database = database(&programs, folder.path(), database_port);
        let settings = archive_settings(folder.path(), broker_port, database_port);
        let mut plant = Plant { folder, settings, broker_port, broker, database, archive: None };
        plant.start_archive();
        Some(plant)
    }

    fn start_archive(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.folder.path().join("archive.log"));
        let child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["archive", "run", "--settings"])
            .arg(&self.settings)
            .stdout(Stdio::null())
            .stderr(log.expect("a log"))
            .spawn();
        self.archive = Some(child.expect("the archive starts"));
    }

    fn kill_archive(&mut self) {
        if let Some(mut child) = self.archive.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("archive.log")).unwrap_or_default()
    }

    /// `archive check` with these cells.
    fn check(&self, cells: &str) -> (i32, Value) {
        json(self.folder.path(), &format!("archive check --settings {} {cells}", self.settings.display()))
    }

    /// Waits until the archive holds the same as the cell.
    fn holds(&self, cell: &str, store: &Path) -> Value {
        let since = Instant::now();
        loop {
            let (exit, found) = self.check(&format!("{cell}={}", store.display()));
            if exit == 0 {
                return found;
            }
            assert!(since.elapsed() < PATIENCE, "{found}\n{}", self.log());
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    fn office(&self, cell: &str) -> Office {
        let address = format!("nats://127.0.0.1:{}", self.broker_port);
        let broker = Broker { address, ca: None, login: BrokerLogin::Anybody };
        Office { broker, cell: CellName::new(cell).expect("a name"), behind_min: 60 }
    }
}

/// A store with its sender, as the service has them.
struct Cell {
    folder: TempDir,
    store: Store,
    status: OfficeStatus,
    sender: Option<OfficeSender>,
}

impl Cell {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::create(&folder.path().join("store")).expect("a store");
        Cell { folder, store, status: OfficeStatus::default(), sender: None }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("store")
    }

    fn send(&mut self, office: Office) {
        let parts = OfficeParts { office, folder: self.path(), front: None, status: self.status.clone() };
        self.sender = Some(OfficeSender::start(parts).expect("a thread"));
    }

    fn cycles(&mut self, count: usize) {
        let key = CellKey::of_random(&[7; 32]);
        for number in 0..count {
            let start = CycleStart {
                panel: "wing".to_owned(),
                taught_version: "0011223344556677".to_owned(),
                recipe_text: format!("# {number}\n"),
                file_texts: vec![("cell".to_owned(), "x = 1\n".to_owned())],
                recording: None,
            };
            let id: CycleId = self.store.begin_cycle(&start).expect("begun");
            self.store.conclude(id, Verdict::Pass, &[]).expect("over");
            self.store.sign_cycle(&key, id).expect("signed");
        }
    }
}

fn count(found: &Value, what: &str) -> u64 {
    found["cells"][0][what].as_u64().unwrap_or_else(|| panic!("{what}: {found}"))
}

/// Lets a rendered cell send its records to this broker.
fn with_office(folder: &Path, broker_port: u16) {
    let file = folder.join("cell/cell.toml");
    let cell = fs::read_to_string(&file).expect("a cell");
    let office = format!("\n[office]\nbroker = \"nats://127.0.0.1:{broker_port}\"\ncell = \"cell-1\"\n");
    fs::write(file, cell + &office).expect("written");
}

/// As people use it: a cell with `[office]`, one cycle, and the proof afterwards.
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
    let found = plant.holds("cell-1", &folder.path().join("cell/store"));
    assert!(count(&found, "records") >= 3 && count(&found, "signatures") == 1, "{found}");
    assert_eq!(found["cells"][0]["same"], found["cells"][0]["records"]);
    assert!(count(&found, "files") > 5, "pictures: {found}");
    // A list that was carried to the office proves the same.
    let (exit, list) = json(folder.path(), "store list --cell cell/cell.toml");
    assert_eq!(exit, 0, "{list}");
    let carried = plant.folder.path().join("cell-1.json");
    fs::write(&carried, list.to_string()).expect("written");
    assert_eq!(plant.check(&format!("cell-1={}", carried.display())).0, 0);
    // A picture that somebody changes at the office is named.
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

/// Whatever is killed meanwhile, every record arrives once.
#[test]
fn nothing_is_lost_or_kept_twice_where_everything_is_killed_in_turn() {
    let Some(mut plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    for round in 0..6 {
        cell.send(plant.office("cell-1"));
        cell.cycles(40);
        match round % 4 {
            0 => plant.broker.kill(),
            1 => plant.database.kill(),
            2 => plant.kill_archive(),
            _ => cell.sender = None,
        }
        cell.cycles(20);
        plant.broker.start();
        plant.database.start();
        if round % 4 == 2 {
            plant.start_archive();
        }
    }
    cell.send(plant.office("cell-1"));
    let found = plant.holds("cell-1", &cell.path());
    assert_eq!((count(&found, "records"), count(&found, "same"), count(&found, "signatures")), (720, 720, 360));
}

/// A broker whose disk is lost, and a database that is brought back without its last records: the cell sends again what is missing.
#[test]
fn what_a_broker_or_a_database_forgets_is_sent_again() {
    let Some(mut plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.send(plant.office("cell-1"));
    cell.cycles(5);
    plant.holds("cell-1", &cell.path());
    // What the broker took is lost with its disk before the archive has it.
    plant.kill_archive();
    cell.cycles(5);
    let progress = cell.path().join("office.json");
    wait_until_sent(&progress, 20);
    plant.broker.kill();
    fs::remove_dir_all(plant.folder.path().join("nats")).expect("its disk");
    plant.broker.start();
    plant.start_archive();
    let found = plant.holds("cell-1", &cell.path());
    assert_eq!(count(&found, "same"), 20);
    // A database of yesterday.
    plant.kill_archive();
    sql(
        &plant,
        "DELETE FROM record_files WHERE number > 7; DELETE FROM records WHERE number > 7; UPDATE epochs SET archived = 7",
    );
    plant.start_archive();
    assert_eq!(count(&plant.holds("cell-1", &cell.path()), "same"), 20);
    // Messages of a broker that keeps its name: some of what it took is gone, and nobody says so.
    plant.kill_archive();
    cell.sender = None;
    cell.send(Office { behind_min: 1, ..plant.office("cell-1") });
    cell.cycles(5);
    wait_until_sent(&progress, 30);
    runtime().block_on(async {
        let client = async_nats::connect(format!("127.0.0.1:{}", plant.broker_port)).await.expect("connected");
        let stream = async_nats::jetstream::new(client).get_stream("PANELPREP").await.expect("it is there");
        stream.purge().await.expect("emptied");
    });
    plant.start_archive();
    assert_eq!(count(&plant.holds("cell-1", &cell.path()), "same"), 30);
}

/// A record is told to be in the office once all of its files are there too, in whatever order they come.
#[test]
fn a_record_counts_with_its_files() {
    let Some(plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.cycles(1);
    let office = plant.office("cell-1");
    let last = cell.store.outbox_epochs().expect("epochs").pop().expect("one");
    let begin = Position { number: 0, ..last.clone() };
    let records = cell.store.outbox_after(&begin, 10).expect("two");
    let Body::Signature { files, .. } = &records[1].body else { panic!("a signature") };
    assert!(files.len() >= 2, "{files:?}");
    for envelope in &records {
        let message = Message { cell: office.cell.clone(), envelope: envelope.clone() };
        let what = What::Message(envelope.position.clone());
        publish(&plant, &chunks(&office.cell, &what, &message.bytes().expect("bytes")).expect("parts"));
    }
    let archived = || {
        let link = async {
            let link = CellLink::connect(&office.broker, &office.cell).await.expect("connected");
            link.archived(&last.epoch).await.expect("told")
        };
        runtime().block_on(link)
    };
    let wait_for = |number: u64| {
        let since = Instant::now();
        while archived() != Some(number) {
            assert!(since.elapsed() < PATIENCE, "{number}: {:?}\n{}", archived(), plant.log());
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    wait_for(1);
    for file in files {
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(archived(), Some(1), "{} is not there yet", file.name);
        let bytes = cell.store.blob(&file.hash).expect("whole");
        publish(&plant, &chunks(&office.cell, &What::File(file.hash.clone()), &bytes).expect("parts"));
    }
    wait_for(2);
}

/// Waits until the broker has taken everything up to this number of the only epoch.
fn wait_until_sent(progress: &Path, number: u64) {
    let since = Instant::now();
    loop {
        let read: Value = serde_json::from_slice(&fs::read(progress).unwrap_or_default()).unwrap_or_default();
        if read["sent"].as_object().is_some_and(|all| all.values().any(|sent| sent.as_u64() == Some(number))) {
            return;
        }
        assert!(since.elapsed() < PATIENCE, "{read}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn sql(plant: &Plant, statements: &str) {
    let text = fs::read_to_string(&plant.settings).expect("settings");
    let port = text.rsplit_once("port = ").expect("a port").1.trim().to_owned();
    let psql = postgres_programs().expect("programs").join("psql");
    let arguments =
        ["-h", "127.0.0.1", "-p", &port, "-U", "panelprep", "-v", "ON_ERROR_STOP=1", "-q", "-c", statements];
    let done = Command::new(psql).args(arguments).arg("panelprep").output().expect("psql");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

/// A cell that gets another name, and one whose office is another one, send everything there.
#[test]
fn under_another_name_and_to_another_office_everything_is_sent() {
    let (Some(plant), Some(other)) = (Plant::start(), Plant::start()) else { return };
    let mut cell = Cell::new();
    cell.cycles(4);
    for (plant, name) in [(&plant, "cell-1"), (&plant, "cell-2"), (&other, "cell-2"), (&plant, "cell-1")] {
        cell.send(plant.office(name));
        plant.holds(name, &cell.path());
        cell.sender = None;
    }
}

/// Another cell under the same name, a record that somebody changes in the database, and garbage: each is told, none replaces anything.
#[test]
fn contradictions_changes_and_garbage_are_told_and_replace_nothing() {
    let Some(plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.send(plant.office("cell-1"));
    cell.cycles(3);
    plant.holds("cell-1", &cell.path());
    garbage(&plant);
    // Whoever speaks under the cell's name, epoch and number without its key.
    let mut forged = cell.store.outbox_after(&cell.store.outbox_epochs().expect("epochs")[0], 1).expect("none");
    assert!(forged.is_empty());
    let begin = Position { number: 0, ..cell.store.outbox_epochs().expect("epochs")[0].clone() };
    forged = cell.store.outbox_after(&begin, 1).expect("the first");
    let Body::Cycle(content) = &mut forged[0].body else { panic!("a cycle") };
    *content = String::from_utf8(content.clone()).expect("text").replace("\"pass\"", "\"fail\"").into_bytes();
    let name = CellName::new("cell-1").expect("a name");
    let message = Message { cell: name.clone(), envelope: forged[0].clone() };
    let what = What::Message(message.envelope.position.clone());
    let parts = chunks(&name, &what, &message.bytes().expect("bytes")).expect("parts");
    publish_without_names(&plant, &parts);
    let since = Instant::now();
    let told = loop {
        let (exit, found) = plant.check(&format!("cell-1={}", cell.path().display()));
        if exit == 1 {
            break found.to_string();
        }
        assert!(since.elapsed() < PATIENCE, "{found}\n{}", plant.log());
        std::thread::sleep(Duration::from_millis(100));
    };
    assert!(told.contains("came a second time with the SHA-256"), "{told}");
    assert!(told.contains("\"same\":6"), "the first one stands: {told}");
    assert!(plant.log().contains("refused"), "{}", plant.log());
    // What somebody changes in the database.
    sql(
        &plant,
        "DELETE FROM contradictions; UPDATE records SET content = convert_to(replace(convert_from(content, 'UTF8'), 'wing', 'tail'), 'UTF8') WHERE number = 2",
    );
    let (exit, found) = plant.check("");
    let found = found.to_string();
    assert!(exit == 1 && found.contains("number 2 of epoch") && found.contains("was changed"), "{found}");
    assert!(found.contains("is not what its cell signed"), "{found}");
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime")
}

fn publish(plant: &Plant, parts: &[Chunk]) {
    let office = plant.office("cell-1");
    runtime().block_on(async {
        let link = CellLink::connect(&office.broker, &office.cell).await.expect("connected");
        // The archive makes the stream when it starts.
        let since = Instant::now();
        while let Err(error) = link.stream().await {
            assert!(since.elapsed() < PATIENCE, "{error}\n{}", plant.log());
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        for part in parts {
            link.send(part, 0).await.expect("sent").taken().await.expect("taken");
        }
    });
}

/// As a sender does whose messages the broker does not know again: after its hour, or one that never told their names.
fn publish_without_names(plant: &Plant, parts: &[Chunk]) {
    runtime().block_on(async {
        let client = async_nats::connect(format!("127.0.0.1:{}", plant.broker_port)).await.expect("connected");
        for part in parts {
            let subject = panelprep::office::subject::records(&part.cell);
            client.publish(subject, part.bytes().expect("bytes").into()).await.expect("sent");
        }
        client.flush().await.expect("sent");
    });
}

/// What is no part of anything, and parts that contradict one another.
fn garbage(plant: &Plant) {
    let name = CellName::new("cell-1").expect("a name");
    let part = |hash: &str, part, parts| Chunk {
        cell: name.clone(),
        what: What::File(hash.repeat(32)),
        part,
        parts,
        bytes: b"nothing".to_vec(),
    };
    publish(plant, &[part("ab", 1, 1), part("cd", 1, 2), part("cd", 2, 3)]);
    let other = CellName::new("cell-2").expect("a name");
    // In another cell's name.
    publish(plant, &[Chunk { cell: other, ..part("ef", 1, 1) }]);
}

/// A robot does the same without an office, with one whose broker never answers, and with one that takes everything.
#[test]
fn the_office_changes_nothing_of_what_the_robot_does() {
    let Some(plant) = Plant::start() else { return };
    let with = |broker_port: Option<u16>| {
        let folder = taught("good");
        if let Some(port) = broker_port {
            with_office(folder.path(), port);
        }
        one_cycle(&Service::start(folder.path()));
        trace(folder.path())
    };
    // It takes connections and says nothing.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let without = with(None);
    assert!(without.iter().any(|line| line.contains("Contact")), "it abrades: {without:#?}");
    assert_eq!(with(Some(silent.local_addr().expect("its port").port())), without);
    assert_eq!(with(Some(plant.broker_port)), without);
}

/// The office's page as people use it: a wrong password, then every page, in a browser.
#[test]
fn people_look_at_all_cells_in_a_browser() {
    let Some(mut plant) = Plant::start() else { return };
    let Some(modules) = modules() else { return };
    let port = free_port();
    let settings = fs::read_to_string(&plant.settings).expect("settings")
        + &format!("[fleet]\nlisten = \"127.0.0.1:{port}\"\n");
    fs::write(&plant.settings, settings).expect("written");
    let folder = taught("good");
    with_office(folder.path(), plant.broker_port);
    let service = Service::start(folder.path());
    service.reset();
    service.done(&format!("{START} --part SN-0017 --order W-4 --wait"));
    let mut other = Cell::new();
    other.send(plant.office("cell-2"));
    other.cycles(30);
    let store = Store::open(&folder.path().join("cell/store")).expect("a store");
    service.wait("its record is signed", |_| !store.signatures().expect("read").is_empty());
    plant.holds("cell-1", &folder.path().join("cell/store"));
    plant.holds("cell-2", &other.path());
    let account = format!("archive account office --printed-name Office --settings {}", plant.settings.display());
    let mut made = super::commands::started(plant.folder.path(), &account);
    std::io::Write::write_all(&mut made.stdin.take().expect("an input"), b"a long password\n").expect("written");
    assert!(made.wait().expect("it ends").success());
    let _fleet = Ends(super::commands::started(
        plant.folder.path(),
        &format!("fleet --settings {}", plant.settings.display()),
    ));
    plant.broker.start();
    let since = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(since.elapsed() < PATIENCE, "the office's page does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    // A recipe is approved once: each cell is offered it, and none takes it by itself.
    let recipe = fs::read_to_string(folder.path().join("cell/recipe.toml")).expect("a recipe");
    let offered = plant.folder.path().join("offered.toml");
    fs::write(&offered, recipe.clone() + "\n# approved in the office\n").expect("written");
    let (exit, told) = json(
        plant.folder.path(),
        &format!(
            "archive offer {} --by Anna --why finer --settings {}",
            offered.display(),
            plant.settings.display()
        ),
    );
    assert_eq!(exit, 0, "{told}");
    let address = plant.office("cell-1");
    let offer = runtime().block_on(async {
        let link = CellLink::connect(&address.broker, &address.cell).await.expect("connected");
        link.offer("simulated-panel").await.expect("asked").expect("offered")
    });
    assert_eq!((offer.by.as_str(), offer.text.ends_with("# approved in the office\n")), ("Anna", true));
    assert_eq!(fs::read_to_string(folder.path().join("cell/recipe.toml")).expect("a recipe"), recipe);
    let browser = in_browser("fleet.mjs", &format!("http://127.0.0.1:{port}"), &modules);
    let told = browser.wait_with_output().expect("it ends");
    let [words, problems] = [&told.stdout, &told.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(told.status.success() && words.lines().last() == Some("whole"), "{words}\n{problems}");
}

/// Is killed when the test ends.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
