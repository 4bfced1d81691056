//! Detects filled ellipses in a picture and joins them to the grid of a board of circles.
//!
//! Candidates for circles are darker or lighter than their surroundings. A pixel belongs to a candidate if it differs
//! enough from the mean of its surroundings. Adjacent pixels form a connected component. A component of area A with the
//! covariance C of its pixels is an ellipse if A = 4π √det C, which neither letters nor wood grain satisfy. The
//! computing time grows only with the number of pixels.
//!
//! A lattice grows from a blob and two of its neighbours. Each step is predicted from the previous one, so that a lens
//! and a tilt may deform the lattice. Its two directions are not always those of the rows of the board: with a tilt a
//! diagonal may be shorter, and the rows of an asymmetric board are diagonals of its lattice. The coordinates are
//! therefore rotated and sheared by small integers until they are those of the board. The number of blobs that are
//! examined from each position is limited, and so is the computing time.

use super::board::Board;
use nalgebra::{Matrix2, Vector2};
use panelprep_base::geometry::{GrayPicture, Mask, Pixel};
use panelprep_cell::imaging;
use panelprep_cell::imaging::ImagingError;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// A connected component with the shape of an ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob {
    pub centre: Pixel,
    pub area_px: f64,
}

/// Minimum area of a component with a recognizable shape, px.
const MIN_AREA_PX: f64 = 12.0;
/// Maximum area of a circle, as a fraction of the picture: a larger component is not one circle among many.
const MAX_AREA_FRACTION: f64 = 0.03;
/// Maximum difference of A / (4π √det C) from 1.
const MAX_ROUNDNESS_ERROR: f64 = 0.12;
/// Maximum ratio of the longest axis to the shortest: for a circle seen at 70° it is 2.9.
const MAX_AXIS_RATIO: f64 = 3.5;
/// Minimum difference of a pixel from its surroundings, grey levels.
const MIN_CONTRAST: f64 = 6.0;
/// Minimum grey level of a pixel that may belong to a glare, which would raise the mean of the surroundings.
const MIN_GLARE_GRAY: u8 = 225;
/// Divisor for the maximum distance of pixels that may belong to a glare beside them: the longer side of the picture
/// divided by this number.
const GLARE_RIM_DIVISOR: usize = 40;
/// The amount that each pixel adds to a sum so that the sum also counts the pixels: more than the sum of all grey
/// levels of a picture.
const PIXEL_COUNT_UNIT: u64 = 1 << 36;

/// Finds the blobs that are darker, or lighter, than the mean of ± `reach_px` around them; `sums` are the sums of the
/// picture.
///
/// # Errors
/// If OpenCV refuses the picture, for example an empty one.
pub(super) fn blobs(
    picture: &GrayPicture,
    sums: &Sums,
    reach_px: usize,
    lighter: bool,
) -> Result<Vec<Blob>, ImagingError> {
    let (width, height) = (picture.width, picture.height);
    let is_marked = |index: usize| {
        let away = f64::from(picture.gray[index]) - sums.mean(index % width, index / width, reach_px);
        if lighter { away > MIN_CONTRAST } else { away < -MIN_CONTRAST }
    };
    let mask = Mask { width, height, inside: (0..width * height).map(is_marked).collect() };
    let piece = |pixels: &Vec<usize>| {
        let mut piece = ConnectedComponent::default();
        for (column, row) in pixels.iter().map(|index| (index % width, index / width)) {
            piece.add(column as f64, row as f64);
            piece.touches_rim |= column == 0 || row == 0 || column + 1 == width || row + 1 == height;
        }
        piece.blob((width * height) as f64)
    };
    Ok(imaging::connected_components(&mask, false)?.iter().filter_map(piece).collect())
}

/// An integral image: the sums over all pixels above and left of each pixel.
struct Integral {
    sums: Vec<u64>,
    width: usize,
    height: usize,
}

