//! Intrinsics from pictures of a board (thesis 3.6), with their uncertainty.
//!
//! `lens_fit` minimises the reprojection error of all corners over the camera and the board poses, among lenses that
//! can be inverted over the whole picture. A picture whose corners have far larger residuals than those of the other
//! pictures (blurred, bent board, wrong corners) is excluded with the reason, and the rest is calibrated again.
//! [`choose`] selects how many distortion coefficients the pictures support, and [`fit_board_shape`] tests whether the
//! board is flat. The coverage of the picture and the tilts of the board show what the pictures can determine: without
//! tilt, focal length and distance cannot be distinguished; without corners near the rim, distortion is extrapolated.
//!
//! Each lens model is fitted without some of the pictures and judged by its prediction of these left-out pictures
//! (cross-validation). A coefficient that the data do not support follows the noise and does not improve the
//! prediction. The simplest model is selected whose prediction error is not larger than that of the best model by more
//! than the scatter of this difference from picture to picture (the one-standard-error rule, Breiman et al. 1984).
//!
//! A bent board, or a board with unequal squares, leaves residuals that are the same at each of its corners in all
//! pictures, and that no lens and no pose absorbs. The position of each corner on the board gets an offset δⱼ, as in
//! OpenCV's `calibrateCameraRO`. Lens and poses are adjusted in turn with the offsets. For fixed lens and poses each
//! offset is
//!     δⱼ = (Σᵢ JᵢⱼᵀJᵢⱼ)⁻¹ Σᵢ Jᵢⱼᵀ rᵢⱼ,                                                                           (1)
//! with J the derivative of the pixel with respect to the position of the corner. The part of the offsets that is a
//! motion or another scale of the whole board belongs to the poses, and is removed from the stated offsets.

use super::board::Board as BoardPattern;
use super::detect::Corners;
use super::error::CalibError;
pub use super::lens_fit::LensModel;
use super::lens_fit::{LensFit, LensGram};
pub use super::lens_support::{LensSupport, NextPicture};
use super::{foreign, lens_fit, lens_support};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use panelprep_base::geometry::statistics::mean;
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Pixel, Point, Rigid, median};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::cell::{LensCovariance, LensExtent, SupportedArea};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A picture with its corners.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name of the picture in messages.
    pub name: String,
    /// The corners that the picture shows.
    pub corners: Corners,
}

/// The result of the calibration for one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewResult {
    /// Name of the picture.
    pub name: String,
    /// Root mean square distance of the picture's corners from the camera model, px.
    pub rms_px: f64,
    /// The reason why the picture was excluded; `None` if it was used.
    pub exclusion_reason: Option<String>,
}

/// A corner with its residual in the camera model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerResidual {
    /// The pixel at which the corner was found.
    pub pixel: Pixel,
    /// Found minus computed pixel, u, px.
    pub du_px: f64,
    /// Found minus computed pixel, v, px.
    pub dv_px: f64,
}

/// A calibrated camera with its evidence.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The camera; coefficients that the model does not contain are 0.
    pub camera: PinholeCamera,
    /// The lens model: it states which coefficients the lens has.
    pub model: LensModel,
    /// Prediction error of each model on left-out pictures, the simplest model first.
    pub trials: Vec<ModelTrial>,
    /// Root mean square distance of all used corners, px.
    pub rms_px: f64,
    /// Root mean square distance of the corners in left-out pictures, px.
    pub left_out_rms_px: f64,
    /// Distance within which 95 % of the corners in left-out pictures are, px.
    pub left_out_95_px: f64,
    /// Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3.
    pub deviations: [f64; 9],
    /// Covariance of the lens parameters fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub covariance: LensCovariance,
    /// The part of the picture in which the lens is calibrated.
    pub support: LensSupport,
    /// The pictures, in the order of the input.
    pub views: Vec<ViewResult>,
    /// Fraction of the picture's 8 × 6 fields that contain a corner.
    pub coverage: f64,
    /// Minimum and maximum tilt of the board relative to the image plane, degrees.
    pub tilt_deg: [f64; 2],
    /// The residual of every used corner.
    pub residuals: Vec<CornerResidual>,
    /// The shape of the board, if it explains the residuals: the board is bent, or its squares are not equal.
    pub board_shape: Option<BoardShape>,
    /// The information of corners and prior about the lens.
    information: LensCovariance,
}

