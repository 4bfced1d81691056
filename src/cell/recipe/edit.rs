//! Writes the shapes that a person has drawn on the taught picture into the text of a recipe. All other text, including
//! comments, stays unchanged.

use panelprep_base::config::set_value;
use serde::{Deserialize, Serialize};
use toml_edit::{Array, DocumentMut, Item, Table, Value};

/// The shapes that a person has drawn on the taught picture, px.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrawnShapes {
    /// The region's corners, in order.
    pub corners_px: [[f64; 2]; 4],
    /// Number of rows of grids.
    pub rows: u32,
    /// Number of columns of grids.
    pub columns: u32,
    /// Quadrilaterals that are excluded from the inspection.
    pub masked_px: Vec<[[f64; 2]; 4]>,
    /// The corners of the panel's outline; empty if the outline is taken from the scan.
    pub outline_px: Vec<[f64; 2]>,
    /// Quadrilaterals at which the panel is held.
    pub held_px: Vec<[[f64; 2]; 4]>,
}

/// The reason why the shapes cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// The text is not TOML.
    #[error("the recipe is not valid TOML: {0}")]
    NotToml(#[from] toml_edit::TomlError),
    /// A key that must be a table has another value.
    #[error("{key} must be a table")]
    NotATable {
        /// The key that must be a table.
        key: &'static str,
    },
}

/// Returns the text of the recipe with the drawn shapes. Pixels are rounded to 0.1 px.
///
/// # Errors
/// If the text is not TOML, or `region` or `inspect` is not a table.
pub fn with_shapes(text: &str, drawn: &DrawnShapes) -> Result<String, EditError> {
    let mut document: DocumentMut = text.parse()?;
    put_key(&mut document, "region", "corners_px", polygon(&drawn.corners_px))?;
    put_key(&mut document, "region", "rows", i64::from(drawn.rows))?;
    put_key(&mut document, "region", "columns", i64::from(drawn.columns))?;
    let all =
        |shapes: &[[[f64; 2]; 4]]| shapes.iter().map(|corners| Value::from(polygon(corners))).collect::<Array>();
    set_list(&mut document, "inspect", "masked_px", all(&drawn.masked_px))?;
    set_list(&mut document, "panel", "outline_px", polygon(&drawn.outline_px))?;
    set_list(&mut document, "panel", "held_px", all(&drawn.held_px))?;
    Ok(document.to_string())
}

fn polygon(corners: &[[f64; 2]]) -> Array {
    corners.iter().map(|corner| array(corner.map(number))).collect()
}

/// Sets a list, unless it is empty and the text does not contain it yet.
fn set_list(document: &mut DocumentMut, table: &'static str, key: &str, list: Array) -> Result<(), EditError> {
    let has_one = document.get(table).and_then(|table| table.get(key)).is_some();
    if has_one || !list.is_empty() {
        put_key(document, table, key, list)?;
    }
    Ok(())
}

/// Rewrites `panel = "name"` as `panel.name = "name"`, so that more keys can be added to the table. Comments before the
/// key stay before it.
fn expand_panel_key(document: &mut DocumentMut, key: &'static str) {
    let Some((written, item)) = document.as_table_mut().get_key_value_mut(key) else { return };
    let Some(name) = item.as_value().filter(|value| value.is_str()).cloned() else { return };
    let mut table = Table::new();
    table.set_dotted(true);
    table.insert("name", Item::Value(name));
    if let Some(mut inner) = table.key_mut("name") {
        *inner.leaf_decor_mut() = written.leaf_decor().clone();
    }
    *item = Item::Table(table);
}

/// Formats a number with as few decimals as possible.
fn number(px: f64) -> Value {
    let tenth = (px * 10.0).round() / 10.0;
    if tenth.fract() == 0.0 { Value::from(tenth as i64) } else { Value::from(tenth) }
}

fn array(values: [Value; 2]) -> Value {
    Value::from(values.into_iter().collect::<Array>())
}

