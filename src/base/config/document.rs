//! Checks a whole file: parses it, reads its keys, and turns all findings into a list of problems.

use super::nearest::nearest;
use super::problem::{Problem, Problems};
use super::reading::{Document, Finding, path};
use super::section::Section;
use super::syntax;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use toml::de::DeTable;

/// Checks a file: `parse` reads its keys and returns the checked form if it found no problem. `parse` is called
/// twice: the first reading finds the misspelt tables, so that the second one can also list the problems inside
/// them.
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
    let list = document.problems(errors.iter().map(|error| syntax::syntax_problem(text, error)));
    match checked {
        Some(value) if list.is_empty() => Ok(value),
        _ => Err(Problems { file: file.to_owned(), list }),
    }
}

/// Returns the keys at the top of a file, as far as the file can be parsed.
pub fn top_keys(text: &str) -> Vec<String> {
    let (root, _) = DeTable::parse_recoverable(text);
    root.get_ref().keys().map(|key| key.get_ref().to_string()).collect()
}

/// The probable meaning of an unknown key.
enum KeyMeaning {
    /// A key of the same table, with another name or another unit.
    Near(&'static str, Option<&'static str>),
    /// A key of other tables.
    Elsewhere(Vec<String>),
    Nothing,
}

impl<'t> Document<'t> {
    fn root_section(&self) -> Section<'_, 't> {
        Section::new(self, String::new(), Some(self.root.get_ref()), 1)
    }

    /// Finds the probable meaning of an unknown key. A number or a text under the name of a whole table is not
    /// meant for that table.
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
        // The parser invents a value for a broken line and skips others: problems that result from this are not
        // reported.
        list.retain(|problem| !syntax.iter().any(|error| error.line == problem.line));
        missing.retain(|(_, key), _| syntax.is_empty() && !explained.contains(key));
        list.extend(missing.into_iter().map(|((line, key), needs)| missing_problem(line, key, &needs)));
        list.extend(syntax);
        list.sort_by_key(|problem| problem.line);
        list
    }

    /// The message for an unknown key, and the keys that may have been meant.
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
