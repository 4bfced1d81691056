//! Fits the lens of a given model to corners by least squares, so that the lens can be inverted after every step. The
//! module also states how accurately the pictures determine the lens.
//!
//! A model contains none, some or all of the five distortion coefficients.
//!
//! Levenberg–Marquardt minimises the reprojection error over lens and board poses, with the poses eliminated. A lens
//! folds at the radius at which its distorted radius stops growing. A step to a lens that folds anywhere in the picture
//! is never made, and the barrier
//!     − 2 μ Σ ln s(rᵢ),   s(r) = 1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶ − 0.9 · least slope                            (1)
//! over radii of the picture keeps the steps away from it. Prior knowledge of any camera is added: the principal point
//! is near the centre of the picture, and both focal lengths are nearly equal. μ is so small that barrier and prior
//! have an effect only if the corners contain no information.
//!
//! The board poses are also eliminated from the covariance of the nine lens parameters. With J the derivatives of all
//! corners with respect to the lens and Jᵢ those with respect to the pose of picture i,
//!     C = σ² (Σ Jᵀ J − Σ Jᵀ Jᵢ (Jᵢᵀ Jᵢ)⁻¹ Jᵢᵀ J + σ² D)⁻¹.                                                      (2)
//! A mount needs the whole of C, since principal point, tangential distortion and focal length are far from
//! independent. D is the prior knowledge of any lens: no coefficient moves the rim of the picture by more than a stated
//! fraction of its radius, the principal point is near the centre of the picture, and the focal lengths are nearly
//! equal. This knowledge has an effect only if the pictures contain no information. All five coefficients are in (2)
//! with every model, since an omitted coefficient is not known to be zero. If the variance of the left-out pictures is
//! larger than that of the fit, σ² is the larger one. OpenCV states only the square roots of the diagonal of C. These
//! are too large by a factor of √2 or a little more: OpenCV's σ² divides by the number of corners, although each corner
//! has two rows.

use super::adjust::scaled_inverse;
use super::chain::exp_map;
use super::detect::Corners;
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Rigid};
use panelprep_cell::cell::LensCovariance;
use strum::{IntoStaticStr, VariantArray};

/// A lens model; each model contains the coefficients of the models before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, IntoStaticStr, VariantArray)]
pub enum LensModel {
    /// A pinhole camera without distortion.
    #[strum(serialize = "pinhole")]
    Pinhole,
    /// Distortion with the coefficient k1.
    #[strum(serialize = "k1")]
    Radial1,
    /// Distortion with the coefficients k1, k2.
    #[strum(serialize = "k1k2")]
    Radial2,
    /// Distortion with the coefficients k1, k2, p1, p2.
    #[strum(serialize = "k1k2p1p2")]
    Tangential,
    /// Distortion with the coefficients k1, k2, p1, p2, k3.
    #[strum(serialize = "k1k2p1p2k3")]
    Full,
}

/// The index of each coefficient among fx, fy, cx, cy, k1, k2, p1, p2, k3.
const COEFFICIENTS: [(&str, usize, LensModel); 5] = [
    ("k1", 4, LensModel::Radial1),
    ("k2", 5, LensModel::Radial2),
    ("p1", 6, LensModel::Tangential),
    ("p2", 7, LensModel::Tangential),
    ("k3", 8, LensModel::Full),
];

impl LensModel {
    /// All models, the simplest first.
    pub const ALL: &'static [LensModel] = <Self as VariantArray>::VARIANTS;

    /// Returns the name of the model on the command line and in files.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns whether the model contains the parameter at this index among fx, fy, cx, cy, k1, k2, p1, p2, k3.
    pub fn contains_parameter(self, place: usize) -> bool {
        COEFFICIENTS.iter().find(|(_, at, _)| *at == place).is_none_or(|(_, _, model)| *model <= self)
    }

    /// Returns the number of parameters of the model, including focal lengths and principal point.
    pub fn count(self) -> usize {
        (0..9).filter(|place| self.contains_parameter(*place)).count()
    }

    /// Returns the coefficients that this model contains and the previous model does not.
    pub fn added(self) -> Vec<&'static str> {
        COEFFICIENTS.iter().filter(|(_, _, model)| *model == self).map(|(name, ..)| *name).collect()
    }

    /// Returns the coefficients that the model does not contain.
    pub fn excluded_coefficients(self) -> Vec<&'static str> {
        COEFFICIENTS.iter().filter(|(_, _, model)| *model > self).map(|(name, ..)| *name).collect()
    }
}

