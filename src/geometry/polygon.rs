//! Plane polygons of pixels: inside or outside, signed area.

use super::units::Pixel;

/// Twice-counted corners are allowed; the polygon closes itself.
///
/// True for a point inside by the even–odd rule.
pub fn contains(polygon: &[Pixel], point: Pixel) -> bool {
    let mut inside = false;
    for (a, b) in edges(polygon) {
        if (a.v > point.v) != (b.v > point.v) && point.u < a.u + (point.v - a.v) / (b.v - a.v) * (b.u - a.u) {
            inside = !inside;
        }
    }
    inside
}

/// Area in px², positive where the corners run clockwise as seen on a screen (v down).
pub fn signed_area_px2(polygon: &[Pixel]) -> f64 {
    edges(polygon).map(|(a, b)| (a.u * b.v - b.u * a.v) / 2.0).sum()
}

fn edges(polygon: &[Pixel]) -> impl Iterator<Item = (Pixel, Pixel)> + '_ {
    polygon.iter().copied().zip(polygon.iter().copied().cycle().skip(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a right triangle of 4 × 2 px has 4 px².
    #[test]
    fn triangle() {
        let triangle = [Pixel::at(0.0, 0.0), Pixel::at(4.0, 0.0), Pixel::at(0.0, 2.0)];
        assert!((signed_area_px2(&triangle) - 4.0).abs() < 1e-12);
        assert!(contains(&triangle, Pixel::at(1.0, 0.5)));
        assert!(!contains(&triangle, Pixel::at(3.0, 1.5)));
    }
}
