//! Checks whether the arm could leave the panel at a stop: from each waypoint in contact, along the tool's axis, in
//! the arm's configuration there. Distance and speed are those with which the controller's program lifts the tool
//! off.
//!
//! Applies to a path that was followed; only the retract is checked, not the way back.

use super::follow::follow_path;
use super::infeasible::{Infeasibility, ReachFault};
use super::leg::PathLine;
use crate::path::Kinematics;
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool, Vector};
use panelprep_cell::controller::{RETRACT_MM, RETRACT_MM_S};

/// Returns the straight line away from the panel.
pub fn retract(base_from_tool: Rigid<Base, Tool>) -> PathLine {
    let away = Rigid::<Tool, Tool>::identity().followed_by_displacement(Vector::new(Vector3::z() * -RETRACT_MM));
    PathLine { base_from_tool: base_from_tool * away, feed_mm_s: RETRACT_MM_S, blend_mm: 0.0 }
}

/// Checks each waypoint in contact. Each item states whether the waypoint is in contact, the tool's pose and the axis
/// angles.
///
/// # Errors
/// The first waypoint from which the arm could not lift off, as [`Infeasibility::Retract`].
pub fn check_retracts(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    waypoints: impl IntoIterator<Item = (bool, Rigid<Base, Tool>, Joints)>,
) -> Result<(), ReachFault> {
    let in_contact = waypoints.into_iter().enumerate().filter(|(_, (contact, ..))| *contact);
    // Each waypoint, since an epoch can end at any of them, and the controller retracts along a line by itself without
    // asking.
    for (index, (_, base_from_tool, joints)) in in_contact {
        if let Err(fault) = follow_path(arm, flange_from_tool, Some(&joints), &[retract(base_from_tool)]) {
            return Err(ReachFault { index, cause: Infeasibility::Retract { why: Box::new(fault.cause) } });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::KukaPose;
    use panelprep_cell::cell::Cell;

    /// Reads the value of a constant in the shipped program.
    fn shipped(name: &str) -> f64 {
        let text = include_str!("../../../../config/kuka/cell_config.dat");
        let line = text.lines().find_map(|line| line.split_once(&format!("{name}="))).expect("a constant");
        line.1.trim().parse().expect("a number")
    }

    /// The retract is the same as in the controller's program.
    #[test]
    fn the_retract_is_the_programs() {
        assert_eq!((RETRACT_MM, RETRACT_MM_S), (shipped("CELL_RETRACT_MM"), 1e3 * shipped("CELL_RETRACT_VEL")));
    }

    /// Found by a random walk over the controller's programs: the tool points down and is so near to axis 5's limit
    /// that the arm cannot lift it by 50 mm. In front of a panel the arm can.
    #[test]
    fn contact_from_which_a_stop_could_not_lift_off_is_refused() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}"));
        let arm = Kinematics::new(cell.arm());
        let flange_from_tool: Rigid<Flange, Tool> = KukaPose { z_mm: 100.0, ..KukaPose::default() }.to_rigid();
        let asked = |axes_deg: [f64; 6]| {
            let joints = Joints::from(axes_deg);
            let pose = arm.base_from_flange(&joints).expect("an arm") * flange_from_tool;
            assert_eq!(
                check_retracts(&arm, flange_from_tool, [(false, pose, joints)]),
                Ok(()),
                "nothing retracts from the air"
            );
            check_retracts(&arm, flange_from_tool, [(false, pose, joints), (true, pose, joints)])
        };
        let fault = asked([0.0, -156.2, 127.9, 0.0, 115.0, 0.0]).expect_err("axis 5 has no room");
        assert_eq!((fault.index, fault.cause.code()), (1, "retract_out_of_reach"));
        assert!(
            fault.to_string().starts_with("waypoint 1: at a stop the controller lifts the tool by 50 mm"),
            "{fault}"
        );
        assert_eq!(asked([0.0, -110.0, 135.0, 0.0, -25.0, 90.0]), Ok(()));
    }
}
