//! Tests clients of the service that are slow, silent, endless or wrong on purpose. A stop is still accepted, and these
//! clients cannot write files that only the service may write.

mod clients;

use super::service::{START, Service, socket, taught};
use clients::harass;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Runs forty hostile clients and two hundred silent connections. Each stop and each abort is accepted at its first
/// attempt.
#[test]
fn a_stop_is_accepted_despite_hostile_clients() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    let (socket, ends, done) = (socket(folder), AtomicBool::new(false), AtomicUsize::new(0));
    std::thread::scope(|scope| {
        for kind in 0..40 {
            let (socket, ends, done) = (&socket, &ends, &done);
            scope.spawn(move || harass(socket, kind, ends, done));
        }
        let silent: Vec<UnixStream> = (0..200).filter_map(|_| UnixStream::connect(&socket).ok()).collect();
        let mut failed = Vec::new();
        for line in [&b"{\"ask\":\"stop\"}\n"[..], b"{\"ask\":\"abort\"}\n", b"{\"ask\":\"abort\"}\n"] {
            let mut stream = UnixStream::connect(&socket).expect("it listens");
            stream.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
            let mut answer = String::new();
            let heard = stream.write_all(line).and_then(|()| stream.read_to_string(&mut answer));
            // The last request reaches a cell that is already aborted: the loop has received the request and reports
            // this.
            if heard.is_err() || !(answer.contains("\"answer\":\"done\"") || answer.contains("not_now")) {
                failed.push(format!("{}{heard:?} {answer}", String::from_utf8_lossy(line)));
            }
        }
        ends.store(true, Ordering::Relaxed);
        assert!(failed.is_empty(), "{failed:#?}\n{}", service.log());
        drop(silent);
    });
    assert!(done.load(Ordering::Relaxed) > 40, "they were there");
    service.reach("aborted");
    service.done("clear");
}

/// A client can request a recording only in a new file outside of the store, given by its full path. No text of a
/// client can begin a line of the log.
#[test]
fn no_client_writes_into_the_store_or_forges_a_log_line() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    let store = folder.join("cell/store").canonicalize().expect("it is there");
    let outside = folder.canonicalize().expect("it is there");
    std::os::unix::fs::symlink(&store, outside.join("link")).expect("a link");
    std::os::unix::fs::symlink("/nowhere/at/all", outside.join("dangling.mcap")).expect("a link");
    let inside = "is inside the store";
    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("rendered");
    for (file, words) in [
        (format!("{}/panelprep.sqlite-journal", store.display()), inside),
        (format!("{}/blobs/0123", store.display()), inside),
        (format!("{}/link/blobs/0123", outside.display()), inside),
        (format!("{}/cell/../cell/store/a.mcap", outside.display()), "contains . or .."),
        (format!("{}/./a.mcap", outside.display()), "contains . or .."),
        (format!("{}/new/.", outside.display()), "contains . or .."),
        (format!("{}/", outside.display()), "names a folder"),
        ("a.mcap".to_owned(), "the path is relative"),
        (format!("{}/a\n2026-01-01 WARN root (uid 0) asks: abort.mcap", outside.display()), "control characters"),
        (format!("{}/dangling.mcap", outside.display()), "already exists"),
        (format!("{}/nowhere/a.mcap", outside.display()), "no such folder"),
    ] {
        let line = serde_json::json!({
            "ask": "start", "recipe": "x\n2026-01-01 WARN forged\u{1b}[2K", "text": recipe, "record": {"file": file},
        });
        let mut stream = UnixStream::connect(socket(folder)).expect("it listens");
        stream.write_all(format!("{line}\n").as_bytes()).expect("it reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("it answers");
        assert!(answer.contains(words) && answer.contains("\"refused\""), "{file:?}: {answer}");
    }
    assert!(!outside.join("a.mcap").exists() && service.state() == "idle", "nothing began");
    service.refused(&format!("{START} --record {}/a.mcap", store.display()), 2, inside);
    service.done(&format!("{START} --record {}/a.mcap --part SN-7 --operator Anna", outside.display()));
    service.done("abort");
    let log = service.log();
    assert!(!log.contains('\u{1b}') && !log.lines().any(|line| line.starts_with("2026-01-01")), "{log}");
    assert!(log.contains("(uid ") && log.contains("asks: abort"), "{log}");
}
