//! An office server with broker, database and archive, and cells that send to it, each with the same sender as the
//! service.

use crate::commands::json;
use crate::plant::{Server, archive_settings, broker, database, free_port, nats_server, postgres_programs};
use panelprep::broker::CellLink;
use panelprep::cell::{Broker, BrokerLogin, CellName, Office};
use panelprep::daemon::{OfficeParts, OfficeSender, OfficeStatus};
use panelprep::office::Chunk;
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

pub const TIMEOUT: Duration = Duration::from_secs(120);

/// The office server: broker, database and archive.
pub struct Plant {
    pub folder: TempDir,
    pub settings: PathBuf,
    pub broker_port: u16,
    pub broker: Server,
    pub database: Server,
    pub archive: Option<Child>,
}

impl Drop for Plant {
    fn drop(&mut self) {
        self.kill_archive();
    }
}

impl Plant {
    /// Starts the office server; prints a message and returns `None` if its programs are not installed.
    pub fn start() -> Option<Self> {
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

    pub fn start_archive(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.folder.path().join("archive.log"));
        let child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["archive", "run", "--settings"])
            .arg(&self.settings)
            .stdout(Stdio::null())
            .stderr(log.expect("a log"))
            .spawn();
        self.archive = Some(child.expect("the archive starts"));
    }

    pub fn kill_archive(&mut self) {
        if let Some(mut child) = self.archive.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("archive.log")).unwrap_or_default()
    }

    /// Runs `archive check` for these cells.
    pub fn check(&self, cells: &str) -> (i32, Value) {
        json(self.folder.path(), &format!("archive check --settings {} {cells}", self.settings.display()))
    }

    /// Waits until the archive contains the same records as the cell.
    pub fn wait_until_archived(&self, cell: &str, store: &Path) -> Value {
        let since = Instant::now();
        loop {
            let (exit, found) = self.check(&format!("{cell}={}", store.display()));
            if exit == 0 {
                return found;
            }
            assert!(since.elapsed() < TIMEOUT, "{found}\n{}", self.log());
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    pub fn office(&self, cell: &str) -> Office {
        let address = format!("nats://127.0.0.1:{}", self.broker_port);
        let broker = Broker { address, ca: None, login: BrokerLogin::Anybody };
        Office { broker, cell: CellName::new(cell).expect("a name"), alarm_delay_min: 60 }
    }
}

/// A store with its sender, as in the service.
pub struct Cell {
    pub folder: TempDir,
    pub store: Store,
    pub status: OfficeStatus,
    pub sender: Option<OfficeSender>,
}

impl Cell {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::create(&folder.path().join("store")).expect("a store");
        Cell { folder, store, status: OfficeStatus::default(), sender: None }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("store")
    }

    pub fn send(&mut self, office: Office) {
        let parts = OfficeParts { office, folder: self.path(), front: None, status: self.status.clone() };
        self.sender = Some(OfficeSender::start(parts).expect("a thread"));
    }

    pub fn cycles(&mut self, count: usize) {
        let key = CellKey::from_random_bytes(&[7; 32]);
        for number in 0..count {
            let start = CycleStart {
                panel: "wing".to_owned(),
                taught_version: "0011223344556677".to_owned(),
                recipe_text: format!("# {number}\n"),
                file_texts: vec![("cell".to_owned(), "x = 1\n".to_owned())],
                recording: None,
                is_air_run: false,
            };
            let id: CycleId = self.store.begin_cycle(&start).expect("begun");
            self.store.conclude(id, Verdict::Pass, &[]).expect("over");
            self.store.sign_cycle(&key, id).expect("signed");
        }
    }
}

pub fn count(found: &Value, what: &str) -> u64 {
    found["cells"][0][what].as_u64().unwrap_or_else(|| panic!("{what}: {found}"))
}

pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime")
}

pub fn publish(plant: &Plant, parts: &[Chunk]) {
    let office = plant.office("cell-1");
    runtime().block_on(async {
        let link = CellLink::connect(&office.broker, &office.cell).await.expect("connected");
        // The archive creates the stream when it starts, so several attempts may be necessary.
        let since = Instant::now();
        while let Err(error) = link.stream().await {
            assert!(since.elapsed() < TIMEOUT, "{error}\n{}", plant.log());
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        for part in parts {
            link.send(part, 0).await.expect("sent").wait_acknowledged().await.expect("taken");
        }
    });
}

pub fn sql(plant: &Plant, statements: &str) {
    let text = fs::read_to_string(&plant.settings).expect("settings");
    let port = text.rsplit_once("port = ").expect("a port").1.trim().to_owned();
    let psql = postgres_programs().expect("programs").join("psql");
    let arguments =
        ["-h", "127.0.0.1", "-p", &port, "-U", "panelprep", "-v", "ON_ERROR_STOP=1", "-q", "-c", statements];
    let done = Command::new(psql).args(arguments).arg("panelprep").output().expect("psql");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}
