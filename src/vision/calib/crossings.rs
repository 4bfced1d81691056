//! Finds the points of a picture at which two edges cross, as at the corners of a chessboard, and joins them to the
//! lattice of a chessboard.
//!
//! The positions are approximate, and each point is classified independently of the others. In a smoothed picture a
//! crossing is a saddle: its Hessian has a negative determinant. On a ring around it the grey levels change between
//! dark and bright four times, and opposite points of the ring are similar. At the end of an edge, on a line or in
//! noise they are not. The four changes give the directions of both edges. The computing time grows only with the
//! number of pixels.
//!
//! The lattice grows from corner to corner along its edges. One edge connects two neighbouring corners, with one colour
//! to its left and the other to its right over its whole length. The lattice begins at a first corner. Each step is
//! predicted from the previous one, and a corner is added if edges lead to all of its neighbours that are already part
//! of the lattice. The lattice therefore stays correct if corners are missing under a glare, and ends at the end of the
//! board. The number of edge evaluations is counted and limited.

use nalgebra::Vector2;
use panelprep_base::geometry::statistics::NORMAL_HALF;
use panelprep_base::geometry::{GrayPicture, Pixel};
use rayon::prelude::*;
use std::collections::{BTreeMap, VecDeque};

/// A point where two edges cross.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    /// Position of the crossing in the picture, px.
    pub position: Vector2<f64>,
    /// Unit vectors along both edges.
    pub edges: [Vector2<f64>; 2],
    /// Half of the contrast on the ring, grey levels.
    pub contrast: f64,
}

/// A picture, smoothed by a Gaussian of 1 px.
pub(super) struct SmoothedPicture {
    pub width: usize,
    pub height: usize,
    gray: Vec<f32>,
    /// Noise of the picture before the smoothing, grey levels.
    pub noise: f64,
}

/// Radius of the ring around a saddle, px.
const RING_RADIUS_PX: f64 = 4.0;
const RING_SAMPLE_COUNT: usize = 32;
/// Minimum correlation between opposite positions of the ring.
const MIN_RING_CORRELATION: f64 = 0.55;
/// Minimum half contrast of a corner, grey levels. `MIN_CONTRAST_TO_NOISE` is its minimum ratio to the noise that
/// remains after the smoothing.
const MIN_CONTRAST: f64 = 3.0;
const MIN_CONTRAST_TO_NOISE: f64 = 3.0;
/// The fraction of white noise that remains after the smoothing.
const SMOOTHED_NOISE_FRACTION: f64 = 0.27;
/// Maximum bend of an edge, rad: the difference of the directions to two opposite changes of the ring from a straight
/// line.
const MAX_BEND_RAD: f64 = 0.6;
/// Minimum angle between two edges that cross, rad.
const MIN_ANGLE_RAD: f64 = 0.3;
/// Maximum number of crossings: hardly any board has more corners. The crossings with the highest contrast are kept.
const MAX_CROSSINGS: usize = 6000;
/// Minimum distance between saddles, px: each window of this half width contains at most one saddle.
const MIN_SADDLE_DISTANCE_PX: usize = 3;

impl SmoothedPicture {
    pub fn from_picture(picture: &GrayPicture) -> Self {
        let (width, height) = (picture.width, picture.height);
        let blur = |left: f32, near: f32, middle: f32, far: f32, right: f32| {
            (left + right + 4.0 * (near + far) + 6.0 * middle) / 16.0
        };
        let mut across = vec![0.0f32; width * height];
        across.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, line)| {
            let from = &picture.gray[row * width..(row + 1) * width];
            let at = |column: isize| f32::from(from[column.clamp(0, width as isize - 1) as usize]);
            for (column, value) in line.iter_mut().enumerate() {
                let c = column as isize;
                *value = blur(at(c - 2), at(c - 1), at(c), at(c + 1), at(c + 2));
            }
        });
        let mut gray = vec![0.0f32; width * height];
        gray.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, line)| {
            let start = |row: isize| row.clamp(0, height as isize - 1) as usize * width;
            let r = row as isize;
            let rows = [r - 2, r - 1, r, r + 1, r + 2].map(start);
            for (column, value) in line.iter_mut().enumerate() {
                let [a, b, c, d, e] = rows.map(|row| across[row + column]);
                *value = blur(a, b, c, d, e);
            }
        });
        SmoothedPicture { width, height, gray, noise: noise(picture) }
    }

    /// Returns the smoothed picture with rounded grey levels.
    pub fn picture(&self) -> GrayPicture {
        let gray = self.gray.iter().map(|gray| gray.round().clamp(0.0, 255.0) as u8).collect();
        GrayPicture { width: self.width, height: self.height, gray }
    }

    /// Returns the grey level interpolated between pixels; outside of the picture, the grey level at its border.
    pub fn interpolate(&self, at: Vector2<f64>) -> f64 {
        let (u, v) = (at.x.clamp(0.0, self.width as f64 - 1.001), at.y.clamp(0.0, self.height as f64 - 1.001));
        let (column, row) = (u as usize, v as usize);
        let (right, low) = (u - column as f64, v - row as f64);
        let gray = |column: usize, row: usize| {
            f64::from(self.gray[row.min(self.height - 1) * self.width + column.min(self.width - 1)])
        };
        let above = gray(column, row) * (1.0 - right) + gray(column + 1, row) * right;
        let below = gray(column, row + 1) * (1.0 - right) + gray(column + 1, row + 1) * right;
        above * (1.0 - low) + below * low
    }
}

