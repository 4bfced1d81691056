//! Refines corners that were found to about a pixel, to sub-pixel accuracy.
//!
//! `cornerSubPix` moves each corner to the intersection of the grey gradients around it; `saddle` fits a model of the
//! grey levels, which is several times as precise. The window of ± N px must contain only one corner and enough edge:
//! by default N is 0.35 of the shortest distance between neighbours, 3 to 11. If N is given, the corners are those of
//! `cornerSubPix`, as users of OpenCV know them.
//!
//! All corners of a board are on a smooth surface in a picture. In poor pictures the position of a corner is averaged
//! with its position on this surface, weighted by the uncertainties of both.

use super::board::{Board, Corners};
use super::crossings::noise;
use super::print::{MatchWindow, Print, PrintMatch};
use super::saddle::Saddle;
use super::{foreign, saddle};
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use panelprep_base::geometry::statistics::{QuantileRank, quantile};
use panelprep_base::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point, median};
use panelprep_cell::imaging::ImagingError;
use std::collections::BTreeMap;

/// Detected corners and the window that refined them.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedCorners {
    /// The detected corners, each as a point on the board and its pixel.
    pub corners: Corners,
    /// Half side of the window, px.
    pub half_window_px: usize,
    /// Number of corners that the model of the grey levels located; the others come from `cornerSubPix`.
    pub modelled_count: usize,
}

const RELATIVE_WINDOW_SIZE: f64 = 0.35;
const WINDOW_LIMITS_PX: (f64, f64) = (3.0, 11.0);

/// Refines the approximate corners of a board with `cornerSubPix`.
pub(super) fn refine_subpix(
    picture: &GrayPicture,
    rough: &Corners,
    square_mm: f64,
    half_window_px: Option<usize>,
) -> Result<DetectedCorners, ImagingError> {
    let chosen_px = half_window_px.unwrap_or_else(|| {
        (RELATIVE_WINDOW_SIZE * shortest_px(rough, square_mm)).clamp(WINDOW_LIMITS_PX.0, WINDOW_LIMITS_PX.1)
            as usize
    });
    let pixels: Vec<Pixel> = rough.iter().map(|(_, pixel)| *pixel).collect();
    let pixels = foreign::refine_corners(picture, &pixels, chosen_px)?;
    Ok(DetectedCorners {
        corners: rough.iter().map(|(q, _)| *q).zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled_count: 0,
    })
}

/// Locates every corner that has neighbours with the model of the grey levels. If the model does not match, or its
/// position is not accurate, the print is searched near the position that the other corners predict. The less accurate
/// a corner is because of noise, the more it is moved towards the smooth surface through all corners. A corner that is
/// still not accurate enough is excluded.
pub(super) fn refine_with_model(
    picture: &GrayPicture,
    board: &Board,
    found: DetectedCorners,
    is_seen: &[bool],
    print: &Print,
) -> DetectedCorners {
    let window_px = found.half_window_px;
    let model = Model::new(picture, &found.corners, board.square_mm());
    let mut placed: Vec<Option<CornerEstimate>> =
        found.corners.iter().map(|(q, pixel)| model.predict_corner(*q, *pixel, window_px)).collect();
    let enough = 2 * placed.iter().flatten().count() >= found.corners.len();
    // If the model locates too few corners, the other detected corners are accurate enough as start positions.
    let begun: Vec<Option<CornerEstimate>> = match enough {
        true => placed.clone(),
        false => found
            .corners
            .iter()
            .zip(&placed)
            .zip(is_seen)
            .map(|(((_, pixel), placed), is_seen)| {
                placed.or(is_seen.then_some(CornerEstimate {
                    pixel: *pixel,
                    deviation_px: MAX_SURFACE_STD_PX,
                    contrast: 0.0,
                }))
            })
            .collect(),
    };
    let enough = 2 * begun.iter().flatten().count() >= found.corners.len();
    let Some(mut surface) = fit_surface(&found.corners, &begun, picture).filter(|_| enough) else {
        return accept_individually(found, placed, is_seen);
    };
    let reach_mm = PRINT_REACH_SQUARES * board.square_mm();
    let mut blur_px = None;
    for _ in 0..2 {
        for ((q, _), placed) in found.corners.iter().zip(&mut placed) {
            let there = surface.pixel_at(*q);
            let is_near = |found: &CornerEstimate| found.pixel.distance_px(there) <= surface.limit_px(*q, found);
            *placed = placed.filter(is_near).or_else(|| model.predict_corner(*q, there, window_px).filter(is_near));
            if placed.is_none_or(|placed| placed.deviation_px > MAX_WELL_LOCATED_STD_PX) {
                let blur_px = *blur_px.get_or_insert_with(|| {
                    surface.blur_px(picture, print, (&found.corners, reach_mm), model.noise)
                });
                let by_print = print.match_near(picture, &surface.view(*q, reach_mm, blur_px), model.noise);
                let by_print = by_print
                    .filter(|found| found.contrast > 0.0)
                    .map(|found| CornerEstimate::from_match(&found, model.noise));
                let better =
                    |own: &CornerEstimate| placed.is_none_or(|placed| own.deviation_px < placed.deviation_px);
                *placed = by_print.filter(is_near).filter(better).or(*placed);
            }
        }
        let Some(next) = fit_surface(&found.corners, &placed, picture) else { break };
        surface = next;
    }
    let placed = inflate_uncertainty(&found.corners, placed, board.square_mm());
    let surface = fit_surface(&found.corners, &placed, picture).unwrap_or(surface);
    let drawn = found.corners.iter().zip(placed).filter_map(|((q, _), placed)| {
        let placed = placed
            .filter(|placed| placed.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, placed))?;
        surface.blend_with_surface(*q, placed).map(|pixel| (*q, pixel))
    });
    let corners: Corners = drawn.collect();
    DetectedCorners { modelled_count: corners.len(), corners, ..found }
}

