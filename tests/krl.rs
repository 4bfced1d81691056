//! Tests third-party programs: what `check` reports for each, the time and memory for hostile programs, and a corpus of
//! real programs if one exists.

use super::commands::panelprep;
use super::fuzz::hostile_programs;
use panelprep::check::{decode, is_krl};
use panelprep::krl::{Analysis, analyse, parse};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Returns all KRL files of a folder and its subfolders, in order.
fn krl_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if is_krl(&path.to_string_lossy()) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Analyses these files as one program.
fn analyse_files(files: &[PathBuf]) -> Analysis {
    let read = |file: &PathBuf| {
        let name = file.to_string_lossy();
        let bytes = std::fs::read(file).expect("a file");
        parse(&name, &decode(&name, &bytes).expect("a text").text)
    };
    let read: Vec<_> = files.iter().map(read).collect();
    analyse(&read, None)
}

/// Each file of `fixtures/krl` begins with its expected result: `ok`, or each error and warning with line, key and
/// words. The files in a subfolder are one program; every other file is one program.
#[test]
fn each_fixture_is_judged_as_its_first_lines_state() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/krl");
    let mut programs: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
    for file in krl_files(&root) {
        let folder = file.parent().expect("a folder").to_owned();
        let program = if folder == root { file.clone() } else { folder };
        programs.entry(program).or_default().push(file);
    }
    assert!(programs.len() > 25, "{}", programs.len());
    for files in programs.values() {
        let analysis = analyse_files(files);
        for ((file, problems), warnings) in files.iter().zip(&analysis.problems).zip(&analysis.warnings) {
            let text = std::fs::read_to_string(file).expect("UTF-8");
            let expected: Vec<String> = text
                .lines()
                .filter_map(|line| line.trim_end().strip_prefix("; expected: "))
                .map(str::to_owned)
                .collect();
            let said = |word: &str, list: &[panelprep::config::Problem]| -> Vec<String> {
                list.iter().map(|found| format!("{word} {} {}: {}", found.line, found.key, found.message)).collect()
            };
            let mut found = [said("error", problems), said("warning", warnings)].concat();
            if found.is_empty() {
                found.push("ok".to_owned());
            }
            assert_eq!(found, expected, "{}", file.display());
        }
    }
}

/// Hostile programs are checked unchanged by the program itself, which may use a gigabyte of address space. It answers
/// in time and does not abort.
#[test]
fn hostile_programs_are_checked_in_time() {
    let folder = tempfile::tempdir().expect("a folder");
    for (number, text) in hostile_programs().into_iter().enumerate() {
        let file = format!("a{number}.src");
        std::fs::write(folder.path().join(&file), &text).expect("written");
        let began = Instant::now();
        let mut limited = Command::new("sh");
        let limited = limited.args(["-c", "ulimit -v 1000000; exec \"$0\" check \"$1\""]);
        let output = limited.args([env!("CARGO_BIN_EXE_panelprep"), &file]).current_dir(folder.path()).output();
        let output = output.expect("it starts");
        let began_with = String::from_utf8_lossy(&text[..text.len().min(200)]).into_owned();
        assert!(matches!(output.status.code(), Some(0 | 1)), "{began_with}: {output:?}");
        assert!(began.elapsed() < Duration::from_secs(3), "{began_with}: {:?}", began.elapsed());
    }
}

/// Returns the kind of error that a message reports: the message without names and numbers.
fn error_kind(message: &str) -> String {
    let of_name = |sign: char| "_$'\"[".contains(sign) || sign.is_ascii_digit();
    let word = |word: &str| match word.chars().any(of_name) {
        true => "…".to_owned(),
        false => word.to_owned(),
    };
    let words: Vec<String> = message.split_whitespace().map(word).collect();
    words.join(" ").chars().take(100).collect()
}

#[derive(Default)]
struct Row {
    files: BTreeSet<PathBuf>,
    projects: BTreeSet<PathBuf>,
    times: usize,
    example: String,
}

fn print(title: &str, rows: BTreeMap<String, Row>) {
    println!("{title}\n| files | projects | times | says | for example |\n|---|---|---|---|---|");
    let mut rows: Vec<(String, Row)> = rows.into_iter().collect();
    rows.sort_by_key(|(_, row)| std::cmp::Reverse((row.files.len(), row.projects.len())));
    for (says, Row { files, projects, times, example }) in rows {
        println!("| {} | {} | {times} | {says} | {example} |", files.len(), projects.len());
    }
}

