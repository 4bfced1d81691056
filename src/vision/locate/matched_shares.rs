//! The fractions of the panel and of the scan that were matched.
//!
//! Each taught point is looked up at its projection, each point of the outline at the expected place of its edge, and
//! the scan's pieces at the places that the taught panel would show. A point that is occluded or out of view is
//! neither counted against the pose nor as matched; nor is a missing point beside a nearer object that may shade it.

use super::edges::EdgeReading;
use super::fit::{FitInputs, Residuals};
use super::grid::{RigidF32, camera_point};
use super::model::Model;
use super::pieces::{self, Piece};
use super::search::{PointObservation, covered_share, observe_point};
use super::shadow;
use panelprep_base::geometry::{median, polygon};
use rayon::prelude::*;

/// A point of the outline is found if the edge is this near, px.
pub(super) const EDGE_FOUND_PX: f64 = 1.5;
/// A channel at this level or above is saturated.
pub const SATURATED: u8 = 252;
/// Pieces of which at least this fraction lies on the panel are part of the panel.
const PART_OF_PANEL: f64 = 0.2;

/// Fractions of the taught surface, 0…1.
pub(super) struct SurfaceShares {
    pub found: f64,
    pub through: f64,
    pub measured: f64,
    pub rms_mm: f64,
}

impl SurfaceShares {
    pub fn compute(motion: &RigidF32, inputs: FitInputs<'_>) -> SurfaceShares {
        let FitInputs { model, grid, scan } = inputs;
        let look = |i: usize| {
            let pixel = grid.camera.project(camera_point(&motion.point(&model.points[i])));
            let place = pixel.and_then(|pixel| pixel.nearest_whole(scan.width(), scan.height()));
            let measured = place.is_some_and(|(column, row)| scan.point(column, row).is_some());
            let unlit =
                || pixel.is_some_and(|pixel| shadow::may_occlude(grid, pixel, motion.point(&model.points[i]).z));
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
        SurfaceShares {
            found: share(on + near, looks.len()),
            through: share(through, looks.len()),
            measured: share(measured, in_view),
            rms_mm: (squares / on.max(1) as f64).sqrt(),
        }
    }
}

/// Fractions of the taught outline, 0…1.
pub(super) struct OutlineShares {
    pub found: f64,
    pub absent: f64,
    pub rms_px: f64,
    pub width_px: Option<f64>,
}

impl OutlineShares {
    pub fn compute(residuals: &Residuals, model: &Model) -> OutlineShares {
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
            if offset_px.abs() <= EDGE_FOUND_PX {
                found += length_mm;
                squares += offset_px * offset_px;
                near += 1;
            } else {
                absent += length_mm;
            }
        }
        let whole: f64 = model.outline.iter().map(|sample| sample.length_mm).sum();
        let enough = widths.len() >= 20;
        OutlineShares {
            found: found / whole.max(1.0),
            absent: absent / f64::max(in_view, 1.0),
            rms_px: (squares / near.max(1) as f64).sqrt(),
            width_px: median(&mut widths).filter(|_| enough),
        }
    }
}

/// A panel with a shorter border of marks in view than this has no usable marks, mm.
const MIN_MARKS_MM: f64 = 100.0;

/// Returns the fraction of the marks in view that are at their place, by the length of their borders, 0…1.
pub(super) fn marks_found(residuals: &Residuals, model: &Model) -> Option<f64> {
    let (mut found_mm, mut in_view_mm) = (0.0, 0.0);
    for (mark, edge) in &residuals.mark_edges {
        let length_mm = model.marks.points[*mark].length_mm;
        let Some(is_found) = edge.is_within_distance(EDGE_FOUND_PX) else { continue };
        in_view_mm += length_mm;
        found_mm += if is_found { length_mm } else { 0.0 };
    }
    (in_view_mm >= MIN_MARKS_MM).then(|| found_mm / in_view_mm)
}

/// Returns the fraction of the panel's pieces that the taught panel covers. An object attached to the panel at a held
/// place counts as another piece.
pub(super) fn scan_found(motion: &RigidF32, inputs: FitInputs<'_>, pieces: &[Piece]) -> f64 {
    if !inputs.model.held_px.is_empty() {
        return scan_overlap(motion, inputs, &cut_held_places(motion, inputs, pieces));
    }
    scan_overlap(motion, inputs, pieces)
}

fn scan_overlap(motion: &RigidF32, inputs: FitInputs<'_>, pieces: &[Piece]) -> f64 {
    let (mut found, mut whole) = (0.0, 0.0);
    for piece in pieces {
        let share = covered_share(motion, inputs.model, inputs.grid, piece, 1_500);
        if share >= PART_OF_PANEL {
            found += share * piece.area_mm2;
            whole += piece.area_mm2;
        }
    }
    found / f64::max(whole, 1.0)
}

/// The pieces without the blocks that lie in a held place of the taught picture.
fn cut_held_places(motion: &RigidF32, inputs: FitInputs<'_>, pieces: &[Piece]) -> Vec<Piece> {
    let FitInputs { model, grid, .. } = inputs;
    let (back, taught) = (motion.inverse(), RigidF32::from_rigid(&model.camera_from_panel));
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

/// Returns the fraction of the panel's pixels that are overexposed.
pub(super) fn saturated_share(motion: &RigidF32, inputs: FitInputs<'_>) -> f64 {
    let FitInputs { model, grid, scan } = inputs;
    let (mut asked, mut over) = (0usize, 0usize);
    for point in model.points.iter().step_by(7) {
        let pixel = grid.camera.project(camera_point(&motion.point(point)));
        let Some((column, row)) = pixel.and_then(|pixel| pixel.nearest_whole(scan.width(), scan.height())) else {
            continue;
        };
        asked += 1;
        over += usize::from(scan.color_at(row * scan.width() + column).iter().any(|&level| level >= SATURATED));
    }
    over as f64 / asked.max(1) as f64
}
