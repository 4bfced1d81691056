//! The keys of a pose: read as a person writes them, and written as they are read.

use crate::config::Section;
use crate::files::ReportedFlange;
use crate::geometry::KukaPose;

pub(super) const PLACE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;

const ANGLE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;

pub(super) const AXIS_DEG: std::ops::RangeInclusive<f64> = -720.0..=720.0;

pub(super) const CORNER: std::ops::RangeInclusive<usize> = 0..=60;

/// Six keys in mm and degrees, all of them.
pub(super) fn pose(section: &Section<'_, '_>) -> Option<KukaPose> {
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| section.take(key, PLACE_MM, None));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| section.take(key, ANGLE_DEG, None));
    section.done();
    Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? })
}

/// Do these angles look like radians? Not proof: the caller asks only where the tool cannot be upright.
pub(super) fn like_radians(pose: &KukaPose) -> bool {
    let angles = [pose.a_deg, pose.b_deg, pose.c_deg];
    let circle = [std::f64::consts::PI, std::f64::consts::FRAC_PI_2];
    angles.iter().all(|angle| angle.abs() < 3.15)
        && angles.iter().any(|angle| circle.iter().any(|turn| (angle.abs() - turn).abs() < 0.05))
}

/// The keys of a pose as a poses file has them, with the axes where they are known: what `picture_poses` reads.
pub fn pose_keys(flange: &ReportedFlange) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = flange.base_from_flange;
    let axes = flange.joints.map(|joints| format!("axes_deg = {:?}\n", joints.degrees()));
    format!(
        "base_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, \
         c_deg = {c_deg:?} }}\n"
    ) + &axes.unwrap_or_default()
}
