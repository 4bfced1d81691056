//! Detects the panel's corner in a picture of the flange camera (thesis 3.9, Fig. 3.17).
//!
//! As in the thesis: bilateral filter (Fig. 3.18), threshold (Fig. 3.19), the largest contour, the smallest box around
//! it (Fig. 3.20), and the contour point nearest to the corner of the box (Fig. 3.21). Two details differ from the
//! thesis. First, a direction states which corner of the box is meant, since the order of the corners from
//! `minAreaRect` jumps as the box rotates. Second, the result is the intersection of the two extended edges beside this
//! contour point. A single pixel on a rounded corner is a poor measurement; two lines through hundreds of sub-pixel
//! points are a good one. Lens distortion and the curvature of the panel bend the edges by a fraction of a pixel over
//! the fitted length. The edges at teaching and now are bent in the same way, because they are seen from nearly the
//! same position; this bend is not corrected. This module does not know the expected position of the corner: see
//! `refine`.
//!
//! A straight edge is measured to a fraction of a pixel. A line through contour pixels gives its approximate position.
//! At every pixel along this line, the grey level of the unfiltered picture is read across the edge, from the panel's
//! side to the other. The edge point is the position at which the grey level crosses the mean of the levels of both
//! sides. A robust line is fitted to these edge points; then the grey levels are read once more across this line.
//!
//! If a picture shows no corner, the error is a text for the person who set the recipe.

use nalgebra::{Matrix2, Vector2};
use panelprep_base::geometry::{FlangeCamera, GrayPicture, Mask, PinholeCamera, Pixel, Point, median, polygon};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::imaging::{ImagingError, bilateral_filter, min_area_box, outer_contours};
use panelprep_cell::recipe;
use panelprep_cell::recipe::CornerName;

/// Minimum fraction of the picture that the contour of the panel encloses.
const MIN_PICTURE_FRACTION: f64 = 0.02;
/// Minimum distance between a contour point of the panel and the border of the picture, px; nearer points belong to the
/// border.
const MIN_BORDER_DISTANCE_PX: f64 = 3.0;
/// Minimum angle between two edges that determine a corner, degrees.
const MIN_ANGLE_DEG: f64 = 20.0;

/// A detected corner, with the intermediate results of its detection.
#[derive(Debug, Clone, PartialEq)]
pub struct CornerFound {
    /// The corner: the intersection of the two edges.
    pub corner_px: Pixel,
    /// The contour point nearest to the corner of the box, which the thesis uses as the corner.
    pub nearest_px: Pixel,
    /// The contour of the panel, pixel by pixel.
    pub contour: Vec<Pixel>,
    /// The corners of the smallest box around the contour.
    pub box_px: [Pixel; 4],
    /// The two edges that meet in the corner.
    pub edges: [EdgeLine; 2],
}

/// Finds the corner of the panel in this direction. `px_per_mm` is the scale of the picture at the corner: focal length
/// divided by depth.
///
/// # Errors
/// If the picture shows no corner of the panel; each error states the remedy.
pub fn find(
    picture: &GrayPicture,
    settings: &recipe::Corner,
    which: CornerName,
    px_per_mm: f64,
) -> Result<CornerFound, CornerError> {
    // The filter preserves edges for the segmentation. The edges are fitted on the unfiltered picture below, since a
    // filter shifts them by fractions of a pixel.
    let filtered = bilateral_filter(picture, settings.bilateral_diameter_px(), settings.bilateral_sigma_gray())?;
    let contour = panel_contour(&filtered, settings)?;
    let box_px = min_area_box(&contour)?;
    let nearest = nearest_contour_index(&contour, named_box_corner(&box_px, which));
    let nearest_px = contour[nearest];
    let inside = |pixel: Pixel| {
        let (right, bottom) = (picture.width as f64 - 1.0, picture.height as f64 - 1.0);
        pixel.u.min(pixel.v).min(right - pixel.u).min(bottom - pixel.v) > MIN_BORDER_DISTANCE_PX
    };
    if !inside(nearest_px) {
        return Err(CornerError::CornerAtBorder { u: nearest_px.u, v: nearest_px.v });
    }
    let length =
        EdgeStretch { skip_px: settings.rounding_mm() * px_per_mm, fit_px: settings.edge_mm() * px_per_mm };
    let fitted = |start: usize, step: isize| {
        let along =
            walk_contour(&contour, start, step).take_while(|&(_, way_px)| way_px <= length.skip_px + length.fit_px);
        // Points on the border of the picture follow the border and not the panel.
        let beside = along.filter(|&(pixel, way_px)| way_px >= length.skip_px && inside(pixel));
        fit_edge(picture, &beside.map(|(pixel, _)| pixel).collect::<Vec<_>>(), length)
    };
    let edges_from =
        |start: usize| -> Result<[EdgeLine; 2], CornerError> { Ok([fitted(start, 1)?, fitted(start, -1)?]) };
    // If the panel is rotated in the picture, the thesis's corner point is not in the middle of the rounding: a first
    // intersection of the edges gives the middle.
    let rough = edges_from(nearest)?;
    let rough_px = intersect_edges(&rough[0], &rough[1], MIN_ANGLE_DEG)?;
    let edges = edges_from(nearest_contour_index(&contour, rough_px))?;
    let corner_px = intersect_edges(&edges[0], &edges[1], MIN_ANGLE_DEG)?;
    if !inside(corner_px) {
        return Err(CornerError::CornerAtBorder { u: corner_px.u, v: corner_px.v });
    }
    Ok(CornerFound { corner_px, nearest_px, contour, box_px, edges })
}

