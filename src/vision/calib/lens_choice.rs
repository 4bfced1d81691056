//! Selects the lens model that the data support: each model is fitted without some of the pictures and judged by its
//! prediction of these pictures.
//!
//! A coefficient that the data do not support follows the noise and does not improve the prediction of left-out
//! pictures. The simplest model that passes a test is selected: its left-out pictures are not worse than the best
//! model's by more than the scatter of that comparison from picture to picture (the one-standard-error rule, Breiman
//! et al. 1984).

use super::detect::Corners;
use super::lens_fit::{self, LensFit};
use super::lens_model::LensModel;
use rayon::prelude::*;

/// Prediction error of one lens model on the left-out pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelTrial {
    /// The model.
    pub model: LensModel,
    /// Root mean square distance of corners in left-out pictures, px; `None` if no such lens could be fitted.
    pub left_out_rms_px: Option<f64>,
    /// The relative increase of the mean square over that of the best model, as the mean over the pictures.
    pub relative_increase: f64,
    /// The standard error of `worse`.
    pub worse_error: f64,
}

/// A left-out picture: the distances of its corners under the lens of the other pictures, px.
type LeftOutDistances = Vec<f64>;

/// The judged models.
pub(super) struct ModelChoice {
    pub model: LensModel,
    pub trials: Vec<ModelTrial>,
    /// The distances in each picture when it was left out, under the chosen model.
    pub left_out_distances: Vec<LeftOutDistances>,
}

/// The number of groups in which pictures are left out.
const GROUPS: usize = 5;

/// Chooses among fits of all pictures, one for each model.
pub(super) fn choose(fits: &[(LensModel, Option<LensFit>)], views: &[&Corners]) -> Option<ModelChoice> {
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
    let best = all.iter().flatten().min_by(|a, b| square(a).total_cmp(&square(b)))?.clone();
    let trials: Vec<ModelTrial> =
        fits.iter().zip(&all).map(|((model, _), all)| trial(*model, all.as_ref(), &best)).collect();
    let chosen =
        // The first within one standard error of the best: more coefficients than the pictures prove only add
        // uncertainty at the border.
        trials.iter().position(|trial| trial.left_out_rms_px.is_some() && trial.relative_increase <= trial.worse_error)?;
    Some(ModelChoice { model: trials[chosen].model, left_out_distances: all[chosen].clone()?, trials })
}

fn square(pictures: &[LeftOutDistances]) -> f64 {
    pictures.iter().flatten().map(|px| px * px).sum()
}

fn mean_square(picture: &LeftOutDistances) -> f64 {
    picture.iter().map(|px| px * px).sum::<f64>() / picture.len().max(1) as f64
}

fn trial(model: LensModel, pictures: Option<&Vec<LeftOutDistances>>, best: &[LeftOutDistances]) -> ModelTrial {
    let Some(pictures) = pictures else {
        return ModelTrial { model, left_out_rms_px: None, relative_increase: f64::INFINITY, worse_error: 0.0 };
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
    let left_out_rms_px = Some((square(pictures) / corners.max(1) as f64).sqrt());
    ModelTrial { model, left_out_rms_px, relative_increase: worse, worse_error: (spread / count).sqrt() }
}

/// Returns the pictures of one group under the lens of all other groups.
fn leave_group_out(
    model: LensModel,
    found: &LensFit,
    views: &[&Corners],
    (group, groups): (usize, usize),
) -> Option<Vec<(usize, LeftOutDistances)>> {
    // Every fifth picture and not runs: neighbours in a series show nearly the same view and would predict each other.
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
