//! Parts of the region's surface: patches, sample points over a patch, and the areas that a path treats.
//!
//! A grid is a patch of the region's single surface: a rectangle of parameters. Adjacent grids join as smoothly as the
//! surface itself. A separate surface for each grid, as in the thesis's Fig. 4.22, would not achieve this. The effects
//! of a path are calculated at sample points that are uniformly distributed over a patch. A path treats whole grids, or
//! rectangular patches around breaks.

use super::bspline::{BSplineSurface, Parameter};
use panelprep_cell::panel::{GridId, Region};

/// The areas that a path treats, with the grids in which they lie. The record identifies an area by its grids, and
/// sanding passes are counted for each grid.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Treated {
    grids: Vec<GridId>,
    areas: Option<Vec<ParameterPatch>>,
    broken: Option<Vec<Parameter>>,
    uncertainty_mm: f64,
}

impl Treated {
    /// Creates the treatment of these whole grids.
    pub fn from_grids(grids: &[GridId]) -> Self {
        Treated { grids: grids.to_vec(), ..Treated::default() }
    }

    /// Returns the treatment of whole grids instead of these areas. The break points in these grids are kept.
    #[must_use]
    pub fn as_whole_grids(&self, region: &Region, grids: &[GridId]) -> Self {
        let patches: Vec<ParameterPatch> =
            grids.iter().filter_map(|id| ParameterPatch::for_grid(region, *id)).collect();
        let in_grids = |at: &&Parameter| patches.iter().any(|patch| patch.holds(**at));
        let broken = self.broken.as_ref().map(|broken| broken.iter().filter(in_grids).copied().collect());
        Treated { broken, uncertainty_mm: self.uncertainty_mm, ..Treated::from_grids(grids) }
    }

    /// Creates the treatment of these areas, with the break points that lie in them. Its grids are those that the areas
    /// cover in part, row by row.
    pub fn from_areas(region: &Region, areas: Vec<ParameterPatch>, broken: Vec<Parameter>) -> Self {
        let extends_into = |id: &GridId| areas.iter().any(|area| area.part_in(region, *id).is_some());
        let grids = region.ids().filter(extends_into).collect();
        Treated { grids, areas: Some(areas), broken: Some(broken), uncertainty_mm: 0.0 }
    }

    /// Sets the uncertainty of the break points' positions on the panel, mm.
    #[must_use]
    pub fn with_uncertainty_mm(self, uncertainty_mm: f64) -> Self {
        Treated { uncertainty_mm, ..self }
    }

    /// Returns the uncertainty of the break points' positions on the panel, mm.
    pub fn uncertainty_mm(&self) -> f64 {
        self.uncertainty_mm
    }

    /// Returns the grids in which the areas lie.
    pub fn grids(&self) -> &[GridId] {
        &self.grids
    }

    /// Returns the areas that are treated; `None` if whole grids are treated.
    pub fn areas(&self) -> Option<&[ParameterPatch]> {
        self.areas.as_deref()
    }

    /// Returns the break points that the disc must reach; `None` if the recipe requires that whole grids are treated.
    pub fn broken(&self) -> Option<&[Parameter]> {
        self.broken.as_deref()
    }

    /// Returns whether a point in one of the grids is treated.
    pub fn holds(&self, at: Parameter) -> bool {
        self.areas().is_none_or(|areas| areas.iter().any(|area| area.holds(at)))
    }
}

/// Sample points in rows and columns, each at the centre of its cell of the patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleGrid {
    /// The patch over which the points are distributed.
    pub patch: ParameterPatch,
    /// Number of points along u.
    pub columns: usize,
    /// Number of points along v.
    pub rows: usize,
}

impl SampleGrid {
    /// Creates sample points at about this distance, mm, measured through the middle of the patch.
    pub fn from_patch(surface: &BSplineSurface, patch: ParameterPatch, spacing_mm: f64) -> Self {
        let middle = surface.tangents(patch.parameter_at(Parameter { u: 0.5, v: 0.5 }));
        let count = |length_mm: f64| (length_mm / spacing_mm).ceil().max(1.0) as usize;
        let [size_u, size_v] = sizes(patch);
        let (columns, rows) = (count(middle.s_u.mm.norm() * size_u), count(middle.s_v.mm.norm() * size_v));
        SampleGrid { patch, columns, rows }
    }

    /// Returns the number of sample points.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns the parameters of a sample point; points are numbered row by row.
    pub fn parameter_at(&self, place: usize) -> Parameter {
        let share = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        self.patch.parameter_at(Parameter {
            u: share(place % self.columns, self.columns),
            v: share(place / self.columns, self.rows),
        })
    }

    /// Returns the area of a cell in the parameters. Multiplied by the surface area per unit of the parameters at the
    /// point, this is the area in mm².
    pub fn cell(&self) -> f64 {
        let [size_u, size_v] = sizes(self.patch);
        size_u * size_v / self.count() as f64
    }

    /// Returns the sample points around this box of parameters: all points inside, and at most one more on each side.
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

/// Returns the lengths of the region along u and along v, through its middle, mm.
pub fn sides_mm(surface: &BSplineSurface) -> [f64; 2] {
    let point = |u: f64, v: f64| surface.point(Parameter { u, v });
    [point(0.0, 0.5).distance_mm(point(1.0, 0.5)), point(0.5, 0.0).distance_mm(point(0.5, 1.0))]
}

/// A rectangle in the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterPatch {
    /// Minimum u and v.
    pub low: Parameter,
    /// Maximum u and v.
    pub high: Parameter,
}

