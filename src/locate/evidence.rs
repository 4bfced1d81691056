//! What a localization knows about itself.
//!
//! The covariance of the pose about the panel's centre is the inverse of the fit's information,
//!     C = (Σ_k Σᵢ wᵢ JᵢᵀJᵢ / f_k)⁻¹,   f_k = max(1, (ν + Σ_c m_c²/s_c²) / (ν + n)),                            (1)
//! over the kinds k of residuals. A kind's noise is stated in `fit` for the mean m of a cell whose members share one error;
//! f_k is how much larger the n cells' means are than that, which ν cells' worth of trust in the stated noise steadies:
//! a small panel has few cells. A point x of the panel then has the covariance A C Aᵀ with A = [−[x − c]×  I].
//! Does not know what both scans share: the error of the camera's calibration.

use super::LocateError;
use super::camera_check::CameraCheck;
use super::edges::Edge;
use super::fit::{EDGE_CORRELATION_MM, Fitted, RANGE_CORRELATION_MM, Residuals, Samples, Seen};
use super::grid::{Motion, camera_point};
use super::model::Model;
use super::pieces::Piece;
use super::search::{Sight, covered, sight};
use super::solve::{Constraint, Weighing};
use crate::geometry::{Base, Camera, Degrees, Panel, Rigid};
use crate::panel::panel_from_base_at_teaching;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// 95 % of a normal distribution lie within this many standard deviations, in one direction.
const WITHIN_95_PERCENT: f64 = 1.96;
/// The worst point's error is smaller than this many of its stated standard deviations in 95 % of rendered scans
/// (`make bench-locate`): the noise is stated on the safe side.
const WORST_95_PERCENT: f64 = 2.0;
/// ν of (1).
const TRUST_CELLS: f64 = 12.0;
/// A cell needs this share of the points of a full one.
const CELL_FILLED: f64 = 0.3;
/// A point of the outline is found where the edge is this near, px.
const EDGE_FOUND_PX: f64 = 1.5;
/// A channel at this level or above is saturated.
const SATURATED: u8 = 252;
/// Pieces with at least this share on the panel are part of it.
const PART_OF_PANEL: f64 = 0.2;

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
    /// Share of the taught points that the scan sees through: something farther is where they should be.
    pub seen_through: f64,
    /// Share of the taught outline in view beyond which the surface goes on, or which is not there.
    pub outline_absent: f64,
    /// Share of the taught points in view and not hidden for which the scan has a point at all: low where it is wet.
    pub measured: f64,
    /// How many pixels a step of brightness takes at the outline, median; `None` where colour shows no edge.
    pub edge_width_px: Option<f64>,
    /// The same at teaching.
    pub taught_edge_width_px: f64,
    /// Share of the panel's pixels that are overexposed.
    pub saturated: f64,
    /// Steps of the fit.
    pub iterations: usize,
    /// How far the last of them moved the panel, at most, mm.
    pub last_step_mm: f64,
    /// How far apart fits from independent starts end, at most, mm.
    pub agreement_mm: f64,
    /// The placement that explains the scan next best.
    pub rival: Option<Rival>,
    /// What the fixture says of the camera's place; `None` where too little of it is seen.
    pub camera: Option<CameraCheck>,
    /// Covariance of a small twist (ω, v) about the panel's centre in the camera's frame, rad and mm.
    pub covariance: Matrix6<f64>,
    /// 95 % of the errors are smaller, at the worst point of the panel, mm.
    pub uncertainty_mm: f64,
    /// 95 % of the errors along the weakest direction are smaller, mm, where a turn counts by what it moves on average.
    pub weakest_mm: f64,
    /// That direction: what of the panel it moves.
    pub weakest: Weakest,
    /// How far the panel's centre stands from its nominal place, mm.
    pub shift_mm: f64,
    /// The turn in the panel's plane, about its mean normal, −180…180°.
    pub turn: Degrees,
    /// The tilt of its mean normal.
    pub tilt: Degrees,
    /// Taught points that took part.
    pub points: usize,
}

/// The direction in which a pose is held least.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weakest {
    /// A shift along the panel's normal, or a tilt of it.
    Normal,
    /// A shift in the panel's plane.
    Sideways,
    /// A turn in the panel's plane.
    Turn,
}

