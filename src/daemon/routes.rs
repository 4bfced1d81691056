//! Paths as they are sent, each through the gate whole.
//!
//! A way through air is a straight line cut into steps, so that the gate sees all of it. A contact path is the plan's,
//! in the panel's frame, which is the base that was set.

use super::Job;
use crate::cell::Limits;
use crate::eki::{MoveLin, SetAccSpeed};
use crate::geometry::{Base, Degrees, KukaPose, Panel, Rigid, Tool, Vector};
use crate::path::{Plan, Route, Waypoint, WaypointLimits, judge_route};
use crate::verdict::{Judgement, Verdict};
use nalgebra::Vector3;

/// Steps of a way through air, at most.
const AIR_STEP_MM: f64 = 40.0;
const AIR_TURN: Degrees = Degrees(8.0);
/// Rounding at waypoints: of the step to the next, so that a path never stops on the panel, and a point in air.
const BLEND_SHARE: f64 = 0.2;
const AIR_BLEND_MM: f64 = 5.0;
/// Speed through air, mm/s, where the cell allows it.
const AIR_MM_S: f64 = 200.0;
const ACCELERATION_M_S2: f64 = 1.0;
/// Share of the axes' speed and acceleration between named poses, %.
pub(super) const AXIS_PERCENT: u8 = 20;

/// A path that may be sent, or why not.
#[derive(Debug, Clone)]
pub(super) struct Gated {
    pub judgement: Judgement,
    pub points: Vec<MoveLin>,
    pub speed: SetAccSpeed,
    /// Where the tip will stand, in the robot's base.
    pub end: Option<Rigid<Base, Tool>>,
}

impl Gated {
    pub fn is_good(&self) -> bool {
        self.judgement.verdict == Verdict::Accept
    }
}

/// The tool's Z on the panel at its nominal place: the mean over the plan.
pub(super) fn taught_axis(plan: &Plan) -> Option<Vector<Base>> {
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let z = |waypoint: &Waypoint| (waypoint.pose.to_rigid::<Panel, Tool>() * Vector::<Tool>::new(Vector3::z())).mm;
    let mean: Vector3<f64> = waypoints.map(z).sum();
    // At the nominal place the panel's frame is the base.
    Vector::new(mean).direction()
}

/// The plan's waypoints, one path after the other.
pub(super) fn waypoints(plan: &Plan) -> Vec<Waypoint> {
    plan.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect()
}

/// A straight way through air from where the arm stands, in a base that stands at `base_from_active`.
pub(super) fn air<Active: crate::geometry::Frame>(
    job: &Job<'_>,
    base_from_active: Rigid<Base, Active>,
    ends: (Rigid<Active, Tool>, Rigid<Active, Tool>),
    taught_axis: Option<Vector<Base>>,
) -> Gated {
    air_within(job.limits, base_from_active, ends, taught_axis, AIR_MM_S)
}

/// The same without a job, at a speed of its own.
pub(super) fn air_within<Active: crate::geometry::Frame>(
    limits: &Limits,
    base_from_active: Rigid<Base, Active>,
    (from, to): (Rigid<Active, Tool>, Rigid<Active, Tool>),
    taught_axis: Option<Vector<Base>>,
    speed_mm_s: f64,
) -> Gated {
    let (length_mm, turn) = (from.origin().distance_mm(to.origin()), (from.inverse() * to).turn());
    let steps = (length_mm / AIR_STEP_MM).max(turn.0 / AIR_TURN.0).ceil().clamp(1.0, 1_000.0) as usize;
    let poses: Vec<Rigid<Active, Tool>> = (1..=steps)
        .map(|step| if step == steps { to } else { between(from, to, step as f64 / steps as f64) })
        .collect();
    let points = poses.iter().enumerate().map(|(index, pose)| MoveLin {
        pose: KukaPose::from_rigid(pose),
        blend_mm: if index + 1 == steps { 0.0 } else { AIR_BLEND_MM.min(BLEND_SHARE * length_mm / steps as f64) },
        contact: false,
    });
    let speed_mm_s = speed_mm_s.min(limits.max_speed_mm_s());
    gated(limits, base_from_active, (from, points.collect()), (taught_axis, speed_mm_s))
}

/// The same plan with every point of contact lifted off the panel, along the tool's axis.
pub(super) fn lifted(plan: &Plan, height_mm: f64) -> Plan {
    let mut lifted = plan.clone();
    for waypoint in lifted.paths.iter_mut().flat_map(|path| &mut path.waypoints).filter(|waypoint| waypoint.contact)
    {
        let on_panel: Rigid<Panel, Tool> = waypoint.pose.to_rigid();
        let up = Rigid::<Tool, Tool>::identity().displaced(Vector::new(Vector3::z() * -height_mm));
        waypoint.pose = KukaPose::from_rigid(&(on_panel * up));
        waypoint.contact = false;
    }
    lifted
}

/// The path over the panel: all of the plan but its first point, the one in air where the arm already stands.
pub(super) fn contact(
    job: &Job<'_>,
    base_from_panel: Rigid<Base, Panel>,
    from: Rigid<Panel, Tool>,
    plan: &Plan,
) -> Gated {
    let all = waypoints(plan);
    let spacing_mm = job.recipe.path().waypoint_spacing_mm();
    let blend = |before: &Waypoint, next: Option<&Waypoint>, here: &Waypoint| {
        let rubs = [Some(before), Some(here), next].into_iter().flatten().all(|waypoint| waypoint.contact);
        if rubs { BLEND_SHARE * spacing_mm } else { 0.0 }
    };
    let points = all.windows(2).enumerate().map(|(index, pair)| MoveLin {
        pose: pair[1].pose,
        blend_mm: blend(&pair[0], all.get(index + 2), &pair[1]),
        contact: pair[1].contact,
    });
    let speed_mm_s = job.recipe.path().feed_mm_s().min(job.limits.max_speed_mm_s());
    gated(job.limits, base_from_panel, (from, points.collect()), (taught_axis(plan), speed_mm_s))
}

fn gated<Active: crate::geometry::Frame>(
    limits: &Limits,
    base_from_active: Rigid<Base, Active>,
    (from, points): (Rigid<Active, Tool>, Vec<MoveLin>),
    (taught_axis, speed_mm_s): (Option<Vector<Base>>, f64),
) -> Gated {
    // Judged as they will be sent, numbers and all.
    let poses: Vec<Rigid<Base, Tool>> =
        points.iter().map(|point| base_from_active * point.pose.to_rigid::<Active, Tool>()).collect();
    let route = Route { from: base_from_active * from, waypoints: &poses, taught_axis };
    Gated {
        judgement: judge_route(&route, &WaypointLimits::from(limits)),
        points,
        speed: SetAccSpeed {
            speed_m_s: speed_mm_s / 1_000.0,
            acceleration_m_s2: ACCELERATION_M_S2,
            axis_speed_percent: AXIS_PERCENT,
            axis_acceleration_percent: AXIS_PERCENT,
        },
        end: poses.last().copied(),
    }
}

fn between<Active: crate::geometry::Frame>(
    from: Rigid<Active, Tool>,
    to: Rigid<Active, Tool>,
    share: f64,
) -> Rigid<Active, Tool> {
    let (from, to) = (from.isometry(), to.isometry());
    let place = from.translation.vector.lerp(&to.translation.vector, share);
    // Opposite rotations have no way between them; the gate sees the turn.
    let turned = from.rotation.try_slerp(&to.rotation, share, 1e-9).unwrap_or(to.rotation);
    Rigid::claim(nalgebra::Isometry3::from_parts(place.into(), turned))
}
