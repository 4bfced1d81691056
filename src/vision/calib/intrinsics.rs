//! Intrinsics from pictures of a board (thesis 3.6), and how far they can be trusted.
//!
//! `lens_fit` minimises the reprojection error of all corners over the camera and every board's pose, among lenses
//! that can be inverted over the whole picture. A picture with corners that fit far worse than the others'
//! (blurred, bent board, wrong corners) is set aside with the reason, and the rest is calibrated again.
//! `lens_choice` selects how many distortion coefficients the pictures support. The coverage of the picture and the
//! tilts of the board show what the pictures can determine: without tilt, focal length and distance cannot be
//! distinguished; without corners near the rim, distortion is extrapolated.

use super::board::Board as BoardPattern;
use super::board_shape;
pub use super::board_shape::BoardShape;
use super::detect::Corners;
use super::error::CalibError;
use super::foreign;
pub use super::lens_choice::ModelTrial;
use super::lens_fit::{self, LensFit};
use super::lens_gram::LensGram;
pub use super::lens_model::LensModel;
pub use super::lens_next::NextPicture;
pub use super::lens_support::LensSupport;
use super::{lens_choice, lens_covariance, lens_next, lens_support};
use nalgebra::Vector3;
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Pixel, Point, Rigid, median};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::cell::LensCovariance;

/// A picture with its corners.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The picture's name in messages.
    pub name: String,
    /// The corners that it shows.
    pub corners: Corners,
}

/// One picture's part in the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewResult {
    /// The picture.
    pub name: String,
    /// Root mean square of the distances of the picture's corners, px.
    pub rms_px: f64,
    /// The reason why it was set aside; `None` if it was used.
    pub exclusion_reason: Option<String>,
}

/// A corner with its residual in the camera model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerResidual {
    /// The pixel at which it was found.
    pub pixel: Pixel,
    /// Found minus computed, u, px.
    pub du_px: f64,
    /// Found minus computed, v, px.
    pub dv_px: f64,
}

/// A calibrated camera with its evidence.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The camera; coefficients that are not in the model are 0.
    pub camera: PinholeCamera,
    /// The lens model, which states the coefficients.
    pub model: LensModel,
    /// Prediction error of each model on pictures that were left out, the simplest model first.
    pub trials: Vec<ModelTrial>,
    /// Root mean square distance of all used corners, px.
    pub rms_px: f64,
    /// Root mean square distance of the corners in left-out pictures, px.
    pub left_out_rms_px: f64,
    /// The distance within which 95 % of the corners in left-out pictures lie, px.
    pub left_out_95_px: f64,
    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3.
    pub deviations: [f64; 9],
    /// Covariance of the coefficients.
    pub covariance: LensCovariance,
    /// The part of the picture in which the lens is calibrated.
    pub support: LensSupport,
    /// The pictures, in the order of the input.
    pub views: Vec<ViewResult>,
    /// Share of the picture's 8 × 6 fields that contain a corner.
    pub coverage: f64,
    /// Smallest and largest tilt of the board relative to the image plane, degrees.
    pub tilt_deg: [f64; 2],
    /// The residual of every used corner.
    pub residuals: Vec<CornerResidual>,
    /// The board's own shape, if it explains the residuals: the board is bent, or its squares are not equal.
    pub board_shape: Option<BoardShape>,
    /// The information of corners and prior on the lens.
    information: LensCovariance,
}

impl Calibrated {
    /// Returns the picture of this board that would help most; `None` if none helps much.
    pub fn next_picture(&self, board: &BoardPattern) -> Option<NextPicture> {
        lens_next::best_next_picture(&self.camera, board, &self.information)
    }
}

/// Options of the calibration.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Whether no picture may be set aside.
    pub keep_all_pictures: bool,
    /// The lens model; without it, the model is chosen from the data.
    pub model: Option<LensModel>,
}

/// Minimum number of pictures: fewer determine no camera.
pub const MIN_VIEWS: usize = 4;
/// A picture whose residual is this multiple of the median is set aside.
const OUTLIER_FACTOR: f64 = 2.5;
/// Pictures with a smaller residual than this are good, independent of the others, px.
const GOOD_PX: f64 = 0.15;
/// At most this share of the pictures is set aside.
const MAX_EXCLUDED_SHARE: f64 = 0.34;
const FIELDS: (usize, usize) = (8, 6);

