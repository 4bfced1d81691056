//! Detects axis angles that differ from those in the file: two exchanged, a wrong sign, or those of another arm.

use super::arm_errors::{self, ARM_NUMBERS, AxisFault};
use super::robot_data::{ArmView, RigKind, RobotData};
use nalgebra::Isometry3;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
use panelprep_base::number_text::distinguishable_texts;

/// The largest difference between axis angles and controller, mm and degrees, if both belong to one robot.
const MAX_POSITION_DIFFERENCE_MM: f64 = 5.0;
const MAX_ROTATION_DIFFERENCE_DEG: f64 = 1.0;
/// The largest difference between the rotations of board and flange from picture to picture, degrees rms.
const MAX_TURN_DIFFERENCE_DEG: f64 = 0.7;
/// The largest difference between the shifts of board and flange along the axis of that rotation, mm rms.
const MAX_SHIFT_DIFFERENCE_MM: f64 = 5.0;
/// Rotations with a well-defined axis.
const AXIS_DEG: (f64, f64) = (5.0, 170.0);

/// Checks whether the axis angles agree with the controller's poses and the pictures. If not, returns the fault
/// that explains the difference.
pub(super) fn axis_angle_problem(data: &RobotData) -> Option<String> {
    if data.views.iter().all(|view| view.pose.joints.is_none()) {
        return None;
    }
    let drawn = |joints: &Joints| arm_errors::base_from_flange(&data.geometry, joints, &[0.0; ARM_NUMBERS]);
    let poses = || data.views.iter().filter_map(|view| Some((&view.pose, view.pose.joints.as_ref()?)));
    let misfit = |mend: &dyn Fn(&Joints) -> Joints| -> (f64, f64) {
        poses().fold((0.0, 0.0), |(mm, deg), (pose, joints)| {
            let off = pose.base_from_flange.inverse() * drawn(&mend(joints));
            (f64::max(mm, off.origin().mm.coords.norm()), f64::max(deg, off.turn().0))
        })
    };
    let screws = |mend: &dyn Fn(&Joints) -> Joints| screw_misfit(data, &|joints| drawn(&mend(joints)));
    let fits = |(deg, mm): (f64, f64)| deg <= MAX_TURN_DIFFERENCE_DEG && mm <= MAX_SHIFT_DIFFERENCE_MM;
    let agrees = |mend: &dyn Fn(&Joints) -> Joints| {
        let (mm, deg) = misfit(mend);
        mm <= MAX_POSITION_DIFFERENCE_MM && deg <= MAX_ROTATION_DIFFERENCE_DEG
    };
    let is_stated = poses().any(|(pose, joints)| {
        let off = pose.base_from_flange.inverse() * drawn(joints);
        off.origin().mm.coords.norm() > 1e-6 || off.turn().0 > 1e-6
    });
    let same = |joints: &Joints| *joints;
    let ((mm, deg), (turn_deg, shift_mm)) = (misfit(&same), screws(&same));
    if agrees(&same) && fits((turn_deg, shift_mm)) {
        return None;
    }
    let fault = AxisFault::all().into_iter().find(|fault| {
        let mend = |joints: &Joints| fault.correct_angles(joints);
        fits(screws(&mend)) && (!is_stated || agrees(&mend))
    });
    let why = match fault {
        Some(fault) => format!("{fault} in the file; after this correction all data agree"),
        None => {
            "no exchange of two axes and no wrong sign explains this; check that [arm] has the lengths of this \
             arm, and that the poses are those of the flange at these pictures, without a tool or a base"
                .to_owned()
        }
    };
    let ([mm, most_mm], [deg, most_deg]) = (
        distinguishable_texts(mm, MAX_POSITION_DIFFERENCE_MM, 1),
        distinguishable_texts(deg, MAX_ROTATION_DIFFERENCE_DEG, 1),
    );
    let [turn, most_turn] = distinguishable_texts(turn_deg, MAX_TURN_DIFFERENCE_DEG, 1);
    let [shift, most_shift] = distinguishable_texts(shift_mm, MAX_SHIFT_DIFFERENCE_MM, 1);
    Some(format!(
        "axis angles and base_from_flange differ by up to {mm} mm and {deg}° (limits {most_mm} mm and \
         {most_deg}°); between pictures, the motions of the board and of the flange by its axis angles differ by \
         {turn}° and {shift} mm rms (limits {most_turn}° and {most_shift} mm); {why}"
    ))
}

/// Returns the difference between the motions of a board and of the flange from picture to picture, rms: the angle
/// of the rotation, degrees, and the shift along its axis, mm. Both are the same for a screw motion from every
/// viewpoint, so that neither mount nor board pose is needed.
fn screw_misfit(data: &RobotData, flange: &dyn Fn(&Joints) -> Rigid<Base, Flange>) -> (f64, f64) {
    let (mut turns, mut shifts, mut count) = (0.0, 0.0, 0.0_f64);
    for (rig, kind) in data.rigs.iter().map(|rig| rig.kind).enumerate() {
        let views: Vec<&ArmView> = data.views.iter().filter(|view| view.rig == rig).collect();
        for (one, two) in views.iter().zip(views.iter().skip(1)) {
            let (Some(from), Some(to)) = (&one.pose.joints, &two.pose.joints) else { continue };
            let moved = *(flange(from).inverse() * flange(to)).isometry();
            let (from, to) = (one.camera_from_board, two.camera_from_board);
            let seen = match kind {
                RigKind::EyeToHand => from.inverse() * to,
                RigKind::EyeInHand => from * to.inverse(),
            };
            let screw = |motion: &Isometry3<f64>| {
                let along = motion.rotation.axis().map_or(0.0, |axis| motion.translation.vector.dot(&axis));
                (motion.rotation.angle().to_degrees(), along)
            };
            let ((moved_deg, moved_mm), (seen_deg, seen_mm)) = (screw(&moved), screw(&seen));
            turns += (moved_deg - seen_deg).powi(2);
            // The axis of a small rotation is poorly determined, and that of half a turn has no sign.
            let has_axis = |deg: &f64| (AXIS_DEG.0..AXIS_DEG.1).contains(deg);
            let is_screw = has_axis(&moved_deg) && has_axis(&seen_deg);
            shifts += if is_screw { (moved_mm - seen_mm).powi(2) } else { 0.0 };
            count += 1.0;
        }
    }
    ((turns / count.max(1.0)).sqrt(), (shifts / count.max(1.0)).sqrt())
}
