//! Corners that were found to about a pixel, placed to sub-pixel.
//!
//! `cornerSubPix` moves each to where grey gradients around it meet, and `saddle` fits a model of the grey levels, which is
//! several times as exact. The window of ± N px must hold one corner alone and enough edge: by default N is 0.35 of the
//! shortest distance between neighbours, 3 to 11. Where N is given, the corners are those of `cornerSubPix`, as OpenCV's
//! users know them.

use super::board::Board;
use super::crossings::noise;
use super::foreign;
use super::print::{Matched, Print, View, likest};
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
    let chosen_px = half_window_px
        .unwrap_or_else(|| (WINDOW_SHARE * shortest_px(rough, square_mm)).clamp(WINDOW_PX.0, WINDOW_PX.1) as usize);
    let pixels: Vec<Pixel> = rough.iter().map(|(_, pixel)| *pixel).collect();
    let pixels = foreign::refine_corners(picture, &pixels, chosen_px)?;
    Ok(Detected {
        corners: rough.iter().map(|(q, _)| *q).zip(pixels).collect(),
        half_window_px: chosen_px,
        modelled: 0,
    })
}

/// With every corner placed by the model of the grey levels that has neighbours and fits it. Where it does not fit, or places
/// the corner badly, the print around it is looked for where the others foretell it. The less well the noise lets a corner be
/// known, the more it is moved to the smooth surface through all, and one that is not known well enough after that is left out.
pub(super) fn modelled(
    picture: &GrayPicture,
    board: &Board,
    found: Detected,
    is_seen: &[bool],
    print: &Print,
) -> Detected {
    let window_px = found.half_window_px;
    let model = Model::of(picture, &found.corners, board.square_mm());
    let mut placed: Vec<Option<Placed>> =
        found.corners.iter().map(|(q, pixel)| model.place(*q, *pixel, window_px)).collect();
    let enough = 2 * placed.iter().flatten().count() >= found.corners.len();
    // Where the model places too few, those that were seen are known well enough to begin with.
    let begun: Vec<Option<Placed>> = match enough {
        true => placed.clone(),
        false => found
            .corners
            .iter()
            .zip(&placed)
            .zip(is_seen)
            .map(|(((_, pixel), placed), is_seen)| {
                placed.or(is_seen.then_some(Placed { at: *pixel, deviation_px: KNOWN_TOGETHER_PX }))
            })
            .collect(),
    };
    let enough = 2 * begun.iter().flatten().count() >= found.corners.len();
    let Some(mut surface) = surface_of(&found.corners, &begun, picture).filter(|_| enough) else {
        return one_by_one(found, placed, is_seen);
    };
    let reach_mm = PRINT_SQUARES * board.square_mm();
    let mut blur_px = None;
    for _ in 0..2 {
        for ((q, _), placed) in found.corners.iter().zip(&mut placed) {
            let there = surface.at(*q);
            let is_near = |found: &Placed| found.at.distance_px(there) <= surface.limit_px(*q, found);
            *placed = placed.filter(is_near).or_else(|| model.place(*q, there, window_px).filter(is_near));
            if placed.is_none_or(|placed| placed.deviation_px > WELL_PX) {
                let blur_px = *blur_px.get_or_insert_with(|| {
                    surface.blur_px(picture, print, (&found.corners, reach_mm), model.noise)
                });
                let by_print = print.matched(picture, &surface.view(*q, reach_mm, blur_px), model.noise);
                let by_print = by_print
                    .filter(|found| found.contrast > 0.0)
                    .map(|found| Placed { at: found.at, deviation_px: found.deviation_px });
                let better = |own: &Placed| placed.is_none_or(|placed| own.deviation_px < placed.deviation_px);
                *placed = by_print.filter(is_near).filter(better).or(*placed);
            }
        }
        let Some(next) = surface_of(&found.corners, &placed, picture) else { break };
        surface = next;
    }
    let drawn = found.corners.iter().zip(placed).filter_map(|((q, _), placed)| {
        let placed =
            placed.filter(|placed| placed.at.distance_px(surface.at(*q)) <= surface.limit_px(*q, placed))?;
        surface.drawn(*q, placed).map(|pixel| (*q, pixel))
    });
    let corners: Corners = drawn.collect();
    Detected { modelled: corners.len(), corners, ..found }
}