impl Weakest {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Weakest::Normal => "along the panel's normal",
            Weakest::Sideways => "sideways in the panel's plane",
            Weakest::Turn => "turned in the panel's plane",
        }
    }
}

/// Another placement, and what tells the two apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// Where it puts the panel.
    pub base_from_panel: Rigid<Base, Panel>,
    /// The turn between the two.
    pub turned: Degrees,
    /// Outline and surface that speak for the first alone, as a length, mm.
    pub for_first_mm: f64,
    /// The same for the rival alone, mm.
    pub for_rival_mm: f64,
}

/// A length of outline that turns up by chance, mm.
const CHANCE_MM: f64 = 8.0;

impl Rival {
    /// How many times more speaks for the first than for the rival.
    pub fn margin(&self) -> f64 {
        (self.for_first_mm + CHANCE_MM) / (self.for_rival_mm + CHANCE_MM)
    }
}

impl Fit {
    /// The smaller share of taught points found in the scan and of the scan's found among the taught.
    pub fn overlap(&self) -> f64 {
        self.taught_found.min(self.scan_found)
    }
}

/// What is known beside the fit itself.
pub(super) struct Beside {
    pub agreement_mm: f64,
    pub rival: Option<Rival>,
    pub camera: Option<CameraCheck>,
}

/// Weighs the end of a fit.
pub(super) fn weigh(
    fitted: &Fitted,
    seen: Seen<'_>,
    pieces: &[Piece],
    base_from_camera: Rigid<Base, Camera>,
    beside: Beside,
) -> Result<Fit, LocateError> {
    let Seen { model, grid, .. } = seen;
    let placed = fitted.camera_from_panel;
    let motion = Motion::of(&placed);
    let samples = Samples::all(model);
    let residuals = Residuals::at(&placed, seen, &samples);
    let weighing = residuals.weighing(model, &samples);
    let (covariance, weakest) =
        covariance(&residuals, &weighing, model, &motion).ok_or(LocateError::Degenerate {
            surface: residuals.surface.len(),
            outline: residuals.colour.len() + residuals.depth.len(),
        })?;
    let sights: Vec<Sight> = (0..model.points.len())
        .into_par_iter()
        .with_min_len(1_024)
        .map(|i| sight(&motion, model, grid, i))
        .collect();
    let surface = SurfaceShares::of(&sights);
    let outline = OutlineShares::of(&residuals, model);
    let base_from_panel = base_from_camera * placed;
    let (shift_mm, turn, tilt) = displacement(base_from_panel, model);
    let (px_per_mm, _) = grid.camera.px_per_mm_at(residuals.centre.z);
    Ok(Fit {
        base_from_panel,
        rms_mm: surface.rms_mm,
        outline_rms_mm: outline.rms_px / px_per_mm,
        outline_rms_px: outline.rms_px,
        taught_found: surface.found,
        scan_found: scan_found(&motion, seen, pieces),
        outline_found: outline.found,
        seen_through: surface.through,
        outline_absent: outline.absent,
        measured: surface.measured,
        edge_width_px: outline.width_px,
        taught_edge_width_px: model.edge_width_px,
        saturated: saturated(&motion, seen),
        iterations: fitted.iterations,
        last_step_mm: fitted.last_step_mm,
        agreement_mm: beside.agreement_mm,
        rival: beside.rival,
        camera: beside.camera,
        uncertainty_mm: WORST_95_PERCENT * worst_mm(&covariance, model, &motion),
        weakest_mm: weakest.0,
        weakest: weakest.1,
        covariance,
        shift_mm,
        turn,
        tilt,
        points: residuals.surface.len(),
    })
}

struct SurfaceShares {
    found: f64,
    through: f64,
    measured: f64,
    rms_mm: f64,
}

impl SurfaceShares {
    fn of(sights: &[Sight]) -> SurfaceShares {
        let (mut on, mut through, mut unknown, mut squares) = (0usize, 0usize, 0usize, 0.0);
        for sight in sights {
            match sight {
                Sight::On(residual_mm) => (on, squares) = (on + 1, squares + residual_mm * residual_mm),
                Sight::Through => through += 1,
                Sight::Unknown => unknown += 1,
                Sight::Hidden => {}
            }
        }
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        SurfaceShares {
            found: share(on, sights.len()),
            through: share(through, sights.len()),
            measured: share(on + through, on + through + unknown),
            rms_mm: (squares / on.max(1) as f64).sqrt(),
        }
    }
}

