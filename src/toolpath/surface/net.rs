//! Points spread evenly over a patch of the surface, at which the effects of a path are calculated.

use super::bspline::BSplineSurface;
use super::derivatives::Parameter;
use super::patch::ParameterPatch;

/// Points in rows and columns, each in the middle of its part of the patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleGrid {
    /// The patch.
    pub patch: ParameterPatch,
    /// Places along u.
    pub columns: usize,
    /// Places along v.
    pub rows: usize,
}

impl SampleGrid {
    /// Creates points at about this spacing, mm, measured through the middle of the patch.
    pub fn from_patch(surface: &BSplineSurface, patch: ParameterPatch, spacing_mm: f64) -> Self {
        let middle = surface.tangents(patch.parameter_at(Parameter { u: 0.5, v: 0.5 }));
        let count = |length_mm: f64| (length_mm / spacing_mm).ceil().max(1.0) as usize;
        let [size_u, size_v] = sizes(patch);
        let (columns, rows) = (count(middle.s_u.mm.norm() * size_u), count(middle.s_v.mm.norm() * size_v));
        SampleGrid { patch, columns, rows }
    }

    /// Returns the number of samples.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// The parameters of a point; points are counted row by row.
    pub fn parameter_at(&self, place: usize) -> Parameter {
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        self.patch.parameter_at(Parameter {
            u: share(place % self.columns, self.columns),
            v: share(place / self.columns, self.rows),
        })
    }

    /// The area in the parameters that belongs to each point. Multiplied by the surface's area for a unit of the
    /// parameters there, it gives the area in mm².
    pub fn cell(&self) -> f64 {
        let [size_u, size_v] = sizes(self.patch);
        size_u * size_v / self.count() as f64
    }

    /// Returns the points around this box of parameters: all points inside, and at most one more on each side.
    pub fn points_around(&self, least: Parameter, most: Parameter) -> impl Iterator<Item = usize> + use<> {
        let range = |[least, most]: [f64; 2], [low, high]: [f64; 2], count: usize| {
            let index = |at: f64| ((at - low) / (high - low) * count as f64).clamp(0.0, count as f64) as usize;
            if most < low || least > high { 0..0 } else { index(least)..(index(most) + 1).min(count) }
        };
        let (low, high, columns) = (self.patch.low, self.patch.high, self.columns);
        let across = range([least.u, most.u], [low.u, high.u], columns);
        let down = range([least.v, most.v], [low.v, high.v], self.rows);
        down.flat_map(move |row| across.clone().map(move |column| row * columns + column))
    }
}

fn sizes(patch: ParameterPatch) -> [f64; 2] {
    [patch.high.u - patch.low.u, patch.high.v - patch.low.v]
}

/// Returns the length of the region along u and along v, through its middle, mm.
pub fn sides_mm(surface: &BSplineSurface) -> [f64; 2] {
    let point = |u: f64, v: f64| surface.point(Parameter { u, v });
    [point(0.0, 0.5).distance_mm(point(1.0, 0.5)), point(0.5, 0.0).distance_mm(point(0.5, 1.0))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::KnotVector;
    use panelprep_base::geometry::Point;

    /// A plane of 100 mm by 60 mm.
    fn plane() -> BSplineSurface {
        let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("knots");
        let corners = [(0.0, 0.0), (0.0, 60.0), (100.0, 0.0), (100.0, 60.0)];
        let controls = corners.map(|(x, y)| Point::at(x, y, 0.0)).to_vec();
        BSplineSurface::new([knots(), knots()], controls, Point::at(0.0, 0.0, 500.0)).expect("a surface")
    }

    /// By hand: the upper left quarter, 50 by 30 mm, with a spacing of at most 11 mm has 5 columns and 3 rows of
    /// points, the first point at (5, 5) mm. Each point has an area of 100 mm², which is 100/6000 of the parameters'
    /// square.
    #[test]
    fn places_are_spread_evenly() {
        let patch = ParameterPatch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 0.5, v: 0.5 } };
        let net = SampleGrid::from_patch(&plane(), patch, 11.0);
        assert_eq!((net.columns, net.rows, net.count()), (5, 3, 15));
        let [first, sixth] = [0, 5].map(|place| plane().point(net.parameter_at(place)));
        assert!(first.distance_mm(Point::at(5.0, 5.0, 0.0)) < 1e-9, "{first:?}");
        assert!(sixth.distance_mm(Point::at(5.0, 15.0, 0.0)) < 1e-9, "{sixth:?}");
        assert!((net.cell() - 1.0 / 60.0).abs() < 1e-12);
        assert_eq!(sides_mm(&plane()).map(f64::round), [100.0, 60.0]);
    }

    /// Calculated by hand: u from 0.15 to 0.25 meets columns 1 and 2, v from 0.4 meets row 2; a box beside the
    /// patch meets none.
    #[test]
    fn a_box_meets_the_places_around_it() {
        let patch = ParameterPatch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 0.5, v: 0.5 } };
        let net = SampleGrid::from_patch(&plane(), patch, 11.0);
        let around = |u: [f64; 2], v: [f64; 2]| {
            net.points_around(Parameter { u: u[0], v: v[0] }, Parameter { u: u[1], v: v[1] }).collect::<Vec<_>>()
        };
        assert_eq!(around([0.15, 0.25], [0.4, 0.45]), [11, 12]);
        assert_eq!(around([-1.0, 2.0], [-1.0, 2.0]), (0..15).collect::<Vec<_>>());
        assert!(around([0.6, 0.7], [0.1, 0.2]).is_empty() && around([0.1, 0.2], [-0.3, -0.1]).is_empty());
    }
}
