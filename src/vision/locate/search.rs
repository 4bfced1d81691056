//! Pose hypotheses for a scan, without a start value.
//!
//! A piece of the scan has a centroid and a mean normal. The taught panel is aligned with them at every rotation about
//! the normal, and at some shifts, since part of the piece may be occluded. Each of these starts is moved by the
//! surface and by the true border of the piece to its local optimum. The score of a hypothesis evaluates both
//! directions. It counts taught points that are on the scan, minus taught points at which the scan shows a surface
//! farther away. It also counts outline points on the border, and points of the piece that the taught panel covers. No
//! features are used, as a smooth panel has none. But if much of a panel with marks has no points, the borders of marks
//! are used as well.
//!
//! Without these points, pieces and their borders hardly determine the position of a flat panel in its plane; its
//! printed marks do. The picture of the scan is searched for its steps of brightness, block by block, and each block
//! stores the nearest of them. For each rotation of the panel about the normal of the piece, the shift is selected that
//! puts the most borders of marks on steps whose brightness increases in the same direction. Within the range of
//! shifts, the picture is approximated by an affine map of the panel's plane about each mark.

use super::edges::outward_px;
use super::grid::{ColoredCloud, DepthReading, Grid, MatrixTransform, camera_point, spread_indices};
use super::model::Model;
use super::pieces::{Border, MAX_BORDER_DISTANCE_BLOCKS, Piece, grid_position_in, points};
use super::print_features::{MIN_STEP_LEVELS, MarkSteps};
use super::solve::{Constraint, ResidualSums, ResidualWeighting, apply_twist};
use nalgebra::{Isometry3, Rotation3, Translation3, Unit, UnitQuaternion, Vector2, Vector3};
use panelprep_base::geometry::{Camera, Panel, Rigid};
use rayon::prelude::*;

/// Number of rotations about the normal.
const ROTATION_COUNT: usize = 36;
/// Number of rotations about the normal if marks are used.
const MARK_ROTATION_COUNT: usize = 72;
/// Number of shifts to each side along both axes; `RELATIVE_SHIFT_STEP` is the step between two shifts, as a fraction
/// of the panel's reach.
const SHIFTS_TO_EACH_SIDE: i32 = 2;
const RELATIVE_SHIFT_STEP: f64 = 0.13;
/// Number of surface points for the first evaluation of a start (`COARSE_POINT_COUNT`), for moving it
/// (`MOVE_POINT_COUNT`), and for its score (`SCORE_POINT_COUNT`).
const COARSE_POINT_COUNT: usize = 110;
const MOVE_POINT_COUNT: usize = 360;
const SCORE_POINT_COUNT: usize = 900;
/// Number of points of the outline, or of the marks, for moving a start. `SCORE_OUTLINE_POINT_COUNT` is the number of
/// outline points for its score.
const MOVE_LINE_POINT_COUNT: usize = 160;
const SCORE_OUTLINE_POINT_COUNT: usize = 300;
/// Maximum distance between the surfaces in the first evaluation, as a fraction of the panel's reach; wide, because the
/// normal of the piece is not precise.
const MAX_RELATIVE_COARSE_DISTANCE: f64 = 0.09;
/// Number of iterations in which a start is moved; in each iteration the cutoff of the residuals is multiplied by
/// `CUTOFF_FACTOR`.
const START_MOVE_ITERATIONS: usize = 14;
const CUTOFF_FACTOR: f64 = 0.82;
/// First iteration for starts from marks, which are already near the result. The following constants are the cutoffs in
/// the first iteration and their lower limits, for the surface (mm) and for the lines (blocks).
const FIRST_MARK_ITERATION: usize = 6;
const FIRST_CUTOFF_MM: f64 = 20.0;
const MIN_CUTOFF_MM: f64 = 2.0;
const FIRST_CUTOFF_BLOCKS: f64 = 30.0;
const MIN_CUTOFF_BLOCKS: f64 = 3.0;
/// Maximum distance between a taught point and the scan, for the point to be on the scan, mm.
const MAX_SURFACE_DISTANCE_MM: f64 = 1.5;
/// Distance inside of the outline at which missing points are searched, mm.
const OUTLINE_INSET_MM: f64 = 3.0;
/// Minimum distance between two different hypotheses, as a fraction of the panel's reach.
const MIN_RELATIVE_HYPOTHESIS_DISTANCE: f64 = 0.06;
/// Maximum difference between the score of a hypothesis and the best score; with a larger difference the hypothesis is
/// dropped. The score is at most 3, or 4 with marks.
const MAX_SCORE_LOSS: f64 = 1.2;
/// Maximum number of pose hypotheses; `MAX_PATCH_HYPOTHESES` is their number if much of the taught panel is missing, so
/// that pieces and borders contain less information.
const MAX_HYPOTHESES: usize = 5;
const MAX_PATCH_HYPOTHESES: usize = 20;
/// Minimum area of a piece that is a start by itself, as a fraction of the panel's area. `MIN_PART_AREA_FRACTION` is
/// the minimum area of a piece that is joined with others to a start.
const MIN_PIECE_AREA_FRACTION: f64 = 0.3;
const MIN_PART_AREA_FRACTION: f64 = 0.05;
/// Maximum area of a piece relative to the panel's area; a larger piece is another object.
const MAX_PIECE_AREA_RATIO: f64 = 3.5;