/// Corners of which too few are placed to compare them: those that the model places well, or that were seen.
fn one_by_one(found: Detected, placed: Vec<Option<Placed>>, is_seen: &[bool]) -> Detected {
    let well =
        |placed: Option<Placed>| placed.filter(|placed| placed.deviation_px < KNOWN_PX).map(|placed| placed.at);
    let placed: Vec<Option<Pixel>> = placed.into_iter().map(well).collect();
    let modelled = placed.iter().flatten().count();
    let is_large = found.corners.len() >= 2 * TERMS;
    let seen = is_seen.iter().copied().chain(std::iter::repeat(true));
    let kept = found.corners.iter().zip(placed.iter().zip(seen)).filter_map(|((q, pixel), (placed, is_seen))| {
        let without = (is_seen && !is_large).then_some(*pixel);
        placed.or(without).map(|pixel| (*q, pixel))
    });
    Detected { corners: kept.collect(), modelled, ..found }
}

/// A corner as the model places it.
#[derive(Debug, Clone, Copy)]
struct Placed {
    at: Pixel,
    /// How well noise, and what the model leaves, let it be known, each way, px.
    deviation_px: f64,
}

impl Placed {
    /// By the print, in a picture with this much noise.
    fn of(found: &Matched, noise: f64) -> Self {
        let left = (found.left.powi(2) - noise.powi(2)).max(0.0).sqrt() / (0.5 * found.contrast.abs());
        Placed { at: found.at, deviation_px: found.deviation_px.hypot(LEFT_PX * (left - USUAL_LEFT).max(0.0)) }
    }
}

/// What is looked for by its print alone.
pub(super) struct ByPrint<'a> {
    pub picture: &'a GrayPicture,
    /// It is looked for in the picture made smaller by so many times.
    pub times: usize,
    pub reach_mm: f64,
    /// The contrast's sign: 1 where the print is darker than the ground.
    pub sign: f64,
}

