//! The evidence for a located pose, as measured values.
//!
//! The evidence consists of the matched fractions, the uncertainty of the pose (`covariance`), the results of further
//! checks (independent starts, competing poses, the fixture), and the displacement from the nominal pose. The module
//! `gate` compares these values with their limits. An error of the camera calibration, which both scans have in common,
//! is not visible here.
//!
//! The matched fractions of the panel and of the scan are determined as follows. Each taught point is compared with the
//! scan at its projection, and each point of the outline with the expected position of its edge. The connected pieces
//! of the scan are compared with the taught panel at its pose. A point that is occluded or out of view is neither
//! matched nor evidence against the pose. The same is true for a missing point beside a nearer object that may shade
//! it.
//!
//! An object in front of the panel may block the light of the 3D camera's projector. A 3D camera has no points where
//! the light of its projector does not reach. The projector is mounted beside the lens, along the rows of the picture,
//! at a distance of at most B. An object at the depth z′ can shade a point at the depth z only if it is seen in the
//! same row, at a distance of at most
//!     f B (1/z′ − 1/z) px.                                                                               (1)
//! It depends on the camera on which side of the point the object is, so both sides are examined. A panel cannot shade
//! itself: with slope s over k px, (1) is k s B / z, which is less than k up to s = 6, 81°.

use super::camera_check::CameraCheck;
use super::covariance::{PoseCovariance, WeakestMotion, covariance, worst_mm};
use super::deviation::Deviation;
use super::edges::EdgeReading;
use super::error::LocateError;
use super::fit::{FitInputs, FitState, Residuals, Samples};
use super::grid::{Grid, MatrixTransform, camera_point};
use super::model::Model;
use super::pieces;
use super::pieces::Piece;
use super::search::{PointObservation, covered_share, observe_point};
use nalgebra::Matrix6;
use panelprep_base::geometry::statistics::{NORMAL_TWO_SIDED_95, PANEL_MAX_95};
use panelprep_base::geometry::{
    Base, Camera, Degrees, Panel, Pixel, Point, PoseUncertainty, Rigid, median, polygon,
};
use rayon::prelude::*;

/// A located pose with its evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The located pose of the panel in the base frame.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Root mean square distance of the scan from the taught surface with its smooth deviation, mm: the part that no
    /// smooth bend explains.
    pub rms_mm: f64,
    /// Maximum distance between the present and the taught panel according to the smooth deviation, mm; `None` if too
    /// little of the panel is visible.
    pub deviation_mm: Option<f64>,
    /// Root mean square distance across the outline, mm.
    pub outline_rms_mm: f64,
    /// Root mean square distance across the outline, in pixels of the 3D camera.
    pub outline_rms_px: f64,
    /// Fraction of the taught points that are found in the scan, 0…1. This fraction, `scan_found_share` and `measured`
    /// are relative to a scan with the same number of missing points as the taught scan.
    pub taught_found: f64,
    /// Fraction of the area of the scanned pieces that the taught panel covers, 0…1.
    pub scan_found_share: f64,
    /// Fraction of the taught outline that is found in the scan, 0…1.
    pub outline_found: f64,
    /// Fraction of the taught points at which the scan shows a surface farther away.
    pub seen_through_share: f64,
    /// Fraction of the taught outline in view at which the edge is missing or displaced, for example because the
    /// surface continues beyond the outline.
    pub outline_absent: f64,
    /// Fraction of the taught marks in view that the scan shows at their taught positions, 0…1; `None` if the panel has
    /// hardly any marks.
    pub marks_found: Option<f64>,
    /// Fraction of the taught points, in view and not hidden, at which the scan has a point: low if the panel is wet.
    pub measured: f64,
    /// Median width of the steps of brightness at the outline, px; `None` if colour shows no edge.
    pub edge_width_px: Option<f64>,
    /// Median width of the steps of brightness at the outline at teaching, px.
    pub taught_edge_width_px: f64,
    /// Fraction of the pixels of the panel that are overexposed.
    pub saturated_share: f64,
    /// Number of iterations of the fit.
    pub iterations: usize,
    /// Maximum displacement of the panel in the last iteration of the fit, mm.
    pub last_step_mm: f64,
    /// Maximum distance between the results of fits from independent starts, mm.
    pub agreement_mm: f64,
    /// The pose that explains the scan second best.
    pub rival: Option<CompetingPose>,
    /// Result of the comparison of the camera pose with the fixture; `None` if too little of the fixture is visible.
    pub camera: Option<CameraCheck>,
    /// Uncertainty of the camera pose, 95 %, as the fixture in the taught scan would determine it, mm. Computed if the
    /// fixture in this scan does not determine the pose well enough; `None` also if the taught scan shows too little of
    /// the fixture.
    pub camera_at_teaching_mm: Option<f64>,
    /// Covariance of a small twist (ω, v) about the centre of the panel in the camera frame, rad and mm.
    pub covariance: Matrix6<f64>,
    /// The centre of the panel in the panel frame.
    pub centre: Point<Panel>,
    /// Uncertainty of the pose, 95 %: the maximum error over the whole panel, mm.
    pub uncertainty_mm: f64,
    /// This uncertainty if the panel were at its taught pose, at which the common scale error of all scans of the 3D
    /// camera has no effect, mm.
    pub uncertainty_at_taught_place_mm: f64,
    /// This uncertainty if the distances of the 3D camera had no scale error at all, mm.
    pub uncertainty_without_scale_mm: f64,
    /// Uncertainty along the least constrained direction, 95 %, mm; for a rotation its mean displacement of the panel.
    pub weakest_mm: f64,
    /// The direction in which the pose is least constrained.
    pub weakest_direction: WeakestMotion,
    /// Distance between the centre of the panel and its nominal position, mm.
    pub shift_mm: f64,
    /// Rotation in the plane of the panel, about its mean normal, −180…180°.
    pub turn: Degrees,
    /// Tilt of the mean normal of the panel.
    pub tilt: Degrees,
    /// Number of taught points that were used.
    pub points: usize,
}