impl Integral {
    fn new(width: usize, height: usize, value: impl Fn(usize) -> u64) -> Self {
        let mut sums = vec![0u64; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut line = 0u64;
            for column in 0..width {
                line += value(row * width + column);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + line;
            }
        }
        Integral { sums, width, height }
    }

    /// Returns the sum over ± `reach` pixels, and the number of these pixels.
    fn window_sum(&self, column: usize, row: usize, reach: usize) -> (u64, u64) {
        let (left, right) = (column.saturating_sub(reach), (column + reach + 1).min(self.width));
        let (top, low) = (row.saturating_sub(reach), (row + reach + 1).min(self.height));
        let at = |row: usize, column: usize| self.sums[row * (self.width + 1) + column];
        let sum = at(low, right) + at(top, left) - at(top, right) - at(low, left);
        (sum, ((right - left) * (low - top)) as u64)
    }
}

/// Sums of the grey levels around each pixel, for a window of any size.
pub(super) struct Sums {
    /// Sums over the pixels that cannot belong to a glare: each pixel adds [`PIXEL_COUNT_UNIT`], so that a sum also
    /// contains the number of pixels.
    without_glare: Integral,
    total: Integral,
}

impl Sums {
    pub fn from_picture(picture: &GrayPicture) -> Self {
        let (width, height) = (picture.width, picture.height);
        let gray = |index: usize| u64::from(picture.gray[index]);
        let glare = Integral::new(width, height, |index| u64::from(picture.gray[index] >= MIN_GLARE_GRAY));
        let rim_px = width.max(height) / GLARE_RIM_DIVISOR;
        let without = Integral::new(width, height, |index| {
            let (near, _) = glare.window_sum(index % width, index / width, rim_px);
            if near == 0 { gray(index) + PIXEL_COUNT_UNIT } else { 0 }
        });
        Sums { without_glare: without, total: Integral::new(width, height, gray) }
    }

    fn mean(&self, column: usize, row: usize, reach: usize) -> f64 {
        let (without, area) = self.without_glare.window_sum(column, row, reach);
        let count = without / PIXEL_COUNT_UNIT;
        // If most of the surrounding pixels seem to be a glare, they may be white paper, which can be as bright: then
        // all pixels are used.
        if 4 * count < area {
            return self.total.window_sum(column, row, reach).0 as f64 / area as f64;
        }
        (without % PIXEL_COUNT_UNIT) as f64 / count as f64
    }
}

#[derive(Default)]
struct ConnectedComponent {
    count: f64,
    sum: [f64; 2],
    square: [f64; 3],
    touches_rim: bool,
}

impl ConnectedComponent {
    fn add(&mut self, u: f64, v: f64) {
        self.count += 1.0;
        self.sum = [self.sum[0] + u, self.sum[1] + v];
        self.square = [self.square[0] + u * u, self.square[1] + u * v, self.square[2] + v * v];
    }

    fn blob(&self, picture_px: f64) -> Option<Blob> {
        if self.touches_rim || self.count < MIN_AREA_PX || self.count > MAX_AREA_FRACTION * picture_px {
            return None;
        }
        let [u, v] = self.sum.map(|sum| sum / self.count);
        let [uu, uv, vv] = self.square.map(|square| square / self.count);
        // Each pixel is a square, which adds a variance of 1/12 in each direction.
        let covariance = Matrix2::new(uu - u * u + 1.0 / 12.0, uv - u * v, uv - u * v, vv - v * v + 1.0 / 12.0);
        let axes = covariance.symmetric_eigenvalues();
        let (long, short) = (axes.max().sqrt(), axes.min().max(0.0).sqrt());
        let round = self.count / (4.0 * std::f64::consts::PI * long * short);
        let is_ellipse = (round - 1.0).abs() < MAX_ROUNDNESS_ERROR && long < MAX_AXIS_RATIO * short;
        is_ellipse.then_some(Blob { centre: Pixel::at(u, v), area_px: self.count })
    }
}

