//! The limits that every pose of a path must satisfy, and the reasons why an arm cannot follow a path. As a text, a
//! reason contains the axis or the part of the arm, its value, and the limit.
//!
//! The limits are those of the axes, the singularities, speeds and accelerations, the boxes that no part of the arm may
//! enter, and the distances from the obstacles that a scan showed.

use crate::path::kinematics::{JointAngles, Kinematics};
use crate::path::obstacles::Obstacle;
use nalgebra::{Isometry3, Vector3};
use panelprep_base::geometry::{Base, Flange, Frame, Joints, Point, Rigid, Tool};
use panelprep_base::number_text::{distinguishable_texts, shortest_text};
use panelprep_cell::controller::RETRACT_MM;

/// Name of the arm's part that may approach the panel.
const TOOL: &str = "tool";
/// Distance between the points of the arm that are compared with the keep-out boxes, mm.
const ARM_POINT_DISTANCE_MM: f64 = 15.0;

/// Upper limit of the tool's required distance from an obstacle on a motion away from the end of a checked path, mm.
/// Elsewhere the configured distance is required. The joint motion that begins 40 mm above the demonstration's panel
/// brings the rim of the disc to 11.8 mm above the panel. The obstacles' points are thinned to 8 mm, so that a distance
/// of 8 mm can be measured as up to 10 mm.
const MAX_DEPARTURE_DISTANCE_MM: f64 = 10.0;
/// Minimum distance of the tool from the obstacle points at which it cannot pass through a surface, mm: a line that
/// passes between points 8 mm apart is nearer than this to one of the points.
const MIN_DEPARTURE_DISTANCE_MM: f64 = 8.0;
/// Length by which the arm's body may approach an obstacle on such a motion, mm. The configured distance of the body
/// includes half of its thickness.
const MAX_BODY_APPROACH_MM: f64 = 1.0;

/// The singularities of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Singularity {
    /// Axes 4 and 6 are aligned.
    Wrist,
    /// The arm is extended.
    Elbow,
    /// The wrist's centre is over axis 1.
    Overhead,
}

/// The reason why an arm cannot follow a path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Infeasibility {
    /// A number is not finite.
    #[error("the pose is not a valid number")]
    NotFinite,
    /// The pose is too far from the arm, or too near to it.
    #[error("the pose is {beyond_mm:.1} mm beyond the arm's reach")]
    OutOfReach {
        /// Distance of the pose beyond the reach, mm.
        beyond_mm: f64,
    },
    /// An axis exceeds its limits, which are reduced by the margin.
    #[error(
        "axis {axis} would be at {}°, the limits are {} to {}°", format_beyond(*angle_deg, *allowed_deg), shortest_text(allowed_deg[0]),
        shortest_text(allowed_deg[1])
    )]
    AxisLimit {
        /// Number of the axis, 1 to 6.
        axis: usize,
        /// The required angle of the axis, degrees.
        angle_deg: f64,
        /// Minimum and maximum angle after the margins are subtracted, degrees.
        allowed_deg: [f64; 2],
    },
    /// The arm is too near to a singularity.
    #[error("{} ({}, needed {})", describe_singularity(*singularity), distinguishable_texts(*found, *needed, 1)[0], distinguishable_texts(*found, *needed, 1)[1])]
    Singular {
        /// Kind of the singularity.
        singularity: Singularity,
        /// Distance from the singularity, degrees or mm.
        found: f64,
        /// Minimum distance from the singularity, degrees or mm.
        needed: f64,
    },
    /// The configuration of the arm would change.
    #[error(
        "axis {axis} would jump by {turn_deg:.0}°: the next pose can be reached only in another arm \
         configuration"
    )]
    Flip {
        /// Number of the axis, 1 to 6.
        axis: usize,
        /// Smallest possible rotation of the axis, degrees.
        turn_deg: f64,
    },
    /// The required speed of an axis is too high.
    #[error(
        "axis {axis} would rotate at {} °/s (limit {} °/s); lower feed_mm_s", distinguishable_texts(*needed_deg_s, *allowed_deg_s, 0)[0],
        distinguishable_texts(*needed_deg_s, *allowed_deg_s, 0)[1]
    )]
    AxisSpeed {
        /// Number of the axis, 1 to 6.
        axis: usize,
        /// Required speed, degrees per second.
        needed_deg_s: f64,
        /// Limit of the speed, degrees per second.
        allowed_deg_s: f64,
    },
    /// The required acceleration of an axis is too high.
    #[error(
        "axis {axis} would accelerate at {} °/s² (limit {} °/s²); lower feed_mm_s",
        distinguishable_texts(*needed_deg_s2, *allowed_deg_s2, 0)[0], distinguishable_texts(*needed_deg_s2, *allowed_deg_s2, 0)[1]
    )]
    AxisAcceleration {
        /// Number of the axis, 1 to 6.
        axis: usize,
        /// Required acceleration, degrees per second squared.
        needed_deg_s2: f64,
        /// Limit of the acceleration, degrees per second squared.
        allowed_deg_s2: f64,
    },
    /// A part of the arm is in a keep-out box or too near to an obstacle.
    #[error(
        "the {part} would be {} mm from \"{name}\", at least {} mm are needed", distinguishable_texts(*distance_mm, *needed_mm, 0)[0],
        distinguishable_texts(*distance_mm, *needed_mm, 0)[1]
    )]
    KeepOut {
        /// Name of the part of the arm, or of the tool.
        part: &'static str,
        /// Name of the keep-out box or the obstacle.
        name: String,
        /// Distance of the part from the box or obstacle, mm.
        distance_mm: f64,
        /// Minimum distance of the part, mm.
        needed_mm: f64,
    },
    /// The arm could not retract the tool after a stop in contact.
    #[error(
        "at a stop the controller lifts the tool by {} mm, which is not possible from this pose: {why}",
        RETRACT_MM
    )]
    Retract {
        /// The reason why the retraction is not possible.
        why: Box<Infeasibility>,
    },
}