impl ByPrint<'_> {
    /// The circles of a board, from where some of them are about and their radius; `None` where there are too few to compare,
    /// or hardly one is there.
    pub fn circles(&self, board: &Board, rough: &Corners, radius_mm: f64) -> Option<Corners> {
        let small = if self.times == 1 { None } else { Some(foreign::reduced(self.picture, self.times).ok()?) };
        let small = small.as_ref().unwrap_or(self.picture);
        let noise = noise(small);
        let known = vec![KNOWN_TOGETHER_PX; rough.len()];
        let mut surface = Surface::through(rough, &known, self.picture.width as f64)?;
        let step = (rough.len() / BLUR_CORNERS).max(1);
        let view = |surface: &Surface, q, blur_px| self.smaller(surface.view(q, self.reach_mm, blur_px), small);
        let views: Vec<View> = rough.iter().step_by(step).map(|(q, _)| view(&surface, *q, 1.0)).collect();
        let blur_px = Print::of_circles(board, radius_mm).blur_px(small, &views, noise);
        let tried =
            RADII.map(|by| (by, Print::of_circles(board, by * radius_mm).unlike(small, &views, (blur_px, noise))));
        let print = Print::of_circles(board, likest(tried)? * radius_mm);
        let blur_px = print.blur_px(small, &views, noise);
        let all: Corners = board.corners().into_iter().map(|q| (q, Pixel::at(0.0, 0.0))).collect();
        let mut placed: Vec<Option<Placed>> = vec![None; all.len()];
        for _ in 0..3 {
            for ((q, _), placed) in all.iter().zip(&mut placed).filter(|(_, placed)| placed.is_none()) {
                let found = print.matched(small, &view(&surface, *q, blur_px), noise);
                let Some(found) = found.filter(|found| self.sign * found.contrast > 0.0) else { continue };
                let own = Placed::of(&found, noise);
                let own =
                    Placed { at: self.whole(own.at, small), deviation_px: own.deviation_px * self.times as f64 };
                let is_near = own.at.distance_px(surface.at(*q)) <= surface.limit_px(*q, &own).max(START_PX);
                *placed = (own.deviation_px < PRESENT_PX && is_near).then_some(own);
            }
            surface = surface_of(&all, &placed, self.picture)?;
            for ((q, _), placed) in all.iter().zip(&mut placed) {
                *placed =
                    placed.filter(|placed| placed.at.distance_px(surface.at(*q)) <= surface.limit_px(*q, placed));
            }
        }
        let drawn =
            all.iter().zip(&placed).filter_map(|((q, _), placed)| Some((*q, surface.drawn(*q, (*placed)?)?)));
        let corners: Corners = drawn.collect();
        (2 * corners.len() >= all.len()).then_some(corners)
    }

    fn by(&self, small: &GrayPicture) -> [f64; 2] {
        [small.width as f64 / self.picture.width as f64, small.height as f64 / self.picture.height as f64]
    }

    fn smaller(&self, view: View, small: &GrayPicture) -> View {
        let [across, down] = self.by(small);
        let scale = Matrix3::new(across, 0.0, (across - 1.0) / 2.0, 0.0, down, (down - 1.0) / 2.0, 0.0, 0.0, 1.0);
        let start = Pixel::at((view.start.u + 0.5) * across - 0.5, (view.start.v + 0.5) * down - 0.5);
        View { plane: scale * view.plane, start, most_px: 3.0 * PRINT_PX, ..view }
    }

    fn whole(&self, pixel: Pixel, small: &GrayPicture) -> Pixel {
        let [across, down] = self.by(small);
        Pixel::at((pixel.u + 0.5) / across - 0.5, (pixel.v + 0.5) / down - 0.5)
    }
}

fn surface_of(corners: &Corners, placed: &[Option<Placed>], picture: &GrayPicture) -> Option<Surface> {
    let placed = corners.iter().zip(placed).filter_map(|((q, _), placed)| placed.map(|placed| (*q, placed)));
    let (corners, deviations): (Corners, Vec<f64>) =
        placed.map(|(q, placed)| ((q, placed.at), placed.deviation_px)).unzip();
    Surface::through(&corners, &deviations, picture.width as f64)
}

/// Without those that stand apart from the smooth surface through the others.
pub(super) fn without_strays(corners: Corners, picture: &GrayPicture) -> Corners {
    let deviations_px = vec![0.0; corners.len()];
    let Some(surface) = Surface::through(&corners, &deviations_px, picture.width as f64) else { return corners };
    corners
        .into_iter()
        .filter(|(q, pixel)| {
            surface.at(*q).distance_px(*pixel)
                <= surface.limit_px(*q, &Placed { at: *pixel, deviation_px: KNOWN_PX })
        })
        .collect()
}

