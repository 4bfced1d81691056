//! Locates a corner to a hundredth of a pixel, by fitting a model to the grey levels around it.
//!
//! If two edges of a chessboard cross at c, a pixel at x with signed distances d₁, d₂ from the edges has the grey level
//!     g(x) = (m + a · E(d₁) · E(d₂)) · (1 + l · (x − c)),   E(d) = ∫ erf(t / (s √2)) dt from d − ½ to d + ½,      (1)
//! with mean m, half contrast a (its sign states which squares are black), blur s of the lens and light gradient l. The
//! grey level of a pixel is the mean over its area, which for an edge of any direction is nearly the mean over 1 px
//! across the edge. Least squares over the window by Levenberg–Marquardt determines c, both directions and the other
//! parameters. The pattern is symmetric about the point c, so a wrong profile of the blur does not move c. Every pixel
//! of both edges contributes, while `cornerSubPix`, which gives the start value, follows noise in the gradients.
//!
//! This module does not detect corners, and returns `None` if the model does not match.

use nalgebra::{SMatrix, SVector, Vector2};
use panelprep_base::geometry::{GrayPicture, Pixel};
use statrs::function::erf::erf;

const UNKNOWNS: usize = 9;
const MAX_STEPS: usize = 30;
/// Maximum motion of the corner in the last iteration, px.
const CONVERGENCE_PX: f64 = 1e-4;
/// Maximum motion of a corner from its start, px; beyond this it is another corner.
const MAX_CORNER_MOTION_PX: f64 = 1.5;
/// Minimum half contrast of a corner, grey levels.
const MIN_CONTRAST: f64 = 6.0;
/// Maximum residual of the model in addition to the picture's noise, as a fraction of the half contrast.
const MAX_RELATIVE_MODEL_RESIDUAL: f64 = 0.25;
/// Maximum excess of the mean square of the noise in a window over its expected value, in standard deviations.
const MAX_NOISE_SIGMAS: f64 = 3.0;
const START_BLUR_PX: f64 = 0.8;
/// Minimum blur of the model, px: no lens is sharper.
const MIN_BLUR_PX: f64 = 0.05;

/// A corner with the parameters of the fitted model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Saddle {
    /// Position of the corner in the picture.
    pub pixel: Pixel,
    /// Standard deviation of the position along each axis, from the noise of the picture, px.
    pub deviation_px: f64,
    /// Half contrast, grey levels; its sign states which squares are black.
    pub contrast: f64,
    /// The rms residual of the model in addition to the noise, as a fraction of the half contrast.
    pub residual: f64,
    /// Change of the light from the corner to the side of the window, as a fraction of the contrast.
    pub light_gradient: f64,
}

/// Refines the corner near `start` with edges along `edges`, in a picture with this rms of white noise; `None` if the
/// window leaves the picture or the model does not match.
pub(super) fn refine(
    picture: &GrayPicture,
    start: Pixel,
    edges: [Vector2<f64>; 2],
    half_window_px: usize,
    noise: f64,
) -> Option<Saddle> {
    let patch = Patch::extract(picture, start, half_window_px)?;
    let (model, sums) = fit_model(&patch, patch.initial_model(start, edges))?;
    accept_corner(&patch, (&model, &sums), start, noise)
}

/// Returns the model with the smallest sum of squares; `None` if the iteration does not converge.
fn fit_model(patch: &Patch, mut model: Model) -> Option<(Model, NormalSums)> {
    let mut here = patch.normal_equations(&model);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let mut damped = here.normal;
        (0..UNKNOWNS).for_each(|index| damped[(index, index)] *= 1.0 + damping);
        let Some(factor) = damped.cholesky() else {
            damping *= 10.0;
            continue;
        };
        let step = factor.solve(&here.gradient);
        let next = model.perturbed(&step);
        let there = patch.normal_equations(&next);
        let is_settled = step.fixed_rows::<2>(0).norm() < CONVERGENCE_PX;
        if there.square <= here.square {
            (model, here) = (next, there);
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
        if is_settled {
            return Some((model, here));
        }
    }
    None
}

