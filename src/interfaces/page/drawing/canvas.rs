//! The drawing area, which is used by several pages: the picture, the shapes on it, and the tools beside it.

use panelprep_cell::recipe::{DrawnShapes, Recipe, with_shapes};
use serde_json::json;
use std::collections::BTreeMap;

/// The script of the drawing area: a module that draws, and exports the functions `begin` and `now`.
pub const SCRIPT: &str = include_str!("sheet.js");
/// The style sheet of the drawing area.
pub const STYLE_SHEET: &str = include_str!("sheet.css");
/// The translation table of the drawing area, with one column for each language.
pub const TRANSLATION_TABLE: &str = include_str!("words.csv");
const MARKUP: &str = include_str!("sheet.html");

/// Returns the HTML of the drawing area. `picture` is the picture's URL, `buttons` the content above the tools, and
/// `word` returns the text for a key.
pub fn sheet_markup(picture: &str, buttons: &str, word: impl Fn(&str) -> String) -> String {
    let words: BTreeMap<&str, String> = keys().map(|key| (key, word(key))).collect();
    let of_script = escape_html(&json!(words).to_string());
    let put = [("{words}", of_script.as_str()), ("{picture}", picture), ("{buttons}", buttons)];
    let page = put.iter().fold(MARKUP.to_owned(), |page, (place, text)| page.replace(place, text));
    words.iter().fold(page, |page, (key, word)| page.replace(&format!("{{{key}}}"), &escape_html(word)))
}

/// Returns the keys of the translation table.
fn keys() -> impl Iterator<Item = &'static str> {
    TRANSLATION_TABLE.lines().skip(1).filter_map(|line| line.split(',').next())
}

/// Returns the English text for a key, for the page on this computer.
pub(super) fn english_text(key: &str) -> Option<String> {
    let mut reader = csv::Reader::from_reader(TRANSLATION_TABLE.as_bytes());
    let found = reader.records().filter_map(Result::ok).find(|record| record.get(0) == Some(key));
    found.and_then(|record| record.get(1).map(str::to_owned))
}

fn escape_html(text: &str) -> String {
    let put = [("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("\"", "&quot;")];
    put.iter().fold(text.to_owned(), |text, (sign, name)| text.replace(sign, name))
}

/// Returns the shapes that the recipe contains.
pub fn recipe_shapes(recipe: &Recipe) -> DrawnShapes {
    let region = recipe.region();
    DrawnShapes {
        corners_px: region.corners_px(),
        rows: u32::try_from(region.rows()).unwrap_or(u32::MAX),
        columns: u32::try_from(region.columns()).unwrap_or(u32::MAX),
        masked_px: recipe.inspect().masked_px(),
        outline_px: recipe.outline().outline_px(),
        held_px: recipe.outline().held_px(),
    }
}

/// Returns the recipe's text with the shapes that were drawn on a picture of this size. The result is checked again.
///
/// # Errors
/// A text for each problem of the resulting recipe.
pub fn recipe_with_shapes(
    (name, text): (&str, &str),
    [width, height]: [usize; 2],
    drawn: &DrawnShapes,
) -> Result<String, Vec<String>> {
    let [most_u, most_v] = [width, height].map(|size| size as f64 - 1.0);
    let outside = |[u, v]: &[f64; 2]| !(0.0..=most_u).contains(u) || !(0.0..=most_v).contains(v);
    let quadrilaterals = drawn.masked_px.iter().chain(&drawn.held_px).flatten();
    let all = quadrilaterals.chain(&drawn.outline_px).chain(&drawn.corners_px);
    if let Some([u, v]) = all.into_iter().find(|corner| outside(corner)) {
        return Err(vec![format!("the point ({u:.1}, {v:.1}) px is outside the picture ({width}×{height} px)")]);
    }
    let edited = with_shapes(text, drawn).map_err(|error| vec![error.to_string()])?;
    check_recipe(name, &edited)?;
    Ok(edited)
}

/// Parses and checks the text of a recipe.
///
/// # Errors
/// A text for each problem of the recipe.
pub fn check_recipe(name: &str, text: &str) -> Result<Recipe, Vec<String>> {
    Recipe::check(name, text).map_err(|problems| problems.to_string().lines().map(str::to_owned).collect())
}
