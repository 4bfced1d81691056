//! Follows a path from pose to pose, in the arm's current configuration or in the one with the most room.

use super::clearance::check_clearance;
use super::infeasible::{Infeasibility, ReachFault};
use super::leg::{CheckedPose, PathLine, interpolate_pose};
use super::margins::{axis_limit, check_keep_out, first_exceeded_axis, limit_room_deg, too_fast};
use crate::path::kinematics::{JointAngles, Kinematics, nearest_solution};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid, Tool, Vector};
use rayon::prelude::*;

/// Longest step between two checked poses.
const STEP_MM: f64 = 10.0;
/// Largest rotation between two checked poses, degrees.
const STEP_DEG: f64 = 3.0;
/// Largest turn of an axis in one step, degrees; with a larger turn, the configuration has changed.
const MAX_STEP_TURN_DEG: f64 = 30.0;
/// Shifts of the panel that are tried, mm, along each axis of the base.
const SHIFTS_MM: [f64; 6] = [10.0, 20.0, 40.0, 60.0, 100.0, 150.0];

/// The result of following a path with the arm.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmTravel {
    /// The axis angles at each waypoint.
    pub joints: Vec<Joints>,
    /// Smallest room beyond the margins, degrees, over all axes and the wrist singularity.
    pub room_deg: f64,
}

/// Follows a path from the current axis angles, or, without them, in the configuration that has the most room.
///
/// # Errors
/// The first cause, in the configuration with which the arm comes farthest.
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
    let missing = || ReachFault { index: 0, cause: axis_limit(arm, &first.solutions) };
    best.ok_or_else(|| farthest.map_or_else(missing, |(_, fault)| fault))
}

/// Returns the axis solutions for this flange pose that keep all margins and lie outside all keep-out boxes; `tip` is
/// the tool's.
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

/// Returns the smallest shift of the panel along an axis of the base with which the arm follows the path; `None` if
/// none of the tried shifts helps.
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
    SHIFTS_MM.iter().find_map(|mm| directions.map(|d| Vector::new(d * *mm)).into_iter().find(|step| follows(*step)))
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
    // If the motion before is not known, the path begins at standstill.
    let mut blend = 0.0;
    for (index, leg) in legs.iter().enumerate() {
        let to = leg.base_from_tool;
        let Some(from) = before else {
            all.push(look(index, to, 0.0, None, true));
            before = Some(to);
            continue;
        };
        let (length_mm, turn) = (from.origin().distance_mm(to.origin()), (from.inverse() * to).rotation_angle());
        let steps = (length_mm / STEP_MM).max(turn.0 / STEP_DEG).ceil().max(1.0);
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

/// Follows the poses step by step in one configuration; if this fails, returns the step and the reason.
fn track_configuration(
    arm: &Kinematics,
    looks: &[CheckedPose],
    start: JointAngles,
) -> Result<ArmTravel, (usize, ReachFault)> {
    let (mut at, mut speed) = (start, [0.0; 6]);
    let mut travel = ArmTravel { joints: Vec::new(), room_deg: f64::INFINITY };
    for (step, look) in looks.iter().enumerate() {
        let fault = |cause| (step, ReachFault { index: look.index, cause });
        let next = nearest(arm, look, &at).map_err(fault)?;
        if step > 0 {
            let turned: JointAngles = std::array::from_fn(|axis| next[axis] - at[axis]);
            let axis = widest_axis(&turned);
            if turned[axis].abs() > MAX_STEP_TURN_DEG {
                return Err(fault(Infeasibility::Flip { axis: axis + 1, turn_deg: turned[axis].abs() }));
            }
            speed = too_fast(arm, look, &turned, &speed).map_err(fault)?;
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

/// Returns the axis solution for a pose that is nearest to the current axis angles, including whole turns.
fn nearest(arm: &Kinematics, look: &CheckedPose, at: &JointAngles) -> Result<JointAngles, Infeasibility> {
    nearest_solution(&look.solutions, at).ok_or_else(|| reach_infeasibility(arm, look))
}

fn reach_infeasibility(arm: &Kinematics, look: &CheckedPose) -> Infeasibility {
    Infeasibility::OutOfReach { beyond_mm: arm.reach_excess_mm(&look.base_from_flange) }
}

/// Returns a solution together with its variants in which axes 4 and 6 are one turn further in either direction, as
/// far as the limits allow.
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
