//! Corners that were found to about a pixel, placed to sub-pixel.
//!
//! `cornerSubPix` moves each to where grey gradients around it meet, and `saddle` fits a model of the grey levels, which is
//! several times as exact. The window of ± N px must hold one corner alone and enough edge: by default N is 0.35 of the
//! shortest distance between neighbours, 3 to 11. Where N is given, the corners are those of `cornerSubPix`, as OpenCV's
//! users know them.

use super::board::Board;
use super::crossings::noise;
use super::foreign;
use super::saddle;
use crate::geometry::{Board as BoardFrame, GrayPicture, Pixel, Point, median};
use crate::imaging::ImagingError;
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};
use std::collections::BTreeMap;

/// Corners of the board with their pixels.
pub type Corners = Vec<(Point<BoardFrame>, Pixel)>;

/// Corners and the window that refined them.
#[derive(Debug, Clone, PartialEq)]
pub struct Detected {
    /// The corners.
    pub corners: Corners,
    /// Half the window's side, px.
    pub half_window_px: usize,
    /// How many corners the model of the grey levels placed; the others are `cornerSubPix`'s.
    pub modelled: usize,
}

const WINDOW_SHARE: f64 = 0.35;
const WINDOW_PX: (f64, f64) = (3.0, 11.0);

/// Corners of a board as `cornerSubPix` places them, from where they are about.
pub(super) fn refined(
    picture: &GrayPicture,
    rough: &Corners,
    square_mm: f64,
    half_window_px: Option<usize>,
) -> Result<Detected, ImagingError> {
    let chosen_px = half_window_px.unwrap_or_else(|| window(rough, square_mm));
    let pixels: Vec<Pixel> = rough.iter().map(|(_, pixel)| *pixel).collect();
    let pixels = foreign::refine_corners(picture, &pixels, chosen_px)?;
    Ok(Detected {
        corners: rough.iter().map(|(q, _)| *q).zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled: 0,
    })
}

/// With every corner placed by the model of the grey levels that has neighbours and fits it. Where it does not fit at first, it
/// is tried again from where the others foretell the corner. Of the rest those are kept that were seen where the others
/// foretell them.
pub(super) fn modelled(picture: &GrayPicture, board: &Board, found: Detected, is_seen: &[bool]) -> Detected {
    let window_px = found.half_window_px;
    let model = Model::of(picture, &found.corners, board.square_mm());
    let mut placed: Vec<Option<Pixel>> =
        found.corners.iter().map(|(q, pixel)| model.place(*q, *pixel, window_px)).collect();
    let of_models: Corners =
        found.corners.iter().zip(&placed).filter_map(|((q, _), placed)| Some((*q, (*placed)?))).collect();
    let enough = 2 * of_models.len() >= found.corners.len();
    let Some(surface) = Surface::through(&of_models).filter(|_| enough) else {
        if found.corners.len() >= 2 * TERMS {
            return Detected { corners: of_models.clone(), modelled: of_models.len(), ..found };
        }
        let corners = found.corners.iter().zip(&placed).map(|((q, pixel), placed)| (*q, placed.unwrap_or(*pixel)));
        let seen = is_seen.iter().copied().chain(std::iter::repeat(true));
        let kept =
            corners.zip(placed.iter().zip(seen)).filter(|(_, (placed, is_seen))| placed.is_some() || *is_seen);
        return Detected { corners: kept.map(|(corner, _)| corner).collect(), modelled: of_models.len(), ..found };
    };
    for ((q, _), placed) in found.corners.iter().zip(&mut placed) {
        *placed = placed
            .or_else(|| model.place(*q, surface.at(*q), window_px))
            .or_else(|| model.place(*q, surface.at(*q), (window_px / 2).max(WINDOW_PX.0 as usize)));
    }
    let (limit, limit_without) =
        (STANDS_APART_PX.max(STANDS_APART * surface.usual_px), NEARLY_PX.max(2.0 * surface.usual_px));
    let seen = is_seen.iter().copied().chain(std::iter::repeat(true));
    let mut corners = Corners::new();
    let mut modelled = 0;
    for (((q, pixel), placed), is_seen) in found.corners.iter().zip(placed).zip(seen) {
        let there = surface.at(*q);
        match placed {
            Some(placed) if placed.distance_px(there) <= limit => {
                modelled += 1;
                corners.push((*q, placed));
            }
            None if is_seen && pixel.distance_px(there) <= limit_without => corners.push((*q, *pixel)),
            _ => {}
        }
    }
    Detected { corners, modelled, ..found }
}

/// Without those that stand apart from the smooth surface through the others.
pub(super) fn without_strays(corners: Corners) -> Corners {
    let Some(surface) = Surface::through(&corners) else { return corners };
    let limit = STANDS_APART_PX.max(STANDS_APART * surface.usual_px);
    corners.into_iter().filter(|(q, pixel)| surface.at(*q).distance_px(*pixel) <= limit).collect()
}

/// A corner that the model places farther from the surface through the others is another one, px, and by the median of all.
const STANDS_APART_PX: f64 = 0.4;
const STANDS_APART: f64 = 5.0;
/// The same without a model, px.
const NEARLY_PX: f64 = 0.2;
/// The noise lets a corner be known to so much, each way, px.
const KNOWN_PX: f64 = 0.2;

