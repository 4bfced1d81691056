//! Objects in the cell as a scan shows them: points from which all parts of the arm must keep their distances.
//!
//! The boxes of the cell's file describe the permanent objects. These points describe the present objects: the panel at
//! its measured pose, and all other objects that the scan saw. Objects that the scan did not see are not known: behind
//! an object only the boxes protect the arm.

use panelprep_base::geometry::{Base, Point};
use std::collections::BTreeMap;

/// Side of a cube of which only one point is stored, mm.
const CUBE_MM: f64 = 8.0;

/// Side of a cube whose points are checked together, mm.
const BLOCK_MM: f64 = 64.0;
/// Maximum rounding error of a distance, mm.
const ROUNDING_MM: f64 = 1e-6;

/// Points of all obstacles, grouped by the obstacle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Obstacles(Vec<Obstacle>);

/// One object in the cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Obstacle {
    pub(super) name: &'static str,
    blocks: Vec<Block>,
}

/// Points of one block, and their bounding sphere.
#[derive(Debug, Clone, PartialEq)]
struct Block {
    points: Vec<Point<Base>>,
    middle: Point<Base>,
    radius_mm: f64,
}

impl Obstacles {
    /// Returns the obstacles with another obstacle added, whose points are thinned.
    #[must_use]
    pub fn with_points_of(
        mut self,
        name: &'static str,
        points: impl IntoIterator<Item = Point<Base>>,
    ) -> Obstacles {
        let cube = |point: &Point<Base>| [0, 1, 2].map(|axis| (point.mm[axis] / CUBE_MM).floor() as i64);
        let (mut kept, mut last) = (BTreeMap::new(), None);
        for point in points {
            // Adjacent points of a scan are usually in the same cube, so the cube of the last point is compared first.
            let at = Some(cube(&point)).filter(|at| last != Some(*at));
            if let Some(at) = at {
                kept.entry(at).or_insert(point);
                last = Some(at);
            }
        }
        self.0.push(Obstacle { name, blocks: group_into_blocks(kept.into_values()) });
        self
    }

    /// Returns the obstacles, each with its points.
    pub(super) fn obstacles(&self) -> &[Obstacle] {
        &self.0
    }
}

impl Obstacle {
    /// Returns the smallest distance of the obstacle's points, mm; `distance_mm` returns the distance of one point.
    /// `None` if all points are farther away than `needed_mm`. Blocks whose bounding sphere is too far away are
    /// skipped.
    pub(super) fn smallest_distance_mm(
        &self,
        needed_mm: f64,
        distance_mm: impl Fn(Point<Base>) -> f64,
    ) -> Option<f64> {
        let may_be_near = |block: &&Block| distance_mm(block.middle) - block.radius_mm <= needed_mm + ROUNDING_MM;
        let near = self.blocks.iter().filter(may_be_near).flat_map(|block| &block.points);
        let least_mm = near.map(|point| distance_mm(*point)).fold(f64::INFINITY, f64::min);
        (least_mm < needed_mm).then_some(least_mm)
    }
}

fn group_into_blocks(points: impl Iterator<Item = Point<Base>>) -> Vec<Block> {
    let mut together: BTreeMap<[i64; 3], Vec<Point<Base>>> = BTreeMap::new();
    for point in points {
        let cube = [0, 1, 2].map(|axis| (point.mm[axis] / BLOCK_MM).floor() as i64);
        together.entry(cube).or_default().push(point);
    }
    let block = |points: Vec<Point<Base>>| {
        let bound = |axis: usize, of: fn(f64, f64) -> f64| points.iter().map(|point| point.mm[axis]).reduce(of);
        let middle = [0, 1, 2].map(|axis| {
            let (least, most) = (bound(axis, f64::min), bound(axis, f64::max));
            0.5 * (least.unwrap_or_default() + most.unwrap_or_default())
        });
        let middle = Point::at(middle[0], middle[1], middle[2]);
        let radius_mm = points.iter().map(|point| point.distance_mm(middle)).fold(0.0, f64::max);
        Block { points, middle, radius_mm }
    };
    together.into_values().map(block).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Only the first point in a cube is stored, also if the points in the cube are not consecutive.
    #[test]
    fn points_are_thinned() {
        let obstacles =
            Obstacles::default().with_points_of("panel", [1.0, 2.0, 9.0, 3.0].map(|x| Point::at(x, 0.0, 0.0)));
        let kept: Vec<Point<Base>> = obstacles.0[0].blocks.iter().flat_map(|block| block.points.clone()).collect();
        assert_eq!(kept, [1.0, 9.0].map(|x| Point::at(x, 0.0, 0.0)));
    }

    proptest! {
        /// The search by blocks finds the same nearest point as a search over all points.
        #[test]
        fn the_nearest_point_is_the_nearest_of_all(
            points in prop::collection::vec(prop::array::uniform3(-300.0..300.0f64), 1..300),
            from in prop::array::uniform3(-300.0..300.0f64),
            needed_mm in 0.0..200.0f64,
        ) {
            let points = points.into_iter().map(|[x, y, z]| Point::at(x, y, z));
            let obstacles = Obstacles::default().with_points_of("panel", points);
            let distance_mm = |point: Point<Base>| point.distance_mm(Point::at(from[0], from[1], from[2]));
            let all = obstacles.0[0].blocks.iter().flat_map(|block| &block.points);
            let least_mm = all.map(|point| distance_mm(*point)).fold(f64::INFINITY, f64::min);
            let found = obstacles.0[0].smallest_distance_mm(needed_mm, distance_mm);
            prop_assert_eq!(found, (least_mm < needed_mm).then_some(least_mm));
        }
    }
}
