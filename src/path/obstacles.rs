//! What stands in the cell as a scan shows it: points that no part of the arm may come near.
//!
//! Boxes of the cell's file say what always stands there; these say what stands there now: the panel where it was found, and
//! everything else that the scan saw. What the scan did not see is not known: behind obstacles only the boxes protect the arm.

use crate::geometry::{Base, Point};
use std::collections::BTreeMap;

/// Of all points in a cube of this side one is kept, mm.
const CUBE_MM: f64 = 8.0;

/// Points of obstacles, by the name of each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Obstacles(Vec<(&'static str, Vec<Point<Base>>)>);

impl Obstacles {
    /// With the points of another obstacle, thinned.
    #[must_use]
    pub fn with(mut self, name: &'static str, points: impl IntoIterator<Item = Point<Base>>) -> Obstacles {
        let cube = |point: &Point<Base>| [0, 1, 2].map(|axis| (point.mm[axis] / CUBE_MM).floor() as i64);
        let (mut kept, mut last) = (BTreeMap::new(), None);
        for point in points {
            // Neighbours in a scan mostly share a cube.
            let at = Some(cube(&point)).filter(|at| last != Some(*at));
            if let Some(at) = at {
                kept.entry(at).or_insert(point);
                last = Some(at);
            }
        }
        self.0.push((name, kept.into_values().collect()));
        self
    }

    /// Each obstacle's name and points.
    pub(super) fn of_each(&self) -> &[(&'static str, Vec<Point<Base>>)] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of one cube are one, the first, whether they follow each other or not.
    #[test]
    fn points_are_thinned() {
        let obstacles = Obstacles::default().with("panel", [1.0, 2.0, 9.0, 3.0].map(|x| Point::at(x, 0.0, 0.0)));
        assert_eq!(obstacles.0[0].1, [1.0, 9.0].map(|x| Point::at(x, 0.0, 0.0)));
    }
}
