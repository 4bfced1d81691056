//! The systematic depth error of a 3D camera as a function of the direction in its picture: the error that is the same
//! in each scan.
//!
//! A camera with structured light measures 1/z by triangulation. An error of its lens, its projector or their poses is
//! therefore an error of 1/z that depends only on the direction (x, y) = (X/Z, Y/Z). With the error c mm at the
//! reference depth z₀,
//!     1/z_true = 1/z + c(x, y) / z₀²,   δz = c(x, y) (z / z₀)².                                          (1)
//! c is a uniform cubic B-spline over a rectangle of directions, constant beyond the rectangle's edges. The part of c
//! that is linear in (x, y) maps planes to other planes: it cannot be measured with a flat object alone, but with known
//! distances on a flat object.

use super::cloud::OrganizedCloud;
use super::rigid::{Camera, Point};

/// The reference depth z₀ of (1), mm.
pub const REFERENCE_DEPTH_MM: f64 = 700.0;
/// Number of coefficients along the picture's width.
pub const FIELD_COLUMNS: usize = 9;
/// Number of coefficients along the picture's height.
pub const FIELD_ROWS: usize = 7;
/// Total number of coefficients of the field.
pub const FIELD_SIZE: usize = FIELD_COLUMNS * FIELD_ROWS;

/// The depth error c of (1) as a function of the direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthField {
    /// The rectangle of directions that the field covers.
    pub rectangle: FieldRectangle,
    /// The field's coefficients row by row, mm at the reference depth.
    pub coefficients_mm: [f64; FIELD_SIZE],
}

/// A rectangle of directions (X/Z, Y/Z).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldRectangle {
    /// The smallest x and y.
    pub min: [f64; 2],
    /// The largest x and y.
    pub max: [f64; 2],
}

impl FieldRectangle {
    /// Returns the indices of the coefficients that have an effect at a direction, with their weights; the weights sum
    /// to 1.
    pub fn weights(&self, direction: [f64; 2]) -> [(usize, f64); 16] {
        let along = |axis: usize, count: usize| {
            let span = (self.max[axis] - self.min[axis]).max(f64::MIN_POSITIVE);
            let intervals = (count - 3) as f64;
            let at = ((direction[axis] - self.min[axis]) / span).clamp(0.0, 1.0) * intervals;
            let first = (at.floor() as usize).min(count - 4);
            (first, cubic_bsplines(at - first as f64))
        };
        let ((column, across), (row, down)) = (along(0, FIELD_COLUMNS), along(1, FIELD_ROWS));
        std::array::from_fn(|k| {
            let (i, j) = (k % 4, k / 4);
            ((row + j) * FIELD_COLUMNS + column + i, down[j] * across[i])
        })
    }
}

/// Returns the values of the four cubic B-splines that are not zero in an interval, at the position `t`, 0…1.
fn cubic_bsplines(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        (1.0 - 3.0 * t + 3.0 * t2 - t3) / 6.0,
        (4.0 - 6.0 * t2 + 3.0 * t3) / 6.0,
        (1.0 + 3.0 * t + 3.0 * t2 - 3.0 * t3) / 6.0,
        t3 / 6.0,
    ]
}

impl DepthField {
    /// Creates a field that is zero everywhere.
    pub fn zero(over: FieldRectangle) -> Self {
        DepthField { rectangle: over, coefficients_mm: [0.0; FIELD_SIZE] }
    }

    /// Returns the field plus a linear term with this slope, mm at the reference depth for each unit of the direction.
    /// A linear function is added to the spline by adding the function's values at the coefficients' positions.
    #[must_use]
    pub fn with_linear_term(mut self, slope_mm: [f64; 2]) -> Self {
        let place = |axis: usize, index: usize, count: usize| {
            let share = (index as f64 - 1.0) / (count - 3) as f64;
            self.rectangle.min[axis] + share * (self.rectangle.max[axis] - self.rectangle.min[axis])
        };
        for (index, coefficient_mm) in self.coefficients_mm.iter_mut().enumerate() {
            let (column, row) = (index % FIELD_COLUMNS, index / FIELD_COLUMNS);
            *coefficient_mm +=
                slope_mm[0] * place(0, column, FIELD_COLUMNS) + slope_mm[1] * place(1, row, FIELD_ROWS);
        }
        self
    }

