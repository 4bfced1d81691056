//! What a localization knows about itself.
//!
//! The covariance of the pose at the panel's centre is the inverse of the information matrix,
//!     C = (Σ_k N_k / (n_k σ_k²) Σᵢ JᵢᵀJᵢ)⁻¹,   σ_k² = r̄²_k N_k / (N_k − 3),                                 (1)
//! over the two kinds k of pairs, n_k of them with N_k errors of their own and a mean square residual of r̄²_k: a scanner's
//! range noise is alike over several centimetres, so that thousands of points tell no more than a few dozen would; the
//! fit takes up three of each kind. A point x of the panel then has the covariance A C Aᵀ with A = [−[x − c]×  I].
//! Does not know what both scans share: the error of the camera's calibration.

use super::point_to_plane::{Aligned, NEAR_PATCHES, Residuals, Samples, Sums, information};
use super::samples::{Scanned, Taught};
use super::{LocateError, correspond};
use crate::geometry::{Base, Degrees, Panel, Point, Rigid};
use crate::panel::{TaughtPanel, panel_from_base_at_teaching};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector6};

/// 95 % of a normal distribution lie within this many standard deviations, in one direction.
const WITHIN_95_PERCENT: f64 = 1.96;
/// The same for the length of a vector in space, where all directions are alike: √7.815, χ² with three degrees of freedom.
const WITHIN_95_PERCENT_3D: f64 = 2.796;
/// A taught point is found where the scan's surface passes it at this distance or less, mm.
const FOUND_MM: f64 = 1.0;

/// A pose with what speaks for and against it.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Where the panel stands.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Root mean square of the point-to-plane residuals, mm.
    pub rms_mm: f64,
    /// Root mean square of the distances across the outline, mm.
    pub outline_rms_mm: f64,
    /// The same in pixels of the 3D camera.
    pub outline_rms_px: f64,
    /// Share of the taught points that the scan has, 0…1.
    pub taught_found: f64,
    /// Share of the scan's piece that the taught panel has, 0…1.
    pub scan_found: f64,
    /// Share of the taught outline that the scan's outline has, 0…1.
    pub outline_found: f64,
    /// Point-to-plane steps.
    pub iterations: usize,
    /// How far the last of them moved the panel, at most, mm.
    pub last_step_mm: f64,
    /// Covariance of a small twist (ω, v) about the panel's centre in the base frame, rad and mm.
    pub covariance: Matrix6<f64>,
    /// 95 % of the errors are smaller, at the worst point of the panel, mm.
    pub uncertainty_mm: f64,
    /// 95 % of the errors along the weakest direction are smaller, mm, where a turn counts by what it moves on average.
    pub weakest_mm: f64,
    /// How far the panel's centre stands from its nominal place, mm.
    pub shift_mm: f64,
    /// The turn in the panel's plane, about its mean normal, −180…180°.
    pub turn: Degrees,
    /// The tilt of its mean normal.
    pub tilt: Degrees,
    /// Taught points that took part.
    pub points: usize,
}

impl Fit {
    /// The smaller share of taught points found in the scan and of the scan's found among the taught.
    pub fn overlap(&self) -> f64 {
        self.taught_found.min(self.scan_found)
    }
}

/// Weighs the end of an alignment.
pub(super) fn weigh(
    aligned: Aligned,
    panel: &TaughtPanel,
    taught: &Taught,
    scanned: &Scanned,
    area_mm2: f64,
) -> Result<Fit, LocateError> {
    let base_from_panel = aligned.base_from_panel;
    let residuals = Residuals::at(base_from_panel, taught, scanned);
    let centre = base_from_panel * taught.centre;
    let sums = [Sums::over(&residuals.surface, centre), Sums::over(&residuals.outline, centre)];
    let samples = Samples::of(&sums, taught, scanned, area_mm2);
    let sigma_mm = [sigma_mm(&sums[0], samples.surface), sigma_mm(&sums[1], samples.outline)];
    let degenerate = LocateError::Degenerate { surface: residuals.surface.len(), outline: residuals.outline.len() };
    let covariance = information(&sums, samples, sigma_mm).try_inverse().ok_or(degenerate)?;
    let (shift_mm, turn, tilt) = motion(base_from_panel, taught);
    let outline_rms_mm = sums[1].rms_mm();
    let depth_mm = panel.panel_from_camera.origin().distance_mm(taught.centre);
    Ok(Fit {
        base_from_panel,
        rms_mm: sums[0].rms_mm(),
        outline_rms_mm,
        outline_rms_px: outline_rms_mm * panel.camera.px_per_mm_at(depth_mm).0,
        taught_found: taught_found(&residuals, taught),
        scan_found: scan_found(base_from_panel, taught, scanned),
        outline_found: outline_found(&residuals, taught, scanned),
        iterations: aligned.iterations,
        last_step_mm: aligned.last_step_mm,
        uncertainty_mm: uncertainty_mm(&covariance, centre, base_from_panel, taught),
        weakest_mm: weakest_mm(&covariance, taught),
        covariance,
        shift_mm,
        turn,
        tilt,
        points: residuals.surface.len(),
    })
}