struct OutlineShares {
    found: f64,
    absent: f64,
    rms_px: f64,
    width_px: Option<f64>,
}

impl OutlineShares {
    fn of(residuals: &Residuals, model: &Model) -> OutlineShares {
        let (mut found, mut absent, mut in_view, mut squares, mut near) = (0.0, 0.0, 0.0, 0.0, 0usize);
        let mut widths = Vec::new();
        for (k, edge) in &residuals.edges {
            let length_mm = model.outline[*k].length_mm;
            let offset_px = match edge {
                Edge::Colour { offset_px, width_px } => {
                    widths.push(*width_px);
                    *offset_px
                }
                Edge::Depth { offset_px } => *offset_px,
                Edge::Absent => f64::INFINITY,
                Edge::Hidden | Edge::OutOfView => continue,
            };
            in_view += length_mm;
            if offset_px.abs() <= EDGE_FOUND_PX {
                found += length_mm;
                squares += offset_px * offset_px;
                near += 1;
            } else {
                absent += length_mm;
            }
        }
        let whole: f64 = model.outline.iter().map(|sample| sample.length_mm).sum();
        let middle = widths.len() / 2;
        let enough = widths.len() >= 20;
        OutlineShares {
            found: found / whole.max(1.0),
            absent: absent / f64::max(in_view, 1.0),
            rms_px: (squares / near.max(1) as f64).sqrt(),
            width_px: enough.then(|| *widths.select_nth_unstable_by(middle, f64::total_cmp).1),
        }
    }
}

/// Of the pieces that are part of the panel, the share that the taught panel has.
fn scan_found(motion: &Motion, seen: Seen<'_>, pieces: &[Piece]) -> f64 {
    let (mut held, mut whole) = (0.0, 0.0);
    for piece in pieces {
        let share = covered(motion, seen.model, seen.grid, piece, 1_500);
        if share >= PART_OF_PANEL {
            held += share * piece.area_mm2;
            whole += piece.area_mm2;
        }
    }
    held / f64::max(whole, 1.0)
}

fn saturated(motion: &Motion, seen: Seen<'_>) -> f64 {
    let Seen { model, grid, scan } = seen;
    let (mut asked, mut over) = (0usize, 0usize);
    for point in model.points.iter().step_by(7) {
        let pixel = grid.camera.project(camera_point(&motion.point(point)));
        let Some((column, row)) = pixel.and_then(|pixel| pixel.whole(scan.width(), scan.height())) else {
            continue;
        };
        asked += 1;
        over += usize::from(scan.color_at(row * scan.width() + column).iter().any(|&level| level >= SATURATED));
    }
    over as f64 / asked.max(1) as f64
}

/// Shift of the centre, turn about the mean normal and tilt of it, from the nominal place.
fn displacement(base_from_panel: Rigid<Base, Panel>, model: &Model) -> (f64, Degrees, Degrees) {
    // Nominally the panel's frame is the base: only there do a panel's and a base's numbers compare.
    let moved = panel_from_base_at_teaching() * base_from_panel;
    let (centre, normal) = (model.centre_point(), model.normal_direction());
    // Swing and twist: the part of the quaternion along the normal turns in the plane.
    let rotation = moved.isometry().rotation;
    let turn_rad = 2.0 * rotation.imag().dot(&normal.mm).atan2(rotation.scalar());
    let wrapped_rad = turn_rad.sin().atan2(turn_rad.cos());
    ((moved * centre).distance_mm(centre), Degrees::from_rad(wrapped_rad), (moved * normal).angle_to(normal))
}