/// Returns the corners without comparison, if too few are located: those that the model locates well, or that were
/// detected.
fn accept_individually(
    found: DetectedCorners,
    placed: Vec<Option<CornerEstimate>>,
    is_seen: &[bool],
) -> DetectedCorners {
    let well = |placed: Option<CornerEstimate>| {
        placed.filter(|placed| placed.deviation_px < MAX_SINGLE_STD_PX).map(|placed| placed.pixel)
    };
    let placed: Vec<Option<Pixel>> = placed.into_iter().map(well).collect();
    let modelled = placed.iter().flatten().count();
    let is_large = found.corners.len() >= 2 * TERMS;
    let seen = is_seen.iter().copied().chain(std::iter::repeat(true));
    let kept = found.corners.iter().zip(placed.iter().zip(seen)).filter_map(|((q, pixel), (placed, is_seen))| {
        let without = (is_seen && !is_large).then_some(*pixel);
        placed.or(without).map(|pixel| (*q, pixel))
    });
    DetectedCorners { corners: kept.collect(), modelled_count: modelled, ..found }
}

/// The model of the grey levels around corners; the neighbours of a corner give the directions of its edges.
struct Model<'a> {
    picture: &'a GrayPicture,
    noise: f64,
    neighbours: BoardNeighbours,
}

impl<'a> Model<'a> {
    fn new(picture: &'a GrayPicture, corners: &Corners, square_mm: f64) -> Self {
        Model { picture, noise: noise(picture), neighbours: BoardNeighbours::from_corners(corners, square_mm) }
    }

    /// Returns the position of a corner by the model, from a start position; `None` if the model does not match.
    fn predict_corner(&self, q: Point<BoardFrame>, start: Pixel, half_window_px: usize) -> Option<CornerEstimate> {
        let edges = [self.edge(q, start, Vector3::x())?, self.edge(q, start, Vector3::y())?];
        let found = saddle::refine(self.picture, start, edges, half_window_px, self.noise)?;
        Some(CornerEstimate::from_saddle(&found)).filter(|placed| placed.deviation_px < MAX_SURFACE_STD_PX)
    }

    fn edge(&self, q: Point<BoardFrame>, pixel: Pixel, step: Vector3<f64>) -> Option<Vector2<f64>> {
        let (here, step) = (Vector2::new(pixel.u, pixel.v), step * self.neighbours.square_mm);
        let (ahead, behind) = (self.neighbours.pixel_at(q.mm + step), self.neighbours.pixel_at(q.mm - step));
        (ahead.is_some() || behind.is_some()).then(|| ahead.unwrap_or(here) - behind.unwrap_or(here))
    }
}

/// Corners by their position on the board.
struct BoardNeighbours {
    square_mm: f64,
    pixels: BTreeMap<(i64, i64), Vector2<f64>>,
}

