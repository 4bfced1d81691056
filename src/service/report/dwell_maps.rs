//! The effect of the disc on the surface, as maps of the unrolled region: how long, and how often.
//!
//! Time runs from light to dark blue, which every eye distinguishes by lightness alone; places that were not
//! reached are vermillion.

use super::canvas::InkColor;
use super::unrolled::{UnrolledRegion, paint_grids};
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::Region;
use panelprep_toolpath::surface::dwell::{Dwell, GridDwell};

const UNREQUESTED_COLOR: InkColor = InkColor([225, 225, 225]);
const UNREACHED_COLOR: InkColor = InkColor::VERMILLION;
/// Colours of the shortest and the longest time.
const TIME_COLORS: [InkColor; 2] = [InkColor([222, 235, 247]), InkColor([8, 48, 107])];
/// Fractions of the longest time that the legend shows.
const LEGEND_SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Colours for one, two and more passes.
const PASSES: [InkColor; 3] = [InkColor([190, 215, 235]), InkColor([66, 133, 190]), InkColor([10, 40, 90])];

/// Draws how long each place was under the disc; darkest at the longest time.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn dwell_map(dwell: &Dwell, region: &Region) -> Result<ColorPicture, ImagingError> {
    let longest_s = dwell.longest_s();
    let ink = |share: f64| TIME_COLORS[0].mix_with(TIME_COLORS[1], share.min(1.0));
    let color = |grid: &GridDwell, sample: usize| match f64::from(grid.dwell_s[sample]) {
        dwell_s if dwell_s > 0.0 => ink(dwell_s / longest_s),
        _ => UNREACHED_COLOR,
    };
    let words = LEGEND_SHARES.map(|share| format!("{:.2} s under the disc", share * longest_s));
    let mut legend: Vec<(InkColor, &str)> =
        LEGEND_SHARES.iter().zip(&words).map(|(s, w)| (ink(*s), w.as_str())).collect();
    legend.extend([(UNREACHED_COLOR, "not reached"), (UNREQUESTED_COLOR, "not requested")]);
    draw_map(dwell, region, color, &legend)
}

/// Draws how often the disc passed each place.
///
/// # Errors
/// If OpenCV refuses to draw.
pub fn overlap_map(dwell: &Dwell, region: &Region) -> Result<ColorPicture, ImagingError> {
    let color = |grid: &GridDwell, sample: usize| match grid.passes[sample] {
        0 => UNREACHED_COLOR,
        passes => PASSES[usize::from(passes - 1).min(PASSES.len() - 1)],
    };
    let [once, twice, more] = PASSES;
    let legend = [
        (once, "passed once"),
        (twice, "passed twice"),
        (more, "passed more often"),
        (UNREACHED_COLOR, "not reached"),
        (UNREQUESTED_COLOR, "not requested"),
    ];
    draw_map(dwell, region, color, &legend)
}

fn draw_map(
    dwell: &Dwell,
    region: &Region,
    color: impl Fn(&GridDwell, usize) -> InkColor,
    legend: &[(InkColor, &str)],
) -> Result<ColorPicture, ImagingError> {
    let unrolled = UnrolledRegion::new(dwell.sides_mm());
    let sizes: Vec<_> = dwell.grids.iter().map(|grid| (grid.id, grid.columns, grid.dwell_s.len())).collect();
    let of_sample = |number: usize, sample: usize, _| color(&dwell.grids[number], sample);
    let painted = paint_grids(&unrolled, (region, &sizes), UNREQUESTED_COLOR, of_sample);
    unrolled.finished(&painted, (region, &sizes), legend)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{KukaPose, Panel, Point};
    use panelprep_cell::panel::GridId;
    use panelprep_toolpath::surface::dwell::{ExecutedPose, simulate};
    use panelprep_toolpath::surface::{BSplineSurface, KnotVector};

    /// A square region of 60 mm with four grids. The disc of 5 mm radius moved once along the middle of the upper
    /// grids, and back over the last third of that path.
    fn walked() -> (Dwell, Region) {
        let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("knots");
        let controls = [(0.0, 0.0), (0.0, 60.0), (60.0, 0.0), (60.0, 60.0)].map(|(x, y)| Point::at(x, y, 0.0));
        let viewer: Point<Panel> = Point::at(30.0, 30.0, 500.0);
        let surface = BSplineSurface::new([knots(), knots()], controls.to_vec(), viewer).expect("a surface");
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [60, 0], [60, 60], [0, 60]]\nrows = 2\n\
             columns = 2\n[locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = panelprep_cell::recipe::Recipe::check("test.toml", text).unwrap_or_else(|e| panic!("{e}"));
        let region = Region::new(recipe.region()).expect("convex");
        let at = |x: f64| ExecutedPose {
            panel_from_tool: KukaPose { x_mm: x, y_mm: 15.0, c_deg: 180.0, ..KukaPose::default() }.to_rigid(),
            seconds: 2.0,
            contact: true,
            force_n: None,
        };
        let grids: Vec<GridId> = region.ids().filter(|id| id.to_string() != "r2c2").collect();
        (simulate(&surface, &region, &grids, &[at(5.0), at(55.0), at(40.0)], 5.0), region)
    }

    /// Calculated by hand: 900 px for 60 mm are 15 px per mm, so (20, 15) mm lies at (300, 225) px below the
    /// legend.
    #[test]
    fn each_place_has_the_colour_of_its_passes() {
        let (dwell, region) = walked();
        let map = overlap_map(&dwell, &region).expect("drawn");
        let top = map.height - 900;
        let color = |x_mm: f64, y_mm: f64| map.rgb[(top + (y_mm * 15.0) as usize) * 900 + (x_mm * 15.0) as usize];
        assert_eq!([color(20.0, 15.0), color(43.0, 15.0)], [PASSES[0].0, PASSES[1].0]);
        assert_eq!([color(20.0, 25.0), color(45.0, 45.0)], [UNREACHED_COLOR.0, UNREQUESTED_COLOR.0]);
        let map = dwell_map(&dwell, &region).expect("drawn");
        assert!(top > 5 * 12 && map.rgb.contains(&TIME_COLORS[1].0) && map.rgb.contains(&UNREACHED_COLOR.0));
    }

    /// The colours are distinguishable by lightness alone: each step of both ramps is darker than the one before by a
    /// tenth of the range.
    #[test]
    fn the_ramps_are_read_without_colour() {
        let light = |ink: InkColor| {
            0.2126 * f64::from(ink.0[0]) + 0.7152 * f64::from(ink.0[1]) + 0.0722 * f64::from(ink.0[2])
        };
        let steps = |inks: &[InkColor]| inks.windows(2).all(|pair| light(pair[0]) > light(pair[1]) + 25.0);
        assert!(steps(&PASSES) && steps(&TIME_COLORS));
    }
}
