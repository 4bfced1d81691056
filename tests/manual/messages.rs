//! The page of messages has a row for each code that the program gives as a reason.

use super::pages;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The codes of the page, and what is wrong with its rows.
fn rows(text: &str) -> BTreeSet<String> {
    let mut codes = BTreeSet::new();
    for line in text.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells.len(), 3, "code, meaning, what to do: {line}");
        assert!(cells.iter().all(|cell| !cell.is_empty()), "{line}");
        assert!(codes.insert(cells[0].trim_matches('`').to_owned()), "twice: {line}");
    }
    codes
}

/// The sources of the program without their tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        if path.is_dir() && name != "tests" {
            sources(&path, found);
        } else if name.ends_with(".rs") && !name.starts_with("tests") {
            found.push(path);
        }
    }
}

/// A stable word: lower case and underscores.
fn word(text: &str) -> Option<String> {
    let word = text.trim_start().strip_prefix('"')?.split('"').next()?;
    let is_word = !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    is_word.then(|| word.to_owned())
}

/// The codes that a file names: behind the calls that make a reason, and in the tables that give one for a cause.
fn codes(path: &Path, text: &str) -> BTreeSet<String> {
    const CALLS: [&str; 6] = ["Reason::new(", ".bound(", ".doubt(", " reason(", "sight::reason(", "refused("];
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let mut found: BTreeSet<String> =
        CALLS.iter().flat_map(|call| text.split(call).skip(1).filter_map(word)).collect();
    let name = path.display().to_string();
    let of = |ending: &str| name.ends_with(ending);
    let arguments = |at: usize, call: &str| -> Vec<String> {
        text.split(call).skip(1).filter_map(|rest| word(rest.split(", ").nth(at)?)).collect()
    };
    let arrows = || {
        text.split("=>")
            .skip(1)
            .filter_map(|rest| word(rest.trim_start().trim_start_matches(['{', '(', ' ', '\n'])))
    };
    if of("locate/gate.rs") {
        for call in ["against.reject(", "against.review("] {
            found.extend((1..4).flat_map(|at| arguments(at, call)));
        }
    }
    if of("locate/refine/judge.rs") {
        found.extend(
            text.split("beyond(refined").skip(1).filter_map(|rest| rest.split(", ").take(6).find_map(word)),
        );
    }
    if of("daemon/words.rs") {
        let tables = text.split("fn robot(").nth(1).unwrap_or_default().split("\n}").take(1);
        let tables: String =
            tables.chain(text.split("fn trouble(").nth(1).unwrap_or_default().split("\n}").take(1)).collect();
        found.extend(
            tables
                .split("=>")
                .skip(1)
                .filter_map(|rest| word(rest.trim_start().trim_start_matches(['{', '(', ' ', '\n']))),
        );
    }
    if of("path/reach/obstacle.rs") {
        let table = text.split("fn code(").nth(1).unwrap_or_default().split("\n    }").next().unwrap_or_default();
        found.extend(table.split("=>").skip(1).filter_map(word));
    }
    if of("inspect/quality.rs") {
        let table = text.split("fn word(").nth(1).unwrap_or_default().split("\n    }").next().unwrap_or_default();
        found.extend(table.split("=>").skip(1).filter_map(word));
    }
    if of("cli/robot.rs") {
        found.extend(
            arrows().filter(|code| ["no_controller", "robot", "link_lost", "late"].contains(&code.as_str())),
        );
    }
    found
}

/// Every code that the sources name has its row, and no row has a code that nothing gives.
#[test]
fn every_code_has_a_row_in_the_manual() {
    let page = rows(&fs::read_to_string(pages::folder().join("messages.md")).expect("the page"));
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let texts: Vec<(PathBuf, String)> =
        files.into_iter().map(|file| (file.clone(), fs::read_to_string(file).expect("text"))).collect();
    let named: BTreeSet<String> = texts.iter().flat_map(|(path, text)| codes(path, text)).collect();
    assert!(named.len() > 140, "{}", named.len());
    let without: Vec<&String> = named.difference(&page).collect();
    assert!(without.is_empty(), "no row in messages.md: {without:?}");
    let all: String = texts.iter().map(|(_, text)| text.as_str()).collect();
    let unknown: Vec<&String> = page.iter().filter(|code| !all.contains(&format!("\"{code}\""))).collect();
    assert!(unknown.is_empty(), "nothing gives: {unknown:?}");
}
