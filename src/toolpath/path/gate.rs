//! The acceptance checks (gates) before a motion: a plan, or a motion before its start, is accepted or rejected as a
//! whole and never modified.
//!
//! The gate of a plan checks the poses that will be sent, and not the calculation that led to them. Every number is
//! finite, no step and no rotation between successive waypoints is too large, and each path begins and ends in the air.
//! Then the gate checks the plan's results: coverage, uniformity of the dwell time, and the disc's overhang beyond the
//! panel's outline. This gate does not know the robot: reach, axis speeds and keep-out boxes are checked in the modules
//! with the arm's kinematics.
//!
//! The gate of a motion checks the tool's tip in the robot's base, with the base and tool that the controller will use.
//! Every number is finite, every point lies inside of the cell's box, the first point is near the arm's current pose,
//! and no step and no rotation between successive points is too large. Near the panel it also limits the tilt against
//! the tool's direction at teaching, because a wrong base causes a large tilt. The reach is checked in the modules with
//! the arm's kinematics.

use super::coverage::{GridCoverage, MIN_COVERAGE};
use super::planned::{Plan, ToolPath, Waypoint};
use nalgebra::{Isometry3, Vector3};
use panelprep_base::geometry::{Base, Degrees, Joints, Panel, Rigid, Tool, Vector};
use panelprep_base::number_text::{
    distinguishable_percents, distinguishable_texts, fixed_decimals, list, shortest_text,
};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Severity};
use panelprep_cell::cell::{Limits, Workspace};
use panelprep_cell::recipe;
use panelprep_cell::record::name;

/// Maximum rotation of the tool from one waypoint to the next.
const MAX_STEP_ROTATION: Degrees = Degrees(15.0);
/// Tolerance factor on the distance between waypoints, because rows are resampled along chords.
const STEP_TOLERANCE: f64 = 1.02;

/// Name of the check of the error at the tool, which applies to paths with a press-in.
pub const TOOL_ERROR: &str = "error at the tool, against what the pad takes up";
/// Start of the name of the check for a grid with too little coverage.
pub const GRID_CHECK_PREFIX: &str = "coverage of grid ";

/// Maximum error at the tool, as a fraction of the pad's stroke.
const MAX_ERROR_FRACTION_OF_STROKE: f64 = 1.0 / 3.0;

/// Maximum absolute value of a commanded axis angle, degrees.
const MAX_AXIS_DEG: f64 = 360.0;

/// Returns the verdict on a plan: accepted, rejected, or to be decided by a person, with the reasons.
pub fn judge(plan: &Plan, settings: &recipe::Path) -> Judgement {
    judge_plan(plan, settings).1
}

/// Returns all checks of a plan, and the verdict that follows from the checks.
pub fn judge_plan(plan: &Plan, settings: &recipe::Path) -> (Vec<Check>, Judgement) {
    let mut of_motion: Vec<Check> = plan.paths.iter().flat_map(|path| broken_steps(path, settings)).collect();
    if of_motion.is_empty() && !plan.is_finite() {
        let words = || {
            "the length, the time or the reach of the path is not a valid number: report this fault \
            of the program"
                .to_owned()
        };
        of_motion.push(not_finite_check("length, time and reach of the path", words));
    }
    let checks = [of_motion, coverage(plan), breaks(plan), uniformity_checks(plan, settings)].concat();
    let judgement = Judgement::from_checks(&checks);
    (checks, judgement)
}

/// The panel's present pose, and its nominal pose.
#[derive(Debug, Clone, Copy)]
pub struct PanelPoses {
    /// The present pose, as the localization found it.
    pub now: Rigid<Base, Panel>,
    /// The pose at which the panel was taught.
    pub nominal: Rigid<Base, Panel>,
}

