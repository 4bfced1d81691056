//! Grids of circles: found as ellipses, ordered as a grid, each centre placed by its grey levels.
//!
//! `findCirclesGrid` orders candidates of [`super::blobs`]; it is given at most [`MOST_CANDIDATES`], since its time grows with
//! their third power. A centre is the middle of what differs from the plane of grey levels around the circle, so that blur
//! and falling light do not move it. The centre of the ellipse that a tilted circle shows is not where its centre is seen
//! (Heikkilä, IEEE T-PAMI 22, 2000): with the board's homography and the circles' size that difference is taken off.

use super::blobs::{Blob, blobs};
use super::board::Board;
use super::error::CalibError;
use super::foreign;
use super::placing::Detected;
use crate::geometry::{GrayPicture, Pixel, median};
use crate::imaging::ImagingError;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Candidates beyond so many times the board's circles are not all looked at.
const CANDIDATES_EACH: usize = 3;
const MOST_CANDIDATES: usize = 450;
/// Surroundings for a blob's threshold, as parts of the picture's longer side.
const REACHES: [usize; 2] = [12, 32];
/// The window reaches so far towards the neighbours' middles; the outermost part of it is ground.
const WINDOW: f64 = 0.48;
const GROUND: f64 = 0.40;
/// A circle that is found farther from where its grid has it is none, as a share of the distance to its neighbour.
const BENT: f64 = 0.2;

/// Finds the circles of a board.
pub(super) fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    asymmetric: bool,
    sizes: &[usize],
) -> Result<Detected, CalibError> {
    for &times in sizes {
        let small = if times == 1 { picture.clone() } else { foreign::reduced(picture, times)? };
        for (lighter, parts) in [false, true].into_iter().flat_map(|lighter| REACHES.map(|parts| (lighter, parts)))
        {
            let found = blobs(&small, small.width.max(small.height) / parts, lighter)?;
            let Some(rough) = grid(&found, board, asymmetric)? else { continue };
            let across = picture.width as f64 / small.width as f64;
            let down = picture.height as f64 / small.height as f64;
            let whole = |pixel: &Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
            let rough: Vec<Pixel> = rough.iter().map(whole).collect();
            if let Some(placed) = placed(picture, board, &rough) {
                return Ok(placed);
            }
        }
    }
    Err(CalibError::NoCircles { picture: name.to_owned(), columns: board.columns(), rows: board.rows() })
}

/// The candidates in the board's order; `None` where they are no such grid.
fn grid(found: &[Blob], board: &Board, asymmetric: bool) -> Result<Option<Vec<Pixel>>, ImagingError> {
    let count = board.count();
    if found.len() < count {
        return Ok(None);
    }
    let mut areas: Vec<f64> = found.iter().map(|blob| blob.area_px).collect();
    areas.sort_by(f64::total_cmp);
    // Circles are of one size, and so the most alike sizes are taken: the narrowest range that holds a board's worth.
    let most = (CANDIDATES_EACH * count).min(MOST_CANDIDATES).max(count);
    let narrowest = areas.windows(count).min_by(|a, b| (a[count - 1] / a[0]).total_cmp(&(b[count - 1] / b[0])));
    let middle = narrowest.map_or(1.0, |window| (window[0] * window[count - 1]).sqrt());
    let mut alike: Vec<&Blob> = found.iter().collect();
    let away = |blob: &Blob| (blob.area_px / middle).ln().abs();
    alike.sort_by(|a, b| away(a).total_cmp(&away(b)));
    alike.truncate(most);
    let pixels: Vec<Pixel> = alike.iter().map(|blob| blob.middle).collect();
    let Some(pixels) = foreign::circles(&pixels, (board.columns(), board.rows()), asymmetric)? else {
        return Ok(None);
    };
    Ok(Some(if asymmetric { unmirrored_asymmetric(pixels, board) } else { unmirrored(pixels, board.columns()) }))
}

/// A symmetric grid begins at its upper end and is never mirrored.
fn unmirrored(mut pixels: Vec<Pixel>, columns: usize) -> Vec<Pixel> {
    if turn(pixels[0], pixels[columns - 1], pixels[pixels.len() - columns]) < 0.0 {
        pixels.chunks_mut(columns).for_each(<[Pixel]>::reverse);
    }
    if pixels[pixels.len() - 1].v < pixels[0].v {
        pixels.reverse();
    }
    pixels
}

/// An asymmetric grid is mirrored where its rows run against each other.
fn unmirrored_asymmetric(mut pixels: Vec<Pixel>, board: &Board) -> Vec<Pixel> {
    let columns = board.columns();
    if turn(pixels[0], pixels[columns - 1], pixels[pixels.len() - columns]) < 0.0 {
        // Turned upside down and read from the other end of each row, the same circles have the same places.
        let rows: Vec<Vec<Pixel>> = pixels.chunks(columns).rev().map(<[Pixel]>::to_vec).collect();
        pixels = rows.concat();
    }
    pixels
}

fn turn(first: Pixel, right: Pixel, below: Pixel) -> f64 {
    (right.u - first.u) * (below.v - first.v) - (right.v - first.v) * (below.u - first.u)
}