impl BoardNeighbours {
    fn from_corners(corners: &Corners, square_mm: f64) -> Self {
        let mut all = BoardNeighbours { square_mm, pixels: BTreeMap::new() };
        for (q, pixel) in corners {
            all.pixels.insert(all.key(q.mm), Vector2::new(pixel.u, pixel.v));
        }
        all
    }

    fn key(&self, place: nalgebra::Point3<f64>) -> (i64, i64) {
        let index = |mm: f64| (mm / self.square_mm).round() as i64;
        (index(place.x), index(place.y))
    }

    fn pixel_at(&self, place: nalgebra::Point3<f64>) -> Option<Vector2<f64>> {
        self.pixels.get(&self.key(place)).copied()
    }
}

/// Returns the shortest distance between neighbouring corners, px.
pub(super) fn shortest_px(corners: &Corners, square_mm: f64) -> f64 {
    let by_place = BoardNeighbours::from_corners(corners, square_mm);
    let next = |q: &Point<BoardFrame>, pixel: &Pixel, step: Vector3<f64>| {
        let there = by_place.pixel_at(q.mm + step * square_mm)?;
        Some((there - Vector2::new(pixel.u, pixel.v)).norm())
    };
    let both = |(q, pixel): &(Point<BoardFrame>, Pixel)| {
        [Vector3::x(), Vector3::y()]
            .into_iter()
            .filter_map(|step| next(q, pixel, step))
            .fold(f64::INFINITY, f64::min)
    };
    corners.iter().map(both).fold(f64::INFINITY, f64::min)
}

/// Minimum limit of the distance of a corner from the surface through the others, px; a corner farther away is an
/// outlier. The limit is the larger of this value and `OUTLIER_MEDIANS` times the median distance of all corners.
const MIN_OUTLIER_LIMIT_PX: f64 = 0.4;
const OUTLIER_MEDIANS: f64 = 5.0;
/// Minimum limit of a well-located corner, as a multiple of the standard deviation of the surface there.
const OUTLIER_SIGMAS: f64 = 5.0;
/// Minimum limit of a well-located corner, px: at the outer corners of a board the distortion of a lens may be of a
/// higher degree than the third.
const MIN_WELL_LOCATED_LIMIT_PX: f64 = 0.9;
/// Maximum standard deviation of a corner that is accepted on its own, px.
const MAX_SINGLE_STD_PX: f64 = 0.2;
/// Maximum standard deviation of a corner that is accepted because a surface through all corners supports it, px.
pub(super) const MAX_SURFACE_STD_PX: f64 = 0.7;
/// Maximum standard deviation of a corner after it was combined with the surface, px.
const MAX_COMBINED_STD_PX: f64 = 0.17;
/// Maximum standard deviation of a corner that the model alone locates well enough, px. A corner with a larger one is
/// also located by its print.
const MAX_WELL_LOCATED_STD_PX: f64 = 0.08;
/// Extent of the print that is examined around a corner, in squares; in the picture it is at most `MAX_PRINT_REACH_PX`,
/// px.
pub(super) const PRINT_REACH_SQUARES: f64 = 0.5;
pub(super) const MAX_PRINT_REACH_PX: f64 = 16.0;
/// Maximum distance between a start position and its prediction, px.
pub(super) const START_TOLERANCE_PX: f64 = 1.5;
/// Number of corners at which the blur is estimated.
pub(super) const BLUR_CORNER_COUNT: usize = 6;
/// Standard deviation of corners from a smooth surface, due to prints and lenses, px.
const SURFACE_STD_PX: f64 = 0.05;
/// Minimum lost fraction of the contrast of a corner at the edge of a glare, relative to the corners within
/// `CONTRAST_RADIUS_SQUARES` squares. The edge displaces the corner: by `LOST_CONTRAST_SHIFT_PX` if the whole contrast
/// is lost.
const MIN_LOST_CONTRAST: f64 = 0.15;
const CONTRAST_RADIUS_SQUARES: f64 = 2.6;
const LOST_CONTRAST_SHIFT_PX: f64 = 1.5;
/// Maximum change of the light within the window, as a fraction of the contrast. A larger change is also a sign of the
/// edge of a glare; it displaces the corner by `GRADIENT_SHIFT_PX` times the excess.
const MAX_LIGHT_GRADIENT: f64 = 0.1;
const GRADIENT_SHIFT_PX: f64 = 1.0;
/// Usual residual of the model in addition to the noise, as a fraction of the half contrast. With a larger residual the
/// position of the corner is less certain.
const TYPICAL_RESIDUAL: f64 = 0.06;
/// Additional uncertainty for a residual equal to the whole half contrast, px.
const RESIDUAL_UNCERTAINTY_PX: f64 = 2.0;

