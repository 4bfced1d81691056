//! Locates a corner of a board by all of the print around it, for poor pictures in which the corner alone is not well
//! determined.
//!
//! The print is known, and the rest of the board gives its rotation and tilt. The print around the corner is rendered
//! as the camera would see it, p(x), with the blur of the picture. The grey levels are
//!     g(x) = m + l · x + x · q x + a · p(x − d),                                                                (1)
//! with mean m, a light gradient l and q, contrast a and the unknown shift d. With p(x − d) ≈ p(x) − ∇p · d this is
//! linear in m, l, q, a and a d; the print is rendered again at the estimated position. Pixels that show something
//! else, such as a glare, are down-weighted. The rims of markers and circles contribute as well as the corners.

use super::board::Board;
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use panelprep_base::geometry::statistics::{NORMAL_HALF, rms};
use panelprep_base::geometry::{GrayPicture, Pixel, median};

/// The print on a board.
pub(super) struct Print {
    kind: PrintKind,
    square_mm: f64,
    columns: usize,
    rows: usize,
}

enum PrintKind {
    Squares,
    /// The cells of the markers, by the position of their square, and the ratio of the marker's side to the square's
    /// side.
    Markers {
        cells: Vec<Option<Vec<bool>>>,
        share: f64,
    },
    /// Circles with this radius, mm; each circle is examined separately.
    Circles(f64),
}

/// A position at which the print was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PrintMatch {
    pub pixel: Pixel,
    /// Standard deviation of the position along each axis, from noise and residuals, px.
    pub deviation_px: f64,
    /// Difference of the grey levels of white and black.
    pub contrast: f64,
    /// Residual of the grey levels after the fit of the print, rms.
    pub residual: f64,
    /// Change of the light from the position to the side of the window, as a fraction of the contrast.
    pub light_gradient: f64,
}

/// Parameters of the search for the print around a position.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatchWindow {
    /// Homography from the board, mm, to the picture near the position.
    pub plane: Matrix3<f64>,
    /// Position on the board, mm.
    pub place: [f64; 2],
    /// The pixel at which the search starts.
    pub start: Pixel,
    /// Half side of the window on the board, mm; `most_px` is its maximum in the picture, px.
    pub reach_mm: f64,
    pub most_px: f64,
    /// Standard deviation of the blur of the picture, px.
    pub blur_px: f64,
}

const UNKNOWNS: usize = 9;
/// Standard deviations of the blur that are tried, px.
const TRIED_BLURS_PX: [f64; 6] = [0.3, 0.7, 1.2, 1.7, 2.3, 3.0];
/// Maximum number of renderings of the print. The loop ends earlier if the displacement is below `CONVERGENCE_PX`.
const MAX_RENDERINGS: usize = 5;
const CONVERGENCE_PX: f64 = 0.03;
/// Number of iterations that reduce the weights of pixels with large residuals.
const REWEIGHTING_STEPS: usize = 4;
/// Minimum fraction of the pixels of the window that must show the print.
const MIN_PRINT_FRACTION: f64 = 0.4;
/// Minimum contrast of a print, grey levels.
const MIN_CONTRAST: f64 = 8.0;
/// Minimum expected residual at the edges of a print, because it differs slightly from its nominal geometry, as a
/// fraction of the contrast.
const MIN_RELATIVE_RESIDUAL: f64 = 0.06;
/// Maximum residual in addition to the noise, as a fraction of the contrast.
const MAX_RELATIVE_RESIDUAL: f64 = 0.2;

impl Print {
    /// Returns the print of a chessboard, or of a board with markers.
    pub fn from_board(board: &Board, cells: &[Vec<bool>]) -> Self {
        let (columns, rows) = (board.columns() + 1, board.rows() + 1);
        let kind = match board.markers() {
            None => PrintKind::Squares,
            Some(markers) => {
                let mut by_square = vec![None; columns * rows];
                for ((column, row), cells) in board.marker_squares().into_iter().zip(cells) {
                    by_square[row * columns + column] = Some(cells.clone());
                }
                PrintKind::Markers { cells: by_square, share: markers.marker_mm / board.square_mm() }
            }
        };
        Print { kind, square_mm: board.square_mm(), columns, rows }
    }

