//! Divides a scan into smooth connected components, and finds the components that belong to the same sheet.
//!
//! Two adjacent pixels are connected if the distance between their points is smaller than the distances that a smooth,
//! inclined panel causes. No shape is assumed.
//!
//! Missing points can divide a panel into several components; other components are objects in front of or behind the
//! panel. The heights above the best-fit plane are modelled as a polynomial of second order in the two directions of
//! that plane: h(s, t) = a + b s + c t + d s² + e st + f t². The polynomial is fitted to the components that are known
//! to belong to the sheet. A component belongs to the sheet if its median height differs from this model by at most
//! `MAX_SHEET_DISTANCE_MM`.

use nalgebra::{Matrix3, Matrix6, Point3, Vector3, Vector6};
use panelprep_base::geometry::{
    DIRECT_NEIGHBOURS, Frame, Mask, OrganizedCloud, Panel, Point, RasterSize, Vector, median,
};

/// Maximum distance between adjacent points of a connected component, relative to the median distance. A steep panel
/// causes smaller distances; the gap between a panel and its fixture is far larger.
const MAX_RELATIVE_POINT_DISTANCE: f64 = 6.0;

/// Returns the median distance between adjacent points in the rows, mm.
fn median_point_distance_mm<F: Frame>(cloud: &OrganizedCloud<F>, free: &[bool]) -> Option<f64> {
    let pair = |index: usize| {
        let beside = index + 1;
        let pair = free[index] && !beside.is_multiple_of(cloud.width()) && free[beside];
        pair.then(|| Some(cloud.point_at(index)?.distance_mm(cloud.point_at(beside)?))).flatten()
    };
    let mut steps: Vec<f64> = (0..free.len() - 1).step_by(7).filter_map(pair).collect();
    median(&mut steps)
}

/// Returns the maximum distance between adjacent points of a connected component, mm.
pub(super) fn max_step_mm<F: Frame>(cloud: &OrganizedCloud<F>, free: &[bool]) -> f64 {
    MAX_RELATIVE_POINT_DISTANCE * median_point_distance_mm(cloud, free).unwrap_or_default()
}

/// Returns the pixel indices of each connected component of a scan, the largest component first.
pub fn find_pieces<F: Frame>(cloud: &OrganizedCloud<F>, inside: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let raster = RasterSize { width: cloud.width(), height: cloud.height() };
    let free: Vec<bool> =
        (0..raster.width * raster.height).map(|i| inside(i) && cloud.point_at(i).is_some()).collect();
    let max_step_mm = max_step_mm(cloud, &free);
    let near = |here: usize, there: usize| {
        let points = cloud.point_at(here).zip(cloud.point_at(there));
        points.is_some_and(|(here, there)| there.distance_mm(here) < max_step_mm)
    };
    let mut found = raster.joined_components(&DIRECT_NEIGHBOURS, |index| free[index], near);
    found.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    found
}

/// Converts the pixel indices of a component to a mask.
pub fn component_to_mask<F: Frame>(cloud: &OrganizedCloud<F>, piece: &[usize]) -> Mask {
    let mut mask = Mask::all_outside(cloud.width(), cloud.height());
    for &index in piece {
        mask.inside[index] = true;
    }
    mask
}

/// Maximum distance of a component from the sheet, mm. A clamp or a glued marker is thicker; a real panel deviates less
/// from the model at the ends of a gap.
const MAX_SHEET_DISTANCE_MM: f64 = 4.0;
/// Maximum number of points for a fit, and for the median height of a component.
const MAX_FIT_POINTS: usize = 4_000;
const MAX_MEDIAN_POINTS: usize = 200;

/// Returns the pixels of all components that are on the same sheet as the largest one.
pub(super) fn pixels_on_main_sheet<'a>(
    scan: &OrganizedCloud<Panel>,
    largest: &[usize],
    pieces: impl Iterator<Item = &'a Vec<usize>>,
) -> Vec<usize> {
    let pieces: Vec<&Vec<usize>> = pieces.collect();
    let mut joined = largest.to_vec();
    // Near components extend the model, so that a second pass also finds distant ones.
    for _ in 0..2 {
        let Some(sheet) = QuadraticSheet::fit(scan, &joined) else { return joined };
        joined = pieces
            .iter()
            .filter(|piece| sheet.contains_piece(scan, piece))
            .flat_map(|piece| piece.iter().copied())
            .collect();
    }
    joined
}