impl Infeasibility {
    /// Returns the code with which a path is rejected for this reason.
    pub fn code(&self) -> &'static str {
        match self {
            Infeasibility::Retract { .. } => "retract_out_of_reach",
            _ => "out_of_reach",
        }
    }
}

/// Formats an angle beyond its limits, with enough digits to distinguish it from the exceeded limit.
fn format_beyond(angle_deg: f64, [low_deg, high_deg]: [f64; 2]) -> String {
    let [angle, _] = distinguishable_texts(angle_deg, if angle_deg < low_deg { low_deg } else { high_deg }, 1);
    angle
}

fn describe_singularity(which: Singularity) -> &'static str {
    match which {
        Singularity::Wrist => "axis 5 would be too near its singularity, degrees",
        Singularity::Elbow => "the arm would be too near the elbow singularity (arm extended), degrees",
        Singularity::Overhead => "the wrist would be too near axis 1, mm",
    }
}

/// The waypoint at which the arm cannot follow a path, and the reason.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("waypoint {index}: {cause}")]
pub struct ReachFault {
    /// Index of the waypoint, from 0. The cause is at the waypoint or on the motion to it.
    pub index: usize,
    /// The reason why the arm cannot follow.
    pub cause: Infeasibility,
}

/// Returns the violation by the first axis that exceeds its limits, which are reduced by the margin.
pub(super) fn first_exceeded_axis(arm: &Kinematics, at: &JointAngles) -> Option<Infeasibility> {
    let (axes, margin_deg) = (arm.arm().axes(), arm.arm().margins().limit_margin_deg());
    (0..6).find_map(|axis| {
        let allowed_deg = [axes.min_deg[axis] + margin_deg, axes.max_deg[axis] - margin_deg];
        let inside = (allowed_deg[0]..=allowed_deg[1]).contains(&at[axis]);
        (!inside).then_some(Infeasibility::AxisLimit { axis: axis + 1, angle_deg: at[axis], allowed_deg })
    })
}

/// Returns the violation with the smallest excess, if every solution exceeds an axis limit.
pub(super) fn smallest_axis_violation(arm: &Kinematics, ways: &[JointAngles]) -> Infeasibility {
    let far = |cause: &Infeasibility| match cause {
        Infeasibility::AxisLimit { angle_deg, allowed_deg, .. } => {
            (allowed_deg[0] - angle_deg).max(angle_deg - allowed_deg[1])
        }
        _ => f64::INFINITY,
    };
    let all = ways.iter().filter_map(|way| first_exceeded_axis(arm, way));
    all.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(Infeasibility::NotFinite)
}

/// Calculates the room after all margins, degrees.
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

