//! A cell as a process of its own: a store with new records, and the service's sender.

use panelprep::cell::{Broker, BrokerLogin, CellName, Office};
use panelprep::daemon::{OfficeParts, OfficeSender, OfficeStatus};
use panelprep::record::{CycleId, Finding, Kind, Picture};
use panelprep::signing::CellKey;
use panelprep::store::{CycleStart, Store};
use panelprep::verdict::{Judgement, Verdict};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

/// Pause between two cycles.
const CYCLE_PAUSE: Duration = Duration::from_millis(500);
/// Default size of the single picture of a cycle, bytes.
pub const PICTURE_BYTES: usize = 20_000;

/// Starts this program as a cell process.
pub fn start(name: &str, folder: &Path, broker_port: u16, cycles: usize) -> Child {
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--cell", name]).arg(folder).args([broker_port.to_string(), cycles.to_string()]);
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts")
}

/// Runs as a cell until the process is killed: writes cycles until its store has this number, and sends records.
pub fn run(arguments: &[String]) -> ExitCode {
    let [name, folder, port, cycles] = arguments else { return ExitCode::FAILURE };
    let folder = Path::new(folder);
    let cycles: usize = cycles.parse().expect("a number");
    let mut store = Store::create(folder).expect("a store");
    store.recover().expect("recovered");
    let broker = Broker { address: format!("nats://127.0.0.1:{port}"), ca: None, login: BrokerLogin::Anybody };
    let office = Office { broker, cell: CellName::new(name).expect("a name"), alarm_delay_min: 60 };
    let parts = OfficeParts { office, folder: folder.to_owned(), front: None, status: OfficeStatus::default() };
    let _sender = OfficeSender::start(parts).expect("a thread");
    loop {
        sign_what_is_not(folder);
        if store.ended_cycles().expect("read").len() < cycles {
            cycle(&mut store, PICTURE_BYTES);
        }
        std::thread::sleep(CYCLE_PAUSE);
    }
}

fn key() -> CellKey {
    CellKey::from_random_bytes(&[7; 32])
}

fn sign_what_is_not(folder: &Path) {
    Store::sign_missing(folder, &key(), &|_, _| {}).expect("signed");
}

fn cycle(store: &mut Store, picture_bytes: usize) -> CycleId {
    let start = CycleStart {
        panel: "wing".to_owned(),
        taught_version: "0011223344556677".to_owned(),
        recipe_text: "panel = \"wing\"\n".to_owned(),
        file_texts: vec![("cell".to_owned(), "x = 1\n".to_owned())],
        recording: None,
        is_air_run: false,
    };
    let id = store.begin_cycle(&start).expect("begun");
    let mut picture = format!("picture of cycle {id}").into_bytes();
    picture.resize(picture_bytes, b'.');
    let hash = store.store_blob(&picture).expect("kept");
    let judgement = Judgement { verdict: Verdict::Pass, reasons: vec![] };
    let pictures = vec![Picture { name: "overlay".to_owned(), caption: "what was seen".to_owned(), hash }];
    let finding = Finding { pictures, ..Finding::new(Kind::Inspect, 0, judgement) };
    store.store_finding(id, &finding).expect("noted");
    store.conclude(id, Verdict::Pass, &[]).expect("over");
    id
}

/// Writes a store with this number of cycles, each signed and with a picture of this size.
pub fn write(folder: &Path, cycles: usize, picture_bytes: usize) {
    let mut store = Store::create(folder).expect("a store");
    let key = key();
    for _ in 0..cycles {
        let id = cycle(&mut store, picture_bytes);
        store.sign_cycle(&key, id).expect("signed");
    }
}

/// Returns whether a store has all its cycles, each signed.
pub fn has_written(folder: &Path, cycles: usize) -> bool {
    let Ok(store) = Store::open(folder) else { return false };
    let (ended, signed) = (store.ended_cycles().map(|all| all.len()), store.signatures().map(|all| all.len()));
    ended.is_ok_and(|count| count >= cycles) && signed.is_ok_and(|count| count >= cycles)
}

/// Returns the number of the last record up to which the archive has confirmed all records to the cell.
pub fn archived(folder: &Path) -> u64 {
    let text = std::fs::read_to_string(folder.join("office.json")).unwrap_or_default();
    let found: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    found["archived"].as_object().into_iter().flatten().filter_map(|(_, number)| number.as_u64()).sum()
}