/// Maximum difference between a step and its prediction from the previous step, as a fraction of the step length.
const PREDICTION_TOLERANCE: f64 = 0.27;
/// Maximum ratio of the areas of neighbouring circles; one circle of a board, the mark, may be larger.
const MAX_NEIGHBOUR_AREA_RATIO: f64 = 5.5;
/// Maximum number of neighbours that are tried for the first steps. `MAX_STEP_PAIRS` is the maximum number of pairs of
/// first steps, `MAX_SEEDS` the maximum number of blobs at which a lattice begins.
const MAX_FIRST_NEIGHBOURS: usize = 6;
const MAX_STEP_PAIRS: usize = 4;
const MAX_SEEDS: usize = 25;
/// Minimum fraction of the circles of the board that must be detected.
const MIN_SEEN_FRACTION: f64 = 0.5;

/// Circles by their index in the list of the board's circles.
pub(super) type LatticePositions = BTreeMap<usize, Blob>;

/// Finds the board among the blobs, which are sorted by likelihood, the most likely first; `None` if it is not found.
pub(super) fn grid(blobs: &[Blob], board: &Board) -> Option<LatticePositions> {
    let needed = (MIN_SEEN_FRACTION * board.count() as f64).ceil() as usize;
    let mut used: BTreeSet<usize> = BTreeSet::new();
    let mut best: Option<LatticePositions> = None;
    for seed in 0..blobs.len().min(MAX_SEEDS) {
        if used.contains(&seed) {
            continue;
        }
        for (right, down) in candidate_steps(blobs, seed) {
            let lattice = grow_lattice(blobs, seed, (right, down));
            if lattice.len() < needed {
                continue;
            }
            if let Some(placed) = assign_to_board(blobs, &lattice, board)
                && best.as_ref().is_none_or(|best| best.len() < placed.len())
            {
                used.extend(lattice.values().copied());
                best = Some(placed);
                break;
            }
        }
        if best.as_ref().is_some_and(|best| best.len() == board.count()) {
            break;
        }
    }
    best
}

fn offset_between(blobs: &[Blob], from: usize, to: usize) -> Vector2<f64> {
    let (a, b) = (blobs[from].centre, blobs[to].centre);
    Vector2::new(b.u - a.u, b.v - a.v)
}

fn are_similar(one: &Blob, two: &Blob) -> bool {
    (1.0 / MAX_NEIGHBOUR_AREA_RATIO..=MAX_NEIGHBOUR_AREA_RATIO).contains(&(one.area_px / two.area_px))
}

/// Returns pairs of steps to neighbours, never mirrored; the shortest steps are first.
fn candidate_steps(blobs: &[Blob], seed: usize) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let mut near: Vec<Vector2<f64>> = (0..blobs.len())
        .filter(|other| *other != seed && are_similar(&blobs[*other], &blobs[seed]))
        .map(|other| offset_between(blobs, seed, other))
        .collect();
    near.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    near.truncate(MAX_FIRST_NEIGHBOURS);
    let mut pairs: Vec<(Vector2<f64>, Vector2<f64>)> = Vec::new();
    for (index, one) in near.iter().enumerate() {
        for two in &near[..index] {
            let sine = two.perp(one) / (one.norm() * two.norm());
            if sine.abs() > 0.3 {
                pairs.push(if sine > 0.0 { (*two, *one) } else { (*one, *two) });
            }
        }
    }
    pairs.truncate(MAX_STEP_PAIRS);
    pairs
}