/// Returns the mean direction of the tool's Z axis over the plan, with the panel at its nominal pose.
pub fn taught_axis(plan: &Plan, nominal_pose: Rigid<Base, Panel>) -> Option<Vector<Base>> {
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let z = |waypoint: &Waypoint| (waypoint.panel_from_tool * Vector::<Tool>::new(Vector3::z())).mm;
    let mean: Vector<Panel> = Vector::new(waypoints.map(z).sum());
    (nominal_pose * mean).direction()
}

/// Applies the checks of a motion (box, steps, rotations, tilt against the taught direction) to a whole plan at the
/// panel's present pose. Returns the violated checks.
pub fn violated_in_base(plan: &Plan, panel: PanelPoses, limits: &WaypointLimits) -> Vec<Check> {
    let waypoints = plan.paths.iter().flat_map(|path| &path.waypoints);
    let poses: Vec<Rigid<Base, Tool>> = waypoints.map(|waypoint| panel.now * waypoint.panel_from_tool).collect();
    // During planning, the arm's pose before the path is not known, so the length of the first step is 0 here. The gate
    // before the motion checks this step from the actual pose.
    let from = poses.first().copied().unwrap_or_else(|| Rigid::from_isometry_unchecked(Isometry3::identity()));
    violated_by_route(&Route { from, waypoints: &poses, taught_axis: taught_axis(plan, panel.nominal) }, limits)
}

/// Returns the verdict on a press-in: the pad's stroke must be at least three times the error at the tool (`[limits]
/// tool_error_mm`).
pub fn judge_pad(settings: &recipe::Path, tool_error_mm: Option<f64>) -> Judgement {
    Judgement::from_checks(&check_pad(settings, tool_error_mm))
}

/// Checks the error at the tool against the error that the pad can absorb; `None` if the path has no press-in.
pub fn check_pad(settings: &recipe::Path, tool_error_mm: Option<f64>) -> Option<Check> {
    let stroke_mm = settings.pad_stroke_mm().filter(|_| settings.press_in_mm() > 0.0)?;
    let allowed_mm = MAX_ERROR_FRACTION_OF_STROKE * stroke_mm;
    let check =
        Check::new(TOOL_ERROR, "mm", tool_error_mm).with_max(allowed_mm, LimitSource::recipe("path.pad_stroke_mm"));
    // If the cell's file does not contain the error, the check fails.
    let is_absorbed = tool_error_mm.is_some() && check.is_met();
    Some(check.with_consequence_if(!is_absorbed, Severity::Reject, "pad_stroke", || match tool_error_mm {
        Some(error_mm) => {
            let [error, allowed] = distinguishable_texts(error_mm, allowed_mm, 2);
            format!(
                "the error at the tool is {error} mm, but a pad of {stroke_mm} mm stroke absorbs only {allowed} \
                 mm; use a softer pad"
            )
        }
        None => {
            "press_in_mm requires the error at the tool; add [limits] tool_error_mm to the cell's file".to_owned()
        }
    }))
}

/// Creates the failed check for a number of the path that is not finite.
fn not_finite_check(what: &str, words: impl FnOnce() -> String) -> Check {
    Check::new(what, "", f64::NAN).with_consequence_if(true, Severity::Reject, "not_finite", words)
}

