//! Tests that the glossary of `src/README.md` and the code agree: each named type, function or field is defined, and no
//! second word is used for its concept.

use super::words::{comments, dialect, sources, texts};
use std::collections::BTreeSet;
use std::path::Path;
use syn::visit::{self, Visit};

/// A row of the glossary.
struct Term {
    word: String,
    /// Names of the code.
    names: Vec<String>,
    /// Words that are not used for the concept.
    refused: Vec<String>,
}

/// Returns the rows below the head of a table, cell by cell.
pub fn table_rows<'p>(page: &'p str, head: &'p str) -> impl Iterator<Item = Vec<&'p str>> {
    let rows = page.lines().skip_while(move |line| *line != head).skip(2).take_while(|line| line.starts_with('|'));
    rows.map(|row| row.trim_matches('|').split(" | ").map(str::trim).collect())
}

/// Returns the names in a cell that are written as code.
fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The head of the table of a cycle's data.
pub const DATA_HEAD: &str = "| Data | Type | Made from | Made in |";

/// Returns the rows of the glossary; an error with the row that does not have four cells or names nothing in the code.
fn terms(page: &str) -> Result<Vec<Term>, String> {
    let head = "| Word | Meaning | In the code | Not |";
    let term = |cells: Vec<&str>| {
        let [word, _, names, refused] = cells[..] else { return Err(format!("four cells: {cells:?}")) };
        let names = quoted(names);
        if names.is_empty() {
            return Err(format!("the third cell names nothing in the code: {cells:?}"));
        }
        let refused = refused.split(", ").filter(|word| *word != "–").map(str::to_owned).collect();
        Ok(Term { word: word.to_owned(), names, refused })
    };
    table_rows(page, head).map(term).collect()
}

/// The names that a source defines: types, traits, functions, constants, modules, variants and fields.
#[derive(Default)]
struct Defined(BTreeSet<String>);

impl<'ast> Visit<'ast> for Defined {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let name = match item {
            syn::Item::Struct(item) => Some(&item.ident),
            syn::Item::Enum(item) => Some(&item.ident),
            syn::Item::Trait(item) => Some(&item.ident),
            syn::Item::Type(item) => Some(&item.ident),
            syn::Item::Const(item) => Some(&item.ident),
            syn::Item::Mod(item) => Some(&item.ident),
            _ => None,
        };
        self.0.extend(name.map(ToString::to_string));
        // The frames and the tables of recipe and cell are written with macros: `Base = "base";`, `step_over_mm: f64,
        // …`.
        if let syn::Item::Macro(item) = item {
            let tokens = item.mac.tokens.to_string();
            let words: Vec<&str> = tokens.split_whitespace().collect();
            let named = words.windows(2).filter(|pair| ["=", ":", "{"].contains(&pair[1]));
            self.0.extend(named.map(|pair| pair[0].to_owned()));
        }
        visit::visit_item(self, item);
    }

    fn visit_signature(&mut self, signature: &'ast syn::Signature) {
        self.0.insert(signature.ident.to_string());
        visit::visit_signature(self, signature);
    }

    fn visit_field(&mut self, field: &'ast syn::Field) {
        self.0.extend(field.ident.as_ref().map(ToString::to_string));
        visit::visit_field(self, field);
    }

    fn visit_variant(&mut self, variant: &'ast syn::Variant) {
        self.0.insert(variant.ident.to_string());
        visit::visit_variant(self, variant);
    }
}

