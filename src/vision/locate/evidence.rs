//! The evidence for a located pose, in numbers.
//!
//! It consists of the matched fractions (`matched_shares`), the uncertainty of the pose (`covariance`), the results of further
//! checks (independent starts, competing poses, the fixture), and the displacement from the nominal pose. `gate`
//! judges these numbers. An error of the camera's calibration, which both scans share, is not visible here.

use super::LocateError;
use super::camera_check::CameraCheck;
use super::covariance::{PoseCovariance, WeakestMotion, covariance, worst_mm};
use super::deviation::Deviation;
use super::fit::{FitInputs, IterationEnd, Residuals, Samples};
use super::grid::RigidF32;
use super::matched_shares::{OutlineShares, SurfaceShares, marks_found, saturated_share, scan_found};
use super::model::Model;
use super::pieces::Piece;
use nalgebra::Matrix6;
use panelprep_base::geometry::statistics::{NORMAL_TWO_SIDED_95, PANEL_MAX_95};
use panelprep_base::geometry::{Base, Camera, Degrees, Panel, Point, PoseUncertainty, Rigid};

/// A pose with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The panel's pose.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Root mean square of the scan's distances from the taught surface with its smooth deviation, mm: the part that a
    /// bow or a wave does not explain.
    pub rms_mm: f64,
    /// The largest distance of the panel from the taught one according to the smooth deviation, mm; `None` if too
    /// little of the panel is seen.
    pub deviation_mm: Option<f64>,
    /// Root mean square of the distances across the outline, mm.
    pub outline_rms_mm: f64,
    /// Root mean square of the distances across the outline, in pixels of the 3D camera.
    pub outline_rms_px: f64,
    /// Fraction of the taught points that are found in the scan, 0…1. This fraction, `scan_found` and `measured` are
    /// relative to a scan with the same number of missing points as the taught one.
    pub taught_found: f64,
    /// Fraction of the scan's pieces that is found in the taught panel, 0…1.
    pub scan_found: f64,
    /// Fraction of the taught outline that is found in the scan, 0…1.
    pub outline_found: f64,
    /// Fraction of the taught points at which the scan shows something farther away.
    pub seen_through_share: f64,
    /// Fraction of the taught outline in view at which the edge is missing or elsewhere, for example because the
    /// surface continues beyond the outline.
    pub outline_absent: f64,
    /// Fraction of the taught marks in view that the scan shows at their place, 0…1; `None` if the panel has hardly
    /// any marks.
    pub marks_found: Option<f64>,
    /// Fraction of the taught points, in view and not hidden, at which the scan has a point: low if the panel is wet.
    pub measured: f64,
    /// Width of a step of brightness at the outline, px, median; `None` if colour shows no edge.
    pub edge_width_px: Option<f64>,
    /// Width of a step of brightness at the outline at teaching, px, median.
    pub taught_edge_width_px: f64,
    /// Fraction of the panel's pixels that are overexposed.
    pub saturated_share: f64,
    /// The number of steps of the fit.
    pub iterations: usize,
    /// The largest displacement of the panel in the last step of the fit, mm.
    pub last_step_mm: f64,
    /// The largest distance between the results of fits from independent starts, mm.
    pub agreement_mm: f64,
    /// The pose that explains the scan second best.
    pub rival: Option<CompetingPose>,
    /// The check of the camera's pose by the fixture; `None` if too little of the fixture is visible.
    pub camera: Option<CameraCheck>,
    /// Uncertainty of the camera's pose, 95 %, as the taught scan's own fixture would determine it, mm. Computed if
    /// this scan's fixture does not determine the pose well enough; `None` also if the taught scan shows too little of
    /// the fixture.
    pub camera_at_teaching_mm: Option<f64>,
    /// Covariance of a small twist (ω, v) about the panel's centre in the camera's frame, rad and mm.
    pub covariance: Matrix6<f64>,
    /// The panel's centre.
    pub centre: Point<Panel>,
    /// The largest error over the whole panel is smaller than this with a probability of 95 %, mm.
    pub uncertainty_mm: f64,
    /// The same uncertainty if the panel were at its taught pose, at which a scale error that all scans of the 3D
    /// camera share has no effect, mm.
    pub uncertainty_at_taught_place_mm: f64,
    /// The same uncertainty if the 3D camera's distances had no scale error at all, mm.
    pub uncertainty_without_scale_mm: f64,
    /// 95 % of the errors along the weakest direction are smaller, mm; a rotation counts by its mean displacement.
    pub weakest_mm: f64,
    /// The weakest direction.
    pub weakest_direction: WeakestMotion,
    /// Distance of the panel's centre from its nominal position, mm.
    pub shift_mm: f64,
    /// The rotation in the panel's plane, about its mean normal, −180…180°.
    pub turn: Degrees,
    /// The tilt of the panel's mean normal.
    pub tilt: Degrees,
    /// The number of taught points that were used.
    pub points: usize,
}

