//! Checks whether all axes may turn together from one position to another, as `move_j` does.
//!
//! No line is followed, so singularities do not matter; the margins from the axis limits also apply only to lines. The
//! checks that remain are the limits themselves, the keep-out boxes and the obstacles of the scan, in steps of at most
//! 0.4° of the axis that turns farthest.

use super::clearance::check_clearance;
use super::infeasible::Infeasibility;
use super::margins::check_keep_out;
use crate::path::kinematics::{JointAngles, Kinematics};
use panelprep_base::geometry::{Flange, Joints, Rigid, Tool};

/// Largest turn of an axis between two checked poses, degrees: at a radius of 1 m the tip moves by 7 mm, less than the
/// smallest distance that is kept from a surface, 8 mm.
const STEP_DEG: f64 = 0.4;

/// Checks a motion with this tool in which all axes turn from the first angles to the second ones in proportion.
///
/// # Errors
/// The obstacle or limit.
pub fn joint_motion(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    from: &Joints,
    to: &Joints,
) -> Result<(), Infeasibility> {
    let (from, to) = (from.degrees(), to.degrees());
    if from.iter().chain(&to).any(|angle| !angle.is_finite()) {
        return Err(Infeasibility::NotFinite);
    }
    let axes = arm.arm().axes();
    for (axis, &angle_deg) in to.iter().enumerate() {
        let allowed_deg = [axes.min_deg[axis], axes.max_deg[axis]];
        if !(allowed_deg[0]..=allowed_deg[1]).contains(&angle_deg) {
            return Err(Infeasibility::AxisLimit { axis: axis + 1, angle_deg, allowed_deg });
        }
    }
    let farthest_deg = (0..6).map(|axis| (to[axis] - from[axis]).abs()).fold(0.0, f64::max);
    let steps = (farthest_deg / STEP_DEG).ceil().max(1.0) as usize;
    for step in 0..=steps {
        let share = step as f64 / steps as f64;
        let at: JointAngles = std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * share);
        let base_from_flange = arm.base_from_flange(&Joints::from(at)).ok_or(Infeasibility::NotFinite)?;
        let tip = (base_from_flange * flange_from_tool).origin();
        // A motion out of a keep-out box is permitted.
        if step > 0 {
            check_keep_out(arm, tip, &at)?;
        }
        check_clearance(arm, tip, &at)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::reach::{Obstacles, departing};
    use panelprep_base::geometry::{KukaPose, Point};
    use panelprep_cell::cell::Cell;
    use std::sync::Arc;

    fn turn(a1_deg: f64) -> Joints {
        Joints { a1_deg, a2_deg: -90.0, a3_deg: 90.0, a5_deg: 30.0, ..Joints::default() }
    }

    /// A post stands beside the arm, 45° to the right (A1 = 45, as KUKA counts): a turn from 0 to 90° passes over
    /// it, a turn to the left does not. Calculated by hand: the wrist moves at 25 + 365 = 390 mm from axis 1.
    #[test]
    fn a_swing_sweeps_what_lies_between() {
        let post = "[[keep_out]]\nname = 'post'\nmin_mm = [250, -300, 0]\nmax_mm = [300, -250, 900]\n";
        let cell = Cell::check("cell.toml", post).unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let met = joint_motion(&arm, tool, &turn(0.0), &turn(90.0));
        assert!(matches!(&met, Err(Infeasibility::KeepOut { name, .. }) if name == "post"), "{met:?}");
        assert_eq!(joint_motion(&arm, tool, &turn(0.0), &turn(-90.0)), Ok(()));
        let far = joint_motion(&arm, tool, &turn(0.0), &turn(-170.5));
        assert!(matches!(far, Err(Infeasibility::AxisLimit { axis: 1, .. })), "{far:?}");
        assert_eq!(joint_motion(&arm, tool, &turn(0.0), &turn(f64::NAN)), Err(Infeasibility::NotFinite));
    }

    /// The same turn over an object that a scan saw at the place of the post: by hand, at 45° the forearm passes
    /// over it.
    #[test]
    fn a_joint_motion_keeps_clear_of_what_the_scan_saw() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let obstacles = Obstacles::default()
            .with_points_of("what the scan saw", (0..45).map(|k| Point::at(275.0, -275.0, f64::from(20 * k))));
        let arm = Kinematics::new(cell.arm());
        let beside = arm.clone().with_obstacles(Arc::new(obstacles));
        let tool = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let met = joint_motion(&beside, tool, &turn(0.0), &turn(90.0));
        assert!(matches!(&met, Err(Infeasibility::KeepOut { name, .. }) if name == "what the scan saw"), "{met:?}");
        assert_eq!(joint_motion(&beside, tool, &turn(0.0), &turn(-90.0)), Ok(()));
        assert_eq!(joint_motion(&arm, tool, &turn(0.0), &turn(90.0)), Ok(()));
    }

    /// A sheet of points, one in 8 mm, lies beside the tip; elsewhere 40 mm are required. At the end of a checked path a
    /// motion away from it is permitted if it begins at 20 mm, and a motion through it is not, wherever it begins. By
    /// hand: at 20 mm the nearest point is 20.8 mm away, and 10 mm must be left; at 4 mm it is 6.9 mm away, and 8 mm must be.
    #[test]
    fn a_departure_does_not_pass_through_a_surface() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let tip = (arm.base_from_flange(&turn(0.0)).expect("finite") * tool).origin();
        let moves = |beside_mm: f64, to_deg: f64| {
            // To the left of the tip, where a positive angle of A1 does not lead.
            let at = |x: i32, z: i32| (tip.mm.x + f64::from(8 * x), tip.mm.z + f64::from(8 * z));
            let sheet = (-12..=12).flat_map(|x| (-12..=0).map(move |z| at(x, z)));
            let points = sheet.map(|(x, z)| Point::at(x + 4.0, tip.mm.y + beside_mm, z + 4.0));
            let arm = arm.clone().with_obstacles(Arc::new(Obstacles::default().with_points_of("panel", points)));
            let departing = departing(&arm, &turn(0.0), tool).expect("finite");
            [&arm, &departing].map(|arm| joint_motion(arm, tool, &turn(0.0), &turn(to_deg)).is_ok())
        };
        assert_eq!([moves(20.0, 20.0), moves(20.0, -20.0)], [[false, true], [false, false]]);
        assert_eq!([moves(4.0, 20.0), moves(4.0, -20.0)], [[false, false], [false, false]]);
    }

    /// An object 40 mm from the forearm's centre line, and far from the tool: at the end of a path, too, the forearm
    /// keeps its distance of 80 mm, less what it lacked at the start.
    #[test]
    fn the_arms_body_does_not_come_nearer_at_the_end_of_a_path() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let [_, elbow, wrist, _] = arm.centre_line(&turn(30.0).degrees());
        let beside = elbow + (wrist - elbow) * 0.5;
        let arm = arm.with_obstacles(Arc::new(Obstacles::default().with_points_of("post", [beside])));
        let departing = departing(&arm, &turn(0.0), tool).expect("finite");
        let met = joint_motion(&departing, tool, &turn(0.0), &turn(30.0)).expect_err("a collision");
        assert!(
            matches!(&met, Infeasibility::KeepOut { part, needed_mm, .. } if *part != "tool" && *needed_mm > 70.0),
            "{met}"
        );
    }
}
