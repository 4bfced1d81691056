//! One table of a file, from which keys are taken; what is left over is unknown.

use super::document::{Document, Finding, path};
use super::problem::Problem;
use super::syntax::line_of;
use super::value::Setting;
use std::cell::RefCell;
use std::collections::BTreeMap;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One table of a file. Keys are taken from it; [`Section::done`] reports those that nobody took.
pub struct Section<'d, 't> {
    document: &'d Document<'t>,
    path: String,
    table: Option<&'d DeTable<'t>>,
    line: usize,
    known: RefCell<Vec<&'static str>>,
}

impl<'d, 't> Section<'d, 't> {
    pub(super) fn new(
        document: &'d Document<'t>,
        path: String,
        table: Option<&'d DeTable<'t>>,
        line: usize,
    ) -> Self {
        Section { document, path, table, line, known: RefCell::default() }
    }

    /// Is this table in the file at all?
    pub fn is_present(&self) -> bool {
        self.table.is_some()
    }

    /// Notes a problem with one key of this table, at the key's line where it is there.
    pub fn problem(&self, key: &str, message: impl Into<String>) {
        let line = self.entry(key).map_or(self.line, |(line, _)| line);
        self.found(Finding::Wrong(Problem { line, key: path(&self.path, key), message: message.into() }));
    }

    fn found(&self, finding: Finding) {
        self.document.findings.borrow_mut().push(finding);
    }

    fn entry(&self, key: &str) -> Option<(usize, &'d DeValue<'t>)> {
        let (name, value) = self.table?.get_key_value(key)?;
        Some((line_of(self.document.text, name.span().start), value.get_ref()))
    }

    fn parse<T: Setting>(&self, key: &str, value: &DeValue<'_>, limits: &T::Limits) -> Option<T> {
        T::parse(value, limits).map_err(|message| self.problem(key, message)).ok()
    }

    /// Takes a key; without one the default holds, and without a default the key is missing.
    pub fn take<T: Setting>(&self, key: &'static str, limits: T::Limits, default: Option<T>) -> Option<T> {
        self.known.borrow_mut().push(key);
        match self.entry(key) {
            Some((_, value)) => self.parse(key, value, &limits),
            None if default.is_some() => default,
            None => {
                let (line, table, table_is_there) = (self.line, self.path.clone(), self.is_present());
                self.found(Finding::Missing { line, table, key, table_is_there });
                None
            }
        }
    }

    /// Takes a key that may be absent.
    pub fn take_optional<T: Setting>(&self, key: &'static str, limits: T::Limits) -> Option<T> {
        self.take(key, limits, Some(None)).flatten()
    }

    /// A table inside this one; an absent table reads as an empty one, a misspelt one by the name that is meant.
    pub fn section(&self, key: &'static str) -> Section<'d, 't> {
        self.known.borrow_mut().push(key);
        let misspelt = self.document.misspelt.get(&path(&self.path, key)).map(String::as_str);
        let is_table = |name: &&str| self.entry(name).is_some_and(|(_, value)| value.is_table());
        let name = misspelt.filter(is_table).unwrap_or(key);
        self.inner(name)
    }

    fn inner(&self, name: &str) -> Section<'d, 't> {
        let (path, entry) = (path(&self.path, name), self.entry(name));
        let table = entry.and_then(|(_, value)| value.as_table());
        if entry.is_some() && table.is_none() {
            self.problem(name, format!("found a single value, allowed is a table; write [{path}]"));
        }
        Section::new(self.document, path, table, entry.map_or(self.line, |(line, _)| line))
    }

    /// The tables of a list, `[[key]]`; an absent list is empty.
    pub fn sections(&self, key: &'static str) -> Vec<Section<'d, 't>> {
        self.known.borrow_mut().push(key);
        let Some((_, value)) = self.entry(key) else { return Vec::new() };
        let advice = format!("write [[{}]]", path(&self.path, key));
        let Some(list) = value.as_array() else {
            self.problem(key, format!("is not a list of tables; {advice}"));
            return Vec::new();
        };
        let item = |(index, item): (usize, &'d Spanned<DeValue<'t>>)| {
            if item.get_ref().as_table().is_none() {
                self.problem(key, format!("item {} is not a table; {advice}", index + 1));
            }
            let path = format!("{}[{}]", path(&self.path, key), index + 1);
            Section::new(
                self.document,
                path,
                item.get_ref().as_table(),
                line_of(self.document.text, item.span().start),
            )
        };
        list.iter().enumerate().map(item).collect()
    }

    fn names(&self) -> impl Iterator<Item = &'d str> {
        self.table.into_iter().flatten().map(|(name, _)| name.get_ref().as_ref())
    }

    /// All entries of a table whose names the user chooses.
    pub fn take_named<T: Setting>(&self, limits: &T::Limits) -> BTreeMap<String, T> {
        let parsed = |name: &str| Some((name.to_owned(), self.parse(name, self.entry(name)?.1, limits)?));
        self.names().filter_map(parsed).collect()
    }

    /// All tables in a table whose names the user chooses.
    pub fn named_sections(&self) -> Vec<(String, Section<'d, 't>)> {
        self.names().map(|name| (name.to_owned(), self.inner(name))).collect()
    }

    /// Ends the reading of this table: every key that nobody took is a problem.
    pub fn done(&self) {
        let known = self.known.take();
        for key in self.names().filter(|name| !known.contains(name)) {
            let line = self.entry(key).map_or(self.line, |(line, _)| line);
            self.found(Finding::Unknown { line, table: self.path.clone(), key: key.to_owned() });
        }
        self.document.known.borrow_mut().insert(self.path.clone(), known);
    }
}
