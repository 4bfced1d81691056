//! Tests the licences of the crates that are linked into the program, from `cargo metadata` and the sources of each
//! crate. The package's licence file is written from the same data (`tests/package/licences.rs`).

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Licences that require only their name and text, so that the package may contain the crates. The MPL also requires a
/// statement where the unchanged sources are: the package's licence file names the repository of each crate.
const ALLOWED: [&str; 14] = [
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "IJG",
    "ISC",
    "MIT",
    "MIT-0",
    "MPL-2.0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Crates that state no licence name but contain a licence text: crate, beginning of the text, licence.
const BY_TEXT: [(&str, &str, &str); 1] = [("pcd-rs", "MIT License", "MIT")];

/// Parts of crates that have a separate licence: the crate, and the file with the text of this licence.
const BESIDE: [(&str, &str); 1] = [("dejavu", "assets/dejavu-fonts-ttf-2.37/LICENSE")];

/// A crate that is linked into the program.
#[allow(dead_code, reason = "authors and repository are printed by the package's licence file alone")]
pub struct Linked {
    /// Name and version.
    pub name: String,
    /// The licence of the crate as an SPDX expression; empty if the crate states none.
    pub licence: String,
    /// The authors, as the crate states them.
    pub authors: Vec<String>,
    /// The crate's repository, if it states one.
    pub repository: String,
    /// The licence texts of the crate: file name and text.
    pub texts: Vec<(String, String)>,
}

/// Returns every crate that is linked into the program on this machine, without the program itself and without crates
/// that are only used to build or test it.
pub fn linked() -> Vec<Linked> {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let output = Command::new(option_env!("CARGO").unwrap_or("cargo"))
        .args(["metadata", "--format-version=1", "--locked", "--offline", "--filter-platform", &platform])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let by_id = |list: &Value| -> BTreeMap<String, Value> {
        let entries = list.as_array().expect("a list").iter();
        entries.map(|entry| (entry["id"].as_str().expect("an id").to_owned(), entry.clone())).collect()
    };
    let (packages, nodes) = (by_id(&metadata["packages"]), by_id(&metadata["resolve"]["nodes"]));
    let root = metadata["resolve"]["root"].as_str().expect("a root").to_owned();
    let (mut seen, mut ahead) = (BTreeSet::new(), vec![root.clone()]);
    while let Some(id) = ahead.pop() {
        if !seen.insert(id.clone()) {
            continue;
        }
        let needs = nodes[&id]["deps"].as_array().expect("a list").iter();
        // Dependencies of kind null are linked; those of kind "build" and "dev" are not.
        let is_linked = |need: &&Value| {
            need["dep_kinds"].as_array().is_some_and(|kinds| kinds.iter().any(|kind| kind["kind"].is_null()))
        };
        ahead.extend(needs.filter(is_linked).filter_map(|need| need["pkg"].as_str().map(str::to_owned)));
    }
    seen.remove(&root);
    seen.iter().map(|id| linked_crate(&packages[id])).collect()
}

fn linked_crate(package: &Value) -> Linked {
    let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
    let folder = PathBuf::from(text("manifest_path")).parent().expect("a folder").to_owned();
    let authors = package["authors"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let mut texts = BTreeMap::new();
    let named = package["license_file"].as_str().map(|file| folder.join(file));
    let beside = BESIDE.iter().filter(|(name, _)| *name == text("name")).map(|(_, file)| folder.join(file));
    for file in named.into_iter().chain(licence_files(&folder)).chain(beside) {
        let name = file.file_name().expect("a name").to_string_lossy().into_owned();
        texts.insert(name, String::from_utf8_lossy(&std::fs::read(&file).expect("a licence")).replace('\r', ""));
    }
    let by_text = BY_TEXT.iter().find(|(name, begin, _)| {
        *name == text("name") && texts.values().any(|found: &String| found.starts_with(begin))
    });
    // Before SPDX expressions existed, crates wrote `/` for OR.
    let stated = text("license").replace('/', " OR ");
    Linked {
        name: format!("{} {}", text("name"), text("version")),
        licence: by_text
            .filter(|_| stated.is_empty())
            .map_or(stated.clone(), |(_, _, licence)| (*licence).to_owned()),
        authors: authors.map(str::to_owned).collect(),
        repository: text("repository"),
        texts: texts.into_iter().collect(),
    }
}

/// Returns the files of a crate that have the usual name of a licence file.
fn licence_files(folder: &Path) -> Vec<PathBuf> {
    let begins = ["license", "licence", "copying", "copyright", "notice", "unlicense"];
    let entries = std::fs::read_dir(folder).expect("its sources").map(|entry| entry.expect("an entry").path());
    let is_one = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        path.is_file() && begins.iter().any(|begin| name.starts_with(begin))
    };
    entries.filter(is_one).collect()
}

/// Returns whether the package may contain code under this licence.
pub fn is_allowed(licence: &str) -> bool {
    let allowed =
        |requirement: &spdx::LicenseReq| requirement.license.id().is_some_and(|id| ALLOWED.contains(&id.name));
    spdx::Expression::parse(licence).is_ok_and(|expression| expression.evaluate(allowed))
}

#[test]
fn every_linked_crate_has_a_licence_that_the_package_may_contain() {
    let linked = linked();
    let names: Vec<&str> = linked.iter().filter_map(|it| it.name.split(' ').next()).collect();
    // Some crates that must be in the list, and some that are only used by tests or builds.
    assert!(
        names.len() > 100
            && ["opencv", "libsqlite3-sys", "zstd-sys", "clap"].iter().all(|name| names.contains(name))
    );
    assert!(!["proptest", "bindgen", "spdx", "panelprep"].iter().any(|name| names.contains(name)), "{names:?}");
    assert!(
        linked.iter().filter(|it| it.texts.is_empty()).count() < linked.len() / 10,
        "sources without their texts"
    );
    // The fonts may be embedded if their own notice is included.
    let has_notice =
        |it: &&Linked| it.texts.iter().any(|(_, text)| text.contains("Bitstream Vera Fonts Copyright"));
    let fonts: Vec<&str> = linked.iter().filter(has_notice).map(|it| it.name.as_str()).collect();
    assert!(fonts.iter().any(|name| name.starts_with("dejavu ")), "{fonts:?}");
    let wrong: Vec<String> = linked
        .iter()
        .filter(|it| !is_allowed(&it.licence))
        .map(|it| format!("{}: \"{}\"", it.name, it.licence))
        .collect();
    assert_eq!(wrong, [] as [String; 0], "without a licence that is known to be right");
}

/// Checks that a missing licence, and a licence that is not allowed, are refused.
#[test]
fn a_missing_or_another_licence_is_refused() {
    for licence in ["", "GPL-3.0-only", "MIT AND GPL-2.0-only", "SomethingElse"] {
        assert!(!is_allowed(licence), "{licence}");
    }
    for licence in [
        "MIT",
        "GPL-3.0-only OR MIT",
        "Apache-2.0 WITH LLVM-exception OR Zlib",
        "(MIT OR Apache-2.0) AND Unicode-3.0",
    ] {
        assert!(is_allowed(licence), "{licence}");
    }
}