impl Calibrated {
    /// Returns for each coefficient outside of the model why it was left out.
    pub fn exclusion_reasons(&self) -> Vec<String> {
        if self.trials.len() == 1 {
            return self
                .model
                .excluded_coefficients()
                .iter()
                .map(|name| format!("{name}: not part of the lens model of --model"))
                .collect();
        }
        let own =
            self.trials.iter().find(|trial| trial.model == self.model).and_then(|trial| trial.left_out_rms_px);
        let reason = |model: &LensModel| {
            let trial = self.trials.iter().find(|trial| trial.model == *model)?;
            let new: Vec<&str> = model.added();
            Some(match (trial.left_out_rms_px, own) {
                (Some(with), Some(without)) => format!(
                    "{}: error in left-out pictures {with:.4} px rms if included, {without:.4} px rms if not",
                    new.join(", ")
                ),
                _ => format!("{}: if included, no lens fits the subsets of the pictures", new.join(", ")),
            })
        };
        LensModel::ALL.iter().filter(|model| **model > self.model).filter_map(reason).collect()
    }

    /// Returns the area of the picture in which the lens is known, as its calibration file states it.
    pub fn lens_extent(&self) -> LensExtent {
        let supported = self
            .support
            .outline_px
            .as_ref()
            .map(|outline_px| SupportedArea { error_px: self.support.error_px, outline_px: outline_px.clone() });
        LensExtent {
            model: Some(self.model.name().to_owned()),
            excluded_coefficients: self.exclusion_reasons(),
            supported,
        }
    }

    /// Returns the picture of this board that would improve the lens most; `None` if no picture improves it much.
    pub fn next_picture(&self, board: &BoardPattern) -> Option<NextPicture> {
        lens_support::best_next_picture(&self.camera, board, &self.information)
    }
}

/// Options of the calibration.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Whether no picture may be excluded.
    pub keep_all_pictures: bool,
    /// The lens model; `None` to select it from the data.
    pub model: Option<LensModel>,
}

/// Minimum number of pictures that determine a camera.
pub const MIN_VIEWS: usize = 4;
/// Maximum residual of a used picture, as a multiple of the median.
const MIN_OUTLIER_RATIO: f64 = 2.5;
/// Maximum residual of a picture that is good independently of the others, px.
const MAX_GOOD_RMS_PX: f64 = 0.15;
/// Maximum fraction of the pictures that are excluded.
const MAX_EXCLUDED_FRACTION: f64 = 0.34;
const COVERAGE_FIELDS: (usize, usize) = (8, 6);

/// Calibrates the intrinsics of a camera from pictures of a board.
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
        // A model of medium size: with a simpler one, pictures with corners near the border would appear wrong; a
        // larger one would fit the errors of bad pictures.
        let first = fit_lens(size, &used, options.model.unwrap_or(LensModel::Tangential))?;
        let rms = rms_per_picture(&first, &used);
        let set_aside = aside.iter().flatten().count() + 1;
        let allowed = !options.keep_all_pictures && set_aside as f64 <= MAX_EXCLUDED_FRACTION * views.len() as f64;
        // One picture at a time is excluded, then the lens is fitted again: a bad picture changes the lens, so that
        // good pictures appear worse than they are.
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
    lens_fit::fit(model, start, &used_corners(used))
        .ok_or(CalibError::NotSettled { what: "the adjustment of the lens" })
}

