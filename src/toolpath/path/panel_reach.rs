//! Checks whether the arm can reach the panel at its pose: a whole plan, and, before the panel is wetted, every grid.
//!
//! A round tool may have any rotation about its own axis (spin). Therefore twelve spins are tried for the whole path:
//! the first one with sufficient room is used, otherwise the one with the most room. *Room* is the smallest distance of
//! an axis or a singularity from its limit, after the configured margin is subtracted. The result applies only to the
//! plan with this spin, [`plan_with_spin`]. If the arm cannot follow, the message contains the grid, the waypoint, the
//! axis, the amount by which the axis exceeds its limit, and a shift of the panel with which the arm could follow.

use super::disc::DiscWearPlan;
use super::gate::judge_plan;
use super::kinematics::Kinematics;
use super::plan::plan;
use super::planned::{Plan, PlanError, Waypoint};
use super::reach::{
    ArmTravel, Infeasibility, PathLine, ReachFault, check_retracts, follow_path, helpful_shift, retract,
};
use crate::surface::dwell::surface_foot;
use crate::surface::{BSplineSurface, Parameter};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Degrees, Flange, Joints, Panel, Point, Rigid, Tool, Vector};
use panelprep_base::verdict::{Check, Judgement, Reason, Severity};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;
use rayon::prelude::*;

/// Spins that are tried in this order, degrees.
const TRIED_SPINS_DEG: [f64; 12] =
    [0.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0];
/// Sufficient room after the margins, degrees: a spin with this room is used without trying the others.
const SUFFICIENT_ROOM_DEG: f64 = 10.0;
/// Maximum number of waypoints that are checked in the search for a shift.
const MAX_SHIFT_WAYPOINTS: usize = 60;

/// The panel's pose relative to the arm, and the arm's tool.
#[derive(Debug, Clone, Copy)]
pub struct ReachSetup<'a> {
    /// The arm that follows the path.
    pub arm: &'a Kinematics,
    /// The sanding tool on the flange.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// The panel's present pose.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The axis angles before the linear motion to the plan's first point: the arm keeps their configuration. Without
    /// them the configuration with the most room is used.
    pub start_joints: Option<Joints>,
}

/// A plan that the arm can follow.
#[derive(Debug, Clone, PartialEq)]
pub struct ReachablePlan {
    /// Rotation of the tool about its own Z axis, for the whole plan.
    pub spin: Degrees,
    /// The axis angles at each waypoint, and the smallest room after the margins.
    pub arm_travel: ArmTravel,
}

/// A plan that the arm cannot follow.
#[derive(Debug, Clone, PartialEq)]
pub struct UnreachablePlan {
    /// The waypoint and the reason, for the spin with which the arm follows the plan farthest.
    pub fault: ReachFault,
    /// The point on the panel at which the arm cannot follow.
    pub at: Point<Panel>,
    /// A shift of the panel with which the arm could follow the plan.
    pub shift: Option<Vector<Base>>,
}

/// Finds a spin with which the arm can follow a plan.
///
/// # Errors
/// If the arm cannot follow the plan with any spin. The error contains the reason for the spin with which the arm
/// follows the plan farthest.
///
/// # Panics
/// If a number of the plan is not finite: see [`plan`].
pub fn follow_plan(
    plan: &Plan,
    stand: &ReachSetup<'_>,
    settings: &recipe::Path,
) -> Result<ReachablePlan, Box<UnreachablePlan>> {
    first_spin_with_room(plan, stand, settings, SUFFICIENT_ROOM_DEG)
}

/// Returns the first spin with at least this room after the margins; otherwise the spin with the most room.
fn first_spin_with_room(
    plan: &Plan,
    stand: &ReachSetup<'_>,
    settings: &recipe::Path,
    enough_deg: f64,
) -> Result<ReachablePlan, Box<UnreachablePlan>> {
    assert!(plan.is_finite(), "the path contains a number that is not finite");
    let spins = if settings.round_tool() { &TRIED_SPINS_DEG[..] } else { &TRIED_SPINS_DEG[..1] };
    let (mut best, mut farthest): (Option<ReachablePlan>, Option<(f64, ReachFault)>) = (None, None);
    for spin_deg in spins {
        match check_follow(plan, stand, *spin_deg) {
            Ok(travel) => {
                let enough = travel.room_deg >= enough_deg;
                if best.as_ref().is_none_or(|best| travel.room_deg > best.arm_travel.room_deg) {
                    best = Some(ReachablePlan { spin: Degrees(*spin_deg), arm_travel: travel });
                }
                if enough {
                    break;
                }
            }
            Err(fault) if farthest.as_ref().is_none_or(|(_, before)| fault.index > before.index) => {
                farthest = Some((*spin_deg, fault));
            }
            Err(_) => {}
        }
    }
    match (best, farthest) {
        (Some(best), _) => Ok(best),
        (None, Some((spin_deg, fault))) => Err(Box::new(unreachable_plan(plan, stand, spin_deg, fault))),
        // A plan without waypoints can always be followed.
        (None, None) => Ok(ReachablePlan {
            spin: Degrees(0.0),
            arm_travel: ArmTravel { joints: Vec::new(), room_deg: f64::INFINITY },
        }),
    }
}

