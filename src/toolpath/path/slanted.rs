//! Rows in any direction over a patch.
//!
//! In the patch's middle u and v are scaled to mm and rotated by the feed angle: (a, b) along and across the rows.
//! Rows begin at the inset corner of the patch that is lowest in b. Each row continues from the row before it by r'
//! along b, measured on the surface as ∫ |F × D| / |F| db with F = S_a and D = S_b. Parts of rows outside of the inset
//! patch use the measure of the nearest place in the patch, and are then cut off.

use super::raster::{Insets, RasterError, RasterSettings, RowDirection, interpolate, point_across, resampled};
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use panelprep_base::geometry::Degrees;

/// Distance between points of a row before resampling, mm.
const COLUMN_MM: f64 = 4.0;
/// Number of steps for a distance across the rows; the measure hardly changes over one row.
const ACROSS_STEPS: usize = 2;

struct Chart {
    middle: Parameter,
    /// Change of (u, v) for 1 mm along and across.
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

    /// Returns the distance on the surface, mm, for 1 mm across in the chart.
    fn measure(&self, surface: &BSplineSurface, patch: &ParameterPatch, at: Parameter) -> Result<f64, RasterError> {
        let at = Parameter { u: at.u.clamp(patch.low.u, patch.high.u), v: at.v.clamp(patch.low.v, patch.high.v) };
        let tangents = surface.tangents(at);
        surface.unit_normal(&tangents).ok_or(RasterError::Degenerate { at })?;
        let direction = |[u, v]: [f64; 2]| tangents.s_u.mm * u + tangents.s_v.mm * v;
        let feed = direction(self.direction);
        Ok(feed.cross(&direction(self.normal_direction)).norm() / feed.norm())
    }
}

/// Lays rows at an angle to u; neighbouring rows run in opposite directions.
pub(super) fn rows(
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
    // Width on the surface through the middle, from the lowest to the highest corner.
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

/// Returns the corners of the patch, moved inwards by the insets, in order.
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

/// Returns the part of a line inside a convex quadrilateral.
fn clip_line(line: &[Parameter], corners: &[Parameter; 4]) -> Vec<Parameter> {
    // The value is positive inside of a side; the corners are in the order that leads from u to v.
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
            // A point just outside counts as inside, because the first and the last row touch a corner.
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