/// σ of (1).
fn sigma_mm(sums: &Sums, samples: f64) -> f64 {
    let free = (samples - 3.0).max(1.0);
    (sums.squares_mm2 / sums.count.max(1) as f64 * samples / free).sqrt()
}

/// Shift of the centre, turn about the mean normal and tilt of it, from the nominal place.
fn motion(base_from_panel: Rigid<Base, Panel>, taught: &Taught) -> (f64, Degrees, Degrees) {
    // Nominally the panel's frame is the base: only there do a panel's and a base's numbers compare.
    let moved = panel_from_base_at_teaching() * base_from_panel;
    let tilt = (moved * taught.normal).angle_to(taught.normal);
    // Swing and twist: the part of the quaternion along the normal turns in the plane.
    let rotation = moved.isometry().rotation;
    let turn_rad = 2.0 * rotation.imag().dot(&taught.normal.mm).atan2(rotation.scalar());
    let wrapped_rad = turn_rad.sin().atan2(turn_rad.cos());
    ((moved * taught.centre).distance_mm(taught.centre), Degrees::from_rad(wrapped_rad), tilt)
}

fn taught_found(residuals: &Residuals, taught: &Taught) -> f64 {
    let found = residuals.surface.iter().filter(|constraint| constraint.residual_mm.abs() <= FOUND_MM).count();
    found as f64 / (taught.surface.len() - residuals.at_border).max(1) as f64
}

fn outline_found(residuals: &Residuals, taught: &Taught, scanned: &Scanned) -> f64 {
    let allowed_mm = FOUND_MM.max(scanned.spacing_mm);
    let found = residuals.outline.iter().filter(|constraint| constraint.residual_mm.abs() <= allowed_mm).count();
    found as f64 / taught.outline.len() as f64
}

fn scan_found(base_from_panel: Rigid<Base, Panel>, taught: &Taught, scanned: &Scanned) -> f64 {
    let moved = taught.surface.iter().map(|point| base_from_panel * *point);
    let Some(tree) = correspond::Tree::over(moved) else { return 0.0 };
    // Taught points lie on a lattice up to √2 times as wide as the patches'; its half diagonal, and what is allowed.
    let reach_mm = (NEAR_PATCHES * scanned.patch_spacing_mm).hypot(FOUND_MM);
    let found = scanned.surface.iter().filter(|patch| tree.closest(patch.point).1 <= reach_mm).count();
    found as f64 / scanned.surface.len() as f64
}

fn uncertainty_mm(
    covariance: &Matrix6<f64>,
    centre: Point<Base>,
    base_from_panel: Rigid<Base, Panel>,
    taught: &Taught,
) -> f64 {
    let at = |point: &Point<Panel>| {
        let arm = (base_from_panel * *point - centre).mm;
        let mut a = Matrix3x6::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (a * covariance * a.transpose()).symmetric_eigenvalues().max()
    };
    WITHIN_95_PERCENT_3D * taught.outline.iter().map(at).fold(0.0, f64::max).max(0.0).sqrt()
}

fn weakest_mm(covariance: &Matrix6<f64>, taught: &Taught) -> f64 {
    let count = taught.surface.len() as f64;
    let radius_mm =
        (taught.surface.iter().map(|point| (*point - taught.centre).mm.norm_squared()).sum::<f64>() / count).sqrt();
    let scale = Matrix6::from_diagonal(&Vector6::new(radius_mm, radius_mm, radius_mm, 1.0, 1.0, 1.0));
    WITHIN_95_PERCENT * (scale * covariance * scale).symmetric_eigenvalues().max().max(0.0).sqrt()
}