/// A lens with the pose of the board in each picture.
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
/// Maximum relative decrease of the sum of squares in the last step, at which the iteration ends.
const CONVERGENCE_TOLERANCE: f64 = 1e-10;
/// Minimum derivative of the distorted radius with respect to the undistorted one.
const MIN_SLOPE: f64 = 0.05;
const BARRIER_RADIUS_COUNT: usize = 12;
/// Usual standard deviation of the principal point from the centre, as a fraction of the picture's side.
const RELATIVE_CENTRE_PRIOR_STD: f64 = 0.15;
/// Prior standard deviation of the ratio of both focal lengths, whose expected value is 1.
const FOCAL_RATIO_PRIOR: f64 = 0.02;

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

/// Returns the pose of the board in another picture for this lens, from a start pose, and its sum of squared residuals.
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

/// Returns the lens with only the coefficients of the model.
fn restrict_to_model(model: LensModel, camera: &PinholeCamera) -> PinholeCamera {
    let all = lens_parameters(camera);
    let kept = camera_from_parameters(
        camera,
        &SVector::from_fn(|row, _| if model.contains_parameter(row) { all[row] } else { 0.0 }),
    );
    if undistorted_radius(&kept).is_some() {
        return kept;
    }
    PinholeCamera { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, ..*camera }
}

/// Returns the lens parameters fx, fy, cx, cy, k1, k2, p1, p2, k3.
fn lens_parameters(camera: &PinholeCamera) -> SVector<f64, 9> {
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

/// Returns the maximum undistorted radius in the picture; `None` if the lens folds within the picture.
fn undistorted_radius(camera: &PinholeCamera) -> Option<f64> {
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
    /// Creates the state of this lens and these poses; `None` if the lens folds or a corner is behind the camera.
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
        let camera = camera_from_parameters(&self.camera, &(lens_parameters(&self.camera) + lens));
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

/// Returns the differences of the principal point and of the ratio of the focal lengths from the usual values, in
/// standard deviations, and their derivatives with respect to the lens.
fn prior_residuals(camera: &PinholeCamera) -> [(f64, SVector<f64, 9>); 3] {
    let [across, down] = [camera.width_px, camera.height_px].map(|size| size as f64);
    let by = |places: &[(usize, f64)]| {
        let mut slope = SVector::<f64, 9>::zeros();
        places.iter().for_each(|(place, value)| slope[*place] = *value);
        slope
    };
    let (u, v) = (RELATIVE_CENTRE_PRIOR_STD * across, RELATIVE_CENTRE_PRIOR_STD * down);
    let ratio =
        by(&[(0, 1.0 / (FOCAL_RATIO_PRIOR * camera.fx_px)), (1, -1.0 / (FOCAL_RATIO_PRIOR * camera.fy_px))]);
    [
        ((camera.cx_px - across / 2.0) / u, by(&[(2, 1.0 / u)])),
        ((camera.cy_px - down / 2.0) / v, by(&[(3, 1.0 / v)])),
        ((camera.fx_px / camera.fy_px).ln() / FOCAL_RATIO_PRIOR, ratio),
    ]
}

/// Returns s of (1) at each radius, and its derivative with respect to the lens.
fn radial_barrier(camera: &PinholeCamera, radius: f64) -> impl Iterator<Item = (f64, SVector<f64, 9>)> {
    let PinholeCamera { k1, k2, k3, .. } = *camera;
    (1..=BARRIER_RADIUS_COUNT).map(move |index| {
        let r2 = (radius * index as f64 / BARRIER_RADIUS_COUNT as f64).powi(2);
        let by = [3.0 * r2, 5.0 * r2 * r2, 7.0 * r2.powi(3)];
        let slope = 1.0 + k1 * by[0] + k2 * by[1] + k3 * by[2] - 0.9 * MIN_SLOPE;
        (slope, SVector::from([0.0, 0.0, 0.0, 0.0, by[0], by[1], 0.0, 0.0, by[2]]))
    })
}

/// The products of the derivatives of a picture's corners. The pose is perturbed on the right, by rotations in rad and
/// shifts in mm.
pub(super) struct LensGram {
    /// Normal matrix of the lens parameters.
    pub lens: LensCovariance,
    /// Cross terms of lens and pose.
    pub lens_pose_cross: SMatrix<f64, 9, 6>,
    /// Normal matrix of the pose.
    pub pose: Matrix6<f64>,
    /// Right-hand side of the lens parameters.
    pub lens_pull: SVector<f64, 9>,
    /// Right-hand side of the pose.
    pub pose_pull: Vector6<f64>,
    /// Sum of squared residuals, px².
    pub square: f64,
    /// Number of residuals: two for each corner.
    pub rows: f64,
}

impl LensGram {
    /// Returns the products of a picture; `None` if a corner is behind the camera.
    pub fn compute(
        camera: &PinholeCamera,
        corners: &Corners,
        camera_from_board: &Rigid<Camera, Board>,
    ) -> Option<Self> {
        let turn = camera_from_board.rotation().into_inner();
        let mut gram = LensGram {
            lens: LensCovariance::zeros(),
            lens_pose_cross: SMatrix::zeros(),
            pose: Matrix6::zeros(),
            lens_pull: SVector::zeros(),
            pose_pull: Vector6::zeros(),
            square: 0.0,
            rows: 2.0 * corners.len() as f64,
        };
        for (q, found) in corners {
            let point = *camera_from_board * *q;
            let (pixel, slope) = camera.project_with_jacobian(point)?;
            let by_lens = camera.lens_jacobian(point)?;
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(-slope * turn * q.mm.coords.cross_matrix()));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&(slope * turn));
            let residual = nalgebra::Vector2::new(found.u - pixel.u, found.v - pixel.v);
            gram.lens += by_lens.transpose() * by_lens;
            gram.lens_pose_cross += by_lens.transpose() * by_pose;
            gram.pose += by_pose.transpose() * by_pose;
            gram.lens_pull += by_lens.transpose() * residual;
            gram.pose_pull += by_pose.transpose() * residual;
            gram.square += residual.norm_squared();
        }
        Some(gram)
    }

    /// Returns the information of the picture about the lens, with its pose eliminated.
    pub fn information(&self) -> Option<LensCovariance> {
        Some(self.lens - self.lens_pose_cross * scaled_inverse(&self.pose)? * self.lens_pose_cross.transpose())
    }
}

