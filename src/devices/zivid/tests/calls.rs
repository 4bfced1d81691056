//! Compares the list of the SDK's calls, `cpp/CALLS.md`, with the declarations and with the source that makes the
//! calls.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

fn cpp() -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("src/devices/zivid/cpp")
}

fn text(file: &str) -> String {
    std::fs::read_to_string(cpp().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// Returns the public names in the namespace Zivid of a declaration: types, functions, constants.
fn declared(text: &str) -> BTreeSet<String> {
    let from = text.find("\nnamespace Zivid").unwrap_or_else(|| panic!("no such namespace"));
    let (mut found, mut is_private) = (BTreeSet::new(), false);
    for line in text[from..].lines().map(|line| line.split("//").next().unwrap_or_default()) {
        match line.trim() {
            "private:" => is_private = true,
            "public:" | "};" => is_private = false,
            _ if is_private => {}
            line => {
                let line = line.replace("std::move(", " ");
                let named = |before: &str| words(before).last().unwrap_or_default().to_owned();
                let ends: Vec<_> = line.match_indices('(').filter(|(at, _)| !line[..*at].ends_with('>')).collect();
                found.extend(ends.into_iter().map(|(at, _)| named(&line[..at])));
                for kind in ["class ", "struct ", "constexpr ValueType "] {
                    let rest = line.find(kind).map(|at| &line[at + kind.len()..]);
                    found.extend(rest.and_then(|rest| words(rest).next()).map(str::to_owned));
                }
            }
        }
    }
    found.retain(|name| {
        !name.is_empty() && name != "operator" && name.chars().next().is_some_and(char::is_alphabetic)
    });
    found
}

/// Returns the names between backquotes in the first column of the list.
fn listed() -> BTreeSet<String> {
    let list = text("CALLS.md");
    let rows: Vec<&str> = list.lines().filter(|line| line.starts_with("| `")).collect();
    assert!(rows.len() > 30, "{rows:?}");
    let first = |row: &&str| row[2..].split(" | ").next().unwrap_or_default().to_owned();
    let quoted = |column: &String| column.split('`').skip(1).step_by(2).collect::<Vec<_>>().join(" ");
    let calls: Vec<String> = rows.iter().map(first).map(|column| quoted(&column)).collect();
    calls.iter().flat_map(|call| words(call)).map(str::to_owned).collect()
}

/// The adapter is built with these declarations only, so it calls nothing else; and each of them is in the list.
#[test]
fn each_call_of_the_sdk_is_listed_and_each_listed_one_is_made() {
    let files =
        ["stub/Zivid/Zivid.h", "stub/Zivid/Experimental/SettingsInfo.h", "stub/Zivid/Experimental/Calibration.h"];
    let declared: BTreeSet<String> = files.iter().flat_map(|file| declared(&text(file))).collect();
    assert!(["capture2D3D", "isUpToDate", "inaccessible", "k3", "SNR"].iter().all(|name| declared.contains(*name)));
    let listed = listed();
    let unlisted: Vec<_> = declared.iter().filter(|name| !listed.contains(*name) && *name != "ValueType").collect();
    assert!(unlisted.is_empty(), "CALLS.md does not list {unlisted:?}");
    let adapter = text("panelprep_zivid.cpp");
    let made: BTreeSet<&str> = words(&adapter).collect();
    // The types of returned values are not named at the call, so types are left out.
    let is_made = |name: &String| made.contains(name.as_str()) || name.starts_with(char::is_uppercase);
    let stale: Vec<_> = listed.iter().filter(|name| !is_made(name)).collect();
    assert!(stale.is_empty(), "CALLS.md lists {stale:?}, which nothing calls");
}

/// With an older SDK the library cannot be built, and the reason is reported.
#[test]
fn an_older_sdk_does_not_build_it_and_states_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let older = |major: u32, minor: u32| {
        let version = folder.path().join("Zivid/Version.h");
        std::fs::create_dir_all(folder.path().join("Zivid")).expect("made");
        let text = format!("#define ZIVID_CORE_VERSION_MAJOR {major}\n#define ZIVID_CORE_VERSION_MINOR {minor}\n");
        std::fs::write(version, text).expect("written");
        let includes =
            [folder.path().to_owned(), cpp().join("stub")].map(|folder| format!("-I{}", folder.display()));
        let mut compiler = Command::new("c++");
        let compiler = compiler.args(["-std=c++17", "-fsyntax-only"]).args(includes);
        let made = compiler.arg(cpp().join("panelprep_zivid.cpp")).output().expect("a compiler is here");
        (made.status.success(), String::from_utf8_lossy(&made.stderr).into_owned())
    };
    for (major, minor) in [(2, 16), (1, 20)] {
        let (is_built, says) = older(major, minor);
        assert!(!is_built && says.contains("Panelprep needs the Zivid SDK 2.17.0 or newer"), "{says}");
    }
    for (major, minor) in [(2, 17), (2, 18), (3, 0)] {
        let (is_built, says) = older(major, minor);
        assert!(is_built, "{says}");
    }
}
