//! The effect of a path on the surface, as maps of the unrolled region: the dwell time at each point, the number of
//! passes, and the removal in µm. Each grid is a rectangle in the region's unit square, which is scaled to the lengths
//! of the region's middle lines.
//!
//! Time and depth are shown from light to dark blue, so that they can also be read by lightness alone. The darkest blue
//! of the depth is the limit. In the maps of time and passes, points that the disc did not reach are vermillion. In the
//! map of the removal, points that are deeper than the limit are vermillion and hatched, so that they are not marked by
//! colour alone; points without removal are white.

use super::canvas::{Canvas, InkColor, PenWidth};
use panelprep_base::geometry::{ColorPicture, Pixel};
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::imaging::ImagingError;
use panelprep_cell::panel::{GridId, Region};
use panelprep_toolpath::surface::Field;
use panelprep_toolpath::surface::dwell::{Dwell, GridDwell};

const NOT_REQUESTED_COLOR: InkColor = InkColor([225, 225, 225]);
const NOT_REACHED_COLOR: InkColor = InkColor::VERMILLION;
/// Colours of the shortest and the longest dwell time.
const TIME_COLORS: [InkColor; 2] = [InkColor([222, 235, 247]), InkColor([8, 48, 107])];
/// Fractions of the longest dwell time that the legend shows.
const TIME_LEGEND_FRACTIONS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Colours of one, two, and three or more passes.
const PASS_COLORS: [InkColor; 3] = [InkColor([190, 215, 235]), InkColor([66, 133, 190]), InkColor([10, 40, 90])];

/// Draws the dwell time of the disc at each point; the longest time has the darkest colour.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn dwell_map(dwell: &Dwell, region: &Region) -> Result<ColorPicture, ImagingError> {
    let longest_s = dwell.longest_s();
    let ink = |share: f64| TIME_COLORS[0].mix_with(TIME_COLORS[1], share.min(1.0));
    let color = |grid: &GridDwell, sample: usize| match f64::from(grid.dwell_s[sample]) {
        dwell_s if dwell_s > 0.0 => ink(dwell_s / longest_s),
        _ => NOT_REACHED_COLOR,
    };
    let words = TIME_LEGEND_FRACTIONS.map(|share| format!("{:.2} s under the disc", share * longest_s));
    let mut legend: Vec<(InkColor, &str)> =
        TIME_LEGEND_FRACTIONS.iter().zip(&words).map(|(s, w)| (ink(*s), w.as_str())).collect();
    legend.extend([(NOT_REACHED_COLOR, "not reached"), (NOT_REQUESTED_COLOR, "not requested")]);
    draw_dwell(dwell, region, color, &legend)
}

/// Draws the number of passes of the disc over each point.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn overlap_map(dwell: &Dwell, region: &Region) -> Result<ColorPicture, ImagingError> {
    let color = |grid: &GridDwell, sample: usize| match grid.passes[sample] {
        0 => NOT_REACHED_COLOR,
        passes => PASS_COLORS[usize::from(passes - 1).min(PASS_COLORS.len() - 1)],
    };
    let [once, twice, more] = PASS_COLORS;
    let legend = [
        (once, "passed once"),
        (twice, "passed twice"),
        (more, "passed more often"),
        (NOT_REACHED_COLOR, "not reached"),
        (NOT_REQUESTED_COLOR, "not requested"),
    ];
    draw_dwell(dwell, region, color, &legend)
}

fn draw_dwell(
    dwell: &Dwell,
    region: &Region,
    color: impl Fn(&GridDwell, usize) -> InkColor,
    legend: &[(InkColor, &str)],
) -> Result<ColorPicture, ImagingError> {
    let unrolled = UnrolledRegion::new(dwell.sides_mm());
    let sizes: Vec<_> = dwell.grids.iter().map(|grid| (grid.id, grid.columns, grid.dwell_s.len())).collect();
    let of_sample = |number: usize, sample: usize, _| color(&dwell.grids[number], sample);
    let painted = paint_grids(&unrolled, (region, &sizes), NOT_REQUESTED_COLOR, of_sample);
    unrolled.with_grids_and_legend(&painted, (region, &sizes), legend)
}

/// Colours of depth 0 and of the limit of the depth.
const DEPTH_COLORS: [InkColor; 2] = [InkColor([222, 235, 247]), InkColor([8, 48, 107])];
const NO_REMOVAL_COLOR: InkColor = InkColor::WHITE;
const TOO_DEEP_COLOR: InkColor = InkColor::VERMILLION;
const NO_PANEL_COLOR: InkColor = InkColor([225, 225, 225]);
/// Distance between the lines of the hatch, px.
const HATCH_SPACING_PX: usize = 6;
/// Fractions of the target depth that the legend shows.
const DEPTH_LEGEND_FRACTIONS: [f64; 5] = [0.25, 0.5, 0.75, 1.0, 1.25];

