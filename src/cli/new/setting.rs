//! Sets values in a sample's text.

use crate::config::set_value;
use toml_edit::{DocumentMut, Value};

/// Sets a value of a file's text, in a table that is there; the comment beside it stays.
pub(super) fn set(document: &mut DocumentMut, table: &str, key: &str, value: impl Into<Value>) {
    let mut below = table.split('.').filter(|name| !name.is_empty());
    let home = below.try_fold(document.as_table_mut(), |home, name| home.get_mut(name)?.as_table_mut());
    if let Some(home) = home {
        set_value(home, key, value);
    }
}
