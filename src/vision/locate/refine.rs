//! The correction of a localization with corners in pictures of the flange camera (thesis 3.9, Eq. 3.22–3.25).
//!
//! The expected pixel of a corner is the projection of its taught position through the pose to be corrected. The thesis
//! drives the camera to  ᵇT_newCP = ᵇT_w · ʷT_nominalCP  (3.22), where the expected pixel is the taught reference
//! pixel. The expected pixel can be computed for any other camera pose as well, so the camera need not be exactly at
//! this pose. The thesis then moves the camera in small amounts until both pixels coincide. With the image Jacobian one
//! computed step is enough: in undistorted image coordinates x, y, at the depth Z of the corner,
//!     Δ = Z · (x_found − x_expected,  y_found − y_expected)  along the camera's X and Y.                      (3.23)
//! If a corner is found to the right of its expected position, the camera must move right to see it there, and the
//! panel is to the right by the same distance:
//!     ᵇT_w' = ᵇT_w · ʷR_newCP · T(Δ) · ʷR_newCPᵀ,   ʷR_newCP the rotation of  ʷT_newCP = ᵇT_w⁻¹ · ᵇT_newCP.  (3.24, 3.25)
//! This shifts the panel by Δ along the axes of the camera without a rotation. For several corners, the shift v is the
//! least-squares solution. If they are far enough apart, they also determine the rotation φ about the viewing direction
//! f of the cameras: a corner p then moves by  v + φ f × (p − p̄).  Along a direction in which every camera looks, the
//! pose is not corrected. The residuals at the corners show whether they are corners of one rigid panel. The correction
//! shows whether they agree with the 3D scan. Neither is hidden by averaging: see [`judge`] and [`worst_disagreement`].
//!
//! A correction is accepted if it is within the limits of the recipe, consistent with one rigid panel, and in agreement
//! with the 3D scan. Every corner is compared with its limit individually and named by its taught number. A NaN
//! violates its limit.

#[cfg(test)]
mod tests;

use super::gate::exceeds_limit;
use nalgebra::{Isometry3, Matrix4, Translation3, UnitQuaternion, Vector3, Vector4};
use panelprep_base::geometry::{Base, Degrees, FlangeCamera, Panel, PinholeCamera, Pixel, Point, Rigid, Vector};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Severity};
use panelprep_cell::panel::TaughtCorner;
use panelprep_cell::recipe;

/// Minimum sum of the weights of the cameras at which a direction is corrected. A camera has weight 1 for a direction
/// across its view and 0 along it. Two cameras with almost the same view would convert an error of a pixel into
/// millimetres of depth.
const MIN_WEIGHT: f64 = 0.2;

/// Minimum root mean square distance of the corners from their centroid at which the rotation is corrected, mm: with a
/// smaller one, an error of a pixel would cause an error of degrees.
const MIN_CORNER_SPREAD_MM: f64 = 25.0;

/// A corner that was found in one picture of the flange camera.
#[derive(Debug, Clone, Copy)]
pub struct CornerView<'a> {
    /// Index of the corner among the taught corners, from 0.
    pub corner: usize,
    /// The taught data of the corner.
    pub taught: &'a TaughtCorner,
    /// The pose of the camera at this picture: base_from_flange · flange_from_camera.
    pub base_from_camera: Rigid<Base, FlangeCamera>,
    /// The pixel at which the corner was found.
    pub found_px: Pixel,
}

/// The reason why a correction cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// There is no corner picture.
    #[error("no corner picture was given; at least one is needed")]
    NoView,
    /// The corner is not in front of the camera.
    #[error(
        "according to the flange pose of its picture, corner {corner} has a depth of {depth_mm:.0} mm from the \
         camera and is not in its view; check that the flange pose belongs to this picture"
    )]
    NotInView {
        /// Number of the taught corner, from 1.
        corner: usize,
        /// Depth of the expected corner, mm.
        depth_mm: f64,
    },
}

