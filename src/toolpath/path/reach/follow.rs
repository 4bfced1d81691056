//! Follows a motion of the arm step by step: a path, the retraction from a path, or a joint motion of all axes.
//!
//! A path is followed from pose to pose, in the arm's current configuration or in the one with the most room.
//!
//! The check of the retraction shows whether the arm can leave the panel after a stop: from each waypoint in contact,
//! along the tool's axis, in the arm's configuration at this waypoint. Distance and speed are those with which the
//! controller's program retracts the tool. The check applies to a path that the arm can follow. It covers only the
//! retraction, not the motion back to the park pose.
//!
//! A joint motion rotates all axes together from one position to another, as `move_j` does. Singularities and the
//! margins from the axis limits matter only for linear motions. A joint motion is checked against the axis limits
//! themselves, the keep-out boxes and the obstacles of the scan, in steps of at most 0.4° of the axis with the largest
//! rotation.

use super::infeasible::{
    CheckedPose, Infeasibility, PathLine, ReachFault, check_axis_speeds, check_clearance, check_keep_out,
    first_exceeded_axis, interpolate_pose, limit_room_deg, smallest_axis_violation,
};
use crate::path::kinematics::{JointAngles, Kinematics, nearest_solution};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid, Tool, Vector};
use panelprep_cell::controller::{RETRACT_MM, RETRACT_MM_S};
use rayon::prelude::*;

/// Maximum distance between two checked poses, mm.
const MAX_POSE_STEP_MM: f64 = 10.0;
/// Maximum rotation between two checked poses, degrees.
const MAX_POSE_STEP_DEG: f64 = 3.0;
/// Maximum rotation of an axis in one step, degrees; a larger rotation means that the configuration has changed.
const MAX_STEP_ROTATION_DEG: f64 = 30.0;
/// Shifts of the panel that are tried along each axis of the base, mm.
const TRIED_SHIFTS_MM: [f64; 6] = [10.0, 20.0, 40.0, 60.0, 100.0, 150.0];

/// Maximum rotation of an axis between two checked poses of a joint motion, degrees: at a radius of 1 m the tip moves
/// by 7 mm, which is less than the smallest required distance from a surface, 8 mm.
const MAX_AXIS_STEP_DEG: f64 = 0.4;

/// The result of following a path with the arm.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmTravel {
    /// The axis angles at each waypoint.
    pub joints: Vec<Joints>,
    /// Smallest room after the margins, degrees, over all axes and the wrist singularity.
    pub room_deg: f64,
}

/// Follows a path from the current axis angles; without these, in the configuration with the most room.
///
/// # Errors
/// If the arm cannot follow the path. The error is the first cause, in the configuration with which the arm follows the
/// path farthest.
pub fn follow_path(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    from: Option<&Joints>,
    legs: &[PathLine],
) -> Result<ArmTravel, ReachFault> {
    let mut looks = checked_poses(arm, flange_from_tool, from, legs)?;
    let ways: Vec<Vec<JointAngles>> =
        looks.par_iter().map(|look| arm.inverse_solutions(&look.base_from_flange)).collect();
    looks.iter_mut().zip(ways).for_each(|(look, ways)| look.solutions = ways);
    let Some(first) = looks.first() else { return Ok(ArmTravel { joints: Vec::new(), room_deg: f64::INFINITY }) };
    if first.solutions.is_empty() {
        return Err(ReachFault { index: 0, cause: reach_infeasibility(arm, first) });
    }
    let starts = match from {
        Some(joints) => vec![joints.degrees()],
        None => first.solutions.iter().flat_map(|way| full_turn_variants(arm, way)).collect(),
    };
    let (mut best, mut farthest): (Option<ArmTravel>, Option<(usize, ReachFault)>) = (None, None);
    for start in starts {
        match track_configuration(arm, &looks, start) {
            Ok(travel) if best.as_ref().is_none_or(|best| travel.room_deg > best.room_deg) => best = Some(travel),
            Ok(_) => {}
            Err((step, fault)) if farthest.as_ref().is_none_or(|(before, _)| step > *before) => {
                farthest = Some((step, fault));
            }
            Err(_) => {}
        }
    }
    let missing = || ReachFault { index: 0, cause: smallest_axis_violation(arm, &first.solutions) };
    best.ok_or_else(|| farthest.map_or_else(missing, |(_, fault)| fault))
}

