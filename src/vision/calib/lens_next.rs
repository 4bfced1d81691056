//! Suggests the picture of the board that would improve a lens most.
//!
//! The board is simulated in nine parts of the picture, flat and tilted in four directions. Of the poses at which the
//! picture contains it completely, the best is the one after which the lens's error, summed over the picture, is
//! least.

use super::adjust::scaled_inverse;
use super::board::Board;
use super::detect::Corners;
use super::lens_gram::LensGram;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Camera, Degrees, PinholeCamera, Pixel, Point, Rigid};
use panelprep_cell::cell::LensCovariance;

/// A recommended next picture.
#[derive(Debug, Clone, PartialEq)]
pub struct NextPicture {
    /// Position and tilt of the board in the picture, as text.
    pub description: String,
    /// The middle of the board, px.
    pub centre: Pixel,
    /// The lens's error after this picture, as a share of the error before it.
    pub error_share: f64,
}

const PARTS: [(f64, &str); 3] = [(0.25, "left"), (0.5, ""), (0.75, "right")];
const ROWS: [(f64, &str); 3] = [(0.27, "upper"), (0.5, ""), (0.73, "lower")];
const TILT_DEG: f64 = 35.0;
/// A picture is not worth taking if a larger share of the error remains after it.
const MAX_REMAINING_SHARE: f64 = 0.98;
/// Widths of the board as shares of the picture's width, the largest first.
const WIDTHS: [f64; 4] = [0.8, 0.6, 0.45, 0.3];

/// Returns the best next picture; `information` is that of corners and prior on the lens together.
pub(super) fn best_next_picture(
    camera: &PinholeCamera,
    board: &Board,
    information: &LensCovariance,
) -> Option<NextPicture> {
    let before = error(camera, &scaled_inverse(information)?)?;
    let mut best: Option<NextPicture> = None;
    for (across, column) in PARTS {
        for (down, row) in ROWS {
            for (turn, tilt) in candidate_tilts() {
                let Some((width, gram)) = WIDTHS.iter().find_map(|&width| {
                    let pose = candidate_pose(camera, board, (across, down), turn, width)?;
                    Some((width, simulate_view(camera, board, &pose)?))
                }) else {
                    continue;
                };
                let Some(gain) = gram.information() else { continue };
                let Some(after) = scaled_inverse(&(information + gain)).and_then(|after| error(camera, &after))
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
    best.filter(|best| best.error_share < MAX_REMAINING_SHARE)
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

/// Returns the pose of the board with its middle on the ray of a part of the picture.
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
fn error(camera: &PinholeCamera, covariance: &LensCovariance) -> Option<f64> {
    let mut sum = 0.0;
    for index in 0..48 {
        let at = |index: usize, count: usize, size: usize| (index as f64 + 0.5) / count as f64 * size as f64;
        let pixel = Pixel::at(at(index % 8, 8, camera.width_px), at(index / 8, 6, camera.height_px));
        let ray: panelprep_base::geometry::Vector<Camera> = camera.unproject(pixel)?;
        let slope = camera.lens_slope(Point::<Camera>::new(ray.mm.into()))?;
        sum += (slope * covariance * slope.transpose()).trace();
    }
    Some(sum)
}
