//! Finds start poses from the marks of a panel if much of the panel gives no points.
//!
//! Pieces and their borders then hardly show where a flat panel lies in its plane; its printed marks do. The scan's
//! picture is searched for its steps of brightness, block by block, and each block stores the nearest of them. For
//! each rotation of the panel about the piece's normal, the shift is chosen that puts the most borders of marks on
//! steps which become brighter in the same direction. Within the possible shifts, the picture is treated as an affine
//! map of the panel's plane about each mark.

use super::edge_map::MarkSteps;
use super::grid::{Grid, RigidF32, camera_point};
use super::model::Model;
use super::outline_edges::outward_px;
use super::pieces::{MAX_BORDER_DISTANCE_BLOCKS, Piece};
use super::sampling::spread_indices;
use super::solve::Constraint;
use nalgebra::{Rotation3, Vector2, Vector3};
use rayon::prelude::*;

/// The numbers of marks that are looked for at each shift and for each score.
const COARSE_MARK_COUNT: usize = 100;
const SCORE_MARKS: usize = 300;
/// The largest shift of the panel to each side, as a fraction of its reach. The second constant is the distance from
/// one shift to the next, blocks.
const SHIFT_REACH: f64 = 0.35;
const SHIFT_BLOCKS: f64 = 3.0;
/// A mark counts as found at a shift if it lies within this distance of a step, blocks.
const MAX_MARK_DISTANCE_BLOCKS: f64 = 2.5;
/// The number of starts that are used: those of the rotations at which the most marks are found.
const MAX_STARTS: usize = 8;

/// Returns the distance of a mark from the nearest step of brightness, towards its brighter side, blocks.
pub(super) fn mark_distance(
    motion: &RigidF32,
    model: &Model,
    grid: &Grid,
    steps: &MarkSteps,
    k: usize,
) -> Option<Constraint> {
    let mark = &model.marks.points[k];
    let point = motion.point(&mark.point);
    if (motion.turn * mark.normal).dot(&point) >= 0.0 {
        return None;
    }
    let (pixel, slope) = grid.camera.project_with_jacobian(camera_point(&point))?;
    let brighter = outward_px(
        &(slope * (motion.turn * mark.border_direction)),
        &(slope * (motion.turn * mark.brighter_direction)),
    )?;
    let way = steps.vector_to_step(grid.block_position(pixel), &brighter)?;
    let residual = -(way[0] * brighter.x + way[1] * brighter.y);
    let gradient = slope.transpose() * brighter / grid.factor as f64;
    Some(Constraint { point, gradient, residual, sample: k })
}

/// Returns the fraction of the marks that lie on a step of brightness; 0 if no marks are looked for.
pub(super) fn marks_found(motion: &RigidF32, model: &Model, grid: &Grid, steps: Option<&MarkSteps>) -> f64 {
    let Some(steps) = steps else { return 0.0 };
    let is_on = |k: &usize| {
        mark_distance(motion, model, grid, steps, *k)
            .is_some_and(|mark| mark.residual.abs() <= MAX_BORDER_DISTANCE_BLOCKS)
    };
    let chosen = spread_indices(model.marks.points.len(), SCORE_MARKS);
    chosen.iter().filter(|k| is_on(k)).count() as f64 / chosen.len().max(1) as f64
}

/// Returns for each of the best of these rotations the position of the panel's middle at which the most marks are
/// found, and the rotation.
pub(super) fn start_positions(
    model: &Model,
    (grid, steps): (&Grid, &MarkSteps),
    piece: &Piece,
    turns: Vec<Rotation3<f64>>,
) -> Vec<(Vector3<f64>, Rotation3<f64>)> {
    let mut found: Vec<(usize, Vector3<f64>, Rotation3<f64>)> = turns
        .into_par_iter()
        .map(|rotation| {
            let (count, shift) = best_shift(model, (grid, steps), piece, &rotation);
            (count, piece.centre + shift, rotation)
        })
        .collect();
    found.sort_by_key(|(count, ..)| std::cmp::Reverse(*count));
    found.truncate(MAX_STARTS);
    found.into_iter().map(|(_, centre, rotation)| (centre, rotation)).collect()
}

/// A mark with the panel's middle on the piece's middle: its place, its displacement for a shift of one millimetre to
/// the right and one up, and the direction in which it becomes brighter.
struct ShiftedMark {
    place: Vector2<f64>,
    right: Vector2<f64>,
    up: Vector2<f64>,
    brighter: Vector2<f64>,
}

/// Returns the number of marks found at the best shift in the piece's plane, and this shift, mm.
fn best_shift(
    model: &Model,
    (grid, steps): (&Grid, &MarkSteps),
    piece: &Piece,
    rotation: &Rotation3<f64>,
) -> (usize, Vector3<f64>) {
    let Some(right) = piece.normal.cross(&piece.centre.yzx()).try_normalize(1e-9) else {
        return (0, Vector3::zeros());
    };
    let up = piece.normal.cross(&right);
    let shifted = |k: usize| {
        let mark = &model.marks.points[k];
        let point = piece.centre + rotation * (mark.point - model.centre);
        let (pixel, slope) = grid.camera.project_with_jacobian(camera_point(&point))?;
        let brighter = outward_px(
            &(slope * (rotation * mark.border_direction)),
            &(slope * (rotation * mark.brighter_direction)),
        )?;
        let slope = slope / grid.factor as f64;
        let [x, y] = grid.block_position(pixel);
        Some(ShiftedMark { place: Vector2::new(x, y), right: slope * right, up: slope * up, brighter })
    };
    let marks: Vec<ShiftedMark> =
        spread_indices(model.marks.points.len(), COARSE_MARK_COUNT).into_iter().filter_map(shifted).collect();
    let (px_per_mm, _) = grid.camera.px_per_mm_at(piece.centre.z);
    let step_mm = SHIFT_BLOCKS * grid.factor as f64 / px_per_mm;
    let max_steps = (SHIFT_REACH * piece.reach_mm / step_mm) as i32;
    let count_at = |across_mm: f64, up_mm: f64| {
        let is_found = |mark: &&ShiftedMark| {
            let place = mark.place + mark.right * across_mm + mark.up * up_mm;
            steps
                .vector_to_step([place.x, place.y], &mark.brighter)
                .is_some_and(|way| way[0].hypot(way[1]) <= MAX_MARK_DISTANCE_BLOCKS)
        };
        marks.iter().filter(is_found).count()
    };
    let mut best = (0, Vector3::zeros());
    for (i, j) in (-max_steps..=max_steps).flat_map(|i| (-max_steps..=max_steps).map(move |j| (i, j))) {
        let (across_mm, up_mm) = (f64::from(i) * step_mm, f64::from(j) * step_mm);
        let count = count_at(across_mm, up_mm);
        if count > best.0 {
            best = (count, right * across_mm + up * up_mm);
        }
    }
    best
}
