//! Fits the lens of a given model to corners: least squares that never leaves the lenses which can be inverted.
//!
//! Levenberg–Marquardt minimises the reprojection error over lens and boards' poses, with the poses eliminated. A
//! lens folds at the radius at which its distorted radius stops growing. A step to a lens that folds anywhere in
//! the picture is never made, and the barrier
//!     − 2 μ Σ ln s(rᵢ),   s(r) = 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶ − least slope                                  (1)
//! over radii of the picture keeps the steps away from it. Prior knowledge of any camera is added: the principal
//! point lies near the picture's middle, and both focal lengths are nearly equal. μ is so small that all of this
//! counts only if the corners carry no information.

use super::adjust::scaled_inverse;
use super::arrangement::exp_map;
use super::detect::Corners;
use super::lens_gram::LensGram;
use super::lens_model::LensModel;
use nalgebra::{SVector, Vector6};
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Rigid};
use panelprep_cell::cell::LensCovariance;

/// A lens with the pose of each picture's board.
#[derive(Debug, Clone)]
pub(super) struct LensFit {
    pub camera: PinholeCamera,
    pub poses: Vec<Rigid<Camera, Board>>,
    /// Sum of squared residuals, px².
    pub square: f64,
    /// Number of residuals: two for each corner.
    pub rows: f64,
}

const MAX_STEPS: usize = 60;
/// μ of (1), px².
const BARRIER_PX2: f64 = 2.5e-3;
/// The iteration ends when the sum of squares decreases by a smaller share.
const CONVERGENCE_TOLERANCE: f64 = 1e-10;
/// The smallest derivative of the distorted radius with respect to the undistorted one.
const MIN_SLOPE: f64 = 0.05;
const RADII: usize = 12;
/// Usual standard deviation of the principal point from the middle, as a share of the picture's side.
const CENTRE_SHARE: f64 = 0.15;
/// Usual standard deviation of the ratio of both focal lengths from 1.
const RATIO: f64 = 0.02;

/// Fits a lens from a start value; `None` if the corners determine no lens.
pub(super) fn fit(model: LensModel, start: LensFit, views: &[&Corners]) -> Option<LensFit> {
    let mut here = State::new(restrict_to_model(model, &start.camera), start.poses, views)?;
    let mut damping = 1e-4;
    for _ in 0..MAX_STEPS {
        let Some((next, foretold)) = here.step(model, damping, views) else {
            damping *= 10.0;
            if damping > 1e12 {
                return None;
            }
            continue;
        };
        if next.cost <= here.cost {
            let settled = here.cost - next.cost <= CONVERGENCE_TOLERANCE * here.cost && damping <= 1.0;
            here = next;
            damping = (damping * 0.1).max(1e-12);
            if settled {
                return Some(here.into_fit());
            }
        } else if foretold <= CONVERGENCE_TOLERANCE * here.cost || damping > 1e12 {
            return Some(here.into_fit());
        } else {
            damping *= 10.0;
        }
    }
    Some(here.into_fit())
}

/// Returns the pose of one more picture under this lens, from a start, and its sum of squared residuals.
pub(super) fn estimate_pose(
    camera: &PinholeCamera,
    corners: &Corners,
    start: Rigid<Camera, Board>,
) -> Option<(Rigid<Camera, Board>, f64)> {
    let mut pose = start;
    let mut gram = LensGram::compute(camera, corners, &pose)?;
    for _ in 0..MAX_STEPS {
        let step = scaled_inverse(&gram.pose)? * gram.pose_pull;
        let next = perturb_pose(&pose, &step);
        let there = LensGram::compute(camera, corners, &next)?;
        if there.square > gram.square * (1.0 - CONVERGENCE_TOLERANCE) {
            break;
        }
        (pose, gram) = (next, there);
    }
    Some((pose, gram.square))
}

/// Returns the lens with only the model's coefficients.
fn restrict_to_model(model: LensModel, camera: &PinholeCamera) -> PinholeCamera {
    let all = numbers(camera);
    let kept = camera_from_parameters(
        camera,
        &SVector::from_fn(|row, _| if model.contains_parameter(row) { all[row] } else { 0.0 }),
    );
    if undistorted_radius(&kept).is_some() {
        return kept;
    }
    PinholeCamera { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, ..*camera }
}

/// Returns fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub(super) fn numbers(camera: &PinholeCamera) -> SVector<f64, 9> {
    let c = camera;
    SVector::from([c.fx_px, c.fy_px, c.cx_px, c.cy_px, c.k1, c.k2, c.p1, c.p2, c.k3])
}

fn camera_from_parameters(camera: &PinholeCamera, n: &SVector<f64, 9>) -> PinholeCamera {
    let PinholeCamera { width_px, height_px, .. } = *camera;
    let (fx_px, fy_px, cx_px, cy_px) = (n[0], n[1], n[2], n[3]);
    PinholeCamera {
        width_px,
        height_px,
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        k1: n[4],
        k2: n[5],
        p1: n[6],
        p2: n[7],
        k3: n[8],
    }
}

/// Returns the largest undistorted radius of the picture; `None` if the lens folds before the picture's farthest
/// corner.
pub(super) fn undistorted_radius(camera: &PinholeCamera) -> Option<f64> {
    if !(camera.fx_px > 1.0 && camera.fy_px > 1.0) {
        return None;
    }
    camera.max_undistorted_radius(MIN_SLOPE)
}

