//! The correspondence set K of thesis Eq. 3.20: pairs of closest points.
//!
//! Pairs farther apart than a limit are dropped. The limit follows the median distance of all pairs down to a
//! floor, so that it decreases as the fit improves.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use panelprep_base::geometry::{Base, Panel, Point, Rigid, median};
use rayon::prelude::*;

/// The number of points that one task looks up. It is fixed, so that partial sums are the same for any number of
/// threads.
pub(super) const CHUNK: usize = 512;
/// Pairs with a distance above this multiple of the median distance are dropped.
const MAX_PAIR_MEDIANS: f64 = 3.0;

/// A search tree for nearest neighbours among points of the base frame.
pub(super) struct NeighbourTree(ImmutableKdTree<f64, 3>);

impl NeighbourTree {
    /// Creates a tree of these points; `None` for no points.
    pub fn from_points(points: impl Iterator<Item = Point<Base>>) -> Option<Self> {
        let rows: Vec<[f64; 3]> = points.map(|point| point.mm.into()).collect();
        if rows.is_empty() {
            return None;
        }
        ImmutableKdTree::new_from_slice(&rows).ok().map(NeighbourTree)
    }

    /// Returns the index of the closest point, and its distance in mm.
    pub fn closest_point(&self, point: Point<Base>) -> (usize, f64) {
        let found = self.0.query(&point.mm.into()).nearest_one::<SquaredEuclidean<f64>>().execute();
        (found.item as usize, found.distance.sqrt())
    }
}

/// A taught point and the scanned point closest to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClosestPair {
    /// The taught point, q of Eq. 3.20.
    pub taught: Point<Panel>,
    /// Index of the scanned point that is closest, p of Eq. 3.20.
    pub closest: usize,
    /// Distance between the two points, mm.
    pub distance_mm: f64,
}

/// Returns every taught point with its closest point, in the order of the taught points.
pub(super) fn closest_pairs(
    tree: &NeighbourTree,
    taught: &[Point<Panel>],
    base_from_panel: Rigid<Base, Panel>,
) -> Vec<ClosestPair> {
    let pair = |&taught: &Point<Panel>| {
        let moved = base_from_panel * taught;
        let (closest, distance_mm) = tree.closest_point(moved);
        ClosestPair { taught, closest, distance_mm }
    };
    taught.par_iter().with_min_len(CHUNK).map(pair).collect()
}

/// Returns the distance beyond which a pair is dropped: three medians, but at least the floor.
pub(super) fn distance_limit_mm(pairs: &[ClosestPair], floor_mm: f64) -> f64 {
    let mut distances: Vec<f64> = pairs.iter().map(|pair| pair.distance_mm).collect();
    median(&mut distances).map_or(floor_mm, |median_mm| (MAX_PAIR_MEDIANS * median_mm).max(floor_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An organized grid has thousands of equal coordinates in a row: the search must still find every point itself.
    #[test]
    fn organised_rows_are_found() {
        let points: Vec<Point<Base>> =
            (0..6_400).map(|i| Point::at(600.0, f64::from(i % 80) * 0.5, f64::from(i / 80) * 0.5)).collect();
        let tree = NeighbourTree::from_points(points.iter().copied()).expect("points");
        for (index, point) in points.iter().enumerate() {
            assert_eq!(tree.closest_point(*point), (index, 0.0));
        }
        // By hand: a place 3 mm in front of the grid and 0.1 mm beside a point has the distance √(9 + 0.01) from
        // this point.
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
