//! Compares two pose hypotheses of one panel by the evidence that supports only one of the two.
//!
//! Only places at which the two poses disagree carry information. Such a place is a segment of the outline, or the
//! border of a mark, that has its edge at only one of the poses. It may also be a piece of surface that lies on the
//! scan at only one of the poses. Places that are occluded at either pose are left out. The evidence is a length; a
//! square of surface counts as the length of its side.

use super::fit::FitInputs;
use super::grid::RigidF32;
use super::sampling::spread_indices;
use super::search::{PointObservation, observe_point};
use super::{mark_edges, model::Model, outline_edges};
use panelprep_base::geometry::{Camera, Panel, Rigid};
use rayon::prelude::*;

/// An edge within this distance is at the outline's place, px.
const MAX_EDGE_DISTANCE_PX: f64 = 1.2;
/// A surface within this distance counts as the taught surface, mm.
pub(super) const MAX_SURFACE_DISTANCE_MM: f64 = 0.35;
/// Side of the square that a point of the surface represents, mm.
const SQUARE_MM: f64 = 8.0;

/// The result of comparing each place of the panel at a pose with the scan: consistent, contradicted, or unknown.
pub(super) struct ConsistencyScore {
    agreements: Vec<Option<bool>>,
    lengths_mm: Vec<f64>,
}

impl ConsistencyScore {
    /// Computes the score at a pose.
    pub fn compute(placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>) -> ConsistencyScore {
        let motion = RigidF32::from_rigid(placed);
        let FitInputs { model, grid, scan } = inputs;
        let outline = (0..model.outline.len()).into_par_iter().with_min_len(64).map(|k| {
            outline_edges::observe_edge(&motion, model, &grid.camera, scan, k)?
                .edge
                .is_within_distance(MAX_EDGE_DISTANCE_PX)
        });
        let chosen = squares(model);
        let surface = chosen.par_iter().with_min_len(512).map(|&i| match observe_point(&motion, model, grid, i) {
            PointObservation::On(residual_mm) => Some(residual_mm.abs() <= MAX_SURFACE_DISTANCE_MM),
            PointObservation::Through => Some(false),
            // An object in front of the panel hides it and contradicts nothing; only a ray that passes through the
            // panel does.
            PointObservation::Near | PointObservation::Hidden | PointObservation::Unknown => None,
        });
        let marks = model.marks.points.par_iter().with_min_len(64).map(|mark| {
            mark_edges::observe_mark(&motion, mark, &grid.camera, scan)?
                .edge
                .is_within_distance(MAX_EDGE_DISTANCE_PX)
        });
        let mut agreement: Vec<Option<bool>> = outline.collect();
        agreement.extend(surface.collect::<Vec<_>>());
        let mut lengths_mm: Vec<f64> = model.outline.iter().map(|sample| sample.length_mm).collect();
        lengths_mm.resize(agreement.len(), SQUARE_MM);
        agreement.extend(marks.collect::<Vec<_>>());
        lengths_mm.extend(model.marks.points.iter().map(|mark| mark.length_mm));
        ConsistencyScore { agreements: agreement, lengths_mm }
    }

    /// Returns the lengths that support only this pose and only the other pose, mm.
    pub fn exclusive_support_mm(&self, other: &ConsistencyScore) -> [f64; 2] {
        let mut alone_mm = [0.0; 2];
        for ((a, b), length_mm) in self.agreements.iter().zip(&other.agreements).zip(&self.lengths_mm) {
            match (a, b) {
                // A place that is unknown at one of the two poses says nothing about their difference.
                (Some(true), Some(false)) => alone_mm[0] += length_mm,
                (Some(false), Some(true)) => alone_mm[1] += length_mm,
                _ => {}
            }
        }
        alone_mm
    }
}

fn squares(model: &Model) -> Vec<usize> {
    spread_indices(model.points.len(), ((model.area_mm2 / (SQUARE_MM * SQUARE_MM)) as usize).clamp(100, 4_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 3 mm support only the first pose, 5 mm only the second; places that either pose does not see are
    /// left out.
    #[test]
    fn only_differences_count() {
        let votes = |said: [Option<bool>; 4]| ConsistencyScore {
            agreements: said.to_vec(),
            lengths_mm: vec![3.0, 5.0, 7.0, 9.0],
        };
        let first = votes([Some(true), Some(false), Some(true), Some(true)]);
        let second = votes([Some(false), Some(true), None, Some(true)]);
        assert_eq!(first.exclusive_support_mm(&second), [3.0, 5.0]);
    }
}