/// Returns the lattice that these steps span from a blob.
fn grow_lattice(
    blobs: &[Blob],
    seed: usize,
    (right, down): (Vector2<f64>, Vector2<f64>),
) -> BTreeMap<(i32, i32), usize> {
    let mut lattice = BTreeMap::from([((0, 0), seed)]);
    let mut taken = BTreeSet::from([seed]);
    let mut open = VecDeque::from([(0, 0)]);
    while let Some(at) = open.pop_front() {
        for step in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
            let there = (at.0 + step.0, at.1 + step.1);
            if lattice.contains_key(&there) {
                continue;
            }
            let own = lattice[&at];
            let place = |at: (i32, i32)| lattice.get(&at).copied();
            let pair = |from: (i32, i32)| {
                Some(offset_between(blobs, place(from)?, place((from.0 + step.0, from.1 + step.1))?))
            };
            let foretold = pair((at.0 - step.0, at.1 - step.1))
                .or_else(|| pair((at.0 + step.1, at.1 + step.0)))
                .or_else(|| pair((at.0 - step.1, at.1 - step.0)))
                .unwrap_or_else(|| right * f64::from(step.0) + down * f64::from(step.1));
            let off = |index: usize| (offset_between(blobs, own, index) - foretold).norm();
            let nearest = (0..blobs.len())
                .filter(|index| !taken.contains(index) && are_similar(&blobs[*index], &blobs[own]))
                .min_by(|a, b| off(*a).total_cmp(&off(*b)));
            if let Some(index) = nearest.filter(|index| off(*index) < PREDICTION_TOLERANCE * foretold.norm()) {
                lattice.insert(there, index);
                taken.insert(index);
                open.push_back(there);
            }
        }
    }
    lattice
}

/// Assigns the lattice to the circles of the board. If several assignments match, the one with the first circle at the
/// top is used.
fn assign_to_board(
    blobs: &[Blob],
    lattice: &BTreeMap<(i32, i32), usize>,
    board: &Board,
) -> Option<LatticePositions> {
    let is_asymmetric = board.circles()?;
    let places: BTreeMap<(i32, i32), usize> = (0..board.count())
        .map(|index| {
            let (column, row) = ((index % board.columns()) as i32, (index / board.columns()) as i32);
            ((if is_asymmetric { 2 * column + row % 2 } else { column }, row), index)
        })
        .collect();
    let far = |coordinate: fn(&(i32, i32)) -> i32| places.keys().map(coordinate).max().unwrap_or(0);
    let (wide, high) = (far(|at| at.0), far(|at| at.1));
    let needed = (MIN_SEEN_FRACTION * board.count() as f64).ceil() as usize;
    let mut ways: Vec<LatticePositions> = Vec::new();
    for [a, b, c, d] in lattice_transforms(is_asymmetric) {
        let moved: Vec<((i32, i32), usize)> =
            lattice.iter().map(|((x, y), index)| ((a * x + b * y, c * x + d * y), *index)).collect();
        // An outer line with very few circles belongs to an object beside the board.
        let Some(low) = find_origin(&moved, (wide, high)) else { continue };
        let placed: LatticePositions = moved
            .iter()
            .filter_map(|((x, y), index)| Some((*places.get(&(x - low.0, y - low.1))?, blobs[*index])))
            .collect();
        let outside = moved.len() - placed.len();
        if placed.len() >= needed && 10 * outside <= placed.len() {
            ways.push(placed);
        }
    }
    let max_count = ways.iter().map(BTreeMap::len).max()?;
    let upper = |placed: &LatticePositions| {
        let (first, last) = (placed.values().next(), placed.values().next_back());
        first.zip(last).map_or(0.0, |(first, last)| first.centre.v - last.centre.v)
    };
    ways.into_iter().filter(|way| way.len() == max_count).min_by(|a, b| upper(a).total_cmp(&upper(b)))
}

/// Finds the coordinates of the first column and row of the board: the position at which the board contains most of the
/// blobs.
fn find_origin(moved: &[((i32, i32), usize)], (wide, high): (i32, i32)) -> Option<(i32, i32)> {
    let start = |of: fn(&(i32, i32)) -> i32, length: i32| {
        let (low, top) =
            moved.iter().map(|(at, _)| of(at)).fold((i32::MAX, i32::MIN), |(l, h), n| (l.min(n), h.max(n)));
        let inside = |start: i32| moved.iter().filter(|(at, _)| (start..=start + length).contains(&of(at))).count();
        // At most two extra lines are omitted, and no line may be missing.
        let excess = top - low - length;
        (0..=2).contains(&excess).then(|| (low..=low + excess).max_by_key(|s| (inside(*s), -s)).unwrap_or(low))
    };
    Some((start(|at| at.0, wide)?, start(|at| at.1, high)?))
}

