//! Checks whether all axes may turn together from one position to another, as `move_j` does.
//!
//! No line is followed, so singularities do not matter; the margins from the axis limits also apply only to lines. The
//! checks that remain are the limits themselves, the keep-out boxes and the obstacles of the scan, at every 2° of the
//! axis that turns farthest.

use super::clearance::keeps_clear;
use super::infeasible::Infeasibility;
use super::margins::keeps_out;
use crate::geometry::{Flange, Joints, Rigid, Tool};
use crate::path::kinematics::{Angles, Kinematics};

/// Largest turn of an axis between two checked poses, degrees: at a radius of 1 m the tip moves by 9 mm, less than the
/// smallest distance that is kept from a surface.
const STEP_DEG: f64 = 0.5;

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
    for step in 1..=steps {
        let share = step as f64 / steps as f64;
        let at: Angles = std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * share);
        let base_from_flange = arm.base_from_flange(&Joints::from(at)).ok_or(Infeasibility::NotFinite)?;
        let tip = (base_from_flange * flange_from_tool).origin();
        keeps_out(arm, tip, &at).and_then(|()| keeps_clear(arm, tip, &at))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::geometry::{KukaPose, Point};
    use crate::path::reach::{Obstacles, departing};
    use std::sync::Arc;

    fn turn(a1_deg: f64) -> Joints {
        Joints { a1_deg, a2_deg: -90.0, a3_deg: 90.0, a5_deg: 30.0, ..Joints::default() }
    }

    /// A post stands beside the arm, 45° to the right (A1 = 45, as KUKA counts): a turn from 0 to 90° passes over
    /// it, a turn to the left does not. Calculated by hand: the wrist moves at 25 + 365 = 390 mm from axis 1.
    #[test]
    fn a_swing_sweeps_what_stands_between() {
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
            .with("what the scan saw", (0..45).map(|k| Point::at(275.0, -275.0, f64::from(20 * k))));
        let arm = Kinematics::new(cell.arm());
        let beside = arm.clone().beside(Arc::new(obstacles));
        let tool = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let met = joint_motion(&beside, tool, &turn(0.0), &turn(90.0));
        assert!(matches!(&met, Err(Infeasibility::KeepOut { name, .. }) if name == "what the scan saw"), "{met:?}");
        assert_eq!(joint_motion(&beside, tool, &turn(0.0), &turn(-90.0)), Ok(()));
        assert_eq!(joint_motion(&arm, tool, &turn(0.0), &turn(90.0)), Ok(()));
    }

    /// The tip begins 10 mm beside an object; elsewhere 40 mm are required. At the end of a checked path, a motion away
    /// from the object is permitted. A motion towards it is refused: by hand, the tip is more than 300 mm from axis 1, so
    /// it reaches the object within 2°.
    #[test]
    fn a_departure_does_not_come_much_nearer_than_its_start() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let tip = (arm.base_from_flange(&turn(0.0)).expect("finite") * tool).origin();
        // To the left of the arm, where a positive angle of A1 does not lead.
        let beside = Point::at(tip.mm.x, tip.mm.y + 10.0, tip.mm.z);
        let arm = arm.beside(Arc::new(Obstacles::default().with("panel", [beside])));
        let departing = departing(&arm, &turn(0.0), tool).expect("finite");
        let moves = |arm: &Kinematics, to| joint_motion(arm, tool, &turn(0.0), &turn(to)).is_ok();
        assert_eq!([moves(&arm, 20.0), moves(&departing, 20.0)], [false, true]);
        assert_eq!([moves(&arm, -20.0), moves(&departing, -20.0)], [false, false]);
    }
}
