//! The configuration files that ship.

use panelprep::check::{check_file, check_files};
use std::fs;
use std::path::Path;

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
                let report = check_file(&path.to_string_lossy(), &text);
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
    for report in check_files(&[("CELLCMD.xml", &texts[0]), ("CELLSTAT.xml", &texts[1])]) {
        assert_eq!((report.kind, report.problems, report.warnings), (Some("EthernetKRL"), vec![], vec![]));
    }
}
