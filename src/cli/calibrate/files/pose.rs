//! The keys of a pose: read as a person writes them, and written as they are read.

use crate::config::{Section, Setting};
use crate::files::ReportedFlange;
use crate::geometry::KukaPose;
use toml::de::DeValue;

pub(super) const PLACE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;

const ANGLE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;

pub(super) const AXIS_DEG: std::ops::RangeInclusive<f64> = -720.0..=720.0;

pub(super) const CORNER: std::ops::RangeInclusive<usize> = 0..=60;

/// A pose as the controller shows it: `{X 400.5, Y 0, Z 600, A 90, B 0, C 180}`, also with its type and what follows it, `{E6POS: …, S 2, T 35}`.
struct KrlPose(KukaPose);

impl Setting for KrlPose {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        let allowed = || {
            "allowed is a table {x_mm, y_mm, z_mm, a_deg, b_deg, c_deg}, or a pose as the controller writes it, \
             \"{X 400.5, Y 0, Z 600, A 90, B 0, C 180}\""
                .to_owned()
        };
        let text = value.as_str().ok_or_else(allowed)?.trim();
        let inside = text.strip_prefix('{').and_then(|text| text.strip_suffix('}')).ok_or_else(allowed)?;
        let inside = inside.split_once(':').map_or(inside, |(_, numbers)| numbers);
        let mut numbers = [None; 6];
        for part in inside.split(',') {
            let (name, number) = part.trim().split_once(char::is_whitespace).ok_or_else(allowed)?;
            let place = ["X", "Y", "Z", "A", "B", "C"].iter().position(|key| key.eq_ignore_ascii_case(name));
            let Some(place) = place else { continue };
            let number: f64 = number.trim().parse().map_err(|_| allowed())?;
            let limits = if place < 3 { PLACE_MM } else { ANGLE_DEG };
            if numbers[place].is_some() || !limits.contains(&number) {
                return Err(format!(
                    "{name} {number}: allowed is each of X, Y, Z, A, B, C once, within {} to {}",
                    limits.start(),
                    limits.end()
                ));
            }
            numbers[place] = Some(number);
        }
        let [Some(x_mm), Some(y_mm), Some(z_mm), Some(a_deg), Some(b_deg), Some(c_deg)] = numbers else {
            return Err(allowed());
        };
        Ok(KrlPose(KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }))
    }
}

/// The pose under this key of a table: six keys, or as the controller writes it.
pub(super) fn pose_of(section: &Section<'_, '_>, key: &'static str) -> Option<KukaPose> {
    match section.has(key) && !section.is_table(key) {
        true => section.take::<KrlPose>(key, (), None).map(|pose| pose.0),
        false => pose(&section.section(key)),
    }
}

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