/// Checks and returns the axes' speeds in a step, degrees per second.
pub(super) fn check_axis_speeds(
    arm: &Kinematics,
    look: &CheckedPose,
    turned: &JointAngles,
    before: &JointAngles,
) -> Result<JointAngles, Infeasibility> {
    let axes = arm.arm().axes();
    // A step without a duration is a pure rotation; it takes the time that the controller plans for it.
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
fn parts(
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

/// Checks that no part of the arm, and not the tool with its tip at this point, is inside of a keep-out box or too near
/// to one.
pub(super) fn check_keep_out(arm: &Kinematics, tip: Point<Base>, at: &JointAngles) -> Result<(), Infeasibility> {
    if arm.arm().keep_out().is_empty() {
        return Ok(());
    }
    let parts = parts(arm, tip, at);
    for keep_out in arm.arm().keep_out() {
        for (part, from, to, needed_mm) in parts {
            let samples = (from.distance_mm(to) / ARM_POINT_DISTANCE_MM).ceil().max(1.0) as usize;
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

/// One linear motion of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLine {
    /// The pose at the end of the line.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Speed of the tool centre point on this line, mm/s.
    pub feed_mm_s: f64,
    /// Rounding at the end of the line, mm; with 0 the arm stops there.
    pub blend_mm: f64,
}

/// A pose of a path at which the arm is checked.
pub(super) struct CheckedPose {
    pub index: usize,
    pub base_from_flange: Rigid<Base, Flange>,
    pub tip: Point<Base>,
    /// Time since the previous checked pose, s.
    pub seconds: f64,
    /// Time in which the speed changes since the previous checked pose, s; `None` if the arm stops in between.
    pub change_s: Option<f64>,
    /// Whether the pose is the end of a waypoint's motion.
    pub is_end: bool,
    pub solutions: Vec<JointAngles>,
}

/// Returns the pose at a fraction of a linear motion; the rotation is interpolated by the same fraction.
pub fn interpolate_pose<To: Frame>(from: Rigid<To, Tool>, to: Rigid<To, Tool>, share: f64) -> Rigid<To, Tool> {
    let (from, to) = (from.isometry(), to.isometry());
    let place = from.translation.vector.lerp(&to.translation.vector, share);
    // The interpolation between opposite rotations is not unique; the check at the end detects the jump.
    let turned = from.rotation.try_slerp(&to.rotation, share, 1e-9).unwrap_or(to.rotation);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(place.into(), turned))
}

/// Checks that no part of the arm, and not the tool with its tip at this point, is too near to an obstacle point.
pub(super) fn check_clearance(arm: &Kinematics, tip: Point<Base>, at: &JointAngles) -> Result<(), Infeasibility> {
    let Some(obstacles) = arm.obstacles() else { return Ok(()) };
    for (index, (part, from, to, needed_mm)) in parts(arm, tip, at).into_iter().enumerate() {
        for (number, obstacle) in obstacles.obstacles().iter().enumerate() {
            let needed_mm = arm.least_mm(number).map_or(needed_mm, |least_mm| least_mm[index]);
            let nearer_mm =
                obstacle.smallest_distance_mm(needed_mm, |point| distance_to_segment_mm(point, from, to));
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

/// Returns the arm with the required distances for a motion that begins with these axis angles, at the end of a checked
/// path near an obstacle. The tool must keep half of its distance at the start, but at most
/// [`MAX_DEPARTURE_DISTANCE_MM`] and at least [`MIN_DEPARTURE_DISTANCE_MM`]. The body must keep its distance at the
/// start, or the configured distance if that is smaller, minus [`MAX_BODY_APPROACH_MM`]. `None` if the angles are not
/// finite.
pub fn arm_for_departure(
    arm: &Kinematics,
    from: &Joints,
    flange_from_tool: Rigid<Flange, Tool>,
) -> Option<Kinematics> {
    let tip = (arm.base_from_flange(from)? * flange_from_tool).origin();
    let Some(obstacles) = arm.obstacles() else { return Some(arm.clone()) };
    let parts = parts(arm, tip, &from.degrees());
    let of_obstacle = |obstacle: &Obstacle| {
        parts.map(|(part, from, to, needed_mm)| {
            let nearer_mm =
                obstacle.smallest_distance_mm(needed_mm, |point| distance_to_segment_mm(point, from, to));
            let start_mm = nearer_mm.unwrap_or(needed_mm);
            match part {
                TOOL => (0.5 * start_mm).clamp(MIN_DEPARTURE_DISTANCE_MM, MAX_DEPARTURE_DISTANCE_MM).min(needed_mm),
                _ => start_mm - MAX_BODY_APPROACH_MM,
            }
        })
    };
    let least_mm = obstacles.obstacles().iter().map(of_obstacle).collect();
    Some(arm.clone().with_least_distances(least_mm))
}

/// Returns the distance of a point from the segment between two points, mm.
fn distance_to_segment_mm(point: Point<Base>, from: Point<Base>, to: Point<Base>) -> f64 {
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

    /// Expected values, calculated by hand: (30, 40, 0) is 40 mm beside the segment from the origin along X, (−30, 40,
    /// 0) is 50 mm from the segment's start.
    #[test]
    fn distances_from_a_line() {
        let line = |x: f64| {
            distance_to_segment_mm(Point::at(x, 40.0, 0.0), Point::at(0.0, 0.0, 0.0), Point::at(100.0, 0.0, 0.0))
        };
        assert!((line(30.0) - 40.0).abs() < 1e-12 && (line(-30.0) - 50.0).abs() < 1e-12);
    }

    /// A tool of 120 mm moves 60 mm along its axis; the required distance is 40 mm. An object 30 mm ahead of the end is
    /// too near, an object 60 mm ahead is not.
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