/// Finds the taught corner with this index. `expected` is its expected position in the camera frame; its distance gives
/// the scale.
///
/// # Errors
/// If the picture shows no corner of the panel; each error states the remedy.
pub fn find_taught(
    picture: &GrayPicture,
    (settings, corner): (&recipe::Corner, usize),
    camera: &PinholeCamera,
    expected: Point<FlangeCamera>,
) -> Result<CornerFound, CornerError> {
    find(picture, settings, settings.which().for_picture(corner), camera.px_per_mm_at(expected.mm.z).0)
}

fn panel_contour(filtered: &GrayPicture, settings: &recipe::Corner) -> Result<Vec<Pixel>, CornerError> {
    let (min, max) = (settings.panel_gray_min(), settings.panel_gray_max());
    let inside = filtered.gray.iter().map(|&gray| (min..=max).contains(&usize::from(gray))).collect();
    let mask = Mask { width: filtered.width, height: filtered.height, inside };
    // The largest contour is the panel: smaller ones are reflections and labels with the same grey levels.
    let contour = outer_contours(&mask)?.into_iter().next().ok_or(CornerError::NoContour { min, max })?;
    let share = polygon::signed_area_px2(&contour).abs() / (mask.width * mask.height) as f64;
    if share < MIN_PICTURE_FRACTION {
        let (found_percent, needed_percent) = (100.0 * share, 100.0 * MIN_PICTURE_FRACTION);
        return Err(CornerError::ContourTooSmall { found_percent, needed_percent });
    }
    Ok(contour)
}

/// Returns the corner of the box that is farthest in the taught direction; correct for boxes rotated by up to 45°.
fn named_box_corner(box_px: &[Pixel; 4], which: CornerName) -> Pixel {
    let (right, down) = match which {
        CornerName::TopLeft => (-1.0, -1.0),
        CornerName::TopRight => (1.0, -1.0),
        CornerName::BottomRight => (1.0, 1.0),
        CornerName::BottomLeft => (-1.0, 1.0),
    };
    let far = |pixel: &Pixel| right * pixel.u + down * pixel.v;
    box_px.iter().copied().fold(box_px[0], |best, corner| if far(&corner) > far(&best) { corner } else { best })
}

fn nearest_contour_index(contour: &[Pixel], corner: Pixel) -> usize {
    let distance = |index: &usize| contour[*index].distance_px(corner);
    (0..contour.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or_default()
}

/// Iterates over the contour once from one of its points, forwards (`step` 1) or backwards (−1). Returns each point
/// with its distance along the contour, px.
fn walk_contour(contour: &[Pixel], start: usize, step: isize) -> impl Iterator<Item = (Pixel, f64)> + '_ {
    let count = contour.len() as isize;
    let at = move |i: isize| contour[(start as isize + i * step).rem_euclid(count) as usize];
    (0..count).scan(0.0, move |way_px, i| {
        *way_px += if i == 0 { 0.0 } else { at(i).distance_px(at(i - 1)) };
        Some((at(i), *way_px))
    })
}