/// Corrects a pose with one or more corner pictures.
///
/// # Errors
/// If there is no view, or a corner is not in front of its camera.
pub fn refine(
    located: Rigid<Base, Panel>,
    camera: &PinholeCamera,
    views: &[CornerView<'_>],
) -> Result<RefinedPose, RefineError> {
    let seen = views
        .iter()
        .map(|view| {
            let unseen = |depth_mm| RefineError::NotInView { corner: view.corner + 1, depth_mm };
            observe_corner(located, camera, view).map_err(unseen)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let first = seen.first().ok_or(RefineError::NoView)?;
    let base_from_base = common_motion(&seen);
    let moved = |seen: &CornerObservation| (base_from_base * seen.point - seen.point).mm;
    let along = |seen: &CornerObservation| [moved(seen).dot(&seen.right.mm), moved(seen).dot(&seen.down.mm)];
    // The residuals after the common motion show whether the corners agree: the corners of a rigid panel have no
    // residuals.
    let report = |seen: &CornerObservation| {
        let [right, down] = along(seen);
        CornerReport {
            corner: seen.corner,
            expected_px: seen.expected_px,
            error_px: seen.error_px,
            shift_mm: seen.shift_mm,
            remaining_shift_mm: (seen.shift_mm[0] - right).hypot(seen.shift_mm[1] - down),
        }
    };
    Ok(RefinedPose {
        base_from_panel: base_from_base * located,
        shift_mm: along(first),
        rotation: base_from_base.rotation_angle(),
        error_px: seen.iter().map(|seen| seen.error_px).fold(0.0, f64::max),
        corners: seen.iter().map(report).collect(),
    })
}

struct CornerObservation {
    corner: usize,
    point: Point<Base>,
    forward: Vector<Base>,
    expected_px: Pixel,
    error_px: f64,
    shift_mm: [f64; 2],
    right: Vector<Base>,
    down: Vector<Base>,
}

/// Evaluates one corner by itself; if it cannot be projected, the error is the depth of the expected corner, mm.
fn observe_corner(
    located: Rigid<Base, Panel>,
    camera: &PinholeCamera,
    view: &CornerView<'_>,
) -> Result<CornerObservation, f64> {
    let expected: Point<FlangeCamera> = view.base_from_camera.inverse() * (located * view.taught.point);
    let depth_mm = expected.mm.z;
    let expected_px = camera.project(expected).ok_or(depth_mm)?;
    let found: Vector<FlangeCamera> = camera.unproject(view.found_px).ok_or(depth_mm)?;
    let shift_mm = [depth_mm * found.mm.x - expected.mm.x, depth_mm * found.mm.y - expected.mm.y]; // Eq. 3.23
    let axis = |axis: Vector3<f64>| view.base_from_camera * Vector::new(axis);
    Ok(CornerObservation {
        corner: view.corner,
        point: located * view.taught.point,
        forward: axis(Vector3::z()),
        expected_px,
        error_px: view.found_px.distance_px(expected_px),
        shift_mm,
        right: axis(Vector3::x()),
        down: axis(Vector3::y()),
    })
}

/// Returns the least-squares motion of all corners. For one corner, this is the shift by Δ along the axes of its camera
/// (Eq. 3.24, in the base frame).
fn common_motion(seen: &[CornerObservation]) -> Rigid<Base, Base> {
    let count = seen.len().max(1) as f64;
    let middle = seen.iter().map(|view| view.point.mm.coords).sum::<Vector3<f64>>() / count;
    let about = seen.iter().map(|view| view.forward.mm).sum::<Vector3<f64>>().try_normalize(1e-6);
    let apart_mm =
        (seen.iter().map(|view| (view.point.mm.coords - middle).norm_squared()).sum::<f64>() / count).sqrt();
    let about = about.filter(|_| apart_mm >= MIN_CORNER_SPREAD_MM).unwrap_or_else(Vector3::zeros);
    // Rotations are converted to mm at the distance of the corners, so that one weight limit applies to rotations and
    // shifts.
    let radius_mm = apart_mm.max(MIN_CORNER_SPREAD_MM);
    let (mut weight, mut wanted) = (Matrix4::zeros(), Vector4::zeros());
    for view in seen {
        let turned = about.cross(&(view.point.mm.coords - middle)) / radius_mm;
        for (axis, shift_mm) in [(view.right.mm, view.shift_mm[0]), (view.down.mm, view.shift_mm[1])] {
            let row = Vector4::new(axis.x, axis.y, axis.z, axis.dot(&turned));
            weight += row * row.transpose();
            wanted += row * shift_mm;
        }
    }
    let eigen = weight.symmetric_eigen();
    let part = |i: usize| {
        let direction = eigen.eigenvectors.column(i).into_owned();
        let seen = eigen.eigenvalues[i] >= MIN_WEIGHT;
        if seen { direction * (direction.dot(&wanted) / eigen.eigenvalues[i]) } else { Vector4::zeros() }
    };
    let motion: Vector4<f64> = (0..4).map(part).sum();
    let turn = UnitQuaternion::from_scaled_axis(about * (motion.w / radius_mm));
    Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(middle + motion.xyz() - turn * middle),
        turn,
    ))
}

/// The measured deviation of one corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerReport {
    /// Index of the corner among the taught corners, from 0.
    pub corner: usize,
    /// The expected position of the corner.
    pub expected_px: Pixel,
    /// Distance between the found and the expected position, px.
    pub error_px: f64,
    /// Shift that this corner alone indicates, along X and Y of its camera, mm.
    pub shift_mm: [f64; 2],
    /// The part of this shift that remains after the common correction, mm.
    pub remaining_shift_mm: f64,
}

