//! The layer test: `src/lib.rs` states which module may name which, and the test checks the code against it.
//!
//! Paragraphs of `pub mod` lines are layers, from top to bottom; a module may name only modules of earlier
//! paragraphs. There are at most nine layers. Only the modules of `EDGE` name disk, sockets, processes, clocks or
//! the database, and only they name each other. The code is parsed, so that grouped imports, aliases and `super`
//! chains are found; the contents of macros are read as tokens.
//!
//! Within each top-level module, no file names a file that names it, directly or through others (`circles`).

mod circles;

use circles::Crate;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};

/// Maximum number of layers.
const MAX_LAYERS: usize = 9;

/// The modules with access to the world outside of the program; all others are pure.
const EDGE: [&str; 11] =
    ["disk", "supervision", "trust", "store", "backup", "broker", "page", "devices", "archive", "daemon", "cli"];

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

/// Returns each module's layer, as the paragraphs of `lib.rs` give it.
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

/// Every path that a file names, `crate` and `super` resolved to `crate::…`.
struct Paths {
    /// The file's module below the crate's root, `["panel", "region"]`.
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
            _ => segments.to_vec(),
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
        for start in
            text.match_indices("crate::").map(|(at, _)| at).chain(text.match_indices("std::").map(|(at, _)| at))
        {
            let path: String =
                text[start..].chars().take_while(|c| c.is_alphanumeric() || "_:".contains(*c)).collect();
            self.found.push(path);
        }
        visit::visit_macro(self, invocation);
    }
}

/// Returns what a file of `module` does that its layer does not allow.
fn wrongs(code: &str, module: &[&str], layers: &BTreeMap<String, usize>) -> Vec<String> {
    let home = module[0];
    let is_pure = !EDGE.contains(&home);
    let mut wrongs = Vec::new();
    for path in Paths::collect(code, module) {
        if let Some(named) = path.strip_prefix("crate::").and_then(|rest| rest.split("::").next())
            && let Some(&layer) = layers.get(named)
            && named != home
            && layer >= layers[home]
        {
            wrongs.push(format!("{home} names {path}, which does not stand above it in lib.rs"));
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
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let layers = layers(&std::fs::read_to_string(source.join("lib.rs")).expect("lib.rs"));
    assert!(layers.len() > 5, "{layers:?}");
    let depth = layers.values().max().map_or(0, |deepest| deepest + 1);
    assert!(depth <= MAX_LAYERS, "lib.rs has {depth} layers, at most {MAX_LAYERS} are allowed");
    let (mut seen, mut all_wrongs) = (0, Vec::new());
    for file in rust_files(&source) {
        let relative = file.strip_prefix(&source).expect("below src").with_extension("");
        let parts: Vec<&str> =
            relative.iter().filter_map(|part| part.to_str()).filter(|part| *part != "mod").collect();
        if ["lib", "main"].contains(&parts[0]) {
            continue;
        }
        assert!(layers.contains_key(parts[0]), "src/{} is in no layer of lib.rs", parts[0]);
        let code = std::fs::read_to_string(&file).expect("a source file");
        all_wrongs
            .extend(wrongs(&code, &parts, &layers).into_iter().map(|wrong| format!("{}: {wrong}", file.display())));
        seen += 1;
    }
    assert!(all_wrongs.is_empty(), "{all_wrongs:#?}");
    assert!(seen > 10, "the test looks at {seen} files only");
}

/// Checks the rule itself: each planted fault is found, and no allowed line is reported.
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
        ("use crate::disk::Input;", &["sim", "cell"]),
        ("use super::super::panel::Region;", &["sim", "cell"]),
    ];
    for (code, module) in faults {
        assert!(!wrongs(code, module, &layers).is_empty(), "not found: {code}");
    }
    let allowed = [
        ("use crate::{geometry::Point, panel::TaughtPanel};", &["locate"][..]),
        ("use super::region::Region; use std::time::Duration;", &["panel", "corner"]),
        ("use std::{fs, time::SystemTime}; use crate::disk::Input;", &["store"]),
        ("use crate::geometry::Point; use super::scene;", &["sim", "cell"]),
    ];
    for (code, module) in allowed {
        assert_eq!(wrongs(code, module, &layers), Vec::<String>::new(), "{code}");
    }
}

#[test]
fn files_of_a_room_name_each_other_one_way_only() {
    let all = Crate::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    let rooms = all.rooms();
    assert!(rooms.len() > 20, "{rooms:?}");
    let circles: Vec<_> = rooms.iter().flat_map(|room| all.circles(room)).collect();
    let found: Vec<String> = circles
        .iter()
        .map(|circle| format!("these files name each other: {}\n  {}", circle.members, circle.edges.join("\n  ")))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Returns the circles of a crate that consists of these files; each file is a module's path and its code.
fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
    let mut all = Crate::default();
    for (path, code) in files {
        let module: Vec<String> = path.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
        all.add(code, &module);
    }
    all.circles("room").into_iter().map(|circle| circle.members).collect()
}

#[test]
fn planted_circles_are_found() {
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
        let found = circles_of(&[("", "pub mod room;"), parent, ("room::a", a), ("room::b", b)]);
        assert_eq!(found, [expected], "{what}");
    }
}

#[test]
fn what_is_no_circle_is_allowed() {
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
        let found = circles_of(&[("", "pub mod room;"), parent, ("room::a", a), ("room::b", b)]);
        assert_eq!(found, Vec::<String>::new(), "{what}");
    }
}
