//! The removal by a path, as a map of the unrolled region in µm.
//!
//! Depth runs from light to dark blue, which every eye distinguishes by lightness alone, up to the deepest allowed
//! depth. Deeper places are vermillion and hatched, so that they are not marked by colour alone. Places without
//! removal are white.

use super::canvas::InkColor;
use super::unrolled::{UnrolledRegion, paint_grids};
use panelprep_base::geometry::ColorPicture;
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::Region;
use panelprep_toolpath::surface::Field;

/// Colours of depth 0 and of the largest allowed depth.
const DEPTHS: [InkColor; 2] = [InkColor([222, 235, 247]), InkColor([8, 48, 107])];
const NO_REMOVAL_COLOR: InkColor = InkColor::WHITE;
const TOO_DEEP: InkColor = InkColor::VERMILLION;
const NO_PANEL_COLOR: InkColor = InkColor([225, 225, 225]);
/// Distance between the lines of the hatch, px.
const HATCH_PX: usize = 6;
/// Fractions of the target depth that the legend shows.
const LEGEND_SHARES: [f64; 5] = [0.25, 0.5, 0.75, 1.0, 1.25];

/// Draws the map, against the target and the largest allowed depth, µm.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn removal_map(
    field: &Field,
    region: &Region,
    [target_um, max_um]: [f64; 2],
) -> Result<ColorPicture, ImagingError> {
    let ink = |depth_um: f64| DEPTHS[0].mix_with(DEPTHS[1], (depth_um / max_um).min(1.0));
    let color = |grid: usize, sample: usize, (x, y): (usize, usize)| match field.grids[grid].values[sample] {
        None => NO_PANEL_COLOR,
        Some(depth_um) if depth_um <= 0.0 => NO_REMOVAL_COLOR,
        Some(depth_um) if f64::from(depth_um) > max_um => {
            if (x + y) % HATCH_PX < 2 {
                InkColor::RIM
            } else {
                TOO_DEEP
            }
        }
        Some(depth_um) => ink(f64::from(depth_um)),
    };
    let sizes: Vec<_> = field.grids.iter().map(|grid| (grid.id, grid.columns, grid.values.len())).collect();
    let unrolled = UnrolledRegion::new(field.sides_mm);
    let painted = paint_grids(&unrolled, (region, &sizes), NO_PANEL_COLOR, color);
    let shown = LEGEND_SHARES.map(|share| share * target_um).into_iter().filter(|depth_um| *depth_um < max_um);
    let words: Vec<(InkColor, String)> = shown
        .map(|depth_um| {
            let mark = if depth_um == target_um { ", the target" } else { "" };
            (ink(depth_um), format!("{} µm{mark}", fixed_decimals(depth_um, 1)))
        })
        .chain([(ink(max_um), format!("{} µm, the limit", fixed_decimals(max_um, 1)))])
        .collect();
    let mut legend: Vec<(InkColor, &str)> = words.iter().map(|(ink, text)| (*ink, text.as_str())).collect();
    legend.extend([
        (TOO_DEEP, "more than the limit (hatched)"),
        (NO_REMOVAL_COLOR, "nothing removed"),
        (NO_PANEL_COLOR, "not evaluated"),
    ]);
    unrolled.finished(&painted, (region, &sizes), &legend)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::panel::GridId;
    use panelprep_cell::recipe::Recipe;
    use panelprep_toolpath::surface::GridField;

    /// A square of 60 mm, one grid of 2 × 2 samples: 10, 30, none and 80 µm, with a target of 30 and a limit of 60.
    #[test]
    fn each_depth_has_its_colour() {
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [60, 0], [60, 60], [0, 60]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let region = Region::new(recipe.region()).expect("convex");
        let values = vec![Some(10.0), Some(30.0), None, Some(80.0)];
        let grid = GridField { id: GridId { row: 1, column: 1 }, columns: 2, values };
        let field = Field { grids: vec![grid], sides_mm: [60.0, 60.0] };
        let map = removal_map(&field, &region, [30.0, 60.0]).expect("drawn");
        // Calculated by hand: 900 px for 60 mm below the legend; the middles of the four samples.
        let top = map.height - 900;
        let at = |x: usize, y: usize| map.rgb[(top + y) * map.width + x];
        assert_eq!(at(225, 225), DEPTHS[0].mix_with(DEPTHS[1], 1.0 / 6.0).0);
        assert_eq!([at(675, 225), at(225, 675)], [DEPTHS[0].mix_with(DEPTHS[1], 0.5).0, NO_PANEL_COLOR.0]);
        let deep: Vec<_> = (670..676).map(|x| at(x, 675)).collect();
        assert!(deep.contains(&TOO_DEEP.0) && deep.contains(&InkColor::RIM.0), "hatched");
    }

    /// The colours are distinguishable by lightness alone.
    #[test]
    fn the_ramp_is_read_without_colour() {
        let light = |ink: InkColor| {
            0.2126 * f64::from(ink.0[0]) + 0.7152 * f64::from(ink.0[1]) + 0.0722 * f64::from(ink.0[2])
        };
        let at = |share: f64| light(DEPTHS[0].mix_with(DEPTHS[1], share));
        assert!((1..=4).all(|step| at(f64::from(step - 1) / 4.0) > at(f64::from(step) / 4.0) + 25.0));
    }
}
