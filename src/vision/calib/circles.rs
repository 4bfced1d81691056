//! Detects grids of circles: the circles are found as ellipses and ordered as a grid, and each centre is located by its
//! grey levels.
//!
//! Candidates are ordered by `circle_lattice`, which receives at most [`MAX_CANDIDATES`]. The centre of an ellipse is
//! the centroid of the pixels that differ from the plane of grey levels around the circle, so that blur and non-uniform
//! light do not move it. The centre of the ellipse that a tilted circle shows is not the image of the circle's centre
//! (Heikkilä, IEEE T-PAMI 22, 2000). This difference is calculated from the homography of the board and the size of the
//! circles, and is subtracted. If one of the four outer circles is larger than all others, it is the first circle: it
//! shows the rotation of a board that looks the same from several sides.
//!
//! In poor pictures the circles are located by their print (`print`) and the smooth surface through all of them
//! (`placing`).

use super::board::{Board, Corners};
use super::circle_lattice::{Blob, Sums, blobs};
use super::crossings::{SmoothedPicture, noise};
use super::error::CalibError;
use super::placing::{
    BLUR_CORNER_COUNT, CornerEstimate, DetectedCorners, MAX_PRINT_REACH_PX, MAX_SURFACE_STD_PX, START_TOLERANCE_PX,
    Surface, fit_surface, homography_pixel, inflate_uncertainty, remove_outliers,
};
use super::print::{MatchWindow, Print, best_candidate};
use super::{circle_lattice, foreign};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use panelprep_base::geometry::{GrayPicture, Pixel, median};

/// Maximum number of candidates that are examined, as a multiple of the number of circles of the board.
const MAX_CANDIDATE_RATIO: usize = 3;
const MAX_CANDIDATES: usize = 450;
/// Maximum number of blobs from the windows of all sizes together: a woven texture has more, and each blob is compared
/// with all others.
const MAX_BLOBS: usize = 2_000;
/// Divisors for the window sizes of a blob's threshold: the longer side of the picture divided by these numbers.
const THRESHOLD_WINDOW_DIVISORS: [usize; 3] = [12, 32, 80];
/// Maximum number of grids in which the circles are located.
const MAX_GRIDS: usize = 3;
/// Extent of the window, as a fraction of the distance between neighbouring centres. From `RELATIVE_BACKGROUND_START`
/// outwards the window shows only background.
const RELATIVE_WINDOW_EXTENT: f64 = 0.48;
const RELATIVE_BACKGROUND_START: f64 = 0.40;
/// Maximum extent of the window in the full-size picture, px. Circles with larger windows are located in a reduced
/// picture.
const MAX_WINDOW_EXTENT_PX: f64 = 13.0;
/// Maximum distance of a circle from its predicted position in the grid, as a fraction of the distance to its
/// neighbour; a circle farther away is rejected.
const MAX_GRID_DEVIATION: f64 = 0.2;

/// Maximum relative difference between the radius of a circle and that of the others; a circle with a larger difference
/// is not completely visible.
const MAX_RADIUS_DEVIATION: f64 = 0.12;
/// Minimum ratio of the radius of the mark to the radius of the other circles. The mark is an outer circle and the
/// first circle of the board.
const MIN_MARK_RATIO: f64 = 1.3;

/// Circles, each by its number on the board and its pixel.
type NumberedPixel = Vec<(usize, Pixel)>;