/// Returns the rms of white noise in a picture, computed from the median residual of a plane through the neighbours of
/// a pixel (Immerkær, Computer Vision and Image Understanding 64, 1996), over a sample of the pixels.
pub(super) fn noise(picture: &GrayPicture) -> f64 {
    let (width, height) = (picture.width, picture.height);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let mut counts = [0usize; 256 * 16];
    let step = (width * height / 200_000).max(1);
    let mut all = 0;
    for index in (width + 1..width * (height - 1) - 1).step_by(step) {
        let at = |offset: isize| i32::from(picture.gray[(index as isize + offset) as usize]);
        let w = width as isize;
        let left =
            at(-w - 1) + at(-w + 1) + at(w - 1) + at(w + 1) - 2 * (at(-w) + at(w) + at(-1) + at(1)) + 4 * at(0);
        counts[(left.unsigned_abs() as usize).min(counts.len() - 1)] += 1;
        all += 1;
    }
    let mut below = 0;
    let median = counts.iter().position(|count| {
        below += count;
        2 * below > all
    });
    // The operator's gain is 6.
    median.unwrap_or(0) as f64 / (6.0 * NORMAL_HALF)
}

/// Returns the crossings of edges in a picture, at most [`MAX_CROSSINGS`].
pub(super) fn crossings(picture: &SmoothedPicture) -> Vec<Crossing> {
    let rim = RING_RADIUS_PX as usize + 3;
    if picture.width <= 2 * rim || picture.height <= 2 * rim {
        return Vec::new();
    }
    let width = picture.width;
    let gray = |index: usize| picture.gray[index];
    let saddle = |index: usize| {
        let middle = 2.0 * gray(index);
        let across = gray(index + 2) - middle + gray(index - 2);
        let down = gray(index + 2 * width) - middle + gray(index - 2 * width);
        let mixed = (gray(index + 2 * width + 2) - gray(index + 2 * width - 2) - gray(index - 2 * width + 2)
            + gray(index - 2 * width - 2))
            / 4.0;
        mixed * mixed - across * down
    };
    let mut response = vec![0.0f32; picture.gray.len()];
    response.par_chunks_mut(width).enumerate().skip(3).take(picture.height - 6).for_each(|(row, line)| {
        (3..width - 3).for_each(|column| line[column] = saddle(row * width + column));
    });
    let least_contrast = MIN_CONTRAST.max(MIN_CONTRAST_TO_NOISE * SMOOTHED_NOISE_FRACTION * picture.noise);
    // The determinant is about the square of the half contrast at a sharp corner, and a fifth of it at a blurred
    // corner.
    let min_response = (0.15 * least_contrast * least_contrast) as f32;
    let rows: Vec<Vec<Crossing>> = (rim..picture.height - rim)
        .into_par_iter()
        .map(|row| {
            let peak = |column: usize| {
                let (index, here) = (row * width + column, response[row * width + column]);
                here > min_response
                    && (row - MIN_SADDLE_DISTANCE_PX..=row + MIN_SADDLE_DISTANCE_PX).all(|r| {
                        let line = r * width + column;
                        response[line - MIN_SADDLE_DISTANCE_PX..=line + MIN_SADDLE_DISTANCE_PX]
                            .iter()
                            .enumerate()
                            .all(|(c, other)| {
                                *other < here || (*other == here && line - MIN_SADDLE_DISTANCE_PX + c >= index)
                            })
                    })
            };
            (rim..width - rim)
                .filter(|column| peak(*column))
                .filter_map(|column| classify_saddle(picture, column, row, least_contrast))
                .collect()
        })
        .collect();
    let mut all = rows.concat();
    if all.len() > MAX_CROSSINGS {
        all.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
        all.truncate(MAX_CROSSINGS);
    }
    all
}

