//! A program that can be executed: its steps, routines, memory and texts.

use super::code::{Cell, Entry, Location, Op, Shared};
use super::condense::Condensed;
use std::collections::BTreeMap;

/// A program that can be executed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// The steps.
    pub code: Vec<Op>,
    /// The location of each statement.
    pub statements: Vec<Location>,
    /// All routines.
    pub routines: Vec<Entry>,
    /// Shared memory with the values of the data lists.
    pub memory: Vec<Cell>,
    /// All shared variables.
    pub shared: Vec<Shared>,
    /// All texts.
    pub texts: Vec<String>,
    /// The files' names.
    pub files: Vec<String>,
    /// Statements that are not executed, by their indices, each with a description of the part that is not
    /// executed.
    pub unexecuted: BTreeMap<u32, String>,
    /// Whether the program has more steps than are stored; it must not be executed then.
    pub is_too_large: bool,
    /// The steps in combined form.
    pub(super) condensed: Condensed,
}

impl Program {
    /// Returns the routine of this name.
    pub fn routine(&self, name: &str) -> Option<u32> {
        self.routines.iter().position(|routine| routine.name == name).and_then(|index| u32::try_from(index).ok())
    }

    /// Returns the first cell of the shared variable of this name.
    pub fn cell(&self, name: &str) -> Option<u32> {
        self.shared.iter().find(|shared| shared.name == name).map(|shared| shared.offset)
    }
}
