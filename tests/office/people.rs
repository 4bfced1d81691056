//! The office's page, and the actions of people there.

use super::offices::{Cell, Plant, TIMEOUT, runtime};
use super::with_office;
use crate::commands::{json, started};
use crate::operator_page::{in_browser, modules};
use crate::plant::free_port;
use crate::service::{START, Service, taught};
use panelprep::broker::CellLink;
use panelprep::store::Store;
use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

/// Uses the office's page in a browser as people do: a wrong password, then every page.
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
    let mut made = started(plant.folder.path(), &account);
    std::io::Write::write_all(&mut made.stdin.take().expect("an input"), b"a long password\n").expect("written");
    assert!(made.wait().expect("it ends").success());
    let _fleet = Ends(started(plant.folder.path(), &format!("fleet --settings {}", plant.settings.display())));
    plant.broker.start();
    let since = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(since.elapsed() < TIMEOUT, "the office's page does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    // A recipe is approved once: it is offered to each cell, and no cell uses it by itself.
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

/// A child process that is killed when the test ends.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