/// Prior standard deviation of the displacement of the rim by radial terms, as a fraction of its radius.
const RELATIVE_RADIAL_PRIOR_STD: f64 = 0.2;
/// Prior standard deviation of the displacement of the rim by tangential terms, as a fraction of its radius: lenses of
/// one manufacturer differ by a thousandth.
const RELATIVE_TANGENTIAL_PRIOR_STD: f64 = 0.01;

/// Returns the sum of the information of corners and prior, in units of `variance_px2`; `None` if a picture determines
/// no pose.
pub(super) fn information(camera: &PinholeCamera, grams: &[LensGram], variance_px2: f64) -> Option<LensCovariance> {
    let mut normal = LensCovariance::zeros();
    for gram in grams {
        normal += gram.information()?;
    }
    let radius = camera.max_undistorted_radius(0.0)?;
    for (place, power, share) in [
        (4, 2, RELATIVE_RADIAL_PRIOR_STD),
        (5, 4, RELATIVE_RADIAL_PRIOR_STD),
        (6, 1, RELATIVE_TANGENTIAL_PRIOR_STD),
        (7, 1, RELATIVE_TANGENTIAL_PRIOR_STD),
        (8, 6, RELATIVE_RADIAL_PRIOR_STD),
    ] {
        let deviation = share / radius.powi(power);
        normal[(place, place)] += variance_px2 / deviation.powi(2);
    }
    for (_, by_lens) in prior_residuals(camera) {
        normal += by_lens * by_lens.transpose() * variance_px2;
    }
    Some(normal)
}

/// Returns the covariance C of (2) for this information; `None` if the information determines no lens.
pub(super) fn lens_covariance(information: &LensCovariance, variance_px2: f64) -> Option<LensCovariance> {
    Some(scaled_inverse(information)? * variance_px2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_model_adds_coefficients_to_the_previous_one() {
        assert_eq!(LensModel::ALL.iter().map(|model| model.count()).collect::<Vec<_>>(), [4, 5, 6, 8, 9]);
        assert_eq!(LensModel::Radial2.excluded_coefficients(), ["p1", "p2", "k3"]);
        assert!(LensModel::Full.excluded_coefficients().is_empty());
    }
}
