//! Tests a store that differs from the state in which the service left it: its database is from the day before, or its
//! disk is full.

use super::super::commands::{json, rendered, taught_and_verified};
use super::{START, Service, taught};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The database is from the day before, but the head file is from today. The service stays in Aborted and states why,
/// until a person clears this.
#[test]
fn a_store_that_was_rolled_back_rests_until_a_person_clears_it() {
    let folder = taught("clean");
    let folder = folder.path();
    let (database, verify) = (folder.join("cell/store/panelprep.sqlite"), "store verify --cell cell/cell.toml");
    let yesterday = std::fs::read(&database).expect("a database");
    let service = Service::start(folder);
    service.reset();
    let (exit, beside) = json(folder, verify);
    assert_eq!((exit, &beside["ok"]), (0, &true.into()), "beside the service: {beside}");
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));
    std::fs::write(&database, yesterday).expect("rolled back");

    let (exit, output) = json(folder, verify);
    let found = output["found"].to_string();
    assert!(exit == 1 && output["ok"] == false && found.contains("rolled back"), "{output}");
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml";
    let (exit, refused) = json(folder, cycle);
    assert!(exit == 2 && refused["reasons"].to_string().contains("panelprep store verify"), "{refused}");
    let service = Service::start(folder);
    let found = service.done("state");
    assert!(found["state"] == "aborted" && found["reasons"][0]["code"] == "store_changed", "{found}");
    service.refused("reset", 2, "possible now: clear");
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    service.reset();
    let (exit, output) = json(folder, verify);
    let known = output["known"].to_string();
    assert!(exit == 0 && output["ok"] == true && known.contains("rolled back"), "it stays on record: {output}");
}

/// Another program fills the store's disk in the middle of a cycle. The cell is held and states what to delete; after a
/// restart on the full disk it does the same. When there is free space again, it continues.
#[test]
fn a_full_disk_holds_the_cell_and_a_start_on_it_states_what_to_delete() {
    let folder = rendered("good");
    let folder = folder.path();
    let store = folder.join("cell/store");
    std::fs::create_dir_all(&store).expect("made");
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=1400m", "none"]).arg(&store).output();
    if !mount.as_ref().is_ok_and(|said| said.status.success()) {
        eprintln!("not run: no disk can be mounted here: {mount:?}");
        return;
    }
    let _mounted = Mounted(store.clone());
    taught_and_verified(folder);
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    fill(&store);
    service.reach("held");
    let held = service.done("state")["reasons"].to_string();
    assert!(held.contains("disk_full") && held.contains("delete"), "{held}");
    service.refused("unhold --dried", 3, "is full");
    service.kill_and_wait();

    fill(&store);
    let service = Service::start(folder);
    let reported = service.done("state");
    assert!(reported["reasons"].to_string().contains("delete"), "{reported}");
    assert!(["stopped", "aborted"].contains(&reported["state"].as_str().unwrap_or_default()), "{reported}");
    service.ctl("reset");
    service.wait("it is refused", |service| ["stopped", "aborted"].contains(&&*service.state()));
    assert_ne!(service.ctl(START).0, 0, "nothing starts on a full disk");
    std::fs::remove_file(store.join("ballast")).expect("room");
    service.wait("it continues", |service| {
        if service.state() == "aborted" {
            service.ctl("clear");
        }
        service.ctl("reset");
        service.state() == "idle"
    });
    let (exit, reported) = json(folder, "store verify --cell cell/cell.toml");
    assert_eq!((exit, &reported["ok"]), (0, &true.into()), "{reported}");
}

struct Mounted(PathBuf);

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

/// Fills the remaining space of a disk.
fn fill(disk: &Path) {
    let file = disk.join("ballast");
    let mut ballast = std::fs::OpenOptions::new().create(true).append(true).open(file).expect("made");
    for block in [vec![7; 1 << 20], vec![7; 1]] {
        while ballast.write_all(&block).is_ok() {}
    }
}