/// Draws the map of the removal; the legend shows the target depth and the depth limit, µm.
///
/// # Errors
/// If OpenCV cannot draw the picture.
pub fn removal_map(
    field: &Field,
    region: &Region,
    [target_um, max_um]: [f64; 2],
) -> Result<ColorPicture, ImagingError> {
    let ink = |depth_um: f64| DEPTH_COLORS[0].mix_with(DEPTH_COLORS[1], (depth_um / max_um).min(1.0));
    let color = |grid: usize, sample: usize, (x, y): (usize, usize)| match field.grids[grid].values[sample] {
        None => NO_PANEL_COLOR,
        Some(depth_um) if depth_um <= 0.0 => NO_REMOVAL_COLOR,
        Some(depth_um) if f64::from(depth_um) > max_um => {
            if (x + y) % HATCH_SPACING_PX < 2 {
                InkColor::RIM
            } else {
                TOO_DEEP_COLOR
            }
        }
        Some(depth_um) => ink(f64::from(depth_um)),
    };
    let sizes: Vec<_> = field.grids.iter().map(|grid| (grid.id, grid.columns, grid.values.len())).collect();
    let unrolled = UnrolledRegion::new(field.sides_mm);
    let painted = paint_grids(&unrolled, (region, &sizes), NO_PANEL_COLOR, color);
    let shown =
        DEPTH_LEGEND_FRACTIONS.map(|share| share * target_um).into_iter().filter(|depth_um| *depth_um < max_um);
    let words: Vec<(InkColor, String)> = shown
        .map(|depth_um| {
            let mark = if depth_um == target_um { ", the target" } else { "" };
            (ink(depth_um), format!("{} µm{mark}", fixed_decimals(depth_um, 1)))
        })
        .chain([(ink(max_um), format!("{} µm, the limit", fixed_decimals(max_um, 1)))])
        .collect();
    let mut legend: Vec<(InkColor, &str)> = words.iter().map(|(ink, text)| (*ink, text.as_str())).collect();
    legend.extend([
        (TOO_DEEP_COLOR, "more than the limit (hatched)"),
        (NO_REMOVAL_COLOR, "nothing removed"),
        (NO_PANEL_COLOR, "not evaluated"),
    ]);
    unrolled.with_grids_and_legend(&painted, (region, &sizes), &legend)
}

/// Number of pixels along the longer side of the region.
const LONGER_SIDE_PX: usize = 900;

/// The scale and the size of the drawn region.
struct UnrolledRegion {
    px_per_mm: f64,
    size_px: [f64; 2],
}

impl UnrolledRegion {
    /// Computes the scale and the size for a region with these lengths along u and v, mm.
    fn new(sides_mm: [f64; 2]) -> Self {
        let px_per_mm = LONGER_SIDE_PX as f64 / sides_mm[0].max(sides_mm[1]).max(1.0);
        UnrolledRegion { px_per_mm, size_px: sides_mm.map(|side_mm| side_mm * px_per_mm) }
    }

    /// Adds the edges and names of these grids, a scale bar and a legend to the picture.
    fn with_grids_and_legend(
        &self,
        picture: &ColorPicture,
        (region, grids): (&Region, &[(GridId, usize, usize)]),
        legend: &[(InkColor, &str)],
    ) -> Result<ColorPicture, ImagingError> {
        let mut canvas = Canvas::from_picture(picture)?;
        let text_px = (self.size_px[1] / 40.0).max(12.0);
        for (id, ..) in grids {
            let edge = self.edge_px(region, *id);
            canvas.polyline(&edge, true, PenWidth { ink: InkColor::WHITE, width_px: 1 })?;
            let corner = Pixel::at(edge[0].u + text_px * 0.4, edge[0].v + text_px * 1.3);
            canvas.label(corner, &id.to_string(), text_px, InkColor::WHITE)?;
        }
        canvas.scale_bar_within(self.px_per_mm)?;
        canvas.with_legend(legend)?.finish()
    }

    fn edge_px(&self, region: &Region, id: GridId) -> [Pixel; 4] {
        let [low, high] = region.grid_bounds(id);
        let place = |u: f64, v: f64| Pixel::at(u * self.size_px[0], v * self.size_px[1]);
        [place(low.x, low.y), place(high.x, low.y), place(high.x, high.y), place(low.x, high.y)]
    }
}