/// Length of a profile to each side of the edge, px.
const REACH_PX: i32 = 8;
/// Number of samples at each end of a profile that determine the grey level of this side.
const SIDE_SAMPLE_COUNT: usize = 5;
/// Minimum difference between the grey levels of the two sides of an edge.
const MIN_CONTRAST: f64 = 20.0;
/// Minimum number of sharp edge points per pixel of length; with fewer, the edge is too short or has too many gaps.
const MIN_POINTS_PER_PX: f64 = 0.5;
/// Maximum distance of an edge point from the line, as a multiple of the median distance; points farther away are
/// excluded. Points within `MIN_OUTLIER_LIMIT_PX` of the line are always used.
const MAX_OUTLIER_MEDIANS: f64 = 4.0;
const MIN_OUTLIER_LIMIT_PX: f64 = 0.33;
const LINE_FIT_ITERATIONS: usize = 6;

/// The segment in which an edge is searched, starting at the corner.
#[derive(Debug, Clone, Copy)]
struct EdgeStretch {
    /// Length beside the corner that is not used, px.
    pub skip_px: f64,
    /// Length over which the edge is fitted, px.
    pub fit_px: f64,
}

/// A straight edge in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeLine {
    /// The end of the edge near the corner, px.
    pub from: Pixel,
    /// The end of the edge far from the corner, px.
    pub to: Pixel,
    /// Root mean square distance of the edge points from the line, px.
    pub rms_px: f64,
    /// Number of edge points on the line.
    pub points: usize,
}

/// Fits the edge along contour pixels that are ordered from the corner outwards.
fn fit_edge(picture: &GrayPicture, contour: &[Pixel], length: EdgeStretch) -> Result<EdgeLine, CornerError> {
    let needed = ((length.fit_px * MIN_POINTS_PER_PX) as usize).max(4);
    let short = |found: usize| CornerError::EdgeTooShort { found, needed };
    let (Some(first), Some(last)) = (contour.first(), contour.last()) else { return Err(short(0)) };
    let outwards = vector(*last) - vector(*first);
    let mut line =
        FittedLine::fit_trimmed(&contour.iter().map(|&pixel| vector(pixel)).collect::<Vec<_>>(), outwards)
            .ok_or_else(|| short(contour.len()))?;
    for _ in 0..2 {
        let places = edge_points(picture, &line);
        line = FittedLine::fit_trimmed(&places, outwards)
            .filter(|line| line.points >= needed)
            .ok_or_else(|| short(places.len()))?;
    }
    Ok(EdgeLine {
        from: pixel(line.centre + line.direction * line.span[0]),
        to: pixel(line.centre + line.direction * line.span[1]),
        rms_px: line.rms_px,
        points: line.points,
    })
}

/// Returns the intersection of two edges.
fn intersect_edges(a: &EdgeLine, b: &EdgeLine, min_angle_deg: f64) -> Result<Pixel, CornerError> {
    let along = |edge: &EdgeLine| (vector(edge.to) - vector(edge.from)).normalize();
    let (along_a, along_b) = (along(a), along(b));
    let sine = along_a.perp(&along_b);
    let angle_deg = sine.abs().asin().to_degrees();
    if angle_deg.is_nan() || angle_deg < min_angle_deg {
        return Err(CornerError::EdgesParallel { angle_deg, min_deg: min_angle_deg });
    }
    let way = (vector(b.from) - vector(a.from)).perp(&along_b) / sine;
    Ok(pixel(vector(a.from) + along_a * way))
}

struct FittedLine {
    centre: Vector2<f64>,
    direction: Vector2<f64>,
    /// Positions of the first and the last point along the line, relative to the middle of the line, px.
    span: [f64; 2],
    rms_px: f64,
    points: usize,
}

impl FittedLine {
    /// Fits a line by trimmed total least squares: its direction is the direction of the largest scatter of the points
    /// near the line.
    fn fit_trimmed(places: &[Vector2<f64>], outwards: Vector2<f64>) -> Option<FittedLine> {
        let mut kept = places.to_vec();
        let mut line = FittedLine::fit_least_squares(&kept, outwards)?;
        for _ in 0..LINE_FIT_ITERATIONS {
            let away = |place: &Vector2<f64>| (place - line.centre).perp(&line.direction).abs();
            let mut sizes: Vec<f64> = kept.iter().map(away).collect();
            let limit_px = (MAX_OUTLIER_MEDIANS * median(&mut sizes)?).max(MIN_OUTLIER_LIMIT_PX);
            kept = places.iter().filter(|place| away(place) <= limit_px).copied().collect();
            line = FittedLine::fit_least_squares(&kept, outwards)?;
        }
        Some(line)
    }

