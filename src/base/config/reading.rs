//! The state while a file is read, and the findings.

use super::problem::Problem;
use std::cell::RefCell;
use std::collections::BTreeMap;
use toml::Spanned;
use toml::de::DeTable;

/// A finding of the reading. The possible meaning of an unknown key is only known when the whole file has been
/// read.
pub(super) enum Finding {
    Wrong(Problem),
    Unknown { line: usize, table: String, key: String, is_table: bool },
    Missing { line: usize, table: String, key: &'static str, table_is_there: bool },
}

/// A parsed file in the process of reading.
pub(super) struct Document<'t> {
    pub(super) text: &'t str,
    pub(super) root: Spanned<DeTable<'t>>,
    pub(super) findings: RefCell<Vec<Finding>>,
    /// The known keys of each table that was read.
    pub(super) known: RefCell<BTreeMap<String, Vec<&'static str>>>,
    /// Misspelt tables: the path of the right name, and the name in the file.
    pub(super) misspelt: BTreeMap<String, String>,
}

/// Returns the path of a key with its table.
pub(super) fn path(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}
