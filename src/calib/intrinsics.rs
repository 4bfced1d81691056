//! Intrinsics from pictures of a board (thesis 3.6), and how far they can be trusted.
//!
//! `calibrateCamera` minimises the reprojection error of all corners over the camera and every board's pose. A picture
//! whose corners fit far worse than the others' (blurred, bent board, wrong corners) is set aside with the reason and
//! the rest is calibrated again. Coverage of the picture and tilts of the board say what the pictures can determine:
//! without tilt, focal length and distance cannot be told apart; without corners near the rim, distortion is guessed.

use super::detect::Corners;
use super::error::CalibError;
use super::foreign;
use super::lens_covariance::lens_covariance;
use crate::cell::LensCovariance;
use crate::geometry::{Board, Camera, PinholeCamera, Pixel, Point, Rigid};
use crate::words::apart;
use nalgebra::Vector3;

/// A picture with its corners.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The picture's name in messages.
    pub name: String,
    /// The corners that it shows.
    pub corners: Corners,
}

/// How one picture took part.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewResult {
    /// The picture.
    pub name: String,
    /// Root mean square of its corners' distances, px.
    pub rms_px: f64,
    /// Why it was set aside; `None` where it was used.
    pub set_aside: Option<String>,
}

/// A corner and how far the camera model misses it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerResidual {
    /// Where it was found.
    pub at: Pixel,
    /// Found minus computed, u, px.
    pub du_px: f64,
    /// Found minus computed, v, px.
    pub dv_px: f64,
}

/// A calibrated camera with its evidence.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The camera.
    pub camera: PinholeCamera,
    /// Root mean square distance of all used corners, px.
    pub rms_px: f64,
    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3.
    pub deviations: [f64; 9],
    /// Their covariance.
    pub covariance: LensCovariance,
    /// The pictures, in the order given.
    pub views: Vec<ViewResult>,
    /// Share of the picture's 8 × 6 fields that hold a corner.
    pub coverage: f64,
    /// Smallest and largest tilt of the board from facing the camera, degrees.
    pub tilt_deg: [f64; 2],
    /// The residual of every used corner.
    pub residuals: Vec<CornerResidual>,
}

/// Fewer pictures than this determine no camera.
pub const MIN_VIEWS: usize = 4;
/// A picture this many times worse than the median is set aside.
const OUTLIER_FACTOR: f64 = 2.5;
/// Pictures below this are good whatever the others are, px.
const GOOD_PX: f64 = 0.15;
/// At most this share of the pictures is set aside.
const MAX_ASIDE: f64 = 0.34;
const FIELDS: (usize, usize) = (8, 6);

/// Calibrates. With `keep_all` no picture is set aside.
///
/// # Errors
/// Where there are too few pictures, or OpenCV finds no camera.
pub fn calibrate(size: (usize, usize), views: &[View], keep_all: bool) -> Result<Calibrated, CalibError> {
    let mut aside: Vec<Option<(f64, String)>> = vec![None; views.len()];
    loop {
        let used: Vec<&View> =
            views.iter().zip(&aside).filter(|(_, aside)| aside.is_none()).map(|(v, _)| v).collect();
        if used.len() < MIN_VIEWS {
            let (found, given) = (used.len(), views.len());
            return Err(CalibError::TooFewPictures { found, given, needed: MIN_VIEWS, first_reason: None });
        }
        let corners: Vec<&[(Point<Board>, Pixel)]> = used.iter().map(|view| view.corners.as_slice()).collect();
        let found = foreign::calibrate_camera(size, &corners)?;
        let poses: Vec<Rigid<Camera, Board>> =
            found.camera_from_board.iter().map(|pose| Rigid::claim(*pose)).collect();
        let residuals: Vec<Vec<CornerResidual>> =
            used.iter().zip(&poses).map(|(view, pose)| residuals_of(&found.camera, pose, view)).collect();
        let rms: Vec<f64> = residuals.iter().map(|view| rms_px(view)).collect();
        let set_aside = aside.iter().flatten().count() + 1;
        let allowed = !keep_all && set_aside as f64 <= MAX_ASIDE * views.len() as f64;
        if let Some((worst, limit_px)) = outlier(&rms).filter(|_| allowed && used.len() > MIN_VIEWS) {
            let name = &used[worst].name;
            let [off, limit] = apart(rms[worst], limit_px, 2);
            let reason = format!(
                "its corners are {off} px off, the limit from the other pictures is {limit} px; blurred, or the board was bent \
                 or moved"
            );
            if let Some(index) = views.iter().position(|view| view.name == *name) {
                aside[index] = Some((rms[worst], reason));
            }
            continue;
        }
        let mut each = rms.iter();
        let views = views.iter().zip(&aside).map(|(view, aside)| match aside {
            Some((rms_px, reason)) => {
                ViewResult { name: view.name.clone(), rms_px: *rms_px, set_aside: Some(reason.clone()) }
            }
            None => ViewResult {
                name: view.name.clone(),
                rms_px: each.next().copied().unwrap_or(f64::NAN),
                set_aside: None,
            },
        });
        let seen: Vec<_> = used.iter().map(|view| &view.corners).zip(poses.iter().copied()).collect();
        let covariance =
            lens_covariance(&found.camera, &seen).ok_or(CalibError::NotSettled { what: "the lens" })?;
        return Ok(Calibrated {
            camera: found.camera,
            covariance,
            rms_px: found.rms_px,
            deviations: std::array::from_fn(|index| covariance[(index, index)].sqrt()),
            views: views.collect(),
            coverage: coverage(size, &used),
            tilt_deg: tilts(&poses),
            residuals: residuals.concat(),
        });
    }
}

fn residuals_of(camera: &PinholeCamera, pose: &Rigid<Camera, Board>, view: &View) -> Vec<CornerResidual> {
    let residual = |&(q, at): &(Point<Board>, Pixel)| {
        let computed = camera.project(*pose * q)?;
        Some(CornerResidual { at, du_px: at.u - computed.u, dv_px: at.v - computed.v })
    };
    view.corners.iter().filter_map(residual).collect()
}

fn rms_px(residuals: &[CornerResidual]) -> f64 {
    let square: f64 = residuals.iter().map(|r| r.du_px.powi(2) + r.dv_px.powi(2)).sum();
    (square / residuals.len().max(1) as f64).sqrt()
}

/// The worst picture and the limit it exceeds.
fn outlier(rms: &[f64]) -> Option<(usize, f64)> {
    let mut sorted = rms.to_vec();
    sorted.sort_by(f64::total_cmp);
    let limit_px = (OUTLIER_FACTOR * sorted[sorted.len() / 2]).max(GOOD_PX);
    let (worst, largest) = rms.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (*largest > limit_px).then_some((worst, limit_px))
}

fn coverage((width, height): (usize, usize), views: &[&View]) -> f64 {
    let mut seen = vec![false; FIELDS.0 * FIELDS.1];
    for (_, pixel) in views.iter().flat_map(|view| &view.corners) {
        if let Some((column, row)) = pixel.whole(width, height) {
            seen[row * FIELDS.1 / height * FIELDS.0 + column * FIELDS.0 / width] = true;
        }
    }
    seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64
}

fn tilts(poses: &[Rigid<Camera, Board>]) -> [f64; 2] {
    let tilt = |pose: &Rigid<Camera, Board>| {
        let normal = pose.rotation() * Vector3::z();
        normal.angle(&pose.origin().mm.coords.normalize()).to_degrees()
    };
    poses.iter().map(tilt).fold([f64::INFINITY, 0.0], |[low, high], tilt| [low.min(tilt), high.max(tilt)])
}
