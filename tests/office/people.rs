//! Tests the web page of the office server, and the actions of people there.

use super::offices::{Cell, Plant, TIMEOUT, runtime};
use super::with_office;
use crate::commands::{json, start_program};
use crate::operator_page::{in_browser, modules};
use crate::plant::{archive_settings, database, free_port, postgres_programs};
use crate::service::{START, Service, taught};
use panelprep::broker::CellLink;
use panelprep::store::Store;
use std::fs;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

/// Uses the web page of the office server in a browser as people do: a wrong password, then every page.
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
    plant.wait_until_archived("cell-1", &folder.path().join("cell/store"));
    plant.wait_until_archived("cell-2", &other.path());
    let account = format!("archive account office --printed-name Office --settings {}", plant.settings.display());
    let mut made = start_program(plant.folder.path(), &account);
    std::io::Write::write_all(&mut made.stdin.take().expect("an input"), b"a long password\n").expect("written");
    assert!(made.wait().expect("it ends").success());
    let _fleet =
        KilledOnDrop(start_program(plant.folder.path(), &format!("fleet --settings {}", plant.settings.display())));
    plant.broker.start();
    let since = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(since.elapsed() < TIMEOUT, "the office's page does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    // A recipe is approved once: it is offered to each cell, and no cell uses it automatically.
    let recipe = fs::read_to_string(folder.path().join("cell/recipe.toml")).expect("a recipe");
    let offered = plant.folder.path().join("offered.toml");
    fs::write(&offered, recipe.clone() + "\n# approved in the office\n").expect("written");
    let (exit, reply) = json(
        plant.folder.path(),
        &format!(
            "archive offer {} --by Anna --why finer --settings {}",
            offered.display(),
            plant.settings.display()
        ),
    );
    assert_eq!(exit, 0, "{reply}");
    let address = plant.office("cell-1");
    let offer = runtime().block_on(async {
        let link = CellLink::connect(&address.broker, &address.cell).await.expect("connected");
        link.recipe_offer("simulated-panel").await.expect("asked").expect("offered")
    });
    assert_eq!((offer.by.as_str(), offer.text.ends_with("# approved in the office\n")), ("Anna", true));
    assert_eq!(fs::read_to_string(folder.path().join("cell/recipe.toml")).expect("a recipe"), recipe);
    let browser = in_browser("fleet.mjs", &format!("http://127.0.0.1:{port}"), &modules);
    let reply = browser.wait_with_output().expect("it ends");
    let [words, problems] = [&reply.stdout, &reply.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(reply.status.success() && words.lines().last() == Some("whole"), "{words}\n{problems}");
}

/// A session of the page ends when its account gets another password. Only the database is needed for this.
#[test]
fn an_office_session_ends_when_its_account_changes() {
    let Some(programs) = postgres_programs() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let _database = database(&programs, folder.path(), free_port_of_database(folder.path()));
    let port = free_port();
    let settings = folder.path().join("archive.toml");
    let text = fs::read_to_string(&settings).expect("settings");
    fs::write(&settings, text + &format!("[fleet]\nlisten = \"127.0.0.1:{port}\"\n")).expect("written");
    // The archive creates the tables; it waits for a broker that is not started.
    let _archive = KilledOnDrop(start_program(folder.path(), "archive run --settings archive.toml"));
    store_account(folder.path(), "a long password");
    let _fleet = KilledOnDrop(start_program(folder.path(), "fleet --settings archive.toml"));
    let since = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(since.elapsed() < TIMEOUT, "the office's page does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    let form = "name=office&password=a+long+password";
    let answer = ask(
        port,
        &format!(
            "POST /login HTTP/1.1\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: {}",
            form.len()
        ),
        form,
    );
    let cookie = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")?.split(';').next());
    let cookie = cookie.unwrap_or_else(|| panic!("{answer}"));
    let page = || ask(port, &format!("GET /recipes HTTP/1.1\r\nCookie: {cookie}"), "");
    assert!(page().starts_with("HTTP/1.1 200"), "{}", page());
    store_account(folder.path(), "another long password");
    let ended = page();
    assert!(ended.starts_with("HTTP/1.1 303") && ended.contains("location: /login"), "{ended}");
}

fn free_port_of_database(folder: &Path) -> u16 {
    let port = free_port();
    archive_settings(folder, free_port(), port);
    port
}

/// Writes the account `office` with this password, after the database has its tables.
fn store_account(folder: &Path, password: &str) {
    let since = Instant::now();
    let is_kept = || {
        let mut made =
            start_program(folder, "archive account office --printed-name Office --settings archive.toml");
        let line = format!("{password}\n");
        std::io::Write::write_all(&mut made.stdin.take().expect("an input"), line.as_bytes()).expect("written");
        made.wait().expect("it ends").success()
    };
    while !is_kept() {
        assert!(since.elapsed() < TIMEOUT, "the account is not kept");
        std::thread::sleep(Duration::from_millis(200));
    }
}

/// Returns the response to one request of a browser.
fn ask(port: u16, head: &str, body: &str) -> String {
    use std::io::{Read, Write};
    let mut stream = std::net::TcpStream::connect(("127.0.0.1", port)).expect("connected");
    write!(stream, "{head}\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n{body}").expect("sent");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("answered");
    String::from_utf8_lossy(&answer).into_owned()
}

/// A child process that is killed when the test ends.
struct KilledOnDrop(Child);

impl Drop for KilledOnDrop {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