/// A competing pose (rival), and the evidence that distinguishes it from the first pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompetingPose {
    /// The pose of the panel according to the rival.
    pub base_from_panel: Rigid<Base, Panel>,
    /// Angle of the rotation between the two poses.
    pub rotation: Degrees,
    /// Length of outline, and of surface converted to a length, that supports only the first pose, mm.
    pub for_first_mm: f64,
    /// Length of outline, and of surface converted to a length, that supports only the rival, mm.
    pub for_rival_mm: f64,
}

/// A length of outline that may match by chance, mm.
pub(super) const CHANCE_MATCH_MM: f64 = 8.0;

impl CompetingPose {
    /// Returns the ratio of the evidence for the first pose to the evidence for the rival.
    pub fn evidence_ratio(&self) -> f64 {
        (self.for_first_mm + CHANCE_MATCH_MM) / (self.for_rival_mm + CHANCE_MATCH_MM)
    }
}

impl Fit {
    /// Returns the smaller of two fractions: of the taught points that are found in the scan, and of the scanned points
    /// that are found among the taught points.
    pub fn overlap(&self) -> f64 {
        self.taught_found.min(self.scan_found_share)
    }

    /// Returns the pose with its uncertainty increased by this additional error, mm.
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

    /// Returns the uncertainty of the pose at each point of the panel, for this pose of the camera.
    pub fn pose_uncertainty(&self, base_from_camera: Rigid<Base, Camera>) -> PoseUncertainty {
        PoseUncertainty {
            camera_from_panel: base_from_camera.inverse() * self.base_from_panel,
            centre: self.centre,
            covariance: self.covariance,
        }
    }

    /// Returns by how many pixels the steps of brightness at the outline are wider than at teaching; `None` if colour
    /// shows no edge.
    pub fn blur_px(&self) -> Option<f64> {
        self.edge_width_px.map(|width_px| width_px - self.taught_edge_width_px)
    }

    /// Returns the minimum displacement of the panel by the motion of the camera since teaching, mm: the result of the
    /// fixture minus its uncertainty.
    pub fn camera_moved_mm(&self) -> Option<f64> {
        self.camera.map(|camera| camera.moved_mm - camera.uncertainty_mm)
    }
}

/// The evidence that does not come from the fit.
pub(super) struct FurtherEvidence {
    pub agreement_mm: f64,
    pub rival: Option<CompetingPose>,
    pub camera: Option<CameraCheck>,
    pub camera_at_teaching_mm: Option<f64>,
    /// The bend of the panel; the model in the inputs of the fit is the panel with this bend.
    pub deviation: Option<Deviation>,
}

