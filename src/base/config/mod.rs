//! Strict reading of configuration files: all problems of a file are reported at once, each with line, key and the
//! nearest valid name.
//!
//! `serde` stops at the first unknown field. Therefore a file is parsed to toml's spanned tree, and each known key is
//! *taken* from the tree; a key that was not taken is unknown. Nothing is corrected: a value out of range is a problem,
//! and a file with a problem gives no checked form. The input is the file's text, which the caller reads; the result is
//! either the checked values or the list of problems.
//!
//! The reader takes keys from a [`Section`], one table of the file. [`settings!`](crate::settings) defines a table's
//! settings with one line for each key: name, kind, range, default and meaning. The macro generates the checked struct,
//! its accessors and its reader from these lines, so that they always agree.

mod problem;
#[cfg(test)]
mod tests;
mod value;

pub use crate::settings;
pub use problem::{Problem, Problems, key_line, nearest};
use problem::{line_number, syntax_problem};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use value::describe_value;
pub use value::{Choice, Setting, set_value};

/// Checks a file: `parse` reads its keys and returns the checked form if it found no problem. `parse` is called twice:
/// the first call finds the misspelt tables, so that the second call can also list the problems inside them.
///
/// # Errors
/// All problems in the order of their lines.
pub fn parse_file<T>(file: &str, text: &str, parse: impl Fn(&Section<'_, '_>) -> Option<T>) -> Result<T, Problems> {
    let (root, errors) = DeTable::parse_recoverable(text);
    let mut document =
        Document { text, root, findings: RefCell::default(), known: RefCell::default(), misspelt: BTreeMap::new() };
    parse(&document.root_section());
    document.misspelt = document.misspelt_names();
    document.findings.take();
    let checked = parse(&document.root_section());
    let list = document.problems(errors.iter().map(|error| syntax_problem(text, error)));
    match checked {
        Some(value) if list.is_empty() => Ok(value),
        _ => Err(Problems { file: file.to_owned(), list }),
    }
}

/// Returns the keys of the file's top level. If the file has a syntax error, only the keys that could be parsed.
pub fn top_keys(text: &str) -> Vec<String> {
    let (root, _) = DeTable::parse_recoverable(text);
    root.get_ref().keys().map(|key| key.get_ref().to_string()).collect()
}

/// One table of a file. Keys are taken from it; [`Section::finish`] reports those that were not taken.
pub struct Section<'d, 't> {
    document: &'d Document<'t>,
    path: String,
    table: Option<&'d DeTable<'t>>,
    line: usize,
    known: RefCell<Vec<&'static str>>,
}

impl<'d, 't> Section<'d, 't> {
    fn new(document: &'d Document<'t>, path: String, table: Option<&'d DeTable<'t>>, line: usize) -> Self {
        Section { document, path, table, line, known: RefCell::default() }
    }

    /// Returns whether this table is in the file.
    pub fn is_present(&self) -> bool {
        self.table.is_some()
    }

    /// Handles a missing required key. If the whole table is absent, its feature is disabled; if only the key is
    /// absent, this is a problem.
    pub fn missing_required<T>(&self, key: &str, what: &str) -> Option<Option<T>> {
        if self.is_present() {
            self.problem(key, format!("is missing: {what}; to turn the function off, remove the whole table"));
            return None;
        }
        Some(None)
    }

    /// Returns whether this key is in the table.
    pub fn has_key(&self, key: &str) -> bool {
        self.entry(key).is_some()
    }

    /// Returns whether this key exists and is a table.
    pub fn is_table(&self, key: &str) -> bool {
        self.entry(key).is_some_and(|(_, value)| value.is_table())
    }

    /// Adds a problem with one key of this table, at the key's line if the key exists.
    pub fn problem(&self, key: &str, message: impl Into<String>) {
        let line = self.entry(key).map_or(self.line, |(line, _)| line);
        self.note(Finding::Wrong(Problem { line, key: path(&self.path, key), message: message.into() }));
    }

    fn note(&self, finding: Finding) {
        self.document.findings.borrow_mut().push(finding);
    }

    fn entry(&self, key: &str) -> Option<(usize, &'d DeValue<'t>)> {
        let (name, value) = self.table?.get_key_value(key)?;
        Some((line_number(self.document.text, name.span().start), value.get_ref()))
    }

    fn parse_value<T: Setting>(&self, key: &str, value: &DeValue<'_>, limits: &T::Limits) -> Option<T> {
        T::parse(value, limits).map_err(|message| self.problem(key, message)).ok()
    }

    /// Reads a key. If it is absent, the default applies; if there is no default, the key is reported as missing.
    pub fn parse<T: Setting>(&self, key: &'static str, limits: T::Limits, default: Option<T>) -> Option<T> {
        self.known.borrow_mut().push(key);
        match self.entry(key) {
            Some((_, value)) => self.parse_value(key, value, &limits),
            None if default.is_some() => default,
            None => {
                let (line, table, table_is_there) = (self.line, self.path.clone(), self.is_present());
                self.note(Finding::Missing { line, table, key, table_is_there });
                None
            }
        }
    }