/// Calibrates a camera's intrinsics from pictures of a board.
///
/// # Errors
/// If there are too few pictures, or their corners determine no camera.
pub fn calibrate(size: (usize, usize), views: &[View], options: Options) -> Result<Calibrated, CalibError> {
    let mut aside: Vec<Option<(f64, String)>> = vec![None; views.len()];
    loop {
        let used: Vec<&View> =
            views.iter().zip(&aside).filter(|(_, aside)| aside.is_none()).map(|(v, _)| v).collect();
        if used.len() < MIN_VIEWS {
            let (found, given) = (used.len(), views.len());
            return Err(CalibError::TooFewPictures { found, given, needed: MIN_VIEWS, first_reason: None });
        }
        // A model of medium size: a simpler one would make pictures with corners near the border look wrong, a larger
        // one would overfit bad pictures.
        let first = fit_lens(size, &used, options.model.unwrap_or(LensModel::Tangential))?;
        let rms = rms_per_picture(&first, &used);
        let set_aside = aside.iter().flatten().count() + 1;
        let allowed = !options.keep_all_pictures && set_aside as f64 <= MAX_EXCLUDED_SHARE * views.len() as f64;
        // One at a time and fitted again: a bad picture pulls the lens, so that good ones look worse than they are.
        let Some((worst, limit_px)) = worst_outlier(&rms).filter(|_| allowed && used.len() > MIN_VIEWS) else {
            return choose_model(first, &used, options.model, (views, &aside));
        };
        let name = &used[worst].name;
        let [off, limit] = distinguishable_texts(rms[worst], limit_px, 2);
        let reason = format!(
            "its corners are {off} px off (limit {limit} px, from the other pictures): the picture is blurred, or \
             the board was bent or moved"
        );
        if let Some(index) = views.iter().position(|view| view.name == *name) {
            aside[index] = Some((rms[worst], reason));
        }
    }
}

fn used_corners<'a>(used: &[&'a View]) -> Vec<&'a Corners> {
    used.iter().map(|view| &view.corners).collect()
}

/// Fits the lens of one model, from OpenCV's start values.
fn fit_lens(size: (usize, usize), used: &[&View], model: LensModel) -> Result<LensFit, CalibError> {
    let corners: Vec<&[(Point<Board>, Pixel)]> = used.iter().map(|view| view.corners.as_slice()).collect();
    let start = foreign::calibrate_camera(size, &corners)?;
    let poses = start.camera_from_board.iter().map(|pose| Rigid::from_isometry_unchecked(*pose)).collect();
    let start = LensFit { camera: start.camera, poses, square: 0.0, rows: 0.0 };
    lens_fit::fit(model, start, &used_corners(used)).ok_or(CalibError::NotSettled { what: "the lens" })
}

fn rms_per_picture(fit: &LensFit, used: &[&View]) -> Vec<f64> {
    let rms = |(view, pose): (&&View, &Rigid<Camera, Board>)| rms_px(&compute_residuals(&fit.camera, pose, view));
    used.iter().zip(&fit.poses).map(rms).collect()
}

