//! The fit: moves the panel by its surface and its outline together until the pose converges.
//!
//! The surface constrains the panel along its normal and hardly in its plane: a smooth panel slides along itself. The
//! outline constrains the panel in its plane and, through the perspective of the picture, a little along the normal as
//! well. Both are residuals of one Gauss–Newton iteration (`solve`). The borders of marks inside the outline, if the
//! panel has any, are further residuals. Each kind of residual is weighted by its noise and by the number of neighbours
//! with correlated errors. The range noise of a scanner is correlated over centimetres, so thousands of points contain
//! no more information than a few dozen independent ones.
//!
//! For an assumed pose of the panel, the edge in the scan is searched beside each point of the model's outline. For
//! each taught border of a mark, the nearest step of brightness with the same sign is searched across the border. The
//! search begins near the expected position of the border and continues farther away, because the start pose of a flat
//! panel may be wrong by several pixels. If a nearer object is in front of the border, or the surface faces away, the
//! mark is treated as hidden.

use super::edges;
use super::edges::{EdgeReading, HALF_LENGTH_PX, Tangent, edge, outward_px};
use super::grid::{ColoredCloud, Grid, MatrixTransform, camera_point, spread_indices};
use super::model::Model;
use super::print_features::MarkPoint;
use super::search::surface_residual;
use super::solve::{Constraint, ResidualSums, ResidualWeighting, apply_twist, spread};
use nalgebra::Vector3;
use panelprep_base::geometry::{Camera, Panel, PinholeCamera, Pixel, Rigid};
use rayon::prelude::*;

/// Maximum displacement of any point of the panel in the last step, at which the iteration ends, mm.
pub(super) const CONVERGED_STEP_MM: f64 = 0.002;
const MAX_STEPS: usize = 20;
/// Length over which the errors of an edge in the picture are correlated, mm: the error of the edge, of the taught
/// depth, and the remaining error of the lens model.
pub(super) const EDGE_CORRELATION_MM: f64 = 30.0;
/// Standard deviation of the mean position of an edge over a length of `EDGE_CORRELATION_MM`, px, without other errors:
/// `EDGE_NOISE_PX` for an edge found by colour, `DEPTH_EDGE_NOISE_PX` for an edge found by depth.
const EDGE_NOISE_PX: f64 = 0.05;
const DEPTH_EDGE_NOISE_PX: f64 = 0.5;
/// Cutoff of the residuals, in standard deviations; larger residuals have no weight. The following constants are lower
/// limits of the cutoffs.
const CUTOFF_SIGMA: f64 = 4.7;
const MIN_SURFACE_CUTOFF_MM: f64 = 0.4;
const MIN_EDGE_CUTOFF_PX: f64 = 0.5;
const MIN_DEPTH_EDGE_CUTOFF_PX: f64 = 2.0;

/// Number of kinds of residuals: surface, edges by colour, edges by depth, marks.
pub(super) const RESIDUAL_KIND_COUNT: usize = 4;

/// All residuals of the panel at a pose.
pub(super) struct Residuals {
    pub surface: Vec<Constraint>,
    pub colour: Vec<Constraint>,
    pub depth: Vec<Constraint>,
    pub marks: Vec<Constraint>,
    /// For each examined point of the outline, its index and the result of the search for its edge.
    pub edges: Vec<(usize, EdgeReading)>,
    /// For each mark, its index and the result of the search for its step of brightness.
    pub mark_edges: Vec<(usize, EdgeReading)>,
    /// The centre of the panel.
    pub centre: Vector3<f64>,
    /// The part of the noise of an edge in this view that the noise of the taught depth causes, px.
    taught_noise_px: f64,
}

/// The inputs of a fit.
#[derive(Clone, Copy)]
pub(super) struct FitInputs<'a> {
    pub model: &'a Model,
    pub grid: &'a Grid,
    pub scan: &'a ColoredCloud,
}

/// The samples of a fit: all samples of the model, or a selection.
pub(super) struct Samples {
    surface: Vec<usize>,
    outline: Vec<usize>,
    marks: Vec<usize>,
}

