//! The least-squares B-spline surface of a taught region, with its deviation.
//!
//! Minimises Σ_q w_q |S(u_q, v_q) − P_q|² over the control points (Eq. 4.12), P_q the scan's points. A point bears on
//! the (k + 1)(l + 1) control points of its span alone, so the normal equations are banded. They are summed span by
//! span and folded in order: the result is the same for any number of threads. With r_q the deviation along the
//! normal and σ = 1.4826 · median |r| of a first fit with w = 1, the second and last fit has Tukey's weights
//!     w = (1 − (r / c)²)² for |r| < c = 4.685 σ, else 0:
//! flying points lose their say. A point of weight 0 counts as missing. Where points are missing nothing is invented:
//! a hole of the size of a span is an error.
//! Source of the weights: Beaton & Tukey, Technometrics 16(2), 1974.

use super::banded::BandMatrix;
use super::basis::{KnotError, KnotVector, Local};
use super::bspline::{BSplineSurface, Parameter, SurfaceError};
use super::samples::{Cell, gather, knots};
use crate::geometry::{Panel, Pixel, Point};
use crate::panel::{Region, TaughtPanel};
use crate::recipe;
use nalgebra::{Point2, Vector3};
use rayon::prelude::*;

/// Degree along u and v.
pub(super) const DEGREE: usize = 3;
/// Control points that a span bears on, along one parameter.
const SIDE: usize = DEGREE + 1;
/// Control points that a span bears on.
const LOCAL: usize = SIDE * SIDE;
/// Tukey's constant: 95 % as efficient as plain least squares on normal noise.
const TUKEY: f64 = 4.685;
/// No 3D camera is more exact than this, mm: keeps σ from zero on data without noise.
const MIN_SCALE_MM: f64 = 0.001;
/// Fewer pixels in a span do not determine it.
const MIN_PIXELS: usize = LOCAL;
/// A span with a smaller share of its pixels is a hole.
const MIN_SPAN_SHARE: f64 = 0.25;

/// How far the scan lies from the surface, along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Points in the fit, rejected ones not counted.
    pub points: usize,
    /// Points of the region with weight zero: farther off than 4.685 σ.
    pub rejected: usize,
    /// Root mean square over the points in the fit, mm.
    pub rms_mm: f64,
    /// Below this lie 95 % of the points in the fit, mm.
    pub p95_mm: f64,
    /// The largest of the points in the fit, mm.
    pub largest_mm: f64,
    /// Pixels of the region without a point, or with a rejected one, percent.
    pub missing_percent: f64,
}

/// A surface with the evidence for it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The surface; the region is its unit square.
    pub surface: BSplineSurface,
    /// How well it lies in the scan.
    pub deviation: Deviation,
}

/// Why a scan gives no surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// No point of the panel in the region.
    #[error("the region has no scan points; scan again or move the region")]
    NoPoints,
    /// The control points are closer than the scan's.
    #[error(
        "a span of {spacing_mm} mm has only {pixels} pixels at ({:.0}, {:.0}) px, needed are {MIN_PIXELS}; raise \
         [surface] control_spacing_mm", at.u, at.v
    )]
    TooFine {
        /// The recipe's spacing, mm.
        spacing_mm: f64,
        /// Pixels in the poorest span.
        pixels: usize,
        /// Its middle in the taught picture.
        at: Pixel,
    },
    /// A hole as large as a span.
    #[error(
        "the scan has a hole at ({:.0}, {:.0}) px: {found_percent:.0} % of the pixels there have a point, needed are \
         {:.0} %; scan again or move the region", at.u, at.v, 100.0 * MIN_SPAN_SHARE
    )]
    Hole {
        /// The middle of the span in the taught picture.
        at: Pixel,
        /// Pixels of the span that have a point, percent.
        found_percent: f64,
    },
    /// Too much is missing.
    #[error(
        "{percent:.1} % of the region have no point that fits the surface, [surface] max_missing_percent allows \
         {limit_percent}"
    )]
    Missing {
        /// Share found, percent.
        percent: f64,
        /// Share allowed, percent.
        limit_percent: f64,
    },
    /// The points do not determine a control point.
    #[error("the scan does not determine the surface near ({:.0}, {:.0}) px; scan again", at.u, at.v)]
    Undetermined {
        /// The control point's place in the taught picture.
        at: Pixel,
    },
    /// The surface turns its back to the camera.
    #[error("the surface folds at ({:.0}, {:.0}) px: its normal turns away from the camera", at.u, at.v)]
    Fold {
        /// Where, in the taught picture.
        at: Pixel,
    },
    /// The deviation is too large.
    #[error(
        "the scan lies {rms_mm:.3} mm rms off the surface, [surface] max_rms_mm allows {limit_mm}; a smaller \
         control_spacing_mm follows a rougher panel"
    )]
    PoorFit {
        /// Deviation, mm.
        rms_mm: f64,
        /// Deviation allowed, mm.
        limit_mm: f64,
    },
    /// The control points make no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// The region makes no knots.
    #[error(transparent)]
    Knots(#[from] KnotError),
}

