//! Finds where a picture changes from one brightness to another along a short line, to a fraction of a pixel.
//!
//! Brightness is read every pixel along the line; inside and outside of the edge it has the levels a and b. The edge
//! lies near the place at which brightness passes the middle between the two. The edge's position is that of an ideal
//! step with the same sum of brightness:
//!     Σᵢ (b − gᵢ) / (b − a)  =  number of places inside of the edge.                                         (1)
//! A pixel is the mean over its area, so that (1) holds wherever the edge lies in its pixel; the crossing itself is
//! biased towards the pixels' centres. A taught and a scanned edge are evaluated in the same way, so that the effect
//! of a lens or a gamma cancels.

use panelprep_base::geometry::OrganizedCloud;
use panelprep_base::geometry::{Frame, Pixel};

/// The number of positions that are read to each side of the line's middle, px.
pub(super) const HALF_LENGTH_PX: usize = 12;
/// The number of positions on a line.
pub(super) const POSITION_COUNT: usize = 2 * HALF_LENGTH_PX + 1;
/// The levels are read between these two distances from the edge, px.
const LEVEL_FROM: f64 = 2.5;
const LEVEL_TO: f64 = 6.0;
/// The edge is searched up to this distance from its expected position, px.
const SEARCH: f64 = 3.0;
/// The sum of (1) extends over this distance to each side of the crossing, px.
const SUM_REACH: f64 = 1.6;
/// Maximum difference between the position by the sum (1) and the crossing, px.
const MAX_UNLIKE: f64 = 0.5;
/// Minimum difference between the levels, grey levels.
const MIN_CONTRAST: f64 = 14.0;
/// Maximum variation of the brightness that determines a level, grey levels; the second constant is the limit as a
/// fraction of the contrast.
const MAX_UNEVEN: f64 = 10.0;
const MAX_UNEVEN_SHARE: f64 = 0.1;

/// Brightness along a line, from the inside outwards.
pub(super) type BrightnessLine = [f64; POSITION_COUNT];

/// A step of brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BrightnessStep {
    /// Distance of the step from the line's middle outwards, px.
    pub offset_px: f64,
    /// Level outside minus level inside, grey levels.
    pub contrast: f64,
    /// The width of the step, from its contrast and its slope, px.
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
    // The levels are read around the edge itself, not around its expected place.
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
        (level(-LEVEL_TO, -LEVEL_FROM)?, level(LEVEL_FROM, LEVEL_TO)?);
    let contrast = outside - inside;
    // Beside another edge, for example of a post behind the panel, the level cannot be determined.
    let uneven = uneven_inside.max(uneven_outside) > MAX_UNEVEN.max(MAX_UNEVEN_SHARE * contrast.abs());
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
        .filter(|(offset, _)| away(*offset) <= SEARCH)
        .min_by(|a, b| away(a.0).total_cmp(&away(b.0)))?;
    let first = ((crossed - SUM_REACH).floor() as i64 + HALF_LENGTH_PX as i64).max(0) as usize;
    let last =
        ((crossed + SUM_REACH).ceil() as i64 + HALF_LENGTH_PX as i64).clamp(0, POSITION_COUNT as i64 - 1) as usize;
    let inside_places: f64 = line[first..=last].iter().map(|gray| (outside - gray) / contrast).sum(); // (1)
    let offset_px = first as f64 - 0.5 + inside_places - HALF_LENGTH_PX as f64;
    // If the two differ more, the sum comes from a spot beside the edge and not from the edge.
    ((offset_px - crossed).abs() < MAX_UNLIKE).then(|| BrightnessStep {
        offset_px,
        contrast,
        width_px: contrast.abs() / slope,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 70 inside, 180 outside; a quarter of the pixel at +2 is panel, so that the edge is at 1.5 + 0.25.
    /// The crossing would be at 1 + 55/82.5.
    #[test]
    fn a_mixed_pixel_states_where_the_edge_is() {
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