/// Returns the point near a saddle at which the gradient of the smoothed picture is zero.
fn refine_saddle(picture: &SmoothedPicture, column: usize, row: usize) -> Vector2<f64> {
    let mut at = Vector2::new(column as f64, row as f64);
    let start = at;
    for _ in 0..2 {
        let gray = |u: f64, v: f64| picture.interpolate(at + Vector2::new(u, v));
        let (here, right, left, low, high) =
            (gray(0.0, 0.0), gray(1.5, 0.0), gray(-1.5, 0.0), gray(0.0, 1.5), gray(0.0, -1.5));
        let mixed = (gray(1.5, 1.5) - gray(1.5, -1.5) - gray(-1.5, 1.5) + gray(-1.5, -1.5)) / 9.0;
        let hessian = nalgebra::Matrix2::new(
            (right - 2.0 * here + left) / 2.25,
            mixed,
            mixed,
            (low - 2.0 * here + high) / 2.25,
        );
        let Some(inverse) = hessian.try_inverse() else { return start };
        at -= inverse * Vector2::new((right - left) / 3.0, (low - high) / 3.0);
    }
    if (at - start).norm() < 2.0 { at } else { start }
}

/// Returns the saddle as a crossing; `None` if its ring is not that of a crossing.
fn classify_saddle(picture: &SmoothedPicture, column: usize, row: usize, least_contrast: f64) -> Option<Crossing> {
    let at = refine_saddle(picture, column, row);
    let angle = |index: f64| std::f64::consts::TAU * index / RING_SAMPLE_COUNT as f64;
    let ring: [f64; RING_SAMPLE_COUNT] = std::array::from_fn(|index| {
        let (sin, cos) = angle(index as f64).sin_cos();
        picture.interpolate(at + Vector2::new(cos, sin) * RING_RADIUS_PX)
    });
    let (low, high) = ring.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), g| (l.min(*g), h.max(*g)));
    let contrast = (high - low) / 2.0;
    if contrast < least_contrast {
        return None;
    }
    let mean = ring.iter().sum::<f64>() / RING_SAMPLE_COUNT as f64;
    let square: f64 = ring.iter().map(|gray| (gray - mean).powi(2)).sum();
    let product: f64 = (0..RING_SAMPLE_COUNT)
        .map(|i| (ring[i] - mean) * (ring[(i + RING_SAMPLE_COUNT / 2) % RING_SAMPLE_COUNT] - mean))
        .sum();
    if product < MIN_RING_CORRELATION * square {
        return None;
    }
    let middle = (low + high) / 2.0;
    let changes: Vec<f64> = (0..RING_SAMPLE_COUNT)
        .filter_map(|index| {
            let (here, next) = (ring[index] - middle, ring[(index + 1) % RING_SAMPLE_COUNT] - middle);
            ((here > 0.0) != (next > 0.0)).then(|| angle(index as f64 + here / (here - next)))
        })
        .collect();
    let changes: [f64; 4] = changes.try_into().ok()?;
    let edge = |one: f64, two: f64| {
        let bend = two - one - std::f64::consts::PI;
        (bend.abs() < MAX_BEND_RAD).then(|| {
            let along = one + bend / 2.0;
            Vector2::new(along.cos(), along.sin())
        })
    };
    let edges = [edge(changes[0], changes[2])?, edge(changes[1], changes[3])?];
    (edges[0].perp(&edges[1]).abs() > MIN_ANGLE_RAD.sin()).then_some(Crossing { position: at, edges, contrast })
}

impl Crossing {
    /// Returns the position as a pixel.
    pub fn pixel(&self) -> Pixel {
        Pixel::at(self.position.x, self.position.y)
    }
}

/// Corners by column and row, which may be negative.
pub(super) type Lattice = BTreeMap<(i32, i32), usize>;

