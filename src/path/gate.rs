//! Judges a plan before anything moves: whole paths, rejected and never clipped.
//!
//! Looks at the poses as they would be sent, not at how they were made: every number finite, no large step, no large
//! turn between neighbours, contact only between air and air. Then at what the plan reaches: coverage, and the disc
//! beyond the panel's outline. Does not know the robot: reach, speed of the axes and keep-out boxes come where it is
//! known.

use super::coverage::MIN_COVERAGE;
use super::planned::{Plan, ToolPath, Waypoint};
use super::waypoint_gate::{Route, WaypointLimits, judge_route};
use crate::geometry::{Base, Degrees, Panel, Rigid, Tool, Vector};
use crate::recipe;
use crate::verdict::{Judgement, Reason};
use crate::words::{apart, fixed, percent_apart};
use nalgebra::{Isometry3, Vector3};

/// Largest turn of the tool from one waypoint to the next.
const MAX_TURN: Degrees = Degrees(15.0);
/// Waypoints may be this much farther apart than asked for: rows are resampled along chords.
const STEP_TOLERANCE: f64 = 1.02;

/// Lines are moved inwards until the disc reaches no farther than this over what is allowed, mm.
const OVERHANG_TOLERANCE_MM: f64 = 0.02;

/// Accepts a plan, asks a person, or rejects it, with reasons.
pub fn judge(plan: &Plan, settings: &recipe::Path) -> Judgement {
    let mut reject: Vec<Reason> = plan.paths.iter().flat_map(|path| motion_faults(path, settings)).collect();
    if reject.is_empty() && !plan.is_finite() {
        reject.push(Reason::new("not_finite", "the length, the time or the reach of the path is not a number"));
    }
    Judgement::of(reject, shortfalls(plan, settings))
}

/// The tool's Z on the panel at its nominal place: the mean over the plan.
pub fn taught_axis(plan: &Plan) -> Option<Vector<Base>> {
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let z = |waypoint: &Waypoint| (waypoint.panel_from_tool * Vector::<Tool>::new(Vector3::z())).mm;
    let mean: Vector3<f64> = waypoints.map(z).sum();
    // At the nominal place the panel's frame is the base.
    Vector::new(mean).direction()
}

/// The gate before a motion on a whole plan where the panel stands, from its first waypoint on: the cell's box, steps,
/// turns, and the tilt against the taught direction.
pub fn judge_in_base(plan: &Plan, base_from_panel: Rigid<Base, Panel>, limits: &WaypointLimits) -> Judgement {
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let poses: Vec<Rigid<Base, Tool>> =
        waypoints.map(|waypoint| base_from_panel * waypoint.panel_from_tool).collect();
    let from = poses.first().copied().unwrap_or_else(|| Rigid::claim(Isometry3::identity()));
    judge_route(&Route { from, waypoints: &poses, taught_axis: taught_axis(plan) }, limits)
}

/// Largest share of the pad's stroke that the error at the tool may take.
const ERROR_OF_STROKE: f64 = 1.0 / 3.0;

/// Accepts a press-in, or rejects it: the pad must take up the error at the tool (`[limits] tool_error_mm`) three times.
pub fn judge_pad(settings: &recipe::Path, tool_error_mm: Option<f64>) -> Judgement {
    let (Some(stroke_mm), true) = (settings.pad_stroke_mm(), settings.press_in_mm() > 0.0) else {
        return Judgement::of(vec![], vec![]);
    };
    let allowed_mm = ERROR_OF_STROKE * stroke_mm;
    let message = match tool_error_mm {
        Some(error_mm) if error_mm <= allowed_mm => return Judgement::of(vec![], vec![]),
        Some(error_mm) => {
            let [error, allowed] = apart(error_mm, allowed_mm, 2);
            format!(
                "the error at the tool is {error} mm, a pad of {stroke_mm} mm stroke takes up {allowed}; a softer pad takes up \
                 more"
            )
        }
        None => {
            "a press-in needs the error at the tool: state [limits] tool_error_mm in the cell's file".to_owned()
        }
    };
    Judgement::of(vec![Reason::new("pad_stroke", message)], vec![])
}

