//! Fits the surface of a taught region, and computes the scan's deviation from the surface.
//!
//! The fit minimises Σ_q w_q |S(u_q, v_q) − P_q|² over the control points (Eq. 4.12), with P_q the scan's points,
//! smoothed as the noise requires (`equations`). A point affects only the (k + 1)(l + 1) control points of its span, so
//! the normal equations are banded. They are summed over bands of the picture in a fixed order: the result is the same
//! for any number of threads. With r_q the deviation along the normal and σ = 1.4826 · median |r|, points have Tukey's
//! weights
//!     w = (1 − (r / c)²)² for |r| < c = 4.685 σ, else 0.
//! The first fit has w = 1; the fit is then repeated until σ converges, so that outliers have no influence. A point of
//! weight 0 is treated as missing. The white noise is calculated from second differences of r between adjacent pixels,
//! which neither a smooth misfit nor a smooth error of the camera affects. Missing points are not filled in: a hole
//! larger than the recipe's limit is an error, and so are a fold and a poor fit. Source of the weights: Beaton & Tukey,
//! Technometrics 16(2), 1974.

use super::bspline::BSplineSurface;
use super::equations::{Solution, SurfaceEquations};
use super::map::{DeviationMap, MapPixel};
use super::samples::{FitError, MIN_PIXELS, Sample, Samples, knots, sides_mm, thesis_controls, thesis_knots};
use nalgebra::{Point2, Vector3};
use panelprep_base::geometry::basis::KnotVector;
use panelprep_base::geometry::statistics::{
    QuantileRank, SIGMA_OF_MEDIAN, TUKEY_CONSTANT, quantile, rms, tukey_weight,
};
use panelprep_base::geometry::{Panel, Pixel, Point, median};
use panelprep_cell::panel::{Region, TaughtPanel};
use panelprep_cell::recipe::{self, FitMethod};
use rayon::prelude::*;

/// Minimum value of σ, mm: no 3D camera is more accurate. The limit prevents a σ of zero for data without noise.
const MIN_SCALE_MM: f64 = 0.001;
/// Maximum number of weighted fits; two are usual.
const MAX_ROUNDS: usize = 4;
/// Minimum ratio of σ to its previous value at which the iteration ends.
const CONVERGENCE_RATIO: f64 = 0.9;

/// Statistics of the scan's distance from the surface, along the surface's normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Number of points in the fit, without rejected points.
    pub points: usize,
    /// Number of rejected points of the region: their weight is zero, because they are farther from the surface than
    /// 4.685 σ.
    pub rejected: usize,
    /// Root mean square over the points in the fit, mm.
    pub rms_mm: f64,
    /// 95 % quantile of the distance over the points in the fit, mm.
    pub p95_mm: f64,
    /// The largest distance of a point in the fit, mm.
    pub largest_mm: f64,
    /// White noise of the scan along the normal, σ, mm. If the surface is perfect, `rms_mm` equals this value.
    pub noise_mm: f64,
    /// The smoothing λ that this noise required, relative to the data; 0 in the thesis's method.
    pub smoothing: f64,
    /// Pixels of the region without a point, or with a rejected point, percent.
    pub missing_percent: f64,
    /// Side of the largest square of the region without a point, mm.
    pub largest_hole_mm: f64,
}

/// A fitted surface with the scan's deviation from the surface.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The surface; the region is the unit square of its parameters.
    pub surface: BSplineSurface,
    /// Statistics of the scan's deviation from the surface.
    pub deviation: Deviation,
    /// The deviation of each pixel.
    pub map: DeviationMap,
}

/// A rejected fit, with the map that shows where the fit fails.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    /// The reason why the fit was rejected.
    pub error: FitError,
    /// The deviation of each pixel; `None` if it was not computed.
    pub map: Option<DeviationMap>,
}