    /// Returns the print of a board of circles with this radius.
    pub fn from_circles(board: &Board, radius_mm: f64) -> Self {
        Print {
            kind: PrintKind::Circles(radius_mm),
            square_mm: board.square_mm(),
            columns: board.columns(),
            rows: board.rows(),
        }
    }

    /// Returns the colour of the print around a position on the board, black 0, white 1.
    fn colour_at(&self, [x, y]: [f64; 2], place: [f64; 2]) -> f32 {
        if let PrintKind::Circles(radius_mm) = self.kind {
            return if (x - place[0]).hypot(y - place[1]) < radius_mm { 0.0 } else { 1.0 };
        }
        let (u, v) = (x / self.square_mm + 1.0, y / self.square_mm + 1.0);
        if u < 0.0 || v < 0.0 || u >= self.columns as f64 || v >= self.rows as f64 {
            return 1.0;
        }
        let (column, row) = (u as usize, v as usize);
        let PrintKind::Markers { cells, share } = &self.kind else { return ((column + row) % 2) as f32 };
        let Some(cells) = &cells[row * self.columns + column] else { return 0.0 };
        let side = (cells.len() as f64).sqrt();
        let [across, down] = [u, v].map(|at| (at.fract() - (1.0 - share) / 2.0) / share * side);
        let is_inside = (0.0..side).contains(&across) && (0.0..side).contains(&down);
        let is_black = is_inside && !cells[down as usize * side as usize + across as usize];
        if is_black { 0.0 } else { 1.0 }
    }

    /// Finds the print near the start position, in a picture with this rms of white noise; `None` if the print is not
    /// found.
    pub fn match_near(&self, picture: &GrayPicture, view: &MatchWindow, noise: f64) -> Option<PrintMatch> {
        let mut view = *view;
        let first = view.start;
        for turn in 0..MAX_RENDERINGS {
            let drawn = self.render_window(picture, &view)?;
            let fitted = fit_print(&drawn, noise)?;
            let step = Vector2::new(fitted.pixel.u - view.start.u, fitted.pixel.v - view.start.v);
            view.start = fitted.pixel;
            if view.start.distance_px(first) > 0.35 * view.most_px.max(4.0) {
                return None;
            }
            if step.norm() < CONVERGENCE_PX || turn + 1 == MAX_RENDERINGS {
                return Some(fitted).filter(|_| step.norm() < 0.3);
            }
        }
        None
    }

    /// Returns the blur at which the rendered print is most similar to the picture at these positions, px.
    pub fn blur_px(&self, picture: &GrayPicture, views: &[MatchWindow], noise: f64) -> f64 {
        let of = |blur_px: f64| (blur_px, self.match_statistics(picture, views, (blur_px, noise)));
        best_candidate(TRIED_BLURS_PX.map(of)).unwrap_or(TRIED_BLURS_PX[1])
    }

    /// Returns the number of positions at which the print is found, and its mean residual as a fraction of the
    /// contrast.
    pub fn match_statistics(
        &self,
        picture: &GrayPicture,
        views: &[MatchWindow],
        (blur_px, noise): (f64, f64),
    ) -> (usize, f64) {
        let all =
            views.iter().filter_map(|view| self.match_near(picture, &MatchWindow { blur_px, ..*view }, noise));
        let left: Vec<f64> = all.map(|found| found.residual / found.contrast.abs()).collect();
        (left.len(), left.iter().sum::<f64>() / left.len().max(1) as f64)
    }