/// A pose hypothesis, with a score from −2 to 4 for its agreement with the scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseHypothesis {
    pub camera_from_panel: Rigid<Camera, Panel>,
    pub score: f64,
}

/// The lines that constrain a start in the plane of the panel.
#[derive(Clone, Copy)]
enum StartConstraint<'a> {
    /// The true border of the piece.
    Border(&'a Border),
    /// The borders of marks, which give more information if much of the panel has no points.
    Marks(&'a MarkSteps),
}

/// The true border of a piece, and, if marks are used, the steps of brightness beside it.
struct ConstraintLines<'a> {
    border: Border,
    steps: Option<&'a MarkSteps>,
}

/// Returns the maximum number of hypotheses that are fitted.
pub(super) fn fitted_hypotheses(model: &Model) -> usize {
    if model.has_missing_parts() { MAX_PATCH_HYPOTHESES } else { MAX_HYPOTHESES }
}

/// Returns the pieces that are used as starts: single pieces, and several pieces joined, in case an object divides the
/// panel.
pub(super) fn candidates(model: &Model, grid: &Grid, pieces: &[Piece]) -> Vec<Piece> {
    let parts: Vec<&Piece> = pieces
        .iter()
        .filter(|piece| (MIN_PART_AREA_FRACTION..MAX_PIECE_AREA_RATIO).contains(&(piece.area_mm2 / model.area_mm2)))
        .collect();
    let reach_mm = reach_mm(model);
    let mut joined = Vec::new();
    // The pieces are sorted by size. Only the largest ones are joined, not every subset, since a strap divides a panel
    // into a few large parts.
    for count in 2..=parts.len().min(4) {
        let whole = Piece::join(grid, &parts[..count]);
        // The limits are somewhat larger than the panel, because the parts also contain points of a holder or of the
        // ground.
        let fits = |whole: &Piece| whole.area_mm2 < 1.3 * model.area_mm2 && whole.reach_mm < 1.4 * reach_mm;
        joined.extend(whole.filter(fits));
    }
    // Only the three largest are used: a search box contains the panel and a few objects, and each start costs a whole
    // search.
    let large = |piece: &Piece| {
        (MIN_PIECE_AREA_FRACTION..MAX_PIECE_AREA_RATIO).contains(&(piece.area_mm2 / model.area_mm2))
    };
    let mut found: Vec<Piece> = pieces.iter().filter(|piece| large(piece)).take(3).cloned().collect();
    found.extend(joined);
    found
}

/// Returns the distance from the centre of the panel to its farthest point, mm.
pub(super) fn reach_mm(model: &Model) -> f64 {
    model.outline.iter().map(|sample| (sample.point - model.centre).norm()).fold(0.0, f64::max)
}

