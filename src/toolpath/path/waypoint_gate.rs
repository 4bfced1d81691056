//! The one gate before every motion: the whole path is accepted, or no part is sent.
//!
//! Checks the tool's tip in the robot's base, with the base and tool that the controller will use: every number
//! finite, every point inside the cell's box, the first point near the arm's current pose, no large step and no large
//! rotation between neighbours. Near the panel it also checks for a large tilt against the tool's direction at
//! teaching (a wrong base causes such a tilt). The gate rejects and never clips. It does not know the arm: reach is
//! checked in the modules that have its kinematics.

use panelprep_base::geometry::{Base, Degrees, Joints, Rigid, Tool, Vector};
use panelprep_base::number_text::{distinguishable_texts, list, shortest_text};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Severity};
use panelprep_cell::cell::{Limits, Workspace};

/// The limits of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaypointLimits {
    /// The box that the tip must not leave; without a box, no straight motion is allowed.
    pub workspace: Option<Workspace>,
    /// Longest step, mm.
    pub max_step_mm: f64,
    /// Largest rotation in one step.
    pub max_turn: Degrees,
    /// Largest angle between the tool's axis and the taught axis.
    pub max_tilt: Degrees,
}

impl From<&Limits> for WaypointLimits {
    fn from(limits: &Limits) -> Self {
        WaypointLimits {
            workspace: limits.workspace(),
            max_step_mm: limits.max_step_mm(),
            max_turn: Degrees(limits.max_turn_deg()),
            max_tilt: Degrees(limits.max_tilt_deg()),
        }
    }
}

/// A path of straight lines as it would be executed.
#[derive(Debug, Clone, Copy)]
pub struct Route<'a> {
    /// The arm's pose, as reported.
    pub from: Rigid<Base, Tool>,
    /// The poses to move to.
    pub waypoints: &'a [Rigid<Base, Tool>],
    /// The direction of the tool's Z on the panel at its nominal pose; `None` away from the panel.
    pub taught_axis: Option<Vector<Base>>,
}

/// Accepts or rejects a whole path of straight lines.
pub fn judge_route(route: &Route<'_>, limits: &WaypointLimits) -> Judgement {
    Judgement::from_checks(&violated_by_route(route, limits))
}

/// Returns a failed check for each limit that a path of straight lines violates; empty if the path may be sent.
pub fn violated_by_route(route: &Route<'_>, limits: &WaypointLimits) -> Vec<Check> {
    let nothing_moves = |what: &str, code: &'static str, words: String| {
        vec![Check::new(what, "", None).with_consequence_if(true, Severity::Reject, code, || words)]
    };
    let Some(workspace) = limits.workspace else {
        let message = "the cell's file does not state box_min_mm and box_max_mm, without which the robot makes no \
                       linear motions; state both in [limits]";
        return nothing_moves("the cell's box", "no_box", message.to_owned());
    };
    if route.waypoints.is_empty() {
        return nothing_moves("waypoints", "no_waypoints", "the path has no waypoint".to_owned());
    }
    // With the reported pose of the arm as the first: a wrong present pose makes the longest step.
    let all = || std::iter::once(&route.from).chain(route.waypoints);
    if let Some(index) = all().position(|pose| !is_finite_pose(pose)) {
        return nothing_moves(
            "waypoint",
            "not_finite",
            format!("the pose of waypoint {index} is not a valid number"),
        );
    }
    let mut broken = Vec::new();
    for (index, (from, to)) in all().zip(route.waypoints).enumerate() {
        let index = index + 1;
        broken.extend(box_violation(index, to, workspace));
        broken.extend(jump_violation(index, (from, to), limits));
        broken.extend(route.taught_axis.and_then(|axis| tilt_violation(index, to, axis, limits.max_tilt)));
    }
    broken
}

/// Accepts or rejects axis angles.
pub fn judge_joints(joints: &Joints) -> Judgement {
    let angles = joints.degrees();
    // Not a number compares false with every limit, so it is asked for by name.
    let wrong = angles.iter().position(|angle| !angle.is_finite() || angle.abs() > MAX_AXIS_DEG);
    let check = |axis: usize| {
        Check::new(format!("axis {}", axis + 1), "°", angles[axis].abs())
            .with_max(MAX_AXIS_DEG, LimitSource::Program)
            .or_reject("axis_limit", || {
                let angle = shortest_text(angles[axis]);
                format!("axis {} is commanded to {angle}° (limit ±{MAX_AXIS_DEG}°)", axis + 1)
            })
    };
    Judgement::from_checks(&wrong.map(check))
}