/// A corner that the model places farther from the surface through the others is another one, px, and by the median of all.
const STANDS_APART_PX: f64 = 0.4;
const STANDS_APART: f64 = 5.0;
/// … and where it is placed well, by how well the surface is known there.
const UNCERTAIN: f64 = 5.0;
/// The noise lets a corner be known to so much, each way, px: alone, and where a surface through all of them helps.
const KNOWN_PX: f64 = 0.2;
const KNOWN_TOGETHER_PX: f64 = 0.7;
/// … what is placed no better is there, and its place is that on the surface, px.
const PRESENT_PX: f64 = 3.0;
/// … and after that, px.
const KNOWN_AT_LAST_PX: f64 = 0.17;
/// A corner that the model places worse is looked for by its print as well, px.
const WELL_PX: f64 = 0.08;
/// The print is looked at so far around a corner, in squares, and so far in the picture, px.
pub(super) const PRINT_SQUARES: f64 = 0.5;
pub(super) const PRINT_PX: f64 = 16.0;
/// A circle's radius may be so many times that of a first estimate.
const RADII: [f64; 5] = [0.9, 0.95, 1.0, 1.05, 1.1];
/// A first place may be farther from where it is foretold, px.
const START_PX: f64 = 1.5;
/// The blur is found at so many corners.
pub(super) const BLUR_CORNERS: usize = 6;
/// Prints and lenses leave corners so far from a smooth surface, each way, px.
const ROUGH_PX: f64 = 0.05;
/// What the model leaves beside the noise, as a share of the half contrast, beyond which the corner is less well known …
const USUAL_LEFT: f64 = 0.06;
/// … by so many px for the whole half contrast.
const LEFT_PX: f64 = 2.0;

/// A smooth surface through corners: a plane's homography, and what a lens and a board that is not quite flat bend it by, a
/// polynomial of third degree.
struct Surface {
    middle: Vector2<f64>,
    reach_mm: f64,
    plane: Matrix3<f64>,
    bend: SMatrix<f64, TERMS, 2>,
    /// The median distance of the corners from it, px.
    usual_px: f64,
    /// How far corners are from it for other reasons than noise, each way, px.
    rough_px: f64,
    /// How well it is known itself, by the terms, px².
    spread: SMatrix<f64, TERMS, TERMS>,
}

const TERMS: usize = 10;
/// What a lens bends a place by, at a picture's width from its middle, in widths.
const LENS: f64 = 0.5;