/// Chooses the model and gathers its evidence.
fn choose_model(
    first: LensFit,
    used: &[&View],
    model: Option<LensModel>,
    (views, aside): (&[View], &[Option<(f64, String)>]),
) -> Result<Calibrated, CalibError> {
    let unsettled = CalibError::NotSettled { what: "the lens" };
    let corners = used_corners(used);
    let models = model.map_or_else(|| LensModel::ALL.to_vec(), |model| vec![model]);
    let mut start = first;
    let mut fits = Vec::new();
    for model in models {
        let fit = lens_fit::fit(model, start.clone(), &corners);
        start = fit.clone().unwrap_or(start);
        fits.push((model, fit));
    }
    let choice = lens_choice::choose(&fits, &corners).ok_or_else(|| unsettled.clone())?;
    let chosen = fits.into_iter().find(|(model, _)| *model == choice.model).and_then(|(_, fit)| fit);
    let found = chosen.ok_or_else(|| unsettled.clone())?;
    let grams: Vec<LensGram> = corners
        .iter()
        .zip(&found.poses)
        .map(|(corners, pose)| LensGram::compute(&found.camera, corners, pose))
        .collect::<Option<_>>()
        .ok_or_else(|| unsettled.clone())?;
    let poses = 6.0 * corners.len() as f64;
    let redundancy = found.rows - choice.model.count() as f64 - poses;
    let mut left_out: Vec<f64> = choice.left_out_distances.concat();
    left_out.sort_by(f64::total_cmp);
    let left_out_square: f64 = left_out.iter().map(|px| px * px).sum();
    if redundancy <= 0.0 || left_out.is_empty() {
        return Err(unsettled);
    }
    // The larger of two estimates: corners that are off in the same way in each picture hardly show in the residuals of
    // the fit itself.
    let variance_px2 = (found.square / redundancy).max(left_out_square / (found.rows - poses));
    let information = lens_covariance::information(&found.camera, &grams, variance_px2);
    let information = information.ok_or_else(|| unsettled.clone())?;
    let covariance = lens_covariance::lens_covariance(&information, variance_px2).ok_or(unsettled)?;
    let residuals: Vec<Vec<CornerResidual>> =
        used.iter().zip(&found.poses).map(|(view, pose)| compute_residuals(&found.camera, pose, view)).collect();
    let mut each = residuals.iter().map(|view| rms_px(view));
    let views = views.iter().zip(aside).map(|(view, aside)| match aside {
        Some((rms_px, reason)) => {
            ViewResult { name: view.name.clone(), rms_px: *rms_px, exclusion_reason: Some(reason.clone()) }
        }
        None => {
            ViewResult { name: view.name.clone(), rms_px: each.next().unwrap_or(f64::NAN), exclusion_reason: None }
        }
    });
    let size = (found.camera.width_px, found.camera.height_px);
    Ok(Calibrated {
        camera: found.camera,
        model: choice.model,
        trials: choice.trials,
        rms_px: (2.0 * found.square / found.rows).sqrt(),
        left_out_rms_px: (left_out_square / left_out.len() as f64).sqrt(),
        left_out_95_px: left_out[((left_out.len() as f64 * 0.95).ceil() as usize).clamp(1, left_out.len()) - 1],
        deviations: std::array::from_fn(|index| covariance[(index, index)].sqrt()),
        // In parts of the picture without corners a lens model is an extrapolation, whose polynomial may be off by
        // pixels.
        support: lens_support::compute_support(&found.camera, &covariance, &corners),
        covariance,
        views: views.collect(),
        coverage: coverage(size, used.iter().flat_map(|view| &view.corners)),
        tilt_deg: board_tilts(&found.poses),
        residuals: residuals.concat(),
        board_shape: board_shape::shape(choice.model, &found, &corners),
        information,
    })
}

fn compute_residuals(camera: &PinholeCamera, pose: &Rigid<Camera, Board>, view: &View) -> Vec<CornerResidual> {
    let residual = |&(q, at): &(Point<Board>, Pixel)| {
        let computed = camera.project(*pose * q)?;
        Some(CornerResidual { pixel: at, du_px: at.u - computed.u, dv_px: at.v - computed.v })
    };
    view.corners.iter().filter_map(residual).collect()
}

fn rms_px(residuals: &[CornerResidual]) -> f64 {
    let square: f64 = residuals.iter().map(|r| r.du_px.powi(2) + r.dv_px.powi(2)).sum();
    (square / residuals.len().max(1) as f64).sqrt()
}

/// Returns the worst picture and the limit that it exceeds.
fn worst_outlier(rms: &[f64]) -> Option<(usize, f64)> {
    let limit_px = (OUTLIER_FACTOR * median(&mut rms.to_vec())?).max(GOOD_PX);
    let (worst, largest) = rms.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (*largest > limit_px).then_some((worst, limit_px))
}

/// Returns the share of the picture's fields that contain a corner.
pub fn coverage<'c>(
    (width, height): (usize, usize),
    corners: impl IntoIterator<Item = &'c (Point<Board>, Pixel)>,
) -> f64 {
    let mut seen = vec![false; FIELDS.0 * FIELDS.1];
    for (_, pixel) in corners {
        if let Some((column, row)) = pixel.nearest_whole(width, height) {
            seen[row * FIELDS.1 / height * FIELDS.0 + column * FIELDS.0 / width] = true;
        }
    }
    seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64
}

/// Returns the tilts of the boards relative to the image plane: a board that is parallel to it carries no
/// information on the focal length, wherever it is.
fn board_tilts(poses: &[Rigid<Camera, Board>]) -> [f64; 2] {
    let tilt = |pose: &Rigid<Camera, Board>| (pose.rotation() * Vector3::z()).angle(&Vector3::z()).to_degrees();
    poses.iter().map(tilt).fold([f64::INFINITY, 0.0], |[low, high], tilt| [low.min(tilt), high.max(tilt)])
}
