//! Point-to-point ICP, the thesis's method (3.8), only for comparison.
//!
//! The method minimises  E(ᵇT_w) = Σ ‖p − ᵇT_w q‖²  over the pairs (p, q) of K, q taught and p scanned (3.21). Each
//! step is the least-squares rigid motion of its pairs (`geometry::fit_rigid_motion`). A smooth panel slides along
//! itself under this cost: the result has an error of millimetres, which the method does not report. Source: thesis
//! 3.8.
//!
//! K is the correspondence set of thesis Eq. 3.20: pairs of closest points. Pairs farther apart than a limit are
//! excluded. The limit is a multiple of the median distance of all pairs, but has a lower bound, so that it decreases
//! as the fit improves.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use panelprep_base::geometry::{Base, Panel, Point, Rigid, fit_rigid_motion, median};
use rayon::prelude::*;

/// Number of points for which one task searches the closest points. The number is fixed, so that partial sums are the
/// same for any number of threads.
const CHUNK_SIZE: usize = 512;
/// Maximum distance of a pair, as a multiple of the median distance; other pairs are excluded.
const MAX_PAIR_MEDIANS: f64 = 3.0;

/// A search tree for nearest neighbours among points of the base frame.
struct NeighbourTree(ImmutableKdTree<f64, 3>);

impl NeighbourTree {
    /// Creates a search tree of these points; `None` without points.
    pub fn from_points(points: impl Iterator<Item = Point<Base>>) -> Option<Self> {
        let rows: Vec<[f64; 3]> = points.map(|point| point.mm.into()).collect();
        if rows.is_empty() {
            return None;
        }
        ImmutableKdTree::new_from_slice(&rows).ok().map(NeighbourTree)
    }

    /// Returns the index of the closest point, and its distance, mm.
    pub fn closest_point(&self, point: Point<Base>) -> (usize, f64) {
        let found = self.0.query(&point.mm.into()).nearest_one::<SquaredEuclidean<f64>>().execute();
        (found.item as usize, found.distance.sqrt())
    }
}

/// A taught point and the scanned point closest to it.
#[derive(Debug, Clone, Copy)]
struct ClosestPair {
    /// The taught point, q of Eq. 3.20.
    pub taught: Point<Panel>,
    /// Index of the closest scanned point, p of Eq. 3.20.
    pub closest: usize,
    /// Distance between the two points, mm.
    pub distance_mm: f64,
}

/// Returns every taught point with its closest scanned point, in the order of the taught points.
fn closest_pairs(
    tree: &NeighbourTree,
    taught: &[Point<Panel>],
    base_from_panel: Rigid<Base, Panel>,
) -> Vec<ClosestPair> {
    let pair = |&taught: &Point<Panel>| {
        let moved = base_from_panel * taught;
        let (closest, distance_mm) = tree.closest_point(moved);
        ClosestPair { taught, closest, distance_mm }
    };
    taught.par_iter().with_min_len(CHUNK_SIZE).map(pair).collect()
}

/// Returns the maximum distance of a pair that is used, mm: three times the median distance, but at least `floor_mm`.
fn distance_limit_mm(pairs: &[ClosestPair], floor_mm: f64) -> f64 {
    let mut distances: Vec<f64> = pairs.iter().map(|pair| pair.distance_mm).collect();
    median(&mut distances).map_or(floor_mm, |median_mm| (MAX_PAIR_MEDIANS * median_mm).max(floor_mm))
}

/// Lower limit of the distance beyond which a pair is excluded, mm, however good the fit is.
const MIN_DROP_DISTANCE_MM: f64 = 5.0;
/// Maximum displacement in the last step, at which the iteration ends, mm.
const CONVERGED_STEP_MM: f64 = 0.002;
const MAX_STEPS: usize = 100;

/// Moves the taught points onto the scanned ones, starting at a start pose.
pub fn thesis_icp(
    taught: &[Point<Panel>],
    scanned: &[Point<Base>],
    start: Rigid<Base, Panel>,
) -> Rigid<Base, Panel> {
    let Some(tree) = NeighbourTree::from_points(scanned.iter().copied()) else { return start };
    let mut base_from_panel = start;
    for _ in 0..MAX_STEPS {
        let all = closest_pairs(&tree, taught, base_from_panel);
        let limit_mm = distance_limit_mm(&all, MIN_DROP_DISTANCE_MM);
        let near = all.iter().filter(|pair| pair.distance_mm <= limit_mm);
        let matched: Vec<_> = near.map(|pair| (pair.taught, scanned[pair.closest])).collect();
        let Some(next) = fit_rigid_motion(&matched) else { break };
        let step_mm = taught.iter().map(|&point| base_from_panel.distance_at_mm(next, point)).fold(0.0, f64::max);
        base_from_panel = next;
        if step_mm < CONVERGED_STEP_MM {
            break;
        }
    }
    base_from_panel
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An organised grid has thousands of equal coordinates in a row: the search must still find every point.
    #[test]
    fn every_point_of_an_organised_grid_is_found() {
        let points: Vec<Point<Base>> =
            (0..6_400).map(|i| Point::at(600.0, f64::from(i % 80) * 0.5, f64::from(i / 80) * 0.5)).collect();
        let tree = NeighbourTree::from_points(points.iter().copied()).expect("points");
        for (index, point) in points.iter().enumerate() {
            assert_eq!(tree.closest_point(*point), (index, 0.0));
        }
        // Expected value, calculated by hand: a point 3 mm in front of the grid and 0.1 mm beside a grid point has the
        // distance √(9 + 0.01) from it.
        let (index, distance_mm) = tree.closest_point(Point::at(597.0, 1.6, 0.0));
        assert_eq!(index, 3);
        assert!((distance_mm - 9.01f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_limit_is_three_medians_and_not_below_the_floor() {
        let pair = |distance_mm| ClosestPair { taught: Point::at(0.0, 0.0, 0.0), closest: 0, distance_mm };
        let pairs = [9.0, 1.0, 2.0].map(pair);
        assert!((distance_limit_mm(&pairs, 1.0) - 6.0).abs() < 1e-12);
        assert!((distance_limit_mm(&pairs, 7.0) - 7.0).abs() < 1e-12);
    }
}
