//! The limits that every pose of a path must satisfy: the axes' limits, the singularities, speeds and
//! accelerations, and the boxes that no part of the arm may enter.

use super::infeasible::{Infeasibility, Singularity};
use super::leg::CheckedPose;
use crate::path::kinematics::{JointAngles, Kinematics};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Point};

/// The part of the arm that may be near to the panel.
pub(super) const TOOL: &str = "tool";
/// Distance between points on the arm that are compared with the keep-out boxes, mm.
const SAMPLE_MM: f64 = 15.0;

/// Returns the first axis that exceeds its limits, which are reduced by the margin.
pub(super) fn first_exceeded_axis(arm: &Kinematics, at: &JointAngles) -> Option<Infeasibility> {
    let (axes, margin_deg) = (arm.arm().axes(), arm.arm().margins().limit_margin_deg());
    (0..6).find_map(|axis| {
        let allowed_deg = [axes.min_deg[axis] + margin_deg, axes.max_deg[axis] - margin_deg];
        let inside = (allowed_deg[0]..=allowed_deg[1]).contains(&at[axis]);
        (!inside).then_some(Infeasibility::AxisLimit { axis: axis + 1, angle_deg: at[axis], allowed_deg })
    })
}

/// Returns the reason that excludes all solutions: the axis limit that is exceeded least.
pub(super) fn axis_limit(arm: &Kinematics, ways: &[JointAngles]) -> Infeasibility {
    let far = |cause: &Infeasibility| match cause {
        Infeasibility::AxisLimit { angle_deg, allowed_deg, .. } => {
            (allowed_deg[0] - angle_deg).max(angle_deg - allowed_deg[1])
        }
        _ => f64::INFINITY,
    };
    let all = ways.iter().filter_map(|way| first_exceeded_axis(arm, way));
    all.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(Infeasibility::NotFinite)
}

/// Calculates the room beyond all margins, degrees.
pub(super) fn limit_room_deg(arm: &Kinematics, look: &CheckedPose, at: &JointAngles) -> Result<f64, Infeasibility> {
    if let Some(cause) = first_exceeded_axis(arm, at) {
        return Err(cause);
    }
    let margins = arm.arm().margins();
    let wrist_deg = at[4].abs().min(180.0 - at[4].abs());
    let checks = [
        (Singularity::Wrist, wrist_deg, margins.wrist_margin_deg()),
        (Singularity::Elbow, arm.elbow_deg(at), margins.elbow_margin_deg()),
        (Singularity::Overhead, arm.overhead_mm(&look.base_from_flange), margins.overhead_margin_mm()),
    ];
    if let Some((which, found, needed)) = checks.into_iter().find(|(_, found, needed)| found < needed) {
        return Err(Infeasibility::Singular { singularity: which, found, needed });
    }
    let (axes, margin_deg) = (arm.arm().axes(), margins.limit_margin_deg());
    let of_axis = |axis: usize| (at[axis] - axes.min_deg[axis]).min(axes.max_deg[axis] - at[axis]) - margin_deg;
    let least = (0..6).map(of_axis).fold(f64::INFINITY, f64::min);
    Ok(least.min(wrist_deg - margins.wrist_margin_deg()).min(arm.elbow_deg(at) - margins.elbow_margin_deg()))
}

/// Checks and returns the axes' speeds on a step, degrees a second.
pub(super) fn too_fast(
    arm: &Kinematics,
    look: &CheckedPose,
    turned: &JointAngles,
    before: &JointAngles,
) -> Result<JointAngles, Infeasibility> {
    let axes = arm.arm().axes();
    // A rotation on the spot takes as long as the controller plans.
    if look.seconds <= 0.0 {
        return Ok([0.0; 6]);
    }
    let speed: JointAngles = turned.map(|turn| turn / look.seconds);
    for axis in 0..6 {
        let (needed_deg_s, allowed_deg_s) = (speed[axis].abs(), axes.max_speed_deg_s[axis]);
        if needed_deg_s > allowed_deg_s {
            return Err(Infeasibility::AxisSpeed { axis: axis + 1, needed_deg_s, allowed_deg_s });
        }
        let Some(change_s) = look.change_s else { continue };
        let (needed_deg_s2, allowed_deg_s2) =
            ((speed[axis] - before[axis]).abs() / change_s, axes.max_acceleration_deg_s2[axis]);
        if needed_deg_s2 > allowed_deg_s2 {
            return Err(Infeasibility::AxisAcceleration { axis: axis + 1, needed_deg_s2, allowed_deg_s2 });
        }
    }
    Ok(speed)
}

/// Returns the arm's parts: each with its ends and its required distance, mm.
pub(super) fn parts(
    arm: &Kinematics,
    tip: Point<Base>,
    at: &JointAngles,
) -> [(&'static str, Point<Base>, Point<Base>, f64); 4] {
    let margins = arm.arm().margins();
    let [shoulder, elbow, wrist, flange] = arm.centre_line(at);
    [
        ("upper arm", shoulder, elbow, margins.clearance_mm()),
        ("forearm", elbow, wrist, margins.clearance_mm()),
        ("wrist", wrist, flange, margins.clearance_mm()),
        (TOOL, flange, tip, margins.tool_clearance_mm()),
    ]
}

/// Checks that neither a part of the arm nor the tool with its tip at this point is in a keep-out box or too near to a
/// box.
pub(super) fn check_keep_out(arm: &Kinematics, tip: Point<Base>, at: &JointAngles) -> Result<(), Infeasibility> {
    if arm.arm().keep_out().is_empty() {
        return Ok(());
    }
    let parts = parts(arm, tip, at);
    for keep_out in arm.arm().keep_out() {
        for (part, from, to, needed_mm) in parts {
            let samples = (from.distance_mm(to) / SAMPLE_MM).ceil().max(1.0) as usize;
            let along = |n: usize| from + (to - from) * (n as f64 / samples as f64);
            let outside = |point: Point<Base>| {
                let beyond = |i: usize| (keep_out.min.mm[i] - point.mm[i]).max(point.mm[i] - keep_out.max.mm[i]);
                Vector3::new(beyond(0), beyond(1), beyond(2)).map(|mm| mm.max(0.0)).norm()
            };
            let distance_mm = (0..=samples).map(|n| outside(along(n))).fold(f64::INFINITY, f64::min);
            if distance_mm < needed_mm {
                let name = keep_out.name.clone();
                return Err(Infeasibility::KeepOut { part, name, distance_mm, needed_mm });
            }
        }
    }
    Ok(())
}