/// Returns the corner if the fitted model is plausible.
fn accept_corner(patch: &Patch, (model, sums): (&Model, &NormalSums), start: Pixel, noise: f64) -> Option<Saddle> {
    let count = patch.pixels.len() as f64;
    let mean_square = sums.square / count;
    let is_sound = model.is_plausible(start, (mean_square, count), noise);
    let spread = if is_sound { sums.normal.cholesky()?.inverse() } else { return None };
    let deviation_px = noise.max(mean_square.sqrt()) * spread[(0, 0)].max(spread[(1, 1)]).sqrt();
    let left = (mean_square - noise * noise).max(0.0).sqrt() / model.contrast.abs();
    let slant = model.light.norm() * model.mean.abs() * patch.half_window_px / (2.0 * model.contrast.abs());
    Some(Saddle {
        pixel: model.pixel,
        deviation_px,
        contrast: model.contrast,
        residual: left,
        light_gradient: slant,
    })
}

/// The parameters of the model (1).
#[derive(Clone, Copy)]
struct Model {
    pixel: Pixel,
    /// Directions of the edges, rad.
    angles: [f64; 2],
    log_blur: f64,
    mean: f64,
    contrast: f64,
    light: Vector2<f64>,
}

impl Model {
    fn perturbed(&self, step: &SVector<f64, UNKNOWNS>) -> Self {
        Model {
            pixel: Pixel::at(self.pixel.u + step[0], self.pixel.v + step[1]),
            angles: [self.angles[0] + step[2], self.angles[1] + step[3]],
            log_blur: (self.log_blur + step[4]).max(MIN_BLUR_PX.ln()),
            mean: self.mean + step[5],
            contrast: self.contrast + step[6],
            light: self.light + Vector2::new(step[7], step[8]),
        }
    }

    /// Returns the grey level at an offset from the corner, and its derivatives.
    fn evaluate_gray(&self, u: f64, v: f64) -> (f64, SVector<f64, UNKNOWNS>) {
        let offset = Vector2::new(u - self.pixel.u, v - self.pixel.v);
        let blur = self.log_blur.exp();
        let edge = |angle: f64| {
            let along = Vector2::new(angle.cos(), angle.sin());
            let distance = along.perp(&offset);
            // ∫ erf(t / (s √2)) dt = t erf(t / (s √2)) + s √(2/π) exp(−t² / 2s²); its derivative by s is √(2/π)
            // exp(−t² / 2s²).
            let [ahead, behind] = [distance + 0.5, distance - 0.5].map(|t| {
                let step = erf(t / (blur * std::f64::consts::SQRT_2));
                (t * step, step, (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * (t / blur).powi(2)).exp())
            });
            let by_log_blur = blur * (ahead.2 - behind.2);
            (ahead.0 - behind.0 + by_log_blur, ahead.1 - behind.1, by_log_blur, along)
        };
        let [(one, one_slope, one_blur, one_along), (two, two_slope, two_blur, two_along)] = self.angles.map(edge);
        let (flat, light) = (self.mean + self.contrast * one * two, 1.0 + self.light.dot(&offset));
        let by_one = self.contrast * two * one_slope * light;
        let by_two = self.contrast * one * two_slope * light;
        // perp(along, offset) = along.x · offset.y − along.y · offset.x
        let du = by_one * one_along.y + by_two * two_along.y - flat * self.light.x;
        let dv = -by_one * one_along.x - by_two * two_along.x - flat * self.light.y;
        let turned = [-by_one * one_along.dot(&offset), -by_two * two_along.dot(&offset)];
        let slope = SVector::from([
            du,
            dv,
            turned[0],
            turned[1],
            self.contrast * (two * one_blur + one * two_blur) * light,
            light,
            one * two * light,
            flat * offset.x,
            flat * offset.y,
        ]);
        (flat * light, slope)
    }

    fn is_plausible(&self, start: Pixel, (mean_square, count): (f64, f64), noise: f64) -> bool {
        let of_noise = noise * noise * (1.0 + MAX_NOISE_SIGMAS * (2.0 / count).sqrt());
        self.pixel.distance_px(start) < MAX_CORNER_MOTION_PX
            && self.contrast.abs() > MIN_CONTRAST
            && mean_square < (MAX_RELATIVE_MODEL_RESIDUAL * self.contrast).powi(2) + of_noise
    }
}

struct Patch {
    /// For each pixel, u, v and grey level.
    pixels: Vec<[f64; 3]>,
    half_window_px: f64,
}

struct NormalSums {
    normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    gradient: SVector<f64, UNKNOWNS>,
    square: f64,
}