/// Returns the pose hypotheses from these pieces, the best first, all different from each other.
pub(super) fn search(model: &Model, (grid, scan): (&Grid, &ColoredCloud), pieces: &[Piece]) -> Vec<PoseHypothesis> {
    let reach_mm = reach_mm(model);
    let mut found: Vec<PoseHypothesis> = Vec::new();
    let by_marks = model.has_missing_parts() && !model.marks.points.is_empty();
    let steps = by_marks.then(|| MarkSteps::detect(scan, grid, pieces, MIN_STEP_LEVELS));
    for piece in pieces {
        let lines = ConstraintLines {
            border: Border::from_piece(grid, piece, model.has_missing_parts()),
            steps: steps.as_ref(),
        };
        let begun = |turn: usize| best_shift(model, grid, piece, turn as f64 / ROTATION_COUNT as f64, reach_mm);
        let ended = |start: Rigid<Camera, Panel>, by: StartConstraint<'_>| {
            let camera_from_panel = move_start_onto_scan(start, model, grid, by)?;
            Some(PoseHypothesis { camera_from_panel, score: score(&camera_from_panel, model, grid, piece, &lines) })
        };
        let by_border = (0..ROTATION_COUNT)
            .into_par_iter()
            .map(|turn| ended(begun(turn)?, StartConstraint::Border(&lines.border)));
        let mut of_piece: Vec<Option<PoseHypothesis>> = by_border.collect();
        if let Some(steps) = lines.steps {
            let turns = (0..MARK_ROTATION_COUNT)
                .map(|turn| align_normal(model, piece, turn as f64 / MARK_ROTATION_COUNT as f64));
            let by_marks = start_positions(model, (grid, steps), piece, turns.collect()).into_iter();
            of_piece.extend(
                by_marks
                    .map(|(centre, turn)| ended(centre_at(model, centre, &turn), StartConstraint::Marks(steps))),
            );
        }
        found.extend(of_piece.into_iter().flatten());
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut distinct: Vec<PoseHypothesis> = Vec::new();
    for hypothesis in found {
        let best = distinct.first().map_or(hypothesis.score, |best| best.score);
        let far = |other: &PoseHypothesis| {
            model.largest_distance_mm(&other.camera_from_panel, &hypothesis.camera_from_panel)
                > MIN_RELATIVE_HYPOTHESIS_DISTANCE * reach_mm
        };
        // The margin is wide: the score is coarse, and the other possible pose of a symmetric panel must be kept for
        // the full fit.
        if distinct.len() < fitted_hypotheses(model)
            && hypothesis.score > best - MAX_SCORE_LOSS
            && distinct.iter().all(far)
        {
            distinct.push(hypothesis);
        }
    }
    distinct
}

/// Returns the pose at one rotation about the normal of the piece, with the shift at which the most taught points agree
/// with the scan.
fn best_shift(model: &Model, grid: &Grid, piece: &Piece, turn: f64, reach_mm: f64) -> Option<Rigid<Camera, Panel>> {
    let rotation = align_normal(model, piece, turn);
    let right = rotation * perpendicular_direction(&model.normal);
    let up = piece.normal.cross(&right);
    let chosen = spread_indices(model.points.len(), COARSE_POINT_COUNT);
    let turned: Vec<Vector3<f64>> = chosen.iter().map(|&i| rotation * (model.points[i] - model.centre)).collect();
    let near_mm = MAX_RELATIVE_COARSE_DISTANCE * reach_mm;
    let step_mm = RELATIVE_SHIFT_STEP * reach_mm;
    let look = |shift: Vector3<f64>| -> f64 {
        let value = |offset: &Vector3<f64>| {
            let point = piece.centre + shift + offset;
            match grid.camera.project(camera_point(&point)).map(|pixel| grid.reading_at_pixel(pixel)) {
                Some(DepthReading::Smooth(z) | DepthReading::Rough(z)) if (z - point.z).abs() < near_mm => 1.0,
                // A ray that passes through the panel is the strongest evidence against the pose. A nearer surface may
                // be an object in front.
                Some(DepthReading::Smooth(z) | DepthReading::Rough(z)) if z > point.z => -1.0,
                Some(DepthReading::Smooth(_) | DepthReading::Rough(_)) => -0.5,
                _ => -0.3,
            }
        };
        turned.iter().map(value).sum()
    };
    let shifts = (-SHIFTS_TO_EACH_SIDE..=SHIFTS_TO_EACH_SIDE)
        .flat_map(|i| (-SHIFTS_TO_EACH_SIDE..=SHIFTS_TO_EACH_SIDE).map(move |j| (f64::from(i), f64::from(j))));
    let (_, shift) = shifts
        .map(|(i, j)| right * (i * step_mm) + up * (j * step_mm))
        .map(|shift| (look(shift), shift))
        .fold((f64::NEG_INFINITY, Vector3::zeros()), |best, next| if next.0 > best.0 { next } else { best });
    Some(centre_at(model, piece.centre + shift, &rotation))
}

/// Returns the rotation that aligns the normal of the taught panel with the normal of the piece, followed by this
/// fraction of a full rotation about this normal.
fn align_normal(model: &Model, piece: &Piece, turn: f64) -> Rotation3<f64> {
    let upright = Rotation3::rotation_between(&model.normal, &piece.normal)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    Rotation3::from_axis_angle(&Unit::new_normalize(piece.normal), turn * std::f64::consts::TAU) * upright
}

