//! Joins edge crossings to the lattice of a chessboard, from corner to corner along its edges.
//!
//! One edge runs between two neighbouring corners, with one colour to its left and the other to its right over its
//! whole length. The lattice grows from a first corner along its edges. Each step is predicted from the previous
//! one, and a corner joins if edges lead to all of its neighbours that are already part of the lattice. The lattice
//! therefore stays correct if corners are missing under a glare, and ends at the end of the board. The number of
//! edge evaluations is counted and limited.

use super::crossings::{Crossing, SmoothedPicture};
use nalgebra::Vector2;
use std::collections::{BTreeMap, VecDeque};

/// Corners by column and row, any of which may be negative.
pub(super) type Lattice = BTreeMap<(i32, i32), usize>;

/// Minimum distance of neighbours, px.
const MIN_PX: f64 = 6.0;
/// Maximum distance of neighbours, px: a larger board is found in a smaller picture.
const MAX_PX: f64 = 170.0;
/// If there are enough candidates within this distance, none is searched farther away, px.
const FIRST_SEARCH_RADIUS_PX: f64 = 60.0;
/// The largest angle between a first step and an edge's direction, as a cosine.
const MIN_STEP_COSINE: f64 = 0.966;
/// A neighbour must have an edge along the line from the corner: the largest angle, as a cosine.
const MIN_EDGE_COSINE: f64 = 0.90;
/// Maximum difference between a step and its prediction from the previous step, as a fraction of the step's length.
const PREDICTION_TOLERANCE: f64 = 0.28;
/// The number of crossings that are examined along a first edge.
const MAX_NEIGHBOURS: usize = 10;
/// Minimum ratio of the contrast across the edge to that of the corners.
const EDGE_SHARE: f64 = 0.3;
/// Contrasts of neighbours differ by at most this factor.
const CONTRASTS: f64 = 3.5;
/// Maximum number of edge checks in one picture.
const MAX_EDGE_CHECKS: usize = 250_000;
/// Minimum number of corners of a lattice.
const MIN_CORNERS: usize = 6;

/// Returns all lattices of a picture, the largest first.
pub(super) fn lattices(picture: &SmoothedPicture, crossings: &[Crossing]) -> Vec<Lattice> {
    let mut field = Field::new(picture, crossings);
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

/// Returns the lowest and the highest column and row.
pub(super) fn extent(lattice: &Lattice) -> [(i32, i32); 2] {
    let range = |of: fn(&(i32, i32)) -> i32| {
        let all = lattice.keys().map(of);
        (all.clone().min().unwrap_or(0), all.max().unwrap_or(-1))
    };
    [range(|at| at.0), range(|at| at.1)]
}

/// Returns the lattice without outer lines of which less than this share is present.
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

/// The crossings of a picture, sorted by their position.
struct Field<'a> {
    picture: &'a SmoothedPicture,
    crossings: &'a [Crossing],
    cells: Vec<Vec<usize>>,
    across: usize,
    looks: usize,
}

const CELL_PX: f64 = 24.0;

/// Unit vectors along the directions of columns and rows, at a corner of a growing lattice.
type Axes = [Vector2<f64>; 2];

impl<'a> Field<'a> {
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
        Field { picture, crossings, cells, across, looks: 0 }
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
                let found =
                    self.next(&lattice, &axes[&at], at, step, &|index| used[index] || taken.contains(&index));
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

    /// Returns the neighbour of a corner, with the neighbour's own axes.
    fn next(
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
                    away > MIN_PX && between.dot(&along) > MIN_STEP_COSINE * away
                };
                let mut all = self.crossings_within(here, FIRST_SEARCH_RADIUS_PX, &is_ahead);
                if all.len() < MAX_NEIGHBOURS {
                    all = self.crossings_within(here, MAX_PX, &is_ahead);
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
            // The neighbour's edge that leads to this corner is the same axis; its second edge is the other axis.
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

    /// Returns whether an edge runs from one crossing to the other.
    fn is_connected_by_edge(&mut self, one: usize, two: usize) -> bool {
        self.looks += 1;
        let (a, b) = (&self.crossings[one], &self.crossings[two]);
        let between = b.position - a.position;
        let length = between.norm();
        let factor = a.contrast / b.contrast;
        if length < MIN_PX || !(1.0 / CONTRASTS..=CONTRASTS).contains(&factor) {
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
        let min_contrast = EDGE_SHARE * a.contrast.min(b.contrast);
        let beyond = (2.5 / length).max(0.2);
        mean.abs() > min_contrast
            && steps.iter().all(|step| step * mean.signum() > 0.25 * mean.abs())
            && step(-beyond) * mean.signum() < 0.25 * mean.abs()
            && step(1.0 + beyond) * mean.signum() < 0.25 * mean.abs()
    }
}