/// (1), and the direction in which it is largest.
fn covariance(
    residuals: &Residuals,
    weighing: &[Weighing; 3],
    model: &Model,
    motion: &Motion,
) -> Option<(Matrix6<f64>, (f64, Weakest))> {
    let across = {
        let first = model.outline.first()?.point - model.centre;
        (first - model.normal * model.normal.dot(&first)).try_normalize(1e-9)?
    };
    let up = model.normal.cross(&across);
    let square = |sample: usize| {
        let offset = model.points[sample] - model.centre;
        let cell = |along: &Vector3<f64>| (offset.dot(along) / RANGE_CORRELATION_MM).floor() as i64;
        (cell(&across), cell(&up))
    };
    // The taught outline is in order, so that a stretch of it is a run of its points.
    let mut ways_mm = Vec::with_capacity(model.outline.len());
    let mut way_mm = 0.0;
    for sample in &model.outline {
        ways_mm.push(way_mm);
        way_mm += sample.length_mm;
    }
    let stretch = |sample: usize| ((ways_mm[sample] / EDGE_CORRELATION_MM).floor() as i64, 0);
    let factors = [
        inflation(&residuals.surface, &weighing[0], square),
        inflation(&residuals.colour, &weighing[1], stretch),
        inflation(&residuals.depth, &weighing[2], stretch),
    ];
    let kinds = [&residuals.surface, &residuals.colour, &residuals.depth];
    let mut information = Matrix6::zeros();
    for ((kind, weighing), factor) in kinds.iter().zip(weighing).zip(factors) {
        information += super::solve::Sums::over(kind, weighing, &residuals.centre).information / factor;
    }
    let covariance = information.try_inverse().filter(|c| (0..6).all(|i| c[(i, i)] > 0.0))?;
    let count = model.points.len().max(1) as f64;
    let squares = model.points.iter().map(|point| (point - model.centre).norm_squared()).sum::<f64>();
    let radius_mm = (squares / count).sqrt();
    let scale = Matrix6::from_diagonal(&Vector6::new(radius_mm, radius_mm, radius_mm, 1.0, 1.0, 1.0));
    let eigen = (scale * covariance * scale).symmetric_eigen();
    let weakest_mm = WITHIN_95_PERCENT * eigen.eigenvalues.max().max(0.0).sqrt();
    let direction = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let normal = motion.turn * model.normal;
    let (turn, shift) = (direction.fixed_rows::<3>(0), direction.fixed_rows::<3>(3));
    let (spin, lift) = (turn.dot(&normal).powi(2), shift.dot(&normal).powi(2));
    let (tilt, slide) = (turn.norm_squared() - spin, shift.norm_squared() - lift);
    let word = if lift + tilt >= spin.max(slide) {
        Weakest::Normal
    } else if slide >= spin {
        Weakest::Sideways
    } else {
        Weakest::Turn
    };
    Some((covariance, (weakest_mm, word)))
}

/// f of (1).
fn inflation(constraints: &[Constraint], weighing: &Weighing, cell: impl Fn(usize) -> (i64, i64)) -> f64 {
    let mut cells: BTreeMap<(i64, i64), (f64, f64)> = BTreeMap::new();
    for constraint in constraints {
        let robust = weighing.robust(constraint.residual);
        let sums = cells.entry(cell(constraint.sample)).or_default();
        *sums = (sums.0 + robust, sums.1 + robust * constraint.residual);
    }
    let filled = cells.values().filter(|(weight, _)| *weight >= CELL_FILLED * weighing.sharing);
    let (count, squares) = filled.fold((0.0, 0.0), |(count, squares), (weight, sum)| {
        let mean = sum / weight;
        (count + 1.0, squares + mean * mean / (weighing.sigma * weighing.sigma))
    });
    // The fit takes up a part of the noise, so that cells never say that there is less of it than stated.
    ((TRUST_CELLS + squares) / (TRUST_CELLS + count)).max(1.0)
}

/// One standard deviation at the worst point of the panel, along its worst direction, mm.
pub(super) fn worst_mm(covariance: &Matrix6<f64>, model: &Model, motion: &Motion) -> f64 {
    let centre = motion.point(&model.centre);
    let at = |point: &Vector3<f64>| {
        let arm = motion.point(point) - centre;
        let mut a = Matrix3x6::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (a * covariance * a.transpose()).symmetric_eigenvalues().max()
    };
    model.outline.iter().step_by(4).map(|sample| at(&sample.point)).fold(0.0, f64::max).max(0.0).sqrt()
}
