//! Builds the paths that are sent to the controller. Each path passes the acceptance checks as a whole.
//!
//! A motion through air is a straight line that is divided into steps, so that all its parts are checked. A contact
//! path is the plan's path in the panel's frame, which is set as the base. Each path is checked with the arm's
//! kinematics from the current axis angles.

use super::gate::{PanelPoses, Route, WaypointLimits, check_pad, judge_plan, taught_axis, violated_by_route};
use super::kinematics::Kinematics;
use super::planned::{Plan, Waypoint};
use super::reach::{self, Obstacles, PathLine, ReachFault, check_retracts, follow_path, interpolate_pose};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Degrees, Flange, Joints, KukaPose, Panel, Rigid, Tool, Vector};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, Judgement, Reason, Severity, Verdict};
use panelprep_cell::cell::{self, Limits};
use panelprep_cell::controller::AIR_ACCELERATION_M_S2;
use panelprep_cell::recipe;
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

/// Maximum length of a step of a motion through air, mm.
const MAX_AIR_STEP_MM: f64 = 40.0;
/// Maximum rotation in a step of a motion through air.
const MAX_AIR_ROTATION: Degrees = Degrees(8.0);
/// Rounding between the steps of a motion through air, as a fraction of a step.
const AIR_BLEND_FRACTION: f64 = 0.2;
/// Maximum rounding between the steps of a motion through air, mm.
const MAX_AIR_BLEND_MM: f64 = 5.0;
/// Speed of motions through air, mm/s, unless the cell's limit is lower.
const AIR_SPEED_MM_S: f64 = 200.0;

/// Maximum distance between the tip calculated with the cell's arm and the tip that the controller reports, mm. A
/// larger distance means another arm, another tool or another mastering of an axis.
const MAX_MODEL_DEVIATION_MM: f64 = 3.0;
const MAX_MODEL_ROTATION: Degrees = Degrees(1.0);

/// The state of the arm before a path, and the limits for the path.
#[derive(Debug, Clone, Copy)]
pub struct StartState<'a> {
    /// The limits of the cell's file.
    pub limits: &'a Limits,
    /// The arm of the cell's file.
    pub arm: &'a cell::Arm,
    /// The tool that is set in the controller.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// The current axis angles.
    pub joints: Joints,
    /// The obstacles that the arm avoids; `None` if the motion leads to the panel.
    pub obstacles: Option<&'a Arc<Obstacles>>,
}

/// A linear motion to a point, in the active base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearMotion {
    /// The pose at the end of the motion.
    pub pose: KukaPose,
    /// Rounding at the end of the motion, mm; with 0 the arm stops there.
    pub blend_mm: f64,
    /// Whether the tool is in contact at the end of the motion.
    pub contact: bool,
    /// The speed of this motion, m/s; `None` for the path's speed.
    pub speed_m_s: Option<f64>,
}

/// Speed and acceleration of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSpeed {
    /// Speed of the tip, m/s.
    pub speed_m_s: f64,
    /// Acceleration of the tip, m/s².
    pub acceleration_m_s2: f64,
}

/// A path with the result of its acceptance checks.
#[derive(Debug, Clone)]
pub struct GatedPath {
    /// The violated checks; empty if the path may be sent.
    pub violations: Vec<Check>,
    /// The linear motions of the path.
    pub points: Vec<LinearMotion>,
    /// Speed and acceleration of the motions.
    pub speed: PathSpeed,
    /// The tip's pose at the end of the path, in the robot's base.
    pub end_pose: Option<Rigid<Base, Tool>>,
    /// The axis angles at the end of the path; `None` if the path is rejected.
    pub joints: Option<Joints>,
}

impl GatedPath {
    /// Returns whether the path may be sent.
    pub fn is_sendable(&self) -> bool {
        self.judgement().verdict == Verdict::Accept
    }

    /// Returns the verdict that follows from the violated checks.
    pub fn judgement(&self) -> Judgement {
        Judgement::from_checks(&self.violations)
    }

    /// Returns the path with additional violated checks.
    fn refused_for(self, mut broken: Vec<Check>) -> Self {
        broken.extend(self.violations);
        GatedPath { violations: broken, joints: None, ..self }
    }
}

/// Returns the waypoints of all paths of the plan, in order.
pub fn waypoints(plan: &Plan) -> Vec<Waypoint> {
    plan.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect()
}