/// Fits the surface of the panel's region.
///
/// # Errors
/// If the scan has holes, does not determine the surface, or deviates from the surface by more than the recipe's limit.
pub fn fit(panel: &TaughtPanel, settings: &recipe::Surface) -> Result<Fit, FitError> {
    examine_fit(panel, settings).map_err(|refusal| refusal.error)
}

/// Fits the surface of the panel's region; an error contains the map of the deviation.
///
/// # Errors
/// The errors of [`fit`].
pub fn examine_fit(panel: &TaughtPanel, settings: &recipe::Surface) -> Result<Fit, Box<Refusal>> {
    let early = |error: FitError| Box::new(Refusal { error, map: None });
    let sides_mm = sides_mm(panel).map_err(early)?;
    let knots = match settings.method() {
        FitMethod::LeastSquares => knots(sides_mm, settings.control_spacing_mm()),
        FitMethod::Thesis => thesis_knots(sides_mm, settings.control_spacing_mm()),
    };
    let samples = Samples::collect(panel, &knots.map_err(|error| early(error.into()))?);
    let look = FitInputs {
        samples: &samples,
        region: &panel.region,
        viewer: panel.panel_from_camera.origin(),
        sides_mm,
        settings,
    };
    let seen = look.map(None);
    look.fit(panel, &seen).map_err(|(error, map)| Box::new(Refusal { error, map: Some(map.unwrap_or(seen)) }))
}

/// The inputs of one fit.
struct FitInputs<'a> {
    samples: &'a Samples,
    region: &'a Region,
    viewer: Point<Panel>,
    sides_mm: [f64; 2],
    settings: &'a recipe::Surface,
}

