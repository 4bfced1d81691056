//! Poses of the arm for the calibration of its own errors: those that a camera can use next, and those over which the
//! remaining error is stated.

use nalgebra::{Isometry3, Vector3};
use panelprep_base::geometry::{Base, Flange, Joints, PinholeCamera, Point, Rigid};
use panelprep_cell::cell::Cell;
use panelprep_toolpath::path::{Kinematics, reach};
use panelprep_vision::calib::robot::{ArmPose, RobotData, RobotFound};
use panelprep_vision::calib::robot_next::{self, Candidate};
use panelprep_vision::calib::{Board, arm_errors};

/// Number of evaluated positions in the working volume along each of its sides.
const EVALUATION_GRID: [usize; 3] = [4, 4, 3];

/// Returns the tip of the tool that touched, in the frame of the flange; its origin if no tool touched.
pub fn tip(found: &RobotFound) -> Point<Flange> {
    Point::new(found.tip_mm.unwrap_or(Vector3::zeros()).into())
}

/// Returns poses that pass the gates and from which a camera sees a board.
pub fn candidates(
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

/// Returns the possible configurations of the arm at a pose, with its tip in the cell's box.
fn reachable_postures(
    cell: &Cell,
    arm: &Kinematics,
    base_from_flange: &Rigid<Base, Flange>,
    tip: Point<Flange>,
) -> Vec<ArmPose> {
    let is_inside = cell.limits().workspace().is_none_or(|workspace| workspace.contains(*base_from_flange * tip));
    let ways = if is_inside { reach::postures(arm, base_from_flange, tip) } else { Vec::new() };
    let drawn = |joints: Joints| {
        let flange =
            arm_errors::base_from_flange(cell.arm().geometry(), &joints, &[0.0; arm_errors::ARM_PARAMETER_COUNT]);
        ArmPose { joints: Some(joints), base_from_flange: flange }
    };
    ways.into_iter().map(drawn).collect()
}

/// Returns poses all over the working volume: the cell's box or, without one, the region of the measured poses. The
/// tool's orientation at each position is that of the nearest measured pose.
pub fn working_volume(cell: &Cell, found: &RobotFound, data: &RobotData) -> Vec<ArmPose> {
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
