//! The layer test. The compiler checks that a crate below `src/` uses only the crates on which it depends; this test
//! checks the modules inside of each crate, and what pure modules may use.
//!
//! Paragraphs of `pub mod` lines in a crate's `lib.rs` are layers; a module may use only modules of earlier paragraphs.
//! Only the modules of `EDGE` use disk, sockets, processes, clocks or the database, and only they use each other. The
//! code is parsed, so that grouped imports, aliases and `super` chains are found; the contents of macros are read as
//! tokens.
//!
//! The files of a crate have no cyclic dependencies (`circles`).

mod circles;

use circles::Crate;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};

/// Maximum number of layers in a crate.
const MAX_LAYERS: usize = 5;
/// Crates that are not divided into top-level modules; each is treated as one module.
const WHOLE: [&str; 2] = ["sim", "devices"];

/// The modules with access to the world outside of the program; all others are pure.
const EDGE: [&str; 12] = [
    "disk",
    "supervision",
    "trust",
    "store",
    "backup",
    "broker",
    "page",
    "devices",
    "archive",
    "setup",
    "daemon",
    "cli",
];

/// Crates that only the modules in `EDGE` may use.
const EDGE_ONLY: [&str; 8] = [
    "tokio",
    "std::fs",
    "std::net",
    "std::process",
    "rusqlite",
    "std::time::Instant",
    "std::time::SystemTime",
    "std::os",
];

/// A crate below `src/`, or the crate of the program.
struct Member {
    folder: PathBuf,
    /// The name of a crate that is not divided into top-level modules; all of its files are treated as one module with
    /// this name.
    whole: Option<String>,
    /// The layer of each top-level module, according to the paragraphs of `lib.rs`.
    layers: BTreeMap<String, usize>,
}

impl Member {
    fn read(folder: PathBuf) -> Self {
        let lib = std::fs::read_to_string(folder.join("lib.rs")).expect("lib.rs");
        let name = folder.file_name().and_then(|name| name.to_str()).expect("a name").to_owned();
        let whole = WHOLE.contains(&name.as_str()).then_some(name);
        let layers = whole.clone().map_or_else(|| layers(&lib), |name| BTreeMap::from([(name, 0)]));
        Member { folder, whole, layers }
    }

    /// Returns the module path of a file, below the name of its top-level module.
    fn module(&self, file: &Path) -> Vec<String> {
        let relative = file.strip_prefix(&self.folder).expect("in the crate").with_extension("");
        let parts = relative.iter().filter_map(|part| part.to_str()).filter(|part| !["mod", "lib"].contains(part));
        self.whole.iter().cloned().chain(parts.map(str::to_owned)).collect()
    }

    /// Returns the files of the crate, without those of crates in its subfolders.
    fn files(&self) -> Vec<PathBuf> {
        let is_own = |file: &PathBuf| {
            let mut folders = file.ancestors().skip(1).take_while(|folder| *folder != self.folder);
            folders.all(|folder| !folder.join("Cargo.toml").exists())
        };
        rust_files(&self.folder).into_iter().filter(is_own).collect()
    }
}

/// Returns all crates: those of the workspace in their order, and the crate of the program.
fn members() -> Vec<Member> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("Cargo.toml")).expect("Cargo.toml");
    let manifest: toml::Table = text.parse().expect("TOML");
    let names = manifest["workspace"]["members"].as_array().expect("a list").iter();
    let names = names.map(|name| name.as_str().expect("a path")).chain(["src"]);
    names.map(|name| Member::read(root.join(name))).collect()
}

/// Returns the layer of each module, according to the paragraphs of a `lib.rs`.
fn layers(lib: &str) -> BTreeMap<String, usize> {
    let paragraphs = lib.split("\n\n").map(|paragraph| {
        let name = |line: &str| line.trim().strip_prefix("pub mod ")?.strip_suffix(';').map(str::to_owned);
        paragraph.lines().filter_map(name).collect::<Vec<_>>()
    });
    paragraphs
        .filter(|names| !names.is_empty())
        .enumerate()
        .flat_map(|(layer, names)| names.into_iter().map(move |name| (name, layer)))
        .collect()
}

/// Returns the path in a normalized form: `panelprep_base::geometry` and `crate::geometry` are equal.
fn normalized_path(segments: &[String], home: &str) -> Vec<String> {
    let Some((first, rest)) = segments.split_first() else { return Vec::new() };
    let whole = |name: &str| WHOLE.contains(&name).then(|| name.to_owned());
    let room = match (first.as_str(), first.strip_prefix("panelprep_")) {
        ("crate", _) => whole(home),
        (_, Some(name)) => whole(name),
        _ => return segments.to_vec(),
    };
    ["crate".to_owned()].into_iter().chain(room).chain(rest.iter().cloned()).collect()
}