/// Checks a linear motion through air from the arm's current pose. `base_from_active` is the pose of the active base.
pub fn gate_air_motion<Active: panelprep_base::geometry::Frame>(
    standing: &StartState<'_>,
    base_from_active: Rigid<Base, Active>,
    ends: (Rigid<Active, Tool>, Rigid<Active, Tool>),
    taught_axis: Option<Vector<Base>>,
) -> GatedPath {
    gate_air_motion_at(standing, base_from_active, ends, taught_axis, AIR_SPEED_MM_S)
}

/// Checks a linear motion through air at a given speed.
pub fn gate_air_motion_at<Active: panelprep_base::geometry::Frame>(
    standing: &StartState<'_>,
    base_from_active: Rigid<Base, Active>,
    (from, to): (Rigid<Active, Tool>, Rigid<Active, Tool>),
    taught_axis: Option<Vector<Base>>,
    speed_mm_s: f64,
) -> GatedPath {
    let (length_mm, turn) = (from.origin().distance_mm(to.origin()), (from.inverse() * to).rotation_angle());
    let steps = (length_mm / MAX_AIR_STEP_MM).max(turn.0 / MAX_AIR_ROTATION.0).ceil().clamp(1.0, 1_000.0) as usize;
    let poses: Vec<Rigid<Active, Tool>> = (1..=steps)
        .map(|step| if step == steps { to } else { interpolate_pose(from, to, step as f64 / steps as f64) })
        .collect();
    let points = poses.iter().enumerate().map(|(index, pose)| LinearMotion {
        pose: KukaPose::from_rigid(pose),
        // The last point is not rounded, because a picture is captured or the tool is started there.
        blend_mm: if index + 1 == steps {
            0.0
        } else {
            MAX_AIR_BLEND_MM.min(AIR_BLEND_FRACTION * length_mm / steps as f64)
        },
        contact: false,
        speed_m_s: None,
    });
    let speed_mm_s = speed_mm_s.min(standing.limits.max_speed_mm_s());
    gate_path(
        standing,
        base_from_active,
        (from, points.collect()),
        (taught_axis, speed_mm_s, AIR_ACCELERATION_M_S2),
    )
}

/// Returns the plan with every contact point moved off the panel along the tool's axis.
pub fn lift_contact_points(plan: &Plan, height_mm: f64) -> Plan {
    let mut lifted = plan.clone();
    for waypoint in lifted.paths.iter_mut().flat_map(|path| &mut path.waypoints).filter(|waypoint| waypoint.contact)
    {
        let up = Rigid::<Tool, Tool>::identity().followed_by_displacement(Vector::new(Vector3::z() * -height_mm));
        // The displacement is applied to the pose as sent, so that a run in air tests exactly the poses of the contact
        // path.
        waypoint.panel_from_tool = waypoint.as_sent() * up;
        waypoint.contact = false;
    }
    lifted
}

/// Checks the contact path over the panel: the whole plan without its first point, which is in the air and at which the
/// arm already is. Feed and rounding are those of each waypoint. A plan that the plan checks reject is not sent, even
/// if a person accepted the previous steps. Decisions that the plan checks request from a person have already been
/// made.
pub fn gate_contact_path(
    standing: &StartState<'_>,
    panel: PanelPoses,
    (from, plan): (Rigid<Panel, Tool>, &Plan),
    settings: &recipe::Path,
) -> GatedPath {
    let allowed_mm_s = standing.limits.max_speed_mm_s();
    let point = |waypoint: &Waypoint| LinearMotion {
        pose: waypoint.pose(),
        blend_mm: waypoint.blend_mm,
        contact: waypoint.contact,
        speed_m_s: Some(waypoint.feed_mm_s.min(allowed_mm_s) / 1_000.0),
    };
    let points: Vec<LinearMotion> = waypoints(plan).iter().skip(1).map(point).collect();
    let speed_mm_s = settings.feed_mm_s().min(allowed_mm_s);
    let acceleration_m_s2 = settings.acceleration_mm_s2() / 1_000.0;
    let axis = taught_axis(plan, panel.nominal);
    let gated = gate_path(standing, panel.now, (from, points), (axis, speed_mm_s, acceleration_m_s2));
    let in_contact = waypoints(plan).into_iter().filter(|waypoint| waypoint.contact);
    let places = in_contact.map(|waypoint| panel.now * waypoint.panel_from_tool);
    let of_plan = judge_plan(plan, settings).0.into_iter();
    let of_plan = of_plan
        .chain(check_pad(settings, standing.limits.tool_error_mm()))
        .chain(standing.check_correction_measured(places))
        .filter(|check| check.reason().is_some());
    let of_plan: Vec<Check> = of_plan.collect();
    if Judgement::from_checks(&of_plan).verdict != Verdict::Reject {
        return gated;
    }
    gated.refused_for(of_plan)
}

