//! Checks whether a cell can execute a recipe, from the values of both files about the tool, the feed and the region.

use super::{NamedFile, ReadNamed, UnmetRequirement, check_box_unit, to_problems};
use panelprep_base::config::Problems;
use panelprep_base::number_text::{fixed_decimals, shortest_text};
use panelprep_cell::cell::{Cell, CompliantTool, Intrinsics};
use panelprep_cell::force::SensorLoad;
use panelprep_cell::recipe::{Recipe, TreatBy};
use panelprep_toolpath::removal::model::NO_MODEL_MESSAGE;

/// Error: the force in the recipe does not match the tool.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ForceMismatch {
    /// The tool is compliant, but the recipe contains no force.
    #[error("the recipe contains no [path] force_n, which the cell's compliant tool needs: add the force")]
    NoForce,
    /// The recipe contains a force, but the tool cannot apply it.
    #[error(
        "the recipe contains [path] force_n = {found_n}, which has no effect: the cell's [tool] is a spring; remove \
         the key, or use a cell with a compliant tool"
    )]
    ForceForSpringTool {
        /// The force in the recipe, N.
        found_n: f64,
    },
    /// The force in the recipe, with the tool's tolerance and the weight of its payload, exceeds the maximum force of
    /// the tool.
    #[error(
        "[path] force_n = {found_n} of the recipe is too high: with the tool's force tolerance of {band_n} N and the weight of \
         its payload, {} N, it exceeds [tool] max_force_n = {max_force_n}. Lower the force",
        fixed_decimals(*weight_n, 1)
    )]
    TooMuchForce {
        /// The force in the recipe, N.
        found_n: f64,
        /// The tool's force tolerance, N.
        band_n: f64,
        /// The weight of the tool's payload, N.
        weight_n: f64,
        /// The maximum force of the tool, N.
        max_force_n: f64,
    },
}

/// Checks that the recipe contains a force if and only if the tool is compliant, and that the tool can apply this
/// force.
///
/// # Errors
/// If the force does not match the tool; the error states why.
pub fn check_force(tool: Option<&CompliantTool>, recipe: &Recipe) -> Result<(), ForceMismatch> {
    match (tool, recipe.path().force_n()) {
        (None, None) => Ok(()),
        (Some(_), None) => Err(ForceMismatch::NoForce),
        (None, Some(found_n)) => Err(ForceMismatch::ForceForSpringTool { found_n }),
        (Some(tool), Some(found_n)) => {
            // If the tool points upwards, its force must also lift its payload.
            let (band_n, weight_n, most_n) =
                (tool.band_n, SensorLoad::from(tool).weight_force_n(1.0), tool.max_force_n);
            match found_n + band_n + weight_n > most_n {
                true => Err(ForceMismatch::TooMuchForce { found_n, band_n, weight_n, max_force_n: most_n }),
                false => Ok(()),
            }
        }
    }
}

/// Returns the requirements of a recipe that this cell cannot meet, each with its key in the recipe; empty if recipe
/// and cell match. The region is compared with the size of the scanner's pictures, which is stated in the calibration
/// that the cell's file names.
pub fn unmet_demands(cell: &Cell, recipe: &Recipe, read: ReadNamed<'_>) -> Vec<UnmetRequirement> {
    let force = check_force(cell.tool().compliant(), recipe).err();
    let force = force.map(|mismatch| UnmetRequirement::new("path.force_n", mismatch.to_string()));
    let is_unknown = recipe.removal().is_some() && cell.calibration().removal.is_none();
    let removal = is_unknown.then(|| UnmetRequirement::new("removal", NO_MODEL_MESSAGE));
    let outside = picture_px(cell, read).and_then(|size_px| corner_outside_picture(recipe, size_px));
    let treat = check_margin(cell, recipe).err();
    force.into_iter().chain(removal).chain(check_feed(cell, recipe).err()).chain(treat).chain(outside).collect()
}

