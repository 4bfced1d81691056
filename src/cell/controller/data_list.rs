//! Reads a KRL data list, and compares its declarations with those of this release. A cell engineer may change the
//! numbers, but not the names, types and visibility, because the controller's programs need them.

use super::names::{CONFIG, Differences};
use panelprep_base::config::Problem;
use panelprep_kuka::krl::{DeclaredVariable, StatedValue, UnreadValue, parse};
use std::collections::{BTreeMap, BTreeSet};

/// Returns the highest acceleration that the controller accepts, m/s², from the text of `cell_config.dat`.
pub fn highest_acceleration_m_s2(config: &str) -> Option<f64> {
    DataList::parse(CONFIG, config).get("CELL_ACC_MAX").map(|number| number.value)
}

/// A number in the data list, and its line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Number {
    pub value: f64,
    pub line: usize,
}

impl Number {
    /// Returns the number as an integer; `None` if it has a fraction or does not fit in 32 bits.
    pub fn as_integer(self) -> Option<i32> {
        let whole = self.value as i32;
        (f64::from(whole) == self.value).then_some(whole)
    }
}

/// Returns the name of a variable, or of an element of an array, for messages.
pub(super) fn format_variable_name(name: &str, index: Option<i32>) -> String {
    index.map_or(name.to_owned(), |index| format!("{name}[{index}]"))
}

/// The contents of a data list.
#[derive(Debug, Default)]
pub(super) struct DataList {
    numbers: BTreeMap<(String, Option<i32>), Number>,
    /// Values that are not plain numbers: name, index, line.
    unread: Vec<UnreadValue>,
    /// Values that are assigned twice: name, index, line of the second assignment.
    duplicates: Vec<StatedValue>,
    /// The variables that the list declares.
    pub declared: Vec<DeclaredVariable>,
    /// The line of DEFDAT, and whether the list is PUBLIC; `None` if the text is not a data list.
    pub list: Option<(usize, bool)>,
    /// The problems that the KRL parser found.
    pub problems: Vec<Problem>,
}

impl DataList {
    /// Parses the text of a data list.
    pub fn parse(name: &str, text: &str) -> Self {
        let file = parse(name, text);
        let mut list = DataList {
            problems: file.problems.clone(),
            declared: file.declared_variables(),
            list: file.data_list(),
            unread: file.unread_values(),
            ..DataList::default()
        };
        for stated in file.stated_values() {
            let number = Number { value: stated.value, line: stated.line };
            if list.numbers.insert((stated.name.clone(), stated.index), number).is_some() {
                list.duplicates.push(stated);
            }
        }
        list
    }

    /// Returns the number that is assigned to this variable.
    pub fn get(&self, name: &str) -> Option<Number> {
        self.numbers.get(&(name.to_owned(), None)).copied()
    }

    /// Returns an element of an array; the first index is 1.
    pub fn element(&self, name: &str, index: i32) -> Option<Number> {
        self.numbers.get(&(name.to_owned(), Some(index))).copied()
    }

    /// Returns all assigned elements of an array, by index.
    pub fn array(&self, name: &str) -> BTreeMap<i32, Number> {
        let of_name = self.numbers.iter().filter(|((of, _), _)| of == name);
        of_name.filter_map(|((_, index), number)| Some(((*index)?, *number))).collect()
    }

    /// Returns the first line in which this variable, or an element of this array, gets a value.
    pub fn first_line_of(&self, name: &str) -> Option<usize> {
        let of_name = self.numbers.iter().filter(|((of, _), _)| of == name);
        of_name.map(|(_, number)| number.line).min()
    }

    /// Returns the values that are not plain numbers, each with its key and line. An earlier number of the same
    /// variable must not be used instead, because the controller uses the last value.
    pub fn unread(&self) -> Vec<(String, usize)> {
        self.unread.iter().map(|value| (format_variable_name(&value.name, value.index), value.line)).collect()
    }

    /// Returns the values that are assigned a second time.
    pub fn duplicates(&self) -> &[StatedValue] {
        &self.duplicates
    }
}

/// The data list of this release.
const RELEASE_DATA_LIST: &str = include_str!("../../../config/kuka/cell_config.dat");
/// Maximum number of names that one message lists.
const MAX_LISTED_NAMES: usize = 8;

/// Reports every declaration that differs from this release. Returns the names without declaration and value; one
/// message reports all of them.
pub(super) fn compare_declarations(config: &DataList, found: &mut Differences) -> BTreeSet<String> {
    if let Some((line, false)) = config.list {
        let message = "is not PUBLIC: the other programs would not find its variables, and the controller would refuse \
                       them; write `DEFDAT CELL_CONFIG PUBLIC`";
        found.note(CONFIG, line, "DEFDAT", message);
    }
    let shipped = DataList::parse(CONFIG, RELEASE_DATA_LIST);
    let mut missing = Vec::new();
    for expected in &shipped.declared {
        match config.declared.iter().find(|declared| declared.name == expected.name) {
            Some(declared) if !is_same(declared, expected) => {
                let message = format!(
                    "is declared as `{declared}`, and must be `{expected}`: the controller's programs need this declaration; only \
                     numbers may be changed"
                );
                found.note(CONFIG, declared.line, &*expected.name, message);
            }
            Some(_) => {}
            None => match config.first_line_of(&expected.name) {
                Some(line) => {
                    let message = format!(
                        "has a value but no declaration: the controller refuses the list; write `{expected}` above it"
                    );
                    found.note(CONFIG, line, &*expected.name, message);
                }
                None => missing.push(expected),
            },
        }
    }
    note_missing(&missing, found);
    missing.into_iter().map(|expected| expected.name.clone()).collect()
}

/// Reports all missing names in one message: if several names are missing, the file belongs to an earlier release.
fn note_missing(missing: &[&DeclaredVariable], found: &mut Differences) {
    match missing {
        [] => {}
        [only] => {
            let message =
                format!("is not declared, and the programs need it; write `{only}`, as in this program's own file");
            found.note(CONFIG, 1, &*only.name, message);
        }
        several => {
            let mut names: Vec<&str> = several.iter().take(MAX_LISTED_NAMES).map(|it| it.name.as_str()).collect();
            let more = format!("{} more", several.len().saturating_sub(MAX_LISTED_NAMES));
            if several.len() > MAX_LISTED_NAMES {
                names.push(&more);
            }
            let message = format!(
                "of an earlier release: {} are missing, but the programs of this release need them; copy {CONFIG} \
                 of this program's config/kuka and enter the numbers of this cell there",
                names.join(", ")
            );
            found.note(CONFIG, 1, "DEFDAT", message);
        }
    }
}

fn is_same(one: &DeclaredVariable, other: &DeclaredVariable) -> bool {
    let what = |it: &DeclaredVariable| (it.global, it.constant, it.type_name.clone(), it.sizes.clone());
    what(one) == what(other)
}