/// Fits the surface of the panel's region.
///
/// # Errors
/// Where the scan has holes, does not determine the surface, or deviates from it by more than the recipe allows.
pub fn fit(panel: &TaughtPanel, settings: &recipe::Surface) -> Result<Fit, FitError> {
    let knots = knots(panel, settings.control_spacing_mm())?;
    let cells = gather(panel, &knots);
    refuse_missing(&cells, 0, settings)?;
    refuse_holes(&cells, &knots, &panel.region, settings)?;
    let viewer = panel.panel_from_camera.origin();

    let alike = cells.iter().map(|cell| vec![1.0; cell.samples.len()]).collect();
    let first = solve(&cells, alike, &knots, &panel.region, viewer)?;
    let first_residuals = residuals(&cells, &first, &panel.region, viewer)?;
    let scale_mm = scale_mm(&first_residuals);
    let weigh = |residuals: Vec<f64>| residuals.into_iter().map(|r| tukey(r / scale_mm)).collect::<Vec<_>>();
    let weights = first_residuals.into_iter().map(weigh).collect();
    let surface = solve(&cells, weights, &knots, &panel.region, viewer)?;
    let deviation = deviation(&cells, residuals(&cells, &surface, &panel.region, viewer)?, scale_mm);

    refuse_missing(&cells, deviation.rejected, settings)?;
    if deviation.rms_mm > settings.max_rms_mm() {
        return Err(FitError::PoorFit { rms_mm: deviation.rms_mm, limit_mm: settings.max_rms_mm() });
    }
    Ok(Fit { surface, deviation })
}

fn missing_percent(cells: &[Cell], rejected: usize) -> f64 {
    let pixels: usize = cells.iter().map(|cell| cell.pixels).sum();
    let points: usize = cells.iter().map(|cell| cell.points).sum();
    100.0 * (1.0 - points.saturating_sub(rejected) as f64 / pixels.max(1) as f64)
}

fn refuse_missing(cells: &[Cell], rejected: usize, settings: &recipe::Surface) -> Result<(), FitError> {
    let (percent, limit_percent) = (missing_percent(cells, rejected), settings.max_missing_percent());
    if percent > limit_percent { Err(FitError::Missing { percent, limit_percent }) } else { Ok(()) }
}

fn refuse_holes(
    cells: &[Cell],
    [knots_u, knots_v]: &[KnotVector; 2],
    region: &Region,
    settings: &recipe::Surface,
) -> Result<(), FitError> {
    for (index, cell) in cells.iter().enumerate() {
        let middle = |knots: &KnotVector, span: usize| {
            let domain = knots.domain();
            domain.start() + (domain.end() - domain.start()) * (span as f64 + 0.5) / knots.spans() as f64
        };
        let (span_u, span_v) = (index / knots_v.spans(), index % knots_v.spans());
        let at = region.pixel(Point2::new(middle(knots_u, span_u), middle(knots_v, span_v)));
        if cell.pixels < MIN_PIXELS {
            return Err(FitError::TooFine { spacing_mm: settings.control_spacing_mm(), pixels: cell.pixels, at });
        }
        let share = cell.points as f64 / cell.pixels as f64;
        if share < MIN_SPAN_SHARE {
            return Err(FitError::Hole { at, found_percent: 100.0 * share });
        }
    }
    Ok(())
}

/// Pairs of functions of one span along one parameter, (0, 0), (1, 0), (1, 1), (2, 0) …
const PAIRS: usize = SIDE * (SIDE + 1) / 2;

/// What one span adds to the normal equations: with N_n = N_a(u) N_b(v) the sums of N_n N_m are those of the products
/// of a pair along u with a pair along v.
struct Block {
    pairs: [[f64; PAIRS]; PAIRS],
    right: [Vector3<f64>; LOCAL],
}

impl Block {
    fn of(cell: &Cell, weights: &[f64], [knots_u, knots_v]: &[KnotVector; 2]) -> Self {
        let mut block = Block { pairs: [[0.0; PAIRS]; PAIRS], right: [Vector3::zeros(); LOCAL] };
        for (sample, weight) in cell.samples.iter().zip(weights) {
            let (u, v) = (knots_u.values(sample.at.u), knots_v.values(sample.at.v));
            let pairs_v = pairs(&v);
            for (sums, pair_u) in block.pairs.iter_mut().zip(pairs(&u)) {
                let weighted = weight * pair_u;
                for (sum, pair_v) in sums.iter_mut().zip(&pairs_v) {
                    *sum += weighted * pair_v;
                }
            }
            for (n, sum) in block.right.iter_mut().enumerate() {
                *sum += sample.mm * (weight * u[n / SIDE] * v[n % SIDE]);
            }
        }
        block
    }