/// Finds the circles of a board.
pub(super) fn detect(
    name: &str,
    picture: &GrayPicture,
    board: &Board,
    asymmetric: bool,
    sizes: &[usize],
) -> Result<DetectedCorners, CalibError> {
    let mut all: Vec<(NumberedPixel, bool)> = Vec::new();
    'looks: for &times in sizes {
        let small = if times == 1 { picture.clone() } else { foreign::reduce_picture(picture, times)? };
        let small = SmoothedPicture::from_picture(&small).picture();
        let across = picture.width as f64 / small.width as f64;
        let down = picture.height as f64 / small.height as f64;
        let whole = |pixel: &Pixel| Pixel::at((pixel.u + 0.5) * across - 0.5, (pixel.v + 0.5) * down - 0.5);
        let sums = Sums::from_picture(&small);
        for lighter in [false, true] {
            let mut together: Vec<Blob> = Vec::new();
            for parts in THRESHOLD_WINDOW_DIVISORS.map(Some).into_iter().chain([None]) {
                let rough = match parts {
                    Some(parts) => {
                        let found = blobs(&small, &sums, small.width.max(small.height) / parts, lighter)?;
                        add_new_blobs(&mut together, &found);
                        grid(&found, board)
                    }
                    // A window size that misses circles beside a glare needs the blobs of another size. Therefore the
                    // blobs of all sizes together are tried last.
                    None => grid(&together, board),
                };
                let Some(rough) = rough else { continue };
                let rough: NumberedPixel = rough.iter().map(|(index, pixel)| (*index, whole(pixel))).collect();
                let is_whole = rough.len() == board.count();
                all.push((rough, lighter));
                if is_whole {
                    break 'looks;
                }
            }
        }
    }
    // The largest grid is the most likely one; the next ones are tried if it is not a grid of the board.
    all.sort_by_key(|(rough, _)| std::cmp::Reverse(rough.len()));
    let best = all.iter().take(MAX_GRIDS).find_map(|(rough, lighter)| {
        let (first, radii_mm) = refine_centres(picture, board, rough, *lighter)?;
        let turned = if asymmetric { None } else { number_from_mark(rough, &radii_mm, board) };
        Some(
            turned
                .and_then(|turned| refine_centres(picture, board, &turned, *lighter))
                .map_or(first, |(placed, _)| placed),
        )
    });
    let none = || CalibError::NoCircles { picture: name.to_owned(), columns: board.columns(), rows: board.rows() };
    best.ok_or_else(none)
}

/// Adds the blobs that the list does not contain.
fn add_new_blobs(all: &mut Vec<Blob>, more: &[Blob]) {
    if all.len() + more.len() > MAX_BLOBS {
        return;
    }
    for blob in more {
        let is_known = |other: &Blob| other.centre.distance_px(blob.centre) < 0.5 * blob.area_px.sqrt();
        if !all.iter().any(is_known) {
            all.push(*blob);
        }
    }
}

/// Returns the candidates that are circles of the board; `None` if they form no matching grid.
fn grid(found: &[Blob], board: &Board) -> Option<NumberedPixel> {
    let count = board.count() / 2;
    if found.len() < count {
        return None;
    }
    let mut areas: Vec<f64> = found.iter().map(|blob| blob.area_px).collect();
    areas.sort_by(f64::total_cmp);
    // All circles have one size. Therefore the blobs of the most similar sizes are selected: the narrowest range of
    // sizes that contains as many blobs as the board has circles.
    let most = (MAX_CANDIDATE_RATIO * board.count()).min(MAX_CANDIDATES).max(board.count());
    let narrowest = areas.windows(count).min_by(|a, b| (a[count - 1] / a[0]).total_cmp(&(b[count - 1] / b[0])));
    let middle = narrowest.map_or(1.0, |window| (window[0] * window[count - 1]).sqrt());
    let mut alike: Vec<Blob> = found.to_vec();
    let away = |blob: &Blob| (blob.area_px / middle).ln().abs();
    alike.sort_by(|a, b| away(a).total_cmp(&away(b)));
    alike.truncate(most);
    let placed = circle_lattice::grid(&alike, board)?;
    Some(placed.into_iter().map(|(index, blob)| (index, blob.centre)).collect())
}

