//! The panel's piece of the scan: what lies in the search box, is connected, and has the panel's size.
//!
//! Size is what no rigid motion changes: the area, and length and width as √12 times the spread along the two principal
//! axes (the sides, for a rectangle). The largest piece is not the answer, since a fixture's back plate is larger.

use super::LocateError;
use crate::geometry::{Frame, Mask, OrganizedCloud, Point};
use crate::panel::segment;
use crate::recipe;
use nalgebra::{Matrix3, Vector3};

/// A smaller piece is a speck.
const MIN_POINTS: usize = 1_000;
/// A piece may have this much more or less area than the panel: part may be hidden, part may be something else.
const MAX_AREA_RATIO: f64 = 1.6;
/// The same for length and width.
const MAX_SIDE_RATIO: f64 = 1.35;
/// Size is measured on every so many pixels in both directions.
const STRIDE_PX: usize = 3;

/// What a rigid motion does not change.
#[derive(Debug, Clone, Copy)]
pub(super) struct Size {
    /// Area of the surface, mm².
    pub area_mm2: f64,
    /// Longest principal axis, mm.
    pub length_mm: f64,
    /// Second principal axis, mm.
    pub width_mm: f64,
}

impl Size {
    /// The size of a cloud's pixels in a mask; `None` where there are too few.
    pub fn of<F: Frame>(cloud: &OrganizedCloud<F>, mask: &Mask) -> Option<Size> {
        let (mut areas, mut area_sum) = (0usize, 0.0);
        let (mut count, mut sum, mut squares) = (0usize, Vector3::zeros(), Matrix3::zeros());
        let mut first: Option<Point<F>> = None;
        for row in (1..cloud.height() - 1).step_by(STRIDE_PX) {
            for column in (1..cloud.width() - 1).step_by(STRIDE_PX) {
                let Some(point) = cloud.point(column, row).filter(|_| mask.contains(column, row)) else { continue };
                let offset = (point - *first.get_or_insert(point)).mm;
                (count, sum, squares) = (count + 1, sum + offset, squares + offset * offset.transpose());
                if inner(mask, column, row, 1) {
                    areas += 1;
                    area_sum += cloud.pixel_area_mm2(column, row)?;
                }
            }
        }
        if areas == 0 {
            return None;
        }
        let mean = sum / count as f64;
        let mut spread = (squares / count as f64 - mean * mean.transpose()).symmetric_eigenvalues();
        spread.as_mut_slice().sort_by(f64::total_cmp);
        let side_mm = |variance: f64| (12.0 * variance.max(0.0)).sqrt();
        Some(Size {
            area_mm2: area_sum / areas as f64 * mask.count() as f64,
            length_mm: side_mm(spread[2]),
            width_mm: side_mm(spread[1]),
        })
    }

    /// How unlike two sizes are: 0 for equal ones, 1 where a ratio reaches its limit.
    fn unlike(&self, other: &Size) -> f64 {
        let ratio = |a: f64, b: f64, limit: f64| ((a / b).ln() / limit.ln()).abs();
        ratio(self.area_mm2, other.area_mm2, MAX_AREA_RATIO)
            .max(ratio(self.length_mm, other.length_mm, MAX_SIDE_RATIO))
            .max(ratio(self.width_mm, other.width_mm, MAX_SIDE_RATIO))
    }
}

/// Is a pixel inside, and its eight neighbours at this distance as well?
pub(super) fn inner(mask: &Mask, column: usize, row: usize, distance_px: usize) -> bool {
    let far = column >= distance_px
        && row >= distance_px
        && column + distance_px < mask.width
        && row + distance_px < mask.height;
    far && [row - distance_px, row, row + distance_px]
        .iter()
        .all(|&v| [column - distance_px, column, column + distance_px].iter().all(|&u| mask.contains(u, v)))
}

/// The piece of the scan in the search box whose size is most like the panel's.
pub(super) fn find<F: Frame>(
    scan: &OrganizedCloud<F>,
    taught: &Size,
    settings: &recipe::Locate,
) -> Result<(Mask, Size), LocateError> {
    let (low, high) = (settings.box_min_mm(), settings.box_max_mm());
    let in_box = |index: usize| {
        scan.point_at(index).is_some_and(|p| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p.mm[axis])))
    };
    let pieces = segment::pieces(scan, in_box);
    let found = pieces.iter().map(Vec::len).sum();
    let alike = pieces
        .iter()
        .take_while(|piece| piece.len() >= MIN_POINTS)
        .filter_map(|piece| {
            let mask = segment::mask_of(scan, piece);
            let size = Size::of(scan, &mask)?;
            Some((size.unlike(taught), mask, size))
        })
        .collect::<Vec<_>>();
    let count = alike.len();
    let Some((unlike, mask, size)) = alike.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Err(LocateError::EmptyBox { found, needed: MIN_POINTS });
    };
    // NaN, from a piece without extent, is not below 1 either.
    if unlike < 1.0 {
        return Ok((mask, size));
    }
    Err(LocateError::NoPieceFits {
        pieces: count,
        area_mm2: size.area_mm2,
        length_mm: size.length_mm,
        width_mm: size.width_mm,
        taught_area_mm2: taught.area_mm2,
        taught_length_mm: taught.length_mm,
        taught_width_mm: taught.width_mm,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;

    /// By hand: 40 × 20 pixels, 2 mm apart across and 3 mm down, stand for 4 800 mm² and 80 × 60 mm.
    #[test]
    fn a_rectangle_has_its_sides_and_area() {
        let point = |i: usize| [(i % 60) as f32 * 2.0, (i / 60) as f32 * 3.0, 700.0];
        let cloud = OrganizedCloud::<Camera>::new(60, 40, (0..2_400).map(point).collect(), vec![[0; 3]; 2_400])
            .expect("counts");
        let mut mask = Mask::empty(60, 40);
        for row in 10..30 {
            for column in 10..50 {
                mask.inside[row * 60 + column] = true;
            }
        }
        let size = Size::of(&cloud, &mask).expect("a rectangle");
        assert!((size.area_mm2 - 4_800.0).abs() < 1.0, "{size:?}");
        // 14 sampled columns, 6 mm apart, spread by 6·√((14² − 1)/12) = 24.2 mm, √12 of it is 83.8 mm.
        assert!((size.length_mm - 83.785).abs() < 1e-3 && (size.width_mm - 60.0).abs() < 3.0, "{size:?}");
        assert!(size.unlike(&size) < 1e-12);
        assert!(size.unlike(&Size { length_mm: 120.0, ..size }) > 1.0, "1.4 times as long is another thing");
    }
}