/// Every path that a file uses, with `crate` and `super` resolved to `crate::…`.
struct Paths {
    /// The module path of the file below the crate's root, such as `["panel", "region"]`.
    module: Vec<String>,
    found: Vec<String>,
}

impl Paths {
    fn collect(code: &str, module: &[&str]) -> Vec<String> {
        let file = syn::parse_file(code).expect("the code parses");
        let mut paths = Paths { module: module.iter().map(|&part| part.to_owned()).collect(), found: Vec::new() };
        paths.visit_file(&file);
        paths.found
    }

    fn note(&mut self, segments: &[String]) {
        let supers = segments.iter().take_while(|part| *part == "super").count();
        let rest = &segments[supers..];
        let resolved = match segments.first().map(String::as_str) {
            Some("super") => {
                let kept = self.module.len().saturating_sub(supers);
                ["crate".to_owned()].iter().chain(&self.module[..kept]).chain(rest).cloned().collect()
            }
            Some("self") => return,
            _ => normalized_path(segments, &self.module[0]),
        };
        self.found.push(resolved.join("::"));
    }

    fn note_tree(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |ident: &syn::Ident| [before, &[ident.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.note_tree(&with(&path.ident), &path.tree),
            syn::UseTree::Name(name) => self.note(&with(&name.ident)),
            syn::UseTree::Rename(rename) => self.note(&with(&rename.ident)),
            syn::UseTree::Glob(_) => self.note(&[before, &["*".to_owned()]].concat()),
            syn::UseTree::Group(group) => group.items.iter().for_each(|item| self.note_tree(before, item)),
        }
    }
}

impl<'ast> Visit<'ast> for Paths {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.note_tree(&[], &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.note(&segments);
        visit::visit_path(self, path);
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if item.content.is_some() {
            self.module.push(item.ident.to_string());
            visit::visit_item_mod(self, item);
            self.module.pop();
        }
    }

