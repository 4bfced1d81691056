//! The configuration files that ship.

use panelprep::check::check_file;
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