/// Checks whether the arm can follow the path with this spin, and can retract after a stop at each waypoint in contact.
fn check_follow(plan: &Plan, stand: &ReachSetup<'_>, spin_deg: f64) -> Result<ArmTravel, ReachFault> {
    let legs = plan_legs(plan, stand, spin_deg);
    let travel = follow_path(stand.arm, stand.flange_from_tool, stand.start_joints.as_ref(), &legs)?;
    let in_contact = plan.paths.iter().flat_map(|path| &path.waypoints).map(|waypoint| waypoint.contact);
    let all = in_contact.zip(&legs).zip(&travel.joints);
    let all = all.map(|((contact, leg), joints)| (contact, leg.base_from_tool, *joints));
    check_retracts(stand.arm, stand.flange_from_tool, all)?;
    Ok(travel)
}

fn unreachable_plan(plan: &Plan, stand: &ReachSetup<'_>, spin_deg: f64, fault: ReachFault) -> UnreachablePlan {
    let legs = plan_legs(plan, stand, spin_deg);
    let thinned: Vec<PathLine> =
        legs.iter().step_by(legs.len().div_ceil(MAX_SHIFT_WAYPOINTS).max(1)).copied().collect();
    // The waypoints of a thinned path are far apart, so axis speeds cannot be checked: the path is followed at a low
    // feed.
    let mut slow: Vec<PathLine> =
        thinned.iter().map(|leg| PathLine { feed_mm_s: 5.0, blend_mm: 0.0, ..*leg }).collect();
    if matches!(fault.cause, Infeasibility::Retract { .. }) {
        // With the shift, the retraction must be possible as well.
        slow = slow
            .iter()
            .flat_map(|leg| [*leg, PathLine { feed_mm_s: 5.0, ..retract(leg.base_from_tool) }, *leg])
            .collect();
    }
    let at = legs
        .get(fault.index)
        .map_or(Point::at(0.0, 0.0, 0.0), |leg| stand.base_from_panel.inverse() * leg.base_from_tool.origin());
    UnreachablePlan { fault, at, shift: helpful_shift(stand.arm, stand.flange_from_tool, &slow) }
}

/// Returns the plan's motions as the arm receives them, with the tool rotated by this spin.
pub fn plan_legs(plan: &Plan, stand: &ReachSetup<'_>, spin_deg: f64) -> Vec<PathLine> {
    let spin = own_axis_rotation(Degrees(spin_deg));
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let leg = |waypoint: &Waypoint| PathLine {
        base_from_tool: stand.base_from_panel * waypoint.as_sent() * spin,
        feed_mm_s: waypoint.feed_mm_s,
        blend_mm: waypoint.blend_mm,
    };
    waypoints.map(leg).collect()
}

/// Returns the plan with the tool rotated by this spin: see [`ReachablePlan::spin`].
pub fn plan_with_spin(plan: &Plan, spin: Degrees) -> Plan {
    let mut plan = plan.clone();
    for waypoint in plan.paths.iter_mut().flat_map(|path| &mut path.waypoints) {
        waypoint.panel_from_tool = waypoint.as_sent() * own_axis_rotation(spin);
    }
    plan
}

fn own_axis_rotation(spin: Degrees) -> Rigid<Tool, Tool> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), spin.to_rad());
    Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::identity(), turn))
}

/// The result of the reach check for one grid.
#[derive(Debug, Clone)]
pub struct GridReach {
    /// The grid that was checked.
    pub id: GridId,
    /// The room after the margins, degrees, or the reason why the arm cannot follow the path.
    pub outcome: Result<f64, Box<UnreachablePlan>>,
    /// Area of the panel that the disc sweeps on the path over this grid alone, mm².
    pub swept_mm2: f64,
    /// The violated checks of the path over this grid alone; empty if the path is accepted.
    pub refused: Vec<Check>,
}