/// A surface of second order that is fitted to points of a panel.
pub(super) struct QuadraticSheet {
    centre: Point3<f64>,
    /// Two directions in the best-fit plane, and its normal.
    axes: Matrix3<f64>,
    height: Vector6<f64>,
    /// The radius of the points, mm, by which the coordinates are scaled.
    scale_mm: f64,
    /// The matrix (Σ t tᵀ / n)⁻¹, where t are the polynomial's terms at each point.
    spread: Matrix6<f64>,
    /// Distance of the points from the sheet, rms, mm.
    pub(super) rms_mm: f64,
}

/// Maximum leverage tᵀ (Σ t tᵀ / n)⁻¹ t at which a position is not farther away than the border of the fitted points.
/// The mean leverage of these points is 6; at the corners of a uniformly filled square it is 1 + 3 + 3 + 5 + 5 + 9 =
/// 26.
const MAX_RIM_LEVERAGE: f64 = 26.0;
/// Maximum number of iterations of the intersection between a ray and the sheet, and the tolerance of the last step,
/// mm.
const MAX_INTERSECTION_STEPS: usize = 20;
const INTERSECTION_TOLERANCE_MM: f64 = 1e-6;

impl QuadraticSheet {
    /// Returns the intersection of a ray with the sheet; `None` if it is far from the fitted points.
    pub(super) fn intersect_ray(&self, viewer: Point<Panel>, ray: Vector<Panel>) -> Option<Point<Panel>> {
        let normal = self.axes.column(2).into_owned();
        let slope = normal.dot(&ray.mm);
        let mut distance = normal.dot(&(self.centre - viewer.mm)) / slope;
        for _ in 0..MAX_INTERSECTION_STEPS {
            let point = viewer + ray * distance;
            let (terms, height) = self.polynomial_terms(&point.mm);
            let step = (self.height.dot(&terms) - height) / slope;
            distance += step;
            if step.abs() * ray.mm.norm() <= INTERSECTION_TOLERANCE_MM {
                let is_near = terms.dot(&(self.spread * terms)) <= MAX_RIM_LEVERAGE;
                return (is_near && distance > 0.0).then_some(point);
            }
        }
        None
    }

    /// Fits a sheet to the points at these pixels; `None` if there are too few points, or if they are collinear.
    pub(super) fn fit(scan: &OrganizedCloud<Panel>, pixels: &[usize]) -> Option<QuadraticSheet> {
        let points: Vec<Point3<f64>> =
            subsample(pixels, MAX_FIT_POINTS).filter_map(|i| scan.point_at(i)).map(|p| p.mm).collect();
        let centre =
            Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64);
        let scatter: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let thinnest = eigen.eigenvalues.imin();
        let columns =
            [(thinnest + 1) % 3, (thinnest + 2) % 3, thinnest].map(|i| eigen.eigenvectors.column(i).into_owned());
        let scale_mm = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max).max(1e-9);
        let axes = Matrix3::from_columns(&columns);
        let (height, spread) = (Vector6::zeros(), Matrix6::zeros());
        let mut sheet = QuadraticSheet { centre, axes, height, scale_mm, spread, rms_mm: 0.0 };
        let (mut squares, mut sums) = (Matrix6::zeros(), Vector6::zeros());
        for point in &points {
            let (terms, height) = sheet.polynomial_terms(point);
            squares += terms * terms.transpose();
            sums += terms * height;
        }
        let inverse = squares.try_inverse()?;
        sheet.height = inverse * sums;
        sheet.spread = inverse * points.len() as f64;
        let off_mm = |point: &Point3<f64>| {
            let (terms, height) = sheet.polynomial_terms(point);
            height - sheet.height.dot(&terms)
        };
        let squares_mm2: f64 = points.iter().map(|point| off_mm(point).powi(2)).sum();
        sheet.rms_mm = (squares_mm2 / points.len() as f64).sqrt();
        Some(sheet)
    }

    fn polynomial_terms(&self, point: &Point3<f64>) -> (Vector6<f64>, f64) {
        let at = self.axes.transpose() * (point - self.centre);
        let (s, t) = (at.x / self.scale_mm, at.y / self.scale_mm);
        (Vector6::new(1.0, s, t, s * s, s * t, t * t), at.z)
    }

    fn contains_piece(&self, scan: &OrganizedCloud<Panel>, piece: &[usize]) -> bool {
        let away = |i: usize| {
            let (terms, height) = self.polynomial_terms(&scan.point_at(i)?.mm);
            Some(height - self.height.dot(&terms))
        };
        let mut heights: Vec<f64> = subsample(piece, MAX_MEDIAN_POINTS).filter_map(away).collect();
        median(&mut heights).is_some_and(|height| height.abs() <= MAX_SHEET_DISTANCE_MM)
    }
}

