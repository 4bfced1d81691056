//! One straight edge to a fraction of a pixel, and the intersection of two edges.
//!
//! A line through contour pixels shows roughly where the edge is. At every pixel along this line, the grey of the
//! unfiltered picture is read across the edge, from the panel's side to the other. The edge is where the grey
//! crosses the middle between its values on both sides. A robust line through these places is the edge; the grey is
//! read once more from this line.

use super::error::CornerError;
use nalgebra::{Matrix2, Vector2};
use panelprep_base::geometry::{GrayPicture, Pixel, median};

/// How far across the edge the grey is read, px.
const REACH_PX: i32 = 8;
/// Number of samples at each end of a profile that determine the grey of a side.
const SIDE_SAMPLES: usize = 5;
/// Smallest difference between both sides of an edge, grey levels.
const MIN_CONTRAST: f64 = 20.0;
/// Smallest number of sharp edge points per pixel of length; with fewer, the edge is too short or too broken.
const MIN_SHARE: f64 = 0.5;
/// Points farther from the line than this multiple of the median distance are left out, but points within a third of a
/// pixel are always used.
const MAX_OUTLIER_MEDIANS: f64 = 4.0;
const FLOOR_PX: f64 = 0.33;
const LINE_FIT_ITERATIONS: usize = 6;

/// The segment in which an edge is searched, starting at the corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeStretch {
    /// Length that is left out beside the corner, px.
    pub skip_px: f64,
    /// Fitted, px.
    pub fit_px: f64,
}

/// A straight edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeLine {
    /// The end of the edge near the corner.
    pub from: Pixel,
    /// Its other end.
    pub to: Pixel,
    /// Root mean square distance of the edge points from the line, px.
    pub rms_px: f64,
    /// Number of edge points on the line.
    pub points: usize,
}

/// Fits the edge along contour pixels, given from the corner outwards.
pub(super) fn fit(picture: &GrayPicture, contour: &[Pixel], length: EdgeStretch) -> Result<EdgeLine, CornerError> {
    let needed = ((length.fit_px * MIN_SHARE) as usize).max(4);
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
pub(super) fn intersect_edges(a: &EdgeLine, b: &EdgeLine, min_angle_deg: f64) -> Result<Pixel, CornerError> {
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
    /// First and last point along the line, measured from the middle of the line.
    span: [f64; 2],
    rms_px: f64,
    points: usize,
}

impl FittedLine {
    /// Fits a line by total least squares with trimming: the direction of largest scatter among the points near the
    /// line.
    fn fit_trimmed(places: &[Vector2<f64>], outwards: Vector2<f64>) -> Option<FittedLine> {
        let mut kept = places.to_vec();
        let mut line = FittedLine::fit_least_squares(&kept, outwards)?;
        for _ in 0..LINE_FIT_ITERATIONS {
            let away = |place: &Vector2<f64>| (place - line.centre).perp(&line.direction).abs();
            let mut sizes: Vec<f64> = kept.iter().map(away).collect();
            let limit_px = (MAX_OUTLIER_MEDIANS * median(&mut sizes)?).max(FLOOR_PX);
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

/// Finds where a profile crosses the middle between its ends, nearest to its centre, in samples; `None` if the ends
/// differ too little.
fn find_crossing(profile: &[f64]) -> Option<f64> {
    let mean = |side: &[f64]| side.iter().sum::<f64>() / side.len() as f64;
    let (first, last) = (mean(&profile[..SIDE_SAMPLES]), mean(&profile[profile.len() - SIDE_SAMPLES..]));
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

/// Interpolates the grey between pixel centres, bilinear; `None` outside the picture.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: between 40 and 140 the middle is 90. From 60 to 120 this value is crossed half-way, 8.5
    /// samples from the start.
    #[test]
    fn the_middle_grey_is_crossed_between_two_samples() {
        let mut profile = [40.0; 17];
        profile[8] = 60.0;
        profile[9] = 120.0;
        profile[10..].fill(140.0);
        assert!((find_crossing(&profile).expect("a step") - 8.5).abs() < 1e-12);
        assert_eq!(find_crossing(&[100.0; 17]), None);
    }

    /// By hand: y = 10 and x = 20 + y/2 meet at (25, 10).
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
    fn a_few_wrong_places_do_not_turn_the_line() {
        let place =
            |i: i32| Vector2::new(f64::from(i), if i % 9 == 0 { 14.0 } else { 5.0 + 0.01 * f64::from(i % 2) });
        let line = FittedLine::fit_trimmed(&(0..90).map(place).collect::<Vec<_>>(), Vector2::x()).expect("a line");
        assert!(line.direction.y.abs() < 1e-3 && (line.centre.y - 5.005).abs() < 1e-3, "{:?}", line.centre);
        assert_eq!(line.points, 80);
    }
}
