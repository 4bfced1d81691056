//! Calculates the feed of each move of a path, so that the removal is uniform over the treated area.
//!
//! Let x be the length over which a grain rubs per millimetre of a move. The move removes k p x from a point per
//! millimetre, so the depths of all points are h = A x: they are linear in x for any orbit. x decreases with the feed
//! (`speed`), and the limits of the feeds give limits of x. Bounded least squares find the x that is nearest to the
//! target everywhere. Outside of the treated area there is no target; the removal decreases within the disc's radius
//! there. The wear of the disc depends only on the length of its path, so it is known in advance.
//!
//! The speed of the tool centre point cannot change suddenly. From one move to the next the square of the feed changes
//! by at most the acceleration times the length of the faster move, so that the change takes at most half of this move.
//! If this requires a lower feed, the feed is reduced, and the other feeds are calculated again.
//!
//! The result is not adapted to the recipe's limits; its map shows whether they are met.
//!
//! The least squares have a sparse matrix and are solved by coordinate descent. They minimise
//!     Σᵢ (Σⱼ aᵢⱼ xⱼ − yᵢ)² + μ Σⱼ hⱼ (xⱼ − ½ (xⱼ₋₁ + xⱼ₊₁))²,   low ≤ x ≤ high, with hⱼ = Σᵢ aᵢⱼ².
//! Each step sets one x to the minimum along its axis, clamped to its limits: the sum never increases, and it reaches
//! its minimum because it is convex. The second term keeps successive values similar where the first term does not
//! determine them. Source: Tseng, J. Optim. Theory Appl. 109, 2001.

use super::map::Samples;
use super::model::{Model, UM_PER_MM};
use super::speed::Orbit;
use super::track::{DiscStretch, IsPanelAt};
use crate::surface::{BSplineSurface, Parameter, Treated};
use panelprep_cell::panel::Region;
use rayon::prelude::*;

/// Distance between sample points, in disc radii; `SPACING_MM` contains the limits of this distance.
const SPACING_RADII: f64 = 0.2;
/// Minimum and maximum distance between sample points, mm.
const SPACING_MM: [f64; 2] = [1.0, 3.0];
/// Weight of the term that keeps successive feeds similar.
const SMOOTHING_WEIGHT: f64 = 0.02;
/// Number of iterations over all moves: at the start, and after feeds were reduced for the acceleration.
const ITERATIONS: [usize; 2] = [40, 12];

/// A move of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// Index of the pose at the end of the move, with the numbering of `DiscStretch::pose`.
    pub pose: usize,
    /// Length of the move, mm.
    pub length_mm: f64,
    /// Minimum and maximum feed, mm/s.
    pub feeds_mm_s: [f64; 2],
}

/// The required depth, and the acceleration for the schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemovalTarget {
    /// Required depth, µm.
    pub target_um: f64,
    /// Acceleration of the tool centre point, mm/s².
    pub acceleration_mm_s2: f64,
}