impl Samples {
    pub fn all_of_model(model: &Model) -> Samples {
        Samples {
            surface: (0..model.points.len()).collect(),
            outline: (0..model.outline.len()).collect(),
            marks: (0..model.marks.points.len()).collect(),
        }
    }

    /// Returns the samples of the surface only, without outline and marks.
    pub fn surface_only(&self) -> Samples {
        Samples { surface: self.surface.clone(), outline: Vec::new(), marks: Vec::new() }
    }

    /// Selects about `wanted` samples of the surface, and an eighth of this number of the outline and of the marks.
    pub fn subset(model: &Model, wanted: usize) -> Samples {
        Samples {
            surface: spread_indices(model.points.len(), wanted),
            outline: spread_indices(model.outline.len(), wanted / 8),
            marks: spread_indices(model.marks.points.len(), wanted / 8),
        }
    }
}

impl Residuals {
    /// Computes the residuals at a pose.
    pub fn at_pose(placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>, samples: &Samples) -> Residuals {
        let motion = MatrixTransform::from_rigid(placed);
        let FitInputs { model, grid, scan } = inputs;
        let surface: Vec<Option<Constraint>> = samples
            .surface
            .par_iter()
            .with_min_len(1_024)
            .map(|&sample| surface_residual(&motion, model, grid, sample))
            .collect();
        let looked: Vec<Option<EdgeObservation>> = samples
            .outline
            .par_iter()
            .with_min_len(64)
            .map(|&k| observe_edge(&motion, model, &grid.camera, scan, k))
            .collect();
        let (mut colour, mut depth, mut edges) = (Vec::new(), Vec::new(), Vec::new());
        for (&sample, looked) in samples.outline.iter().zip(looked) {
            let Some(looked) = looked else { continue };
            edges.push((sample, looked.edge));
            let (point, gradient) = (looked.point, looked.gradient);
            let constraint = |offset_px: f64| Constraint { point, gradient, residual: -offset_px, sample };
            match looked.edge {
                EdgeReading::Colour { offset_px, .. } if model.outline[sample].by_colour => {
                    colour.push(constraint(offset_px))
                }
                EdgeReading::Colour { offset_px, .. } | EdgeReading::Depth { offset_px } => {
                    depth.push(constraint(offset_px))
                }
                EdgeReading::Hidden | EdgeReading::OutOfView | EdgeReading::Absent => {}
            }
        }
        let (marks, mark_edges) = marks_at_pose(&motion, inputs, &samples.marks);
        let centre = motion.point(&model.centre);
        // If the panel is seen from another direction than at teaching, an error of the taught depth shifts the outline
        // sideways in the picture.
        let taught_noise_px =
            model.range.taught_scan_mm * model.view_change(&motion) * grid.camera.px_per_mm_at(centre.z).0;
        let surface = surface.into_iter().flatten().collect();
        Residuals { surface, colour, depth, marks, edges, mark_edges, centre, taught_noise_px }
    }

    /// Returns the weights of each kind of residual: surface, edges by colour, edges by depth, marks.
    pub fn residual_weights(&self, model: &Model, samples: &Samples) -> [ResidualWeighting; RESIDUAL_KIND_COUNT] {
        let point_mm2 = model.area_mm2 / samples.surface.len().max(1) as f64;
        let length_mm: f64 = model.outline.iter().map(|sample| sample.length_mm).sum();
        let edge_mm = length_mm / samples.outline.len().max(1) as f64;
        let edge_correlated_count = (EDGE_CORRELATION_MM / edge_mm).max(1.0);
        // With fewer samples, fewer neighbours have a common error; without this factor a selection would have less
        // weight than all samples.
        let marks_taken = samples.marks.len() as f64 / model.marks.points.len().max(1) as f64;
        // The cutoff is proportional to the spread of the residuals, which is large at the start and small at the end.
        // With the lower limit, a perfect fit does not reject its own noise.
        let reach = |constraints: &[Constraint], floor: f64| (CUTOFF_SIGMA * spread(constraints)).max(floor);
        [
            ResidualWeighting {
                sigma: model.range.scan_to_scan_mm,
                correlated_count: (model.range.correlation_mm.powi(2) / point_mm2).max(1.0),
                cutoff: reach(&self.surface, MIN_SURFACE_CUTOFF_MM),
            },
            ResidualWeighting {
                sigma: EDGE_NOISE_PX.hypot(self.taught_noise_px),
                correlated_count: edge_correlated_count,
                cutoff: reach(&self.colour, MIN_EDGE_CUTOFF_PX),
            },
            ResidualWeighting {
                sigma: DEPTH_EDGE_NOISE_PX.hypot(self.taught_noise_px),
                correlated_count: edge_correlated_count,
                cutoff: reach(&self.depth, MIN_DEPTH_EDGE_CUTOFF_PX),
            },
            ResidualWeighting {
                sigma: EDGE_NOISE_PX.hypot(self.taught_noise_px),
                correlated_count: (model.marks.correlated_count * marks_taken).max(1.0),
                cutoff: reach(&self.marks, MIN_EDGE_CUTOFF_PX),
            },
        ]
    }