impl FitInputs<'_> {
    fn fit(&self, panel: &TaughtPanel, seen: &DeviationMap) -> Result<Fit, (FitError, Option<DeviationMap>)> {
        let early = |error| (error, None);
        self.refuse_missing(0).map_err(early)?;
        self.refuse_fine().map_err(early)?;
        self.refuse_hole(seen).map_err(early)?;
        let (surface, smoothing) = match self.settings.method() {
            FitMethod::LeastSquares => self.fit_robust().map_err(early)?,
            FitMethod::Thesis => {
                let controls = thesis_controls(panel, &self.samples.knots).map_err(early)?;
                (self.surface(controls).map_err(early)?, 0.0)
            }
        };
        let residuals = self.residuals(&surface).map_err(early)?;
        let limit_mm = TUKEY_CONSTANT * scale_mm(&residuals);
        let map = self.map(Some((&residuals, limit_mm)));
        let mut deviation = self.deviation(&residuals, limit_mm);
        deviation.smoothing = smoothing;
        deviation.largest_hole_mm = self.largest_hole_in(&map).0;
        let judged = self.refuse_missing(deviation.rejected).and_then(|()| self.refuse_hole(&map)).and_then(|()| {
            let (rms_mm, limit_mm, noise_mm) = (deviation.rms_mm, self.settings.max_rms_mm(), deviation.noise_mm);
            if rms_mm > limit_mm { Err(FitError::PoorFit { rms_mm, limit_mm, noise_mm }) } else { Ok(()) }
        });
        match judged {
            Ok(()) => Ok(Fit { surface, deviation, map }),
            Err(error) => Err((error, Some(map))),
        }
    }

    /// Fits the surface with Tukey's weights until σ converges; also returns σ, mm.
    fn fit_robust(&self) -> Result<(BSplineSurface, f64), FitError> {
        let all = || self.samples.bands.iter().map(|band| band.iter().map(|_| 1.0).collect());
        let centre = self.samples.bands.iter().flatten().next().map_or(Vector3::zeros(), |sample| sample.mm);
        let equations = |weights: &[Vec<f64>]| SurfaceEquations::from_samples(self.samples, weights, centre);
        let plain = equations(&all().collect::<Vec<_>>())
            .solve_with_least_smoothing()
            .map_err(|row| self.undetermined_error(row))?;
        let mut residuals = self.residuals(&self.surface(plain.controls)?)?;
        let mut scale = scale_mm(&residuals);
        let mut round = 0;
        loop {
            round += 1;
            let weigh = |r: &f64| tukey_weight(r / scale);
            let weights: Vec<Vec<f64>> =
                residuals.par_iter().map(|band| band.iter().map(weigh).collect()).collect();
            let noise_mm = noise_mm(self.samples, &residuals);
            let solution =
                equations(&weights).solve_smoothed(noise_mm).map_err(|row| self.undetermined_error(row))?;
            let Solution { controls, smoothing } = solution;
            let surface = self.surface(controls)?;
            if round == MAX_ROUNDS {
                return Ok((surface, smoothing));
            }
            residuals = self.residuals(&surface)?;
            let next = scale_mm(&residuals);
            if next > CONVERGENCE_RATIO * scale {
                return Ok((surface, smoothing));
            }
            scale = next;
        }
    }

    fn surface(&self, controls: Vec<Vector3<f64>>) -> Result<BSplineSurface, FitError> {
        let controls = controls.into_iter().map(|mm| Point::new(mm.into())).collect();
        Ok(BSplineSurface::new(self.samples.knots.clone(), controls, self.viewer)?)
    }

    fn undetermined_error(&self, row: usize) -> FitError {
        let [knots_u, knots_v] = &self.samples.knots;
        let share = |index: usize, knots: &KnotVector| index as f64 / (knots.controls() - 1) as f64;
        let (i, j) = (row / knots_v.controls(), row % knots_v.controls());
        FitError::Undetermined { at: self.region.pixel(Point2::new(share(i, knots_u), share(j, knots_v))) }
    }

    /// Computes the deviation of each sample along the surface's normal, mm, for each band of the picture.
    fn residuals(&self, surface: &BSplineSurface) -> Result<Vec<Vec<f64>>, FitError> {
        let residual = |sample: &Sample| {
            let at = self.samples.sample_parameter(sample);
            let tangents = surface.tangents(at);
            let seen = surface
                .unit_normal(&tangents)
                .filter(|normal| normal.mm.dot(&(self.viewer - tangents.point).mm) > 0.0)
                .ok_or_else(|| FitError::Fold { at: self.region.pixel(Point2::new(at.u, at.v)) });
            Ok(seen?.mm.dot(&(sample.mm - tangents.point.mm.coords)))
        };
        let of_band = |band: &Vec<Sample>| band.iter().map(residual).collect::<Result<Vec<f64>, FitError>>();
        let of_bands: Vec<_> = self.samples.bands.par_iter().map(of_band).collect();
        of_bands.into_iter().collect()
    }

    fn missing_percent(&self, rejected: usize) -> f64 {
        let pixels: usize = self.samples.pixels.iter().sum();
        100.0 * (1.0 - self.samples.points.saturating_sub(rejected) as f64 / pixels.max(1) as f64)
    }

    fn refuse_missing(&self, rejected: usize) -> Result<(), FitError> {
        if self.samples.points == 0 {
            return Err(FitError::NoPoints);
        }
        let (percent, limit_percent) = (self.missing_percent(rejected), self.settings.max_missing_percent());
        if percent > limit_percent { Err(FitError::Missing { percent, limit_percent }) } else { Ok(()) }
    }

    fn refuse_fine(&self) -> Result<(), FitError> {
        let poorest = self.samples.pixels.iter().enumerate().find(|(_, pixels)| **pixels < MIN_PIXELS);
        let Some((cell, pixels)) = poorest else { return Ok(()) };
        let at = self.samples.span_centre(cell, self.region);
        Err(FitError::TooFine { spacing_mm: self.settings.control_spacing_mm(), pixels: *pixels, at })
    }

    fn largest_hole_in(&self, map: &DeviationMap) -> (f64, Pixel) {
        let (side_px, at) = map.largest_hole();
        (side_px as f64 * map.mm_per_px, at)
    }

    fn refuse_hole(&self, map: &DeviationMap) -> Result<(), FitError> {
        let ((size_mm, at), limit_mm) = (self.largest_hole_in(map), self.settings.max_hole_mm());
        if size_mm > limit_mm { Err(FitError::Hole { at, size_mm, limit_mm }) } else { Ok(()) }
    }

    /// Returns the state of each pixel. If residuals are given, the state contains the pixel's distance from the
    /// surface.
    fn map(&self, residuals: Option<(&[Vec<f64>], f64)>) -> DeviationMap {
        let samples = self.samples;
        let of_pixel = |inside: &bool| if *inside { MapPixel::Missing } else { MapPixel::Outside };
        let mut pixels: Vec<MapPixel> = samples.inside.iter().map(of_pixel).collect();
        for (index, band) in samples.bands.iter().enumerate() {
            for (nth, sample) in band.iter().enumerate().filter(|(_, sample)| samples.is_inside(sample)) {
                pixels[sample.pixel as usize] = match residuals.map(|(all, limit_mm)| (all[index][nth], limit_mm)) {
                    Some((mm, limit_mm)) if mm.abs() >= limit_mm => MapPixel::Rejected { mm: mm as f32 },
                    Some((mm, _)) => MapPixel::Fits { mm: mm as f32 },
                    None => MapPixel::Fits { mm: 0.0 },
                };
            }
        }
        let count = samples.pixels.iter().sum::<usize>().max(1);
        let mm_per_px = (self.sides_mm[0] * self.sides_mm[1] / count as f64).sqrt();
        DeviationMap { window: samples.window.clone(), pixels, mm_per_px }
    }

    fn deviation(&self, residuals: &[Vec<f64>], limit_mm: f64) -> Deviation {
        let all = || self.samples.bands.iter().flatten().zip(residuals.iter().flatten());
        let mut kept: Vec<f64> = all().map(|(_, r)| r.abs()).filter(|size| *size < limit_mm).collect();
        let rejected = all().filter(|(sample, r)| r.abs() >= limit_mm && self.samples.is_inside(sample)).count();
        Deviation {
            points: kept.len(),
            rejected,
            rms_mm: rms(kept.iter().copied()),
            p95_mm: quantile(&mut kept, 0.95, QuantileRank::Nearest).unwrap_or(0.0),
            largest_mm: kept.iter().copied().fold(0.0, f64::max),
            noise_mm: noise_mm(self.samples, residuals),
            smoothing: 0.0,
            missing_percent: self.missing_percent(rejected),
            largest_hole_mm: 0.0,
        }
    }
}