/// Returns a failed check for each step or rotation between waypoints that exceeds its limit.
fn broken_steps(path: &ToolPath, settings: &recipe::Path) -> Vec<Check> {
    let name = path.grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if let Some(index) = path.waypoints.iter().position(|waypoint| !waypoint.is_finite()) {
        let words = || {
            format!(
                "grid {name}: the pose of waypoint {index} is not a valid number: report this \
            fault of the program"
            )
        };
        return vec![not_finite_check("waypoint", words)];
    }
    let mut broken = Vec::new();
    let in_air = |waypoint: Option<&Waypoint>| waypoint.is_some_and(|waypoint| !waypoint.contact);
    // The tool starts and stops at the ends of the path; on the panel it would sand too deep there.
    if !(in_air(path.waypoints.first()) && in_air(path.waypoints.last())) {
        let words = || {
            format!(
                "grid {name}: the path must begin and end above the panel: report this fault of \
            the program"
            )
        };
        let ends = Check::new("ends of the path above the panel", "", None);
        broken.push(ends.with_consequence_if(true, Severity::Reject, "no_air", words));
    }
    for (index, pair) in path.waypoints.windows(2).enumerate() {
        let (from, to) = (pair[0].panel_from_tool, pair[1].panel_from_tool);
        let (step_mm, turn) = (from.origin().distance_mm(to.origin()), rotation_between(from, to));
        // A descent or a lift covers the approach height in one step; only on the panel must the chord between two
        // waypoints be short.
        let limit_mm = if pair[0].contact && pair[1].contact {
            settings.waypoint_spacing_mm() * STEP_TOLERANCE
        } else {
            settings.waypoint_spacing_mm().max(settings.landing_mm())
                + settings.approach_mm()
                + settings.press_in_mm()
        };
        let step = Check::new("step from a waypoint to the next", "mm", step_mm)
            .with_max(limit_mm, LimitSource::recipe("path.waypoint_spacing_mm"))
            .or_reject("large_step", || {
                let [step, limit] = distinguishable_texts(step_mm, limit_mm, 2);
                format!("grid {name}: the step from waypoint {index} to the next is {step} mm (limit {limit} mm)")
            });
        let turned = Check::new("turn of the tool from a waypoint to the next", "°", turn.0)
            .with_max(MAX_STEP_ROTATION.0, LimitSource::Program)
            .or_reject("large_turn", || {
                let [turn, limit] = distinguishable_texts(turn.0, MAX_STEP_ROTATION.0, 3);
                format!(
                    "grid {name}: the tool rotates by {turn}° from waypoint {index} to the next (limit {limit}°); \
                     set a smaller waypoint_spacing_mm or another reference_axis"
                )
            });
        broken.extend([step, turned].into_iter().filter(|check| !check.is_met()));
    }
    broken
}

fn rotation_between(from: Rigid<Panel, Tool>, to: Rigid<Panel, Tool>) -> Degrees {
    (from.inverse() * to).rotation_angle()
}

/// Checks the coverage of the grids: one check for the worst grid, and a check for each grid with too little coverage.
fn coverage(plan: &Plan) -> Vec<Check> {
    let check = |name: String, share: f64, words: &dyn Fn() -> String| {
        Check::new(name, "", share).with_min(MIN_COVERAGE, LimitSource::Program).or_review("coverage", words)
    };
    let words = |grid: &GridCoverage| {
        let [reached, wanted] = distinguishable_percents(grid.covered_fraction(), MIN_COVERAGE, 2);
        format!(
            "grid {}: the disc covers {reached} %, at least {wanted} % are needed; use a smaller step_over_mm, or \
             near the panel's outline a larger edge_overhang_mm",
            grid.id
        )
    };
    let worst = plan.grids.iter().min_by(|a, b| a.covered_fraction().total_cmp(&b.covered_fraction()));
    let least = worst.map_or(1.0, GridCoverage::covered_fraction);
    // The value is that of the worst grid, because in a large region the mean would hide a grid of which a tenth is not
    // covered.
    let of_worst = check(name::COVERAGE.to_owned(), least, &|| worst.map_or(String::new(), words));
    let short =
        plan.grids.iter().filter(|grid| grid.covered_fraction().is_nan() || grid.covered_fraction() < MIN_COVERAGE);
    let short = short
        .map(|grid| check(format!("{GRID_CHECK_PREFIX}{}", grid.id), grid.covered_fraction(), &|| words(grid)));
    [Check::new("coverage of these grids", "", plan.coverage), of_worst].into_iter().chain(short).collect()
}

