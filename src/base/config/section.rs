//! One table of a file. The reader takes keys from it; keys that were not taken are reported as unknown.

use super::problem::Problem;
use super::reading::{Document, Finding, path};
use super::syntax::line_number;
use super::value::{Setting, describe_value};
use std::cell::RefCell;
use std::collections::BTreeMap;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One table of a file. Keys are taken from it; [`Section::finish`] reports those that were not taken.
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

    /// Whether this table is in the file.
    pub fn is_present(&self) -> bool {
        self.table.is_some()
    }

    /// Handles a missing required key: an absent table disables the feature; a table without its required key is a
    /// problem.
    pub fn missing_required<T>(&self, key: &str, what: &str) -> Option<Option<T>> {
        if self.is_present() {
            self.problem(key, format!("is missing: {what}; to turn the function off, remove the whole table"));
            return None;
        }
        Some(None)
    }

    /// Whether this key is in the table.
    pub fn has_key(&self, key: &str) -> bool {
        self.entry(key).is_some()
    }

    /// Whether this key exists and is a table.
    pub fn is_table(&self, key: &str) -> bool {
        self.entry(key).is_some_and(|(_, value)| value.is_table())
    }

    /// Notes a problem with one key of this table, at the key's line if the key exists.
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

    /// Reads a key; without it the default applies, and without a default the key is reported as missing.
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

    /// The tables of a list, `[[key]]`; an absent list is empty.
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

    /// All entries of a table with names chosen by the user.
    pub fn parse_named_entries<T: Setting>(&self, limits: &T::Limits) -> BTreeMap<String, T> {
        let parsed = |name: &str| Some((name.to_owned(), self.parse_value(name, self.entry(name)?.1, limits)?));
        self.names().filter_map(parsed).collect()
    }

    /// All tables in a table with names chosen by the user.
    pub fn named_sections(&self) -> Vec<(String, Section<'d, 't>)> {
        self.names().map(|name| (name.to_owned(), self.subsection(name, name))).collect()
    }

    /// Ends the reading of this table: every key that was not taken is a problem.
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