    /// Returns a table inside this one. An absent table is read as an empty one; a misspelt table is read under the
    /// right name.
    pub fn section(&self, key: &'static str) -> Section<'d, 't> {
        self.known.borrow_mut().push(key);
        let is_table = |name: &&str| self.entry(name).is_some_and(|(_, value)| value.is_table());
        let misspelt = self.document.misspelt.get(&path(&self.path, key)).map(String::as_str).filter(is_table);
        self.subsection(key, misspelt.filter(|_| self.entry(key).is_none()).unwrap_or(key))
    }

    /// Returns the table with the right name `name`, which the file calls `written`.
    fn subsection(&self, name: &str, written: &str) -> Section<'d, 't> {
        let path = path(&self.path, name);
        match self.entry(written) {
            Some((line, value)) => {
                let write = format!("[{path}]");
                self.table(path, line, value, &write)
            }
            None => Section::new(self.document, path, None, self.line),
        }
    }

    fn table(&self, path: String, line: usize, value: &'d DeValue<'t>, write: &str) -> Section<'d, 't> {
        let table = value.as_table();
        if table.is_none() {
            let message = format!("found {}, valid: a table; write {write}", describe_value(value));
            self.note(Finding::Wrong(Problem { line, key: path.clone(), message }));
        }
        Section::new(self.document, path, table, line)
    }

    /// Returns the tables of a list, `[[key]]`; none if the list is absent.
    pub fn sections(&self, key: &'static str) -> Vec<Section<'d, 't>> {
        self.known.borrow_mut().push(key);
        let Some((_, value)) = self.entry(key) else { return Vec::new() };
        let write = format!("[[{}]]", path(&self.path, key));
        let Some(list) = value.as_array() else {
            self.problem(key, format!("found {}, valid: a list of tables; write {write}", describe_value(value)));
            return Vec::new();
        };
        let item = |(index, item): (usize, &'d Spanned<DeValue<'t>>)| {
            let line = line_number(self.document.text, item.span().start);
            self.table(format!("{}[{}]", path(&self.path, key), index + 1), line, item.get_ref(), &write)
        };
        list.iter().enumerate().map(item).collect()
    }

    fn names(&self) -> impl Iterator<Item = &'d str> {
        self.table.into_iter().flatten().map(|(name, _)| name.get_ref().as_ref())
    }

    /// Reads all entries of a table whose keys the user chooses freely, such as names of poses.
    pub fn parse_named_entries<T: Setting>(&self, limits: &T::Limits) -> BTreeMap<String, T> {
        let parsed = |name: &str| Some((name.to_owned(), self.parse_value(name, self.entry(name)?.1, limits)?));
        self.names().filter_map(parsed).collect()
    }

    /// Returns all tables inside a table whose keys the user chooses freely, each with its name.
    pub fn named_sections(&self) -> Vec<(String, Section<'d, 't>)> {
        self.names().map(|name| (name.to_owned(), self.subsection(name, name))).collect()
    }

    /// Ends the reading of this table: every key of the table that was not taken is reported as unknown.
    pub fn finish(&self) {
        let known = self.known.take();
        for key in self.names().filter(|name| !known.contains(name)) {
            let (line, value) = self.entry(key).map_or((self.line, None), |(line, value)| (line, Some(value)));
            let is_table = matches!(value, Some(DeValue::Table(_) | DeValue::Array(_)));
            self.note(Finding::Unknown { line, table: self.path.clone(), key: key.to_owned(), is_table });
        }
        self.document.known.borrow_mut().insert(self.path.clone(), known);
    }
}