impl Surface {
    /// `None` where there are too few corners to compare.
    fn through(corners: &Corners, deviations_px: &[f64], width_px: f64) -> Option<Self> {
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
            middle,
            reach_mm,
            plane,
            bend: SMatrix::zeros(),
            usual_px: 0.0,
            rough_px: ROUGH_PX,
            spread: SMatrix::zeros(),
        };
        let trust: Vec<f64> =
            deviations_px.iter().map(|noise_px| 1.0 / (ROUGH_PX.powi(2) + noise_px.powi(2))).collect();
        // A lens bends a small board by less: so much is usual for the terms of third degree.
        let reach_px = places.iter().zip(&pixels).map(|(_, p)| p.distance_px(pixels[0])).fold(0.0, f64::max) / 2.0;
        let cubic_px = LENS * reach_px.powi(3) / (width_px * width_px) + 0.01;
        let mut usual = SMatrix::<f64, TERMS, TERMS>::identity() * 1e-6;
        (6..TERMS).for_each(|term| usual[(term, term)] = cubic_px.powi(-2));
        let mut weights = trust.clone();
        for _ in 0..4 {
            let mut normal = usual;
            let mut pull = SMatrix::<f64, TERMS, 2>::zeros();
            for ((place, pixel), weight) in places.iter().zip(&pixels).zip(&weights) {
                let (by, flat) = (terms(place), on_plane(&plane, place));
                normal += by * by.transpose() * *weight;
                pull += by * (Vector2::new(pixel.u, pixel.v) - flat).transpose() * *weight;
            }
            let factor = normal.cholesky()?;
            surface.bend = factor.solve(&pull);
            surface.spread = factor.inverse();
            let apart: Vec<f64> = corners.iter().map(|(q, pixel)| surface.at(*q).distance_px(*pixel)).collect();
            surface.usual_px = median(&mut apart.clone())?;
            // A far one pulls no more (Geman and McClure).
            let usual = surface.usual_px.max(0.02);
            let far = |apart: &f64| (1.0 + (apart / (3.0 * usual)).powi(2)).powi(-2);
            weights = apart.iter().zip(&trust).map(|(apart, trust)| trust * far(apart)).collect();
        }
        // Half of a round normal cloud lies within 1.18 of its deviation each way.
        let noise_px = median(&mut deviations_px.to_vec())?;
        surface.rough_px = ((surface.usual_px / 1.18).powi(2) - noise_px.powi(2)).max(ROUGH_PX.powi(2)).sqrt();
        Some(surface)
    }

    /// A corner farther from it is another one, px: one that is badly known may be farther, and counts the less.
    fn limit_px(&self, q: Point<BoardFrame>, placed: &Placed) -> f64 {
        let is_well = placed.deviation_px < WELL_PX;
        let own_px = if is_well { UNCERTAIN * self.variance(q).sqrt() } else { 0.0 };
        let own_px = own_px.max(2.0 * placed.deviation_px).min(START_PX);
        STANDS_APART_PX.max(STANDS_APART * self.usual_px).max(own_px)
    }

    /// How well it is known at a place, each way, px².
    fn variance(&self, q: Point<BoardFrame>) -> f64 {
        let terms = terms(&self.place(q));
        (terms.transpose() * self.spread * terms)[(0, 0)]
    }

    /// Between a corner's own place and that on the surface: by how well each is known; `None` where both are not.
    fn drawn(&self, q: Point<BoardFrame>, placed: Placed) -> Option<Pixel> {
        let there = self.at(q);
        let of_surface = self.rough_px.powi(2) + self.variance(q);
        let of_own = placed.deviation_px.powi(2);
        let own = of_surface / (of_surface + of_own);
        if own * of_own > KNOWN_AT_LAST_PX.powi(2) {
            return None;
        }
        Some(Pixel::at(there.u + own * (placed.at.u - there.u), there.v + own * (placed.at.v - there.v)))
    }

    /// The print around a place as it is seen.
    fn view(&self, q: Point<BoardFrame>, reach_mm: f64, blur_px: f64) -> View {
        let (scale, middle) = (1.0 / self.reach_mm, self.middle / self.reach_mm);
        let to_place = Matrix3::new(scale, 0.0, -middle.x, 0.0, scale, -middle.y, 0.0, 0.0, 1.0);
        let plane = self.plane * to_place;
        View { plane, place: [q.mm.x, q.mm.y], start: self.at(q), reach_mm, most_px: PRINT_PX, blur_px }
    }

    /// The blur of the picture where the board is, px.
    fn blur_px(
        &self,
        picture: &GrayPicture,
        print: &Print,
        (corners, reach_mm): (&Corners, f64),
        noise: f64,
    ) -> f64 {
        let step = (corners.len() / BLUR_CORNERS).max(1);
        let views: Vec<View> = corners.iter().step_by(step).map(|(q, _)| self.view(*q, reach_mm, 1.0)).collect();
        print.blur_px(picture, &views, noise)
    }

    fn place(&self, q: Point<BoardFrame>) -> Vector2<f64> {
        (q.mm.coords.xy() - self.middle) / self.reach_mm
    }

    /// Where it has a place of the board.
    fn at(&self, q: Point<BoardFrame>) -> Pixel {
        let place = self.place(q);
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
    fn place(&self, q: Point<BoardFrame>, start: Pixel, half_window_px: usize) -> Option<Placed> {
        self.judged(saddle::refine(self.picture, start, self.edges(q, start)?, half_window_px, self.noise)?)
    }

    fn judged(&self, found: saddle::Saddle) -> Option<Placed> {
        let deviation_px = found.deviation_px.hypot(LEFT_PX * (found.left - USUAL_LEFT).max(0.0));
        (deviation_px < KNOWN_TOGETHER_PX).then_some(Placed { at: found.at, deviation_px })
    }

    fn edges(&self, q: Point<BoardFrame>, start: Pixel) -> Option<[Vector2<f64>; 2]> {
        Some([self.edge(q, start, Vector3::x())?, self.edge(q, start, Vector3::y())?])
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

/// The shortest distance between neighbours, px.
pub(super) fn shortest_px(corners: &Corners, square_mm: f64) -> f64 {
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
    corners.iter().map(both).fold(f64::INFINITY, f64::min)
}