/// Returns the pose with this rotation that puts the centre of the panel at `centre`.
fn centre_at(model: &Model, centre: Vector3<f64>, rotation: &Rotation3<f64>) -> Rigid<Camera, Panel> {
    let turn = UnitQuaternion::from_rotation_matrix(rotation);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(
        Translation3::from(centre - rotation * model.centre),
        turn,
    ))
}

/// Returns a direction perpendicular to the given one.
fn perpendicular_direction(direction: &Vector3<f64>) -> Vector3<f64> {
    let least = direction.iamin();
    let mut axis = Vector3::zeros();
    axis[least] = 1.0;
    direction.cross(&axis).normalize()
}

/// Moves a start onto the scan by surface and lines, in a fixed number of iterations, regardless of the residuals.
fn move_start_onto_scan(
    start: Rigid<Camera, Panel>,
    model: &Model,
    grid: &Grid,
    by: StartConstraint<'_>,
) -> Option<Rigid<Camera, Panel>> {
    let on_surface = spread_indices(model.points.len(), MOVE_POINT_COUNT);
    let (count, first_round) = match by {
        StartConstraint::Border(_) => (model.outline.len(), 0),
        StartConstraint::Marks(_) => (model.marks.points.len(), FIRST_MARK_ITERATION),
    };
    let on_lines = spread_indices(count, MOVE_LINE_POINT_COUNT);
    let mut placed = start;
    for round in first_round..START_MOVE_ITERATIONS {
        // The cutoff is wide in the first iterations, so that distant points attract the start; it is narrow in the
        // last iterations, so that other objects lose their influence.
        let shrunk = CUTOFF_FACTOR.powi(round as i32);
        let motion = MatrixTransform::from_rigid(&placed);
        let centre = motion.point(&model.centre);
        let surface = surface_residuals(&motion, model, grid, &on_surface);
        let line_at = |&k: &usize| match by {
            StartConstraint::Border(border) => outside_distance(&motion, model, grid, border, k),
            StartConstraint::Marks(steps) => mark_distance(&motion, model, grid, steps, k),
        };
        let lines: Vec<Constraint> = on_lines.iter().filter_map(line_at).collect();
        let reach_mm = (FIRST_CUTOFF_MM * shrunk).max(MIN_CUTOFF_MM);
        let reach_blocks = (FIRST_CUTOFF_BLOCKS * shrunk).max(MIN_CUTOFF_BLOCKS);
        let of_surface = ResidualWeighting { sigma: 1.0, correlated_count: 1.0, cutoff: reach_mm };
        let of_lines = ResidualWeighting { sigma: 1.0, correlated_count: 1.0, cutoff: reach_blocks };
        let sums = ResidualSums::from_constraints(&surface, &of_surface, &centre)
            .add(ResidualSums::from_constraints(&lines, &of_lines, &centre));
        placed = apply_twist(&placed, &centre, &sums.twist()?);
    }
    Some(placed)
}

/// Returns the residuals of taught surface points at a pose.
fn surface_residuals(motion: &MatrixTransform, model: &Model, grid: &Grid, chosen: &[usize]) -> Vec<Constraint> {
    chosen.iter().filter_map(|&sample| surface_residual(motion, model, grid, sample)).collect()
}

/// Computes the residual (1) of `grid` at one taught point; `None` if the scan shows no smooth surface there, or the
/// point faces away.
pub(super) fn surface_residual(
    motion: &MatrixTransform,
    model: &Model,
    grid: &Grid,
    sample: usize,
) -> Option<Constraint> {
    let point = motion.point(&model.points[sample]);
    let normal = motion.turn * model.normals[sample];
    if normal.dot(&point) >= 0.0 {
        return None;
    }
    let pixel = grid.camera.project(camera_point(&point))?;
    let DepthReading::Smooth(depth_mm) = grid.reading_at_pixel(pixel) else { return None };
    let residual = normal.dot(&point) * (1.0 - depth_mm / point.z);
    Some(Constraint { point, gradient: normal, residual, sample })
}