    /// Σ w N_n N_m.
    fn gram(&self, n: usize, m: usize) -> f64 {
        let pair = |a: usize, b: usize| a.max(b) * (a.max(b) + 1) / 2 + a.min(b);
        self.pairs[pair(n / SIDE, m / SIDE)][pair(n % SIDE, m % SIDE)]
    }
}

fn pairs(values: &Local) -> [f64; PAIRS] {
    let mut pairs = [0.0; PAIRS];
    let mut next = 0;
    for a in 0..SIDE {
        for b in 0..=a {
            pairs[next] = values[a] * values[b];
            next += 1;
        }
    }
    pairs
}

fn solve(
    cells: &[Cell],
    weights: Vec<Vec<f64>>,
    knots: &[KnotVector; 2],
    region: &Region,
    viewer: Point<Panel>,
) -> Result<BSplineSurface, FitError> {
    let blocks: Vec<Block> =
        cells.par_iter().zip(weights).map(|(cell, weights)| Block::of(cell, &weights, knots)).collect();
    let (spans_v, stride) = (knots[1].spans(), knots[1].controls());
    let size = knots[0].controls() * stride;
    let mut matrix = BandMatrix::zeros(size, DEGREE * (stride + 1));
    let mut right = vec![Vector3::zeros(); size];
    for (index, block) in blocks.iter().enumerate() {
        let control = |n: usize| (index / spans_v + n / SIDE) * stride + index % spans_v + n % SIDE;
        for n in 0..LOCAL {
            right[control(n)] += block.right[n];
            for m in 0..=n {
                matrix.add(control(n), control(m), block.gram(n, m));
            }
        }
    }
    let undetermined = |row: usize| {
        let share = |index: usize, knots: &KnotVector| index as f64 / (knots.controls() - 1) as f64;
        let unit = Point2::new(share(row / stride, &knots[0]), share(row % stride, &knots[1]));
        FitError::Undetermined { at: region.pixel(unit) }
    };
    let controls = matrix.solve(right).map_err(undetermined)?;
    let controls = controls.into_iter().map(|mm| Point::new(mm.into())).collect();
    Ok(BSplineSurface::new(knots.clone(), controls, viewer)?)
}

/// Deviation of each sample along the surface's normal, mm, span by span.
fn residuals(
    cells: &[Cell],
    surface: &BSplineSurface,
    region: &Region,
    viewer: Point<Panel>,
) -> Result<Vec<Vec<f64>>, FitError> {
    let residual = |at: Parameter, mm: Vector3<f64>| {
        let tangents = surface.tangents(at);
        let seen = surface
            .normal_of(&tangents)
            .filter(|normal| normal.mm.dot(&(viewer - tangents.point).mm) > 0.0)
            .ok_or_else(|| FitError::Fold { at: region.pixel(Point2::new(at.u, at.v)) });
        Ok(seen?.mm.dot(&(mm - tangents.point.mm.coords)))
    };
    let of_cell = |cell: &Cell| cell.samples.iter().map(|sample| residual(sample.at, sample.mm)).collect();
    let of_cells: Vec<Result<Vec<f64>, FitError>> = cells.par_iter().map(of_cell).collect();
    of_cells.into_iter().collect()
}

/// σ of normal noise with the same median deviation, mm.
fn scale_mm(residuals: &[Vec<f64>]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().flatten().map(|r| r.abs()).collect();
    (1.4826 * quantile(&mut sizes, 0.5)).max(MIN_SCALE_MM)
}

fn tukey(deviation_in_sigma: f64) -> f64 {
    let inner = 1.0 - (deviation_in_sigma / TUKEY).powi(2);
    if inner > 0.0 { inner * inner } else { 0.0 }
}

fn deviation(cells: &[Cell], residuals: Vec<Vec<f64>>, scale_mm: f64) -> Deviation {
    let limit_mm = TUKEY * scale_mm;
    let all = || cells.iter().zip(&residuals).flat_map(|(cell, sizes)| cell.samples.iter().zip(sizes));
    let mut kept: Vec<f64> = all().map(|(_, r)| r.abs()).filter(|size| *size < limit_mm).collect();
    let rejected = all().filter(|(sample, r)| sample.in_region() && r.abs() >= limit_mm).count();
    Deviation {
        points: kept.len(),
        rejected,
        rms_mm: (kept.iter().map(|r| r * r).sum::<f64>() / kept.len().max(1) as f64).sqrt(),
        p95_mm: quantile(&mut kept, 0.95),
        largest_mm: kept.iter().copied().fold(0.0, f64::max),
        missing_percent: missing_percent(cells, rejected),
    }
}

/// The value below which this share of the values lies; 0 of none. Reorders them.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let index = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(index, f64::total_cmp).1
}