/// Checks for every grid of a region whether the arm can follow the path over this grid alone. The result is known
/// before the panel is wetted.
///
/// # Errors
/// If the surface permits no path over a grid.
///
/// # Panics
/// If a number of a plan is not finite: see [`follow_plan`].
pub fn check_grids(
    surface: &BSplineSurface,
    (region, outline): (&Region, &[Point<Panel>]),
    stand: &ReachSetup<'_>,
    settings: &recipe::Path,
) -> Result<Vec<GridReach>, PlanError> {
    let ids: Vec<GridId> = region.ids().collect();
    let of_grid = |id: &GridId| {
        let plan = plan(surface, region, &[*id], outline, settings)?;
        // A room of 0° is sufficient: only reachability is checked here, and the spin of the final path is chosen
        // later.
        let outcome = first_spin_with_room(&plan, stand, settings, 0.0).map(|reached| reached.arm_travel.room_deg);
        let mut refused = judge_plan(&plan, settings).0;
        refused.retain(|check| check.severity == Severity::Reject && check.reason().is_some());
        Ok(GridReach {
            id: *id,
            outcome,
            swept_mm2: DiscWearPlan::compute(&plan, settings, 0.0).swept_mm2,
            refused,
        })
    };
    let all: Vec<Result<GridReach, PlanError>> = ids.par_iter().map(of_grid).collect();
    all.into_iter().collect()
}

/// Returns the verdict on a region. It is accepted if the arm reaches every grid. If some grids are not reached, a
/// person decides, because these grids may pass the test and need no sanding. If no grid is reached, the panel is at a
/// wrong pose and is rejected. The region is also rejected if the plan checks reject the path over a grid, because no
/// person can accept a path that would never be sent.
pub fn judge_grids(grids: &[GridReach]) -> Judgement {
    Judgement::from_checks(&grid_violations(grids))
}

/// Returns a failed check for grids that are not reached, and the violated plan checks of the path over one grid; empty
/// if there are none.
pub fn grid_violations(grids: &[GridReach]) -> Vec<Check> {
    let is_none_reached = grids.iter().all(|grid| grid.outcome.is_err());
    let severity = if is_none_reached { Severity::Reject } else { Severity::Review };
    let unreached = |grid: &GridReach| {
        let unreached = grid.outcome.as_ref().err()?;
        let reason = Reason::new(
            unreached.fault.cause.code(),
            format!("grid {}, {}", grid.id, describe_unreachable(unreached)),
        );
        Some(Check::new(format!("{ROOM_NUMBER}, grid {}", grid.id), "°", None).with_reason(Some(reason), severity))
    };
    let refused = grids.iter().flat_map(|grid| grid.refused.iter().cloned());
    refused.chain(grids.iter().filter_map(unreached)).collect()
}

/// Checks the room that remains if the arm follows a plan. If the arm cannot follow, the plan is rejected; the message
/// contains the grid, the waypoint, the axis, the excess, and a remedy.
pub fn check_plan(
    reached: &Result<ReachablePlan, Box<UnreachablePlan>>,
    (surface, region): (&BSplineSurface, &Region),
) -> Check {
    let reason = |unreached: &UnreachablePlan| {
        let grid = grid_below(surface, region, unreached.at);
        let grid = grid.map_or_else(|| "beside the region".to_owned(), |id| format!("grid {id}"));
        Reason::new(unreached.fault.cause.code(), format!("{grid}, {}", describe_unreachable(unreached)))
    };
    let room_deg = reached.as_ref().ok().map(|reached| reached.arm_travel.room_deg);
    let refused = reached.as_ref().err().map(|unreached| reason(unreached));
    Check::new(ROOM_NUMBER, "°", room_deg).with_reason(refused, Severity::Reject)
}

/// Name of the check of [`check_plan`].
pub const ROOM_NUMBER: &str = "room beyond the arm's margins";

/// Returns the grid at a point of the panel; `None` outside of the region.
pub fn grid_below(surface: &BSplineSurface, region: &Region, point: Point<Panel>) -> Option<GridId> {
    let at = surface_foot(surface, Parameter { u: 0.5, v: 0.5 }, point)?;
    region.grid_at(region.pixel(nalgebra::Point2::new(at.u, at.v)))
}

fn describe_unreachable(unreached: &UnreachablePlan) -> String {
    let help = match unreached.shift {
        Some(shift) => {
            let axis = shift.mm.iamax();
            let sign = if shift.mm[axis] > 0.0 { '+' } else { '−' };
            format!("move the panel {:.0} mm towards {sign}{} of the base", shift.mm.norm(), ["X", "Y", "Z"][axis])
        }
        None => "the path cannot be reached with any shift of the panel along one axis of the base; use another \
             panel position or another tool"
            .to_owned(),
    };
    format!("{}; {help}", unreached.fault)
}