/// The sander on the flange.
#[derive(Debug, Clone, Copy)]
pub struct Sander {
    /// The contact point of the disc.
    pub flange_from_tip: Rigid<Flange, Tool>,
    /// The radius of the disc, mm. The disc's rim is farther away from the flange's axis than the contact point.
    pub radius_mm: f64,
    /// The distance by which the sander is retracted from the panel along its axis, mm.
    pub lift_mm: f64,
}

impl Sander {
    /// Creates the sander with this contact point and the disc of the recipe.
    pub fn new(flange_from_tip: Rigid<Flange, Tool>, settings: &recipe::Path) -> Self {
        Sander { flange_from_tip, radius_mm: settings.disc_diameter_mm() / 2.0, lift_mm: settings.approach_mm() }
    }

    /// Returns the points of the sander whose distances from obstacles are checked: the contact point, and eight points
    /// on the disc's rim.
    pub fn tips(&self) -> Vec<Rigid<Flange, Tool>> {
        let rim = |number: u32| {
            let (sine, cosine) = (f64::from(number) * FRAC_PI_4).sin_cos();
            let aside = Vector::new(Vector3::new(cosine, sine, 0.0) * self.radius_mm);
            self.flange_from_tip * Rigid::<Tool, Tool>::identity().followed_by_displacement(aside)
        };
        std::iter::once(self.flange_from_tip).chain((0..8).map(rim)).collect()
    }

    /// Returns whether all these points of the sander keep the configured distances from the obstacles.
    fn is_clear(&self, arm: &Kinematics, at: &Joints) -> bool {
        self.tips().into_iter().all(|tip| reach::is_clear(arm, tip, at))
    }
}

/// Checks the motion to a view of a corner. The end of the motion must lie in the volume in which the arm's correction
/// was measured. The camera is the tool of this motion; the sander beside the camera must keep its distances, too. If
/// the sander is at the panel, for example after a hold in contact, the sander is first retracted along its axis,
/// because a linear motion of the camera would drag it across the surface.
pub fn gate_view(
    standing: &StartState<'_>,
    (from, to): (Rigid<Base, Tool>, Rigid<Base, Tool>),
    sander: Sander,
) -> GatedPath {
    let arm = standing.kinematics();
    let tip = arm.base_from_flange(&standing.joints).map(|flange| flange * sander.flange_from_tip);
    let Some(tip) = tip.filter(|_| !sander.is_clear(&arm, &standing.joints)) else {
        return gate_camera_motion(standing, (from, to), sander);
    };
    let back = tip.isometry().rotation * Vector3::z() * -sander.lift_mm;
    let lifted = from.followed_by_displacement(Vector::new(back));
    // The panel is no obstacle for the sander, which moves away from the panel. For the arm and its camera, everything
    // is an obstacle.
    let leaving = StartState { obstacles: None, ..*standing };
    let lift = gate_air_motion(&leaving, Rigid::<Base, Base>::identity(), (from, lifted), None);
    let Some(joints) = lift.joints else { return lift };
    let departing = reach::arm_for_departure(&arm, &standing.joints, standing.flange_from_tool).unwrap_or(arm);
    let followed =
        check_mounted_motion(&departing, standing, (Rigid::identity(), &lift.points), standing.flange_from_tool);
    if let Err(reason) = followed {
        let check = Check::new("waypoint of the lift that the arm follows", "", None);
        return lift.refused_for(vec![check.with_reason(Some(reason), Severity::Reject)]);
    }
    let view = gate_camera_motion(&StartState { joints, ..*standing }, (lifted, to), sander);
    GatedPath { points: lift.points.into_iter().chain(view.points).collect(), ..view }
}

