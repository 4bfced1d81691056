//! What a person drew on the taught picture, put into a recipe's text. Everything else in the text stays as it is, comments too.

use crate::config::set_value;
use serde::{Deserialize, Serialize};
use toml_edit::{Array, DocumentMut, Item, Table, Value};

/// What is drawn on the taught scan's picture, px.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drawn {
    /// The region's corners, in order.
    pub corners_px: [[f64; 2]; 4],
    /// Rows of grids.
    pub rows: u32,
    /// Columns of grids.
    pub columns: u32,
    /// What is not inspected: quadrilaterals.
    pub masked_px: Vec<[[f64; 2]; 4]>,
}

/// Why nothing could be put in.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// It is no TOML.
    #[error("the recipe is no TOML: {0}")]
    NotToml(#[from] toml_edit::TomlError),
    /// Something else stands where a table belongs.
    #[error("{key} must be a table")]
    NotATable {
        /// Its key.
        key: &'static str,
    },
}

/// The recipe's text with what was drawn in it. Pixels are rounded to a tenth.
///
/// # Errors
/// Where the text is no TOML, or `region` or `inspect` is no table.
pub fn drawn_into(text: &str, drawn: &Drawn) -> Result<String, EditError> {
    let mut document: DocumentMut = text.parse()?;
    let quadrilateral =
        |corners: &[[f64; 2]; 4]| corners.iter().map(|corner| array(corner.map(number))).collect::<Array>();
    put(&mut document, "region", "corners_px", quadrilateral(&drawn.corners_px))?;
    put(&mut document, "region", "rows", i64::from(drawn.rows))?;
    put(&mut document, "region", "columns", i64::from(drawn.columns))?;
    let masked: Array = drawn.masked_px.iter().map(|corners| Value::from(quadrilateral(corners))).collect();
    let has_masks = document.get("inspect").and_then(|inspect| inspect.get("masked_px")).is_some();
    if has_masks || !masked.is_empty() {
        put(&mut document, "inspect", "masked_px", masked)?;
    }
    Ok(document.to_string())
}

/// A number as a person would write it.
fn number(px: f64) -> Value {
    let tenth = (px * 10.0).round() / 10.0;
    if tenth.fract() == 0.0 { Value::from(tenth as i64) } else { Value::from(tenth) }
}

fn array(values: [Value; 2]) -> Value {
    Value::from(values.into_iter().collect::<Array>())
}

/// Sets a value in a table, which is made where it is not there.
fn put(
    document: &mut DocumentMut,
    table: &'static str,
    key: &str,
    value: impl Into<Value>,
) -> Result<(), EditError> {
    let item = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    set_value(item.as_table_like_mut().ok_or(EditError::NotATable { key: table })?, key, value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Recipe;

    const DRAWN: Drawn = Drawn {
        corners_px: [[700.04, 350.0], [1250.0, 350.26], [1250.0, 850.0], [700.0, 850.0]],
        rows: 3,
        columns: 5,
        masked_px: vec![],
    };

    #[test]
    fn what_was_drawn_is_put_in_and_comments_stay() {
        let text = "# the door\npanel = \"door\"\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                    [region] # by hand\ncorners_px = [[1, 2], [3, 2], [3, 4], [1, 4]] # from the ruler\nrows = 4\ncolumns = 6 # wide\n";
        let edited = drawn_into(text, &DRAWN).expect("a recipe");
        let expected = text
            .replace("[[1, 2], [3, 2], [3, 4], [1, 4]]", "[[700, 350], [1250, 350.3], [1250, 850], [700, 850]]")
            .replace("rows = 4", "rows = 3")
            .replace("columns = 6", "columns = 5");
        assert_eq!(edited, expected);
        let recipe = Recipe::check("door.toml", &edited).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((recipe.region().rows(), recipe.region().columns()), (3, 5));
    }

    #[test]
    fn masks_come_into_a_table_of_their_own_and_go_again() {
        let text = "region = { corners_px = [[1, 2], [3, 2], [3, 4], [1, 4]], rows = 1, columns = 1 }\n";
        let masked_px = vec![[[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.5]]];
        let with = drawn_into(text, &Drawn { masked_px, ..DRAWN }).expect("a recipe");
        assert!(with.contains("[inspect]\nmasked_px = [[[1, 1], [2, 1], [2, 2], [1, 2.5]]]"), "{with}");
        assert!(with.starts_with("region = { corners_px = [[700, 350]"), "{with}");
        assert!(drawn_into(&with, &DRAWN).expect("a recipe").contains("masked_px = []"));
        assert!(!drawn_into(text, &DRAWN).expect("a recipe").contains("masked"), "none were, none are");
    }

    #[test]
    fn what_is_no_recipe_is_left_alone() {
        assert!(drawn_into("panel = ", &DRAWN).is_err());
        let error = drawn_into("region = 3\n", &DRAWN).expect_err("no table").to_string();
        assert_eq!(error, "region must be a table");
    }
}
