//! Lays the lines of the recipe's pattern over one patch, as one continuous track from the first to the last point in
//! contact: rows in any direction, offset contours and spirals (thesis Fig. 4.26 b–d).
//!
//! Rows at an angle: in the patch's middle u and v are scaled to mm and rotated by the feed angle, to (a, b) along and
//! across the rows. Rows begin at the inset corner of the patch that is lowest in b. The distance from each row to the
//! next is r' along b, measured on the surface as ∫ |F × D| / |F| db with F = S_a and D = S_b. Outside of the inset
//! patch, rows use the measure at the nearest point of the patch; these parts are then cut off.
//!
//! Rings: a ring at depth d has the distance d from each of the patch's four borders, after the border's inset,
//! measured on the surface as for rows. Let h be half of the patch's shorter side without the insets. The depth
//! increases by equal steps r' = h / (n + ½) ≤ r − e, so that the sides of the innermost ring are also r' apart in the
//! middle. Where the patch is wider by e, these sides are at most r apart; no line is sanded twice. If h is zero, there
//! is one line, or one point, in the middle.

use super::raster::{
    Insets, RasterError, RasterSettings, RowDirection, interpolate, join_lines, point_across, resampled, rows,
    squeezed_position_mm,
};
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use panelprep_base::geometry::{Degrees, Panel, Point};
use panelprep_cell::recipe::{self, Pattern};

/// Maximum difference from 0° or 90° at which a feed angle is treated as along u or v, degrees.
const AXIS_ANGLE_TOLERANCE_DEG: f64 = 0.01;

/// Factor on the step between the windings of a spiral: adjacent windings are not parallel, and near the middle their
/// distance exceeds the difference of their depths by up to 15 %.
const SPIRAL_STEP_FACTOR: f64 = 0.85;

/// Minimum length of a line, mm. A line that is shorter, and also shorter than [`MIN_SPACING_FRACTION`] of the distance
/// between waypoints, is merged with the next line. The feed on such a short line would be low, because the controller
/// needs time to plan each line.
const MIN_LINE_MM: f64 = 1.0;
/// Minimum length of a line as a fraction of the distance between waypoints: see [`MIN_LINE_MM`].
const MIN_SPACING_FRACTION: f64 = 0.25;

/// Distance between the points of a row before resampling, mm.
const COLUMN_MM: f64 = 4.0;
/// Number of integration steps for the distance from one row to the next; the integrand hardly changes over this
/// distance.
const ACROSS_STEPS: usize = 2;

/// Number of iterations for a ring's corner, the intersection of two borders; each iteration adds about three correct
/// digits.
const CORNER_STEPS: usize = 4;
/// Number of points along one side of a ring before resampling.
const SIDE_STEPS: usize = 24;
/// Minimum half of a ring's shorter side, mm; a smaller ring becomes a line.
const MIN_HALF_MM: f64 = 0.5;

/// Number of sides of a ring. Their order: from the corner at lowest u and v along u, along v, back along u, back along
/// v.
const SIDES: usize = 4;

/// The lines over a patch.
#[derive(Debug, Clone)]
pub(super) struct Lines {
    /// All points in contact, in order.
    pub track: Vec<Parameter>,
    /// Pairs of adjacent lines, for measuring the distance between them.
    pub neighbours: Vec<[Vec<Parameter>; 2]>,
}

/// Lays the lines over a patch: adjacent lines are at most `step_over_mm` apart, successive waypoints at most
/// `spacing_mm`.
pub(super) fn lines(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    insets: Insets,
    settings: &recipe::Path,
    [step_over_mm, spacing_mm]: [f64; 2],
) -> Result<Lines, RasterError> {
    let laid = lay_lines(surface, patch, insets, settings, [step_over_mm, spacing_mm])?;
    Ok(Lines {
        track: drop_short_steps(surface, &laid.track, MIN_LINE_MM.min(MIN_SPACING_FRACTION * spacing_mm)),
        ..laid
    })
}