/// Minimum distance between neighbouring corners, px.
const MIN_NEIGHBOUR_DISTANCE_PX: f64 = 6.0;
/// Maximum distance between neighbouring corners, px: a larger board is found in a smaller picture.
const MAX_NEIGHBOUR_DISTANCE_PX: f64 = 170.0;
/// Radius of the first search for neighbours, px; if it contains enough candidates, the search does not extend farther.
const FIRST_SEARCH_RADIUS_PX: f64 = 60.0;
/// Cosine of the maximum angle between a first step and the direction of an edge.
const MIN_STEP_COSINE: f64 = 0.966;
/// Cosine of the maximum angle between an edge of the neighbour and the line from the corner to the neighbour.
const MIN_EDGE_COSINE: f64 = 0.90;
/// Maximum difference between a step and its prediction from the previous step, as a fraction of the step length.
const PREDICTION_TOLERANCE: f64 = 0.28;
/// Maximum number of crossings that are examined along a first edge.
const MAX_NEIGHBOURS: usize = 10;
/// Minimum ratio of the contrast across the edge to that of the corners.
const MIN_EDGE_CONTRAST_RATIO: f64 = 0.3;
/// Maximum ratio between the contrasts of neighbouring corners.
const MAX_NEIGHBOUR_CONTRAST_RATIO: f64 = 3.5;
/// Maximum number of edge checks for one picture.
const MAX_EDGE_CHECKS: usize = 250_000;
/// Minimum number of corners of a lattice.
const MIN_CORNERS: usize = 6;

/// Returns all lattices of a picture, the largest first.
pub(super) fn lattices(picture: &SmoothedPicture, crossings: &[Crossing]) -> Vec<Lattice> {
    let mut field = CrossingGrid::new(picture, crossings);
    let mut used = vec![false; crossings.len()];
    let mut all: Vec<Lattice> = Vec::new();
    for seed in 0..crossings.len() {
        if used[seed] || field.looks > MAX_EDGE_CHECKS {
            continue;
        }
        let grown = field.grow_lattice(seed, &used);
        if grown.len() >= MIN_CORNERS {
            grown.values().for_each(|index| used[*index] = true);
            all.push(grown);
        }
    }
    all.sort_by_key(|lattice| std::cmp::Reverse(lattice.len()));
    all
}

/// Returns the minimum and the maximum column and row of a lattice.
pub(super) fn extent(lattice: &Lattice) -> [(i32, i32); 2] {
    let range = |of: fn(&(i32, i32)) -> i32| {
        let all = lattice.keys().map(of);
        (all.clone().min().unwrap_or(0), all.max().unwrap_or(-1))
    };
    [range(|at| at.0), range(|at| at.1)]
}

/// Returns the lattice without the outer lines of which less than this fraction is present.
pub(super) fn trim_sparse_lines(mut lattice: Lattice, share: f64) -> Lattice {
    loop {
        let [columns, rows] = extent(&lattice);
        let wide = (columns.1 - columns.0 + 1) as usize;
        let high = (rows.1 - rows.0 + 1) as usize;
        let few = |count: usize, length: usize| (count as f64) < share * length as f64;
        let line = |is_in: &dyn Fn(&(i32, i32)) -> bool| lattice.keys().filter(|at| is_in(at)).count();
        let column = [columns.0, columns.1].into_iter().find(|c| few(line(&|at| at.0 == *c), high));
        let row = [rows.0, rows.1].into_iter().find(|r| few(line(&|at| at.1 == *r), wide));
        match (column, row) {
            (Some(column), _) => lattice.retain(|at, _| at.0 != column),
            (None, Some(row)) => lattice.retain(|at, _| at.1 != row),
            (None, None) => return lattice,
        }
        if lattice.is_empty() {
            return lattice;
        }
    }
}

/// The crossings of a picture, sorted into cells by their position.
struct CrossingGrid<'a> {
    picture: &'a SmoothedPicture,
    crossings: &'a [Crossing],
    cells: Vec<Vec<usize>>,
    across: usize,
    looks: usize,
}

const CELL_PX: f64 = 24.0;

/// Unit vectors along the directions of columns and rows, at a corner of a growing lattice.
type Axes = [Vector2<f64>; 2];

