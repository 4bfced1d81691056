//! Finds cyclic dependencies between the files of a crate.
//!
//! The graph has a node for each file and an edge for each path by which the code of one file uses another file. A name
//! that a module only re-exports is assigned to the module that defines it. Code that is compiled only for tests is
//! ignored.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use syn::visit::{self, Visit};

/// The path of a module below the crate's root, such as `["panel", "region"]`.
type ModulePath = Vec<String>;

/// The names that one module defines, and the names of other modules that it uses.
#[derive(Default)]
struct Module {
    /// The file that contains the module, as a module path: an inline module belongs to the file around it.
    file: ModulePath,
    children: BTreeSet<String>,
    items: BTreeSet<String>,
    /// The imported path for each imported name.
    imports: BTreeMap<String, Vec<String>>,
    globs: Vec<Vec<String>>,
    /// Paths as they are written in the code.
    named: BTreeSet<Vec<String>>,
}

/// For each file, the files that it uses, and the names that it uses of each.
type Edges = BTreeMap<ModulePath, BTreeMap<ModulePath, BTreeSet<String>>>;

/// A dependency cycle: a set of files, each of which uses all others, directly or through other files.
pub struct Circle {
    /// `calib::fit, calib::gate`.
    pub members: String,
    /// One line for each edge: the file that uses, the file that is used, and the names.
    pub edges: Vec<String>,
}

/// All modules of a crate that are compiled without tests.
#[derive(Default)]
pub struct Crate {
    modules: BTreeMap<ModulePath, Module>,
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let list = attribute.meta.require_list();
        attribute.path().is_ident("cfg") && list.is_ok_and(|list| list.tokens.to_string() == "test")
            || attribute.path().is_ident("test")
    })
}

fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Enum(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Macro(item) => &item.attrs,
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Static(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        syn::Item::Trait(item) => &item.attrs,
        syn::Item::Type(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// Returns the name that an item has in its module.
fn name(item: &syn::Item) -> Option<String> {
    match item {
        syn::Item::Const(item) => Some(item.ident.to_string()),
        syn::Item::Enum(item) => Some(item.ident.to_string()),
        syn::Item::Fn(item) => Some(item.sig.ident.to_string()),
        syn::Item::Static(item) => Some(item.ident.to_string()),
        syn::Item::Struct(item) => Some(item.ident.to_string()),
        syn::Item::Trait(item) => Some(item.ident.to_string()),
        syn::Item::Type(item) => Some(item.ident.to_string()),
        _ => None,
    }
}

/// Collects the names in the modules of one file.
struct Reader<'c> {
    all: &'c mut Crate,
    /// The file's module.
    file: ModulePath,
    /// The module that is being read.
    inside: ModulePath,
}

impl Reader<'_> {
    fn module(&mut self) -> &mut Module {
        let file = self.file.clone();
        self.all.modules.entry(self.inside.clone()).or_insert_with(|| Module { file, ..Module::default() })
    }

    fn import(&mut self, before: &[String], tree: &syn::UseTree) {
        let with = |ident: &syn::Ident| [before, &[ident.to_string()]].concat();
        let (path, alias) = match tree {
            syn::UseTree::Path(path) => return self.import(&with(&path.ident), &path.tree),
            syn::UseTree::Group(group) => return group.items.iter().for_each(|item| self.import(before, item)),
            syn::UseTree::Glob(_) => {
                self.module().globs.push(before.to_vec());
                self.module().named.insert(before.to_vec());
                return;
            }
            syn::UseTree::Name(name) if name.ident == "self" => (before.to_vec(), before.last().cloned()),
            syn::UseTree::Name(name) => (with(&name.ident), Some(name.ident.to_string())),
            syn::UseTree::Rename(rename) if rename.ident == "self" => {
                (before.to_vec(), Some(rename.rename.to_string()))
            }
            syn::UseTree::Rename(rename) => (with(&rename.ident), Some(rename.rename.to_string())),
        };
        if let Some(alias) = alias {
            self.module().imports.insert(alias, path.clone());
        }
        self.module().named.insert(path);
    }
}

impl<'ast> Visit<'ast> for Reader<'_> {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if is_for_tests(attributes(item)) {
            return;
        }
        if let Some(name) = name(item) {
            self.module().items.insert(name);
        }
        visit::visit_item(self, item);
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        self.module().children.insert(item.ident.to_string());
        if item.content.is_some() {
            self.inside.push(item.ident.to_string());
            self.module();
            visit::visit_item_mod(self, item);
            self.inside.pop();
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.import(&[], &item.tree);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.module().named.insert(segments);
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, invocation: &'ast syn::Macro) {
        let tokens = invocation.tokens.to_string().replace(" :: ", "::").replace(":: ", "::");
        for word in tokens.split(|c: char| !(c.is_alphanumeric() || "_:".contains(c))) {
            let segments: Vec<String> = word.split("::").map(str::to_owned).collect();
            if segments.len() > 1 && segments.iter().all(|segment| !segment.is_empty()) {
                self.module().named.insert(segments);
            }
        }
        visit::visit_macro(self, invocation);
    }

    /// Does nothing, because `pub(super)` names a module only to state the visibility of an item.
    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
}

impl Crate {
    /// Reads `lib.rs` of the folder and every module that it declares.
    pub fn read(source: &Path) -> Crate {
        let mut all = Crate::default();
        let mut open = vec![Vec::new()];
        while let Some(module) = open.pop() {
            let stem = module.iter().fold(source.to_path_buf(), |folder, part: &String| folder.join(part));
            let candidates = [source.join("lib.rs"), stem.with_extension("rs"), stem.join("mod.rs")];
            let candidates = if module.is_empty() { &candidates[..1] } else { &candidates[1..] };
            let file =
                candidates.iter().find(|file| file.exists()).unwrap_or_else(|| panic!("no file of {module:?}"));
            open.extend(all.add(&std::fs::read_to_string(file).expect("a source file"), &module));
        }
        all
    }