/// Removes the points of a track that are nearer to the previous point than this distance, mm, except for the ends of
/// the track.
fn drop_short_steps(surface: &BSplineSurface, track: &[Parameter], least_mm: f64) -> Vec<Parameter> {
    let mut kept: Vec<(Parameter, Point<Panel>)> = Vec::with_capacity(track.len());
    for (index, at) in track.iter().enumerate() {
        let point = surface.point(*at);
        let is_near = |kept: &[(Parameter, Point<Panel>)]| {
            kept.last().is_some_and(|(_, last)| last.distance_mm(point) < least_mm)
        };
        if index + 1 == track.len() {
            // The end of the track is kept and points before it are removed instead, because the last line must reach
            // the border.
            while kept.len() > 1 && is_near(&kept) {
                kept.pop();
            }
        }
        if !is_near(&kept) {
            kept.push((*at, point));
        }
    }
    kept.into_iter().map(|(at, _)| at).collect()
}

fn lay_lines(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    insets: Insets,
    settings: &recipe::Path,
    [step_over_mm, spacing_mm]: [f64; 2],
) -> Result<Lines, RasterError> {
    let laying = RasterSettings { along: RowDirection::U, insets, step_over_mm, spacing_mm };
    let rings = |share: f64| PatchRings::new(surface, patch, insets, share * step_over_mm);
    let around = |[low, high]: [usize; 2], rings: Vec<[Vec<Parameter>; 4]>| -> Lines {
        let resample = |side: &Vec<Parameter>| resampled(surface, side, [0.0; 2], spacing_mm);
        let rings: Vec<[Vec<Parameter>; 4]> = rings.iter().map(|ring| ring.each_ref().map(resample)).collect();
        let beside = |pair: &[[Vec<Parameter>; 4]]| -> Vec<[Vec<Parameter>; 2]> {
            pair[0].iter().zip(&pair[1]).map(|(outer, inner)| [inner.clone(), outer.clone()]).collect()
        };
        let within = rings.last().map(|innermost| [innermost[low].clone(), innermost[high].clone()]);
        let neighbours = rings.windows(2).flat_map(beside).chain(within).collect();
        Lines { track: join_lines(surface, &rings.concat(), spacing_mm), neighbours }
    };
    let laid = match settings.pattern() {
        Pattern::Raster => {
            alternate_rows(surface, lay_rows(surface, patch, &laying, settings.feed_angle_deg())?, spacing_mm)
        }
        Pattern::CrossHatch => {
            let angle_deg = settings.feed_angle_deg();
            // The angle stays within ±90°, the range of the recipe's key.
            let other_deg = if angle_deg > 0.0 { angle_deg - 90.0 } else { angle_deg + 90.0 };
            let first = alternate_rows(surface, lay_rows(surface, patch, &laying, angle_deg)?, spacing_mm);
            let second = alternate_rows(surface, lay_rows(surface, patch, &laying, other_deg)?, spacing_mm);
            join_row_sets(surface, first, second, spacing_mm)
        }
        Pattern::Offset => around(rings(1.0).innermost_sides(), rings(1.0).closed()?),
        Pattern::OffsetSpiral => around(rings(1.0).innermost_sides(), rings(1.0).stepped_rings()?),
        Pattern::Spiral => {
            around(rings(SPIRAL_STEP_FACTOR).innermost_sides(), rings(SPIRAL_STEP_FACTOR).winding_rings()?)
        }
    };
    let in_rows = matches!(settings.pattern(), Pattern::Raster | Pattern::CrossHatch);
    if !(in_rows && is_slanted_angle(settings.feed_angle_deg())) {
        return Ok(laid);
    }
    // Rows that meet the border at an angle leave a jagged edge, so a contour along the border is sanded first.
    let contour = around([0, 0], rings(1.0).closed()?.into_iter().take(1).collect());
    Ok(Lines { track: join_lines(surface, &[contour.track, laid.track], spacing_mm), ..laid })
}

fn is_slanted_angle(angle_deg: f64) -> bool {
    angle_deg.abs() >= AXIS_ANGLE_TOLERANCE_DEG && (angle_deg.abs() - 90.0).abs() >= AXIS_ANGLE_TOLERANCE_DEG
}