fn gate_camera_motion(
    standing: &StartState<'_>,
    (from, to): (Rigid<Base, Tool>, Rigid<Base, Tool>),
    sander: Sander,
) -> GatedPath {
    let gated = gate_air_motion(standing, Rigid::<Base, Base>::identity(), (from, to), None);
    if let Some(outside) = standing.check_correction_measured([to]) {
        return gated.refused_for(vec![outside]);
    }
    if !gated.is_sendable() {
        return gated;
    }
    let arm = standing.kinematics();
    let is_clear = sander.is_clear(&arm, &standing.joints);
    let follows_with = |tip: Rigid<Flange, Tool>| {
        // If the angles are not finite, the configured distances apply, and the motion is rejected below.
        let departing = reach::arm_for_departure(&arm, &standing.joints, tip).filter(|_| !is_clear);
        check_mounted_motion(departing.as_ref().unwrap_or(&arm), standing, (Rigid::identity(), &gated.points), tip)
    };
    let Some(reason) = sander.tips().into_iter().find_map(|tip| follows_with(tip).err()) else { return gated };
    let message = format!("with the sander: {}", reason.message);
    let check = Check::new("waypoint that the sander follows", "", None);
    gated.refused_for(vec![check.with_reason(Some(Reason { message, ..reason }), Severity::Reject)])
}

fn gate_path<Active: panelprep_base::geometry::Frame>(
    standing: &StartState<'_>,
    base_from_active: Rigid<Base, Active>,
    (from, points): (Rigid<Active, Tool>, Vec<LinearMotion>),
    (taught_axis, speed_mm_s, acceleration_m_s2): (Option<Vector<Base>>, f64, f64),
) -> GatedPath {
    // The poses are checked exactly as they are sent, with rounded numbers.
    let poses: Vec<Rigid<Base, Tool>> =
        points.iter().map(|point| base_from_active * point.pose.to_rigid::<Active, Tool>()).collect();
    let from = base_from_active * from;
    let route = Route { from, waypoints: &poses, taught_axis };
    let (mut broken, mut joints) = (violated_by_route(&route, &WaypointLimits::from(standing.limits)), None);
    // The arm's motion is checked only if all other checks pass, because it takes the most time, and because a step
    // that is too long would be reported a second time as an axis that is too fast.
    if broken.is_empty() {
        let legs = poses.iter().zip(&points).map(|(pose, point)| PathLine {
            base_from_tool: *pose,
            feed_mm_s: point.speed_m_s.map_or(speed_mm_s, |speed_m_s| 1_000.0 * speed_m_s),
            blend_mm: point.blend_mm,
        });
        let followed = standing.follow_lines(from, &legs.collect::<Vec<_>>());
        let leaves = followed.and_then(|travel| {
            standing.check_retracts(&points, &poses, &travel)?;
            Ok(travel.last().copied())
        });
        match leaves {
            Ok(last) => joints = last,
            Err(reason) => broken.push(
                Check::new("waypoint that the arm follows", "", None).with_reason(Some(reason), Severity::Reject),
            ),
        }
    }
    GatedPath {
        violations: broken,
        points,
        speed: PathSpeed { speed_m_s: speed_mm_s / 1_000.0, acceleration_m_s2 },
        end_pose: poses.last().copied(),
        joints,
    }
}

impl StartState<'_> {
    /// Returns the arm's kinematics with the obstacles that it must avoid.
    fn kinematics(&self) -> Kinematics {
        let arm = Kinematics::new(self.arm);
        match self.obstacles {
            Some(obstacles) => arm.with_obstacles(obstacles.clone()),
            None => arm,
        }
    }

    /// Checks that the arm's correction was measured at these tip poses, which must be exact.
    fn check_correction_measured(&self, tips: impl IntoIterator<Item = Rigid<Base, Tool>>) -> Option<Check> {
        let (arm, tool_from_flange) = (Kinematics::new(self.arm), self.flange_from_tool.inverse());
        let outside =
            tips.into_iter().map(|tip| tip * tool_from_flange).find(|flange| !arm.is_correction_measured(flange));
        outside.map(|flange| {
            let place = KukaPose::from_rigid(&flange);
            let message = format!(
                "the flange would be at {place}, outside the volume in which the arm's correction was measured; \
                 calibrate the arm with pictures from there, or with axis angles"
            );
            let check = Check::new("pose of the flange where the arm's correction was measured", "", None);
            check.with_consequence_if(true, Severity::Reject, "outside_correction", || message)
        })
    }

    /// Checks whether the arm can retract from the panel from each waypoint in contact.
    fn check_retracts(
        &self,
        points: &[LinearMotion],
        poses: &[Rigid<Base, Tool>],
        joints: &[Joints],
    ) -> Result<(), Reason> {
        let all =
            points.iter().zip(poses).zip(joints).map(|((point, pose), joints)| (point.contact, *pose, *joints));
        check_retracts(&Kinematics::new(self.arm), self.flange_from_tool, all).map_err(|fault| to_reason(&fault))
    }

    /// Returns the axis angles at the end of each of these lines, from the current axis angles on, or the reason why
    /// the arm cannot follow.
    fn follow_lines(&self, from: Rigid<Base, Tool>, legs: &[PathLine]) -> Result<Vec<Joints>, Reason> {
        let arm = self.kinematics();
        // This is checked first, because all other checks compute with this model of the arm: for another arm their
        // results would be wrong.
        check_arm_identity(&arm, &self.joints, self.flange_from_tool, from)?;
        match follow_path(&arm, self.flange_from_tool, Some(&self.joints), legs) {
            Ok(travel) => Ok(travel.joints),
            Err(fault) => Err(to_reason(&fault)),
        }
    }
}