fn motion_faults(path: &ToolPath, settings: &recipe::Path) -> Vec<Reason> {
    let name = path.grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if let Some(index) = path.waypoints.iter().position(|waypoint| !waypoint.is_finite()) {
        return vec![Reason::new("not_finite", format!("grid {name}: waypoint {index} is not a number"))];
    }
    let mut reasons = Vec::new();
    let in_air = |waypoint: Option<&Waypoint>| waypoint.is_some_and(|waypoint| !waypoint.contact);
    if !(in_air(path.waypoints.first()) && in_air(path.waypoints.last())) {
        let message = format!("grid {name}: the path does not begin and end above the panel");
        reasons.push(Reason::new("no_air", message));
    }
    for (index, pair) in path.waypoints.windows(2).enumerate() {
        let (from, to) = (pair[0].panel_from_tool, pair[1].panel_from_tool);
        let (step_mm, turn) = (from.origin().distance_mm(to.origin()), turn_between(from, to));
        let limit_mm = if pair[0].contact && pair[1].contact {
            settings.waypoint_spacing_mm() * STEP_TOLERANCE
        } else {
            settings.waypoint_spacing_mm().max(settings.landing_mm())
                + settings.approach_mm()
                + settings.press_in_mm()
        };
        if step_mm > limit_mm {
            let [step, limit] = apart(step_mm, limit_mm, 2);
            let message = format!("grid {name}: {step} mm from waypoint {index} to the next, allowed {limit}");
            reasons.push(Reason::new("large_step", message));
        }
        if turn > MAX_TURN {
            let [turn, limit] = apart(turn.0, MAX_TURN.0, 3);
            let message = format!(
                "grid {name}: the tool turns by {turn}° from waypoint {index} to the next, allowed {limit}°; set a smaller \
                 waypoint_spacing_mm or another reference_axis"
            );
            reasons.push(Reason::new("large_turn", message));
        }
    }
    reasons
}

fn turn_between(from: Rigid<Panel, Tool>, to: Rigid<Panel, Tool>) -> Degrees {
    (from.inverse() * to).turn()
}

fn shortfalls(plan: &Plan, settings: &recipe::Path) -> Vec<Reason> {
    let mut reasons = Vec::new();
    for grid in plan.grids.iter().filter(|grid| grid.share() < MIN_COVERAGE) {
        let [reached, wanted] = percent_apart(grid.share(), MIN_COVERAGE, 2);
        let message = format!(
            "grid {}: the disc reaches {reached} %, wanted {wanted} %; a smaller step_over_mm reaches more, and so does a \
             larger edge_overhang_mm beside the panel's outline",
            grid.id
        );
        reasons.push(Reason::new("coverage", message));
    }
    let step_over_mm = plan.step_over_mm.map_or(0.0, |step_over| step_over.max_mm);
    if step_over_mm > settings.step_over_mm() {
        let [found, allowed] = apart(step_over_mm, settings.step_over_mm(), 2);
        let message = format!(
            "lines lie {found} mm apart, allowed is step_over_mm, {allowed}; another pattern or feed_angle_deg lays them closer"
        );
        reasons.push(Reason::new("step_over", message));
    }
    if let Some((ratio, grid)) = plan.dwell_ratio().filter(|(ratio, _)| *ratio > settings.max_dwell_ratio()) {
        let place = grid.map_or("over all that is treated".to_owned(), |id| format!("in grid {id}"));
        let [found, allowed] = apart(ratio, settings.max_dwell_ratio(), 2);
        let message = format!(
            "{place} the disc stays {found} times longer at one place than at another (95 % to 5 % of the treated area), \
             allowed is max_dwell_ratio, {allowed}; a smaller step_over_mm, a smaller disc, pattern = \"raster\" or more \
             grids at a time make it more even"
        );
        reasons.push(Reason::new("uneven", message));
    }
    if plan.overhang.largest_mm > settings.edge_overhang_mm() + OVERHANG_TOLERANCE_MM {
        let [reach, allowed] = apart(plan.overhang.largest_mm, settings.edge_overhang_mm(), 1);
        let message = format!(
            "the disc reaches {reach} mm beyond the panel's outline, at {} % of the waypoints more than edge_overhang_mm \
             allows, {allowed}; move the region inwards or take a smaller disc",
            fixed(100.0 * plan.overhang.share_beyond, 0)
        );
        reasons.push(Reason::new("edge_overhang", message));
    }
    reasons
}