fn rms_per_picture(fit: &LensFit, used: &[&View]) -> Vec<f64> {
    let rms = |(view, pose): (&&View, &Rigid<Camera, Board>)| rms_px(&compute_residuals(&fit.camera, pose, view));
    used.iter().zip(&fit.poses).map(rms).collect()
}

/// Selects the lens model and computes its evidence.
fn choose_model(
    first: LensFit,
    used: &[&View],
    model: Option<LensModel>,
    (views, aside): (&[View], &[Option<(f64, String)>]),
) -> Result<Calibrated, CalibError> {
    let unsettled = CalibError::NotSettled { what: "the adjustment of the lens" };
    let corners = used_corners(used);
    let models = model.map_or_else(|| LensModel::ALL.to_vec(), |model| vec![model]);
    let mut start = first;
    let mut fits = Vec::new();
    for model in models {
        let fit = lens_fit::fit(model, start.clone(), &corners);
        start = fit.clone().unwrap_or(start);
        fits.push((model, fit));
    }
    let choice = choose(&fits, &corners).ok_or_else(|| unsettled.clone())?;
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
    // The larger of two estimates: if corners deviate in the same way in each picture, the residuals of the fit hardly
    // show this.
    let variance_px2 = (found.square / redundancy).max(left_out_square / (found.rows - poses));
    let information = lens_fit::information(&found.camera, &grams, variance_px2);
    let information = information.ok_or_else(|| unsettled.clone())?;
    let covariance = lens_fit::lens_covariance(&information, variance_px2).ok_or(unsettled)?;
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
        // In parts of the picture without corners a lens model extrapolates, and its polynomial may be wrong by several
        // pixels.
        support: lens_support::compute_support(&found.camera, &covariance, &corners),
        covariance,
        views: views.collect(),
        coverage: coverage(size, used.iter().flat_map(|view| &view.corners)),
        tilt_deg: board_tilts(&found.poses),
        residuals: residuals.concat(),
        board_shape: fit_board_shape(choice.model, &found, &corners),
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
    mean(residuals.iter().map(|r| r.du_px.powi(2) + r.dv_px.powi(2))).map_or(0.0, f64::sqrt)
}

/// Returns the index of the worst picture and the limit that its residual exceeds.
fn worst_outlier(rms: &[f64]) -> Option<(usize, f64)> {
    let limit_px = (MIN_OUTLIER_RATIO * median(&mut rms.to_vec())?).max(MAX_GOOD_RMS_PX);
    let (worst, largest) = rms.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (*largest > limit_px).then_some((worst, limit_px))
}

/// Returns the fraction of the picture's fields that contain a corner.
pub fn coverage<'c>(
    (width, height): (usize, usize),
    corners: impl IntoIterator<Item = &'c (Point<Board>, Pixel)>,
) -> f64 {
    let mut seen = vec![false; COVERAGE_FIELDS.0 * COVERAGE_FIELDS.1];
    for (_, pixel) in corners {
        if let Some((column, row)) = pixel.nearest_whole(width, height) {
            seen[row * COVERAGE_FIELDS.1 / height * COVERAGE_FIELDS.0 + column * COVERAGE_FIELDS.0 / width] = true;
        }
    }
    seen.iter().filter(|seen| **seen).count() as f64 / seen.len() as f64
}

/// Returns the tilts of the boards relative to the image plane: a board that is parallel to this plane gives no
/// information on the focal length, at any position.
fn board_tilts(poses: &[Rigid<Camera, Board>]) -> [f64; 2] {
    let tilt = |pose: &Rigid<Camera, Board>| (pose.rotation() * Vector3::z()).angle(&Vector3::z()).to_degrees();
    poses.iter().map(tilt).fold([f64::INFINITY, 0.0], |[low, high], tilt| [low.min(tilt), high.max(tilt)])
}

