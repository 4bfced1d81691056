//! Finds the edge of the panel in the scan beside a point of its taught outline. In a picture, an edge is a change of
//! brightness from one level to another along a short line; its position is measured to a fraction of a pixel.
//!
//! The measured depths give the approximate edge: inside of the edge the points are on the surface of the panel,
//! outside of the edge they are behind it. The colour picture gives the exact edge if the brightness of the two sides
//! differs. If a nearer object occludes the edge, none is reported.
//!
//! A 3D camera has no points where its projector does not reach. The shadow of the panel is on the background along one
//! side of its edge, and the shadow of an object in front of the panel is on the panel. Missing points beyond the
//! surface are therefore no measure of the distance to its edge. If points are missing inside of the edge, depth gives
//! no information and only the colour picture is used.
//!
//! Brightness is read at every pixel along a line; inside and outside of the edge it has the levels a and b. The edge
//! is near the position at which the brightness crosses (a + b)/2. The position of the edge is that of an ideal step
//! with the same sum of brightness:
//!     Σᵢ (b − gᵢ) / (b − a)  =  number of positions inside of the edge.                                      (1)
//! A pixel is the mean over its area, so (1) holds wherever the edge is within its pixel; the crossing is biased
//! towards the centres of the pixels. A taught and a scanned edge are evaluated in the same way, so that the effect of
//! a lens or a gamma cancels.

use super::grid::ColoredCloud;
use nalgebra::{Vector2, Vector3};
use panelprep_base::geometry::{Frame, OrganizedCloud, PinholeCamera, Pixel};

/// Maximum distance between a point of the surface and the tangent plane of the surface, mm.
/// `MAX_SURFACE_DISTANCE_MM_PER_PX` is added for each px of distance from the edge.
const MAX_SURFACE_DISTANCE_MM: f64 = 1.5;
const MAX_SURFACE_DISTANCE_MM_PER_PX: f64 = 0.15;
/// Lower limit of the cosine of the angle between view and normal: a more slanted surface is treated as if it had this
/// slant.
const MIN_INCIDENCE_COSINE: f64 = 0.3;
/// Number of pixels just inside of an edge that are examined; `MIN_INSIDE_PIXELS` of them must be on the surface.
const INSIDE_PIXEL_COUNT: i32 = 6;
const MIN_INSIDE_PIXELS: usize = 3;
/// Maximum distance between the edge by colour and the edge by depth, px.
const MAX_COLOUR_DEPTH_DISTANCE_PX: f64 = 2.6;
/// Maximum width of the strip of missing points that an edge causes, px; a wider strip is a shadow.
const MAX_RIM_PX: i32 = 3;
/// Maximum gap between the depths on the surface and behind it that still determines the edge, px; with a larger gap
/// colour must show the edge.
const MAX_GAP_PX: i32 = 8;

/// The result of the search for the edge beside a point of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum EdgeReading {
    /// The edge was found by colour, at this distance outwards from the point and with this width of its step, px.
    Colour { offset_px: f64, width_px: f64 },
    /// The edge was found only by depth.
    Depth { offset_px: f64 },
    /// A nearer object hides the edge, or the surface faces away from the camera.
    Hidden,
    /// The edge lies outside of the picture.
    OutOfView,
    /// The surface continues beyond the outline, or is missing.
    Absent,
}

