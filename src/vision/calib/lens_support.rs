//! The part of the picture that the data support (the pixels at which the lens is known to a stated error), and the
//! picture of the board that would improve a lens most.
//!
//! C is the covariance of the lens, J the derivative of a pixel with respect to the lens, and Jp its derivative with
//! respect to the pose of a board. A lens error δ makes a board appear displaced. The estimated pose compensates a part
//! of this displacement: P δ, by least squares over the corners that were used. The remainder, (J − Jp P) δ, cannot be
//! compensated afterwards; its 95 % circle is the error of the lens at this pixel. The error increases from the centre
//! of the corners outwards; the outline is the line at which it exceeds the limit.
//!
//! For the next picture, the board is simulated in nine parts of the picture, flat and tilted in four directions. Only
//! poses are considered at which the picture contains the whole board. The best pose is the one after which the lens
//! error, summed over the picture, is smallest.

use super::adjust::scaled_inverse;
use super::board::Board;
use super::detect::Corners;
use super::lens_fit::LensGram;
use nalgebra::{Isometry3, Matrix2, Matrix6, SMatrix, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Camera, Degrees, PinholeCamera, Pixel, Point, Rigid, polygon};
use panelprep_cell::cell::LensCovariance;

/// The part of the picture in which a lens is known.
#[derive(Debug, Clone, PartialEq)]
pub struct LensSupport {
    /// The error for which the support is stated, 95 %, px.
    pub error_px: f64,
    /// Outline of the part in which the lens is known to this error; `None` if this is the whole picture.
    pub outline_px: Option<Vec<Pixel>>,
    /// The supported part as a fraction of the picture.
    pub share: f64,
}

/// Maximum error of a lens in the supported part of the picture, 95 %, px.
pub const MAX_LENS_ERROR_PX: f64 = 0.3;
/// Ratio of the stated error to the error in the centre of the corners, if the error is larger than
/// [`MAX_LENS_ERROR_PX`] even there. The stated error is at most `MAX_STATED_ERROR_PX`, px.
const MAX_RATIO_TO_CENTRE: f64 = 1.5;
const MAX_STATED_ERROR_PX: f64 = 3.0;
/// The 95 % quantile of χ² with two degrees of freedom.
const CHI_SQUARE_2_DOF_QUANTILE_95: f64 = 5.991;
const OUTLINE_DIRECTIONS: usize = 48;
const OUTLINE_STEPS: usize = 60;
/// Maximum number of corners to which the pose is fitted.
const MAX_POSE_CORNERS: usize = 2000;

/// Returns the part of the picture in which a lens with this covariance is known.
pub(super) fn compute_support(
    camera: &PinholeCamera,
    covariance: &LensCovariance,
    views: &[&Corners],
) -> LensSupport {
    let nowhere = LensSupport { error_px: MAX_LENS_ERROR_PX, outline_px: Some(Vec::new()), share: 0.0 };
    let pixels: Vec<Pixel> = views.iter().flat_map(|corners| corners.iter().map(|(_, pixel)| *pixel)).collect();
    let Some(follow) = pose_jacobian(camera, &pixels) else { return nowhere };
    let error_at = |pixel: Pixel| error_px(camera, covariance, &follow, pixel).unwrap_or(f64::INFINITY);
    let count = pixels.len().max(1) as f64;
    let middle = Pixel::at(
        pixels.iter().map(|pixel| pixel.u).sum::<f64>() / count,
        pixels.iter().map(|pixel| pixel.v).sum::<f64>() / count,
    );
    // If the error is larger than the limit even in the centre, the stated part is the part in which the error is
    // hardly larger than in the centre.
    let allowed_px = MAX_LENS_ERROR_PX.max(MAX_RATIO_TO_CENTRE * error_at(middle));
    if allowed_px.is_nan() || allowed_px > MAX_STATED_ERROR_PX {
        return nowhere;
    }
    let is_known = |pixel: Pixel| error_at(pixel) <= allowed_px;
    let (right, low) = (camera.width_px as f64 - 1.0, camera.height_px as f64 - 1.0);
    let mut is_whole = true;
    let outline = (0..OUTLINE_DIRECTIONS).map(|direction| {
        let turn = std::f64::consts::TAU * direction as f64 / OUTLINE_DIRECTIONS as f64;
        let at = |length: f64| Pixel::at(middle.u + turn.cos() * length, middle.v + turn.sin() * length);
        let length = distance_to_rim_px(middle, turn, (right, low));
        let unknown =
            (1..=OUTLINE_STEPS).find(|index| !is_known(at(length * *index as f64 / OUTLINE_STEPS as f64)));
        is_whole &= unknown.is_none();
        at(length * (unknown.unwrap_or(OUTLINE_STEPS + 1) - 1) as f64 / OUTLINE_STEPS as f64)
    });
    let outline: Vec<Pixel> = outline.collect();
    let corners = [(0.0, 0.0), (right, 0.0), (right, low), (0.0, low)].map(|(u, v)| Pixel::at(u, v));
    if is_whole && corners.into_iter().all(is_known) {
        return LensSupport { error_px: allowed_px, outline_px: None, share: 1.0 };
    }
    let share = polygon::signed_area_px2(&outline).abs() / (right * low);
    LensSupport { error_px: allowed_px, outline_px: Some(outline), share }
}

