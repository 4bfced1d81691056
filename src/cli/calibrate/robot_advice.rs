//! The report of `calibrate robot` about the working volume: the possible error of the tip, the next pose to take, and
//! whether one more pose is useful.

use super::super::outcome::Outcome;
use nalgebra::{Isometry3, Vector3};
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, PinholeCamera, Point, Rigid, median};
use panelprep_cell::cell::Cell;
use panelprep_toolpath::path::{Kinematics, reach};
use panelprep_vision::calib::robot::{ArmPose, RigKind, RobotData, RobotFound};
use panelprep_vision::calib::robot_next::{self, Candidate, NextPose};
use panelprep_vision::calib::{Board, arm_errors};
use serde_json::json;

/// Number of evaluated positions in the working volume along each of its sides.
const EVALUATION_GRID: [usize; 3] = [4, 4, 3];

/// Reports the stated error over the working volume and the next pose.
pub(super) fn report_advice(
    outcome: &mut Outcome,
    cell: &Cell,
    found: &RobotFound,
    (data, cameras, board): (&RobotData, &[PinholeCamera], &Board),
) {
    let volume = volume(cell, found, data);
    let mut stated: Vec<(f64, Point<Base>)> = volume
        .iter()
        .filter_map(|pose| Some((found.tip_uncertainty_mm(pose)?, (pose.base_from_flange * tip(found)))))
        .collect();
    stated.sort_by(|a, b| a.0.total_cmp(&b.0));
    outcome.add_value("tip_uncertainty_mm", json!(null));
    if let Some((worst_mm, at)) = stated.last().copied() {
        let mut all: Vec<f64> = stated.iter().map(|(mm, _)| *mm).collect();
        let median_mm = median(&mut all).unwrap_or(worst_mm);
        let (x, y, z) = (at.mm.x, at.mm.y, at.mm.z);
        let places = stated.len();
        outcome.add_value(
            "tip_uncertainty_mm",
            json!({"median": median_mm, "worst": worst_mm, "at_mm": [x, y, z], "places": places}),
        );
        outcome.add_line(format!(
            "error of the tip with the correction: at most {median_mm:.2} mm (95 %, median of {places} positions in the working \
             volume); at the worst position {worst_mm:.2} mm, at ({x:.0}, {y:.0}, {z:.0}) mm"
        ));
    }
    let candidates = candidates(cell, found, data, (cameras, board));
    let next = robot_next::best_next_pose(found, &candidates, &volume);
    outcome.add_value("next_pose", next.as_ref().map_or(json!(null), |next| object(found, next)));
    outcome.add_value("enough", json!(next.as_ref().map(NextPose::is_sufficient)));
    outcome.add_line(describe_advice(found, next.as_ref()));
}

fn describe_advice(found: &RobotFound, next: Option<&NextPose>) -> String {
    let Some(next) = next else {
        return "no next pose: no pose within the axis limits shows a whole board, or the data determine no parameter \
                yet"
            .to_owned();
    };
    let less = |share: f64| format!("{:.1} %", 100.0 * (1.0 - share));
    if next.is_sufficient() {
        return format!(
            "enough poses: no further pose reduces the tip's stated error by more than {}",
            less(next.tip_share)
        );
    }
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&next.pose.base_from_flange);
    let axes = next.pose.joints.map_or(String::new(), |joints| {
        let all: Vec<String> = joints.degrees().iter().map(|deg| format!("{deg:.1}")).collect();
        format!("axes [{}]°, ", all.join(", "))
    });
    format!(
        "next pose, for {}: {axes}flange X {x_mm:.1} Y {y_mm:.1} Z {z_mm:.1} A {a_deg:.1} B {b_deg:.1} C {c_deg:.1}; the uncertainty \
         of the least known parameter, {}, falls by {}; a further pose reduces the tip's stated error by up to {}",
        describe_board(found, next.rig),
        next.weakest_parameter,
        less(next.weakest_share),
        less(next.tip_share)
    )
}

fn describe_board(found: &RobotFound, rig: usize) -> &'static str {
    match found.rigs[rig].kind {
        RigKind::EyeToHand => "the board on the flange in front of the fixed camera",
        RigKind::EyeInHand => "the fixed board in front of the camera on the flange",
    }
}