/// Checks that the recipe's feed is not above the cell's limit.
///
/// # Errors
/// If the feed is above the limit; the error states the key, the feed and the limit.
pub fn check_feed(cell: &Cell, recipe: &Recipe) -> Result<(), UnmetRequirement> {
    let (found, limit) = (recipe.path().feed_mm_s(), cell.limits().max_speed_mm_s());
    if found <= limit {
        return Ok(());
    }
    let [found, limit] = [found, limit].map(shortest_text);
    let message =
        format!("found {found}, but [limits] max_speed_mm_s of the cell's file is {limit}: lower the feed");
    Err(UnmetRequirement::new("path.feed_mm_s", message))
}

/// If areas around water breaks are sanded, checks that the recipe's position uncertainty of a break is not less than
/// the cell's error at the tool.
///
/// # Errors
/// If the uncertainty is less; the error states the key, the uncertainty and the cell's error.
fn check_margin(cell: &Cell, recipe: &Recipe) -> Result<(), UnmetRequirement> {
    let (treat, error_mm) = (recipe.treat(), cell.limits().tool_error_mm());
    let beyond_mm = error_mm.filter(|error_mm| treat.by() == TreatBy::Break && *error_mm > treat.uncertainty_mm());
    let Some(error_mm) = beyond_mm else { return Ok(()) };
    let [found, error] = [treat.uncertainty_mm(), error_mm].map(shortest_text);
    let message = format!(
        "found {found}, but [limits] tool_error_mm of the cell's file is {error}: set at least this uncertainty, and \
         a margin_mm that includes it"
    );
    Err(UnmetRequirement::new("treat.uncertainty_mm", message))
}

/// Parses a recipe, and refuses a recipe that no cell can execute because its search box is given in metres.
///
/// # Errors
/// If the recipe has problems; the error lists them.
pub fn parse_plausible_recipe(name: &str, text: &str) -> Result<Recipe, Problems> {
    let recipe = Recipe::check(name, text)?;
    let locate = recipe.locate();
    let in_metres = check_box_unit("locate.box_max_mm", locate.box_min_mm(), locate.box_max_mm());
    match in_metres {
        None => Ok(recipe),
        Some(unmet) => Err(Problems { file: name.to_owned(), list: to_problems(text, vec![unmet]) }),
    }
}

/// Returns the size of the scanner's pictures from its calibration, px.
fn picture_px(cell: &Cell, read: ReadNamed<'_>) -> Option<[usize; 2]> {
    let file = cell.calibration().scanner.as_deref()?;
    let NamedFile::Text(text) = read(file) else { return None };
    let lens = Intrinsics::check(&file.display().to_string(), &text).ok()?;
    Some([lens.camera.width_px, lens.camera.height_px])
}

fn corner_outside_picture(recipe: &Recipe, [width_px, height_px]: [usize; 2]) -> Option<UnmetRequirement> {
    let is_outside =
        |[u, v]: &[f64; 2]| !(0.0..=width_px as f64).contains(u) || !(0.0..=height_px as f64).contains(v);
    let [u, v] = recipe.region().corners_px().into_iter().find(is_outside)?.map(shortest_text);
    let message = format!(
        "the corner ({u}, {v}) is outside of the scanner's picture of {width_px} × {height_px} px: set a \
                 corner inside"
    );
    Some(UnmetRequirement::new("region.corners_px", message))
}

#[cfg(test)]
mod tests {
    use super::super::skip_file;
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    fn keys(cell: &str, recipe: &str) -> Vec<String> {
        let cell = Cell::check("cell.toml", cell).unwrap_or_else(|problems| panic!("{problems}"));
        let region = "panel = \"p\"\n[locate]\nbox_min_mm = [0.0, 0.0, 0.0]\nbox_max_mm = [900.0, 900.0, 900.0]\n[region]\n\
                      corners_px = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]\nrows = 1\ncolumns = 1\n";
        let recipe = Recipe::check("recipe.toml", &format!("{region}{recipe}"))
            .unwrap_or_else(|problems| panic!("{problems}"));
        unmet_demands(&cell, &recipe, &skip_file).into_iter().map(|unmet| unmet.key).collect()
    }