/// Numbers the circles so that the marked circle is the first; `None` if none is marked, or the marked circle is
/// already the first.
fn number_from_mark(rough: &NumberedPixel, radii_mm: &[f64], board: &Board) -> Option<NumberedPixel> {
    let usual = median(&mut radii_mm.to_vec())?;
    let (columns, rows, last) = (board.columns(), board.rows(), board.count() - 1);
    let radius = |number: usize| {
        rough.iter().zip(radii_mm).find(|((index, _), _)| *index == number).map_or(0.0, |(_, radius)| *radius)
    };
    let outer = [0, columns - 1, last, last + 1 - columns];
    let marked = outer.into_iter().position(|number| radius(number) > MIN_MARK_RATIO * usual)?;
    let others = rough.iter().zip(radii_mm).filter(|((index, _), _)| *index != outer[marked]);
    if marked == 0 || others.into_iter().any(|(_, radius)| *radius > MIN_MARK_RATIO * usual) {
        return None;
    }
    // A rectangular board has two possible orientations, a square one four.
    let turned = |number: usize| {
        let (column, row) = (number % columns, number / columns);
        match marked {
            2 => Some(last - number),
            1 if columns == rows => Some((columns - 1 - column) * columns + row),
            3 if columns == rows => Some(column * columns + columns - 1 - row),
            _ => None,
        }
    };
    let mut all: NumberedPixel =
        rough.iter().map(|(number, pixel)| Some((turned(*number)?, *pixel))).collect::<Option<_>>()?;
    all.sort_by_key(|(number, _)| *number);
    Some(all)
}

/// Returns all centres with sub-pixel accuracy, and the radii of the circles; `None` if the candidates form no flat
/// grid. Circles without a centre, and circles far from their positions in the grid, are excluded.
fn refine_centres(
    picture: &GrayPicture,
    board: &Board,
    rough: &NumberedPixel,
    lighter: bool,
) -> Option<(DetectedCorners, Vec<f64>)> {
    let places = board.corners();
    let place = |number: usize| [places[number].mm.x, places[number].mm.y];
    let neighbour_mm = board.square_mm() * if board.circles()? { std::f64::consts::SQRT_2 } else { 1.0 };
    let (asked, rough) = (rough, &filter_coplanar(board, rough, neighbour_mm)?);
    let plane: Vec<[f64; 2]> = rough.iter().map(|(number, _)| place(*number)).collect();
    let seen: Vec<Pixel> = rough.iter().map(|(_, pixel)| *pixel).collect();
    let board_to_picture = foreign::homography(&plane, &seen)?;
    let centres: Vec<Option<(Pixel, f64)>> = plane
        .iter()
        .zip(&seen)
        .map(|(place, pixel)| {
            let slope = pixel_jacobian(&board_to_picture, *place);
            let (pixel, area_px) = centre(picture, *pixel, &(slope * neighbour_mm))?;
            Some((pixel, (area_px / slope.determinant().abs() / std::f64::consts::PI).sqrt()))
        })
        .collect();
    let radius = |number: usize| {
        let at = rough.iter().position(|(other, _)| *other == number);
        at.and_then(|at| centres[at]).map_or(0.0, |(_, radius)| radius)
    };
    let radii_mm: Vec<f64> = asked.iter().map(|(number, _)| radius(*number)).collect();
    let radius_mm = median(&mut radii_mm.iter().copied().filter(|radius| *radius > 0.0).collect::<Vec<_>>())?;
    let found: Vec<(usize, Pixel, f64)> = rough
        .iter()
        .zip(&centres)
        .filter_map(|((number, _), centre)| centre.map(|(pixel, radius)| (*number, pixel, radius)))
        .collect();
    if 2 * found.len() < board.count() {
        return None;
    }
    let plane: Vec<[f64; 2]> = found.iter().map(|(number, ..)| place(*number)).collect();
    let pixels: Vec<Pixel> = found.iter().map(|(_, pixel, _)| *pixel).collect();
    let board_to_picture = foreign::homography(&plane, &pixels)?;
    let found_by_print =
        locate_by_print(picture, board, (&board_to_picture, neighbour_mm), (&found, radius_mm), lighter);
    let half_window_px =
        (radius_mm * pixel_jacobian(&board_to_picture, plane[0]).determinant().abs().sqrt()) as usize;
    if let Some(corners) = found_by_print {
        return Some((DetectedCorners { modelled_count: corners.len(), corners, half_window_px }, radii_mm));
    }
    let corners = found.iter().map(|(number, pixel, radius)| {
        let at_place = place(*number);
        // The mark keeps its own radius; all other circles have one radius.
        let radius = if *radius > MIN_MARK_RATIO * radius_mm { *radius } else { radius_mm };
        Some((places[*number], project_centre(&board_to_picture, at_place, *pixel, radius)?))
    });
    let corners = remove_outliers(corners.collect::<Option<_>>()?, picture);
    Some((DetectedCorners { modelled_count: corners.len(), corners, half_window_px }, radii_mm))
}

