//! Sets values in a file's text and keeps the comments.

use toml_edit::{Item, TableLike, Value};

/// Sets a value of a table; an existing value is replaced, and its position and its comment are kept.
pub fn set_value(table: &mut dyn TableLike, key: &str, value: impl Into<Value>) {
    let mut value = value.into();
    match table.get_mut(key) {
        Some(before) => {
            if let Some(before) = before.as_value() {
                *value.decor_mut() = before.decor().clone();
            }
            *before = Item::Value(value);
        }
        None => drop(table.insert(key, Item::Value(value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use toml_edit::DocumentMut;

    #[test]
    fn a_value_is_set_beside_its_comment() {
        let mut document: DocumentMut = "# all\nrows = 4 # four\n".parse().expect("TOML");
        set_value(document.as_table_mut(), "rows", 5);
        set_value(document.as_table_mut(), "columns", 6);
        assert_eq!(document.to_string(), "# all\nrows = 5 # four\ncolumns = 6\n");
    }
}