/// A corner, located by the model or by its print.
#[derive(Debug, Clone, Copy)]
pub(super) struct CornerEstimate {
    pub pixel: Pixel,
    /// Standard deviation of the position along each axis, from noise and the residual of the model, px.
    pub deviation_px: f64,
    /// Difference of the grey levels of white and black at the corner; 0 if the contrast is not determined.
    pub contrast: f64,
}

impl CornerEstimate {
    /// Creates the corner from its match with the print, in a picture with this noise.
    pub fn from_match(found: &PrintMatch, noise: f64) -> Self {
        let left = (found.residual.powi(2) - noise.powi(2)).max(0.0).sqrt() / (0.5 * found.contrast.abs());
        CornerEstimate {
            pixel: found.pixel,
            deviation_px: combined_std_px(found.deviation_px, left, found.light_gradient),
            contrast: found.contrast.abs(),
        }
    }

    /// Creates the corner from the fitted model of the grey levels.
    pub fn from_saddle(found: &Saddle) -> Self {
        let deviation_px = combined_std_px(found.deviation_px, found.residual, found.light_gradient);
        CornerEstimate { pixel: found.pixel, deviation_px, contrast: 2.0 * found.contrast.abs() }
    }
}

/// Returns the standard deviation of a position, from its deviation due to noise, the residual of the model as a
/// fraction of the half contrast, and the change of the light.
fn combined_std_px(deviation_px: f64, left: f64, slant: f64) -> f64 {
    let of_model_px = RESIDUAL_UNCERTAINTY_PX * (left - TYPICAL_RESIDUAL).max(0.0);
    deviation_px.hypot(of_model_px).hypot(GRADIENT_SHIFT_PX * (slant - MAX_LIGHT_GRADIENT).max(0.0))
}

/// A smooth surface through corners: the homography of a plane, and a polynomial of third degree for the distortion of
/// the lens and for a board that is not exactly flat.
pub(super) struct Surface {
    centre: Vector2<f64>,
    reach_mm: f64,
    plane: Matrix3<f64>,
    coefficients: SMatrix<f64, TERMS, 2>,
    /// Median distance of the corners from the surface, px.
    usual_px: f64,
    /// Standard deviation of the corners from the surface along each axis for reasons other than noise, px.
    rough_px: f64,
    /// Covariance of the surface for the terms of the polynomial, px².
    spread: SMatrix<f64, TERMS, TERMS>,
}

const TERMS: usize = 10;
/// Displacement by a lens at a distance of one picture width from the centre, in picture widths.
const LENS_DISPLACEMENT: f64 = 0.5;