    /// Returns the constraints of every kind, in the order of [`Residuals::residual_weights`].
    pub fn kinds(&self) -> [&[Constraint]; RESIDUAL_KIND_COUNT] {
        [&self.surface, &self.colour, &self.depth, &self.marks]
    }

    /// Calculates the sums over the constraints of all kinds.
    pub fn sum_all(&self, weighing: &[ResidualWeighting; RESIDUAL_KIND_COUNT]) -> ResidualSums {
        self.kinds()
            .iter()
            .zip(weighing)
            .map(|(kind, weighing)| ResidualSums::from_constraints(kind, weighing, &self.centre))
            .fold(ResidualSums::ZERO, ResidualSums::add)
    }
}

/// Returns the constraints by the visible marks, and the result of the search for the edge of each mark.
fn marks_at_pose(
    motion: &MatrixTransform,
    FitInputs { model, grid, scan }: FitInputs<'_>,
    samples: &[usize],
) -> (Vec<Constraint>, Vec<(usize, EdgeReading)>) {
    let observe =
        |&mark: &usize| Some((mark, observe_mark(motion, &model.marks.points[mark], &grid.camera, scan)?));
    let looked: Vec<_> = samples.par_iter().with_min_len(64).filter_map(observe).collect();
    let constraint = |(sample, looked): &(usize, EdgeObservation)| match looked.edge {
        EdgeReading::Colour { offset_px, .. } => {
            let (point, gradient) = (looked.point, looked.gradient);
            Some(Constraint { point, gradient, residual: -offset_px, sample: *sample })
        }
        _ => None,
    };
    let constraints = looked.iter().filter_map(constraint).collect();
    (constraints, looked.iter().map(|(mark, looked)| (*mark, looked.edge)).collect())
}

/// The state of the fit after its last iteration.
#[derive(Debug, Clone, Copy)]
pub(super) struct FitState {
    pub camera_from_panel: Rigid<Camera, Panel>,
    pub iterations: usize,
    pub last_step_mm: f64,
}

/// Fits the pose, starting with the guess, until a step moves the panel by less than the limit; `None` if a direction
/// is unconstrained.
pub(super) fn fit(guess: &Rigid<Camera, Panel>, inputs: FitInputs<'_>, samples: &Samples) -> Option<FitState> {
    let mut fitted = FitState { camera_from_panel: *guess, iterations: 0, last_step_mm: f64::INFINITY };
    while fitted.iterations < MAX_STEPS && fitted.last_step_mm > CONVERGED_STEP_MM {
        let residuals = Residuals::at_pose(&fitted.camera_from_panel, inputs, samples);
        // The weights are computed again in each step: the cutoff decreases with the residuals, so that outliers lose
        // their influence as the fit improves.
        let weighing = residuals.residual_weights(inputs.model, samples);
        let twist = residuals.sum_all(&weighing).twist()?;
        let next = apply_twist(&fitted.camera_from_panel, &residuals.centre, &twist);
        fitted.last_step_mm = inputs.model.largest_distance_mm(&fitted.camera_from_panel, &next);
        fitted.camera_from_panel = next;
        fitted.iterations += 1;
    }
    Some(fitted)
}

/// A point of the outline, and the edge that the scan shows beside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeObservation {
    pub point: Vector3<f64>,
    /// Gradient of the residual across the outline in the picture, px per mm.
    pub gradient: Vector3<f64>,
    pub edge: EdgeReading,
}