impl CornerReport {
    /// Returns the length of the shift of the panel that this corner alone indicates, mm.
    pub fn indicated_shift_mm(&self) -> f64 {
        self.shift_mm[0].hypot(self.shift_mm[1])
    }
}

/// A corrected pose and the corners on which it is based.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedPose {
    /// The corrected pose of the panel in the base frame.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Correction along X and Y of the first camera, mm.
    pub shift_mm: [f64; 2],
    /// Angle by which the panel was rotated; zero unless two or more corners are far enough apart.
    pub rotation: Degrees,
    /// Maximum distance between the found and the expected position of a corner, px.
    pub error_px: f64,
    /// The result of each corner, in the order of the views.
    pub corners: Vec<CornerReport>,
}

/// Maximum distance between a corner of a rigid panel and its measured position after the correction, mm.
pub const MAX_CORNER_DISTANCE_MM: f64 = 0.3;

/// Judges a correction by the limit of the recipe.
pub fn judge(refined: &RefinedPose, limits: &recipe::Corner) -> Judgement {
    Judgement::from_checks(&checks(refined, limits))
}

/// Returns two lists of checks: the shift that each corner indicates, and the residual distance of each corner after
/// the common correction; both lists begin with the largest value.
pub fn checks(refined: &RefinedPose, limits: &recipe::Corner) -> Vec<Check> {
    let allowed_mm = limits.max_correction_mm();
    let asked = sorted_by_size(refined, CornerReport::indicated_shift_mm).into_iter().flat_map(|(corner, asked_mm)| {
        let words = || {
            let [asked, allowed] = distinguishable_texts(asked_mm, allowed_mm, 2);
            format!(
                "{} is {asked} mm ({} px) from its position in the 3D scan (limit {allowed} mm); check whether the \
                 panel has moved since the scan, and whether the flange pose belongs to the picture",
                name(corner),
                fixed_decimals(corner.error_px, 1)
            )
        };
        [
            Check::new(format!("{} from where the scan puts it", name(corner)), "mm", asked_mm)
                .with_max(allowed_mm, LimitSource::recipe("corner.max_correction_mm"))
                .or_reject("correction_limit", words),
            Check::new(format!("{} from there in the picture", name(corner)), "px", corner.error_px),
        ]
    });
    let several = refined.corners.len() > 1;
    let left = sorted_by_size(refined, |corner| corner.remaining_shift_mm).into_iter().enumerate();
    let left = left.map(|(index, (corner, left_mm))| {
        let is_told = several.then_some(left_mm);
        let check = Check::new(format!("{} off after the correction", name(corner)), "mm", is_told)
            .with_max(MAX_CORNER_DISTANCE_MM, LimitSource::Program)
            .with_consequence_if(
                exceeds_limit(left_mm, MAX_CORNER_DISTANCE_MM),
                Severity::Review,
                "corners_disagree",
                || {
                    let [left, allowed] = distinguishable_texts(left_mm, MAX_CORNER_DISTANCE_MM, 2);
                    format!(
                        "{} is still {left} mm from its position in the picture after the best correction of all \
                     corners (limit {allowed} mm); check that each picture shows its own corner and has its own \
                     flange pose",
                        name(corner)
                    )
                },
            );
        // Only the corner with the largest residual has a consequence: all residuals result from one common correction.
        if index == 0 { check } else { check.without_consequence() }
    });
    asked.chain(left).collect()
}