    /// Expected values, by hand: without a limit in the cell's file, the feed limit is 250 mm/s. A corner at 12,970 px
    /// is outside of a picture with a width of 1,944 px.
    #[test]
    fn impossible_feed_region_and_box_are_reported() {
        let feed = |feed_mm_s: u32| format!("[path]\nfeed_mm_s = {feed_mm_s}\n");
        assert_eq!([keys("", &feed(250)), keys("", &feed(251))], [vec![], vec!["path.feed_mm_s".to_owned()]]);
        assert_eq!(keys("[limits]\nmax_speed_mm_s = 400\n", &feed(400)), Vec::<String>::new());
        let by_break = "[treat]\nby = \"break\"\n";
        assert_eq!(keys("[limits]\ntool_error_mm = 2.0\n", by_break), Vec::<String>::new());
        assert_eq!(keys("[limits]\ntool_error_mm = 2.1\n", by_break), ["treat.uncertainty_mm"]);
        assert_eq!(keys("[limits]\ntool_error_mm = 2.1\n", ""), Vec::<String>::new());
        let camera = PinholeCamera { width_px: 1944, height_px: 1200, ..small_camera() };
        let lens = Intrinsics::from_camera(camera).to_toml();
        let cell = Cell::check("cell.toml", "[calibration]\nscanner = \"lens.toml\"\n");
        let cell = cell.unwrap_or_else(|problems| panic!("{problems}"));
        let text = |corner: &str, high: &str| {
            format!(
                "panel = \"p\"\n[locate]\nbox_min_mm = [0.0, 0.0, 0.0]\nbox_max_mm = {high}\n[region]\n\
                 corners_px = [[0.0, 0.0], [{corner}], [9.0, 9.0], [0.0, 9.0]]\nrows = 1\ncolumns = 1\n"
            )
        };
        let reported = |corner: &str| {
            let recipe = parse_plausible_recipe("recipe.toml", &text(corner, "[900, 900, 900]"));
            let recipe = recipe.unwrap_or_else(|problems| panic!("{problems}"));
            unmet_demands(&cell, &recipe, &|_| NamedFile::Text(lens.clone()))
        };
        assert_eq!(reported("1297.0, 0.0"), []);
        let outside = reported("12970.0, 0.0");
        assert_eq!(outside.len(), 1);
        assert_eq!(
            outside[0].message,
            "the corner (12970, 0) is outside of the scanner's picture of 1944 × 1200 px: set a corner inside"
        );
        let box_of = |high: &str| parse_plausible_recipe("recipe.toml", &text("9.0, 0.0", high)).map(drop);
        assert_eq!(box_of("[170, 480, 4]"), Ok(()));
        let problems = box_of("[0.17, 0.48, 0.36]").expect_err("metres").to_string();
        let reported = "recipe.toml:4: locate.box_max_mm: found a box of 0.17 × 0.48 × 0.36 mm; are these metres? write millimetres";
        assert_eq!(problems, reported);
    }

    fn small_camera() -> PinholeCamera {
        let lens = "[camera]\nwidth_px = 20\nheight_px = 20\nfx_px = 1000.0\nfy_px = 1000.0\ncx_px = 10.0\ncy_px = 10.0\nk1 = 0\n\
                    k2 = 0\np1 = 0\np2 = 0\nk3 = 0\n";
        Intrinsics::check("lens.toml", lens).unwrap_or_else(|problems| panic!("{problems}")).camera
    }

    /// Expected values, calculated by hand: of the 100 N, the payload of 1.5 kg uses 14.7 N, and the tolerance 5 N. A
    /// force of 80.2 N is possible, 80.4 N is not.
    #[test]
    fn the_recipes_force_must_suit_the_tool() {
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