impl Surface {
    /// Fits the surface to corners with these standard deviations along each axis; `None` if there are too few corners
    /// to compare.
    pub fn fit(corners: &Corners, deviations_px: &[f64], width_px: f64) -> Option<Self> {
        if corners.len() < 2 * TERMS {
            return None;
        }
        let middle = corners.iter().map(|(q, _)| q.mm.coords.xy()).sum::<Vector2<f64>>() / corners.len() as f64;
        let reach_mm = corners.iter().map(|(q, _)| (q.mm.coords.xy() - middle).amax()).fold(1e-9, f64::max);
        let places: Vec<Vector2<f64>> =
            corners.iter().map(|(q, _)| (q.mm.coords.xy() - middle) / reach_mm).collect();
        let pairs: Vec<[f64; 2]> = places.iter().map(|place| [place.x, place.y]).collect();
        let pixels: Vec<Pixel> = corners.iter().map(|(_, pixel)| *pixel).collect();
        let plane = foreign::homography(&pairs, &pixels)?;
        let mut surface = Surface {
            centre: middle,
            reach_mm,
            plane,
            coefficients: SMatrix::zeros(),
            usual_px: 0.0,
            rough_px: SURFACE_STD_PX,
            spread: SMatrix::zeros(),
        };
        let trust: Vec<f64> =
            deviations_px.iter().map(|noise_px| 1.0 / (SURFACE_STD_PX.powi(2) + noise_px.powi(2))).collect();
        // The lens displaces the corners of a small board less: the usual size of the terms of third degree follows
        // from the size of the board in the picture.
        let reach_px = places.iter().zip(&pixels).map(|(_, p)| p.distance_px(pixels[0])).fold(0.0, f64::max) / 2.0;
        let cubic_px = LENS_DISPLACEMENT * reach_px.powi(3) / (width_px * width_px) + 0.01;
        let mut usual = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-6;
        (6..TERMS).for_each(|term| usual[(term, term)] = cubic_px.powi(-2));
        let mut weights = trust.clone();
        for _ in 0..4 {
            let mut normal = usual;
            let mut pull = SMatrix::<f64, TERMS, 2>::zeros();
            for ((place, pixel), weight) in places.iter().zip(&pixels).zip(&weights) {
                let (by, flat) = (polynomial_terms(place), project_to_plane(&plane, place));
                normal += by * by.transpose() * *weight;
                pull += by * (Vector2::new(pixel.u, pixel.v) - flat).transpose() * *weight;
            }
            let factor = normal.cholesky()?;
            surface.coefficients = factor.solve(&pull);
            surface.spread = factor.inverse();
            let apart: Vec<f64> =
                corners.iter().map(|(q, pixel)| surface.pixel_at(*q).distance_px(*pixel)).collect();
            surface.usual_px = median(&mut apart.clone())?;
            // A distant corner has almost no influence (Geman and McClure).
            let usual = surface.usual_px.max(0.02);
            let far = |apart: &f64| (1.0 + (apart / (3.0 * usual)).powi(2)).powi(-2);
            weights = apart.iter().zip(&trust).map(|(apart, trust)| trust * far(apart)).collect();
        }
        // Half of a normal distribution in two dimensions is within 1.18 times the standard deviation along one axis.
        let noise_px = median(&mut deviations_px.to_vec())?;
        surface.rough_px =
            ((surface.usual_px / 1.18).powi(2) - noise_px.powi(2)).max(SURFACE_STD_PX.powi(2)).sqrt();
        Some(surface)
    }

    /// Returns the maximum distance of this corner from the surface, px; a corner farther away is an outlier. The limit
    /// is larger for a corner with an uncertain position, which has a smaller weight.
    pub fn limit_px(&self, q: Point<BoardFrame>, placed: &CornerEstimate) -> f64 {
        let is_well = placed.deviation_px < MAX_WELL_LOCATED_STD_PX;
        let own_px =
            if is_well { (OUTLIER_SIGMAS * self.variance(q).sqrt()).max(MIN_WELL_LOCATED_LIMIT_PX) } else { 0.0 };
        let own_px = own_px.max(2.0 * placed.deviation_px).min(START_TOLERANCE_PX);
        MIN_OUTLIER_LIMIT_PX.max(OUTLIER_MEDIANS * self.usual_px).max(own_px)
    }

    /// Returns the variance of the surface at a position, along each axis, px².
    fn variance(&self, q: Point<BoardFrame>) -> f64 {
        let terms = polynomial_terms(&self.plane_position(q));
        (terms.transpose() * self.spread * terms)[(0, 0)]
    }

    /// Returns the mean of the position of a corner and its position on the surface, weighted by their inverse
    /// variances; `None` if the result is not accurate enough.
    pub fn blend_with_surface(&self, q: Point<BoardFrame>, placed: CornerEstimate) -> Option<Pixel> {
        let there = self.pixel_at(q);
        let of_surface = self.rough_px.powi(2) + self.variance(q);
        let of_own = placed.deviation_px.powi(2);
        let own = of_surface / (of_surface + of_own);
        if own * of_own > MAX_COMBINED_STD_PX.powi(2) {
            return None;
        }
        Some(Pixel::at(there.u + own * (placed.pixel.u - there.u), there.v + own * (placed.pixel.v - there.v)))
    }

    /// Returns the view of the print around a position.
    pub fn view(&self, q: Point<BoardFrame>, reach_mm: f64, blur_px: f64) -> MatchWindow {
        let (scale, middle) = (1.0 / self.reach_mm, self.centre / self.reach_mm);
        let to_place = Matrix3::new(scale, 0.0, -middle.x, 0.0, scale, -middle.y, 0.0, 0.0, 1.0);
        let plane = self.plane * to_place;
        MatchWindow {
            plane,
            place: [q.mm.x, q.mm.y],
            start: self.pixel_at(q),
            reach_mm,
            most_px: MAX_PRINT_REACH_PX,
            blur_px,
        }
    }