/// Calculates the evidence for the result of a fit.
pub(super) fn compute_evidence(
    fitted: &FitState,
    inputs: FitInputs<'_>,
    pieces: &[Piece],
    base_from_camera: Rigid<Base, Camera>,
    beside: FurtherEvidence,
) -> Result<Fit, LocateError> {
    let FitInputs { model, grid, .. } = inputs;
    let placed = fitted.camera_from_panel;
    let motion = MatrixTransform::from_rigid(&placed);
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
    let surface = SurfaceFractions::compute(&motion, inputs);
    let outline = OutlineFractions::compute(&residuals, model);
    // The points that were missing at teaching and the points that are missing now are independent of each other.
    let of_expected = |share: f64| (share / model.measured_fraction).min(1.0);
    // The camera mount is used only here: everything before is in the camera frame and does not depend on the
    // calibration of the mount.
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
        scan_found_share: of_expected(scan_found_share(&motion, inputs, pieces)),
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

/// Returns the shift of the centre, the rotation about the mean normal and the tilt of the mean normal, relative to the
/// nominal pose.
fn displacement(base_from_panel: Rigid<Base, Panel>, model: &Model) -> (f64, Degrees, Degrees) {
    // The motion is expressed in the panel frame at its nominal pose, the only frame in which the coordinates of the
    // two poses are comparable.
    let moved = model.nominal_pose.inverse() * base_from_panel;
    let (centre, normal) = (model.centre_point(), model.normal_direction());
    // Swing-twist decomposition: the part of the quaternion along the normal is the rotation in the plane.
    let rotation = moved.isometry().rotation;
    let turn_rad = 2.0 * rotation.imag().dot(&normal.mm).atan2(rotation.scalar());
    let wrapped_rad = turn_rad.sin().atan2(turn_rad.cos());
    ((moved * centre).distance_mm(centre), Degrees::from_rad(wrapped_rad), (moved * normal).angle_between(normal))
}

/// Maximum distance between a point of the outline and its measured edge, for the point to be found, px.
pub(super) const MAX_FOUND_EDGE_DISTANCE_PX: f64 = 1.5;
/// Minimum level of a saturated channel.
pub const MIN_SATURATED_LEVEL: u8 = 252;
/// Minimum fraction of a piece that is on the panel, for the piece to be a part of the panel.
const MIN_FRACTION_ON_PANEL: f64 = 0.2;

/// Fractions of the taught surface, 0…1.
pub(super) struct SurfaceFractions {
    pub found: f64,
    pub through: f64,
    pub measured: f64,
    pub rms_mm: f64,
}

impl SurfaceFractions {
    pub fn compute(motion: &MatrixTransform, inputs: FitInputs<'_>) -> SurfaceFractions {
        let FitInputs { model, grid, scan } = inputs;
        let look = |i: usize| {
            let pixel = grid.camera.project(camera_point(&motion.point(&model.points[i])));
            let place = pixel.and_then(|pixel| pixel.nearest_whole(scan.width(), scan.height()));
            let measured = place.is_some_and(|(column, row)| scan.point(column, row).is_some());
            let unlit = || pixel.is_some_and(|pixel| may_occlude(grid, pixel, motion.point(&model.points[i]).z));
            (observe_point(motion, model, grid, i), measured, !measured && unlit())
        };
        let looks: Vec<(PointObservation, bool, bool)> =
            (0..model.points.len()).into_par_iter().with_min_len(1_024).map(look).collect();
        let (mut on, mut near, mut through, mut squares) = (0usize, 0usize, 0usize, 0.0);
        let (mut in_view, mut measured) = (0usize, 0usize);
        for (sight, has_point, unlit) in &looks {
            match sight {
                PointObservation::On(residual_mm) => (on, squares) = (on + 1, squares + residual_mm * residual_mm),
                PointObservation::Near => near += 1,
                PointObservation::Through => through += 1,
                PointObservation::Unknown => {}
                PointObservation::Hidden => continue,
            }
            in_view += usize::from(!unlit);
            measured += usize::from(*has_point);
        }
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        SurfaceFractions {
            found: share(on + near, looks.len()),
            through: share(through, looks.len()),
            measured: share(measured, in_view),
            rms_mm: (squares / on.max(1) as f64).sqrt(),
        }
    }
}

/// Fractions of the taught outline, 0…1.
pub(super) struct OutlineFractions {
    pub found: f64,
    pub absent: f64,
    pub rms_px: f64,
    pub width_px: Option<f64>,
}

impl OutlineFractions {
    pub fn compute(residuals: &Residuals, model: &Model) -> OutlineFractions {
        let (mut found, mut absent, mut in_view, mut squares, mut near) = (0.0, 0.0, 0.0, 0.0, 0usize);
        let mut widths = Vec::new();
        for (k, edge) in &residuals.edges {
            let length_mm = model.outline[*k].length_mm;
            let offset_px = match edge {
                EdgeReading::Colour { offset_px, width_px } => {
                    widths.push(*width_px);
                    *offset_px
                }
                EdgeReading::Depth { offset_px } => *offset_px,
                EdgeReading::Absent => f64::INFINITY,
                EdgeReading::Hidden | EdgeReading::OutOfView => continue,
            };
            in_view += length_mm;
            if offset_px.abs() <= MAX_FOUND_EDGE_DISTANCE_PX {
                found += length_mm;
                squares += offset_px * offset_px;
                near += 1;
            } else {
                absent += length_mm;
            }
        }
        let whole: f64 = model.outline.iter().map(|sample| sample.length_mm).sum();
        let enough = widths.len() >= 20;
        OutlineFractions {
            found: found / whole.max(1.0),
            absent: absent / f64::max(in_view, 1.0),
            rms_px: (squares / near.max(1) as f64).sqrt(),
            width_px: median(&mut widths).filter(|_| enough),
        }
    }
}

/// Minimum length of mark borders in view, mm: a panel with less has no usable marks.
const MIN_MARKS_MM: f64 = 100.0;

/// Returns the fraction of the marks in view that are at their taught positions, by the length of their borders, 0…1.
fn marks_found(residuals: &Residuals, model: &Model) -> Option<f64> {
    let (mut found_mm, mut in_view_mm) = (0.0, 0.0);
    for (mark, edge) in &residuals.mark_edges {
        let length_mm = model.marks.points[*mark].length_mm;
        let Some(is_found) = edge.is_within_distance(MAX_FOUND_EDGE_DISTANCE_PX) else { continue };
        in_view_mm += length_mm;
        found_mm += if is_found { length_mm } else { 0.0 };
    }
    (in_view_mm >= MIN_MARKS_MM).then(|| found_mm / in_view_mm)
}

/// Returns the fraction of the scanned pieces of the panel that the taught panel covers. An object attached to the
/// panel at a holder is treated as a separate piece.
fn scan_found_share(motion: &MatrixTransform, inputs: FitInputs<'_>, pieces: &[Piece]) -> f64 {
    if !inputs.model.held_px.is_empty() {
        return scan_overlap(motion, inputs, &cut_held_places(motion, inputs, pieces));
    }
    scan_overlap(motion, inputs, pieces)
}

fn scan_overlap(motion: &MatrixTransform, inputs: FitInputs<'_>, pieces: &[Piece]) -> f64 {
    let (mut found, mut whole) = (0.0, 0.0);
    for piece in pieces {
        let share = covered_share(motion, inputs.model, inputs.grid, piece, 1_500);
        if share >= MIN_FRACTION_ON_PANEL {
            found += share * piece.area_mm2;
            whole += piece.area_mm2;
        }
    }
    found / f64::max(whole, 1.0)
}

/// Returns the pieces without the blocks within the holders of the taught picture.
fn cut_held_places(motion: &MatrixTransform, inputs: FitInputs<'_>, pieces: &[Piece]) -> Vec<Piece> {
    let FitInputs { model, grid, .. } = inputs;
    let (back, taught) = (motion.inverse(), MatrixTransform::from_rigid(&model.camera_from_panel));
    let is_held = |block: usize| {
        let point = grid.point(block % grid.columns, block / grid.columns);
        let pixel =
            point.and_then(|point| model.grid.camera.project(camera_point(&taught.point(&back.point(&point)))));
        pixel.is_some_and(|pixel| model.held_px.iter().any(|held| polygon::contains(held, pixel)))
    };
    let mut free = vec![false; grid.columns * grid.rows];
    for &block in pieces.iter().flat_map(|piece| &piece.blocks) {
        free[block as usize] = !is_held(block as usize);
    }
    pieces::find_pieces(grid, &free)
}

/// Returns the fraction of the pixels of the panel that are overexposed.
fn saturated_share(motion: &MatrixTransform, inputs: FitInputs<'_>) -> f64 {
    let FitInputs { model, grid, scan } = inputs;
    let (mut asked, mut over) = (0usize, 0usize);
    for point in model.points.iter().step_by(7) {
        let pixel = grid.camera.project(camera_point(&motion.point(point)));
        let Some((column, row)) = pixel.and_then(|pixel| pixel.nearest_whole(scan.width(), scan.height())) else {
            continue;
        };
        asked += 1;
        over += usize::from(
            scan.color_at(row * scan.width() + column).iter().any(|&level| level >= MIN_SATURATED_LEVEL),
        );
    }
    over as f64 / asked.max(1) as f64
}

/// Maximum distance between a projector and its lens, mm: in a Zivid Two it is 112 mm.
const MAX_BASELINE_MM: f64 = 120.0;

/// Returns whether a nearer object may block the projector's light at a pixel of this depth.
fn may_occlude(grid: &Grid, pixel: Pixel, depth_mm: f64) -> bool {
    let [x, y] = grid.block_position(pixel).map(f64::round);
    if !(x >= 0.0 && y >= 0.0 && x < grid.columns as f64 && y < grid.rows as f64) {
        return false;
    }
    let (column, row) = (x as usize, y as usize);
    // The search is along the row, because lens and projector are mounted side by side.
    (0..grid.columns).any(|other| {
        let away_px = (column.abs_diff(other) * grid.factor) as f64;
        let reaches =
            |nearer_mm: f64| grid.camera.fx_px * MAX_BASELINE_MM * (1.0 / nearer_mm - 1.0 / depth_mm) > away_px;
        other != column && grid.depth_mm(row * grid.columns + other).is_some_and(reaches) // (1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    const CAMERA: PinholeCamera = PinholeCamera {
        width_px: 486,
        height_px: 300,
        fx_px: 446.0,
        fy_px: 446.0,
        cx_px: 243.0,
        cy_px: 150.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };

    /// Expected value, calculated by hand: with f = 446 px, an object at 680 mm in front of a panel at 780 mm shades
    /// the panel up to 446 · 120 · (1/680 − 1/780) = 10.1 px beside the object.
    #[test]
    fn the_shadow_of_an_object_has_the_calculated_width() {
        let thing = |column: usize, row: usize| (200..=240).contains(&column) && (100..=140).contains(&row);
        let depth = |index: usize| Some(if thing(index % 486, index / 486) { 680.0 } else { 780.0 });
        let grid = Grid::from_depths((486, 300), &CAMERA, depth);
        let hidden = |u: f64, v: f64| may_occlude(&grid, Pixel::at(u, v), 780.0);
        assert!(hidden(190.0, 120.0) && hidden(250.0, 120.0));
        assert!(!hidden(188.0, 120.0) && !hidden(252.0, 120.0), "too far away");
        assert!(!hidden(195.0, 150.0) && !hidden(220.0, 95.0), "in another row");
        assert!(!may_occlude(&grid, Pixel::at(190.0, 120.0), 690.0), "10 mm behind it: 4 px");
    }

    /// A plane that slopes away at 70° has no object in front of it.
    #[test]
    fn a_steep_panel_does_not_shade_itself() {
        let slope = 70.0_f64.to_radians().tan();
        let depth = |index: usize| {
            let x = ((index % 486) as f64 - 243.0) / 446.0;
            Some((780.0 / (1.0 - slope * x)).clamp(300.0, 3_000.0) as f32)
        };
        let grid = Grid::from_depths((486, 300), &CAMERA, depth);
        assert!((200..280).all(|column| !may_occlude(
            &grid,
            Pixel::at(column as f64, 150.0),
            780.0 / (1.0 - slope * (column as f64 - 243.0) / 446.0)
        )));
    }
}