/// Prediction error of one lens model on the left-out pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelTrial {
    /// The lens model.
    pub model: LensModel,
    /// Root mean square distance of corners in left-out pictures, px; `None` if the model could not be fitted.
    pub left_out_rms_px: Option<f64>,
    /// Relative increase of the mean square over that of the best model, as the mean over the pictures.
    pub relative_increase: f64,
    /// Standard error of `relative_increase`.
    pub increase_error: f64,
}

/// The distances of the corners of a left-out picture from the lens that was fitted to the other pictures, px.
type LeftOutDistances = Vec<f64>;

/// The selected model, with the trials of all models.
struct ModelChoice {
    pub model: LensModel,
    pub trials: Vec<ModelTrial>,
    /// For the selected model, the distances in each picture when it was left out.
    pub left_out_distances: Vec<LeftOutDistances>,
}

/// Number of groups for the cross-validation; one group at a time is left out.
const GROUPS: usize = 5;

/// Selects a model; `fits` contains the fit of each model to all pictures.
fn choose(fits: &[(LensModel, Option<LensFit>)], views: &[&Corners]) -> Option<ModelChoice> {
    let groups = GROUPS.min(views.len());
    let tasks: Vec<(usize, usize)> = (0..fits.len()).flat_map(|fit| (0..groups).map(move |g| (fit, g))).collect();
    let parts: Vec<Option<Vec<(usize, LeftOutDistances)>>> = tasks
        .par_iter()
        .map(|&(fit, group)| {
            let (model, found) = &fits[fit];
            leave_group_out(*model, found.as_ref()?, views, (group, groups))
        })
        .collect();
    let all: Vec<Option<Vec<LeftOutDistances>>> = parts
        .chunks(groups)
        .map(|parts| {
            let parts: Vec<_> = parts.iter().cloned().collect::<Option<_>>()?;
            let mut pictures: Vec<(usize, LeftOutDistances)> = parts.concat();
            pictures.sort_by_key(|(index, _)| *index);
            Some(pictures.into_iter().map(|(_, left_out)| left_out).collect())
        })
        .collect();
    let best = all.iter().flatten().min_by(|a, b| sum_of_squares(a).total_cmp(&sum_of_squares(b)))?.clone();
    let trials: Vec<ModelTrial> =
        fits.iter().zip(&all).map(|((model, _), all)| trial(*model, all.as_ref(), &best)).collect();
    let chosen =
        // The simplest model within one standard error of the best: coefficients that the pictures do not support only
        // add uncertainty at the border.
        trials.iter().position(|trial| {
            trial.left_out_rms_px.is_some() && trial.relative_increase <= trial.increase_error
        })?;
    Some(ModelChoice { model: trials[chosen].model, left_out_distances: all[chosen].clone()?, trials })
}

fn sum_of_squares(pictures: &[LeftOutDistances]) -> f64 {
    pictures.iter().flatten().map(|px| px * px).sum()
}

fn mean_square(picture: &LeftOutDistances) -> f64 {
    mean(picture.iter().map(|px| px * px)).unwrap_or(0.0)
}

