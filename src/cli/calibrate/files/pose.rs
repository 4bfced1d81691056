//! Parses the keys of a pose in the formats that a person writes, and formats poses for a poses file.

use panelprep_base::config::{Section, Setting};
use panelprep_base::geometry::{Base, Flange, KukaPose, Rigid};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::files::ReportedFlange;
use toml::de::DeValue;

pub(super) const POSITION_RANGE_MM: std::ops::RangeInclusive<f64> = -20_000.0..=20_000.0;

const ANGLE_RANGE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;

pub(super) const AXIS_RANGE_DEG: std::ops::RangeInclusive<f64> = -720.0..=720.0;

pub(super) const CORNER: std::ops::RangeInclusive<usize> = 0..=60;

/// A pose in the notation of the controller, `{X 400.5, Y 0, Z 600, A 90, B 0, C 180}`, also with type, status and
/// turn, `{E6POS: …, S 2, T 35}`. Or a 4 × 4 matrix as other programs write it (`Data` in Zivid's YAML), with a
/// rotation and a translation in mm.
struct WrittenPose(KukaPose);

/// Maximum deviation of a rotation matrix from orthonormal columns; larger than the rounding of files with seven
/// digits.
const MAX_ROTATION_DEVIATION: f64 = 1e-3;

fn describe_valid_pose() -> String {
    "valid: a table {x_mm, y_mm, z_mm, a_deg, b_deg, c_deg}, a pose as the controller writes it, \"{X 400.5, Y 0, \
     Z 600, A 90, B 0, C 180}\", or a matrix of four rows of four numbers with the translation in mm"
        .to_owned()
}

/// Parses a pose from a 4 × 4 matrix.
fn parse_matrix(rows: &[toml::Spanned<DeValue<'_>>]) -> Result<KukaPose, String> {
    let mut matrix = nalgebra::Matrix4::<f64>::zeros();
    let [_, _, _, _] = rows else { return Err(describe_valid_pose()) };
    for (i, row) in rows.iter().enumerate() {
        let row = row.get_ref().as_array().filter(|row| row.len() == 4).ok_or_else(describe_valid_pose)?;
        for (j, number) in row.iter().enumerate() {
            matrix[(i, j)] = f64::parse(number.get_ref(), &(-20_000.0..=20_000.0))?;
        }
    }
    let rotation: nalgebra::Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let off = (rotation.transpose() * rotation - nalgebra::Matrix3::identity()).abs().max();
    let last = matrix.row(3).into_owned() - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0);
    if last.abs().max() > 1e-9 {
        let message = "the last row of the matrix is not 0, 0, 0, 1; write the matrix row by row, with the translation \
                       in its last column";
        return Err(message.to_owned());
    }
    if off > MAX_ROTATION_DEVIATION {
        let [off, limit] = distinguishable_texts(off, MAX_ROTATION_DEVIATION, 4);
        return Err(format!(
            "the matrix is not a pose: its rotation deviates from an orthonormal matrix by {off} (limit {limit})"
        ));
    }
    if rotation.determinant() < 0.0 {
        return Err("the matrix is not a pose: its axes are not right-handed".to_owned());
    }
    let rotation = nalgebra::Rotation3::from_matrix_eps(&rotation, 1e-12, 100, nalgebra::Rotation3::identity());
    let place = nalgebra::Translation3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]);
    let pose = nalgebra::Isometry3::from_parts(place, nalgebra::UnitQuaternion::from_rotation_matrix(&rotation));
    Ok(KukaPose::from_rigid(&Rigid::<Base, Flange>::from_isometry_unchecked(pose)))
}

impl Setting for WrittenPose {
    type Limits = ();

    fn parse(value: &DeValue<'_>, (): &()) -> Result<Self, String> {
        if let Some(rows) = value.as_array() {
            return parse_matrix(rows).map(WrittenPose);
        }
        let text = value.as_str().ok_or_else(describe_valid_pose)?.trim();
        let inside =
            text.strip_prefix('{').and_then(|text| text.strip_suffix('}')).ok_or_else(describe_valid_pose)?;
        let inside = inside.split_once(':').map_or(inside, |(_, numbers)| numbers);
        let mut numbers = [None; 6];
        for part in inside.split(',') {
            let (name, number) = part.trim().split_once(char::is_whitespace).ok_or_else(describe_valid_pose)?;
            let place = ["X", "Y", "Z", "A", "B", "C"].iter().position(|key| key.eq_ignore_ascii_case(name));
            let Some(place) = place else { continue };
            let number: f64 = number.trim().parse().map_err(|_| describe_valid_pose())?;
            let limits = if place < 3 { POSITION_RANGE_MM } else { ANGLE_RANGE_DEG };
            if numbers[place].is_some() || !limits.contains(&number) {
                return Err(format!(
                    "{name} {number}; valid: each of X, Y, Z, A, B, C once, from {} to {}",
                    limits.start(),
                    limits.end()
                ));
            }
            numbers[place] = Some(number);
        }
        let [Some(x_mm), Some(y_mm), Some(z_mm), Some(a_deg), Some(b_deg), Some(c_deg)] = numbers else {
            return Err(describe_valid_pose());
        };
        Ok(WrittenPose(KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg }))
    }
}

/// Parses the pose under this key of a table: six keys, the notation of the controller, or a matrix.
pub(super) fn parse_pose_table(section: &Section<'_, '_>, key: &'static str) -> Option<KukaPose> {
    match section.has_key(key) && !section.is_table(key) {
        true => section.parse::<WrittenPose>(key, (), None).map(|pose| pose.0),
        false => pose(&section.section(key)),
    }
}

/// Parses the six keys of a pose in mm and degrees; all of them are required.
pub(super) fn pose(section: &Section<'_, '_>) -> Option<KukaPose> {
    let [x_mm, y_mm, z_mm] = ["x_mm", "y_mm", "z_mm"].map(|key| section.parse(key, POSITION_RANGE_MM, None));
    let [a_deg, b_deg, c_deg] = ["a_deg", "b_deg", "c_deg"].map(|key| section.parse(key, ANGLE_RANGE_DEG, None));
    section.finish();
    Some(KukaPose { x_mm: x_mm?, y_mm: y_mm?, z_mm: z_mm?, a_deg: a_deg?, b_deg: b_deg?, c_deg: c_deg? })
}

/// Returns whether these angles are probably in radians. This is not certain, so the caller uses the result only if the
/// tool cannot be upright.
pub(super) fn are_angles_in_radians(pose: &KukaPose) -> bool {
    let angles = [pose.a_deg, pose.b_deg, pose.c_deg];
    let circle = [std::f64::consts::PI, std::f64::consts::FRAC_PI_2];
    angles.iter().all(|angle| angle.abs() < 3.15)
        && angles.iter().any(|angle| circle.iter().any(|turn| (angle.abs() - turn).abs() < 0.05))
}

/// Formats a pose with the keys of a poses file, and with the axis angles if they are known. `picture_poses` parses
/// this format.
pub fn pose_keys(flange: &ReportedFlange) -> String {
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = flange.base_from_flange;
    let axes = flange.joints.map(|joints| format!("axes_deg = {:?}\n", joints.degrees()));
    format!(
        "base_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = {b_deg:?}, \
         c_deg = {c_deg:?} }}\n"
    ) + &axes.unwrap_or_default()
}
