//! Tests whether the board is flat and its squares are equal.
//!
//! A bent board, or one with unequal squares, leaves residuals that are the same at each of its corners in all
//! pictures, which no lens and no pose absorbs. Each corner's position on the board gets its own offset δⱼ, as in
//! OpenCV's `calibrateCameraRO`. Lens and poses are adjusted in turn with the offsets. For fixed lens and poses each
//! offset is
//!     δⱼ = (Σᵢ JᵢⱼᵀJᵢⱼ)⁻¹ Σᵢ Jᵢⱼᵀ rᵢⱼ,                                                                           (1)
//! with J the derivative of the pixel with respect to the corner's position. The part of the offsets that is a motion
//! or another scale of the whole board belongs to the poses, and is removed from the stated offsets.

use super::detect::Corners;
use super::lens_fit::{self, LensFit};
use super::lens_model::LensModel;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use panelprep_base::geometry::{Board, Point};
use std::collections::BTreeMap;

/// Number of rounds in which lens and board shape are adjusted in turn.
const SHAPE_ITERATIONS: usize = 6;
/// With fewer pictures a shape cannot be distinguished from noise.
const MIN_VIEWS: usize = 6;
/// A corner's position is an unknown if at least this number of pictures show it.
const MIN_VIEWS_PER_CORNER: usize = 4;
/// Corners whose distance from those of a flat board is smaller than this are good, px.
const GOOD_PX: f64 = 0.08;
/// The board is not flat only if its own shape reduces the corners' residuals to this share, or less, of those of a
/// flat board.
const MAX_ERROR_RATIO: f64 = 0.8;

/// A board that is not flat, or not square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardShape {
    /// Root mean square of the corners' distances from those of a flat board, px, calculated with the redundancy of
    /// the fit.
    pub flat_px: f64,
    /// Root mean square of the corners' distances with the board's own shape, px.
    pub fitted_rms_px: f64,
    /// The bow of the board, from its lowest to its highest corner, mm.
    pub bow_mm: f64,
    /// The largest distance of a corner from its nominal position in the plane, mm.
    pub max_in_plane_shift_mm: f64,
}

/// Returns a corner's position as a key, in thousandths of a millimetre.
fn key(q: &Point<Board>) -> [i64; 2] {
    [q.mm.x, q.mm.y].map(|mm| (mm * 1e3).round() as i64)
}

/// Returns the board's shape if it explains the residuals; `None` for a flat board, or if the pictures do not
/// determine it.
pub(super) fn shape(model: LensModel, flat: &LensFit, corners: &[&Corners]) -> Option<BoardShape> {
    let rms = |square: f64, free: f64| (2.0 * square / free).sqrt();
    let own = model.count() as f64 + 6.0 * corners.len() as f64;
    let flat_px = rms(flat.square, flat.rows - own);
    if corners.len() < MIN_VIEWS || flat_px.is_nan() || flat_px < GOOD_PX {
        return None;
    }
    let mut offsets: BTreeMap<[i64; 2], Vector3<f64>> = BTreeMap::new();
    let mut fit = flat.clone();
    for _ in 0..SHAPE_ITERATIONS {
        offsets = solve_offsets(&fit, corners, &offsets)?;
        let shaped: Vec<Corners> = corners.iter().map(|corners| apply_offsets(corners, &offsets)).collect();
        fit = lens_fit::fit(model, fit, &shaped.iter().collect::<Vec<_>>())?;
    }
    // Seven degrees of freedom of the offsets are a motion and the scale of the whole board.
    let free = flat.rows - own - (3 * offsets.len()) as f64 + 7.0;
    if free < 0.25 * flat.rows {
        return None;
    }
    let own_px = rms(fit.square, free);
    let [bow_mm, beside_mm] = bow_and_shift(&offsets)?;
    (own_px <= MAX_ERROR_RATIO * flat_px).then_some(BoardShape {
        flat_px,
        fitted_rms_px: own_px,
        bow_mm,
        max_in_plane_shift_mm: beside_mm,
    })
}

fn apply_offsets(corners: &Corners, offsets: &BTreeMap<[i64; 2], Vector3<f64>>) -> Corners {
    let at = |q: &Point<Board>| Point::new(q.mm + offsets.get(&key(q)).copied().unwrap_or_default());
    corners.iter().map(|(q, pixel)| (at(q), *pixel)).collect()
}

/// Solves equation (1), and adds the result to the offsets so far.
fn solve_offsets(
    fit: &LensFit,
    corners: &[&Corners],
    before: &BTreeMap<[i64; 2], Vector3<f64>>,
) -> Option<BTreeMap<[i64; 2], Vector3<f64>>> {
    let mut sums: BTreeMap<[i64; 2], (Matrix3<f64>, Vector3<f64>, usize)> = BTreeMap::new();
    for (corners, pose) in corners.iter().zip(&fit.poses) {
        let turn = pose.rotation().into_inner();
        for (q, pixel) in corners.iter() {
            let place = Point::new(q.mm + before.get(&key(q)).copied().unwrap_or_default());
            let (seen, slope) = fit.camera.project_with_jacobian(*pose * place)?;
            let slope = slope * turn;
            let sum = sums.entry(key(q)).or_insert((Matrix3::zeros(), Vector3::zeros(), 0));
            sum.0 += slope.transpose() * slope;
            sum.1 += slope.transpose() * nalgebra::Vector2::new(pixel.u - seen.u, pixel.v - seen.v);
            sum.2 += 1;
        }
    }
    let offset = |(at, (normal, pull, seen)): ([i64; 2], (Matrix3<f64>, Vector3<f64>, usize))| {
        let step = if seen < MIN_VIEWS_PER_CORNER { Vector3::zeros() } else { normal.cholesky()?.solve(&pull) };
        Some((at, before.get(&at).copied().unwrap_or_default() + step))
    };
    sums.into_iter().map(offset).collect()
}

/// Returns the bow and the largest shift in the plane, without motion and scale of the whole board.
fn bow_and_shift(offsets: &BTreeMap<[i64; 2], Vector3<f64>>) -> Option<[f64; 2]> {
    let count = offsets.len();
    let place = |at: &[i64; 2]| [at[0] as f64 / 1e3, at[1] as f64 / 1e3];
    let mut plane = DMatrix::zeros(count, 3);
    let mut similar = DMatrix::zeros(2 * count, 4);
    let (mut up, mut beside) = (DVector::zeros(count), DVector::zeros(2 * count));
    for (row, (at, offset)) in offsets.iter().enumerate() {
        let [x, y] = place(at);
        plane.row_mut(row).copy_from_slice(&[1.0, x, y]);
        similar.row_mut(2 * row).copy_from_slice(&[1.0, 0.0, x, -y]);
        similar.row_mut(2 * row + 1).copy_from_slice(&[0.0, 1.0, y, x]);
        up[row] = offset.z;
        (beside[2 * row], beside[2 * row + 1]) = (offset.x, offset.y);
    }
    let up = &up - &plane * plane.clone().svd(true, true).solve(&up, 1e-9).ok()?;
    let beside = &beside - &similar * similar.clone().svd(true, true).solve(&beside, 1e-9).ok()?;
    let largest = beside.as_slice().chunks(2).map(|pair| pair[0].hypot(pair[1])).fold(0.0, f64::max);
    Some([up.max() - up.min(), largest])
}