/// Judges whether the corners are still at their expected positions, just before contact.
pub fn judge_corner_positions(seen: &RefinedPose, limits: &recipe::Corner) -> Judgement {
    Judgement::from_checks(&position_checks(seen, limits))
}

/// Checks the distance of each corner from its located position, the largest first. If a corner is displaced, a person
/// must decide: the tool makes no contact, and the panel is dried and located again.
pub fn position_checks(seen: &RefinedPose, limits: &recipe::Corner) -> Vec<Check> {
    let allowed_mm = limits.verify_mm();
    let checks = sorted_by_size(seen, CornerReport::indicated_shift_mm).into_iter().flat_map(|(corner, off_mm)| {
        let [x_mm, y_mm] = corner.shift_mm;
        let words = || {
            let [off, allowed] = distinguishable_texts(off_mm, allowed_mm, 2);
            format!(
                "{} is {off} mm from its located position (limit {allowed} mm, [corner] verify_mm); check whether \
                 the panel has moved",
                name(corner)
            )
        };
        [
            Check::new(format!("{} from where the localization puts it", name(corner)), "mm", off_mm)
                .with_max(allowed_mm, LimitSource::recipe("corner.verify_mm"))
                .or_review("moved", words),
            Check::new(format!("{} along the camera's x", name(corner)), "mm", x_mm),
            Check::new(format!("{} along the camera's y", name(corner)), "mm", y_mm),
        ]
    });
    checks.collect()
}

/// Name of the check of the farthest corner in [`worst_disagreement`].
pub const FARTHEST_CORNER: &str = "farthest corner, against what scan, corner and calibrations claim";

/// Error of one corner in the plane of its camera, 95 %, mm: the edges of the taught and of the found corner are
/// measured to a tenth of a pixel.
const CORNER_ERROR_MM: f64 = 0.05;

/// Checks whether a corner is farther from its position in the 3D scan than the stated errors permit. The result is a
/// finding and is not averaged; of several corners, the farthest is reported. `claims_mm` contains the stated errors of
/// the localization and of both calibrations, 95 % each. `None` if there is no corner.
pub fn worst_disagreement(refined: &RefinedPose, claims_mm: &[f64]) -> Option<Check> {
    let claimed_mm = claims_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt().hypot(CORNER_ERROR_MM);
    // Twice the 95 % bound: by chance, only one value in ten thousand is larger.
    let allowed_mm = 2.0 * claimed_mm;
    let (corner, asked_mm) = sorted_by_size(refined, CornerReport::indicated_shift_mm).into_iter().next()?;
    let check = Check::new(FARTHEST_CORNER, "mm", asked_mm);
    // If the position is unknown, there is no limit.
    let check = if allowed_mm.is_finite() { check.with_max(allowed_mm, LimitSource::Program) } else { check };
    Some(check.with_consequence_if(exceeds_limit(asked_mm, allowed_mm), Severity::Review, "corner_disagrees", || {
        let [asked, allowed] = distinguishable_texts(asked_mm, allowed_mm, 2);
        format!(
            "{} is {asked} mm from its position in the 3D scan; the stated errors of scan, corner and calibrations \
             give {} mm (95 %), and the limit is twice this value, {allowed} mm: one of these errors is wrong; \
             verify the calibrations",
            name(corner),
            fixed_decimals(claimed_mm, 2)
        )
    }))
}

/// Sorts the corners by the absolute value of a measurement, the largest first.
fn sorted_by_size(refined: &RefinedPose, measured: impl Fn(&CornerReport) -> f64) -> Vec<(&CornerReport, f64)> {
    // Without its sign, NaN is sorted as the largest value.
    let mut corners: Vec<_> = refined.corners.iter().map(|corner| (corner, measured(corner).abs())).collect();
    corners.sort_by(|a, b| b.1.total_cmp(&a.1));
    corners
}

fn name(corner: &CornerReport) -> String {
    format!("corner {}", corner.corner + 1)
}