/// Returns the distance from a pixel to the rim of the picture in a direction, px.
fn distance_to_rim_px(from: Pixel, turn: f64, (right, low): (f64, f64)) -> f64 {
    let reach = |at: f64, along: f64, end: f64| match along {
        along if along > 1e-9 => (end - at) / along,
        along if along < -1e-9 => -at / along,
        _ => f64::INFINITY,
    };
    reach(from.u, turn.cos(), right).min(reach(from.v, turn.sin(), low)).max(0.0)
}

/// Returns the matrix P, the derivative of the board pose with respect to the lens.
fn pose_jacobian(camera: &PinholeCamera, pixels: &[Pixel]) -> Option<SMatrix<f64, 6, 9>> {
    let (mut pose, mut cross) = (Matrix6::zeros(), SMatrix::<f64, 6, 9>::zeros());
    for pixel in pixels.iter().step_by(pixels.len().div_ceil(MAX_POSE_CORNERS).max(1)) {
        let (by_lens, by_pose) = pixel_jacobians(camera, *pixel)?;
        pose += by_pose.transpose() * by_pose;
        cross += by_pose.transpose() * by_lens;
    }
    Some(scaled_inverse(&pose)? * cross)
}

/// Returns the derivatives of the pixel with respect to the lens and to the pose of an object at unit distance.
fn pixel_jacobians(camera: &PinholeCamera, pixel: Pixel) -> Option<(SMatrix<f64, 2, 9>, SMatrix<f64, 2, 6>)> {
    let ray: panelprep_base::geometry::Vector<Camera> = camera.unproject(pixel)?;
    let point = Point::<Camera>::new(ray.mm.into());
    let (_, slope) = camera.project_with_jacobian(point)?;
    let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
    by_pose.fixed_columns_mut::<3>(0).copy_from(&(-slope * ray.mm.cross_matrix()));
    by_pose.fixed_columns_mut::<3>(3).copy_from(&slope);
    Some((camera.lens_jacobian(point)?, by_pose))
}

fn error_px(
    camera: &PinholeCamera,
    covariance: &LensCovariance,
    follow: &SMatrix<f64, 6, 9>,
    pixel: Pixel,
) -> Option<f64> {
    let (by_lens, by_pose) = pixel_jacobians(camera, pixel)?;
    let left = by_lens - by_pose * follow;
    let spread: Matrix2<f64> = left * covariance * left.transpose();
    Some((CHI_SQUARE_2_DOF_QUANTILE_95 * spread.symmetric_eigenvalues().max()).sqrt())
}

/// A recommended next picture.
#[derive(Debug, Clone, PartialEq)]
pub struct NextPicture {
    /// Position and tilt of the board in the picture, as text for a person.
    pub description: String,
    /// The centre of the board, px.
    pub centre: Pixel,
    /// The lens error after this picture, as a fraction of the error before it.
    pub error_share: f64,
}

const COLUMNS: [(f64, &str); 3] = [(0.25, "left"), (0.5, ""), (0.75, "right")];
const ROWS: [(f64, &str); 3] = [(0.27, "upper"), (0.5, ""), (0.73, "lower")];
const TILT_DEG: f64 = 35.0;
/// Maximum fraction of the error that may remain after a useful picture.
const MAX_REMAINING_FRACTION: f64 = 0.98;
/// Widths of the board as fractions of the picture's width, the largest first.
const RELATIVE_BOARD_WIDTHS: [f64; 4] = [0.8, 0.6, 0.45, 0.3];