/// Estimates σ of the white noise, mm, from second differences along the picture's rows.
fn noise_mm(samples: &Samples, residuals: &[Vec<f64>]) -> f64 {
    let of_band = |(band, residuals): (&Vec<Sample>, &Vec<f64>)| {
        let neighbours =
            |three: &&[Sample]| three[1].pixel == three[0].pixel + 1 && three[2].pixel == three[0].pixel + 2;
        let bends = band.windows(3).zip(residuals.windows(3)).step_by(3);
        // The last pixels of a row and the first pixels of the next row have consecutive numbers, but are not adjacent;
        // these pixels are too few to have an effect.
        bends.filter(|(three, _)| neighbours(three)).map(|(_, r)| (r[0] - 2.0 * r[1] + r[2]).abs()).collect()
    };
    let of_bands: Vec<Vec<f64>> = samples.bands.par_iter().zip(residuals).map(of_band).collect();
    let middle = quantile(&mut of_bands.concat(), 0.5, QuantileRank::Nearest).unwrap_or(0.0);
    SIGMA_OF_MEDIAN * middle / 6.0_f64.sqrt()
}

/// Returns σ of normally distributed noise with the same median absolute deviation, mm.
fn scale_mm(residuals: &[Vec<f64>]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().flatten().map(|r| r.abs()).collect();
    (SIGMA_OF_MEDIAN * median(&mut sizes).unwrap_or(0.0)).max(MIN_SCALE_MM)
}