/// Returns the constraint of an outline point: its distance outside of the nearest true border, blocks.
fn outside_distance(
    motion: &MatrixTransform,
    model: &Model,
    grid: &Grid,
    border: &Border,
    k: usize,
) -> Option<Constraint> {
    let sample = &model.outline[k];
    let point = motion.point(&sample.point);
    if (motion.turn * sample.normal).dot(&point) >= 0.0 {
        return None;
    }
    let (pixel, slope) = grid.camera.project_with_jacobian(camera_point(&point))?;
    let way = border.vector_to_border(grid.block_position(pixel))?;
    let across = outward_px(
        &(slope * (motion.turn * sample.outline_direction)),
        &(slope * (motion.turn * sample.outward_direction)),
    )?;
    let residual = -(way[0] * across.x + way[1] * across.y);
    let gradient = slope.transpose() * across / grid.factor as f64;
    Some(Constraint { point, gradient, residual, sample: k })
}

/// Returns whether points are missing just inside of the outline, so that the scan does not show whether the panel ends
/// here.
fn is_unknown_inside(motion: &MatrixTransform, model: &Model, grid: &Grid, k: usize) -> bool {
    let sample = &model.outline[k];
    let inside = motion.point(&(sample.point - sample.outward_direction * OUTLINE_INSET_MM));
    grid.camera
        .project(camera_point(&inside))
        .is_some_and(|pixel| grid.reading_at_pixel(pixel) == DepthReading::Nothing)
}

/// Returns the score of a pose: how well it explains the scan, in both directions.
fn score(
    placed: &Rigid<Camera, Panel>,
    model: &Model,
    grid: &Grid,
    piece: &Piece,
    lines: &ConstraintLines<'_>,
) -> f64 {
    let motion = MatrixTransform::from_rigid(placed);
    let chosen = spread_indices(model.points.len(), SCORE_POINT_COUNT);
    let of_point = |&i: &usize| match observe_point(&motion, model, grid, i) {
        PointObservation::On(_) => 1.0,
        // This is twice the weight of a matching point: a panel that is present cannot be seen through, while many
        // surfaces match by chance.
        PointObservation::Through => -2.0,
        PointObservation::Near | PointObservation::Hidden | PointObservation::Unknown => 0.0,
    };
    let surface = chosen.iter().map(of_point).sum::<f64>() / chosen.len() as f64;
    let edges = spread_indices(model.outline.len(), SCORE_OUTLINE_POINT_COUNT);
    let of_edge = |&k: &usize| {
        outside_distance(&motion, model, grid, &lines.border, k).map_or(0.0, |at| {
            if at.residual.abs() <= MAX_BORDER_DISTANCE_BLOCKS {
                1.0
            // The panel may end here or have no points here: the point is evidence neither for nor against the pose.
            } else if model.has_missing_parts() && is_unknown_inside(&motion, model, grid, k) {
                0.0
            } else if at.residual > 0.0 {
                -1.0
            } else {
                -0.5
            }
        })
    };
    let outline = edges.iter().map(of_edge).sum::<f64>() / edges.len() as f64;
    let covered = covered_share(&motion, model, grid, piece, 400);
    surface + outline + covered + marks_found(&motion, model, grid, lines.steps)
}

/// The observation of a taught point in a scan at a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PointObservation {
    /// The scan has the point. The value is the distance of the point in front of the scan along the normal, (1) of
    /// `grid`, mm.
    On(f64),
    /// The scan has the point beside an edge or missing points, with an imprecise depth.
    Near,
    /// The scan shows a surface behind the point: the panel is not there.
    Through,
    /// A nearer object is visible, the point faces away, or it is outside of the picture.
    Hidden,
    /// The scan has no measured depth at the point.
    Unknown,
}

/// Returns the observation of one taught point in the scan.
pub(super) fn observe_point(
    motion: &MatrixTransform,
    model: &Model,
    grid: &Grid,
    sample: usize,
) -> PointObservation {
    let point = motion.point(&model.points[sample]);
    let normal = motion.turn * model.normals[sample];
    if normal.dot(&point) >= 0.0 {
        return PointObservation::Hidden;
    }
    let look = grid
        .camera
        .project(camera_point(&point))
        .map_or(DepthReading::OutOfView, |pixel| grid.reading_at_pixel(pixel));
    let residual = |depth_mm: f64| normal.dot(&point) * (1.0 - depth_mm / point.z);
    match look {
        DepthReading::Smooth(z) if residual(z).abs() <= MAX_SURFACE_DISTANCE_MM => {
            PointObservation::On(residual(z))
        }
        DepthReading::Rough(z) if residual(z).abs() <= 2.0 * MAX_SURFACE_DISTANCE_MM => PointObservation::Near,
        DepthReading::Smooth(z) | DepthReading::Rough(z) if z > point.z => PointObservation::Through,
        DepthReading::Smooth(_) | DepthReading::Rough(_) | DepthReading::OutOfView => PointObservation::Hidden,
        DepthReading::Nothing => PointObservation::Unknown,
    }
}