/// Checks real programs, each file separately: `KRL_CORPUS=FOLDER cargo test --test all krl_corpus -- --nocapture`;
/// each subfolder is a project. Prints a table by message. People decide whether an error is real; the table contains
/// the place of one example of each message.
#[test]
fn krl_corpus() {
    let Some(root) = std::env::var_os("KRL_CORPUS").map(PathBuf::from) else {
        eprintln!("NOT RUN: KRL_CORPUS names no folder with programs of other people");
        return;
    };
    let files = krl_files(&root);
    let (mut errors, mut warnings) = (BTreeMap::<String, Row>::new(), BTreeMap::<String, Row>::new());
    let (mut wrong, mut warned, mut unexecuted, mut slowest) = (0, 0, 0, Duration::ZERO);
    for file in &files {
        let began = Instant::now();
        let analysis = analyse_files(std::slice::from_ref(file));
        slowest = slowest.max(began.elapsed());
        let below = file.strip_prefix(&root).expect("in it");
        let project = PathBuf::from(below.iter().next().expect("a name"));
        for (list, rows) in [(&analysis.problems[0], &mut errors), (&analysis.warnings[0], &mut warnings)] {
            for found in list {
                let row = rows.entry(error_kind(&found.message)).or_default();
                row.files.insert(file.clone());
                row.projects.insert(project.clone());
                row.times += 1;
                if row.example.is_empty() {
                    row.example = format!("{}:{} {}", below.display(), found.line, found.key);
                }
            }
        }
        wrong += usize::from(!analysis.problems[0].is_empty());
        warned += usize::from(!analysis.warnings[0].is_empty());
        unexecuted += usize::from(!analysis.unexecuted[0].is_empty());
    }
    let all = files.len();
    println!(
        "{all} files: {wrong} not right, {warned} with warnings, {unexecuted} with what is only checked; the slowest took {slowest:?}"
    );
    print("Errors", errors);
    print("Warnings", warnings);
    assert!(all > 0, "{} holds no KRL", root.display());
    assert!(slowest < Duration::from_secs(5), "{slowest:?}");
}

/// Checks several files of one controller as a user does: in all encodings that occur, and with one address of another
/// controller.
#[test]
fn files_of_a_controller_are_read_in_any_encoding() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let shipped = include_str!("../config/kuka/CELLCMD.xml");
    // "Commands" in GBK, from its code table.
    let comment = b"<!-- \xC3\xFC\xC1\xEE -->\n";
    let (head, rest) = shipped.split_once('\n').expect("lines");
    assert!(head.starts_with("<ETHERNETKRL>"), "{head}");
    let bytes = [head.as_bytes(), b"\n", comment, rest.as_bytes()].concat();
    std::fs::write(folder.join("GBK.xml"), &bytes).expect("written");
    let declared = [&b"<?xml version=\"1.0\" encoding=\"GBK\"?>\n"[..], &bytes].concat();
    std::fs::write(folder.join("DECLARED.xml"), declared).expect("written");
    let wide: Vec<u8> = std::iter::once('\u{feff}')
        .chain(shipped.chars())
        .flat_map(|sign| sign.encode_utf16(&mut [0; 2]).to_vec())
        .flat_map(u16::to_le_bytes)
        .collect();
    std::fs::write(folder.join("WIDE.xml"), wide).expect("written");
    let checked = |file: &str| {
        let output = panelprep(folder, &format!("check {file}"));
        (output.status.code(), String::from_utf8(output.stdout).expect("UTF-8"))
    };
    let (exit, text) = checked("GBK.xml");
    assert!(exit == Some(0) && text.contains("warning, line 2: encoding: the file is not UTF-8"), "{text}");
    for file in ["DECLARED.xml", "WIDE.xml"] {
        let (exit, text) = checked(file);
        assert!(exit == Some(0) && !text.contains("warning, line"), "{file}: {text}");
    }
    // A recipe in UTF-16 is refused, because no command reads it.
    let recipe: Vec<u8> = "panel = 'door'\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(folder.join("door.toml"), [&[0xFF, 0xFE][..], &recipe].concat()).expect("written");
    let (exit, text) = checked("door.toml");
    assert!(exit == Some(2) && text.contains("is UTF-16, as PowerShell's > writes it"), "{text}");
}