/// A competing pose (rival), and the evidence that distinguishes it from the first pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompetingPose {
    /// The panel's pose according to the rival.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The rotation between the two poses.
    pub rotation: Degrees,
    /// Length of outline, and of surface counted as a length, that supports only the first pose, mm.
    pub for_first_mm: f64,
    /// Length of outline, and of surface counted as a length, that supports only the rival, mm.
    pub for_rival_mm: f64,
}

/// A length of outline that may match by chance, mm.
const CHANCE_MATCH_MM: f64 = 8.0;

impl CompetingPose {
    /// Returns the ratio of the evidence for the first pose to the evidence for the rival.
    pub fn evidence_ratio(&self) -> f64 {
        (self.for_first_mm + CHANCE_MATCH_MM) / (self.for_rival_mm + CHANCE_MATCH_MM)
    }
}

impl Fit {
    /// Returns the smaller of two fractions: of the taught points found in the scan, and of the scan's points found
    /// among the taught points.
    pub fn overlap(&self) -> f64 {
        self.taught_found.min(self.scan_found)
    }

    /// Returns the pose with an uncertainty that is increased by this additional error, mm.
    pub(super) fn with_additional_error(self, off_mm: f64) -> Self {
        let mut covariance = self.covariance;
        for axis in 3..6 {
            covariance[(axis, axis)] += (off_mm / NORMAL_TWO_SIDED_95).powi(2);
        }
        Fit {
            covariance,
            uncertainty_mm: self.uncertainty_mm + off_mm,
            uncertainty_at_taught_place_mm: self.uncertainty_at_taught_place_mm + off_mm,
            uncertainty_without_scale_mm: self.uncertainty_without_scale_mm + off_mm,
            ..self
        }
    }

    /// Returns the uncertainty of the pose at each place, from the pose of the camera.
    pub fn pose_uncertainty(&self, base_from_camera: Rigid<Base, Camera>) -> PoseUncertainty {
        PoseUncertainty {
            camera_from_panel: base_from_camera.inverse() * self.base_from_panel,
            centre: self.centre,
            covariance: self.covariance,
        }
    }

    /// The number of pixels by which a step of brightness at the outline is wider than at teaching; `None` if
    /// colour shows no edge.
    pub fn blur_px(&self) -> Option<f64> {
        self.edge_width_px.map(|width_px| width_px - self.taught_edge_width_px)
    }

    /// The minimum distance by which the camera's motion has displaced the panel since teaching, mm: the fixture's
    /// result minus its uncertainty.
    pub fn camera_moved_mm(&self) -> Option<f64> {
        self.camera.map(|camera| camera.moved_mm - camera.uncertainty_mm)
    }
}

/// Evidence that does not come from the fit itself.
pub(super) struct FurtherEvidence {
    pub agreement_mm: f64,
    pub rival: Option<CompetingPose>,
    pub camera: Option<CameraCheck>,
    pub camera_at_teaching_mm: Option<f64>,
    /// The bend of the panel; the model of the fit's inputs is the panel with this bend.
    pub deviation: Option<Deviation>,
}