/// Returns the circles at their predicted positions on one plane; `None` if more than a few are elsewhere. The others
/// are removed: if a glare covers a part of a circle, the centroid of the rest is displaced.
fn filter_coplanar(board: &Board, rough: &NumberedPixel, neighbour_mm: f64) -> Option<NumberedPixel> {
    let places = board.corners();
    let mut kept = rough.clone();
    loop {
        let plane: Vec<[f64; 2]> =
            kept.iter().map(|(number, _)| [places[*number].mm.x, places[*number].mm.y]).collect();
        let seen: Vec<Pixel> = kept.iter().map(|(_, pixel)| *pixel).collect();
        let board_to_picture = foreign::homography(&plane, &seen)?;
        let off = plane.iter().zip(&seen).map(|(place, pixel)| {
            let near_px = neighbour_mm * pixel_jacobian(&board_to_picture, *place).determinant().abs().sqrt();
            homography_pixel(&board_to_picture, *place).distance_px(*pixel) / near_px
        });
        let (farthest, bent) = off.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        if bent < MAX_GRID_DEVIATION {
            return Some(kept);
        }
        kept.remove(farthest);
        if 10 * kept.len() < 8 * rough.len() {
            return None;
        }
    }
}

/// Locates all circles by their print, including those that were not found before; `None` if there are too few to
/// compare.
fn locate_by_print(
    picture: &GrayPicture,
    board: &Board,
    (plane, neighbour_mm): (&Matrix3<f64>, f64),
    (found, radius_mm): (&[(usize, Pixel, f64)], f64),
    lighter: bool,
) -> Option<Corners> {
    let places = board.corners();
    let reach_mm = RELATIVE_WINDOW_EXTENT * neighbour_mm;
    let middle = pixel_jacobian(plane, [places[places.len() / 2].mm.x, places[places.len() / 2].mm.y]);
    // Large circles are located equally well in a reduced picture.
    let reach_px = reach_mm * middle.column(0).norm().max(middle.column(1).norm());
    let times = (reach_px / MAX_WINDOW_EXTENT_PX).max(1.0) as usize;
    // A circle that a glare covers in part has another size, and its centroid is shifted.
    let whole = |radius: f64| {
        (radius / radius_mm - 1.0).abs() < MAX_RADIUS_DEVIATION || radius > MIN_MARK_RATIO * radius_mm
    };
    let rough: Corners = found
        .iter()
        .filter(|(.., radius)| whole(*radius))
        .filter_map(|(number, pixel, radius)| {
            let q = places[*number];
            Some((q, project_centre(plane, [q.mm.x, q.mm.y], *pixel, radius.min(2.0 * radius_mm))?))
        })
        .collect();
    let sign = if lighter { -1.0 } else { 1.0 };
    PrintLocator { picture, times, reach_mm, sign }.circles(board, &rough, radius_mm)
}

/// Returns the image of a circle's centre, given the centre of its ellipse.
fn project_centre(plane: &Matrix3<f64>, place: [f64; 2], middle: Pixel, radius_mm: f64) -> Option<Pixel> {
    let (seen, ellipse) = (homography_pixel(plane, place), ellipse_middle(plane, place, radius_mm)?);
    Some(Pixel::at(middle.u + seen.u - ellipse.u, middle.v + seen.v - ellipse.v))
}

