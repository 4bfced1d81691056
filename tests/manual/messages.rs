//! Tests that the message page of the manual has a row for each reason code of the program.

use super::pages;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the codes of the page; panics if a row is not valid.
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

/// Adds the source files of the program, without their tests.
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

/// Returns the quoted word at the start of a text if it can be a code: lower case letters and underscores.
fn leading_code(text: &str) -> Option<String> {
    let word = text.trim_start().strip_prefix('"')?.split('"').next()?;
    let is_word = !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    is_word.then(|| word.to_owned())
}

/// Returns the part of a text from these words to the end of their function.
fn function_text<'t>(text: &'t str, begins: &str) -> &'t str {
    let rest = text.split(begins).nth(1).unwrap_or_default();
    let indent = text.split(begins).next().map_or(0, |before| before.len() - before.trim_end_matches(' ').len());
    rest.split(&format!("\n{}}}", " ".repeat(indent))).next().unwrap_or_default()
}

/// Returns the results of the arms of a match expression, if they begin with a quoted word.
fn match_results(text: &str) -> impl Iterator<Item = String> {
    text.split("=>").skip(1).filter_map(|arm| leading_code(arm.trim_start_matches(['{', '(', ' ', '\n'])))
}

/// Tables that assign a code to a cause: the file, and the function with the table.
const TABLES: [(&str, &str); 4] = [
    ("daemon/operator_texts.rs", "pub(super) fn robot("),
    ("daemon/operator_texts.rs", "pub(super) fn trouble("),
    ("path/reach/infeasible.rs", "pub fn code("),
    ("cli/robot.rs", "fn judgement("),
];

/// Calls whose first argument is a code, in all files or in those with this ending.
const CALLS: [(&str, &str); 12] = [
    (".rs", "Reason::new("),
    (".rs", ".bound("),
    (".rs", ".doubt("),
    (".rs", " reason("),
    (".rs", "sight::reason("),
    (".rs", "refused("),
    (".rs", ".or_reject("),
    (".rs", ".or_review("),
    ("removal/gate.rs", " bounded("),
    ("removal/gate.rs", " power("),
    ("removal/gate.rs", " exponent("),
    (".rs", ".broken("),
];

/// Returns the codes in a file: the arguments of calls that create a reason, and the codes in the tables.
fn codes(path: &Path, text: &str) -> BTreeSet<String> {
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let name = path.display().to_string();
    let of = |ending: &&str| name.ends_with(*ending);
    // A call over several lines is read as one line.
    let on_one_line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let called = CALLS.iter().filter(|(file, _)| of(file)).flat_map(|(file, call)| {
        // If the first argument is not a code, the first argument that is a quoted word is used.
        let most = match *call {
            ".broken(" => 4,
            _ if *file == ".rs" => 1,
            _ => 6,
        };
        let rests: Vec<String> = on_one_line.split(call).skip(1).map(str::to_owned).collect();
        rests.into_iter().filter_map(move |rest| rest.split(", ").take(most).find_map(leading_code))
    });
    let given =
        TABLES.iter().filter(|(file, _)| of(file)).flat_map(|(_, table)| match_results(function_text(text, table)));
    let flaws = if of(&"inspect/quality.rs") { function_text(text, "pub fn word(") } else { "" };
    called.chain(given).chain(match_results(flaws)).collect()
}

/// Every code in the sources has a row, and every row has a code that the program uses.
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
    // The table of priorities lists codes but does not use them as reasons.
    let giving = texts.iter().filter(|(path, _)| !path.ends_with("history/codes.rs"));
    let all: String = giving.map(|(_, text)| text.as_str()).collect();
    let unknown: Vec<&String> = page.iter().filter(|code| !all.contains(&format!("\"{code}\""))).collect();
    assert!(unknown.is_empty(), "nothing gives: {unknown:?}");
}