/// Checks that the tip's pose computed from the axis angles and the cell's arm agrees with the pose that the controller
/// reports. The two poses differ for another arm, for angles in another unit, or for another robot base (`$ROBROOT`).
///
/// # Errors
/// If the two poses differ by more than the limits. The error contains the distance between them.
pub fn check_arm_identity(
    arm: &Kinematics,
    joints: &Joints,
    flange_from_tool: Rigid<Flange, Tool>,
    reported: Rigid<Base, Tool>,
) -> Result<(), Reason> {
    let by_model = arm.base_from_flange(joints).map(|flange| flange * flange_from_tool);
    let unknown = || {
        Reason::new(
            "arm_model",
            "the axis angles that the controller reports are not valid numbers; read the controller's messages",
        )
    };
    let by_model = by_model.ok_or_else(unknown)?;
    let (off_mm, off) =
        (by_model.origin().distance_mm(reported.origin()), (by_model.inverse() * reported).rotation_angle());
    if off_mm <= MAX_MODEL_DEVIATION_MM && off.0 <= MAX_MODEL_ROTATION.0 {
        return Ok(());
    }
    let [mm, allowed_mm] = distinguishable_texts(off_mm, MAX_MODEL_DEVIATION_MM, 1);
    let [deg, allowed_deg] = distinguishable_texts(off.0, MAX_MODEL_ROTATION.0, 3);
    let message = format!(
        "the TCP calculated from the axis angles and [arm] is {mm} mm and {deg}° from the TCP that the controller \
         reports (limits {allowed_mm} mm and {allowed_deg}°); check that the cell's file describes this arm"
    );
    Err(Reason::new("arm_model", message))
}

/// Checks whether another object that is mounted on the flange keeps its distances during the same linear motion.
///
/// # Errors
/// If the object comes too near to an obstacle. The error contains the number of the waypoint.
pub fn check_mounted_object(
    standing: &StartState<'_>,
    base_from_active: Rigid<Base, Base>,
    points: &[LinearMotion],
    flange_from_mounted: Rigid<Flange, Tool>,
) -> Result<(), Reason> {
    check_mounted_motion(&standing.kinematics(), standing, (base_from_active, points), flange_from_mounted)
}

fn check_mounted_motion(
    arm: &Kinematics,
    standing: &StartState<'_>,
    (base_from_active, points): (Rigid<Base, Base>, &[LinearMotion]),
    flange_from_mounted: Rigid<Flange, Tool>,
) -> Result<(), Reason> {
    let tool_from_mounted: Rigid<Tool, Tool> =
        Rigid::from_isometry_unchecked(*(standing.flange_from_tool.inverse() * flange_from_mounted).isometry());
    let legs: Vec<PathLine> = points
        .iter()
        .map(|point| PathLine {
            base_from_tool: base_from_active * point.pose.to_rigid::<Base, Tool>() * tool_from_mounted,
            // The axis speeds were checked with the active tool; only distances and configuration are checked here.
            feed_mm_s: 1.0,
            blend_mm: point.blend_mm,
        })
        .collect();
    follow_path(arm, flange_from_mounted, Some(&standing.joints), &legs)
        .map(drop)
        .map_err(|fault| to_reason(&fault))
}

/// Converts a fault to a reason. The fault's index counts waypoints from 0, the message counts them from 1.
fn to_reason(fault: &ReachFault) -> Reason {
    Reason::new(fault.cause.code(), format!("waypoint {}: {}", fault.index + 1, fault.cause))
}