/// Returns a name as words: `base_from_panel` and `BaseFromPanel` become "base from panel".
fn as_words(name: &str) -> String {
    let mut words = String::new();
    for c in name.chars() {
        if c.is_uppercase() || c == '_' {
            words.push(' ');
        }
        words.extend(c.to_lowercase().filter(|c| *c != '_'));
    }
    words.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn defined() -> BTreeSet<String> {
    let mut all = Defined::default();
    for (file, source) in sources().iter().filter(|(file, _)| file.starts_with("src/")) {
        all.visit_file(&syn::parse_file(source).unwrap_or_else(|error| panic!("{file}: {error}")));
    }
    all.0
}

#[test]
fn each_term_of_the_glossary_is_in_the_code_and_has_no_second_word() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/README.md");
    let terms = terms(&std::fs::read_to_string(page).expect("the page")).unwrap_or_else(|error| panic!("{error}"));
    assert!(terms.len() > 15, "{} terms", terms.len());
    let defined = defined();
    let mut wrong = Vec::new();
    for term in &terms {
        let unknown = term.names.iter().filter(|name| !defined.contains(*name));
        wrong.extend(unknown.map(|name| format!("{}: `{name}` is not defined in src/", term.word)));
    }
    let second: Vec<(&str, &str)> =
        terms.iter().flat_map(|term| term.refused.iter().map(|word| (word.as_str(), term.word.as_str()))).collect();
    assert!(second.len() > 15, "{} words", second.len());
    let mut look = |place: &str, text: &str| {
        wrong.extend(
            dialect(text, &second).map(|(word, right)| format!("{place}: \"{word}\" is \"{right}\": {text}")),
        );
    };
    for (file, source) in sources().iter().filter(|(file, _)| file.starts_with("src/")) {
        comments(source).iter().for_each(|text| look(file, text));
    }
    for (file, found) in texts() {
        found.iter().filter(|text| text.contains(' ')).for_each(|text| look(&file, text));
    }
    defined.iter().for_each(|name| look(name, &as_words(name)));
    assert!(wrong.is_empty(), "{} places: {wrong:#?}", wrong.len());
}

/// Every type and every folder or file that the table of a cycle's data names exists.
#[test]
fn the_table_of_the_data_names_what_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("src/README.md")).expect("the page");
    let (defined, mut wrong, mut named) = (defined(), Vec::new(), 0);
    for cells in table_rows(&page, DATA_HEAD) {
        let (types, places) = (quoted(cells[1]), quoted(cells[3]));
        named += types.len();
        wrong.extend(types.into_iter().filter(|name| !defined.contains(name)));
        wrong.extend(places.into_iter().filter(|place| place.contains('/')).filter(|place| {
            let service = Path::new("src/service").join(place);
            let exists = |path: &Path| root.join(path).exists() || root.join(path).with_extension("rs").exists();
            !exists(&Path::new("src").join(place)) && !exists(&service)
        }));
    }
    assert!(named > 15, "{named} types");
    assert!(wrong.is_empty(), "not defined or not there: {wrong:?}");
}

#[test]
fn names_are_found_at_any_place_where_they_are_defined() {
    let source = "pub struct A { field_mm: f64 } enum B { Variant } impl A { fn method(&self) {} } mod inner { type C = A; }\n\
         frames! { /// Doc.\n Base = \"base\"; } fn f() { let local = 1; }";
    let mut defined = Defined::default();
    defined.visit_file(&syn::parse_file(source).expect("it parses"));
    for name in ["A", "field_mm", "B", "Variant", "method", "inner", "C", "Base", "f"] {
        assert!(defined.0.contains(name), "{name}");
    }
    assert!(!defined.0.contains("local"), "a variable defines no concept");
    assert_eq!([as_words("step_over_mm"), as_words("StepOver")], ["step over mm", "step over"]);
}

#[test]
fn a_row_without_a_name_of_the_code_is_an_error() {
    let head = "| Word | Meaning | In the code | Not |\n|---|---|---|---|\n";
    let good =
        terms(&format!("{head}| feed | a speed | `feed_mm_s`, `Feed` | feedrate, pace |\n")).expect("a term");
    assert_eq!((good[0].names.len(), good[0].refused.len()), (2, 2));
    assert!(terms(&format!("{head}| feed | a speed | feed_mm_s | velocity |\n")).is_err());
    assert!(terms(&format!("{head}| feed | a speed | `feed_mm_s` |\n")).is_err());
}