/// Returns rotations and shears without mirroring, as a, b, c, d of x' = a x + b y, y' = c x + d y.
fn lattice_transforms(is_asymmetric: bool) -> Vec<[i32; 4]> {
    let product = |[a, b, c, d]: [i32; 4], [e, f, g, h]: [i32; 4]| {
        [a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h]
    };
    let quarter = [0, -1, 1, 0];
    let mut all = Vec::new();
    let shears = [[1, 0, 0, 1], [1, 1, 0, 1], [1, -1, 0, 1], [1, 0, 1, 1], [1, 0, -1, 1]];
    for shear in shears {
        // The directions of the lattice of an asymmetric board are those of the board's diagonals.
        let mut turned = if is_asymmetric { product([1, -1, 1, 1], shear) } else { shear };
        for _ in 0..4 {
            all.push(turned);
            turned = product(quarter, turned);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Pixel;

    /// A tilted asymmetric board and a symmetric one, each with a few blobs beside it: all circles are found, in the
    /// order of the board.
    #[test]
    fn circles_of_tilted_grids_are_put_in_order() {
        for text in ["circles:7x5:10", "acircles:4x9:10"] {
            let board = Board::parse(text, None).expect("a board");
            let seen = |x: f64, y: f64| {
                let w = 1.0 + 0.004 * x - 0.003 * y;
                Pixel::at((300.0 + 4.0 * x + 0.8 * y) / w, (200.0 - 0.5 * x + 2.1 * y) / w)
            };
            let corners = board.corners();
            let mut blobs: Vec<Blob> =
                corners.iter().rev().map(|q| Blob { centre: seen(q.mm.x, q.mm.y), area_px: 60.0 }).collect();
            blobs.push(Blob { centre: Pixel::at(20.0, 30.0), area_px: 60.0 });
            blobs.push(Blob { centre: Pixel::at(310.0, 10.0), area_px: 900.0 });
            let placed = grid(&blobs, &board).expect(text);
            assert_eq!(placed.len(), board.count());
            for (index, blob) in &placed {
                let expected = seen(corners[*index].mm.x, corners[*index].mm.y);
                let turned = seen(corners[board.count() - 1 - index].mm.x, corners[board.count() - 1 - index].mm.y);
                let off = blob.centre.distance_px(expected).min(blob.centre.distance_px(turned));
                assert!(off < 1e-9, "{text}: {index}");
            }
        }
    }

    /// A disc, a ring and a bar: only the disc is found.
    #[test]
    fn a_disc_is_found_and_a_bar_is_not() {
        let mut picture = GrayPicture::uniform(120, 80, 200);
        for (index, gray) in picture.gray.iter_mut().enumerate() {
            let (u, v) = ((index % 120) as f64, (index / 120) as f64);
            let ring = (u - 70.0).hypot(v - 30.0);
            let disc = (u - 30.25).hypot(v - 30.0) < 9.0;
            if disc || (6.0..9.0).contains(&ring) || (v - 60.0).abs() < 2.0 && (u - 60.0).abs() < 30.0 {
                *gray = 40;
            }
        }
        let found = blobs(&picture, &Sums::from_picture(&picture), 20, false).expect("a picture");
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].centre.distance_px(Pixel::at(30.25, 30.0)) < 0.15, "{found:?}");
        assert!(
            blobs(&picture, &Sums::from_picture(&picture), 20, true)
                .expect("a picture")
                .iter()
                .all(|blob| blob.centre.distance_px(Pixel::at(70.0, 30.0)) < 1.0)
        );
    }
}