/// Returns the derivative of the pixel with respect to the position on the board, px per mm.
fn pixel_jacobian(plane: &Matrix3<f64>, [x, y]: [f64; 2]) -> Matrix2<f64> {
    let p = plane * Vector3::new(x, y, 1.0);
    let by =
        |column: usize, row: usize, value: f64| (plane[(row, column)] - plane[(2, column)] * value / p.z) / p.z;
    Matrix2::new(by(0, 0, p.x), by(1, 0, p.x), by(0, 1, p.y), by(1, 1, p.y))
}

/// Returns the centre of the ellipse that a circle shows: for the dual conic D of the circle it is the last column of H
/// D Hᵀ.
fn ellipse_middle(plane: &Matrix3<f64>, [x, y]: [f64; 2], radius_mm: f64) -> Option<Pixel> {
    let r2 = radius_mm * radius_mm;
    let dual = Matrix3::new(r2 - x * x, -x * y, -x, -x * y, r2 - y * y, -y, -x, -y, -1.0);
    let seen = plane * dual * plane.transpose();
    let w = seen[(2, 2)];
    (w.abs() > 1e-12).then(|| Pixel::at(seen[(0, 2)] / w, seen[(1, 2)] / w))
}

/// Returns the centroid of the pixels that differ from the background in the window around a circle, and their area,
/// px.
fn centre(picture: &GrayPicture, start: Pixel, neighbour: &Matrix2<f64>) -> Option<(Pixel, f64)> {
    let inverse = neighbour.try_inverse()?;
    let (mut middle, mut area_px) = (start, 0.0);
    for _ in 0..4 {
        let reach = RELATIVE_WINDOW_EXTENT
            * neighbour.column(0).norm().max(neighbour.column(1).norm())
            * std::f64::consts::SQRT_2;
        let low = |at: f64| (at - reach).floor().max(0.0) as usize;
        let columns = low(middle.u)..=((middle.u + reach).ceil() as usize).min(picture.width.checked_sub(1)?);
        let rows = low(middle.v)..=((middle.v + reach).ceil() as usize).min(picture.height.checked_sub(1)?);
        let mut inside = Vec::new();
        let (mut normal, mut pull) = (Matrix3::<f64>::zeros(), Vector3::zeros());
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let away = Vector2::new(column as f64 - middle.u, row as f64 - middle.v);
            let part = (inverse * away).norm();
            if part > RELATIVE_WINDOW_EXTENT {
                continue;
            }
            let gray = f64::from(picture.gray[row * picture.width + column]);
            if part > RELATIVE_BACKGROUND_START {
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
        // The full difference from the background is measured near the centre.
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

/// Maximum standard deviation of a located circle along each axis, px; a circle with a larger one is treated as absent.
const MAX_CENTRE_STD_PX: f64 = 3.0;
/// Factors by which the radius of a circle may differ from its first estimate.
const RADIUS_FACTORS: [f64; 5] = [0.9, 0.95, 1.0, 1.05, 1.1];

/// The inputs for locating circles only by their print.
struct PrintLocator<'a> {
    pub picture: &'a GrayPicture,
    /// The factor by which the picture is reduced for the search.
    pub times: usize,
    pub reach_mm: f64,
    /// Sign of the contrast: 1 if the print is darker than the background.
    pub sign: f64,
}

impl PrintLocator<'_> {
    /// Finds the circles of a board, from the approximate positions of some of them and their radius. `None` if there
    /// are too few to compare, or fewer than half of the circles are found.
    pub fn circles(&self, board: &Board, rough: &Corners, radius_mm: f64) -> Option<Corners> {
        let small =
            if self.times == 1 { None } else { Some(foreign::reduce_picture(self.picture, self.times).ok()?) };
        let small = small.as_ref().unwrap_or(self.picture);
        let noise = noise(small);
        let known = vec![MAX_SURFACE_STD_PX; rough.len()];
        let mut surface = Surface::fit(rough, &known, self.picture.width as f64)?;
        let step = (rough.len() / BLUR_CORNER_COUNT).max(1);
        let view =
            |surface: &Surface, q, blur_px| self.reduced_view(surface.view(q, self.reach_mm, blur_px), small);
        let views: Vec<MatchWindow> = rough.iter().step_by(step).map(|(q, _)| view(&surface, *q, 1.0)).collect();
        let blur_px = Print::from_circles(board, radius_mm).blur_px(small, &views, noise);
        let tried = RADIUS_FACTORS.map(|by| {
            (by, Print::from_circles(board, by * radius_mm).match_statistics(small, &views, (blur_px, noise)))
        });
        let print = Print::from_circles(board, best_candidate(tried)? * radius_mm);
        let blur_px = print.blur_px(small, &views, noise);
        let all: Corners = board.corners().into_iter().map(|q| (q, Pixel::at(0.0, 0.0))).collect();
        let mut placed: Vec<Option<CornerEstimate>> = vec![None; all.len()];
        for _ in 0..3 {
            for ((q, _), placed) in all.iter().zip(&mut placed).filter(|(_, placed)| placed.is_none()) {
                let found = print.match_near(small, &view(&surface, *q, blur_px), noise);
                let Some(found) = found.filter(|found| self.sign * found.contrast > 0.0) else { continue };
                let own = CornerEstimate::from_match(&found, noise);
                let deviation_px = own.deviation_px * self.times as f64;
                let own = CornerEstimate { pixel: self.full_size_pixel(own.pixel, small), deviation_px, ..own };
                // The first surface is only as accurate as the centroids of the circles, some of which a glare has
                // shifted.
                let start_px = START_TOLERANCE_PX * self.times as f64;
                let is_near =
                    own.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, &own).max(start_px);
                *placed = (own.deviation_px < MAX_CENTRE_STD_PX && is_near).then_some(own);
            }
            surface = fit_surface(&all, &placed, self.picture)?;
            for ((q, _), placed) in all.iter().zip(&mut placed) {
                *placed = placed.filter(|placed| {
                    placed.pixel.distance_px(surface.pixel_at(*q)) <= surface.limit_px(*q, placed)
                });
            }
        }
        let placed = inflate_uncertainty(&all, placed, board.square_mm());
        let surface = fit_surface(&all, &placed, self.picture)?;
        let drawn = all
            .iter()
            .zip(&placed)
            .filter_map(|((q, _), placed)| Some((*q, surface.blend_with_surface(*q, (*placed)?)?)));
        let corners: Corners = drawn.collect();
        (2 * corners.len() >= all.len()).then_some(corners)
    }

    fn scale_to(&self, small: &GrayPicture) -> [f64; 2] {
        [small.width as f64 / self.picture.width as f64, small.height as f64 / self.picture.height as f64]
    }

    fn reduced_view(&self, view: MatchWindow, small: &GrayPicture) -> MatchWindow {
        let [across, down] = self.scale_to(small);
        let scale = Matrix3::new(across, 0.0, (across - 1.0) / 2.0, 0.0, down, (down - 1.0) / 2.0, 0.0, 0.0, 1.0);
        let start = Pixel::at((view.start.u + 0.5) * across - 0.5, (view.start.v + 0.5) * down - 0.5);
        MatchWindow { plane: scale * view.plane, start, most_px: 3.0 * MAX_PRINT_REACH_PX, ..view }
    }

    fn full_size_pixel(&self, pixel: Pixel, small: &GrayPicture) -> Pixel {
        let [across, down] = self.scale_to(small);
        Pixel::at((pixel.u + 0.5) / across - 0.5, (pixel.v + 0.5) / down - 0.5)
    }
}