/// Declares a checked table. Fields are private: a value of the struct has passed every range.
///
/// ```text
/// settings! {
///     /// What the table is for.
///     pub struct Locate {
///         /// Largest shift of the panel's centre, mm.
///         max_shift_mm: f64, 0.0..=500.0, default 60.0;
///         /// No default: the file must name it.
///         rows: usize, 1..=50, required;
///     }
/// }
/// ```
#[macro_export]
macro_rules! settings {
    ($(#[$doc:meta])* pub struct $name:ident {
        $($(#[$key_doc:meta])* $key:ident: $kind:ty, $limits:expr, $word:ident $($default:expr)?;)*
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name { $($key: $kind,)* }

        impl $name {
            $($(#[$key_doc])* pub fn $key(&self) -> $kind { $crate::config::copy_value(&self.$key) })*

            /// Reads this table's keys; `None` if one of them has a problem, which is then in the document's list.
            pub fn parse(section: &$crate::config::Section<'_, '_>) -> Option<Self> {
                $(let $key = section.parse::<$kind>(
                    stringify!($key), $limits, $crate::config::settings!(@$word $($default)?));)*
                section.finish();
                Some($name { $($key: $key?,)* })
            }
        }
    };
    (@required) => { None };
    (@default $value:expr) => { Some($value) };
}

/// Returns a copy of a value, for types with and without `Copy`; the generated accessors use this function.
pub fn copy_value<T: Clone>(value: &T) -> T {
    value.clone()
}

/// A parsed file, with the keys read so far and the problems found so far.
struct Document<'t> {
    text: &'t str,
    root: Spanned<DeTable<'t>>,
    findings: RefCell<Vec<Finding>>,
    /// The known keys of each table that was read.
    known: RefCell<BTreeMap<String, Vec<&'static str>>>,
    /// Misspelt tables: the path of the right name, and the name in the file.
    misspelt: BTreeMap<String, String>,
}

/// A problem that was found while the file was read. An unknown key is stored without a suggestion, because all valid
/// keys are only known when the whole file has been read.
enum Finding {
    Wrong(Problem),
    Unknown { line: usize, table: String, key: String, is_table: bool },
    Missing { line: usize, table: String, key: &'static str, table_is_there: bool },
}

/// Returns the dotted path of a key: the path of its table, then the key.
fn path(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}

/// The probable meaning of an unknown key.
enum KeyMeaning {
    /// A key of the same table with a similar name. If only the unit is wrong, also the unit.
    Near(&'static str, Option<&'static str>),
    /// The same key in other tables, by their paths.
    Elsewhere(Vec<String>),
    Nothing,
}

impl<'t> Document<'t> {
    fn root_section(&self) -> Section<'_, 't> {
        Section::new(self, String::new(), Some(self.root.get_ref()), 1)
    }

    /// Finds the probable meaning of an unknown key. A number or a text is not compared with names of tables.
    fn guess_meaning(&self, table: &str, key: &str, is_table: bool) -> KeyMeaning {
        let known = self.known.borrow();
        let homes = known.iter().filter(|(_, keys)| keys.contains(&key)).map(|(home, _)| path(home, key));
        let homes: Vec<String> = homes.filter(|home| is_table || !known.contains_key(home)).collect();
        match known.get(table).and_then(|keys| nearest(key, keys)) {
            _ if !homes.is_empty() => KeyMeaning::Elsewhere(homes),
            Some((name, unit)) => KeyMeaning::Near(name, unit),
            None => KeyMeaning::Nothing,
        }
    }

    fn misspelt_names(&self) -> BTreeMap<String, String> {
        let findings = self.findings.borrow();
        let misspelt = findings.iter().filter_map(|finding| match finding {
            Finding::Unknown { table, key, is_table, .. } => match self.guess_meaning(table, key, *is_table) {
                KeyMeaning::Near(name, _) => Some((path(table, name), key.clone())),
                _ => None,
            },
            _ => None,
        });
        misspelt.collect()
    }

    fn problems(&self, syntax: impl Iterator<Item = Problem>) -> Vec<Problem> {
        let mut syntax: Vec<Problem> = syntax.collect();
        syntax.sort_by_key(|problem| problem.line);
        syntax.dedup_by_key(|problem| problem.line);
        let (mut list, mut explained, mut missing) = (Vec::new(), BTreeSet::new(), BTreeMap::<_, Vec<_>>::new());
        for finding in self.findings.take() {
            match finding {
                Finding::Wrong(problem) => {
                    explained.insert(problem.key.clone());
                    list.push(problem);
                }
                Finding::Unknown { line, table, key, is_table } => {
                    let (message, names) = self.unknown(&table, &key, is_table);
                    list.push(Problem { line, key: path(&table, &key), message });
                    explained.extend(names);
                }
                Finding::Missing { line, table, key, table_is_there: true } => {
                    missing.entry((line, path(&table, key))).or_default();
                }
                Finding::Missing { line, table, key, .. } => missing.entry((line, table)).or_default().push(key),
            }
        }
        // The parser replaces a line with a syntax error by an invented value, or skips it. The resulting problems of
        // that line are not reported.
        list.retain(|problem| !syntax.iter().any(|error| error.line == problem.line));
        missing.retain(|(_, key), _| syntax.is_empty() && !explained.contains(key));
        list.extend(missing.into_iter().map(|((line, key), needs)| missing_problem(line, key, &needs)));
        list.extend(syntax);
        list.sort_by_key(|problem| problem.line);
        list
    }

    /// Returns the message for an unknown key, and the keys that may have been meant.
    fn unknown(&self, table: &str, key: &str, is_table: bool) -> (String, Vec<String>) {
        match self.guess_meaning(table, key, is_table) {
            KeyMeaning::Near(name, None) => (format!("unknown key; did you mean {name}?"), vec![path(table, name)]),
            KeyMeaning::Near(name, Some(unit)) => {
                (format!("unknown key; {unit}: write {name}"), vec![path(table, name)])
            }
            KeyMeaning::Elsewhere(homes) => {
                (format!("unknown key here; did you mean {}?", homes.join(" or ")), homes)
            }
            KeyMeaning::Nothing => {
                let known = self.known.borrow();
                let known = known.get(table).map_or(String::new(), |keys| keys.join(", "));
                (format!("unknown key; valid keys here: {known}"), vec![])
            }
        }
    }
}

fn missing_problem(line: usize, key: String, needs: &[&str]) -> Problem {
    let message = match needs {
        [] => "is missing; this key has no default".to_owned(),
        _ => format!("this table is missing; it needs {}", needs.join(", ")),
    };
    Problem { line, key, message }
}