/// Calculates the evidence for the result of a fit.
pub(super) fn compute_evidence(
    fitted: &IterationEnd,
    inputs: FitInputs<'_>,
    pieces: &[Piece],
    base_from_camera: Rigid<Base, Camera>,
    beside: FurtherEvidence,
) -> Result<Fit, LocateError> {
    let FitInputs { model, grid, .. } = inputs;
    let placed = fitted.camera_from_panel;
    let motion = RigidF32::from_rigid(&placed);
    let samples = Samples::all_of_model(model);
    let residuals = Residuals::at_pose(&placed, inputs, &samples);
    let weighing = residuals.residual_weights(model, &samples);
    let PoseCovariance { covariance, weakest, weakest_mm, at_taught_place, without_scale_term: without_scale } =
        covariance(&residuals, &weighing, model, (&motion, beside.deviation.as_ref())).ok_or(
            LocateError::Degenerate {
                surface: residuals.surface.len(),
                outline: residuals.colour.len() + residuals.depth.len(),
            },
        )?;
    let at_worst_mm = |covariance| PANEL_MAX_95 * worst_mm(covariance, model, &motion);
    let surface = SurfaceShares::compute(&motion, inputs);
    let outline = OutlineShares::compute(&residuals, model);
    // The places of missing points at teaching and those of missing points now are independent of each other.
    let of_expected = |share: f64| (share / model.measured_share).min(1.0);
    // The mount enters only here: everything before is in the camera's frame and does not depend on its calibration.
    let base_from_panel = base_from_camera * placed;
    let (shift_mm, turn, tilt) = displacement(base_from_panel, model);
    let (px_per_mm, _) = grid.camera.px_per_mm_at(residuals.centre.z);
    Ok(Fit {
        base_from_panel,
        rms_mm: surface.rms_mm,
        deviation_mm: beside.deviation.as_ref().map(|deviation| deviation.largest_mm),
        outline_rms_mm: outline.rms_px / px_per_mm,
        outline_rms_px: outline.rms_px,
        taught_found: of_expected(surface.found),
        scan_found: of_expected(scan_found(&motion, inputs, pieces)),
        outline_found: outline.found,
        seen_through_share: surface.through,
        outline_absent: outline.absent,
        marks_found: marks_found(&residuals, model),
        measured: of_expected(surface.measured),
        edge_width_px: outline.width_px,
        taught_edge_width_px: model.edge_width_px,
        saturated_share: saturated_share(&motion, inputs),
        iterations: fitted.iterations,
        last_step_mm: fitted.last_step_mm,
        agreement_mm: beside.agreement_mm,
        rival: beside.rival,
        camera: beside.camera,
        camera_at_teaching_mm: beside.camera_at_teaching_mm,
        uncertainty_mm: at_worst_mm(&covariance),
        uncertainty_at_taught_place_mm: at_worst_mm(&at_taught_place),
        uncertainty_without_scale_mm: at_worst_mm(&without_scale),
        weakest_mm,
        weakest_direction: weakest,
        covariance,
        centre: model.centre_point(),
        shift_mm,
        turn,
        tilt,
        points: residuals.surface.len(),
    })
}

/// Returns the shift of the centre, the rotation about the mean normal and the tilt of this normal, relative to the
/// nominal pose.
fn displacement(base_from_panel: Rigid<Base, Panel>, model: &Model) -> (f64, Degrees, Degrees) {
    // Seen in the panel's frame at its nominal pose: only there are coordinates of the two poses comparable.
    let moved = model.nominal_pose.inverse() * base_from_panel;
    let (centre, normal) = (model.centre_point(), model.normal_direction());
    // Swing and twist: the part of the quaternion along the normal is the rotation in the plane.
    let rotation = moved.isometry().rotation;
    let turn_rad = 2.0 * rotation.imag().dot(&normal.mm).atan2(rotation.scalar());
    let wrapped_rad = turn_rad.sin().atan2(turn_rad.cos());
    ((moved * centre).distance_mm(centre), Degrees::from_rad(wrapped_rad), (moved * normal).angle_between(normal))
}