fn trial(model: LensModel, pictures: Option<&Vec<LeftOutDistances>>, best: &[LeftOutDistances]) -> ModelTrial {
    let Some(pictures) = pictures else {
        return ModelTrial { model, left_out_rms_px: None, relative_increase: f64::INFINITY, increase_error: 0.0 };
    };
    let count = pictures.len() as f64;
    let shares: Vec<f64> = pictures
        .iter()
        .zip(best)
        .map(|(own, best)| mean_square(own) / mean_square(best).max(1e-12) - 1.0)
        .collect();
    let worse = shares.iter().sum::<f64>() / count;
    let spread = shares.iter().map(|share| (share - worse).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let corners: usize = pictures.iter().map(Vec::len).sum();
    let left_out_rms_px = Some((sum_of_squares(pictures) / corners.max(1) as f64).sqrt());
    ModelTrial { model, left_out_rms_px, relative_increase: worse, increase_error: (spread / count).sqrt() }
}

/// Returns the distances in the pictures of one group, for the lens that was fitted to all other groups.
fn leave_group_out(
    model: LensModel,
    found: &LensFit,
    views: &[&Corners],
    (group, groups): (usize, usize),
) -> Option<Vec<(usize, LeftOutDistances)>> {
    // A group contains every fifth picture, not consecutive ones: neighbouring pictures of a series show nearly the
    // same view and would predict each other.
    let is_left_out = |index: usize| index % groups == group;
    let kept: Vec<usize> = (0..views.len()).filter(|index| !is_left_out(*index)).collect();
    let poses = kept.iter().map(|index| found.poses[*index]).collect();
    let start = LensFit { camera: found.camera, poses, square: 0.0, rows: 0.0 };
    let corners: Vec<&Corners> = kept.iter().map(|index| views[*index]).collect();
    let fitted = lens_fit::fit(model, start, &corners)?;
    let left_out = |index: usize| {
        let (pose, _) = lens_fit::estimate_pose(&fitted.camera, views[index], found.poses[index])?;
        let distance = |&(q, seen): &(_, panelprep_base::geometry::Pixel)| {
            Some(fitted.camera.project(pose * q)?.distance_px(seen))
        };
        Some((index, views[index].iter().map(distance).collect::<Option<LeftOutDistances>>()?))
    };
    (0..views.len()).filter(|index| is_left_out(*index)).map(left_out).collect()
}

/// Number of iterations in which lens and board shape are adjusted in turn.
const SHAPE_ITERATIONS: usize = 6;
/// Minimum number of pictures that distinguish the shape of a board from noise.
const MIN_SHAPE_VIEWS: usize = 6;
/// Minimum number of pictures that show a corner, for its position to be an unknown.
const MIN_VIEWS_PER_CORNER: usize = 4;
/// Maximum rms distance of the corners of a flat board from a plane, px.
const MAX_FLAT_BOARD_RMS_PX: f64 = 0.08;
/// Maximum ratio of the corner residuals with the fitted board shape to those with a flat board, for the board to be
/// reported as not flat.
const MAX_SHAPE_ERROR_RATIO: f64 = 0.8;

/// The shape of a board that is not flat, or has unequal squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardShape {
    /// Root mean square distance of the corners from those of a flat board, px, calculated with the redundancy of the
    /// fit.
    pub flat_px: f64,
    /// Root mean square distance of the corners with the fitted board shape, px.
    pub fitted_rms_px: f64,
    /// Bow of the board, from its lowest to its highest corner, mm.
    pub bow_mm: f64,
    /// Maximum distance of a corner from its nominal position in the plane, mm.
    pub max_in_plane_shift_mm: f64,
}

/// Returns the position of a corner as a key, in thousandths of a millimetre.
fn key(q: &Point<Board>) -> [i64; 2] {
    [q.mm.x, q.mm.y].map(|mm| (mm * 1e3).round() as i64)
}

/// Returns the shape of the board if it explains the residuals; `None` for a flat board, or if the pictures do not
/// determine the shape.
fn fit_board_shape(model: LensModel, flat: &LensFit, corners: &[&Corners]) -> Option<BoardShape> {
    let rms = |square: f64, free: f64| (2.0 * square / free).sqrt();
    let own = model.count() as f64 + 6.0 * corners.len() as f64;
    let flat_px = rms(flat.square, flat.rows - own);
    if corners.len() < MIN_SHAPE_VIEWS || flat_px.is_nan() || flat_px < MAX_FLAT_BOARD_RMS_PX {
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
    (own_px <= MAX_SHAPE_ERROR_RATIO * flat_px).then_some(BoardShape {
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

/// Solves (1), and adds the result to the present offsets.
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

/// Returns the bow and the maximum shift in the plane, mm, after the motion and the scale of the whole board are
/// removed.
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
