//! A file while it is read, and what the reading found.

use super::problem::Problem;
use std::cell::RefCell;
use std::collections::BTreeMap;
use toml::Spanned;
use toml::de::DeTable;

/// What a reading found. Only when the whole file is read is it known what an unknown key may have meant.
pub(super) enum Finding {
    Wrong(Problem),
    Unknown { line: usize, table: String, key: String, is_table: bool },
    Missing { line: usize, table: String, key: &'static str, table_is_there: bool },
}

/// A parsed file while it is read.
pub(super) struct Document<'t> {
    pub(super) text: &'t str,
    pub(super) root: Spanned<DeTable<'t>>,
    pub(super) findings: RefCell<Vec<Finding>>,
    /// The keys of each table that was read.
    pub(super) known: RefCell<BTreeMap<String, Vec<&'static str>>>,
    /// Misspelt tables: the path that is meant, and the name that is written.
    pub(super) misspelt: BTreeMap<String, String>,
}

/// A key with its table.
pub(super) fn path(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}
