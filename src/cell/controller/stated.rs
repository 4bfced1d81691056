//! Reads a data list as numbers by name and index.

use super::names::CONFIG;
use panelprep_base::config::Problem;
use panelprep_kuka::krl::{DeclaredVariable, StatedValue, UnreadValue, parse};
use std::collections::BTreeMap;

/// Returns the highest acceleration that the controller accepts, m/s², from the text of `cell_config.dat`.
pub fn highest_acceleration_m_s2(config: &str) -> Option<f64> {
    DataList::parse(CONFIG, config).get("CELL_ACC_MAX").map(|number| number.value)
}

/// A number, and the line on which it is stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Number {
    pub value: f64,
    pub line: usize,
}

impl Number {
    /// Returns the number as an integer, if it is whole and fits in 32 bits.
    pub fn as_integer(self) -> Option<i32> {
        let whole = self.value as i32;
        (f64::from(whole) == self.value).then_some(whole)
    }
}

/// Returns the name of a variable or of an element of an array, as a message names it.
pub(super) fn stated_key(name: &str, index: Option<i32>) -> String {
    index.map_or(name.to_owned(), |index| format!("{name}[{index}]"))
}

/// The numbers of one data list.
#[derive(Debug, Default)]
pub(super) struct DataList {
    numbers: BTreeMap<(String, Option<i32>), Number>,
    /// Values that are no plain numbers: name, index, line.
    unread: Vec<UnreadValue>,
    /// Values that are stated twice: name, index, line of the second statement.
    duplicates: Vec<StatedValue>,
    /// The variables that the list declares.
    pub declared: Vec<DeclaredVariable>,
    /// The line of DEFDAT, and whether the list is PUBLIC; `None` if the text is not a data list.
    pub list: Option<(usize, bool)>,
    /// The problems that the reader of KRL found.
    pub problems: Vec<Problem>,
}

impl DataList {
    /// Reads the text of a data list.
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

    /// A single number.
    pub fn get(&self, name: &str) -> Option<Number> {
        self.numbers.get(&(name.to_owned(), None)).copied()
    }

    /// Returns an element of an array, from 1.
    pub fn element(&self, name: &str, index: i32) -> Option<Number> {
        self.numbers.get(&(name.to_owned(), Some(index))).copied()
    }

    /// Returns all stated elements of an array, by their indices.
    pub fn array(&self, name: &str) -> BTreeMap<i32, Number> {
        let of_name = self.numbers.iter().filter(|((of, _), _)| of == name);
        of_name.filter_map(|((_, index), number)| Some(((*index)?, *number))).collect()
    }

    /// Returns the line of the first value of this name, single or in an array.
    pub fn first_line_of(&self, name: &str) -> Option<usize> {
        let of_name = self.numbers.iter().filter(|((of, _), _)| of == name);
        of_name.map(|(_, number)| number.line).min()
    }

    /// Returns the values that are no plain numbers, each by its key, with its line. Another number of the same name does
    /// not hold: the controller uses the last value.
    pub fn unread(&self) -> Vec<(String, usize)> {
        self.unread.iter().map(|value| (stated_key(&value.name, value.index), value.line)).collect()
    }

    /// Returns the values that are stated a second time.
    pub fn duplicates(&self) -> &[StatedValue] {
        &self.duplicates
    }
}