/// Paints each pixel of these grids in the colour of its sample. Each grid is given by its name, its number of samples
/// along u, and its total number of samples.
fn paint_grids(
    unrolled: &UnrolledRegion,
    (region, grids): (&Region, &[(GridId, usize, usize)]),
    ground: InkColor,
    color: impl Fn(usize, usize, (usize, usize)) -> InkColor,
) -> ColorPicture {
    let [width, height] = unrolled.size_px.map(|size| (size as usize).max(1));
    let mut picture = ColorPicture::uniform(width, height, ground.0);
    for (number, (id, columns, samples)) in grids.iter().enumerate() {
        let [low, high] = region.grid_bounds(*id);
        let rows = samples / (*columns).max(1);
        let start = |low: f64, size: usize| (low * size as f64).round() as usize;
        let index = |at: usize, size: usize, low: f64, high: f64, count: usize| {
            let share = ((at as f64 + 0.5) / size as f64 - low) / (high - low);
            ((share * count as f64).max(0.0) as usize).min(count.saturating_sub(1))
        };
        let across = start(low.x, width)..start(high.x, width).min(width);
        let columns_of: Vec<usize> = across.clone().map(|x| index(x, width, low.x, high.x, *columns)).collect();
        for y in start(low.y, height)..start(high.y, height).min(height) {
            let row = index(y, height, low.y, high.y, rows);
            let pixels = &mut picture.rgb[y * width + across.start..y * width + across.end];
            for ((x, column), pixel) in across.clone().zip(&columns_of).zip(pixels) {
                *pixel = color(number, row * columns + column, (x, y)).0;
            }
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{KukaPose, Panel, Point};
    use panelprep_cell::recipe::Recipe;
    use panelprep_toolpath::surface::dwell::{ExecutedPose, simulate};
    use panelprep_toolpath::surface::{BSplineSurface, GridField, KnotVector};

    /// Returns a square region with sides of 60 mm and four grids. The disc, with a radius of 5 mm, moved once along
    /// the middle of the upper grids, and back over the last 15 mm of this path.
    fn simulated_dwell() -> (Dwell, Region) {
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

    /// Expected position, calculated by hand: 900 px for 60 mm are 15 px per mm. The point (20, 15) mm is therefore
    /// drawn (300, 225) px from the upper left corner below the legend.
    #[test]
    fn each_place_has_the_colour_of_its_passes() {
        let (dwell, region) = simulated_dwell();
        let map = overlap_map(&dwell, &region).expect("drawn");
        let top = map.height - 900;
        let color = |x_mm: f64, y_mm: f64| map.rgb[(top + (y_mm * 15.0) as usize) * 900 + (x_mm * 15.0) as usize];
        assert_eq!([color(20.0, 15.0), color(43.0, 15.0)], [PASS_COLORS[0].0, PASS_COLORS[1].0]);
        assert_eq!([color(20.0, 25.0), color(45.0, 45.0)], [NOT_REACHED_COLOR.0, NOT_REQUESTED_COLOR.0]);
        let map = dwell_map(&dwell, &region).expect("drawn");
        assert!(top > 5 * 12 && map.rgb.contains(&TIME_COLORS[1].0) && map.rgb.contains(&NOT_REACHED_COLOR.0));
    }

    /// The colours can be distinguished by lightness alone: each colour is darker than the previous one by a tenth of
    /// the range.
    #[test]
    fn colours_of_time_and_passes_differ_in_lightness() {
        let light = |ink: InkColor| {
            0.2126 * f64::from(ink.0[0]) + 0.7152 * f64::from(ink.0[1]) + 0.0722 * f64::from(ink.0[2])
        };
        let steps = |inks: &[InkColor]| inks.windows(2).all(|pair| light(pair[0]) > light(pair[1]) + 25.0);
        assert!(steps(&PASS_COLORS) && steps(&TIME_COLORS));
    }

    /// A square region with sides of 60 mm, and one grid of 2 × 2 samples: 10 µm, 30 µm, no value and 80 µm; the target
    /// is 30 µm and the limit 60 µm.
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
        // Expected positions, calculated by hand: the region is 900 px wide and high, below the legend; these are the
        // middles of the four samples.
        let top = map.height - 900;
        let at = |x: usize, y: usize| map.rgb[(top + y) * map.width + x];
        assert_eq!(at(225, 225), DEPTH_COLORS[0].mix_with(DEPTH_COLORS[1], 1.0 / 6.0).0);
        assert_eq!(
            [at(675, 225), at(225, 675)],
            [DEPTH_COLORS[0].mix_with(DEPTH_COLORS[1], 0.5).0, NO_PANEL_COLOR.0]
        );
        let deep: Vec<_> = (670..676).map(|x| at(x, 675)).collect();
        assert!(deep.contains(&TOO_DEEP_COLOR.0) && deep.contains(&InkColor::RIM.0), "hatched");
    }

    /// The colours of the depth can be distinguished by lightness alone.
    #[test]
    fn colours_of_depth_differ_in_lightness() {
        let light = |ink: InkColor| {
            0.2126 * f64::from(ink.0[0]) + 0.7152 * f64::from(ink.0[1]) + 0.0722 * f64::from(ink.0[2])
        };
        let at = |share: f64| light(DEPTH_COLORS[0].mix_with(DEPTH_COLORS[1], share));
        assert!((1..=4).all(|step| at(f64::from(step - 1) / 4.0) > at(f64::from(step) / 4.0) + 25.0));
    }
}