/// Searches for the edge beside a point of the outline.
pub(super) fn observe_edge(
    motion: &MatrixTransform,
    model: &Model,
    camera: &PinholeCamera,
    scan: &ColoredCloud,
    k: usize,
) -> Option<EdgeObservation> {
    let sample = &model.outline[k];
    let point = motion.point(&sample.point);
    let (pixel, slope) = camera.project_with_jacobian(camera_point(&point))?;
    let outward = motion.turn * sample.outward_direction;
    let across = outward_px(&(slope * (motion.turn * sample.outline_direction)), &(slope * outward))?;
    let px_per_mm = across.dot(&(slope * outward));
    let gradient = slope.transpose() * across;
    let looks_away = (motion.turn * sample.normal).dot(&point) > -0.1 * point.norm() || px_per_mm < 0.1;
    let edge = if looks_away {
        EdgeReading::Hidden
    } else {
        let tangent = Tangent::new(camera, pixel, &point, &(motion.turn * sample.normal));
        edge(scan, (pixel, across), &tangent, model.has_missing_parts())
    };
    Some(EdgeObservation { point, gradient, edge })
}

/// Distances from the expected position at which a step is searched, px, in this order; each search finds steps within
/// 3 px.
const SEARCH_OFFSETS_PX: [f64; 5] = [0.0, -3.0, 3.0, -6.0, 6.0];
/// Minimum cosine of the incidence angle at which a mark is evaluated: a surface that is seen at a flatter angle shows
/// no marks.
const MIN_INCIDENCE_COSINE: f64 = 0.1;
/// Minimum distance of another object in front of the panel, mm.
const MIN_OCCLUDER_DISTANCE_MM: f64 = 3.0;

/// Searches for the step of brightness at the border of a mark.
pub(super) fn observe_mark(
    motion: &MatrixTransform,
    mark: &MarkPoint,
    camera: &PinholeCamera,
    scan: &ColoredCloud,
) -> Option<EdgeObservation> {
    let point = motion.point(&mark.point);
    let (pixel, slope) = camera.project_with_jacobian(camera_point(&point))?;
    let brighter = slope * (motion.turn * mark.brighter_direction);
    let across = outward_px(&(slope * (motion.turn * mark.border_direction)), &brighter)?;
    let gradient = slope.transpose() * across;
    let normal = motion.turn * mark.normal;
    let is_averted = normal.dot(&point) > -MIN_INCIDENCE_COSINE * point.norm();
    let edge = if is_averted || is_covered(scan, pixel, &Tangent::new(camera, pixel, &point, &normal)) {
        EdgeReading::Hidden
    } else {
        step_across(scan, pixel, [across.x, across.y])
    };
    Some(EdgeObservation { point, gradient, edge })
}

/// Returns whether the scan has a nearer object at this pixel. A missing point is not treated as an obstacle.
fn is_covered(scan: &ColoredCloud, pixel: Pixel, tangent: &Tangent) -> bool {
    let Some((column, row)) = pixel.nearest_whole(scan.width(), scan.height()) else { return false };
    let [_, _, z] = scan.raw_points_mm()[row * scan.width() + column];
    !z.is_nan() && tangent.depth_behind_mm(column, row, f64::from(z)) < -MIN_OCCLUDER_DISTANCE_MM
}

fn step_across(scan: &ColoredCloud, pixel: Pixel, across: [f64; 2]) -> EdgeReading {
    let margin = HALF_LENGTH_PX as f64 + 1.0;
    let (width, height) = (scan.width() as f64, scan.height() as f64);
    if !(pixel.u >= margin && pixel.v >= margin && pixel.u < width - margin && pixel.v < height - margin) {
        return EdgeReading::OutOfView;
    }
    let Some(line) = edges::line(scan, pixel, across) else { return EdgeReading::OutOfView };
    let near = |&expected_px: &f64| edges::step(&line, expected_px).filter(|step| step.contrast > 0.0);
    match SEARCH_OFFSETS_PX.iter().find_map(near) {
        Some(step) => EdgeReading::Colour { offset_px: step.offset_px, width_px: step.width_px },
        None => EdgeReading::Absent,
    }
}