/// Calculates the feed of each move, mm/s, for which the removal is nearest to the target. `stretches` are the segments
/// of the path; their feeds have no influence.
pub fn schedule(
    (surface, region, ground): (&BSplineSurface, &Region, IsPanelAt<'_>),
    treated: &Treated,
    (stretches, moves): (&[DiscStretch], &[Move]),
    model: &Model,
    target: &RemovalTarget,
) -> Vec<f64> {
    let radius_mm = stretches.first().map_or(1.0, |stretch| stretch.stroke.contact.pad.radius_mm);
    let spacing_mm = (SPACING_RADII * radius_mm).clamp(SPACING_MM[0], SPACING_MM[1]);
    let asked: IsPanelAt<'_> = &|at: Parameter| ground(at) && treated.holds(at);
    let of_grid = |id| Samples::for_grid(surface, region, (id, spacing_mm), asked);
    let samples: Vec<Samples> = treated.grids().par_iter().filter_map(|id| of_grid(*id)).collect();
    let (columns, places) = columns(&samples, (stretches, moves), model, target.target_um);
    let rubbed = |feed_mm_s: f64| model.orbit.rubbed_per_mm(feed_mm_s);
    let bounds: Vec<[f64; 2]> = moves.iter().map(|own| [1, 0].map(|end| rubbed(own.feeds_mm_s[end]))).collect();
    let wanted: Vec<f64> = places.iter().map(|area| if *area > 0.0 { 1.0 } else { 0.0 }).collect();
    let mut sought = DescentTarget {
        target: &wanted,
        bounds: &bounds,
        smoothing_weight: SMOOTHING_WEIGHT,
        rounds: ITERATIONS[0],
    };
    let lowest: Vec<f64> = bounds.iter().map(|[low, _]| *low).collect();
    // The iteration begins with the highest feeds, so that the first iterations add removal at the points that need it.
    let free = minimise_bounded(&columns, lowest.clone(), &sought);
    let slowed = limit_feed_steps(&feeds(&model.orbit, moves, &free), moves, target.acceleration_mm_s2);
    // Feeds that were reduced for the acceleration are not increased again; the other feeds compensate.
    let held: Vec<[f64; 2]> = slowed
        .iter()
        .zip(&free)
        .zip(&bounds)
        .map(|((feed_mm_s, free), [low, high])| {
            let x = rubbed(*feed_mm_s);
            if x > free * (1.0 + 1e-6) { [x.min(*high), *high] } else { [*low, *high] }
        })
        .collect();
    sought = DescentTarget { bounds: &held, rounds: ITERATIONS[1], ..sought };
    let start = free.iter().zip(&held).map(|(x, [low, high])| x.clamp(*low, *high)).collect();
    let settled = minimise_bounded(&columns, start, &sought);
    self::limit_feed_steps(&feeds(&model.orbit, moves, &settled), moves, target.acceleration_mm_s2)
}

fn feeds(orbit: &Orbit, moves: &[Move], x: &[f64]) -> Vec<f64> {
    moves.iter().zip(x).map(|(own, x)| orbit.feed_mm_s(*x, own.feeds_mm_s)).collect()
}

/// Calculates the removal by each move at each point, relative to the target, for one mm of rubbing per mm of the move;
/// also returns the areas of the points.
fn columns(
    samples: &[Samples],
    (stretches, moves): (&[DiscStretch], &[Move]),
    model: &Model,
    target_um: f64,
) -> (Columns, Vec<f64>) {
    let starts: Vec<usize> = samples
        .iter()
        .scan(0, |next, own| {
            let start = *next;
            *next += own.count();
            Some(start)
        })
        .collect();
    let column = |own: &Move| {
        let first = stretches.partition_point(|stretch| stretch.pose < own.pose);
        let own = stretches[first..].iter().take_while(|stretch| stretch.pose == own.pose);
        let mut column: Vec<(u32, f32)> = Vec::new();
        for stretch in own {
            let share = model.preston_at_wear(stretch.swept_mm2) * stretch.length_mm * UM_PER_MM / target_um;
            for (samples, start) in samples.iter().zip(&starts) {
                samples.for_each_point_under(stretch, |place, pressure| {
                    column.push(((start + place) as u32, (share * pressure) as f32));
                });
            }
        }
        merge_rows(column)
    };
    let mut columns = Columns::default();
    let each: Vec<Vec<(u32, f32)>> = moves.par_iter().map(column).collect();
    each.into_iter().for_each(|column| columns.push(column));
    (columns, samples.iter().flat_map(|own| own.area_mm2.iter().copied()).collect())
}

/// Adds the entries of a column that have the same row.
fn merge_rows(mut column: Vec<(u32, f32)>) -> Vec<(u32, f32)> {
    column.sort_unstable_by_key(|(row, _)| *row);
    let mut merged: Vec<(u32, f32)> = Vec::with_capacity(column.len());
    for (row, value) in column {
        match merged.last_mut() {
            Some((last, sum)) if *last == row => *sum += value,
            _ => merged.push((row, value)),
        }
    }
    merged
}

/// Returns these feeds, reduced where the acceleration does not permit the change from or to an adjacent move.
fn limit_feed_steps(feeds_mm_s: &[f64], moves: &[Move], acceleration_mm_s2: f64) -> Vec<f64> {
    let mut slowed = feeds_mm_s.to_vec();
    let follows = |index: usize| moves[index].pose == moves[index - 1].pose + 1;
    let most = |other: f64, length_mm: f64| (other * other + acceleration_mm_s2 * length_mm).sqrt();
    for index in (1..slowed.len()).filter(|index| follows(*index)) {
        slowed[index] = slowed[index].min(most(slowed[index - 1], moves[index].length_mm));
    }
    for index in (1..slowed.len()).rev().filter(|index| follows(*index)) {
        slowed[index - 1] = slowed[index - 1].min(most(slowed[index], moves[index - 1].length_mm));
    }
    slowed
}

/// A sparse matrix, stored by columns.
#[derive(Debug, Clone, Default, PartialEq)]
struct Columns {
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<f32>,
}

impl Columns {
    /// Appends a column, given by its non-zero entries: row and value.
    pub fn push(&mut self, column: impl IntoIterator<Item = (u32, f32)>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        for (row, value) in column {
            self.rows.push(row);
            self.values.push(value);
        }
        self.starts.push(self.rows.len());
    }

    /// Returns the number of columns.
    pub fn count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    fn column(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[index]..self.starts[index + 1];
        let rows = self.rows[range.clone()].iter().map(|row| *row as usize);
        rows.zip(self.values[range].iter().map(|value| f64::from(*value)))
    }

    /// Returns the product A x, with this number of rows.
    pub fn times(&self, x: &[f64], rows: usize) -> Vec<f64> {
        let mut sums = vec![0.0; rows];
        for (index, x) in x.iter().enumerate().take(self.count()) {
            self.column(index).for_each(|(row, value)| sums[row] += value * x);
        }
        sums
    }
}

/// The minimisation problem of the coordinate descent.
#[derive(Debug, Clone, Copy)]
struct DescentTarget<'a> {
    /// The target vector y.
    pub target: &'a [f64],
    /// Lower and upper limit of each x.
    pub bounds: &'a [[f64; 2]],
    /// Weight μ of the smoothing term.
    pub smoothing_weight: f64,
    /// Number of iterations over all unknowns.
    pub rounds: usize,
}