/// Returns about `wanted` of these pixels, at uniform intervals.
fn subsample(pixels: &[usize], wanted: usize) -> impl Iterator<Item = usize> + '_ {
    pixels.iter().copied().step_by(pixels.len().div_ceil(wanted).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Camera;

    /// A block of 4 × 4 pixels, 60 mm in front of a wall: two components, the wall first.
    #[test]
    fn a_gap_in_depth_separates_two_objects() {
        let point = |i: usize| {
            let (column, row) = (i % 10, i / 10);
            let near = (3..7).contains(&column) && (3..7).contains(&row);
            [column as f32 * 0.4, row as f32 * 0.4, if near { 700.0 } else { 760.0 }]
        };
        let cloud = OrganizedCloud::<Camera>::new(10, 10, (0..100).map(point).collect(), vec![[0; 3]; 100])
            .expect("counts agree");
        let pieces = find_pieces(&cloud, |_| true);
        assert_eq!(pieces.iter().map(Vec::len).collect::<Vec<_>>(), [84, 16]);
        assert!(component_to_mask(&cloud, &pieces[1]).contains(4, 4));
    }

    /// Expected values, calculated by hand: the sheet h = 500 + x²/1000 over 0…99 × 0…49 mm has a hole of 40 × 20 mm. A
    /// ray along z through the centre of the hole, (50, 25), meets the sheet at 502.5; a ray far outside, at (400, 25),
    /// has no result.
    #[test]
    fn a_hole_is_bridged_and_far_points_have_no_intersection() {
        let point = |i: usize| {
            let (x, y) = ((i % 100) as f32, (i / 100) as f32);
            let is_hole = (30..70).contains(&(i % 100)) && (15..35).contains(&(i / 100));
            if is_hole { [f32::NAN; 3] } else { [x, y, 500.0 + x * x / 1_000.0] }
        };
        let scan = OrganizedCloud::<Panel>::new(100, 50, (0..5_000).map(point).collect(), vec![[0; 3]; 5_000]);
        let scan = scan.expect("counts agree");
        let given: Vec<usize> = scan.valid_points().map(|(index, _)| index).collect();
        let sheet = QuadraticSheet::fit(&scan, &given).expect("a sheet");
        let along_z = |x: f64| sheet.intersect_ray(Point::at(x, 25.0, 0.0), Vector::new(Vector3::z()));
        let met = along_z(50.0).expect("in the hole");
        assert!((met.mm.z - 502.5).abs() < 1e-3 && (met.mm.x - 50.0).abs() < 1e-9, "{met:?}");
        assert!(along_z(0.0).is_some() && along_z(400.0).is_none());
        // The heights of a parabola above a tilted plane are only approximately a parabola.
        assert!(sheet.rms_mm < 0.01, "{}", sheet.rms_mm);
    }

    /// A bent sheet in two components, with an object 20 mm in front, which is excluded. The second component is 8 mm
    /// above the plane of the first (x²/1000 at x = 90 mm), but on the same bent sheet.
    #[test]
    fn parts_of_a_bent_sheet_belong_together() {
        let point = |i: usize| {
            let (x, y) = ((i % 100) as f32, (i / 100) as f32);
            let lift = if (40..50).contains(&(i % 100)) { 20.0 } else { 0.0 };
            [x, y, 500.0 + x * x / 1_000.0 - lift]
        };
        let scan = OrganizedCloud::<Panel>::new(100, 50, (0..5_000).map(point).collect(), vec![[0; 3]; 5_000]);
        let scan = scan.expect("counts agree");
        let columns =
            |from: usize, to: usize| (0..5_000).filter(|i| (from..to).contains(&(i % 100))).collect::<Vec<_>>();
        let pieces = [columns(50, 90), columns(0, 40), columns(40, 50), columns(92, 100)];
        let joined = pixels_on_main_sheet(&scan, &pieces[0], pieces.iter());
        assert_eq!(joined.len(), 50 * (40 + 40 + 8), "all but the thing");
    }
}