    /// Returns the error c at a direction, mm at the reference depth.
    pub fn at_mm(&self, direction: [f64; 2]) -> f64 {
        self.rectangle.weights(direction).iter().map(|(index, weight)| weight * self.coefficients_mm[*index]).sum()
    }

    /// Returns the factor by which a point's coordinates are multiplied to remove this error, by (1).
    pub fn correction_factor(&self, [x, y, z]: [f64; 3]) -> f64 {
        1.0 / (1.0 + z * self.at_mm([x / z, y / z]) / REFERENCE_DEPTH_MM.powi(2))
    }

    /// Returns the point with this depth error removed.
    pub fn corrected_point(&self, point: Point<Camera>) -> Point<Camera> {
        let mm = point.mm.coords;
        Point::new((mm * self.correction_factor([mm.x, mm.y, mm.z])).into())
    }

    /// Returns the scan with this depth error removed.
    pub fn correct_cloud(&self, scan: &OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
        scan.scaled_along_rays(|mm| self.correction_factor(mm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(mm: impl Fn(usize, usize) -> f64) -> DepthField {
        let over = FieldRectangle { min: [-0.3, -0.2], max: [0.3, 0.2] };
        DepthField {
            rectangle: over,
            coefficients_mm: std::array::from_fn(|k| mm(k % FIELD_COLUMNS, k / FIELD_COLUMNS)),
        }
    }

    /// Expected values, calculated by hand: all coefficients 0.5 give 0.5 everywhere. Coefficients that increase
    /// linearly give a linear field, here 0.1 mm from one column to the next; six intervals cover the width. In the
    /// middle, at interval 3, the coefficients 3, 4, 5 have the weights 1/6, 4/6, 1/6.
    #[test]
    fn constant_and_linear_coefficients_give_such_fields() {
        assert!((field(|_, _| 0.5).at_mm([0.12, -0.05]) - 0.5).abs() < 1e-12);
        let line = field(|column, _| 0.1 * column as f64);
        assert!((line.at_mm([0.0, 0.0]) - 0.4).abs() < 1e-12, "{}", line.at_mm([0.0, 0.0]));
        assert!((line.at_mm([0.1, 0.1]) - 0.5).abs() < 1e-12, "one interval is a sixth of the width");
        assert_eq!(line.at_mm([0.3, 0.0]), line.at_mm([9.0, 0.0]), "constant beyond its edges");
        // The slope adds 0.5 · 0.12 + 1.0 · 0.05 to a field of 0.2.
        let sloped = field(|_, _| 0.2).with_linear_term([0.5, -1.0]);
        assert!((sloped.at_mm([0.12, -0.05]) - 0.31).abs() < 1e-12, "{}", sloped.at_mm([0.12, -0.05]));
    }

    /// Expected value, calculated by hand: a depth error of 0.7 mm at 700 mm is 0.7·(350/700)² = 0.175 mm at 350 mm, to
    /// first order.
    #[test]
    fn a_scan_is_moved_along_its_rays() {
        let points = vec![[0.0, 0.0, 350.0], [70.0, 35.0, 700.0], [f32::NAN; 3], [0.0, 0.0, 700.0]];
        let scan = OrganizedCloud::<Camera>::new(2, 2, points, vec![[0; 3]; 4]).expect("organised");
        let moved = field(|_, _| 0.7).correct_cloud(&scan);
        let z = |index| moved.point_at(index).map(|point| point.mm.z).unwrap_or(f64::NAN);
        assert!((z(0) - (350.0 - 0.175)).abs() < 1e-3 && (z(3) - 699.3).abs() < 1e-3, "{} {}", z(0), z(3));
        let point = moved.point_at(1).expect("there").mm;
        assert!((point.x / point.z - 0.1).abs() < 1e-7 && (point.y / point.z - 0.05).abs() < 1e-7);
        assert!(moved.point_at(2).is_none());
        let alone = field(|_, _| 0.7).corrected_point(Point::at(70.0, 35.0, 700.0));
        assert!(alone.distance_mm(Point::new(point)) < 1e-3, "a point alone is moved as in its scan");
    }
}