fn object(found: &RobotFound, next: &NextPose) -> serde_json::Value {
    let rig = match found.rigs[next.rig].kind {
        RigKind::EyeToHand => "eye-to-hand",
        RigKind::EyeInHand => "eye-in-hand",
    };
    json!({
        "board": rig,
        "axes_deg": next.pose.joints.map(|joints| joints.degrees()),
        "base_from_flange": KukaPose::from_rigid(&next.pose.base_from_flange),
        "improves": next.weakest_parameter,
        "improves_share": next.weakest_share,
        "tip_share": next.tip_share,
    })
}

fn tip(found: &RobotFound) -> Point<Flange> {
    Point::new(found.tip_mm.unwrap_or(Vector3::zeros()).into())
}

/// Returns poses from which a camera sees a board, within the gates.
fn candidates(
    cell: &Cell,
    found: &RobotFound,
    data: &RobotData,
    (cameras, board): (&[PinholeCamera], &Board),
) -> Vec<Candidate> {
    let arm = Kinematics::new(cell.arm());
    let mut all = Vec::new();
    for (rig, camera) in cameras.iter().enumerate() {
        for viewpoint in robot_next::viewpoints(found, &data.views, rig, (camera, board)) {
            let stands = reachable_postures(cell, &arm, &viewpoint.base_from_flange, tip(found));
            all.extend(stands.into_iter().map(|pose| Candidate { viewpoint: viewpoint.clone(), pose }));
        }
    }
    all
}

/// The possible postures of the arm at a pose, with its tip in the cell's box.
fn reachable_postures(
    cell: &Cell,
    arm: &Kinematics,
    base_from_flange: &Rigid<Base, Flange>,
    tip: Point<Flange>,
) -> Vec<ArmPose> {
    let is_inside = cell.limits().workspace().is_none_or(|workspace| workspace.contains(*base_from_flange * tip));
    let ways = if is_inside { reach::postures(arm, base_from_flange, tip) } else { Vec::new() };
    let drawn = |joints: Joints| {
        let flange = arm_errors::base_from_flange(cell.arm().geometry(), &joints, &[0.0; arm_errors::ARM_NUMBERS]);
        ArmPose { joints: Some(joints), base_from_flange: flange }
    };
    ways.into_iter().map(drawn).collect()
}

/// Poses all over the working volume: the cell's box or, without one, the region of the measured poses. The tool's
/// orientation at each position is that of the nearest measured pose.
fn volume(cell: &Cell, found: &RobotFound, data: &RobotData) -> Vec<ArmPose> {
    let arm = Kinematics::new(cell.arm());
    let measured: Vec<Rigid<Base, Flange>> = data.views.iter().map(|view| view.pose.base_from_flange).collect();
    let tips: Vec<Point<Base>> = measured.iter().map(|pose| *pose * tip(found)).collect();
    let (low, high) = match cell.limits().workspace() {
        Some(workspace) => (workspace.min.mm, workspace.max.mm),
        None => {
            tips.iter().fold((tips[0].mm, tips[0].mm), |(low, high), tip| (low.inf(&tip.mm), high.sup(&tip.mm)))
        }
    };
    let along = |axis: usize, index: usize| {
        let share = (index as f64 + 0.5) / EVALUATION_GRID[axis] as f64;
        low[axis] + share * (high[axis] - low[axis])
    };
    let mut all = Vec::new();
    for index in 0..EVALUATION_GRID.iter().product() {
        let place = nalgebra::Point3::new(
            along(0, index % EVALUATION_GRID[0]),
            along(1, index / EVALUATION_GRID[0] % EVALUATION_GRID[1]),
            along(2, index / EVALUATION_GRID[0] / EVALUATION_GRID[1]),
        );
        let mut near: Vec<usize> = (0..tips.len()).collect();
        let away = |at: usize| (tips[at].mm - place).norm();
        near.sort_by(|a, b| away(*a).total_cmp(&away(*b)));
        let standing = near.into_iter().take(3).find_map(|at| {
            let turn = measured[at].isometry().rotation;
            let shift = place.coords - turn * tip(found).mm.coords;
            let flange: Rigid<Base, Flange> =
                Rigid::from_isometry_unchecked(Isometry3::from_parts(shift.into(), turn));
            reachable_postures(cell, &arm, &flange, tip(found)).into_iter().next()
        });
        all.extend(standing);
    }
    if all.is_empty() { data.views.iter().map(|view| view.pose).collect() } else { all }
}