    /// Adds the modules of a file; returns the modules that it declares and that have separate files.
    pub fn add(&mut self, code: &str, module: &[String]) -> Vec<ModulePath> {
        let file = syn::parse_file(code).expect("the code parses");
        let mut reader = Reader { all: self, file: module.to_vec(), inside: module.to_vec() };
        reader.module();
        reader.visit_file(&file);
        let declared = file.items.iter().filter_map(|item| match item {
            syn::Item::Mod(item) if item.content.is_none() && !is_for_tests(&item.attrs) => Some(&item.ident),
            _ => None,
        });
        declared.map(|ident| [module, &[ident.to_string()]].concat()).collect()
    }

    /// Returns the module that defines the item with this path, resolved from `module`; `None` if it is outside of the
    /// crate.
    fn defining(&self, module: &[String], path: &[String], depth: usize) -> Option<ModulePath> {
        if depth > 32 {
            return None;
        }
        let here = self.modules.get(module)?;
        let (first, rest) = path.split_first()?;
        match first.as_str() {
            "crate" => self.walk(&[], rest, depth),
            "self" => self.walk(module, rest, depth),
            "super" => {
                let parent = &module[..module.len().checked_sub(1)?];
                match rest.first().map(String::as_str) {
                    Some("super") => self.defining(parent, rest, depth + 1),
                    _ => self.walk(parent, rest, depth),
                }
            }
            "Self" => None,
            name if here.children.contains(name) || here.items.contains(name) => self.walk(module, path, depth),
            name => {
                let import = here.imports.get(name)?;
                // Imports of a whole crate, such as `use tracing;` and `use name;`, refer to themselves and are not
                // followed.
                let own = import.first() == Some(first);
                if own { None } else { self.defining(module, &[import, rest].concat(), depth + 1) }
            }
        }
    }

    /// Resolves the names of `rest`, starting in `module`, through re-exports.
    fn walk(&self, module: &[String], rest: &[String], depth: usize) -> Option<ModulePath> {
        let here = self.modules.get(module)?;
        let Some((name, after)) = rest.split_first() else { return Some(module.to_vec()) };
        let child = [module, std::slice::from_ref(name)].concat();
        if here.children.contains(name) && self.modules.contains_key(&child) {
            return self.walk(&child, after, depth);
        }
        if here.items.contains(name) {
            return Some(module.to_vec());
        }
        if let Some(import) = here.imports.get(name) {
            return self.defining(module, &[import, after].concat(), depth + 1);
        }
        let mut globs = here.globs.iter().filter_map(|glob| self.defining(module, glob, depth + 1));
        let holder = globs.find(|holder| {
            holder != module
                && self.modules.get(holder).is_some_and(|held| {
                    held.items.contains(name) || held.children.contains(name) || held.imports.contains_key(name)
                })
        });
        match holder {
            Some(holder) => self.walk(&holder, rest, depth + 1),
            None => Some(module.to_vec()),
        }
    }

    /// Returns, for each file, the files of the crate that it uses.
    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (path, module) in &self.modules {
            let named = edges.entry(module.file.clone()).or_default();
            for name in &module.named {
                let Some(target) = self.defining(path, name, 0) else { continue };
                // The import of a whole parent module only gives access to names, and these names are found where they
                // are used.
                let is_way = path.starts_with(&target) && self.names_module(path, name, &target);
                let file = &self.modules[&target].file;
                if *file != module.file && !is_way {
                    named.entry(file.clone()).or_default().insert(name.join("::"));
                }
            }
        }
        edges
    }

    /// Returns whether the path refers to the module itself, and not to an item in it.
    fn names_module(&self, from: &[String], name: &[String], target: &[String]) -> bool {
        let Some(last) = name.last() else { return false };
        let is_glob = self.modules[from].globs.iter().any(|glob| glob == name);
        !is_glob && (last == "super" || target.last() == Some(last)) && !self.modules[target].items.contains(last)
    }

    /// Returns the dependency cycles between the files of the crate, sorted by their members.
    pub fn circles(&self) -> Vec<Circle> {
        let edges = self.edges();
        let reached: BTreeMap<&ModulePath, BTreeSet<&ModulePath>> =
            edges.keys().map(|from| (from, reach(from, &edges))).collect();
        let mut circles = BTreeSet::new();
        for (from, all) in reached.iter().filter(|(from, all)| all.contains(*from)) {
            circles.insert(all.iter().copied().filter(|to| reached[to].contains(from)).collect::<Vec<_>>());
        }
        let circle = |members: Vec<&ModulePath>| {
            let within = members.iter().flat_map(|from| {
                let named = edges[*from].iter().filter(|(to, _)| members.contains(to));
                named.map(|(to, names)| {
                    let names: Vec<&str> = names.iter().map(String::as_str).collect();
                    format!("{} → {}: {}", from.join("::"), to.join("::"), names.join(", "))
                })
            });
            let edges = within.collect();
            Circle { members: members.iter().map(|path| path.join("::")).collect::<Vec<_>>().join(", "), edges }
        };
        circles.into_iter().map(circle).collect()
    }
}

/// Returns the modules that can be reached from a module along the edges.
fn reach<'e>(from: &ModulePath, edges: &'e Edges) -> BTreeSet<&'e ModulePath> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(module) = open.pop() {
        for next in edges.get(module).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(next) {
                open.push(next);
            }
        }
    }
    reached
}