impl Patch {
    fn extract(picture: &GrayPicture, start: Pixel, half_window_px: usize) -> Option<Self> {
        let (column, row) = start.nearest_whole(picture.width, picture.height)?;
        let inside = |at: usize, size: usize| at >= half_window_px && at + half_window_px < size;
        if !inside(column, picture.width) || !inside(row, picture.height) {
            return None;
        }
        let rows = row - half_window_px..=row + half_window_px;
        let columns = column - half_window_px..=column + half_window_px;
        let pixel = |row: usize, column: usize| {
            [column as f64, row as f64, f64::from(picture.gray[row * picture.width + column])]
        };
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| pixel(row, column))).collect();
        Some(Patch { pixels, half_window_px: half_window_px as f64 })
    }

    /// Returns the start model with the given directions of the edges; its mean and contrast come from least squares.
    fn initial_model(&self, at: Pixel, edges: [Vector2<f64>; 2]) -> Model {
        let angles = edges.map(|edge| edge.y.atan2(edge.x));
        let log_blur = START_BLUR_PX.min(self.half_window_px / 3.0).ln();
        let mean = self.pixels.iter().map(|[.., gray]| gray).sum::<f64>() / self.pixels.len() as f64;
        let model = Model { pixel: at, angles, log_blur, mean, contrast: 1.0, light: Vector2::zeros() };
        let (mut product, mut square) = (0.0, 1e-9);
        for [u, v, gray] in &self.pixels {
            let pattern = model.evaluate_gray(*u, *v).1[6];
            product += pattern * (gray - mean);
            square += pattern * pattern;
        }
        Model { contrast: product / square, ..model }
    }

    fn normal_equations(&self, model: &Model) -> NormalSums {
        let mut sums = NormalSums { normal: SMatrix::zeros(), gradient: SVector::zeros(), square: 0.0 };
        for [u, v, gray] in &self.pixels {
            let (expected, slope) = model.evaluate_gray(*u, *v);
            let residual = gray - expected;
            sums.normal.ger(1.0, &slope, &slope, 1.0);
            sums.gradient += slope * residual;
            sums.square += residual * residual;
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Renders a corner at (20.3, 19.6) with edges along 20° and 100°; each pixel is the mean of 16 × 16 rays.
    fn drawn() -> GrayPicture {
        let mut picture = GrayPicture::uniform(41, 41, 0);
        let [one, two] = [20.0_f64, 100.0].map(|deg| Vector2::new(deg.to_radians().cos(), deg.to_radians().sin()));
        for (index, gray) in picture.gray.iter_mut().enumerate() {
            let ray = |ray: usize| {
                let part = |index: usize| (index as f64 + 0.5) / 16.0 - 0.5;
                let offset = Vector2::new(
                    (index % 41) as f64 + part(ray % 16) - 20.3,
                    (index / 41) as f64 + part(ray / 16) - 19.6,
                );
                if (one.perp(&offset) > 0.0) == (two.perp(&offset) > 0.0) { 40.0 } else { 200.0 }
            };
            *gray = ((0..256).map(ray).sum::<f64>() / 256.0).round() as u8;
        }
        picture
    }

    #[test]
    fn a_rendered_corner_is_located_to_a_few_thousandths() {
        let (picture, edges) = (drawn(), [Vector2::new(1.0, 0.25), Vector2::new(0.0, 1.0)]);
        let found = refine(&picture, Pixel::at(20.8, 19.1), edges, 8, 0.0).expect("a corner");
        assert!(found.pixel.distance_px(Pixel::at(20.3, 19.6)) < 0.005, "{found:?}");
    }

    #[test]
    fn pictures_without_a_corner_give_none() {
        let edges = [Vector2::new(1.0, 0.25), Vector2::new(0.0, 1.0)];
        let flat = GrayPicture::uniform(41, 41, 120);
        assert_eq!(refine(&flat, Pixel::at(20.0, 20.0), edges, 8, 0.0), None, "nothing is there");
        assert_eq!(refine(&drawn(), Pixel::at(3.0, 20.0), edges, 8, 0.0), None, "the window leaves the picture");
        assert_eq!(refine(&drawn(), Pixel::at(24.0, 20.0), edges, 6, 0.0), None, "the corner is elsewhere");
    }
}
