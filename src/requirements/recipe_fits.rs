//! Whether a recipe can be done in a cell: what both files say of the tool.

use super::Unmet;
use crate::cell::{Cell, CompliantTool};
use crate::force::Weight;
use crate::recipe::Recipe;
use crate::removal::model::UNKNOWN;
use crate::words::fixed;

/// Recipe and tool do not agree on a force.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ForceMismatch {
    /// A compliant tool without a force.
    #[error("the recipe states no [path] force_n; the cell's compliant tool needs the force with which it presses")]
    NoForce,
    /// A force that nothing presses with.
    #[error(
        "the recipe states [path] force_n = {found_n}, which has no effect: the cell's [tool] is a spring; take the key out, or use a \
         cell with a compliant tool"
    )]
    ForceOfSpring {
        /// What is stated, N.
        found_n: f64,
    },
    /// More than the tool has.
    #[error(
        "the recipe states [path] force_n = {found_n}; with its band of {band_n} N and the weight of its payload, {} N, which \
         a tool that points up lifts as well, it exceeds [tool] max_force_n, {most_n}",
        fixed(*weight_n, 1)
    )]
    TooMuchForce {
        /// What is stated, N.
        found_n: f64,
        /// The band, N.
        band_n: f64,
        /// The weight of what hangs on it, N.
        weight_n: f64,
        /// The tool's strongest push, N.
        most_n: f64,
    },
}

/// Whether recipe and tool agree on a force; a spring is told none.
///
/// # Errors
/// What does not fit.
pub fn force_fits(tool: Option<&CompliantTool>, recipe: &Recipe) -> Result<(), ForceMismatch> {
    match (tool, recipe.path().force_n()) {
        (None, None) => Ok(()),
        (Some(_), None) => Err(ForceMismatch::NoForce),
        (None, Some(found_n)) => Err(ForceMismatch::ForceOfSpring { found_n }),
        (Some(tool), Some(found_n)) => {
            // Pointing up it lifts its payload as well.
            let (band_n, weight_n, most_n) = (tool.band_n, Weight::from(tool).presses_n(1.0), tool.max_force_n);
            match found_n + band_n + weight_n > most_n {
                true => Err(ForceMismatch::TooMuchForce { found_n, band_n, weight_n, most_n }),
                false => Ok(()),
            }
        }
    }
}

/// What a recipe asks for and this cell cannot do, by the recipe's keys; empty where both fit.
pub fn unfit(cell: &Cell, recipe: &Recipe) -> Vec<Unmet> {
    let force = force_fits(cell.tool().compliant(), recipe).err();
    let force = force.map(|mismatch| Unmet::new("path.force_n", mismatch.to_string()));
    let is_unknown = recipe.removal().is_some() && cell.calibration().removal.is_none();
    let removal = is_unknown.then(|| Unmet::new("removal", UNKNOWN));
    force.into_iter().chain(removal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(cell: &str, recipe: &str) -> Vec<String> {
        let cell = Cell::check("cell.toml", cell).unwrap_or_else(|problems| panic!("{problems}"));
        let region = "panel = \"p\"\n[locate]\nbox_min_mm = [0.0, 0.0, 0.0]\nbox_max_mm = [900.0, 900.0, 900.0]\n[region]\n\
                      corners_px = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]\nrows = 1\ncolumns = 1\n";
        let recipe = Recipe::check("recipe.toml", &format!("{region}{recipe}"))
            .unwrap_or_else(|problems| panic!("{problems}"));
        unfit(&cell, &recipe).into_iter().map(|unmet| unmet.key).collect()
    }

    /// By hand: of 100 N the payload of 1.5 kg takes 14.7 and the band 5: 80.2 N fit, 80.4 do not.
    #[test]
    fn recipe_and_cell_agree_on_the_tool() {
        let compliant = "[tool]\nkind = \"simulated\"\n";
        let force = |force_n: f64| format!("[path]\nforce_n = {force_n}\n");
        assert_eq!([keys("", ""), keys(compliant, &force(80.2))], [vec![], Vec::<String>::new()]);
        for (cell, recipe) in [("", force(20.0)), (compliant, String::new()), (compliant, force(80.4))] {
            assert_eq!(keys(cell, &recipe), ["path.force_n"], "{cell} {recipe}");
        }
        let removal = "[removal]\ntarget_um = 20.0\nmax_um = 60.0\nforce_n = 15.0\n";
        assert_eq!(keys("", removal), ["removal"]);
        assert_eq!(keys("[calibration]\nremoval = \"removal.toml\"\n", removal), Vec::<String>::new());
    }
}