    fn fit_least_squares(places: &[Vector2<f64>], outwards: Vector2<f64>) -> Option<FittedLine> {
        if places.len() < 2 {
            return None;
        }
        let count = places.len() as f64;
        let middle = places.iter().sum::<Vector2<f64>>() / count;
        let scatter: Matrix2<f64> =
            places.iter().map(|place| (place - middle) * (place - middle).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let along = if along.dot(&outwards) < 0.0 { -along } else { along };
        let way = |place: &Vector2<f64>| (place - middle).dot(&along);
        let span = [places.iter().map(way).fold(0.0, f64::min), places.iter().map(way).fold(0.0, f64::max)];
        let rms_px = (eigen.eigenvalues.min().max(0.0) / count).sqrt();
        Some(FittedLine { centre: middle, direction: along, span, rms_px, points: places.len() })
    }
}

/// Finds the sub-pixel edge points, one for each pixel along a line near the edge.
fn edge_points(picture: &GrayPicture, line: &FittedLine) -> Vec<Vector2<f64>> {
    let across = Vector2::new(-line.direction.y, line.direction.x);
    let steps = (line.span[1] - line.span[0]).floor().max(0.0) as usize;
    let place = |step: usize| {
        let centre = line.centre + line.direction * (line.span[0] + step as f64);
        let profile = (-REACH_PX..=REACH_PX)
            .map(|offset| gray_at(picture, centre + across * f64::from(offset)))
            .collect::<Option<Vec<f64>>>()?;
        Some(centre + across * (find_crossing(&profile)? - f64::from(REACH_PX)))
    };
    (0..=steps).filter_map(place).collect()
}

/// Returns the position at which a profile crosses the mean of the levels of its two ends, nearest to its centre, in
/// samples; `None` if the two levels differ too little.
fn find_crossing(profile: &[f64]) -> Option<f64> {
    let mean = |side: &[f64]| side.iter().sum::<f64>() / side.len() as f64;
    let (first, last) = (mean(&profile[..SIDE_SAMPLE_COUNT]), mean(&profile[profile.len() - SIDE_SAMPLE_COUNT..]));
    if (last - first).abs() < MIN_CONTRAST {
        return None;
    }
    let middle = (first + last) / 2.0;
    let centre = (profile.len() - 1) as f64 / 2.0;
    let crosses = |i: usize| {
        let (a, b) = (profile[i] - middle, profile[i + 1] - middle);
        ((a < 0.0) != (b < 0.0)).then(|| i as f64 + a / (a - b))
    };
    let rising = |i: &usize| (profile[i + 1] > profile[*i]) == (last > first);
    (0..profile.len() - 1)
        .filter(rising)
        .filter_map(crosses)
        .min_by(|a, b| (a - centre).abs().total_cmp(&(b - centre).abs()))
}

/// Interpolates the grey level bilinearly between pixel centres; `None` outside of the picture.
fn gray_at(picture: &GrayPicture, place: Vector2<f64>) -> Option<f64> {
    let (column, row) = (place.x.floor(), place.y.floor());
    if column < 0.0 || row < 0.0 || column as usize + 1 >= picture.width || row as usize + 1 >= picture.height {
        return None;
    }
    let (right, down) = (place.x - column, place.y - row);
    let at =
        |dx: usize, dy: usize| f64::from(picture.gray[(row as usize + dy) * picture.width + column as usize + dx]);
    let upper = at(0, 0) * (1.0 - right) + at(1, 0) * right;
    let lower = at(0, 1) * (1.0 - right) + at(1, 1) * right;
    Some(upper * (1.0 - down) + lower * down)
}

fn vector(pixel: Pixel) -> Vector2<f64> {
    Vector2::new(pixel.u, pixel.v)
}

fn pixel(place: Vector2<f64>) -> Pixel {
    Pixel::at(place.x, place.y)
}

/// The reason why no corner was detected in a picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CornerError {
    /// No pixel has the brightness of the panel.
    #[error(
        "no pixel has the brightness of the panel, {min}…{max}; check that the light is on and that the panel is \
         in view"
    )]
    NoContour {
        /// Minimum grey level of the panel.
        min: usize,
        /// Maximum grey level of the panel.
        max: usize,
    },
    /// The largest object with the brightness of the panel is too small.
    #[error(
        "the largest object with the panel's brightness covers {} % of the picture, at least {} % are needed; \
         check that the panel is in view, and check panel_gray_max", distinguishable_texts(*found_percent, *needed_percent, 1)[0], distinguishable_texts(*found_percent, *needed_percent, 1)[1]
    )]
    ContourTooSmall {
        /// Percentage of the picture that the object covers.
        found_percent: f64,
        /// Minimum percentage of the picture.
        needed_percent: f64,
    },
    /// The corner is at the border of the picture or beyond.
    #[error(
        "the corner at ({u:.0}, {v:.0}) px lies at the picture's border; move the camera so that the corner is \
         well inside the picture"
    )]
    CornerAtBorder {
        /// Column of the corner, px.
        u: f64,
        /// Row of the corner, px.
        v: f64,
    },
    /// One of the edges that meet in the corner is too short or has too little contrast.
    #[error(
        "an edge beside the corner has {found} sharp points, at least {needed} are needed; check that the edge is \
         in view over rounding_mm and edge_mm, free of reflections, and clearly darker than the background"
    )]
    EdgeTooShort {
        /// Number of detected edge points.
        found: usize,
        /// Minimum number of edge points.
        needed: usize,
    },
    /// The two edges have nearly the same direction.
    #[error(
        "the two edges meet at {}°, at least {}° are needed; check that the picture shows a corner of the panel", distinguishable_texts(*angle_deg, *min_deg, 1)[0],
        distinguishable_texts(*angle_deg, *min_deg, 1)[1]
    )]
    EdgesParallel {
        /// Angle between the two edges, degrees.
        angle_deg: f64,
        /// Minimum angle, degrees.
        min_deg: f64,
    },
    /// OpenCV rejected the picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::recipe::Recipe;

    fn settings(corner: &str) -> recipe::Corner {
        let text = format!(
            "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
             [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n[corner]\n{corner}"
        );
        Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}")).corner().clone()
    }

    /// Draws a dark panel to the right of and below a corner, in front of a bright wall. Its edges are rotated by
    /// `turn_deg`, rounded by `rounding_px` and spread over one pixel; a small unevenness replaces noise.
    fn picture(corner: Pixel, turn_deg: f64, rounding_px: f64) -> GrayPicture {
        let (width, height) = (320usize, 240usize);
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let gray = (0..width * height).map(|i| {
            let (u, v) = ((i % width) as f64 - corner.u, (i / width) as f64 - corner.v);
            let (x, y) = (cos * u + sin * v, cos * v - sin * u);
            let (short_x, short_y) = ((rounding_px - x).max(0.0), (rounding_px - y).max(0.0));
            let inside_px = rounding_px - if x.min(y) < rounding_px { short_x.hypot(short_y) } else { 0.0 };
            let share = (0.5 + inside_px).clamp(0.0, 1.0);
            let uneven = f64::from((i * 7919 % 13) as u8) - 6.0;
            (170.0 - 100.0 * share + uneven).round() as u8
        });
        GrayPicture { width, height, gray: gray.collect() }
    }

    const SHORT: &str = "rounding_mm = 4\nedge_mm = 12\n";

    /// By construction the edges meet at (103.4, 77.8), outside of the panel: the corner is rounded by 22 px.
    #[test]
    fn a_rounded_and_rotated_corner_is_found_to_a_tenth_of_a_pixel() {
        for turn_deg in [-14.0, 0.0, 3.0, 12.0] {
            let corner = Pixel::at(103.4, 77.8);
            let found = find(&picture(corner, turn_deg, 22.0), &settings(SHORT), CornerName::TopLeft, 5.0)
                .expect("a corner");
            assert!(found.corner_px.distance_px(corner) < 0.1, "{turn_deg}°: {:?}", found.corner_px);
            // The thesis's corner point is on the rounding, (√2 − 1)·22 = 9.1 px from the corner. If the panel is
            // rotated, the corner point is beside the middle of the rounding.
            let mark_px = found.nearest_px.distance_px(corner);
            assert!((8.0..28.0).contains(&mark_px), "{turn_deg}°: {:?}", found.nearest_px);
            assert!(found.edges.iter().all(|edge| edge.rms_px < 0.2 && edge.points > 50), "{:?}", found.edges);
        }
    }

    /// Finds another corner in a rotated picture: `which` selects the corner.
    #[test]
    fn the_named_corner_is_found() {
        let upright = picture(Pixel::at(103.0, 77.0), 2.0, 10.0);
        let (width, height) = (upright.width, upright.height);
        let turned = GrayPicture { gray: upright.gray.iter().rev().copied().collect(), ..upright };
        let found = find(&turned, &settings(SHORT), CornerName::BottomRight, 5.0).expect("a corner");
        let expected = Pixel::at(width as f64 - 1.0 - 103.0, height as f64 - 1.0 - 77.0);
        assert!(found.corner_px.distance_px(expected) < 0.1, "{:?}", found.corner_px);
    }

    #[test]
    fn a_picture_without_a_corner_gives_an_error_text() {
        let settings = settings(SHORT);
        let nothing = find(&GrayPicture::uniform(320, 240, 200), &settings, CornerName::TopLeft, 5.0);
        assert!(matches!(nothing, Err(CornerError::NoContour { min: 0, max: 110 })), "{nothing:?}");
        let speck = find(&picture(Pixel::at(310.0, 230.0), 0.0, 1.0), &settings, CornerName::TopLeft, 5.0);
        assert!(matches!(speck, Err(CornerError::ContourTooSmall { .. })), "{speck:?}");
        let cut = find(&picture(Pixel::at(-20.0, 77.0), 0.0, 5.0), &settings, CornerName::TopLeft, 5.0);
        assert!(matches!(cut, Err(CornerError::CornerAtBorder { .. })), "{cut:?}");
        let short = find(&picture(Pixel::at(290.0, 77.0), 0.0, 5.0), &settings, CornerName::TopLeft, 5.0);
        assert!(matches!(short, Err(CornerError::EdgeTooShort { .. })), "{short:?}");
    }

    /// Expected value, calculated by hand: the mean of 40 and 140 levels is 90. The profile crosses 90 halfway between
    /// 60 and 120, 8.5 samples from the start.
    #[test]
    fn the_crossing_of_the_middle_is_interpolated_between_two_samples() {
        let mut profile = [40.0; 17];
        profile[8] = 60.0;
        profile[9] = 120.0;
        profile[10..].fill(140.0);
        assert!((find_crossing(&profile).expect("a step") - 8.5).abs() < 1e-12);
        assert_eq!(find_crossing(&[100.0; 17]), None);
    }

    /// Expected value, calculated by hand: the lines y = 10 and x = 20 + y/2 meet at (25, 10).
    #[test]
    fn two_lines_meet() {
        let line = |a: (f64, f64), b: (f64, f64)| EdgeLine {
            from: Pixel::at(a.0, a.1),
            to: Pixel::at(b.0, b.1),
            rms_px: 0.0,
            points: 2,
        };
        let level = line((40.0, 10.0), (90.0, 10.0));
        let steep = line((30.0, 20.0), (50.0, 60.0));
        let corner = intersect_edges(&level, &steep, 20.0).expect("a corner");
        assert!(corner.distance_px(Pixel::at(25.0, 10.0)) < 1e-12, "{corner:?}");
        let error = intersect_edges(&level, &line((40.0, 20.0), (90.0, 22.0)), 20.0).expect_err("nearly parallel");
        assert!(matches!(error, CornerError::EdgesParallel { angle_deg, .. } if (angle_deg - 2.29).abs() < 0.01));
    }

    #[test]
    fn a_few_outliers_do_not_rotate_the_line() {
        let place =
            |i: i32| Vector2::new(f64::from(i), if i % 9 == 0 { 14.0 } else { 5.0 + 0.01 * f64::from(i % 2) });
        let line = FittedLine::fit_trimmed(&(0..90).map(place).collect::<Vec<_>>(), Vector2::x()).expect("a line");
        assert!(line.direction.y.abs() < 1e-3 && (line.centre.y - 5.005).abs() < 1e-3, "{:?}", line.centre);
        assert_eq!(line.points, 80);
    }
}