/// Largest absolute value of a commanded axis angle.
const MAX_AXIS_DEG: f64 = 360.0;

fn is_finite_pose(pose: &Rigid<Base, Tool>) -> bool {
    pose.isometry().to_homogeneous().iter().all(|number| number.is_finite())
}

/// Checks whether a waypoint is outside the box, and how far.
fn box_violation(index: usize, pose: &Rigid<Base, Tool>, workspace: Workspace) -> Option<Check> {
    let tip = pose.origin().mm;
    // Each coordinate, with enough digits to distinguish it from the nearer side of the box.
    let beside = |mm: f64, axis: usize| {
        let (low, high) = (workspace.min.mm[axis], workspace.max.mm[axis]);
        let [mm, _] = distinguishable_texts(mm, if (mm - low).abs() < (mm - high).abs() { low } else { high }, 1);
        mm
    };
    let message = || {
        format!(
            "waypoint {index} is at ({}, {}, {}) mm, outside of the cell's box from {} to {} mm",
            beside(tip.x, 0),
            beside(tip.y, 1),
            beside(tip.z, 2),
            list(workspace.min.mm.coords.as_slice()),
            list(workspace.max.mm.coords.as_slice())
        )
    };
    let sides = (0..3).flat_map(|axis| {
        let (low, high) = (workspace.min.mm[axis], workspace.max.mm[axis]);
        [(low - tip[axis], "limits.box_min_mm"), (tip[axis] - high, "limits.box_max_mm")]
    });
    let farthest = sides.max_by(|one, other| one.0.total_cmp(&other.0));
    let (beyond_mm, key) = farthest.unwrap_or((f64::NAN, "limits.box_min_mm"));
    let check =
        Check::new("waypoint outside of the cell's box", "mm", beyond_mm).with_max(0.0, LimitSource::cell(key));
    (!workspace.contains(pose.origin()))
        .then(|| check.with_consequence_if(true, Severity::Reject, "outside_box", message))
}

fn jump_violation(
    index: usize,
    (from, to): (&Rigid<Base, Tool>, &Rigid<Base, Tool>),
    limits: &WaypointLimits,
) -> impl Iterator<Item = Check> {
    let before = if index == 1 { "the arm's present pose".to_owned() } else { format!("waypoint {}", index - 1) };
    let (step_mm, turn) = (from.origin().distance_mm(to.origin()), (from.inverse() * *to).rotation_angle());
    let step = Check::new("step from a waypoint to the next", "mm", step_mm)
        .with_max(limits.max_step_mm, LimitSource::cell("limits.max_step_mm"))
        .or_reject("large_step", || {
            let [step, allowed] = distinguishable_texts(step_mm, limits.max_step_mm, 1);
            format!("the step from {before} to waypoint {index} is {step} mm (limit {allowed} mm)")
        });
    let turned = Check::new("turn of the tool from a waypoint to the next", "°", turn.0)
        .with_max(limits.max_turn.0, LimitSource::cell("limits.max_turn_deg"))
        .or_reject("large_turn", || {
            let [turn, allowed] = distinguishable_texts(turn.0, limits.max_turn.0, 3);
            format!("the tool turns by {turn}° from {before} to waypoint {index} (limit {allowed}°)")
        });
    [step, turned].into_iter().filter(|check| !check.is_met())
}