impl EdgeReading {
    /// Returns whether the edge is within this distance of its expected position, px; `None` if the position was not
    /// visible.
    pub fn is_within_distance(self, most_px: f64) -> Option<bool> {
        match self {
            EdgeReading::Colour { offset_px, .. } | EdgeReading::Depth { offset_px } => {
                Some(offset_px.abs() <= most_px)
            }
            EdgeReading::Absent => Some(false),
            EdgeReading::Hidden | EdgeReading::OutOfView => None,
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum DepthClass {
    On,
    Farther,
    Nearer,
    Missing,
}

/// The tangent plane of the surface at a point, as it appears in the picture: its inverse depth is linear in the
/// pixels.
pub(super) struct Tangent {
    at: Pixel,
    inverse: f64,
    /// Gradient of the inverse depth in the picture, per mm and px.
    slope: Vector2<f64>,
    /// Cosine of the angle between the view and the normal of the surface, 0…1.
    incidence_cosine: f64,
}

impl Tangent {
    pub fn new(camera: &PinholeCamera, at: Pixel, point: &Vector3<f64>, normal: &Vector3<f64>) -> Tangent {
        let distance = normal.dot(point);
        Tangent {
            at,
            inverse: 1.0 / point.z,
            slope: Vector2::new(normal.x / (camera.fx_px * distance), normal.y / (camera.fy_px * distance)),
            incidence_cosine: (distance.abs() / point.norm()).max(MIN_INCIDENCE_COSINE),
        }
    }

    /// Returns the distance of a measured depth at a pixel behind the plane, along the normal of the plane, mm.
    pub fn depth_behind_mm(&self, column: usize, row: usize, depth_mm: f64) -> f64 {
        let way = Vector2::new(column as f64 - self.at.u, row as f64 - self.at.v);
        let plane_mm = 1.0 / (self.inverse + self.slope.dot(&way));
        self.incidence_cosine * (depth_mm - plane_mm)
    }
}

/// Finds the edge beside a position in a picture; the surface there has this point and normal, in the camera frame.
/// `across` points away from the panel.
pub(super) fn find_edge(
    camera: &PinholeCamera,
    scan: &ColoredCloud,
    (pixel, across): (Pixel, Vector2<f64>),
    (point, normal): (&Vector3<f64>, &Vector3<f64>),
) -> EdgeReading {
    edge(scan, (pixel, across), &Tangent::new(camera, pixel, point, normal), true)
}

pub(super) fn edge(
    scan: &ColoredCloud,
    (pixel, across): (Pixel, Vector2<f64>),
    tangent: &Tangent,
    is_patchy: bool,
) -> EdgeReading {
    let reach = HALF_LENGTH_PX as i32;
    // The whole line must be in the picture: half of a line could show only one side of the edge.
    let margin = f64::from(reach) + 1.0;
    let (width, height) = (scan.width() as f64, scan.height() as f64);
    let inside = pixel.u >= margin && pixel.v >= margin && pixel.u < width - margin && pixel.v < height - margin;
    if !inside {
        return EdgeReading::OutOfView;
    }
    let depth = |offset: i32| {
        let way = f64::from(offset);
        let (u, v) = (pixel.u + way * across.x, pixel.v + way * across.y);
        let (column, row) = (u.round() as usize, v.round() as usize);
        let [_, _, z] = scan.raw_points_mm()[row * scan.width() + column];
        let away = tangent.depth_behind_mm(column, row, f64::from(z));
        if z.is_nan() {
            DepthClass::Missing
        } else if away.abs() <= MAX_SURFACE_DISTANCE_MM + MAX_SURFACE_DISTANCE_MM_PER_PX * way.abs() {
            DepthClass::On
        } else if away > 0.0 {
            DepthClass::Farther
        } else {
            DepthClass::Nearer
        }
    };
    let depths: Vec<DepthClass> = (-reach..=reach).map(depth).collect();
    let (rough_px, known) = match find_depth_edge(&depths) {
        DepthEdge::At(offset_px) => (offset_px, true),
        DepthEdge::Near(offset_px) => (offset_px, false),
        DepthEdge::Not(edge) => return edge,
    };
    let line = line(scan, pixel, [across.x, across.y]);
    let near = |expected_px: f64| {
        let step = step(line.as_ref()?, expected_px)?;
        // A step farther away is paint, a shadow or another object, even if it is the strongest step.
        ((step.offset_px - expected_px).abs() <= MAX_COLOUR_DEPTH_DISTANCE_PX).then_some(step)
    };
    match near(rough_px).or_else(|| if is_patchy { strongest_step(&depths, near) } else { None }) {
        Some(step) => EdgeReading::Colour { offset_px: step.offset_px, width_px: step.width_px },
        None if known => EdgeReading::Depth { offset_px: rough_px },
        None => EdgeReading::Absent,
    }
}

/// Returns the strongest step of brightness if the gap of missing points is wider than a rim. Points of the panel may
/// be among the missing ones, so the edge is anywhere between the last point on the surface and the first point behind
/// it.
fn strongest_step(depths: &[DepthClass], near: impl Fn(f64) -> Option<BrightnessStep>) -> Option<BrightnessStep> {
    let middle = depths.len() as i32 / 2;
    let missing = |i: &i32| depths.get(*i as usize) == Some(&DepthClass::Missing);
    let before = (0..middle).rev().take_while(missing).last().unwrap_or(middle);
    let beyond = (middle..depths.len() as i32).take_while(missing).last().unwrap_or(middle - 1);
    if beyond - before < MAX_GAP_PX {
        return None;
    }
    let steps = (before..=beyond).step_by(2).filter_map(|i| near(f64::from(i - middle)));
    steps.max_by(|a, b| a.contrast.abs().total_cmp(&b.contrast.abs()))
}

/// The edge according to the depths, px from the middle of the line outwards.
#[derive(Debug, Clone, Copy, PartialEq)]
enum DepthEdge {
    At(f64),
    /// A position near which colour must show the edge, if there is one.
    Near(f64),
    /// No edge is searched by colour; the value is the result.
    Not(EdgeReading),
}

fn find_depth_edge(depths: &[DepthClass]) -> DepthEdge {
    let count = depths.len() as i32;
    let at = |i: i32| depths.get(i as usize).copied().unwrap_or(DepthClass::Missing);
    // A single flying point is not the end of the surface: two of the three following points must be of the same kind.
    let ends = |i: i32, what: DepthClass| at(i) == what && (i + 1..i + 4).filter(|&j| at(j) == what).count() >= 2;
    let farther = (0..count).find(|&i| ends(i, DepthClass::Farther));
    let nearer = (0..count).find(|&i| ends(i, DepthClass::Nearer));
    // If a nearer object begins before the surface ends, the edge may be behind this object.
    let hidden = nearer.is_some_and(|near| farther.is_none_or(|far| near < far));
    if hidden {
        return DepthEdge::Not(EdgeReading::Hidden);
    }
    let middle = count / 2;
    let unlit =
        (middle - INSIDE_PIXEL_COUNT..middle).filter(|&i| at(i) == DepthClass::Missing).count() > MIN_INSIDE_PIXELS;
    let surface_ends = farther.unwrap_or(count);
    let last_on = (0..surface_ends).rev().find(|&i| at(i) == DepthClass::On);
    let on =
        |last: i32| (last - INSIDE_PIXEL_COUNT + 1..=last).filter(|&i| i >= 0 && at(i) == DepthClass::On).count();
    let Some(last_on) = last_on.filter(|&last| on(last) >= MIN_INSIDE_PIXELS) else {
        return if unlit { DepthEdge::Near(0.0) } else { DepthEdge::Not(EdgeReading::Absent) };
    };
    // If no point was measured beyond, there is a shadow, an empty hall, or black objects; otherwise the surface
    // continues.
    if farther.is_none() && last_on >= count - 4 {
        return DepthEdge::Not(EdgeReading::Absent);
    }
    let open = farther.map_or(2, |far| far - last_on);
    // At an edge points are missing on both sides of it, so the edge is in the middle of the gap; of a wide gap only
    // the width of a rim is used.
    let rough_px = f64::from(last_on - middle) + f64::from(open.min(MAX_RIM_PX)) / 2.0;
    if open <= MAX_GAP_PX { DepthEdge::At(rough_px) } else { DepthEdge::Near(rough_px) }
}

/// Number of positions on a line to each side of its middle, px.
pub(super) const HALF_LENGTH_PX: usize = 12;
/// Number of positions on a line.
pub(super) const POSITION_COUNT: usize = 2 * HALF_LENGTH_PX + 1;
/// Minimum (`LEVEL_FROM_PX`) and maximum (`LEVEL_TO_PX`) distance from the edge at which the levels of both sides are
/// read, px.
const LEVEL_FROM_PX: f64 = 2.5;
const LEVEL_TO_PX: f64 = 6.0;
/// Maximum distance of the edge from its expected position, px.
const SEARCH_REACH_PX: f64 = 3.0;
/// Distance to each side of the crossing over which the sum of (1) extends, px.
const SUM_REACH_PX: f64 = 1.6;
/// Maximum difference between the position by (1) and the crossing, px.
const MAX_SUM_DIFFERENCE_PX: f64 = 0.5;
/// Minimum difference between the levels of the two sides, grey levels.
const MIN_CONTRAST: f64 = 14.0;
/// Maximum variation of the brightness that determines a level, grey levels. `MAX_RELATIVE_LEVEL_VARIATION` is the
/// limit as a fraction of the contrast; the larger of both limits applies.
const MAX_LEVEL_VARIATION: f64 = 10.0;
const MAX_RELATIVE_LEVEL_VARIATION: f64 = 0.1;

/// Brightness at the positions along a line, from the inside outwards.
pub(super) type BrightnessLine = [f64; POSITION_COUNT];

/// A step of brightness on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BrightnessStep {
    /// Distance of the step from the middle of the line outwards, px.
    pub offset_px: f64,
    /// Level outside minus level inside, grey levels.
    pub contrast: f64,
    /// Width of the step, from its contrast and its slope, px.
    pub width_px: f64,
}

/// Returns the brightness of a pixel of a scan, grey levels.
pub(super) fn pixel_gray<F: Frame>(scan: &OrganizedCloud<F>, column: usize, row: usize) -> f64 {
    let [r, g, b] = scan.color_at(row * scan.width() + column);
    0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)
}

/// Interpolates the brightness of a scan's colours between pixels; `None` outside of the picture.
pub(super) fn brightness<F: Frame>(scan: &OrganizedCloud<F>, pixel: Pixel) -> Option<f64> {
    let (u, v) = (pixel.u, pixel.v);
    if !(u >= 0.0 && v >= 0.0 && u < (scan.width() - 1) as f64 && v < (scan.height() - 1) as f64) {
        return None;
    }
    let (column, row) = (u as usize, v as usize);
    let (across, down) = (u - column as f64, v - row as f64);
    let at = |column: usize, row: usize| pixel_gray(scan, column, row);
    let above = at(column, row) + across * (at(column + 1, row) - at(column, row));
    let below = at(column, row + 1) + across * (at(column + 1, row + 1) - at(column, row + 1));
    Some(above + down * (below - above))
}

/// Returns the brightness along the line through a pixel; `outward` is a unit vector of the picture.
pub(super) fn line<F: Frame>(scan: &OrganizedCloud<F>, middle: Pixel, outward: [f64; 2]) -> Option<BrightnessLine> {
    let mut line = [0.0; POSITION_COUNT];
    for (index, value) in line.iter_mut().enumerate() {
        let way = index as f64 - HALF_LENGTH_PX as f64;
        *value = brightness(scan, Pixel::at(middle.u + way * outward[0], middle.v + way * outward[1]))?;
    }
    Some(line)
}

/// Finds the step near a position of a line; `None` if the two sides are too similar.
pub(super) fn step(line: &BrightnessLine, expected_px: f64) -> Option<BrightnessStep> {
    let first = find_single_step(line, expected_px)?;
    // The levels are read again around the measured edge, instead of its expected position.
    find_single_step(line, first.offset_px).or(Some(first))
}

fn find_single_step(line: &BrightnessLine, expected_px: f64) -> Option<BrightnessStep> {
    let level = |from: f64, to: f64| {
        let places = (0..POSITION_COUNT)
            .filter(|&i| (from..=to).contains(&(i as f64 - HALF_LENGTH_PX as f64 - expected_px)));
        let start = (0usize, 0.0, f64::MAX, f64::MIN);
        let (count, sum, low, high) = places.fold(start, |(count, sum, low, high), i| {
            (count + 1, sum + line[i], low.min(line[i]), high.max(line[i]))
        });
        (count >= 2).then(|| (sum / count as f64, high - low))
    };
    let ((inside, uneven_inside), (outside, uneven_outside)) =
        (level(-LEVEL_TO_PX, -LEVEL_FROM_PX)?, level(LEVEL_FROM_PX, LEVEL_TO_PX)?);
    let contrast = outside - inside;
    // The level cannot be determined beside another edge, for example of a post behind the panel.
    let uneven =
        uneven_inside.max(uneven_outside) > MAX_LEVEL_VARIATION.max(MAX_RELATIVE_LEVEL_VARIATION * contrast.abs());
    if contrast.abs() < MIN_CONTRAST || uneven {
        return None;
    }
    let middle = (inside + outside) / 2.0;
    let crossing = |i: usize| {
        let (a, b) = ((line[i] - middle) * contrast.signum(), (line[i + 1] - middle) * contrast.signum());
        (a < 0.0 && b >= 0.0).then(|| (i as f64 - HALF_LENGTH_PX as f64 + a / (a - b), b - a))
    };
    let away = |offset: f64| (offset - expected_px).abs();
    let (crossed, slope) = (0..POSITION_COUNT - 1)
        .filter_map(crossing)
        .filter(|(offset, _)| away(*offset) <= SEARCH_REACH_PX)
        .min_by(|a, b| away(a.0).total_cmp(&away(b.0)))?;
    let first = ((crossed - SUM_REACH_PX).floor() as i64 + HALF_LENGTH_PX as i64).max(0) as usize;
    let last = ((crossed + SUM_REACH_PX).ceil() as i64 + HALF_LENGTH_PX as i64).clamp(0, POSITION_COUNT as i64 - 1)
        as usize;
    let inside_places: f64 = line[first..=last].iter().map(|gray| (outside - gray) / contrast).sum(); // (1)
    let offset_px = first as f64 - 0.5 + inside_places - HALF_LENGTH_PX as f64;
    // With a larger difference, the sum contains a spot beside the edge.
    ((offset_px - crossed).abs() < MAX_SUM_DIFFERENCE_PX).then(|| BrightnessStep {
        offset_px,
        contrast,
        width_px: contrast.abs() / slope,
    })
}

/// Returns the unit vector in the picture that is perpendicular to the direction of an outline and points outwards.
pub(super) fn outward_px(
    along: &nalgebra::Vector2<f64>,
    outward: &nalgebra::Vector2<f64>,
) -> Option<nalgebra::Vector2<f64>> {
    let across = nalgebra::Vector2::new(along.y, -along.x).try_normalize(1e-9)?;
    Some(if across.dot(outward) < 0.0 { -across } else { across })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depths(text: &str) -> Vec<DepthClass> {
        text.chars()
            .map(|sign| match sign {
                'o' => DepthClass::On,
                'f' => DepthClass::Farther,
                'n' => DepthClass::Nearer,
                _ => DepthClass::Missing,
            })
            .collect()
    }

    /// Expected values, calculated by hand, with the middle at index 8: the surface ends at 9 and the plate begins at
    /// 12, so the edge is at 10.5, which is 2.5 px outside. A single flying point between them has no effect.
    #[test]
    fn depths_state_where_the_surface_ends() {
        let rough = |text: &str| find_depth_edge(&depths(text));
        assert_eq!(rough("oooooooooo--fffff"), DepthEdge::At(2.5));
        assert_eq!(rough("ooooofoooo--fffff"), DepthEdge::At(2.5), "a flying point");
        assert_eq!(rough("oooooooooo-------"), DepthEdge::At(2.0), "a wide shadow, or the hall");
        assert_eq!(rough("ooooooo-nnnnnnfff"), DepthEdge::Not(EdgeReading::Hidden), "something before it");
        assert_eq!(rough("ooooooooooooooooo"), DepthEdge::Not(EdgeReading::Absent), "it continues");
        assert_eq!(rough("fffffffffffffffff"), DepthEdge::Not(EdgeReading::Absent), "it is not there");
    }

    /// Expected values, calculated by hand: beyond the last point on the surface, at position 5, there is a shadow of 6
    /// px. The edge is at the near end of the shadow, 5 + 1.5, and not in its middle. If the shadow is so wide that it
    /// may also contain missing points of the panel, colour must show the edge. The same applies if the panel itself is
    /// in a shadow.
    #[test]
    fn missing_points_do_not_determine_the_edge() {
        let rough = |text: &str| find_depth_edge(&depths(text));
        assert_eq!(rough("oooooo------fffff"), DepthEdge::At(-1.5));
        assert_eq!(rough("oooooo---------ff"), DepthEdge::At(-2.0), "two points are no plate");
        assert_eq!(rough("oooo----------fff"), DepthEdge::Near(-3.5));
        assert_eq!(rough("---------ffffffff"), DepthEdge::Near(0.0), "the panel is in shadow, the plate is not");
        assert_eq!(rough("-----------------"), DepthEdge::Near(0.0), "both are");
        assert_eq!(
            rough("-----fffffffffff-"),
            DepthEdge::Not(EdgeReading::Absent),
            "the plate where the panel should be"
        );
    }

    /// Expected values, calculated by hand: 70 levels inside, 180 outside. The pixel at +2 shows the panel on a quarter
    /// of its area, so the edge is at 1.5 + 0.25. The crossing would be at 1 + 55/82.5.
    #[test]
    fn the_edge_is_located_within_a_mixed_pixel() {
        let line: BrightnessLine = std::array::from_fn(|i| match i as i64 - HALF_LENGTH_PX as i64 {
            ..2 => 70.0,
            2 => 70.0 + 110.0 * 0.75,
            _ => 180.0,
        });
        let found = step(&line, 0.0).expect("a step");
        assert!((found.offset_px - 1.75).abs() < 1e-9 && (found.contrast - 110.0).abs() < 1e-9);
        assert!((found.width_px - 110.0 / 82.5).abs() < 1e-9);
        assert_eq!(step(&line, 6.0), None, "both sides are outside");
        assert_eq!(step(&line.map(|gray| gray / 10.0), 0.0), None, "eleven levels are noise");
        let mut post = line;
        post[HALF_LENGTH_PX + 5..].fill(150.0);
        assert_eq!(step(&post, 0.0), None, "a second edge four pixels away");
    }
}
