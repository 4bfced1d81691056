//! The configuration files that ship.

use panelprep::check::check_files;
use panelprep::requirements::Purpose;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Every file that ships is read without a problem, and as what it is.
#[test]
fn the_files_that_ship_are_right() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    let mut kinds = Vec::new();
    for folder in [root.clone(), root.join("panels")] {
        for entry in fs::read_dir(&folder).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|extension| extension == "toml") {
                let text = fs::read_to_string(&path).expect("the file is there");
                let name = path.to_string_lossy();
                let report = check_files(&[(&name, &text)], Some(Purpose::Cycle)).swap_remove(0);
                assert_eq!(report.problems, vec![], "{}", path.display());
                assert!(!report.says.is_empty());
                kinds.push(report.kind);
            }
        }
    }
    kinds.sort();
    assert_eq!(kinds, [Some("cell"), Some("cell"), Some("recipe")]);
}

/// What is loaded on the controller has neither errors nor traps, alone and side by side.
#[test]
fn the_channel_files_that_ship_are_right() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/kuka");
    let texts = ["CELLCMD.xml", "CELLSTAT.xml"].map(|name| fs::read_to_string(folder.join(name)).expect("it"));
    for report in check_files(&[("CELLCMD.xml", &texts[0]), ("CELLSTAT.xml", &texts[1])], None) {
        assert_eq!((report.kind, report.problems, report.warnings), (Some("EthernetKRL"), vec![], vec![]));
    }
}

/// The unit lets through what the program itself calls beyond its groups (nice, for the link and for computing), and is
/// hardened as far as it says: 2.0 at most where systemd is here to judge it.
#[test]
fn the_unit_that_ships_is_hardened_and_lets_the_program_live() {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/panelprep.service");
    let text = fs::read_to_string(&unit).expect("it is there");
    let at = |line: &str| text.lines().position(|found| found == line).unwrap_or_else(|| panic!("no {line}"));
    assert!(at("SystemCallFilter=setpriority") > at("SystemCallFilter=~@privileged @resources"));
    at("SystemCallErrorNumber=EPERM");
    at("LimitNICE=-10");
    // Without it no GigE Vision camera is found: the search lists the network's interfaces by it.
    at("RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK");
    let mut judge = Command::new("systemd-analyze");
    judge.args(["security", "--offline=true", "--threshold=20", "--no-pager"]).arg(unit);
    match judge.output() {
        Ok(judged) => assert!(judged.status.success(), "{}", String::from_utf8_lossy(&judged.stdout)),
        Err(error) => eprintln!("systemd-analyze is not here: {error}"),
    }
}
