//! What stands in the cell as a scan shows it: points that no part of the arm may come near.
//!
//! Boxes of the cell's file say what always stands there; these say what stands there now: the panel where it was found, and
//! everything else that the scan saw. What the scan did not see is not known: behind obstacles the boxes must do.

use super::obstacle::Obstacle;
use crate::geometry::{Base, Point};
use crate::path::kinematics::{Angles, Kinematics};
use std::collections::BTreeMap;

/// Of all points in a cube of this side one is kept, mm.
const CUBE_MM: f64 = 8.0;

/// Points by what they are of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Obstacles(Vec<(&'static str, Vec<Point<Base>>)>);

impl Obstacles {
    /// With the points of another thing, thinned.
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
}

/// No part of the arm, nor the tool with its tip there, too near to any of the points.
pub(super) fn keeps_off(arm: &Kinematics, tip: Point<Base>, at: &Angles) -> Result<(), Obstacle> {
    let Some(obstacles) = arm.obstacles() else { return Ok(()) };
    for (part, from, to, needed_mm) in super::margins::parts(arm, tip, at) {
        for (name, points) in &obstacles.0 {
            let distance_mm =
                points.iter().map(|point| from_line_mm(*point, from, to)).fold(f64::INFINITY, f64::min);
            if distance_mm < needed_mm {
                return Err(Obstacle::KeepOut { part, name: (*name).to_owned(), distance_mm, needed_mm });
            }
        }
    }
    Ok(())
}

/// The distance of a point from the line between two others, mm.
fn from_line_mm(point: Point<Base>, from: Point<Base>, to: Point<Base>) -> f64 {
    let (way, arm) = ((to - from).mm, (point - from).mm);
    let share = (arm.dot(&way) / way.norm_squared().max(1e-9)).clamp(0.0, 1.0);
    (arm - way * share).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::geometry::{Flange, Joints, KukaPose, Rigid, Tool, Vector};
    use crate::path::reach::{Leg, follow};
    use nalgebra::Vector3;
    use std::sync::Arc;

    /// By hand: (30, 40, 0) is 40 mm beside the line from the origin along X, (−30, 40, 0) 50 mm from its beginning.
    #[test]
    fn distances_from_a_line() {
        let line =
            |x: f64| from_line_mm(Point::at(x, 40.0, 0.0), Point::at(0.0, 0.0, 0.0), Point::at(100.0, 0.0, 0.0));
        assert!((line(30.0) - 40.0).abs() < 1e-12 && (line(-30.0) - 50.0).abs() < 1e-12);
    }

    /// Points of one cube are one, the first, whether they follow each other or not.
    #[test]
    fn points_are_thinned() {
        let obstacles = Obstacles::default().with("panel", [1.0, 2.0, 9.0, 3.0].map(|x| Point::at(x, 0.0, 0.0)));
        assert_eq!(obstacles.0[0].1, [1.0, 9.0].map(|x| Point::at(x, 0.0, 0.0)));
    }

    /// A tool of 120 mm goes 60 mm along its axis; what stands 30 mm before its end is too near for the 40 mm that it keeps,
    /// what stands 60 mm before is not.
    #[test]
    fn a_line_that_comes_too_near_to_the_panel_is_refused() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|error| panic!("{error}"));
        let bare = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let at = Joints { a2_deg: -90.0, a3_deg: 90.0, a5_deg: 30.0, ..Joints::default() };
        let start = bare.base_from_flange(&at).expect("finite") * tool;
        let ahead = |mm: f64| start * Rigid::<Tool, Tool>::identity().displaced(Vector::new(Vector3::z() * mm));
        let leg = Leg { base_from_tool: ahead(60.0), feed_mm_s: 50.0, blend_mm: 0.0 };
        let follows = |before_mm: f64| {
            let obstacles = Obstacles::default().with("panel", [ahead(60.0 + before_mm).origin()]);
            follow(&bare.clone().beside(Arc::new(obstacles)), tool, Some(&at), &[leg])
        };
        let met = follows(30.0).expect_err("too near").obstacle;
        assert!(matches!(&met, Obstacle::KeepOut { part: "tool", name, .. } if name == "panel"), "{met}");
        assert!(follows(60.0).is_ok());
    }
}