    /// Returns the blur of the picture at the board, px.
    pub fn blur_px(
        &self,
        picture: &GrayPicture,
        print: &Print,
        (corners, reach_mm): (&Corners, f64),
        noise: f64,
    ) -> f64 {
        let step = (corners.len() / BLUR_CORNER_COUNT).max(1);
        let views: Vec<MatchWindow> =
            corners.iter().step_by(step).map(|(q, _)| self.view(*q, reach_mm, 1.0)).collect();
        print.blur_px(picture, &views, noise)
    }

    fn plane_position(&self, q: Point<BoardFrame>) -> Vector2<f64> {
        (q.mm.coords.xy() - self.centre) / self.reach_mm
    }

    /// Returns the pixel of a position on the board, from the surface.
    pub fn pixel_at(&self, q: Point<BoardFrame>) -> Pixel {
        let place = self.plane_position(q);
        let there =
            project_to_plane(&self.plane, &place) + self.coefficients.transpose() * polynomial_terms(&place);
        Pixel::at(there.x, there.y)
    }
}

/// Returns the pixel of a position on the board, mm, from a homography.
pub(super) fn homography_pixel(plane: &Matrix3<f64>, [x, y]: [f64; 2]) -> Pixel {
    let there = project_to_plane(plane, &Vector2::new(x, y));
    Pixel::at(there.x, there.y)
}

fn project_to_plane(plane: &Matrix3<f64>, place: &Vector2<f64>) -> Vector2<f64> {
    let p = plane * place.push(1.0);
    p.xy() / p.z
}

fn polynomial_terms(place: &Vector2<f64>) -> SVector<f64, TERMS> {
    let (x, y) = (place.x, place.y);
    SVector::from([1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y])
}

/// Returns the surface through the located corners.
pub(super) fn fit_surface(
    corners: &Corners,
    placed: &[Option<CornerEstimate>],
    picture: &GrayPicture,
) -> Option<Surface> {
    let placed = corners.iter().zip(placed).filter_map(|((q, _), placed)| placed.map(|placed| (*q, placed)));
    let (corners, deviations): (Corners, Vec<f64>) =
        placed.map(|(q, placed)| ((q, placed.pixel), placed.deviation_px)).unzip();
    Surface::fit(&corners, &deviations, picture.width as f64)
}

/// Increases the uncertainty of corners that have less contrast than those around them because of a glare: the edge of
/// the glare displaces them.
pub(super) fn inflate_uncertainty(
    corners: &Corners,
    placed: Vec<Option<CornerEstimate>>,
    square_mm: f64,
) -> Vec<Option<CornerEstimate>> {
    let known =
        |(q, placed): (&Point<BoardFrame>, &Option<CornerEstimate>)| placed.map(|placed| (*q, placed.contrast));
    let all: Vec<(Point<BoardFrame>, f64)> =
        corners.iter().map(|(q, _)| q).zip(&placed).filter_map(known).collect();
    let usual = |q: Point<BoardFrame>| {
        let near = all.iter().filter(|(other, _)| other.distance_mm(q) < CONTRAST_RADIUS_SQUARES * square_mm);
        let mut contrasts: Vec<f64> = near.map(|(_, contrast)| *contrast).collect();
        quantile(&mut contrasts, 0.75, QuantileRank::Floor).unwrap_or(0.0)
    };
    let doubt = |(q, placed): (Point<BoardFrame>, CornerEstimate)| {
        let lost = (1.0 - placed.contrast / usual(q).max(1.0) - MIN_LOST_CONTRAST).max(0.0);
        CornerEstimate { deviation_px: placed.deviation_px.hypot(LOST_CONTRAST_SHIFT_PX * lost), ..placed }
    };
    corners.iter().zip(placed).map(|((q, _), placed)| placed.map(|placed| doubt((*q, placed)))).collect()
}

/// Removes the corners that are far from the smooth surface through the others.
pub(super) fn remove_outliers(corners: Corners, picture: &GrayPicture) -> Corners {
    let deviations_px = vec![0.0; corners.len()];
    let Some(surface) = Surface::fit(&corners, &deviations_px, picture.width as f64) else { return corners };
    corners
        .into_iter()
        .filter(|(q, pixel)| {
            surface.pixel_at(*q).distance_px(*pixel)
                <= surface
                    .limit_px(*q, &CornerEstimate { pixel: *pixel, deviation_px: MAX_SINGLE_STD_PX, contrast: 0.0 })
        })
        .collect()
}