impl ParameterPatch {
    /// Returns the patch of one grid; `None` if the region has no such grid.
    pub fn for_grid(region: &Region, id: GridId) -> Option<Self> {
        let known = (1..=region.rows).contains(&id.row) && (1..=region.columns).contains(&id.column);
        known.then(|| {
            let [low, high] = region.grid_bounds(id);
            ParameterPatch { low: Parameter { u: low.x, v: low.y }, high: Parameter { u: high.x, v: high.y } }
        })
    }

    /// Returns the part of this patch in a grid; `None` if the part has no area, or the region has no such grid.
    pub fn part_in(&self, region: &Region, id: GridId) -> Option<Self> {
        let grid = ParameterPatch::for_grid(region, id)?;
        let low = Parameter { u: self.low.u.max(grid.low.u), v: self.low.v.max(grid.low.v) };
        let high = Parameter { u: self.high.u.min(grid.high.u), v: self.high.v.min(grid.high.v) };
        (low.u < high.u && low.v < high.v).then_some(ParameterPatch { low, high })
    }

    /// Returns whether these parameters lie in the patch or on its border.
    pub fn holds(&self, at: Parameter) -> bool {
        (self.low.u..=self.high.u).contains(&at.u) && (self.low.v..=self.high.v).contains(&at.v)
    }

    /// Returns the parameters at these fractions of the patch's sides.
    pub fn parameter_at(&self, share: Parameter) -> Parameter {
        Parameter {
            u: self.low.u + (self.high.u - self.low.u) * share.u,
            v: self.low.v + (self.high.v - self.low.v) * share.v,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::KnotVector;
    use panelprep_base::geometry::Point;
    use panelprep_cell::recipe::Recipe;

    /// A plane of 100 mm by 60 mm.
    fn plane() -> BSplineSurface {
        let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("knots");
        let corners = [(0.0, 0.0), (0.0, 60.0), (100.0, 0.0), (100.0, 60.0)];
        let controls = corners.map(|(x, y)| Point::at(x, y, 0.0)).to_vec();
        BSplineSurface::new([knots(), knots()], controls, Point::at(0.0, 0.0, 500.0)).expect("a surface")
    }

    /// Expected values, calculated by hand: the upper left quarter, 50 by 30 mm, with a distance of at most 11 mm has 5
    /// columns and 3 rows of points, the first point at (5, 5) mm. Each point has an area of 100 mm², which is 100/6000
    /// of the parameters' square.
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

    /// Expected values, calculated by hand: u from 0.15 to 0.25 contains columns 1 and 2, v from 0.4 contains row 2; a
    /// box beside the patch contains no point.
    #[test]
    fn a_box_selects_the_places_around_it() {
        let patch = ParameterPatch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 0.5, v: 0.5 } };
        let net = SampleGrid::from_patch(&plane(), patch, 11.0);
        let around = |u: [f64; 2], v: [f64; 2]| {
            net.points_around(Parameter { u: u[0], v: v[0] }, Parameter { u: u[1], v: v[1] }).collect::<Vec<_>>()
        };
        assert_eq!(around([0.15, 0.25], [0.4, 0.45]), [11, 12]);
        assert_eq!(around([-1.0, 2.0], [-1.0, 2.0]), (0..15).collect::<Vec<_>>());
        assert!(around([0.6, 0.7], [0.1, 0.2]).is_empty() && around([0.1, 0.2], [-0.3, -0.1]).is_empty());
    }

    /// Calculated by hand: 2 × 5 grids are 0.2 wide and 0.5 high. An area from 0.15 to 0.25 along u and 0.1 to 0.5
    /// along v covers parts of r1c1 and r1c2; it ends at the border of the second row. u = 0.3 is beside the area.
    #[test]
    fn an_area_has_the_grids_into_which_it_extends() {
        let text = "panel = \"p\"\nregion = { corners_px = [[0, 0], [500, 0], [500, 200], [0, 200]], rows = 2, \
                    columns = 5 }\nlocate.box_min_mm = [0, 0, 0]\nlocate.box_max_mm = [1, 1, 1]\n";
        let recipe = Recipe::check("f", text).unwrap_or_else(|problems| panic!("{problems}"));
        let region = Region::new(recipe.region()).expect("convex");
        let area = ParameterPatch { low: Parameter { u: 0.15, v: 0.1 }, high: Parameter { u: 0.25, v: 0.5 } };
        let broken = vec![Parameter { u: 0.16, v: 0.2 }, Parameter { u: 0.21, v: 0.2 }];
        let treated = Treated::from_areas(&region, vec![area], broken.clone());
        assert_eq!(treated.grids(), [GridId { row: 1, column: 1 }, GridId { row: 1, column: 2 }]);
        assert!(treated.holds(Parameter { u: 0.2, v: 0.3 }) && !treated.holds(Parameter { u: 0.3, v: 0.3 }));
        let whole = Treated::from_grids(treated.grids());
        assert!(whole.areas().is_none() && whole.holds(Parameter { u: 0.3, v: 0.3 }));
        let second = treated.as_whole_grids(&region, &[GridId { row: 1, column: 2 }]);
        assert!(second.areas().is_none() && second.holds(Parameter { u: 0.3, v: 0.3 }));
        assert_eq!((second.grids().len(), second.broken()), (1, Some(&broken[1..])), "0.16 lies in r1c1");
        let part = area.part_in(&region, GridId { row: 1, column: 2 }).expect("it extends into it");
        assert_eq!((part.low, part.high), (Parameter { u: 0.2, v: 0.1 }, Parameter { u: 0.25, v: 0.5 }));
    }
}