/// Checks that the disc reaches every break. Returns no check if the position of no break is known, because the grids
/// are then treated completely.
fn breaks(plan: &Plan) -> Vec<Check> {
    let Some(share) = plan.breaks_reached else { return vec![] };
    let check = Check::new(name::BREAKS_REACHED, "", share).with_min(1.0, LimitSource::Program);
    vec![check.or_review("break_missed", || {
        let [reached, wanted] = distinguishable_percents(share, 1.0, 2);
        format!(
            "with their uncertainty, the disc reaches only {reached} % of the water breaks (limit {wanted} %); look at the \
             planned path; permit a larger edge_overhang_mm if the breaks lie at the panel's outline, or set [treat] \
             by = \"grid\""
        )
    })]
}

/// Checks the uniformity of the dwell time, and the disc's overhang beyond the outline.
fn uniformity_checks(plan: &Plan, settings: &recipe::Path) -> Vec<Check> {
    let steps = plan.step_over_mm;
    let (largest_mm, allowed_mm) = (plan.overhang.largest_mm, settings.edge_overhang_mm());
    let ratio = plan.dwell_ratio();
    vec![
        Check::new("step-over, smallest", "mm", steps.map(|step| step.min_mm)),
        Check::new("step-over, largest", "mm", steps.map(|step| step.max_mm))
            .with_max(settings.step_over_mm(), LimitSource::recipe("path.step_over_mm"))
            .or_review("step_over", || {
                let found_mm = steps.map_or(0.0, |step| step.max_mm);
                let [found, allowed] = distinguishable_texts(found_mm, settings.step_over_mm(), 2);
                format!(
                    "the lines are {found} mm apart (limit {allowed} mm, step_over_mm); choose another pattern or \
                     feed_angle_deg"
                )
            }),
        Check::new("time under the disc, 5 % of the treated area", "s", plan.dwell.map(|dwell| dwell.low_s)),
        Check::new("time under the disc, 95 % of the treated area", "s", plan.dwell.map(|dwell| dwell.high_s)),
        Check::new(name::DWELL_RATIO, "", ratio.map(|(ratio, _)| ratio))
            .with_max(settings.max_dwell_ratio(), LimitSource::recipe("path.max_dwell_ratio"))
            .or_review("uneven", || {
                let (ratio, grid) = ratio.unwrap_or((f64::NAN, None));
                let place = grid.map_or("over the whole treated area".to_owned(), |id| format!("in grid {id}"));
                let [found, allowed] = distinguishable_texts(ratio, settings.max_dwell_ratio(), 2);
                format!(
                    "{place}, the dwell time differs by a factor of {found} (95 % to 5 % quantile of the treated \
                     area; limit {allowed}, max_dwell_ratio); use a smaller step_over_mm, a smaller disc, pattern \
                     = \"raster\" or more grids at a time"
                )
            }),
        Check::new("disc beyond the panel's outline", "mm", largest_mm)
            .with_max(allowed_mm, LimitSource::recipe("path.edge_overhang_mm"))
            .or_review("edge_overhang", || {
                let [reach, allowed] = distinguishable_texts(largest_mm, allowed_mm, 1);
                format!(
                    "the disc reaches {reach} mm beyond the panel's outline (limit {allowed} mm, \
                     edge_overhang_mm) and exceeds this limit at {} % of the waypoints; move the region \
                     inwards or use a smaller disc",
                    fixed_decimals(100.0 * plan.overhang.share_beyond, 0)
                )
            }),
    ]
}

/// The limits of a path of linear motions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WaypointLimits {
    /// The box that the tip must not leave; without a box, no linear motion is permitted.
    pub workspace: Option<Workspace>,
    /// Maximum length of a step, mm.
    pub max_step_mm: f64,
    /// Maximum rotation in one step.
    pub max_turn: Degrees,
    /// Maximum angle between the tool's axis and its taught direction.
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

/// A path of linear motions from the arm's current pose.
#[derive(Debug, Clone, Copy)]
pub struct Route<'a> {
    /// The arm's current pose, as reported by the controller.
    pub from: Rigid<Base, Tool>,
    /// The target poses of the motions.
    pub waypoints: &'a [Rigid<Base, Tool>],
    /// The direction of the tool's Z axis on the panel at its nominal pose; `None` for a path away from the panel.
    pub taught_axis: Option<Vector<Base>>,
}

