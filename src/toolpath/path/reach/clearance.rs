//! Checks whether the arm keeps clear of the obstacles that a scan showed.

use super::infeasible::Infeasibility;
use super::margins::{TOOL, parts};
use crate::path::kinematics::{JointAngles, Kinematics};
use crate::path::obstacles::Obstacle;
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid, Tool};

/// Largest distance of the tool from an obstacle that is required at the end of a checked path, mm. Elsewhere the
/// configured distance is required; the arc of all axes from 40 mm over the demonstration's panel brings the rim of the
/// disc down to 11.8 mm. The obstacles' points are thinned to 8 mm, which makes a distance of 8 mm appear as up to 10 mm.
const DEPARTURE_MM: f64 = 10.0;
/// Smallest distance of the tool that shows that it does not pass through a surface, mm: between points that are
/// thinned to 8 mm, a line keeps smaller distances from all of them.
const MESH_MM: f64 = 8.0;
/// Distance that the arm's body may lose on such a motion, mm. Its configured distance contains half of its thickness.
const BODY_SLACK_MM: f64 = 1.0;

/// Checks that neither a part of the arm nor the tool with its tip at this point is too near to any obstacle point.
pub(super) fn check_clearance(arm: &Kinematics, tip: Point<Base>, at: &JointAngles) -> Result<(), Infeasibility> {
    let Some(obstacles) = arm.obstacles() else { return Ok(()) };
    for (index, (part, from, to, needed_mm)) in parts(arm, tip, at).into_iter().enumerate() {
        for (number, obstacle) in obstacles.obstacles().iter().enumerate() {
            let needed_mm = arm.least_mm(number).map_or(needed_mm, |least_mm| least_mm[index]);
            let nearer_mm = obstacle.smallest_distance_mm(needed_mm, |point| from_line_mm(point, from, to));
            if let Some(distance_mm) = nearer_mm {
                let name = obstacle.name.to_owned();
                return Err(Infeasibility::KeepOut { part, name, distance_mm, needed_mm });
            }
        }
    }
    Ok(())
}

/// Returns whether the arm with this tool keeps the configured distances from the obstacles at these axis angles.
pub fn is_clear(arm: &Kinematics, flange_from_tool: Rigid<Flange, Tool>, at: &Joints) -> bool {
    let tip = arm.base_from_flange(at).map(|flange| (flange * flange_from_tool).origin());
    tip.is_some_and(|tip| check_clearance(arm, tip, &at.degrees()).is_ok())
}

/// Returns the arm at the end of a checked path that led near to an obstacle: on a motion that begins with these axis
/// angles, its tool may come as near as [`DEPARTURE_MM`], or half of the distance at the start if that is smaller, but not
/// nearer than [`MESH_MM`]. Its body may not come nearer than configured, or than at the start if that is smaller. `None`
/// if the angles are not finite.
pub fn departing(arm: &Kinematics, from: &Joints, flange_from_tool: Rigid<Flange, Tool>) -> Option<Kinematics> {
    let tip = (arm.base_from_flange(from)? * flange_from_tool).origin();
    let Some(obstacles) = arm.obstacles() else { return Some(arm.clone()) };
    let parts = parts(arm, tip, &from.degrees());
    let of_obstacle = |obstacle: &Obstacle| {
        parts.map(|(part, from, to, needed_mm)| {
            let nearer_mm = obstacle.smallest_distance_mm(needed_mm, |point| from_line_mm(point, from, to));
            let start_mm = nearer_mm.unwrap_or(needed_mm);
            match part {
                TOOL => (0.5 * start_mm).clamp(MESH_MM, DEPARTURE_MM).min(needed_mm),
                _ => start_mm - BODY_SLACK_MM,
            }
        })
    };
    let least_mm = obstacles.obstacles().iter().map(of_obstacle).collect();
    Some(arm.clone().with_least_distances(least_mm))
}

/// Returns the distance of a point from the line between two others, mm.
fn from_line_mm(point: Point<Base>, from: Point<Base>, to: Point<Base>) -> f64 {
    let (way, arm) = ((to - from).mm, (point - from).mm);
    let share = (arm.dot(&way) / way.norm_squared().max(1e-9)).clamp(0.0, 1.0);
    (arm - way * share).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::obstacles::Obstacles;
    use crate::path::reach::{PathLine, follow_path};
    use nalgebra::Vector3;
    use panelprep_base::geometry::{KukaPose, Vector};
    use panelprep_cell::cell::Cell;
    use std::sync::Arc;

    /// Calculated by hand: (30, 40, 0) is 40 mm beside the line from the origin along X, (−30, 40, 0) is 50 mm from
    /// the line's beginning.
    #[test]
    fn distances_from_a_line() {
        let line =
            |x: f64| from_line_mm(Point::at(x, 40.0, 0.0), Point::at(0.0, 0.0, 0.0), Point::at(100.0, 0.0, 0.0));
        assert!((line(30.0) - 40.0).abs() < 1e-12 && (line(-30.0) - 50.0).abs() < 1e-12);
    }

    /// A tool of 120 mm moves 60 mm along its axis. An object 30 mm ahead of its end is too near for the required
    /// 40 mm, an object 60 mm ahead is not.
    #[test]
    fn a_line_that_comes_too_near_to_the_panel_is_refused() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|error| panic!("{error}"));
        let bare = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let at = Joints { a2_deg: -90.0, a3_deg: 90.0, a5_deg: 30.0, ..Joints::default() };
        let start = bare.base_from_flange(&at).expect("finite") * tool;
        let ahead = |mm: f64| {
            start * Rigid::<Tool, Tool>::identity().followed_by_displacement(Vector::new(Vector3::z() * mm))
        };
        let leg = PathLine { base_from_tool: ahead(60.0), feed_mm_s: 50.0, blend_mm: 0.0 };
        let follows = |before_mm: f64| {
            let obstacles = Obstacles::default().with_points_of("panel", [ahead(60.0 + before_mm).origin()]);
            follow_path(&bare.clone().with_obstacles(Arc::new(obstacles)), tool, Some(&at), &[leg])
        };
        let met = follows(30.0).expect_err("too near").cause;
        assert!(matches!(&met, Infeasibility::KeepOut { part: "tool", name, .. } if name == "panel"), "{met}");
        assert!(follows(60.0).is_ok());
    }
}