fn lay_rows(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    laying: &RasterSettings,
    angle_deg: f64,
) -> Result<Vec<Vec<Parameter>>, RasterError> {
    if is_slanted_angle(angle_deg) {
        slanted_rows(surface, patch, (laying, Degrees(angle_deg)))
    } else if angle_deg.abs() < AXIS_ANGLE_TOLERANCE_DEG {
        rows(surface, patch, laying)
    } else {
        rows(surface, patch, &RasterSettings { along: RowDirection::V, ..*laying })
    }
}

fn alternate_rows(surface: &BSplineSurface, rows: Vec<Vec<Parameter>>, spacing_mm: f64) -> Lines {
    let track = join_lines(surface, &rows, spacing_mm);
    Lines { track, neighbours: rows.windows(2).map(|pair| [pair[0].clone(), pair[1].clone()]).collect() }
}

/// Joins two sets of rows; the second set begins at its end that is nearer to the end of the first.
fn join_row_sets(surface: &BSplineSurface, first: Lines, second: Lines, spacing_mm: f64) -> Lines {
    let (mut track, mut across) = (first.track, second.track);
    let from = track.last().map(|at| surface.point(*at));
    let away = |at: Option<&Parameter>| match (from, at) {
        (Some(from), Some(at)) => from.distance_mm(surface.point(*at)),
        _ => f64::INFINITY,
    };
    if away(across.last()) < away(across.first()) {
        across.reverse();
    }
    track = join_lines(surface, &[track, across], spacing_mm);
    Lines { track, neighbours: [first.neighbours, second.neighbours].concat() }
}

struct Chart {
    middle: Parameter,
    /// Change of (u, v) for 1 mm along and for 1 mm across the rows.
    direction: [f64; 2],
    normal_direction: [f64; 2],
}

impl Chart {
    fn new(surface: &BSplineSurface, patch: &ParameterPatch, angle: Degrees) -> Self {
        let middle = patch.parameter_at(Parameter { u: 0.5, v: 0.5 });
        let tangents = surface.tangents(middle);
        let (lu, lv) = (tangents.s_u.mm.norm(), tangents.s_v.mm.norm());
        let (sine, cosine) = angle.to_rad().sin_cos();
        Chart { middle, direction: [cosine / lu, sine / lv], normal_direction: [-sine / lu, cosine / lv] }
    }

    fn to_parameter(&self, a: f64, b: f64) -> Parameter {
        Parameter {
            u: self.middle.u + a * self.direction[0] + b * self.normal_direction[0],
            v: self.middle.v + a * self.direction[1] + b * self.normal_direction[1],
        }
    }

    fn coordinates(&self, at: Parameter) -> [f64; 2] {
        let (du, dv) = (at.u - self.middle.u, at.v - self.middle.v);
        let area = self.direction[0] * self.normal_direction[1] - self.direction[1] * self.normal_direction[0];
        [
            (du * self.normal_direction[1] - dv * self.normal_direction[0]) / area,
            (dv * self.direction[0] - du * self.direction[1]) / area,
        ]
    }

    /// Returns the distance on the surface, mm, for 1 mm across the rows in the chart.
    fn measure(&self, surface: &BSplineSurface, patch: &ParameterPatch, at: Parameter) -> Result<f64, RasterError> {
        let at = Parameter { u: at.u.clamp(patch.low.u, patch.high.u), v: at.v.clamp(patch.low.v, patch.high.v) };
        let tangents = surface.tangents(at);
        surface.unit_normal(&tangents).ok_or(RasterError::Degenerate { at })?;
        let direction = |[u, v]: [f64; 2]| tangents.s_u.mm * u + tangents.s_v.mm * v;
        let feed = direction(self.direction);
        Ok(feed.cross(&direction(self.normal_direction)).norm() / feed.norm())
    }
}

