//! Converts a planned path to poses with their times, for [`simulate`], and calculates the feeds that make the dwell
//! time uniform.
//!
//! On a line with the feed f the disc dwells on a point for the time c w, with w = 1 / f and c the length of the line
//! within the disc's radius R of the point. For all points together: t = C w. Fewer lines pass near the border of the
//! treated area than in its middle, so the feed must be lower there. With a target time t₀ the iteration
//!     w ← w · Cᵀ(t₀ / C w) / Cᵀ1                                                  (Richardson and Lucy)
//! brings C w close to t₀ and keeps w positive. The lower limit of w follows from the recipe's feed, or from the feed
//! that the controller can plan. The upper limit is [`MAX_SLOWDOWN`] times the value at the recipe's feed. t₀ is a high
//! quantile of the dwell times at a uniform feed, and at least the dwell time between adjacent rows of infinite length.
//! All areas of a plan are calculated together, because adjacent areas influence each other.

use super::areas::Piece;
use super::planned::Plan;
pub use crate::surface::dwell::{Dwell, ExecutedPose, GridDwell, simulate, simulate_treated};
use crate::surface::{BSplineSurface, DwellSpread, Parameter, ParameterPatch, SampleGrid};
use panelprep_base::geometry::statistics::{QuantileRank, quantile};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Maximum ratio of the recipe's feed to the reduced feed.
const MAX_SLOWDOWN: f64 = 3.0;
/// Number of iterations; more iterations change only the third digit of the dwell times.
const ITERATIONS: usize = 15;
/// Quantile of the dwell times at a uniform feed that is used as the target time.
const TARGET_QUANTILE: f64 = 0.9;
/// Maximum ratio between the target time and the dwell time of a point, in either direction, so that a single point
/// does not determine the feed of a line.
const MAX_WEIGHT: f64 = 3.0;

/// Returns the plan as poses with their times.
pub fn timed_poses(plan: &Plan) -> Vec<ExecutedPose> {
    let all: Vec<_> = plan.paths.iter().flat_map(|path| &path.waypoints).collect();
    let mut executed: Vec<ExecutedPose> = Vec::with_capacity(all.len());
    for (index, waypoint) in all.iter().enumerate() {
        let panel_from_tool = waypoint.panel_from_tool;
        let before = executed.last().map_or(panel_from_tool, |last| last.panel_from_tool);
        let seconds = before.origin().distance_mm(panel_from_tool.origin()) / waypoint.feed_mm_s;
        // The descent to the first waypoint in contact is not in contact: the disc touches the panel only at its end.
        let contact = waypoint.contact && index > 0 && all[index - 1].contact;
        executed.push(ExecutedPose { panel_from_tool, seconds, contact, force_n: None });
    }
    executed
}

/// The feeds along the lines of each piece, and the resulting dwell times.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UniformFeeds {
    /// For each piece, the feed of the motion to each point of its track, mm/s.
    pub feeds_mm_s: Vec<Vec<f64>>,
    /// Spread of the dwell times over the whole treated area; `None` if no area is treated.
    pub all: Option<DwellSpread>,
    /// Spread of the dwell times in each grid.
    pub grids: Vec<(GridId, DwellSpread)>,
}