    /// Returns the grey levels of the picture and of the rendered print in the window.
    fn render_window(&self, picture: &GrayPicture, view: &MatchWindow) -> Option<RenderedWindow> {
        let inverse = view.plane.try_inverse()?;
        let there = view.plane * Vector3::new(view.place[0], view.place[1], 1.0);
        let shift = Vector2::new(view.start.u - there.x / there.z, view.start.v - there.y / there.z);
        let on_board = |u: f64, v: f64| {
            let q = inverse * Vector3::new(u - shift.x, v - shift.y, 1.0);
            [q.x / q.z, q.y / q.z]
        };
        let (column, row) = view.start.nearest_whole(picture.width, picture.height)?;
        let is_round = matches!(self.kind, PrintKind::Circles(_));
        let corner = |x: f64, y: f64| {
            let p = view.plane * Vector3::new(view.place[0] + x, view.place[1] + y, 1.0);
            (p.x / p.z - there.x / there.z).abs().max((p.y / p.z - there.y / there.z).abs())
        };
        let r = view.reach_mm;
        let reach_px =
            [(-r, -r), (r, -r), (-r, r), (r, r)].map(|(x, y)| corner(x, y)).into_iter().fold(2.0, f64::max);
        let half = reach_px.min(view.most_px).ceil() as isize;
        let margin = 1 + (2.5 * view.blur_px).ceil() as isize;
        let side = (2 * (half + margin) + 1) as usize;
        let ink: Vec<f32> = (0..side * side)
            .map(|index| {
                let u = column as f64 + (index % side) as f64 - (half + margin) as f64;
                let v = row as f64 + (index / side) as f64 - (half + margin) as f64;
                let ray = |du: f64, dv: f64| self.colour_at(on_board(u + du, v + dv), view.place);
                let rays = [ray(-0.45, -0.45), ray(0.45, -0.45), ray(-0.45, 0.45), ray(0.45, 0.45)];
                let sum: f32 = rays.iter().sum();
                if sum == 0.0 || sum == 4.0 {
                    return sum / 4.0;
                }
                let part = |index: usize| (index as f64 + 0.5) / 4.0 - 0.5;
                (0..16).map(|index| ray(part(index % 4), part(index / 4))).sum::<f32>() / 16.0
            })
            .collect();
        let ink = gaussian_blur(&ink, side, view.blur_px);
        let mut pixels = Vec::with_capacity(side * side);
        for dv in -half..=half {
            for du in -half..=half {
                let (u, v) = (column as isize + du, row as isize + dv);
                if u < 0 || v < 0 || u >= picture.width as isize || v >= picture.height as isize {
                    continue;
                }
                let q = on_board(u as f64, v as f64);
                let away = [q[0] - view.place[0], q[1] - view.place[1]];
                let far = if is_round { away[0].hypot(away[1]) } else { away[0].abs().max(away[1].abs()) };
                if far > view.reach_mm {
                    continue;
                }
                let index = (dv + half + margin) as usize * side + (du + half + margin) as usize;
                pixels.push(PrintSample {
                    offset: Vector2::new(u as f64 - view.start.u, v as f64 - view.start.v),
                    gray: f64::from(picture.gray[v as usize * picture.width + u as usize]),
                    ink: f64::from(ink[index]),
                    slope: Vector2::new(
                        f64::from(ink[index + 1] - ink[index - 1]) / 2.0,
                        f64::from(ink[index + side] - ink[index - side]) / 2.0,
                    ),
                });
            }
        }
        (pixels.len() > 3 * UNKNOWNS).then_some(RenderedWindow { pixels, start: view.start, reach_px: half as f64 })
    }
}

/// Returns the candidate with the smallest residual. A candidate that is found at far fewer positions than another one
/// is excluded.
pub(super) fn best_candidate<const N: usize>(tried: [(f64, (usize, f64)); N]) -> Option<f64> {
    let most = tried.iter().map(|(_, (count, _))| *count).max()?;
    let all = tried.into_iter().filter(|(_, (count, _))| *count > 0 && 4 * count >= 3 * most);
    all.min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(tried, _)| tried)
}

/// A pixel of the window, with the value of the rendered print.
struct PrintSample {
    offset: Vector2<f64>,
    gray: f64,
    ink: f64,
    slope: Vector2<f64>,
}

struct RenderedWindow {
    pixels: Vec<PrintSample>,
    start: Pixel,
    reach_px: f64,
}