/// Lays rows at an angle to u; successive rows run in opposite directions.
fn slanted_rows(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    (laying, angle): (&RasterSettings, Degrees),
) -> Result<Vec<Vec<Parameter>>, RasterError> {
    let chart = Chart::new(surface, patch, angle);
    let corners = inset_corners(surface, patch, &laying.insets)?;
    let around = corners.map(|corner| chart.coordinates(corner));
    let range = |axis: usize| {
        let all = around.iter().map(|c| c[axis]);
        (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((a_low, a_high), (b_low, b_high)) = (range(0), range(1));
    let columns = ((a_high - a_low) / COLUMN_MM).ceil().max(2.0) as usize;
    let a = |column: usize| a_low + (a_high - a_low) * column as f64 / columns as f64;
    // The width on the surface, measured through the middle from the lowest to the highest corner.
    let mut width_mm = 0.0;
    for piece in 0..8 {
        let b = b_low + (b_high - b_low) * (piece as f64 + 0.5) / 8.0;
        width_mm += chart.measure(surface, patch, chart.to_parameter(0.0, b))? * (b_high - b_low) / 8.0;
    }
    let steps = (width_mm / laying.step_over_mm - 1e-9).ceil().max(1.0);
    let step_mm = width_mm / steps;
    let mut at: Vec<f64> = vec![b_low; columns + 1];
    let mut rows = Vec::new();
    for row in 0..=steps as usize {
        if row > 0 {
            for (column, b) in at.iter_mut().enumerate() {
                for _ in 0..ACROSS_STEPS {
                    let half_mm = step_mm / ACROSS_STEPS as f64;
                    let here = chart.measure(surface, patch, chart.to_parameter(a(column), *b))?;
                    let there =
                        chart.measure(surface, patch, chart.to_parameter(a(column), *b + half_mm / here))?;
                    *b += half_mm / (0.5 * (here + there));
                }
            }
        }
        let line: Vec<Parameter> =
            at.iter().enumerate().map(|(column, b)| chart.to_parameter(a(column), *b)).collect();
        let mut line = resampled(surface, &clip_line(&line, &corners), [0.0; 2], laying.spacing_mm);
        if rows.len() % 2 == 1 {
            line.reverse();
        }
        if !line.is_empty() {
            rows.push(line);
        }
    }
    Ok(rows)
}

/// Returns the four corners of the patch, moved inwards by the insets, in order.
fn inset_corners(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    insets: &Insets,
) -> Result<[Parameter; 4], RasterError> {
    let corner = |high_u: bool, high_v: bool| {
        let pick = |high: bool, low: f64, top: f64| if high { top } else { low };
        let inset = |[low, high]: [f64; 2], is_high: bool| if is_high { -high } else { low };
        let (u, v) = (pick(high_u, patch.low.u, patch.high.u), pick(high_v, patch.low.v, patch.high.v));
        let mut at = Parameter { u, v };
        for _ in 0..4 {
            let on_border = Parameter { v, ..at };
            at = point_across(surface, RowDirection::U, on_border, inset(insets.v, high_v))?;
            let on_border = Parameter { u, ..at };
            at = point_across(surface, RowDirection::V, on_border, inset(insets.u, high_u))?;
        }
        Ok(at)
    };
    Ok([corner(false, false)?, corner(true, false)?, corner(true, true)?, corner(false, true)?])
}

/// Returns the part of a line inside of a convex quadrilateral.
fn clip_line(line: &[Parameter], corners: &[Parameter; 4]) -> Vec<Parameter> {
    // The value is positive on the inner side of a border; the corners are in the order of a rotation from u to v.
    let sides = |at: Parameter| -> [f64; 4] {
        std::array::from_fn(|n| {
            let (from, to) = (corners[n], corners[(n + 1) % 4]);
            (to.u - from.u) * (at.v - from.v) - (to.v - from.v) * (at.u - from.u)
        })
    };
    let size = sides(corners[0])[1].abs();
    let mut kept: Vec<Parameter> = Vec::new();
    for pair in line.windows(2) {
        let (before, after) = (sides(pair[0]), sides(pair[1]));
        let (mut from, mut to) = (0.0, 1.0_f64);
        for (b, a) in before.into_iter().zip(after) {
            // The tolerance includes points just outside, because the first and the last row touch a corner.
            let (b, a) = (b + 1e-9 * size, a + 1e-9 * size);
            if b < 0.0 && a < 0.0 {
                to = -1.0;
            } else if b < 0.0 {
                from = f64::max(from, b / (b - a));
            } else if a < 0.0 {
                to = to.min(b / (b - a));
            }
        }
        if from <= to {
            for share in [from, to] {
                let at = interpolate(pair[0], pair[1], share);
                if kept.last() != Some(&at) {
                    kept.push(at);
                }
            }
        }
    }
    kept
}

/// The rings of one patch.
pub(super) struct PatchRings<'a> {
    surface: &'a BSplineSurface,
    patch: &'a ParameterPatch,
    insets: Insets,
    step_mm: f64,
    /// Number of rings inside of the outermost ring.
    steps: usize,
    shorter: RowDirection,
    /// Whether the patch is so narrow that the ring is a line.
    is_line: bool,
}

impl<'a> PatchRings<'a> {
    pub fn new(surface: &'a BSplineSurface, patch: &'a ParameterPatch, insets: Insets, step_over_mm: f64) -> Self {
        let length = |along: RowDirection, across: f64| {
            let place = |n: usize| surface.point(patch.parameter_at(along.point(n as f64 / 8.0, across)));
            (0..8).map(|n| place(n).distance_mm(place(n + 1))).sum::<f64>()
        };
        let (u_mm, v_mm) = (length(RowDirection::U, 0.5), length(RowDirection::V, 0.5));
        // If the patch is too small for both insets, the ring becomes a line or a point between them.
        let shrunk = |length_mm: f64, inset: [f64; 2]| {
            let low_mm = squeezed_position_mm(length_mm, inset);
            if inset[0] + inset[1] < length_mm { inset } else { [low_mm, length_mm - low_mm] }
        };
        let insets = Insets { u: shrunk(u_mm, insets.u), v: shrunk(v_mm, insets.v), ..insets };
        let left = |length_mm: f64, [low, high]: [f64; 2]| (length_mm - low - high).max(0.0);
        let (left_u_mm, left_v_mm) = (left(u_mm, insets.u), left(v_mm, insets.v));
        let half_mm = left_u_mm.min(left_v_mm) / 2.0;
        let shorter = if left_u_mm < left_v_mm { RowDirection::U } else { RowDirection::V };
        let middle_mm = if shorter == RowDirection::U { u_mm } else { v_mm };
        let longest_mm = (0..=4).map(|n| length(shorter, n as f64 / 4.0)).fold(middle_mm, f64::max);
        // Difference e between the patch's largest and middle width. Where the patch is widest, the sides of the
        // innermost ring are farther apart by this length. If the length is more than half of a step, more rings do not
        // help, and the gate reports the distance between the lines.
        let excess_mm = Some(longest_mm - middle_mm).filter(|excess_mm| *excess_mm < step_over_mm / 2.0);
        let within_mm = step_over_mm - excess_mm.unwrap_or(0.0);
        let steps = (half_mm / within_mm - 0.5 - 1e-9).ceil().max(0.0) as usize;
        let step_mm = half_mm / (steps as f64 + 0.5);
        PatchRings { surface, patch, insets, step_mm, steps, shorter, is_line: half_mm < MIN_HALF_MM }
    }

    fn depth(&self, ring: usize) -> f64 {
        self.step_mm * ring as f64
    }

    /// Returns the indices of the two long sides of the innermost ring, which are opposite each other.
    pub fn innermost_sides(&self) -> [usize; 2] {
        if self.shorter == RowDirection::U { [1, 3] } else { [0, 2] }
    }

    /// Returns the four sides of each ring, the outermost ring first.
    pub fn closed(&self) -> Result<Vec<[Vec<Parameter>; SIDES]>, RasterError> {
        (0..=self.steps).map(|ring| self.sides([self.depth(ring); SIDES + 1])).collect()
    }

    /// Returns the rings as [`PatchRings::closed`] does, except that the last side of each ring ends on the next ring,
    /// where that ring begins.
    pub fn stepped_rings(&self) -> Result<Vec<[Vec<Parameter>; SIDES]>, RasterError> {
        let mut rings = self.closed()?;
        for (ring, sides) in rings.iter_mut().take(self.steps).enumerate() {
            let next = self.corner([false, false], self.depth(ring + 1))?;
            let last = &mut sides[SIDES - 1];
            last.retain(|at| at.v > next.v);
            if let Some(at) = last.last().copied() {
                last.push(self.point_at_depth(
                    RowDirection::V,
                    Parameter { v: next.v, ..at },
                    false,
                    self.depth(ring),
                )?);
            }
        }
        Ok(rings)
    }

    /// Returns the outermost ring, then the windings of a spiral inwards, then the innermost ring.
    pub fn winding_rings(&self) -> Result<Vec<[Vec<Parameter>; SIDES]>, RasterError> {
        let mut all = vec![self.sides([0.0; SIDES + 1])?];
        for ring in 0..self.steps {
            let (here, next) = (self.depth(ring), self.depth(ring + 1));
            let depth = |corner: usize| here + (next - here) * corner as f64 / SIDES as f64;
            all.push(self.sides([0, 1, 2, 3, 4].map(depth))?);
        }
        if self.steps > 0 {
            all.push(self.sides([self.depth(self.steps); SIDES + 1])?);
        }
        Ok(all)
    }

    /// Returns four sides between corners at these depths. The fifth depth is that of the first corner after one full
    /// winding, at which the line continues.
    fn sides(&self, depths_mm: [f64; SIDES + 1]) -> Result<[Vec<Parameter>; SIDES], RasterError> {
        let corner =
            |n: usize, depth_mm: f64| self.corner([n % SIDES == 1 || n % SIDES == 2, n % SIDES >= 2], depth_mm);
        let mut corners = [Parameter { u: 0.0, v: 0.0 }; SIDES + 1];
        for (n, depth_mm) in depths_mm.iter().enumerate() {
            corners[n] = corner(n, *depth_mm)?;
        }
        let mut sides = [const { Vec::new() }; SIDES];
        for (n, side) in sides.iter_mut().enumerate() {
            let along = if n % 2 == 0 { RowDirection::U } else { RowDirection::V };
            // Sides 1 and 2 follow the high border of the other parameter, sides 0 and 3 the low border.
            let high = n == 1 || n == 2;
            for step in 0..=SIDE_STEPS {
                let share = step as f64 / SIDE_STEPS as f64;
                let depth_mm = depths_mm[n] + (depths_mm[n + 1] - depths_mm[n]) * share;
                let at = interpolate(corners[n], corners[n + 1], share);
                side.push(self.point_at_depth(along, at, high, depth_mm)?);
            }
        }
        if self.is_line {
            // If the ring is a line, the opposite side would repeat this line.
            sides[2].clear();
            sides[3].clear();
        }
        Ok(sides)
    }

    /// Finds the point on the column through `at` that has this depth from the low or the high border.
    fn point_at_depth(
        &self,
        along: RowDirection,
        at: Parameter,
        high: bool,
        depth_mm: f64,
    ) -> Result<Parameter, RasterError> {
        let border = along.cross_coordinate(if high { self.patch.high } else { self.patch.low });
        let inset_mm = self.insets.side_insets(along)[usize::from(high)] + depth_mm;
        let from = along.point(along.row_coordinate(at), border);
        point_across(self.surface, along, from, if high { -inset_mm } else { inset_mm })
    }

    fn corner(&self, [high_u, high_v]: [bool; 2], depth_mm: f64) -> Result<Parameter, RasterError> {
        let pick = |high: bool, low: f64, top: f64| if high { top } else { low };
        let mut at = Parameter {
            u: pick(high_u, self.patch.low.u, self.patch.high.u),
            v: pick(high_v, self.patch.low.v, self.patch.high.v),
        };
        for _ in 0..CORNER_STEPS {
            at = self.point_at_depth(RowDirection::U, at, high_v, depth_mm)?;
            at = self.point_at_depth(RowDirection::V, at, high_u, depth_mm)?;
        }
        Ok(at)
    }
}