/// Reduces the feed of the lines for which this makes the dwell times more uniform.
pub(super) fn compute_uniform_feeds(
    surface: &BSplineSurface,
    region: &Region,
    pieces: &[Piece],
    settings: &recipe::Path,
) -> UniformFeeds {
    let radius_mm = settings.disc_diameter_mm() / 2.0;
    let parts: Vec<(GridId, ParameterPatch)> = pieces.iter().flat_map(|piece| piece.area.parts(region)).collect();
    let lines: Vec<Vec<Option<Line>>> = pieces.iter().map(|piece| lines(surface, piece, radius_mm)).collect();
    let treating: Vec<&Line> = lines.iter().flatten().flatten().collect();
    let coarse: Vec<UniformSamples> = {
        let spacing_mm = (radius_mm / 5.0).clamp(1.0, 3.0);
        parts.par_iter().map(|(_, part)| UniformSamples::new(surface, *part, spacing_mm)).collect()
    };
    let slowness = inverse_feeds(&treating, &coarse, radius_mm, settings);
    let mut next = slowness.iter();
    let mut feed = |line: &Option<Line>| match line {
        Some(_) => next.next().map_or(settings.feed_mm_s(), |slowness| 1.0 / slowness),
        None => settings.feed_mm_s(),
    };
    // The motion to the first point of a track is through the air, at the recipe's feed.
    let feeds_mm_s = lines
        .iter()
        .map(|lines| std::iter::once(settings.feed_mm_s()).chain(lines.iter().map(&mut feed)).collect())
        .collect();
    // The result is evaluated on a finer grid of sample points than the calculation of the feeds, to show that the
    // dwell time is uniform also between the coarse sample points.
    let spacing_mm = (radius_mm / 10.0).clamp(0.5, 1.5);
    let of_part = |(id, part): &(GridId, ParameterPatch)| {
        let places = UniformSamples::new(surface, *part, spacing_mm);
        let mut times_s = vec![0.0; places.points.len()];
        for (line, slowness) in treating.iter().zip(&slowness) {
            places.for_each_point_under(line, radius_mm, |place, chord_mm| times_s[place] += chord_mm * slowness);
        }
        (*id, times_s.into_iter().zip(places.area_mm2).collect::<Vec<_>>())
    };
    let times: Vec<(GridId, Vec<(f64, f64)>)> = parts.par_iter().map(of_part).collect();
    let all = DwellSpread::from_times(times.iter().flat_map(|(_, times)| times.iter().copied()));
    // One grid may contain parts of two areas.
    let mut by_grid: BTreeMap<GridId, Vec<(f64, f64)>> = BTreeMap::new();
    times.into_iter().for_each(|(id, times)| by_grid.entry(id).or_default().extend(times));
    let spread = |(id, times): (GridId, Vec<(f64, f64)>)| Some((id, DwellSpread::from_times(times.into_iter())?));
    UniformFeeds { feeds_mm_s, all, grids: by_grid.into_iter().filter_map(spread).collect() }
}

/// A straight segment of a track in contact.
struct Line {
    ends: [Parameter; 2],
    points: [Point<Panel>; 2],
    length_mm: f64,
    /// Reach of the disc along u and v, in units of the parameters.
    reach: [f64; 2],
}

/// Returns the lines between successive points of a track; `None` for a line with the tool lifted.
fn lines(surface: &BSplineSurface, piece: &Piece, radius_mm: f64) -> Vec<Option<Line>> {
    let line = |(ends, contact): (&[Parameter], &[bool])| {
        let [from, to] = [ends[0], ends[1]];
        let tangents = surface.tangents(from);
        // With slanted parameter lines the reach is larger than the radius: the height of a rhombus is its side times
        // the sine of its angle.
        let [lu, lv] = [tangents.s_u.mm.norm(), tangents.s_v.mm.norm()];
        let sine = tangents.area_mm2() / (lu * lv);
        let points = [tangents.point, surface.point(to)];
        (contact[0] && contact[1]).then(|| Line {
            ends: [from, to],
            points,
            length_mm: points[0].distance_mm(points[1]),
            reach: [1.1 * radius_mm / (lu * sine), 1.1 * radius_mm / (lv * sine)],
        })
    };
    piece.track.windows(2).zip(piece.contact.windows(2)).map(line).collect()
}

/// Sample points that are uniformly distributed over a grid.
struct UniformSamples {
    net: SampleGrid,
    points: Vec<Point<Panel>>,
    /// Area of the surface that each point represents, mm².
    area_mm2: Vec<f64>,
}

impl UniformSamples {
    fn new(surface: &BSplineSurface, patch: ParameterPatch, spacing_mm: f64) -> Self {
        let net = SampleGrid::from_patch(surface, patch, spacing_mm);
        let place = |index: usize| {
            let tangents = surface.tangents(net.parameter_at(index));
            (tangents.point, tangents.area_mm2() * net.cell())
        };
        let (points, area_mm2) = (0..net.count()).map(place).unzip();
        UniformSamples { net, points, area_mm2 }
    }