/// Returns the x that minimises the sum; the start `x` must be within the limits.
fn minimise_bounded(columns: &Columns, mut x: Vec<f64>, sought: &DescentTarget<'_>) -> Vec<f64> {
    let count = columns.count().min(x.len()).min(sought.bounds.len());
    let mut over = columns.times(&x, sought.target.len());
    over.iter_mut().zip(sought.target).for_each(|(sum, wanted)| *sum -= wanted);
    let squares: Vec<f64> =
        (0..count).map(|index| columns.column(index).map(|(_, value)| value * value).sum()).collect();
    for _ in 0..sought.rounds {
        for index in 0..count {
            let square = squares[index];
            // A move that removes no material of the treated area has no best feed and keeps its start value.
            if square <= 0.0 {
                continue;
            }
            let slope: f64 = columns.column(index).map(|(row, value)| value * over[row]).sum();
            let beside = [index.checked_sub(1), Some(index + 1).filter(|next| *next < count)];
            let beside: Vec<f64> = beside.into_iter().flatten().map(|other| x[other]).collect();
            let mean = beside.iter().sum::<f64>() / beside.len().max(1) as f64;
            let pull = if beside.is_empty() { 0.0 } else { sought.smoothing_weight };
            let [low, high] = sought.bounds[index];
            // The smoothing term is scaled with the column's sum of squares, so that μ has the same effect for moves
            // with a large and a small removal.
            let best = x[index] - (slope + pull * square * (x[index] - mean)) / (square * (1.0 + pull));
            // The value is clamped in each step: for a convex problem the descent then ends at the optimum within the
            // limits, which differs from the clamped optimum without limits.
            let step = best.clamp(low, high) - x[index];
            if step != 0.0 {
                x[index] += step;
                columns.column(index).for_each(|(row, value)| over[row] += value * step);
            }
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::super::examples::MODEL;
    use super::super::figures::MapFigures;
    use super::super::map::tests::region;
    use super::super::map::{RemovalMap, removed};
    use super::super::track::tests::{DISC, level, pose};
    use super::super::track::{Disc, path_stretches};
    use super::*;
    use crate::surface::dwell::ExecutedPose;
    use panelprep_cell::panel::GridId;
    use proptest::prelude::*;

    /// Returns rows 12 mm apart over a square of 60 mm in the middle of 100 mm, beginning 6 mm outside of the square,
    /// with moves of 6 mm.
    fn rows() -> Vec<ExecutedPose> {
        let mut path = Vec::new();
        for row in 0..7 {
            let y = 14.0 + 12.0 * f64::from(row);
            for step in 0..=12 {
                let along = 14.0 + 6.0 * f64::from(step);
                let x = if row % 2 == 0 { along } else { 100.0 - along };
                path.push(pose([x, y, 0.0], 0.1));
            }
        }
        path
    }

    fn timed(path: &[ExecutedPose], feeds_mm_s: &[f64]) -> Vec<ExecutedPose> {
        let mut timed = path.to_vec();
        for (index, feed) in feeds_mm_s.iter().enumerate() {
            let way = timed[index].panel_from_tool.origin().distance_mm(timed[index + 1].panel_from_tool.origin());
            timed[index + 1].seconds = way / feed;
        }
        timed
    }

    /// Plans the treatment of the middle grid of 5 × 5 grids of 20 mm and its neighbours: 60 × 60 mm.
    fn planned(target_um: f64, feeds: [f64; 2], swept_mm2: f64) -> (Vec<f64>, RemovalMap, RemovalMap, Vec<Move>) {
        let (surface, region) = (level(100.0), region(5, 5));
        let inner = |id: &GridId| (2..=4).contains(&id.row) && (2..=4).contains(&id.column);
        let treated = Treated::from_grids(&region.ids().filter(inner).collect::<Vec<_>>());
        let disc = Disc { rim_orbits: true, swept_mm2, ..DISC };
        let path = rows();
        let all = path_stretches(&surface, &path, (&disc, 20.0), &|_| true);
        let own = |index: usize| Move {
            pose: index + 1,
            length_mm: path[index].panel_from_tool.origin().distance_mm(path[index + 1].panel_from_tool.origin()),
            feeds_mm_s: feeds,
        };
        let moves: Vec<Move> = (0..path.len() - 1).map(own).collect();
        let on = (&surface, &region, &(|_| true) as IsPanelAt<'_>);
        let target = RemovalTarget { target_um, acceleration_mm_s2: 1_000.0 };
        let found = schedule(on, &treated, (&all, &moves), &MODEL, &target);
        let map = |feeds_mm_s: &[f64]| {
            let all = path_stretches(&surface, &timed(&path, feeds_mm_s), (&disc, 20.0), &|_| true);
            removed(on, &treated, &all, (&MODEL, 0.1), 1.0)
        };
        let constant = vec![feeds[1]; moves.len()];
        (found.clone(), map(&found), map(&constant), moves)
    }

    #[test]
    fn scheduled_feeds_remove_the_target_evenly() {
        let (_, scheduled, constant, _) = planned(40.0, [5.0, 120.0], 0.0);
        let [even, plain] = [&scheduled, &constant].map(|map| MapFigures::compute(map, 40.0).expect("treated"));
        assert!(even.within_percent < 10.0 && (even.mean_um / 40.0 - 1.0).abs() < 0.03, "{even:?}");
        assert!(even.within_percent < 0.2 * plain.within_percent, "{even:?} {plain:?}");
        // Outside of the treated grids the depth decreases: it is nowhere larger than inside.
        assert!(even.largest_um < 1.3 * 40.0, "{even:?}");
    }

    #[test]
    fn a_worn_disc_moves_at_a_lower_feed() {
        let seconds = |swept_mm2: f64| {
            let (found, _, _, moves) = planned(40.0, [5.0, 120.0], swept_mm2);
            moves.iter().zip(&found).map(|(own, feed)| own.length_mm / feed).sum::<f64>()
        };
        // Expected value, calculated by hand: the duration increases by e^0.4 = 1.49.
        let ratio = seconds(500_000.0) / seconds(0.0);
        assert!((ratio - 1.49).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn feeds_keep_their_bounds_and_the_acceleration() {
        for target_um in [10.0, 40.0, 400.0] {
            let (found, _, _, moves) = planned(target_um, [20.0, 60.0], 0.0);
            for (index, feed) in found.iter().enumerate() {
                assert!((20.0 - 1e-6..=60.0 + 1e-6).contains(feed), "{feed}");
                if index > 0 {
                    let change = (feed * feed - found[index - 1].powi(2)).abs();
                    assert!(change <= 1_000.0 * moves[index].length_mm.max(moves[index - 1].length_mm) + 1e-6);
                }
            }
        }
        let (found, ..) = planned(400.0, [20.0, 60.0], 0.0);
        assert!(found.iter().all(|feed_mm_s| *feed_mm_s < 20.0 + 1e-6), "all that one pass can: {found:?}");
    }

    /// Expected values, calculated by hand: from 10 mm/s over 6 mm at 100 mm/s², the feed can reach (10² + 600)^½ =
    /// 26.46 mm/s, then 36.06 mm/s.
    #[test]
    fn feeds_rise_as_the_acceleration_permits() {
        let own = |pose| Move { pose, length_mm: 6.0, feeds_mm_s: [1.0, 60.0] };
        let moves: Vec<Move> = (1..=4).map(own).collect();
        let found = limit_feed_steps(&[10.0, 60.0, 60.0, 20.0], &moves, 100.0);
        let expected = [10.0, 26.457_5, 31.622_8, 20.0];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-3), "{found:?}");
        // After a motion through the air, the previous feed does not limit the next feed.
        let apart = [own(1), own(5)];
        assert_eq!(limit_feed_steps(&[10.0, 60.0], &apart, 100.0), [10.0, 60.0]);
    }

    #[test]
    fn nothing_in_contact_has_no_feed() {
        let (surface, region) = (level(100.0), region(1, 1));
        let target = RemovalTarget { target_um: 40.0, acceleration_mm_s2: 1_000.0 };
        assert!(
            schedule((&surface, &region, &|_| true), &Treated::default(), (&[], &[]), &MODEL, &target).is_empty()
        );
    }

    fn sought<'a>(wanted: &'a [f64], bounds: &'a [[f64; 2]]) -> DescentTarget<'a> {
        DescentTarget { target: wanted, bounds, smoothing_weight: 0.0, rounds: 200 }
    }

    /// Expected values, calculated by hand: (1, 2) satisfies x₀ + x₁ = 3 and x₁ = 2; with x₁ ≤ 1 the best x₀ is 2.
    #[test]
    fn a_bounded_minimum_with_two_unknowns_is_found() {
        let mut columns = Columns::default();
        columns.push([(0, 1.0)]);
        columns.push([(0, 1.0), (1, 1.0)]);
        let x = minimise_bounded(&columns, vec![0.0, 0.0], &sought(&[3.0, 2.0], &[[0.0, 9.0]; 2]));
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 2.0).abs() < 1e-6, "{x:?}");
        let x = minimise_bounded(&columns, vec![0.0, 0.0], &sought(&[3.0, 2.0], &[[0.0, 9.0], [0.0, 1.0]]));
        assert!((x[0] - 2.0).abs() < 1e-6 && x[1] == 1.0, "{x:?}");
        assert_eq!(columns.times(&[1.0, 2.0], 2), [3.0, 2.0]);
    }

    proptest! {
        /// At the end, no change of a single unknown gives a smaller sum, and all unknowns are within their limits.
        #[test]
        fn no_step_lowers_the_minimum(
            values in prop::collection::vec(0.0..1.0f32, 24), wanted in prop::collection::vec(0.0..3.0f64, 6),
        ) {
            let mut columns = Columns::default();
            for column in values.chunks(6) {
                columns.push(column.iter().enumerate().map(|(row, value)| (row as u32, *value)));
            }
            let bounds = [[0.2, 1.0]; 4];
            let x = minimise_bounded(&columns, vec![0.5; 4], &DescentTarget { rounds: 2_000, ..sought(&wanted, &bounds) });
            let sum = |x: &[f64]| {
                let found = columns.times(x, 6);
                found.iter().zip(&wanted).map(|(found, wanted)| (found - wanted).powi(2)).sum::<f64>()
            };
            for index in 0..4 {
                prop_assert!((0.2..=1.0).contains(&x[index]));
                for step in [-1e-3, 1e-3] {
                    let mut other = x.clone();
                    other[index] = (other[index] + step).clamp(0.2, 1.0);
                    prop_assert!(sum(&other) > sum(&x) - 1e-9);
                }
            }
        }
    }
}
