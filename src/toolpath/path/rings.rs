//! Lines that run around a patch: offset contours and spirals (thesis Fig. 4.26 b–d).
//!
//! A ring at depth d has the distance d, measured on the surface as for rows, from each of the patch's four borders
//! beyond that border's inset. Let h be half of the patch's shorter side without the insets. Depths are equal steps r'
//! = h / (n + ½) ≤ r − e, so that the sides of the innermost ring, too, are r' apart in the middle. At places at which
//! the patch is longer by e, they are at most r apart; no line is travelled twice. If h is zero, there is one line, or
//! one point, in the middle.

use super::raster::{Insets, RasterError, RowDirection, interpolate, point_across, squeezed_position_mm};
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};

/// Steps of the search for a ring's corner, the intersection of two borders; each gains about three digits.
const CORNER_STEPS: usize = 4;
/// Number of points along one side of a ring before resampling.
const SIDE_STEPS: usize = 24;
/// Smallest half of a ring's shorter side, mm; a smaller ring becomes a line.
const MIN_HALF_MM: f64 = 0.5;

/// The rings of one patch.
pub(super) struct PatchRings<'a> {
    surface: &'a BSplineSurface,
    patch: &'a ParameterPatch,
    insets: Insets,
    step_mm: f64,
    /// Number of rings inside the outermost one.
    steps: usize,
    shorter: RowDirection,
    /// Whether there is no room for a ring.
    is_line: bool,
}

/// A side of a ring: from the corner at lowest u and v along u, then along v, back along u, back along v.
const SIDES: usize = 4;

impl<'a> PatchRings<'a> {
    pub fn new(surface: &'a BSplineSurface, patch: &'a ParameterPatch, insets: Insets, step_over_mm: f64) -> Self {
        let length = |along: RowDirection, across: f64| {
            let place = |n: usize| surface.point(patch.parameter_at(along.point(n as f64 / 8.0, across)));
            (0..8).map(|n| place(n).distance_mm(place(n + 1))).sum::<f64>()
        };
        let (u_mm, v_mm) = (length(RowDirection::U, 0.5), length(RowDirection::V, 0.5));
        // If there is no space for both insets, the ring shrinks to a line or a point between them.
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
        // The sides of the innermost ring are farther apart by this length at the longest part of the patch than in
        // the middle. If this is most of a step, more rings do not help, and the gate reports how far apart they
        // are.
        let excess_mm = Some(longest_mm - middle_mm).filter(|excess_mm| *excess_mm < step_over_mm / 2.0);
        let within_mm = step_over_mm - excess_mm.unwrap_or(0.0);
        let steps = (half_mm / within_mm - 0.5 - 1e-9).ceil().max(0.0) as usize;
        let step_mm = half_mm / (steps as f64 + 0.5);
        PatchRings { surface, patch, insets, step_mm, steps, shorter, is_line: half_mm < MIN_HALF_MM }
    }

    fn depth(&self, ring: usize) -> f64 {
        self.step_mm * ring as f64
    }

    /// Returns the two sides of the innermost ring that lie beside one another: those across its shorter side.
    pub fn innermost_sides(&self) -> [usize; 2] {
        if self.shorter == RowDirection::U { [1, 3] } else { [0, 2] }
    }

    /// Returns each ring's four sides, the outermost ring first.
    pub fn closed(&self) -> Result<Vec<[Vec<Parameter>; SIDES]>, RasterError> {
        (0..=self.steps).map(|ring| self.sides([self.depth(ring); SIDES + 1])).collect()
    }

    /// Returns the rings as [`PatchRings::closed`] does, but the last side of each ring leads to the corner of the next
    /// ring, at the place where it meets that ring.
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

    /// Returns the outermost ring, then turns that lead continuously inwards, then the innermost ring.
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

    /// Returns four sides between corners of these depths; the fifth depth is the first corner's after a whole
    /// turn, at which the line continues.
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
            // Sides 0 and 3 follow the low border of the other parameter.
            let high = n == 1 || n == 2;
            for step in 0..=SIDE_STEPS {
                let share = step as f64 / SIDE_STEPS as f64;
                let depth_mm = depths_mm[n] + (depths_mm[n + 1] - depths_mm[n]) * share;
                let at = interpolate(corners[n], corners[n + 1], share);
                side.push(self.point_at_depth(along, at, high, depth_mm)?);
            }
        }
        if self.is_line {
            // On a line, the way back would repeat the same line.
            sides[2].clear();
            sides[3].clear();
        }
        Ok(sides)
    }

    /// Finds the point on the column of `at` at this depth from the low or high border.
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