fn perturb_pose(pose: &Rigid<Camera, Board>, step: &Vector6<f64>) -> Rigid<Camera, Board> {
    Rigid::from_isometry_unchecked(pose.isometry() * exp_map(step))
}

struct State {
    camera: PinholeCamera,
    poses: Vec<Rigid<Camera, Board>>,
    grams: Vec<LensGram>,
    radius: f64,
    cost: f64,
}

impl State {
    /// Returns `None` if the lens folds or a corner lies behind the camera.
    fn new(camera: PinholeCamera, poses: Vec<Rigid<Camera, Board>>, views: &[&Corners]) -> Option<Self> {
        let radius = undistorted_radius(&camera)?;
        let grams: Vec<LensGram> = views
            .iter()
            .zip(&poses)
            .map(|(corners, pose)| LensGram::compute(&camera, corners, pose))
            .collect::<Option<_>>()?;
        let square: f64 = grams.iter().map(|gram| gram.square).sum();
        let barrier: f64 = radial_barrier(&camera, radius).map(|(slope, _)| slope.ln()).sum();
        let usual: f64 = prior_residuals(&camera).map(|(off, _)| off * off).iter().sum();
        let cost = square + BARRIER_PX2 * (usual - 2.0 * barrier);
        cost.is_finite().then_some(State { camera, poses, grams, radius, cost })
    }

    /// Returns the state after a step, and the predicted decrease of the cost.
    fn step(&self, model: LensModel, damping: f64, views: &[&Corners]) -> Option<(State, f64)> {
        let (mut normal, mut pull) = (LensCovariance::zeros(), SVector::<f64, 9>::zeros());
        let mut poses = Vec::with_capacity(self.grams.len());
        for gram in &self.grams {
            let mut pose = gram.pose;
            (0..6).for_each(|at| pose[(at, at)] *= 1.0 + damping);
            let inverse = scaled_inverse(&pose)?;
            normal += gram.lens - gram.lens_pose_cross * inverse * gram.lens_pose_cross.transpose();
            pull += gram.lens_pull - gram.lens_pose_cross * inverse * gram.pose_pull;
            poses.push(inverse);
        }
        for (slope, by_lens) in radial_barrier(&self.camera, self.radius) {
            normal += by_lens * by_lens.transpose() * (BARRIER_PX2 / (slope * slope));
            pull += by_lens * (BARRIER_PX2 / slope);
        }
        for (off, by_lens) in prior_residuals(&self.camera) {
            normal += by_lens * by_lens.transpose() * BARRIER_PX2;
            pull -= by_lens * (BARRIER_PX2 * off);
        }
        for at in 0..9 {
            if model.contains_parameter(at) {
                normal[(at, at)] *= 1.0 + damping;
            } else {
                normal.row_mut(at).fill(0.0);
                normal.column_mut(at).fill(0.0);
                normal[(at, at)] = 1.0;
                pull[at] = 0.0;
            }
        }
        let lens = scaled_inverse(&normal)? * pull;
        let camera = camera_from_parameters(&self.camera, &(numbers(&self.camera) + lens));
        let next = self.poses.iter().zip(&self.grams).zip(&poses).map(|((pose, gram), inverse)| {
            perturb_pose(pose, &(inverse * (gram.pose_pull - gram.lens_pose_cross.transpose() * lens)))
        });
        Some((State::new(camera, next.collect(), views)?, lens.dot(&pull)))
    }

    fn into_fit(self) -> LensFit {
        let square = self.grams.iter().map(|gram| gram.square).sum();
        let rows = self.grams.iter().map(|gram| gram.rows).sum();
        LensFit { camera: self.camera, poses: self.poses, square, rows }
    }
}

/// Returns how far the principal point and the ratio of the focal lengths are from the usual values, in standard
/// deviations, and the derivatives with respect to the lens.
pub(super) fn prior_residuals(camera: &PinholeCamera) -> [(f64, SVector<f64, 9>); 3] {
    let [across, down] = [camera.width_px, camera.height_px].map(|size| size as f64);
    let by = |places: &[(usize, f64)]| {
        let mut slope = SVector::<f64, 9>::zeros();
        places.iter().for_each(|(place, value)| slope[*place] = *value);
        slope
    };
    let (u, v) = (CENTRE_SHARE * across, CENTRE_SHARE * down);
    let ratio = by(&[(0, 1.0 / (RATIO * camera.fx_px)), (1, -1.0 / (RATIO * camera.fy_px))]);
    [
        ((camera.cx_px - across / 2.0) / u, by(&[(2, 1.0 / u)])),
        ((camera.cy_px - down / 2.0) / v, by(&[(3, 1.0 / v)])),
        ((camera.fx_px / camera.fy_px).ln() / RATIO, ratio),
    ]
}

/// Returns s of (1) at each radius, and its derivative with respect to the lens.
fn radial_barrier(camera: &PinholeCamera, radius: f64) -> impl Iterator<Item = (f64, SVector<f64, 9>)> {
    let PinholeCamera { k1, k2, k3, .. } = *camera;
    (1..=RADII).map(move |index| {
        let r2 = (radius * index as f64 / RADII as f64).powi(2);
        let by = [3.0 * r2, 5.0 * r2 * r2, 7.0 * r2.powi(3)];
        let slope = 1.0 + k1 * by[0] + k2 * by[1] + k3 * by[2] - 0.9 * MIN_SLOPE;
        (slope, SVector::from([0.0, 0.0, 0.0, 0.0, by[0], by[1], 0.0, 0.0, by[2]]))
    })
}