/// A smooth surface through corners: a plane's homography, and what a lens and a board that is not quite flat bend it by, a
/// polynomial of third degree.
struct Surface {
    middle: Vector2<f64>,
    reach_mm: f64,
    plane: Matrix3<f64>,
    bend: SMatrix<f64, TERMS, 2>,
    /// The median distance of the corners from it, px.
    usual_px: f64,
}

const TERMS: usize = 10;

impl Surface {
    /// `None` where there are too few corners to compare.
    fn through(corners: &Corners) -> Option<Self> {
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
        let mut surface = Surface { middle, reach_mm, plane, bend: SMatrix::zeros(), usual_px: 0.0 };
        let mut weights = vec![1.0; corners.len()];
        for _ in 0..4 {
            let mut normal = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-9;
            let mut pull = SMatrix::<f64, TERMS, 2>::zeros();
            for ((place, pixel), weight) in places.iter().zip(&pixels).zip(&weights) {
                let (by, flat) = (terms(place), on_plane(&plane, place));
                normal += by * by.transpose() * *weight;
                pull += by * (Vector2::new(pixel.u, pixel.v) - flat).transpose() * *weight;
            }
            surface.bend = normal.cholesky()?.solve(&pull);
            let apart: Vec<f64> = corners.iter().map(|(q, pixel)| surface.at(*q).distance_px(*pixel)).collect();
            surface.usual_px = median(&mut apart.clone())?;
            // A far one pulls no more (Geman and McClure).
            let usual = surface.usual_px.max(0.02);
            weights = apart.iter().map(|apart| (1.0 + (apart / (3.0 * usual)).powi(2)).powi(-2)).collect();
        }
        Some(surface)
    }

    /// Where it has a place of the board.
    fn at(&self, q: Point<BoardFrame>) -> Pixel {
        let place = (q.mm.coords.xy() - self.middle) / self.reach_mm;
        let there = on_plane(&self.plane, &place) + self.bend.transpose() * terms(&place);
        Pixel::at(there.x, there.y)
    }
}

fn on_plane(plane: &Matrix3<f64>, place: &Vector2<f64>) -> Vector2<f64> {
    let p = plane * place.push(1.0);
    p.xy() / p.z
}

fn terms(place: &Vector2<f64>) -> SVector<f64, TERMS> {
    let (x, y) = (place.x, place.y);
    SVector::from([1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y])
}

/// The model of the grey levels around corners whose neighbours tell the directions of their edges.
struct Model<'a> {
    picture: &'a GrayPicture,
    noise: f64,
    neighbours: Neighbours,
}

impl<'a> Model<'a> {
    fn of(picture: &'a GrayPicture, corners: &Corners, square_mm: f64) -> Self {
        Model { picture, noise: noise(picture), neighbours: Neighbours::of(corners, square_mm) }
    }

    /// Where it places a corner, from a start; `None` where it does not fit.
    fn place(&self, q: Point<BoardFrame>, start: Pixel, half_window_px: usize) -> Option<Pixel> {
        let edges = [self.edge(q, start, Vector3::x())?, self.edge(q, start, Vector3::y())?];
        let found = saddle::refine(self.picture, start, edges, half_window_px, self.noise)?;
        (found.deviation_px < KNOWN_PX).then_some(found.at)
    }

    fn edge(&self, q: Point<BoardFrame>, pixel: Pixel, step: Vector3<f64>) -> Option<Vector2<f64>> {
        let (here, step) = (Vector2::new(pixel.u, pixel.v), step * self.neighbours.square_mm);
        let (ahead, behind) = (self.neighbours.at(q.mm + step), self.neighbours.at(q.mm - step));
        (ahead.is_some() || behind.is_some()).then(|| ahead.unwrap_or(here) - behind.unwrap_or(here))
    }
}

/// Corners by their place on the board.
struct Neighbours {
    square_mm: f64,
    pixels: BTreeMap<(i64, i64), Vector2<f64>>,
}

impl Neighbours {
    fn of(corners: &Corners, square_mm: f64) -> Self {
        let mut all = Neighbours { square_mm, pixels: BTreeMap::new() };
        for (q, pixel) in corners {
            all.pixels.insert(all.key(q.mm), Vector2::new(pixel.u, pixel.v));
        }
        all
    }

    fn key(&self, place: nalgebra::Point3<f64>) -> (i64, i64) {
        let index = |mm: f64| (mm / self.square_mm).round() as i64;
        (index(place.x), index(place.y))
    }

    fn at(&self, place: nalgebra::Point3<f64>) -> Option<Vector2<f64>> {
        self.pixels.get(&self.key(place)).copied()
    }
}

fn window(corners: &Corners, square_mm: f64) -> usize {
    let by_place = Neighbours::of(corners, square_mm);
    let next = |q: &Point<BoardFrame>, pixel: &Pixel, step: Vector3<f64>| {
        let there = by_place.at(q.mm + step * square_mm)?;
        Some((there - Vector2::new(pixel.u, pixel.v)).norm())
    };
    let both = |(q, pixel): &(Point<BoardFrame>, Pixel)| {
        [Vector3::x(), Vector3::y()]
            .into_iter()
            .filter_map(|step| next(q, pixel, step))
            .fold(f64::INFINITY, f64::min)
    };
    let shortest = corners.iter().map(both).fold(f64::INFINITY, f64::min);
    (WINDOW_SHARE * shortest).clamp(WINDOW_PX.0, WINDOW_PX.1) as usize
}