/// Returns the verdict on a path of linear motions as a whole.
pub fn judge_route(route: &Route<'_>, limits: &WaypointLimits) -> Judgement {
    Judgement::from_checks(&violated_by_route(route, limits))
}

/// Returns a failed check for each limit that a path of linear motions violates; empty if the path may be sent.
pub fn violated_by_route(route: &Route<'_>, limits: &WaypointLimits) -> Vec<Check> {
    let nothing_moves = |what: &str, code: &'static str, words: String| {
        vec![Check::new(what, "", None).with_consequence_if(true, Severity::Reject, code, || words)]
    };
    let Some(workspace) = limits.workspace else {
        let message = "box_min_mm and box_max_mm are missing in [limits] of the cell's file; without them the \
            robot makes no linear motions; add both";
        return nothing_moves("the cell's box", "no_box", message.to_owned());
    };
    if route.waypoints.is_empty() {
        return nothing_moves("waypoints", "no_waypoints", "the path has no waypoint".to_owned());
    }
    // The current pose of the arm comes first, because a wrong current pose causes the longest step.
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

/// Returns the verdict on axis angles: each must be finite and within ±360°.
pub fn judge_joints(joints: &Joints) -> Judgement {
    let angles = joints.degrees();
    // A comparison with NaN is always false, so NaN is checked explicitly.
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

fn is_finite_pose(pose: &Rigid<Base, Tool>) -> bool {
    pose.isometry().to_homogeneous().iter().all(|number| number.is_finite())
}

/// Returns a failed check if a waypoint is outside of the box.
fn box_violation(index: usize, pose: &Rigid<Base, Tool>, workspace: Workspace) -> Option<Check> {
    let tip = pose.origin().mm;
    // Formats a coordinate with enough digits to distinguish it from the nearer limit of the box.
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
    let before = if index == 1 { "the arm's current pose".to_owned() } else { format!("waypoint {}", index - 1) };
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
            format!("the tool rotates by {turn}° from {before} to waypoint {index} (limit {allowed}°)")
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

    /// The tool points along the base's X axis; `turn_deg` tilts it downwards.
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

    /// Each defect is inserted in the middle of a valid path. The gate must reject the whole path with the code of this
    /// defect.
    #[test]
    fn each_inserted_defect_is_named() {
        let planted = |bad| codes(at(100.0, 0.0), &[at(150.0, 0.0), bad, at(250.0, 0.0)]);
        assert_eq!(planted(at(200.0, 0.0)), [""; 0]);
        assert_eq!(planted(at(f64::NAN, 0.0)), ["not_finite"]);
        assert_eq!(planted(at(200.0, f64::INFINITY)), ["not_finite"]);
        assert_eq!(planted(at(251.0, 0.0)), ["large_step"], "101 mm");
        assert_eq!(planted(at(200.0, 16.0)), ["large_turn"; 2], "there and back");
        let below = Rigid::followed_by_displacement(at(200.0, 0.0), Vector::new(nalgebra::Vector3::y() * -100.5));
        assert!(planted(below).contains(&"outside_box".to_owned()));
    }

    /// Expected values, calculated by hand: at y = −100.5 mm the tip is 0.5 mm below the box, at x = 502 mm it is 2 mm
    /// above the box. Each violation contains the key of its limit; limits that are met are not listed.
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
    fn axis_angles_are_finite_and_within_one_turn() {
        assert_eq!(judge_joints(&Joints { a4_deg: -360.0, ..Joints::default() }).reasons, []);
        assert_eq!(judge_joints(&Joints { a6_deg: 361.0, ..Joints::default() }).reasons[0].code, "axis_limit");
        assert_eq!(judge_joints(&Joints { a1_deg: f64::NAN, ..Joints::default() }).reasons[0].code, "axis_limit");
    }
}