    /// Calls `add` for each point that the disc passes on a line, with the length of the line within the radius of the
    /// point, mm.
    fn for_each_point_under(&self, line: &Line, radius_mm: f64, mut add: impl FnMut(usize, f64)) {
        let ([from, to], [reach_u, reach_v]) = (line.ends, line.reach);
        let least = Parameter { u: from.u.min(to.u) - reach_u, v: from.v.min(to.v) - reach_v };
        let most = Parameter { u: from.u.max(to.u) + reach_u, v: from.v.max(to.v) + reach_v };
        for place in self.net.points_around(least, most) {
            let chord_mm = chord_mm(line, self.points[place], radius_mm);
            if chord_mm > 0.0 {
                add(place, chord_mm);
            }
        }
    }
}

/// Returns the length of the part of a line that lies within the radius of a point, mm.
fn chord_mm(line: &Line, point: Point<Panel>, radius_mm: f64) -> f64 {
    let [from, to] = line.points;
    let (way, offset) = ((to - from).mm, (point - from).mm);
    let along_mm = offset.dot(&way) / line.length_mm;
    let half2 = radius_mm * radius_mm - (offset.norm_squared() - along_mm * along_mm);
    if half2 <= 0.0 {
        return 0.0;
    }
    let half_mm = half2.sqrt();
    ((along_mm + half_mm).min(line.length_mm) - (along_mm - half_mm).max(0.0)).max(0.0)
}

/// Calculates 1 / feed of each line, s/mm.
fn inverse_feeds(lines: &[&Line], places: &[UniformSamples], radius_mm: f64, settings: &recipe::Path) -> Vec<f64> {
    let (fastest, planning_s) = (1.0 / settings.feed_mm_s(), settings.planning_time_ms() / 1_000.0);
    let shortest: Vec<f64> = lines.iter().map(|line| fastest.max(planning_s / line.length_mm)).collect();
    let starts: Vec<usize> = places
        .iter()
        .scan(0, |next, places| {
            let start = *next;
            *next += places.points.len();
            Some(start)
        })
        .collect();
    let column = |line: &&Line| {
        let mut column: Vec<(usize, f64)> = Vec::new();
        for (places, start) in places.iter().zip(&starts) {
            places.for_each_point_under(line, radius_mm, |place, chord_mm| column.push((start + place, chord_mm)));
        }
        column
    };
    let columns: Vec<Vec<(usize, f64)>> = lines.par_iter().map(column).collect();
    let count: usize = places.iter().map(|places| places.points.len()).sum();
    let times_s = |slowness: &[f64]| {
        let mut times_s = vec![0.0; count];
        for (column, slowness) in columns.iter().zip(slowness) {
            column.iter().for_each(|(place, chord_mm)| times_s[*place] += chord_mm * slowness);
        }
        times_s
    };
    // The target time is at least the dwell time between rows of infinite length, because points near a border have
    // shorter dwell times, which must not reduce the target.
    let wanted_s =
        target_time_s(times_s(&shortest), PI * radius_mm * radius_mm / settings.step_over_mm() * fastest);
    let mut slowness = shortest.clone();
    for _ in 0..ITERATIONS {
        let weights: Vec<f64> = times_s(&slowness)
            .into_iter()
            .map(|time_s| (wanted_s / time_s.max(f64::MIN_POSITIVE)).clamp(1.0 / MAX_WEIGHT, MAX_WEIGHT))
            .collect();
        for ((column, shortest), slowness) in columns.iter().zip(&shortest).zip(&mut slowness) {
            let sums = column.iter().fold((0.0, 0.0), |(weighted, all), (place, chord_mm)| {
                (weighted + chord_mm * weights[*place], all + chord_mm)
            });
            if sums.1 > 0.0 {
                // The feed is never higher than the recipe's feed, which a person selected for the disc.
                *slowness = (*slowness * sums.0 / sums.1).clamp(*shortest, shortest.max(MAX_SLOWDOWN * fastest));
            }
        }
    }
    slowness
}

fn target_time_s(mut times_s: Vec<f64>, of_endless_rows_s: f64) -> f64 {
    let long_s = quantile(&mut times_s, TARGET_QUANTILE, QuantileRank::Floor).unwrap_or_default();
    long_s.max(of_endless_rows_s)
}