/// Solves the least squares of (1), with reduced weights for pixels that show something else.
fn fit_print(drawn: &RenderedWindow, noise: f64) -> Option<PrintMatch> {
    let by = |seen: &PrintSample| -> SVector<f64, UNKNOWNS> {
        let offset = seen.offset / drawn.reach_px;
        let (x, y) = (offset.x, offset.y);
        SVector::from([1.0, x, y, seen.ink, -seen.slope.x, -seen.slope.y, x * x, x * y, y * y])
    };
    let mut weights = vec![1.0; drawn.pixels.len()];
    let mut last = None;
    for _ in 0..REWEIGHTING_STEPS {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::identity() * 1e-9;
        let mut pull = SVector::<f64, UNKNOWNS>::zeros();
        for (seen, weight) in drawn.pixels.iter().zip(&weights) {
            let by = by(seen);
            normal.ger(*weight, &by, &by, 1.0);
            pull += by * (*weight * seen.gray);
        }
        let factor = normal.cholesky()?;
        let found = factor.solve(&pull);
        let left: Vec<f64> = drawn.pixels.iter().map(|seen| seen.gray - by(seen).dot(&found)).collect();
        let usual = median(&mut left.iter().map(|left| left.abs()).collect::<Vec<_>>())? / NORMAL_HALF;
        let scale = 2.5 * usual.max(noise).max(MIN_RELATIVE_RESIDUAL * found[3].abs()).max(0.5);
        weights = left.iter().map(|left| (1.0 + (left / scale).powi(2)).powi(-2)).collect();
        last = Some((found, factor, left, scale));
    }
    let (found, factor, left, scale) = last?;
    let near: Vec<f64> = left.iter().copied().filter(|left| left.abs() < scale).collect();
    // Only the edges of the print are evaluated: if a glare hides half of them, the position is not accepted.
    let edges = |limit: f64| {
        let seen = drawn.pixels.iter().zip(&left).filter(|(_, left)| left.abs() < limit);
        seen.map(|(seen, _)| seen.slope.norm_squared()).sum::<f64>()
    };
    let part = (edges(scale) / edges(f64::INFINITY)).min(near.len() as f64 / left.len() as f64);
    let rms = rms(near.iter().copied());
    let contrast = found[3];
    let beyond = (rms * rms - 1.5 * noise * noise).max(0.0).sqrt();
    if part < MIN_PRINT_FRACTION || contrast.abs() < MIN_CONTRAST || beyond > MAX_RELATIVE_RESIDUAL * contrast.abs()
    {
        return None;
    }
    let spread = factor.inverse();
    let deviation_px = rms.max(noise) * spread[(4, 4)].max(spread[(5, 5)]).sqrt() / contrast.abs();
    let at = Pixel::at(drawn.start.u + found[4] / contrast, drawn.start.v + found[5] / contrast);
    let slant = found[1].hypot(found[2]) / contrast.abs();
    Some(PrintMatch { pixel: at, deviation_px, contrast, residual: rms, light_gradient: slant })
}

/// Blurs with a Gaussian of this standard deviation, px.
fn gaussian_blur(from: &[f32], side: usize, sigma_px: f64) -> Vec<f32> {
    if sigma_px < 0.2 {
        return from.to_vec();
    }
    let reach = (2.5 * sigma_px).ceil() as usize;
    let weight = |away: usize| (-0.5 * (away as f64 / sigma_px).powi(2)).exp() as f32;
    let weights: Vec<f32> = (0..=reach).map(weight).collect();
    let sum = 2.0 * weights.iter().sum::<f32>() - weights[0];
    let pass = |from: &[f32], step: usize, place: &dyn Fn(usize) -> usize| -> Vec<f32> {
        (0..from.len())
            .map(|index| {
                let at = place(index);
                let beside = (1..=reach).map(|away| {
                    let (before, after) = (away.min(at), away.min(side - 1 - at));
                    weights[away] * (from[index - before * step] + from[index + after * step])
                });
                (weights[0] * from[index] + beside.sum::<f32>()) / sum
            })
            .collect()
    };
    let across = pass(from, 1, &|index| index % side);
    pass(&across, side, &|index| index / side)
}