/// Returns the fraction of a piece's points that the taught panel covers at a pose.
pub(super) fn covered_share(
    motion: &MatrixTransform,
    model: &Model,
    grid: &Grid,
    piece: &Piece,
    wanted: usize,
) -> f64 {
    let back = motion.inverse();
    let taught = MatrixTransform::from_rigid(&model.camera_from_panel);
    let (mut asked, mut held) = (0usize, 0usize);
    for point in points(grid, piece, piece.blocks.len() / wanted) {
        asked += 1;
        let in_panel = back.point(&point);
        let Some((there, place)) = grid_position_in(&model.grid, &taught, &in_panel) else { continue };
        held += usize::from(match model.grid.reading_at(place) {
            DepthReading::Smooth(z) | DepthReading::Rough(z) => {
                (z - there.z).abs() <= 2.0 * MAX_SURFACE_DISTANCE_MM
            }
            DepthReading::Nothing | DepthReading::OutOfView => false,
        });
    }
    held as f64 / asked.max(1) as f64
}

/// Number of marks that are searched at each shift; `SCORE_MARK_COUNT` is the number for each score.
const COARSE_MARK_COUNT: usize = 100;
const SCORE_MARK_COUNT: usize = 300;
/// Maximum shift of the panel to each side, as a fraction of its reach. `MARK_SHIFT_STEP_BLOCKS` is the step between
/// two shifts, blocks.
const MAX_RELATIVE_MARK_SHIFT: f64 = 0.35;
const MARK_SHIFT_STEP_BLOCKS: f64 = 3.0;
/// Maximum distance between a mark and a step of brightness, for the mark to be found at a shift, blocks.
const MAX_MARK_DISTANCE_BLOCKS: f64 = 2.5;
/// Maximum number of starts: those with the rotations at which the most marks are found.
const MAX_STARTS: usize = 8;

/// Returns the constraint of a mark: its distance from the nearest step of brightness, towards its brighter side,
/// blocks.
fn mark_distance(
    motion: &MatrixTransform,
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

/// Returns the fraction of the marks that are on a step of brightness; 0 if marks are not used.
fn marks_found(motion: &MatrixTransform, model: &Model, grid: &Grid, steps: Option<&MarkSteps>) -> f64 {
    let Some(steps) = steps else { return 0.0 };
    let is_on = |k: &usize| {
        mark_distance(motion, model, grid, steps, *k)
            .is_some_and(|mark| mark.residual.abs() <= MAX_BORDER_DISTANCE_BLOCKS)
    };
    let chosen = spread_indices(model.marks.points.len(), SCORE_MARK_COUNT);
    chosen.iter().filter(|k| is_on(k)).count() as f64 / chosen.len().max(1) as f64
}

/// For the best of these rotations, returns the position of the panel's centre at which the most marks are found, and
/// the rotation.
fn start_positions(
    model: &Model,
    (grid, steps): (&Grid, &MarkSteps),
    piece: &Piece,
    turns: Vec<Rotation3<f64>>,
) -> Vec<(Vector3<f64>, Rotation3<f64>)> {
    let mut found: Vec<(usize, Vector3<f64>, Rotation3<f64>)> = turns
        .into_par_iter()
        .map(|rotation| {
            let (count, shift) = best_mark_shift(model, (grid, steps), piece, &rotation);
            (count, piece.centre + shift, rotation)
        })
        .collect();
    found.sort_by_key(|(count, ..)| std::cmp::Reverse(*count));
    found.truncate(MAX_STARTS);
    found.into_iter().map(|(_, centre, rotation)| (centre, rotation)).collect()
}

/// A mark with the centre of the panel at the centre of the piece: its position, its displacement if the panel is
/// shifted by one millimetre to the right or up, and the direction of increasing brightness.
struct ShiftedMark {
    place: Vector2<f64>,
    right: Vector2<f64>,
    up: Vector2<f64>,
    brighter: Vector2<f64>,
}

/// Returns the number of marks that are found at the best shift in the plane of the piece, and this shift, mm.
fn best_mark_shift(
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
    let step_mm = MARK_SHIFT_STEP_BLOCKS * grid.factor as f64 / px_per_mm;
    let max_steps = (MAX_RELATIVE_MARK_SHIFT * piece.reach_mm / step_mm) as i32;
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