/// Sets a value in a table; the table is created if it does not exist.
fn put_key(
    document: &mut DocumentMut,
    table: &'static str,
    key: &str,
    value: impl Into<Value>,
) -> Result<(), EditError> {
    expand_panel_key(document, table);
    let item = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    set_value(item.as_table_like_mut().ok_or(EditError::NotATable { key: table })?, key, value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Recipe;

    const DRAWN: DrawnShapes = DrawnShapes {
        corners_px: [[700.04, 350.0], [1250.0, 350.26], [1250.0, 850.0], [700.0, 850.0]],
        rows: 3,
        columns: 5,
        masked_px: vec![],
        outline_px: vec![],
        held_px: vec![],
    };

    #[test]
    fn drawn_shapes_are_written_and_comments_stay() {
        let text = "# the door\npanel = \"door\"\n\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [900, 900, 900]\n\n\
                    [region] # by hand\ncorners_px = [[1, 2], [3, 2], [3, 4], [1, 4]] # from the ruler\nrows = 4\ncolumns = 6 # wide\n";
        let edited = with_shapes(text, &DRAWN).expect("a recipe");
        let expected = text
            .replace("[[1, 2], [3, 2], [3, 4], [1, 4]]", "[[700, 350], [1250, 350.3], [1250, 850], [700, 850]]")
            .replace("rows = 4", "rows = 3")
            .replace("columns = 6", "columns = 5");
        assert_eq!(edited, expected);
        let recipe = Recipe::check("door.toml", &edited).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!((recipe.region().rows(), recipe.region().columns()), (3, 5));
    }

    #[test]
    fn masks_are_written_into_their_own_table_and_removed_again() {
        let text = "region = { corners_px = [[1, 2], [3, 2], [3, 4], [1, 4]], rows = 1, columns = 1 }\n";
        let masked_px = vec![[[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.5]]];
        let with = with_shapes(text, &DrawnShapes { masked_px, ..DRAWN }).expect("a recipe");
        assert!(with.contains("[inspect]\nmasked_px = [[[1, 1], [2, 1], [2, 2], [1, 2.5]]]"), "{with}");
        assert!(with.starts_with("region = { corners_px = [[700, 350]"), "{with}");
        assert!(with_shapes(&with, &DRAWN).expect("a recipe").contains("masked_px = []"));
        assert!(!with_shapes(text, &DRAWN).expect("a recipe").contains("masked"), "none were, none are");
    }

    /// The short form of the panel's name is replaced by a table in the same position.
    #[test]
    fn an_outline_and_held_edges_are_written_beside_the_panels_name() {
        let text = "# the door\npanel = \"door\" # the left one\nregion = { corners_px = [[1, 2], [3, 2], [3, 4], [1, 4]], rows = 1, columns = 1 }\n";
        let outline_px = vec![[600.0, 300.0], [1300.0, 300.0], [950.25, 900.0]];
        let held_px = vec![[[900.0, 290.0], [1000.0, 290.0], [1000.0, 310.0], [900.0, 310.0]]];
        let with = with_shapes(text, &DrawnShapes { outline_px, held_px, ..DRAWN }).expect("a recipe");
        let (head, _) = with.split_once("region =").expect("the region");
        let expected = "# the door\npanel.name = \"door\" # the left one\npanel.outline_px = [[600, 300], [1300, 300], [950.3, 900]]\n\
                        panel.held_px = [[[900, 290], [1000, 290], [1000, 310], [900, 310]]]\n";
        assert_eq!(head, expected);
        let without = with_shapes(&with, &DRAWN).expect("a recipe");
        assert!(without.contains("panel.outline_px = []\npanel.held_px = []\n"), "{without}");
        let table = "[panel]\nname = \"door\" # the left one\n";
        let outline_px = vec![[6.0, 3.0], [13.0, 3.0], [9.0, 9.0]];
        let with = with_shapes(table, &DrawnShapes { outline_px, ..DRAWN }).expect("a recipe");
        assert!(with.starts_with(&format!("{table}outline_px = [[6, 3], [13, 3], [9, 9]]\n")), "{with}");
    }

    #[test]
    fn a_text_that_is_no_recipe_is_refused() {
        assert!(with_shapes("panel = ", &DRAWN).is_err());
        let error = with_shapes("region = 3\n", &DRAWN).expect_err("no table").to_string();
        assert_eq!(error, "region must be a table");
    }
}