fn tilt_violation(index: usize, pose: &Rigid<Base, Tool>, taught: Vector<Base>, allowed: Degrees) -> Option<Check> {
    let tilt = (*pose * Vector::<Tool>::new(nalgebra::Vector3::z())).angle_between(taught);
    let message = || {
        let [tilt, allowed] = distinguishable_texts(tilt.0, allowed.0, 3);
        format!("at waypoint {index} the tool is tilted by {tilt}° from its taught direction (limit {allowed}°)")
    };
    let check = Check::new("tilt of the tool against its taught direction", "°", tilt.0)
        .with_max(allowed.0, LimitSource::cell("limits.max_tilt_deg"));
    (!check.is_met()).then(|| check.or_reject("tilt", message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{KukaPose, Point};

    fn limits() -> WaypointLimits {
        let workspace = Workspace { min: Point::at(0.0, -100.0, 0.0), max: Point::at(500.0, 100.0, 500.0) };
        WaypointLimits {
            workspace: Some(workspace),
            max_step_mm: 100.0,
            max_turn: Degrees(15.0),
            max_tilt: Degrees(40.0),
        }
    }

    /// The tool points along the base's X; `turn_deg` tilts it downwards.
    fn at(x_mm: f64, turn_deg: f64) -> Rigid<Base, Tool> {
        KukaPose { x_mm, z_mm: 300.0, b_deg: 90.0 + turn_deg, ..KukaPose::default() }.to_rigid()
    }

    fn codes(from: Rigid<Base, Tool>, waypoints: &[Rigid<Base, Tool>]) -> Vec<String> {
        let taught_axis = Some(Vector::new(nalgebra::Vector3::x()));
        let judgement = judge_route(&Route { from, waypoints, taught_axis }, &limits());
        judgement.reasons.iter().map(|reason| reason.code.to_string()).collect()
    }

    #[test]
    fn a_good_path_passes_up_to_its_limits() {
        assert_eq!(codes(at(100.0, 0.0), &[at(199.0, 14.0), at(298.0, 28.0), at(300.0, 39.0)]), [""; 0]);
    }

    /// Each defect is inserted in the middle of a valid path. It must reject the whole path with its own code.
    #[test]
    fn each_planted_defect_is_named() {
        let planted = |bad| codes(at(100.0, 0.0), &[at(150.0, 0.0), bad, at(250.0, 0.0)]);
        assert_eq!(planted(at(200.0, 0.0)), [""; 0]);
        assert_eq!(planted(at(f64::NAN, 0.0)), ["not_finite"]);
        assert_eq!(planted(at(200.0, f64::INFINITY)), ["not_finite"]);
        assert_eq!(planted(at(251.0, 0.0)), ["large_step"], "101 mm");
        assert_eq!(planted(at(200.0, 16.0)), ["large_turn"; 2], "there and back");
        let below = Rigid::followed_by_displacement(at(200.0, 0.0), Vector::new(nalgebra::Vector3::y() * -100.5));
        assert!(planted(below).contains(&"outside_box".to_owned()));
    }

    /// Calculated by hand: at y = −100.5 mm the tip is 0.5 mm below the box, at x = 502 mm it is 2 mm above the box.
    /// Each violation names the key of its limit; satisfied limits are not listed.
    #[test]
    fn a_check_states_how_far_and_whose_limit() {
        let broken = |bad: Rigid<Base, Tool>| {
            let route = Route { from: at(450.0, 0.0), waypoints: &[at(460.0, 0.0), bad], taught_axis: None };
            violated_by_route(&route, &limits())
        };
        let below = Rigid::followed_by_displacement(at(470.0, 0.0), Vector::new(nalgebra::Vector3::y() * -100.5));
        let outside = |bad, mm: f64, key| {
            let found = broken(bad).into_iter().find(|check| check.code.as_deref() == Some("outside_box"));
            let check = found.expect("outside");
            assert!((check.value.expect("measured") - mm).abs() < 1e-9, "{check:?}");
            assert_eq!(check.set_by, Some(LimitSource::cell(key)));
        };
        outside(below, 0.5, "limits.box_min_mm");
        outside(at(502.0, 0.0), 2.0, "limits.box_max_mm");
        assert_eq!(broken(at(470.0, 0.0)), []);
    }

    #[test]
    fn the_first_point_is_near_the_arm_and_the_tool_near_its_taught_axis() {
        assert_eq!(codes(at(100.0, 0.0), &[at(201.0, 0.0)]), ["large_step"]);
        assert_eq!(codes(at(100.0, 30.0), &[at(110.0, 41.0)]), ["tilt"]);
        assert_eq!(codes(at(100.0, 0.0), &[]), ["no_waypoints"]);
        let route = Route { from: at(1.0, 0.0), waypoints: &[at(2.0, 0.0)], taught_axis: None };
        let judgement = judge_route(&route, &WaypointLimits { workspace: None, ..limits() });
        assert_eq!(judgement.reasons[0].code, "no_box");
    }

    #[test]
    fn axes_are_finite_and_turn_once_at_most() {
        assert_eq!(judge_joints(&Joints { a4_deg: -360.0, ..Joints::default() }).reasons, []);
        assert_eq!(judge_joints(&Joints { a6_deg: 361.0, ..Joints::default() }).reasons[0].code, "axis_limit");
        assert_eq!(judge_joints(&Joints { a1_deg: f64::NAN, ..Joints::default() }).reasons[0].code, "axis_limit");
    }
}