    fn visit_macro(&mut self, invocation: &'ast syn::Macro) {
        let text = invocation.tokens.to_string().replace(' ', "");
        for start in ["crate::", "std::", "panelprep_"]
            .into_iter()
            .flat_map(|word| text.match_indices(word))
            .map(|(at, _)| at)
        {
            let path: String =
                text[start..].chars().take_while(|c| c.is_alphanumeric() || "_:".contains(*c)).collect();
            let segments: Vec<String> = path.split("::").map(str::to_owned).collect();
            self.found.push(normalized_path(&segments, &self.module[0]).join("::"));
        }
        visit::visit_macro(self, invocation);
    }
}

/// Returns each path in a file of `module` that its layer does not allow.
fn layer_violations(code: &str, module: &[&str], layers: &BTreeMap<String, usize>) -> Vec<String> {
    let home = module[0];
    let is_pure = !EDGE.contains(&home);
    let mut wrongs = Vec::new();
    for path in Paths::collect(code, module) {
        if let Some(named) = path.strip_prefix("crate::").and_then(|rest| rest.split("::").next())
            && let Some(&layer) = layers.get(named)
            && named != home
            && layer >= layers[home]
        {
            wrongs.push(format!("{home} names {path}, which is not in a layer above it in lib.rs"));
        }
        let named = path.strip_prefix("crate::").and_then(|rest| rest.split("::").next());
        if named.is_some_and(|named| is_pure && EDGE.contains(&named)) {
            wrongs.push(format!("{home} is pure and names {path}, which is not"));
        }
        if home == "sim" && named.is_some_and(|named| ![home, "geometry"].contains(&named)) {
            wrongs.push(format!("sim names {path}; the renderer shares geometry alone with what it tests"));
        }
        let edge_path = EDGE_ONLY.iter().find(|edge| path == **edge || path.starts_with(&format!("{edge}::")));
        if let Some(edge_path) = edge_path.filter(|_| is_pure) {
            wrongs.push(format!("{home} is pure and names {path}, of {edge_path}"));
        }
    }
    wrongs
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn every_module_names_only_layers_above_it() {
    let (mut seen, mut all_wrongs) = (0, Vec::new());
    for member in members() {
        let depth = member.layers.values().max().map_or(0, |deepest| deepest + 1);
        assert!((1..=MAX_LAYERS).contains(&depth), "{:?} has {depth} layers, limit {MAX_LAYERS}", member.folder);
        for file in member.files() {
            let module = member.module(&file);
            let parts: Vec<&str> = module.iter().map(String::as_str).collect();
            // The `lib.rs` of a crate and the program's `main.rs` are in no layer.
            let Some(&room) = parts.first().filter(|room| **room != "main") else { continue };
            assert!(
                member.layers.contains_key(room),
                "{room} is in no layer of {:?}",
                member.folder.join("lib.rs")
            );
            let code = std::fs::read_to_string(&file).expect("a source file");
            let wrongs = layer_violations(&code, &parts, &member.layers);
            all_wrongs.extend(wrongs.into_iter().map(|wrong| format!("{}: {wrong}", file.display())));
            seen += 1;
        }
    }
    assert!(all_wrongs.is_empty(), "{all_wrongs:#?}");
    assert!(seen > 500, "the test looks at {seen} files only");
}

/// Tests the check itself: each injected violation is found, and no allowed line is reported.
#[test]
fn planted_faults_are_found() {
    let layers = layers(
        "pub mod geometry;\npub mod disk;\n\npub mod panel;\npub mod sim;\n\npub mod locate;\npub mod inspect;\n\npub mod store;\n",
    );
    let faults = [
        ("use crate::{geometry::Point, inspect::Watch};", &["locate"][..]),
        ("fn f() { crate::locate::run() }", &["panel", "region"]),
        ("use super::super::locate::Fit;", &["panel", "region"]),
        ("use std::{collections::BTreeMap, fs};", &["panel"]),
        ("use std::time::{Duration, Instant as Clock};", &["locate", "gate"]),
        ("fn f() { println!(\"{}\", crate::inspect::now()) }", &["locate"]),
        ("mod tests { use super::super::store::Store; }", &["panel"]),
        ("use crate::disk::Input;", &["locate"]),
        ("use panelprep_base::disk::Input;", &["sim", "cell"]),
        ("use panelprep_cell::panel::Region;", &["sim", "cell"]),
        ("use panelprep_base::disk::Input;", &["locate"]),
        ("use panelprep_devices::mock::Mock;", &["panel"]),
        ("fn f() { println!(\"{}\", panelprep_store::store::Store::now()) }", &["panel"]),
    ];
    for (code, module) in faults {
        assert!(!layer_violations(code, module, &layers).is_empty(), "not found: {code}");
    }
    let allowed = [
        ("use crate::{geometry::Point, panel::TaughtPanel};", &["locate"][..]),
        ("use super::region::Region; use std::time::Duration;", &["panel", "corner"]),
        ("use std::{fs, time::SystemTime}; use crate::disk::Input;", &["store"]),
        ("use crate::mono::Gray; use panelprep_base::geometry::Point; use super::scene;", &["sim", "cell"]),
        ("use panelprep_base::geometry::Point;", &["panel"]),
    ];
    for (code, module) in allowed {
        assert_eq!(layer_violations(code, module, &layers), Vec::<String>::new(), "{code}");
    }
}

#[test]
fn files_of_a_crate_name_each_other_one_way_only() {
    let circles: Vec<_> = members().iter().flat_map(|member| Crate::read(&member.folder).circles()).collect();
    let found: Vec<String> = circles
        .iter()
        .map(|circle| format!("these files name each other: {}\n  {}", circle.members, circle.edges.join("\n  ")))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Returns the dependency cycles of a crate with these files; each file is given by its module path and its code.
fn cycles_of_files(files: &[(&str, &str)]) -> Vec<String> {
    let mut all = Crate::default();
    for (path, code) in files {
        let module: Vec<String> = path.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
        all.add(code, &module);
    }
    all.circles().into_iter().map(|circle| circle.members).collect()
}

#[test]
fn planted_dependency_cycles_are_found() {
    let parent = ("room", "mod a; mod b; pub use a::A; pub struct Own;");
    let circles = [
        (
            "siblings",
            "use super::b::B; pub struct A;",
            "fn f() { crate::room::a::run() } pub struct B;",
            "room::a, room::b",
        ),
        ("a re-export", "use super::b::B; pub struct A;", "use super::A; pub struct B;", "room::a, room::b"),
        ("inside a macro", "use super::b::B; pub struct A;", "fn f() { vec![super::a::A] }", "room::a, room::b"),
        ("parent and child", "use super::Own; pub struct A;", "", "room, room::a"),
        ("a glob", "use super::b::*; pub struct A;", "use super::*; pub struct B(A);", "room, room::a, room::b"),
    ];
    for (what, a, b, expected) in circles {
        let found = cycles_of_files(&[("", "pub mod room;"), parent, ("room::a", a), ("room::b", b)]);
        assert_eq!(found, [expected], "{what}");
    }
}

#[test]
fn dependencies_without_a_cycle_are_allowed() {
    let parent = ("room", "mod a; mod b; pub use a::A;");
    let allowed = [
        ("one way", "pub struct A;", "use super::A; pub struct B;"),
        (
            "tests",
            "pub struct A; #[cfg(test)] mod tests { use super::super::b::B; }",
            "use super::a::A; pub struct B;",
        ),
        ("visibility", "pub(super) struct A;", "use super::a::A; pub(in crate::room) struct B;"),
        (
            "the room as a way",
            "use crate::room::b; fn f() { b::run() } pub struct A;",
            "use crate::room; pub fn run() {}",
        ),
    ];
    for (what, a, b) in allowed {
        let found = cycles_of_files(&[("", "pub mod room;"), parent, ("room::a", a), ("room::b", b)]);
        assert_eq!(found, Vec::<String>::new(), "{what}");
    }
}