/// Returns the axis solutions for this flange pose that keep all margins and lie outside of all keep-out boxes; `tip`
/// is the tool's tip.
pub fn postures(arm: &Kinematics, base_from_flange: &Rigid<Base, Flange>, tip: Point<Flange>) -> Vec<Joints> {
    let look = CheckedPose {
        index: 0,
        base_from_flange: *base_from_flange,
        tip: *base_from_flange * tip,
        seconds: 0.0,
        change_s: None,
        is_end: true,
        solutions: Vec::new(),
    };
    let may_stand = |way: &JointAngles| {
        limit_room_deg(arm, &look, way).is_ok()
            && check_keep_out(arm, look.tip, way).is_ok()
            && check_clearance(arm, look.tip, way).is_ok()
    };
    arm.inverse_solutions(base_from_flange).into_iter().filter(may_stand).map(Joints::from).collect()
}

/// Returns the smallest shift of the panel along an axis of the base with which the arm can follow the path; `None` if
/// the arm cannot follow the path with any of the tried shifts.
pub fn helpful_shift(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    legs: &[PathLine],
) -> Option<Vector<Base>> {
    let directions = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let follows = |step: Vector<Base>| {
        let moved: Vec<PathLine> = legs
            .iter()
            .map(|leg| PathLine { base_from_tool: leg.base_from_tool.followed_by_displacement(step), ..*leg })
            .collect();
        follow_path(arm, flange_from_tool, None, &moved).is_ok()
    };
    TRIED_SHIFTS_MM
        .iter()
        .find_map(|mm| directions.map(|d| Vector::new(d * *mm)).into_iter().find(|step| follows(*step)))
}

fn checked_poses(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    from: Option<&Joints>,
    legs: &[PathLine],
) -> Result<Vec<CheckedPose>, ReachFault> {
    let tool_from_flange = flange_from_tool.inverse();
    let finite = |pose: &Rigid<Base, Tool>| pose.isometry().to_homogeneous().iter().all(|n| n.is_finite());
    let wrong = legs.iter().position(|leg| !(finite(&leg.base_from_tool) && leg.feed_mm_s > 0.0));
    let start = from.map(|joints| arm.base_from_flange(joints).map(|pose| pose * flange_from_tool));
    if wrong.is_some() || start == Some(None) {
        return Err(ReachFault { index: wrong.unwrap_or(0), cause: Infeasibility::NotFinite });
    }
    let look = |index, base_from_tool: Rigid<Base, Tool>, seconds, change_s, is_end| CheckedPose {
        index,
        base_from_flange: base_from_tool * tool_from_flange,
        tip: base_from_tool.origin(),
        seconds,
        change_s,
        is_end,
        solutions: Vec::new(),
    };
    let mut all = Vec::with_capacity(legs.len());
    let mut before = start.flatten();
    if let Some(start) = before {
        all.push(look(0, start, 0.0, None, false));
    }
    // The motion before the path is not known, so the path is assumed to begin at standstill.
    let mut blend = 0.0;
    for (index, leg) in legs.iter().enumerate() {
        let to = leg.base_from_tool;
        let Some(from) = before else {
            all.push(look(index, to, 0.0, None, true));
            before = Some(to);
            continue;
        };
        let (length_mm, turn) = (from.origin().distance_mm(to.origin()), (from.inverse() * to).rotation_angle());
        let steps = (length_mm / MAX_POSE_STEP_MM).max(turn.0 / MAX_POSE_STEP_DEG).ceil().max(1.0);
        let seconds = length_mm / leg.feed_mm_s / steps;
        for step in 1..=steps as usize {
            let pose = if step as f64 == steps { to } else { interpolate_pose(from, to, step as f64 / steps) };
            let corner_s = if blend > 0.0 { Some((2.0 * blend / leg.feed_mm_s).max(seconds)) } else { None };
            let change_s = if step > 1 { Some(seconds) } else { corner_s };
            all.push(look(index, pose, seconds, change_s, step as f64 == steps));
        }
        (before, blend) = (Some(to), leg.blend_mm);
    }
    Ok(all)
}