/// Returns the best next picture; `information` is the sum of the information of corners and prior about the lens.
pub(super) fn best_next_picture(
    camera: &PinholeCamera,
    board: &Board,
    information: &LensCovariance,
) -> Option<NextPicture> {
    let before = summed_variance(camera, &scaled_inverse(information)?)?;
    let mut best: Option<NextPicture> = None;
    for (across, column) in COLUMNS {
        for (down, row) in ROWS {
            for (turn, tilt) in candidate_tilts() {
                let Some((width, gram)) = RELATIVE_BOARD_WIDTHS.iter().find_map(|&width| {
                    let pose = candidate_pose(camera, board, (across, down), turn, width)?;
                    Some((width, simulate_view(camera, board, &pose)?))
                }) else {
                    continue;
                };
                let Some(gain) = gram.information() else { continue };
                let Some(after) =
                    scaled_inverse(&(information + gain)).and_then(|after| summed_variance(camera, &after))
                else {
                    continue;
                };
                let error_share = (after / before).sqrt();
                if best.as_ref().is_none_or(|best| error_share < best.error_share) {
                    let middle = Pixel::at(across * camera.width_px as f64, down * camera.height_px as f64);
                    best = Some(NextPicture {
                        description: describe_picture(column, row, tilt, width),
                        centre: middle,
                        error_share,
                    });
                }
            }
        }
    }
    best.filter(|best| best.error_share < MAX_REMAINING_FRACTION)
}

fn describe_picture(column: &str, row: &str, tilt: &str, width: f64) -> String {
    let place = match (row, column) {
        ("", "") => "middle".to_owned(),
        (row, "") => format!("{row} part"),
        ("", column) => format!("{column} part"),
        (row, column) => format!("{row} {column} part"),
    };
    format!("the board in the {place} of the picture, {tilt}, as wide as {:.0} % of the picture", width * 100.0)
}

fn candidate_tilts() -> [(UnitQuaternion<f64>, &'static str); 5] {
    let turn = |axis: Vector3<f64>| UnitQuaternion::from_scaled_axis(axis * Degrees(TILT_DEG).to_rad());
    [
        (UnitQuaternion::identity(), "facing the camera"),
        (turn(Vector3::x()), "its upper edge tilted away by 35°"),
        (turn(-Vector3::x()), "its lower edge tilted away by 35°"),
        (turn(Vector3::y()), "its right edge tilted away by 35°"),
        (turn(-Vector3::y()), "its left edge tilted away by 35°"),
    ]
}

/// Returns the pose at which the centre of the board is on the ray through this position in the picture.
fn candidate_pose(
    camera: &PinholeCamera,
    board: &Board,
    (across, down): (f64, f64),
    turn: UnitQuaternion<f64>,
    width: f64,
) -> Option<Rigid<Camera, panelprep_base::geometry::Board>> {
    let pixel = Pixel::at(across * camera.width_px as f64, down * camera.height_px as f64);
    let ray: panelprep_base::geometry::Vector<Camera> = camera.unproject(pixel)?;
    let middle = board.centre().mm.coords;
    let depth_mm = 2.0 * middle.x * camera.fx_px / (width * camera.width_px as f64);
    let shift = Translation3::from(ray.mm * depth_mm) * turn * Translation3::from(-middle);
    let pose: Isometry3<f64> = shift;
    Some(Rigid::from_isometry_unchecked(pose))
}

fn simulate_view(
    camera: &PinholeCamera,
    board: &Board,
    pose: &Rigid<Camera, panelprep_base::geometry::Board>,
) -> Option<LensGram> {
    let corners: Corners =
        board.corners().into_iter().map(|q| Some((q, camera.project_inside(*pose * q)?))).collect::<Option<_>>()?;
    LensGram::compute(camera, &corners, pose)
}

/// Returns the sum of the pixel variances over the whole picture.
fn summed_variance(camera: &PinholeCamera, covariance: &LensCovariance) -> Option<f64> {
    let mut sum = 0.0;
    for index in 0..48 {
        let at = |index: usize, count: usize, size: usize| (index as f64 + 0.5) / count as f64 * size as f64;
        let pixel = Pixel::at(at(index % 8, 8, camera.width_px), at(index / 8, 6, camera.height_px));
        let ray: panelprep_base::geometry::Vector<Camera> = camera.unproject(pixel)?;
        let slope = camera.lens_jacobian(Point::<Camera>::new(ray.mm.into()))?;
        sum += (slope * covariance * slope.transpose()).trace();
    }
    Some(sum)
}