/// All centres to sub-pixel; `None` where what was found is no plane grid.
fn placed(picture: &GrayPicture, board: &Board, rough: &[Pixel]) -> Option<Detected> {
    let places = board.corners();
    let plane: Vec<[f64; 2]> = places.iter().map(|q| [q.mm.x, q.mm.y]).collect();
    let neighbour_mm = board.square_mm() * if board.circles()? { std::f64::consts::SQRT_2 } else { 1.0 };
    let board_to_picture = foreign::homography(&plane, rough)?;
    let is_plane = plane.iter().zip(rough).all(|(place, pixel)| {
        let slope = slope(&board_to_picture, *place);
        let near_px = neighbour_mm * slope.determinant().abs().sqrt();
        at(&board_to_picture, *place).distance_px(*pixel) < BENT * near_px
    });
    if !is_plane {
        return None;
    }
    let (mut pixels, mut radii_mm) = (Vec::new(), Vec::new());
    for (place, pixel) in plane.iter().zip(rough) {
        let slope = slope(&board_to_picture, *place);
        let (pixel, area_px) = centre(picture, *pixel, &(slope * neighbour_mm))?;
        radii_mm.push((area_px / slope.determinant().abs() / std::f64::consts::PI).sqrt());
        pixels.push(pixel);
    }
    let radius_mm = median(&mut radii_mm)?;
    let board_to_picture = foreign::homography(&plane, &pixels)?;
    let corners = places.iter().zip(&plane).zip(&pixels).map(|((q, place), pixel)| {
        let (seen, middle) = (at(&board_to_picture, *place), ellipse_middle(&board_to_picture, *place, radius_mm)?);
        Some((*q, Pixel::at(pixel.u + seen.u - middle.u, pixel.v + seen.v - middle.v)))
    });
    let corners: Vec<_> = corners.collect::<Option<_>>()?;
    let half_window_px = (radius_mm * slope(&board_to_picture, plane[0]).determinant().abs().sqrt()) as usize;
    Some(Detected { modelled: corners.len(), corners, half_window_px })
}

fn at(plane: &Matrix3<f64>, [x, y]: [f64; 2]) -> Pixel {
    let p = plane * Vector3::new(x, y, 1.0);
    Pixel::at(p.x / p.z, p.y / p.z)
}

/// How a pixel moves with a place on the board, px per mm.
fn slope(plane: &Matrix3<f64>, [x, y]: [f64; 2]) -> Matrix2<f64> {
    let p = plane * Vector3::new(x, y, 1.0);
    let by =
        |column: usize, row: usize, value: f64| (plane[(row, column)] - plane[(2, column)] * value / p.z) / p.z;
    Matrix2::new(by(0, 0, p.x), by(1, 0, p.x), by(0, 1, p.y), by(1, 1, p.y))
}

/// The middle of the ellipse that a circle shows: for the circle's dual conic D it is the last column of H D Hᵀ.
fn ellipse_middle(plane: &Matrix3<f64>, [x, y]: [f64; 2], radius_mm: f64) -> Option<Pixel> {
    let r2 = radius_mm * radius_mm;
    let dual = Matrix3::new(r2 - x * x, -x * y, -x, -x * y, r2 - y * y, -y, -x, -y, -1.0);
    let seen = plane * dual * plane.transpose();
    let w = seen[(2, 2)];
    (w.abs() > 1e-12).then(|| Pixel::at(seen[(0, 2)] / w, seen[(1, 2)] / w))
}

/// The middle of what differs from the ground in the window around a circle, and its area, px.
fn centre(picture: &GrayPicture, start: Pixel, neighbour: &Matrix2<f64>) -> Option<(Pixel, f64)> {
    let inverse = neighbour.try_inverse()?;
    let (mut middle, mut area_px) = (start, 0.0);
    for _ in 0..4 {
        let reach = WINDOW * neighbour.column(0).norm().max(neighbour.column(1).norm()) * std::f64::consts::SQRT_2;
        let low = |at: f64| (at - reach).floor().max(0.0) as usize;
        let columns = low(middle.u)..=((middle.u + reach).ceil() as usize).min(picture.width.checked_sub(1)?);
        let rows = low(middle.v)..=((middle.v + reach).ceil() as usize).min(picture.height.checked_sub(1)?);
        let mut inside = Vec::new();
        let (mut normal, mut pull) = (Matrix3::<f64>::zeros(), Vector3::zeros());
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let away = Vector2::new(column as f64 - middle.u, row as f64 - middle.v);
            let part = (inverse * away).norm();
            if part > WINDOW {
                continue;
            }
            let gray = f64::from(picture.gray[row * picture.width + column]);
            if part > GROUND {
                let by = Vector3::new(1.0, away.x, away.y);
                normal += by * by.transpose();
                pull += by * gray;
            }
            inside.push((away, gray));
        }
        let ground = normal.cholesky()?.solve(&pull);
        let differs = |away: &Vector2<f64>, gray: f64| gray - ground[0] - ground[1] * away.x - ground[2] * away.y;
        let (mut sum, mut moment) = (0.0, Vector2::zeros());
        for (away, gray) in &inside {
            let weight = differs(away, *gray);
            sum += weight;
            moment += away * weight;
        }
        // The full difference is that near the middle.
        let mut near: Vec<f64> = inside
            .iter()
            .filter(|(away, _)| (inverse * away).norm() < 0.12)
            .map(|(away, gray)| differs(away, *gray))
            .collect();
        let peak = median(&mut near).unwrap_or(0.0);
        let step = moment / sum;
        if !(step.norm() < reach && peak.abs() > 6.0 && sum / peak > 4.0) {
            return None;
        }
        middle = Pixel::at(middle.u + step.x, middle.v + step.y);
        area_px = sum / peak;
    }
    (middle.distance_px(start) < 0.3 * neighbour.determinant().abs().sqrt()).then_some((middle, area_px))
}