/// Follows the poses step by step in one configuration. If the arm cannot follow, returns the step and the reason.
fn track_configuration(
    arm: &Kinematics,
    looks: &[CheckedPose],
    start: JointAngles,
) -> Result<ArmTravel, (usize, ReachFault)> {
    let (mut at, mut speed) = (start, [0.0; 6]);
    let mut travel = ArmTravel { joints: Vec::new(), room_deg: f64::INFINITY };
    for (step, look) in looks.iter().enumerate() {
        let fault = |cause| (step, ReachFault { index: look.index, cause });
        let next = nearest_axis_solution(arm, look, &at).map_err(fault)?;
        if step > 0 {
            let turned: JointAngles = std::array::from_fn(|axis| next[axis] - at[axis]);
            let axis = widest_axis(&turned);
            if turned[axis].abs() > MAX_STEP_ROTATION_DEG {
                return Err(fault(Infeasibility::Flip { axis: axis + 1, turn_deg: turned[axis].abs() }));
            }
            speed = check_axis_speeds(arm, look, &turned, &speed).map_err(fault)?;
        }
        travel.room_deg = travel.room_deg.min(limit_room_deg(arm, look, &next).map_err(fault)?);
        check_keep_out(arm, look.tip, &next).and_then(|()| check_clearance(arm, look.tip, &next)).map_err(fault)?;
        at = next;
        if look.is_end {
            travel.joints.push(Joints::from(at));
        }
    }
    Ok(travel)
}

fn widest_axis(turned: &JointAngles) -> usize {
    (0..6).fold(0, |widest, axis| if turned[axis].abs() > turned[widest].abs() { axis } else { widest })
}

/// Returns the axis solution of a pose that is nearest to the current axis angles, including rotations by 360°.
fn nearest_axis_solution(
    arm: &Kinematics,
    look: &CheckedPose,
    at: &JointAngles,
) -> Result<JointAngles, Infeasibility> {
    nearest_solution(&look.solutions, at).ok_or_else(|| reach_infeasibility(arm, look))
}

fn reach_infeasibility(arm: &Kinematics, look: &CheckedPose) -> Infeasibility {
    Infeasibility::OutOfReach { beyond_mm: arm.reach_excess_mm(&look.base_from_flange) }
}

/// Returns a solution together with the solutions in which axes 4 and 6 are rotated by a further 360° in either
/// direction, as far as the axis limits permit.
fn full_turn_variants(arm: &Kinematics, way: &JointAngles) -> Vec<JointAngles> {
    let mut all = Vec::new();
    for turn_4 in [-360.0, 0.0, 360.0] {
        for turn_6 in [-360.0, 0.0, 360.0] {
            let turned = [way[0], way[1], way[2], way[3] + turn_4, way[4], way[5] + turn_6];
            if first_exceeded_axis(arm, &turned).is_none() {
                all.push(turned);
            }
        }
    }
    all
}

/// Returns the linear retraction from the panel, along the tool's axis.
pub fn retract(base_from_tool: Rigid<Base, Tool>) -> PathLine {
    let away = Rigid::<Tool, Tool>::identity().followed_by_displacement(Vector::new(Vector3::z() * -RETRACT_MM));
    PathLine { base_from_tool: base_from_tool * away, feed_mm_s: RETRACT_MM_S, blend_mm: 0.0 }
}

/// Checks the retraction from each waypoint in contact. Each item contains whether the waypoint is in contact, the
/// tool's pose and the axis angles.
///
/// # Errors
/// The first waypoint from which the arm cannot retract, as [`Infeasibility::Retract`].
pub fn check_retracts(
    arm: &Kinematics,
    flange_from_tool: Rigid<Flange, Tool>,
    waypoints: impl IntoIterator<Item = (bool, Rigid<Base, Tool>, Joints)>,
) -> Result<(), ReachFault> {
    let in_contact = waypoints.into_iter().enumerate().filter(|(_, (contact, ..))| *contact);
    // Every waypoint is checked, because an epoch can end at any of them, and the controller then retracts the tool
    // without a further command.
    for (index, (_, base_from_tool, joints)) in in_contact {
        if let Err(fault) = follow_path(arm, flange_from_tool, Some(&joints), &[retract(base_from_tool)]) {
            return Err(ReachFault { index, cause: Infeasibility::Retract { why: Box::new(fault.cause) } });
        }
    }
    Ok(())
}