impl<'a> CrossingGrid<'a> {
    fn new(picture: &'a SmoothedPicture, crossings: &'a [Crossing]) -> Self {
        let across = (picture.width as f64 / CELL_PX) as usize + 1;
        let down = (picture.height as f64 / CELL_PX) as usize + 1;
        let mut cells = vec![Vec::new(); across * down];
        for (index, crossing) in crossings.iter().enumerate() {
            let cell = (crossing.position.y / CELL_PX) as usize * across + (crossing.position.x / CELL_PX) as usize;
            if let Some(cell) = cells.get_mut(cell) {
                cell.push(index);
            }
        }
        CrossingGrid { picture, crossings, cells, across, looks: 0 }
    }

    /// Returns the crossings within a distance that satisfy `is_one`, the nearest first.
    fn crossings_within(
        &self,
        at: Vector2<f64>,
        reach: f64,
        is_one: &dyn Fn(f64, Vector2<f64>) -> bool,
    ) -> Vec<(f64, usize)> {
        let cell = |place: f64| (place / CELL_PX).floor().max(0.0) as usize;
        let down = self.cells.len() / self.across;
        let mut all = Vec::new();
        for row in cell(at.y - reach)..=cell(at.y + reach).min(down - 1) {
            for column in cell(at.x - reach)..=cell(at.x + reach).min(self.across - 1) {
                for &index in &self.cells[row * self.across + column] {
                    let between = self.crossings[index].position - at;
                    let away = between.norm();
                    if away <= reach && is_one(away, between) {
                        all.push((away, index));
                    }
                }
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all
    }

    fn grow_lattice(&mut self, seed: usize, used: &[bool]) -> Lattice {
        let mut lattice = Lattice::new();
        let mut axes: BTreeMap<(i32, i32), Axes> = BTreeMap::new();
        let mut taken = std::collections::BTreeSet::new();
        let first = self.crossings[seed];
        lattice.insert((0, 0), seed);
        axes.insert((0, 0), first.edges);
        taken.insert(seed);
        let mut open = VecDeque::from([(0, 0)]);
        while let Some(at) = open.pop_front() {
            for step in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let there = (at.0 + step.0, at.1 + step.1);
                if lattice.contains_key(&there) {
                    continue;
                }
                let found = self
                    .find_neighbour(&lattice, &axes[&at], at, step, &|index| used[index] || taken.contains(&index));
                let Some((index, turned)) = found else { continue };
                let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)]
                    .map(|s| (there.0 + s.0, there.1 + s.1))
                    .into_iter()
                    .filter(|place| *place != at)
                    .filter_map(|place| lattice.get(&place).copied());
                let beside: Vec<usize> = beside.collect();
                if beside.into_iter().any(|other| !self.is_connected_by_edge(other, index)) {
                    continue;
                }
                lattice.insert(there, index);
                axes.insert(there, turned);
                taken.insert(index);
                open.push_back(there);
            }
        }
        lattice
    }

    /// Returns the neighbour of a corner, and the axes at the neighbour.
    fn find_neighbour(
        &mut self,
        lattice: &Lattice,
        axes: &Axes,
        at: (i32, i32),
        step: (i32, i32),
        is_taken: &dyn Fn(usize) -> bool,
    ) -> Option<(usize, Axes)> {
        let own = lattice[&at];
        let here = self.crossings[own].position;
        let place = |at: (i32, i32)| lattice.get(&at).map(|index| self.crossings[*index].position);
        let (axis, sign) = if step.0 != 0 { (0, step.0) } else { (1, step.1) };
        let along = axes[axis] * f64::from(sign);
        let side = |s: (i32, i32)| {
            let beside = (at.0 + s.0, at.1 + s.1);
            Some(place((beside.0 + step.0, beside.1 + step.1))? - place(beside)?)
        };
        let back = place((at.0 - step.0, at.1 - step.1)).map(|back| here - back);
        let across = if axis == 0 { [(0, 1), (0, -1)] } else { [(1, 0), (-1, 0)] };
        let foretold = back.or_else(|| across.into_iter().find_map(side));
        let near: Vec<usize> = match foretold {
            Some(shift) => {
                let all = self.crossings_within(here + shift, PREDICTION_TOLERANCE * shift.norm(), &|_, _| true);
                all.into_iter().map(|(_, index)| index).collect()
            }
            None => {
                let is_ahead = |away: f64, between: Vector2<f64>| {
                    away > MIN_NEIGHBOUR_DISTANCE_PX && between.dot(&along) > MIN_STEP_COSINE * away
                };
                let mut all = self.crossings_within(here, FIRST_SEARCH_RADIUS_PX, &is_ahead);
                if all.len() < MAX_NEIGHBOURS {
                    all = self.crossings_within(here, MAX_NEIGHBOUR_DISTANCE_PX, &is_ahead);
                }
                all.into_iter().map(|(_, index)| index).take(MAX_NEIGHBOURS).collect()
            }
        };
        for index in near {
            if index == own || is_taken(index) || !self.is_connected_by_edge(own, index) {
                continue;
            }
            let other = &self.crossings[index];
            let toward = (other.position - here).normalize() * f64::from(sign);
            // The edge of the neighbour that leads to this corner is the same axis; its second edge is the other axis.
            let which = usize::from(other.edges[1].dot(&toward).abs() > other.edges[0].dot(&toward).abs());
            let same =
                |edge: Vector2<f64>, as_here: Vector2<f64>| if edge.dot(&as_here) < 0.0 { -edge } else { edge };
            let mut turned = *axes;
            turned[axis] = same(other.edges[which], toward);
            turned[1 - axis] = same(other.edges[1 - which], axes[1 - axis]);
            return Some((index, turned));
        }
        None
    }

    /// Returns whether an edge connects the two crossings.
    fn is_connected_by_edge(&mut self, one: usize, two: usize) -> bool {
        self.looks += 1;
        let (a, b) = (&self.crossings[one], &self.crossings[two]);
        let between = b.position - a.position;
        let length = between.norm();
        let factor = a.contrast / b.contrast;
        if length < MIN_NEIGHBOUR_DISTANCE_PX
            || !(1.0 / MAX_NEIGHBOUR_CONTRAST_RATIO..=MAX_NEIGHBOUR_CONTRAST_RATIO).contains(&factor)
        {
            return false;
        }
        let along = between / length;
        let runs = |crossing: &Crossing| crossing.edges.iter().any(|edge| edge.dot(&along).abs() > MIN_EDGE_COSINE);
        if !runs(a) || !runs(b) {
            return false;
        }
        let aside = Vector2::new(-along.y, along.x) * (0.13 * length).clamp(1.5, 3.5);
        let step = |share: f64| {
            let at = a.position + between * share;
            self.picture.interpolate(at + aside) - self.picture.interpolate(at - aside)
        };
        let steps = [0.25, 0.38, 0.5, 0.62, 0.75].map(step);
        let mean = steps.iter().sum::<f64>() / 5.0;
        let min_contrast = MIN_EDGE_CONTRAST_RATIO * a.contrast.min(b.contrast);
        let beyond = (2.5 / length).max(0.2);
        mean.abs() > min_contrast
            && steps.iter().all(|step| step * mean.signum() > 0.25 * mean.abs())
            && step(-beyond) * mean.signum() < 0.25 * mean.abs()
            && step(1.0 + beyond) * mean.signum() < 0.25 * mean.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture shows two edges along 10° and 70° that cross at (40.3, 30.6). Left of u = 70 px only the crossing is
    /// found, and no other point of the edges.
    #[test]
    fn a_crossing_is_found_and_points_of_edges_are_not() {
        let mut picture = GrayPicture::uniform(120, 60, 0);
        for (index, gray) in picture.gray.iter_mut().enumerate() {
            let (u, v) = ((index % 120) as f64, (index / 120) as f64);
            let side = |deg: f64| {
                let (sin, cos) = deg.to_radians().sin_cos();
                (cos * (v - 30.6) - sin * (u - 40.3)).clamp(-0.5, 0.5)
            };
            let pattern = if u < 80.0 { 4.0 * side(10.0) * side(70.0) } else { if u < 100.0 { -1.0 } else { 1.0 } };
            *gray = (120.0 + 60.0 * pattern) as u8;
        }
        let smooth = SmoothedPicture::from_picture(&picture);
        let near: Vec<Crossing> = crossings(&smooth).into_iter().filter(|found| found.position.x < 70.0).collect();
        assert_eq!(near.len(), 1, "{near:?}");
        assert!((near[0].position - Vector2::new(40.3, 30.6)).norm() < 0.3, "{near:?}");
        let deg = near[0].edges.map(|edge| (edge.y / edge.x).atan().to_degrees());
        assert!((deg[0] - 10.0).abs() < 4.0 && (deg[1] - 70.0).abs() < 4.0, "{deg:?}");
        assert!(near[0].contrast > 40.0 && smooth.noise < 0.5, "{near:?} {}", smooth.noise);
    }
}
