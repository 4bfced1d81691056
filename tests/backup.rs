//! Tests `panelprep backup` and `restore` as a user runs them: during a cycle of the service, and on another machine.

use super::commands::json;
use super::service::{START, Service, taught};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn verify(folder: &Path, cell: &str) -> Value {
    let (exit, told) = json(folder, &format!("store verify --cell {cell}"));
    assert_eq!((exit, &told["ok"]), (0, &Value::Bool(true)), "{told}");
    told
}

/// Returns a page without the sentence with its creation time.
fn page(folder: &Path, cell: &str, cycle: i64) -> String {
    let (exit, told) = json(folder, &format!("page {cycle} --cell {cell} --out page.html"));
    assert_eq!(exit, 0, "{told}");
    let text = fs::read_to_string(folder.join("page.html")).expect("a page");
    fs::remove_file(folder.join("page.html")).expect("removed");
    let (before, rest) = text.split_once("This page was made on ").expect("the sentence");
    let after = rest.split_once(" by panelprep ").expect("its end").1;
    format!("{before}{after}")
}

#[test]
fn a_backup_beside_a_running_cycle_gives_the_same_records_elsewhere() {
    let folder = taught("clean");
    let folder = folder.path();
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    service.reach("complete");
    service.reset();
    service.done(START);
    service.wait("work", |service| service.state() == "execute");
    let (exit, made) = json(folder, "backup first.tar.zst --cell cell/cell.toml");
    assert_eq!((exit, &made["ok"], &made["verdict"]), (0, &true.into(), &"pass".into()), "{made}");
    assert_eq!(service.state(), "execute", "the cycle continues meanwhile");
    service.reach("complete");

    // A restore into the same folder is refused while the service answers.
    let in_place = "restore first.tar.zst --cell cell/cell.toml --only store --replace store";
    let (exit, output) = json(folder, in_place);
    assert!(exit == 2 && output["reasons"].to_string().contains("a service is running on"), "{output}");
    let (exit, second) = json(folder, "backup second.tar.zst --cell cell/cell.toml");
    assert_eq!(exit, 0, "{second}");
    assert!(second["links"].as_i64() > made["links"].as_i64(), "the rest of the cycle: {second} {made}");
    let (exit, output) = json(folder, "backup second.tar.zst --cell cell/cell.toml");
    assert!(exit == 2 && output["reasons"].to_string().contains("is not overwritten"), "{output}");
    // The pages are read before the signal, because the signal appears on the page of the last cycle.
    let pages = [1, 2].map(|cycle| page(folder, "cell/cell.toml", cycle));
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));

    // The store that is restored on another machine has the same rows, and the pages created from them are the same.
    let (exit, output) = json(folder, "restore second.tar.zst --cell other/cell.toml");
    assert!(exit == 2 && output["reasons"].to_string().contains("--last-cycle"), "{output}");
    let (exit, output) = json(folder, "restore second.tar.zst --cell other/cell.toml --last-cycle 2");
    assert_eq!((exit, &output["links"]), (0, &second["links"]), "{output}");
    verify(folder, "other/cell.toml");
    for (cycle, before) in (1..).zip(pages) {
        assert!(page(folder, "other/cell.toml", cycle) == before, "page {cycle} is another one");
    }
    let history =
        |cell: &str| json(folder, &format!("calibrate history --cell {cell}")).1["verifications"].to_string();
    assert_eq!(history("cell/cell.toml"), history("other/cell.toml"));
    let (exit, checked) = json(folder, "check --for cycle other/cell.toml other/recipe.toml");
    assert_eq!(exit, 0, "{checked}");
    assert!(!checked.to_string().contains("is not there"), "its calibrations came with it: {checked}");
    // The backup does not contain the cell's later actions: a person must check the cell first, and numbers continue
    // above the last known number.
    let cycle = "cycle --cell other/cell.toml --recipe other/recipe.toml --scene clean --seed 3";
    let (exit, told) = json(folder, cycle);
    assert!(exit == 2 && told["reasons"].to_string().contains("panelprep clear"), "{told}");
    let (exit, told) = json(folder, "clear --cell other/cell.toml");
    assert_eq!(exit, 0, "{told}");
    let (exit, told) = json(folder, cycle);
    assert!(exit == 2 && told["reasons"].to_string().contains("--lost-passes"), "{told}");
    let (exit, told) = json(folder, &format!("{cycle} --part SN-9 --another-part"));
    assert!(
        exit == 2
            && told["reasons"].to_string().contains("the number of sanding passes on the part SN-9 is unknown"),
        "{told}"
    );
    let (exit, told) = json(folder, &format!("{cycle} --another-part"));
    assert!(exit == 0 && told["cycle_id"].as_i64().is_some_and(|id| id >= 3), "{told}");

    // The backup that was made during a running cycle contains a store with an incomplete cycle, and the restore
    // reports this.
    let (exit, output) = json(folder, in_place);
    assert_eq!(exit, 0, "{output}");
    assert!(output["kept"].to_string().contains("cell/store.before-restore-1"), "{output}");
    assert_eq!(verify(folder, "cell/cell.toml")["links"], made["links"]);
    let service = Service::start(folder);
    assert_eq!(service.state(), "aborted", "{}", service.log());
}

/// If one bit of a backup is changed, the command prints a message, ends with exit code 1, and changes nothing.
#[test]
fn a_damaged_backup_is_reported_and_changes_nothing() {
    let folder = super::commands::rendered("clean");
    let folder = folder.path();
    assert_eq!(json(folder, super::commands::TEACH).0, 0);
    assert_eq!(json(folder, "backup cell.tar.zst --cell cell/cell.toml").0, 0);
    let mut bytes = fs::read(folder.join("cell.tar.zst")).expect("read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(folder.join("cell.tar.zst"), bytes).expect("spoilt");
    let (exit, told) = json(folder, "restore cell.tar.zst --cell other/cell.toml --last-cycle 0");
    assert_eq!((exit, &told["ok"], &told["verdict"]), (1, &false.into(), &"fail".into()), "{told}");
    assert!(told["found"][0].as_str().is_some_and(|words| words.contains("is damaged: its SHA-256")), "{told}");
    assert!(!folder.join("other").exists());
    let (exit, told) = json(folder, "restore cell/cell.toml --cell other/cell.toml");
    assert!(exit == 1 && told["found"].to_string().contains("is not a backup"), "{told}");
}

/// Other programs, if they are installed, can also open the archive.
#[test]
fn an_archive_is_a_tar_file() {
    let folder = super::commands::rendered("clean");
    let folder = folder.path();
    assert_eq!(json(folder, "backup cell.tar.zst --cell cell/cell.toml --only configuration").0, 0);
    let listed =
        std::process::Command::new("tar").args(["--zstd", "-tf", "cell.tar.zst"]).current_dir(folder).output();
    match listed {
        Ok(output) if output.status.success() => {
            let names = String::from_utf8_lossy(&output.stdout).into_owned();
            let expected = ["manifest.json", "configuration/cell.toml", "configuration/named/calibration.scanner"];
            assert!(expected.iter().all(|name| names.lines().any(|line| line == *name)), "{names}");
            assert!(names.contains("configuration/recipes/recipe.toml"), "{names}");
        }
        other => eprintln!("not run: no tar with zstd here: {other:?}"),
    }
}