/// Checks a joint motion with this tool: all axes rotate in proportion from the first to the second angles.
///
/// # Errors
/// The obstacle or axis limit that prevents the motion.
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
    let steps = (farthest_deg / MAX_AXIS_STEP_DEG).ceil().max(1.0) as usize;
    for step in 0..=steps {
        let share = step as f64 / steps as f64;
        let at: JointAngles = std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * share);
        let base_from_flange = arm.base_from_flange(&Joints::from(at)).ok_or(Infeasibility::NotFinite)?;
        let tip = (base_from_flange * flange_from_tool).origin();
        // The start is not checked, because a motion that leads out of a keep-out box is permitted.
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
    use crate::path::reach::{Obstacles, arm_for_departure};
    use panelprep_base::geometry::{KukaPose, Point};
    use panelprep_cell::cell::Cell;
    use std::sync::Arc;

    /// Returns the value of a constant in the controller's program as it is shipped.
    fn shipped_constant(name: &str) -> f64 {
        let text = include_str!("../../../../config/kuka/cell_config.dat");
        let line = text.lines().find_map(|line| line.split_once(&format!("{name}="))).expect("a constant");
        line.1.trim().parse().expect("a number")
    }

    /// The retraction is the same as in the controller's program.
    #[test]
    fn the_retract_equals_that_of_the_controller_program() {
        assert_eq!(
            (RETRACT_MM, RETRACT_MM_S),
            (shipped_constant("CELL_RETRACT_MM"), 1e3 * shipped_constant("CELL_RETRACT_VEL"))
        );
    }

    /// A case that a random test of the controller's programs found: the tool points down, and axis 5 is so near to its
    /// limit that the arm cannot retract by 50 mm. In front of a panel the arm can retract.
    #[test]
    fn a_contact_without_a_possible_retract_is_refused() {
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

    fn turn(a1_deg: f64) -> Joints {
        Joints { a1_deg, a2_deg: -90.0, a3_deg: 90.0, a5_deg: 30.0, ..Joints::default() }
    }

    /// A post stands beside the arm, 45° to the right (A1 = 45 in KUKA's sense of rotation): a rotation from 0 to 90°
    /// passes over the post, a rotation to the left does not. Calculated by hand: the wrist moves at 25 + 365 = 390 mm
    /// from axis 1.
    #[test]
    fn a_joint_motion_is_checked_along_its_arc() {
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

    /// The same motion over an object that a scan showed at the position of the post. Expected value, calculated by
    /// hand: the forearm passes over the object at 45°.
    #[test]
    fn a_joint_motion_keeps_its_distance_from_scanned_obstacles() {
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

    /// A sheet of points 8 mm apart lies beside the tip; elsewhere 40 mm are required. At the end of a checked path a
    /// motion away from the sheet is permitted if it begins at 20 mm; a motion through the sheet is never permitted.
    /// Expected values, calculated by hand: at 20 mm the nearest point is 20.8 mm away, and the required distance is 10
    /// mm. At 4 mm the nearest point is 6.9 mm away, and the required distance is 8 mm.
    #[test]
    fn a_departure_does_not_pass_through_a_surface() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let tip = (arm.base_from_flange(&turn(0.0)).expect("finite") * tool).origin();
        let moves = |beside_mm: f64, to_deg: f64| {
            // The sheet is to the left of the tip; a positive rotation of A1 leads to the right.
            let at = |x: i32, z: i32| (tip.mm.x + f64::from(8 * x), tip.mm.z + f64::from(8 * z));
            let sheet = (-12..=12).flat_map(|x| (-12..=0).map(move |z| at(x, z)));
            let points = sheet.map(|(x, z)| Point::at(x + 4.0, tip.mm.y + beside_mm, z + 4.0));
            let arm = arm.clone().with_obstacles(Arc::new(Obstacles::default().with_points_of("panel", points)));
            let departing = arm_for_departure(&arm, &turn(0.0), tool).expect("finite");
            [&arm, &departing].map(|arm| joint_motion(arm, tool, &turn(0.0), &turn(to_deg)).is_ok())
        };
        assert_eq!([moves(20.0, 20.0), moves(20.0, -20.0)], [[false, true], [false, false]]);
        assert_eq!([moves(4.0, 20.0), moves(4.0, -20.0)], [[false, false], [false, false]]);
    }

    /// An object is 40 mm from the forearm's centre line, and far from the tool. Also at the end of a path, the forearm
    /// must keep the distance that it had at the start, which is less than the configured 80 mm.
    #[test]
    fn the_arm_body_keeps_its_distance_at_the_end_of_a_path() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let arm = Kinematics::new(cell.arm());
        let tool: Rigid<Flange, Tool> = KukaPose { z_mm: 120.0, ..KukaPose::default() }.to_rigid();
        let [_, elbow, wrist, _] = arm.centre_line(&turn(30.0).degrees());
        let beside = elbow + (wrist - elbow) * 0.5;
        let arm = arm.with_obstacles(Arc::new(Obstacles::default().with_points_of("post", [beside])));
        let departing = arm_for_departure(&arm, &turn(0.0), tool).expect("finite");
        let met = joint_motion(&departing, tool, &turn(0.0), &turn(30.0)).expect_err("a collision");
        assert!(
            matches!(&met, Infeasibility::KeepOut { part, needed_mm, .. } if *part != "tool" && *needed_mm > 70.0),
            "{met}"
        );
    }
}
