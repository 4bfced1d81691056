//! A file as tables from which keys are taken; what is left over is unknown.

use super::problem::{Problem, Problems, nearest};
use super::value::Setting;
use std::cell::RefCell;
use std::collections::BTreeMap;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A parsed file, not yet checked.
pub struct Document<'t> {
    file: String,
    text: &'t str,
    root: Spanned<DeTable<'t>>,
    problems: RefCell<Vec<Problem>>,
}

impl<'t> Document<'t> {
    /// Parses a file's text. Syntax errors become problems; what could be read is read.
    pub fn parse(file: &str, text: &'t str) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let problem = |error: &toml::de::Error| Problem {
            line: error.span().map_or(0, |span| line_of(text, span.start)),
            key: String::new(),
            message: error.message().to_owned(),
        };
        let problems = RefCell::new(errors.iter().map(problem).collect());
        Document { file: file.to_owned(), text, root, problems }
    }

    /// The top of the file.
    pub fn top(&self) -> Section<'_, 't> {
        Section::new(self, String::new(), Some(self.root.get_ref()), 1)
    }

    /// The checked value, where no problem was found on the way to it.
    ///
    /// # Errors
    /// All problems in the order of their lines.
    pub fn finish<T>(self, checked: Option<T>) -> Result<T, Problems> {
        let mut list = self.problems.into_inner();
        list.sort_by_key(|problem| problem.line);
        match checked {
            Some(value) if list.is_empty() => Ok(value),
            _ => Err(Problems { file: self.file, list }),
        }
    }
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

/// One table of a file. Keys are taken from it; [`Section::done`] reports those that nobody took.
pub struct Section<'d, 't> {
    document: &'d Document<'t>,
    path: String,
    table: Option<&'d DeTable<'t>>,
    line: usize,
    known: RefCell<Vec<&'static str>>,
}

impl<'d, 't> Section<'d, 't> {
    fn new(document: &'d Document<'t>, path: String, table: Option<&'d DeTable<'t>>, line: usize) -> Self {
        Section { document, path, table, line, known: RefCell::new(Vec::new()) }
    }

    fn key_path(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Notes a problem with one key of this table, at the key's line where it is there.
    pub fn problem(&self, key: &str, message: impl Into<String>) {
        let line = self.entry(key).map_or(self.line, |(line, _)| line);
        let problem = Problem { line, key: self.key_path(key), message: message.into() };
        self.document.problems.borrow_mut().push(problem);
    }

    fn entry(&self, key: &str) -> Option<(usize, &'d DeValue<'t>)> {
        let (name, value) = self.table?.get_key_value(key)?;
        Some((line_of(self.document.text, name.span().start), value.get_ref()))
    }

    fn known_entry(&self, key: &'static str) -> Option<&'d DeValue<'t>> {
        self.known.borrow_mut().push(key);
        self.entry(key).map(|(_, value)| value)
    }

    /// The same table for one more look after [`Section::done`], to note problems between keys.
    pub fn alike(&self) -> Self {
        Section::new(self.document, self.path.clone(), self.table, self.line)
    }

    /// Is this table in the file at all?
    pub fn is_present(&self) -> bool {
        self.table.is_some()
    }

    /// Takes a key; without one the default holds, and without a default the key is missing.
    pub fn take<T: Setting>(&self, key: &'static str, limits: T::Limits, default: Option<T>) -> Option<T> {
        match self.known_entry(key) {
            Some(value) => T::parse(value, &limits).map_err(|message| self.problem(key, message)).ok(),
            None if default.is_some() => default,
            None => {
                self.problem(key, "is missing; this key has no default");
                None
            }
        }
    }

    /// Takes a key that may be absent.
    pub fn take_optional<T: Setting>(&self, key: &'static str, limits: T::Limits) -> Option<T> {
        self.known_entry(key)
            .and_then(|value| T::parse(value, &limits).map_err(|message| self.problem(key, message)).ok())
    }

    /// A table inside this one; an absent table reads as an empty one.
    pub fn section(&self, key: &'static str) -> Section<'d, 't> {
        let value = self.known_entry(key);
        let table = value.and_then(DeValue::as_table);
        if value.is_some() && table.is_none() {
            self.problem(key, format!("is not a table; write [{}]", self.key_path(key)));
        }
        let line = self.entry(key).map_or(self.line, |(line, _)| line);
        Section::new(self.document, self.key_path(key), table, line)
    }

    /// The tables of a list, `[[key]]`; an absent list is empty.
    pub fn sections(&self, key: &'static str) -> Vec<Section<'d, 't>> {
        let Some(value) = self.known_entry(key) else { return Vec::new() };
        let Some(list) = value.as_array() else {
            self.problem(key, format!("is not a list of tables; write [[{}]]", self.key_path(key)));
            return Vec::new();
        };
        let item = |(index, item): (usize, &'d Spanned<DeValue<'t>>)| {
            let path = format!("{}[{}]", self.key_path(key), index + 1);
            let line = line_of(self.document.text, item.span().start);
            if item.get_ref().as_table().is_none() {
                self.problem(key, format!("item {} is not a table; write [[{}]]", index + 1, self.key_path(key)));
            }
            Section::new(self.document, path, item.get_ref().as_table(), line)
        };
        list.iter().enumerate().map(item).collect()
    }

    /// All entries of this table whose value is of one kind: names that the user chooses.
    pub fn take_named<T: Setting>(&self, limits: &T::Limits) -> BTreeMap<String, T> {
        let mut named = BTreeMap::new();
        for (key, value) in self.table.into_iter().flatten() {
            match T::parse(value.get_ref(), limits) {
                Ok(parsed) => {
                    named.insert(key.get_ref().to_string(), parsed);
                }
                Err(message) => self.problem(key.get_ref(), message),
            }
        }
        named
    }

    /// Ends the reading of this table: every key that nobody took is a problem, with the nearest right name.
    pub fn done(self) {
        let known = self.known.borrow();
        for key in self.table.into_iter().flatten().map(|(key, _)| key.get_ref()) {
            if known.contains(&key.as_ref()) {
                continue;
            }
            let message = match nearest(key, &known) {
                Some((name, Some(rule))) => format!("unknown key; {rule}: write {name}"),
                Some((name, None)) => format!("unknown key; did you mean {name}?"),
                None => format!("unknown key; known here: {}", known.join(", ")),
            };
            self.problem(key, message);
        }
    }
}
