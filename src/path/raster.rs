//! Rows over a patch with a step-over that holds on the surface (thesis 4.8).
//!
//! Rows run along u, F = S_u / |S_u|, D = N × F across. A step r along D has
//!     Q − P ≈ S_u Δu + S_v Δv,   [[S_u·D, S_v·D], [S_u·F, S_v·F]] (Δu, Δv)ᵀ = (r, 0)ᵀ,          (4.20–4.23)
//! and with this F  Δv = r / (S_v·D),  |S_v·D| = |S_u × S_v| / |S_u|. A row goes on from each point of the one before
//! it, on columns of constant u: sliding Q back along F to its column leaves v as it is. That is the first guess; then
//! v is corrected until the distance across, measured on the surface,
//!     a(v) = ∫ |S_u × S_v| / |S_u| dv,
//! is right. Rows stand at the equal distance r' = w / ceil(w / r) ≤ r, w being what is left of the patch's width
//! between the first and the last row; where a patch is narrower on one side, each column divides its own width by
//! the number of rows, so that the last row follows the far border.
//!
//! Rows and their ends are inset from the patch's border by 0.6 of the disc's radius R: a corner is then 0.6 √2 R
//! away, within the disc, and the disc laps onto neighbouring grids by 0.4 R; a corner sharper than 74° is not reached
//! wholly, which the coverage shows. A patch narrower than two insets gets
//! one row in its middle, one shorter than two insets rows of one point.

use crate::recipe;
use crate::surface::{BSplineSurface, Parameter, Patch, Tangents};

/// Distance of the outer rows and of the rows' ends from the patch's border, in disc radii.
const INSET_RADII: f64 = 0.6;
/// Columns on which rows are found; between them rows are straight in (u, v).
const COLUMN_SPACING_MM: f64 = 5.0;
/// A distance across is right when it is this exact, mm.
const EXACT_MM: f64 = 1e-6;
/// Newton steps before a row is given up; a smooth patch needs two or three.
const MAX_NEWTON_STEPS: usize = 20;
/// Pieces in which the width of a patch is integrated, three nodes each.
const WIDTH_PIECES: usize = 4;
/// Gauss–Legendre nodes and weights on 0…1.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Rows in the order and direction of motion: each next one runs the other way.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// The rows' waypoints.
    pub rows: Vec<Vec<Parameter>>,
}

/// Why a patch has no raster.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// The surface has no area there.
    #[error("the surface has no area at (u, v) = ({:.4}, {:.4})", at.u, at.v)]
    Degenerate {
        /// Where.
        at: Parameter,
    },
    /// The correction did not settle.
    #[error("no place lies {distance_mm:.3} mm across from (u, v) = ({:.4}, {:.4})", from.u, from.v)]
    NoRow {
        /// Place of the previous row, or of the border.
        from: Parameter,
        /// Distance asked for, mm.
        distance_mm: f64,
    },
}

/// Rows over one patch.
///
/// # Errors
/// Where the surface is degenerate.
pub fn raster(surface: &BSplineSurface, patch: &Patch, settings: &recipe::Path) -> Result<Raster, RasterError> {
    let inset_mm = INSET_RADII * settings.disc_diameter_mm() / 2.0;
    let columns = columns(surface, patch)?;
    let left_mm = |column: &Column| (column.width_mm - 2.0 * inset_mm).max(0.0);
    let widest_mm = columns.iter().map(left_mm).fold(0.0, f64::max);
    let steps = (widest_mm / settings.step_over_mm() - 1e-9).ceil().max(0.0) as usize;

    let mut row: Vec<Parameter> = Vec::with_capacity(columns.len());
    for column in &columns {
        let border = Parameter { u: column.u, v: patch.low.v };
        row.push(across_from(surface, border, inset_mm.min(column.width_mm / 2.0))?);
    }
    let mut rows = vec![row];
    for _ in 0..steps {
        let previous = &rows[rows.len() - 1];
        let next = previous.iter().zip(&columns).map(|(from, column)| {
            across_from(surface, *from, left_mm(column) / steps as f64) // r' of this column
        });
        rows.push(next.collect::<Result<_, _>>()?);
    }
    let ended = |(index, row): (usize, Vec<Parameter>)| {
        let mut row = resampled(surface, &row, inset_mm, settings.waypoint_spacing_mm());
        if index % 2 == 1 {
            row.reverse();
        }
        row
    };
    Ok(Raster { rows: rows.into_iter().enumerate().map(ended).collect() })
}

impl Raster {
    /// All waypoints in one: the rows and the turns between them, in contact throughout.
    pub fn track(&self, surface: &BSplineSurface, spacing_mm: f64) -> Vec<Parameter> {
        let mut track: Vec<Parameter> = Vec::new();
        for row in &self.rows {
            if let (Some(from), Some(to)) = (track.last().copied(), row.first().copied()) {
                track.extend(between(surface, from, to, spacing_mm));
            }
            track.extend(row);
        }
        track
    }
}

/// Places between two others, neither included, so that no step exceeds the spacing.
pub(super) fn between(
    surface: &BSplineSurface,
    from: Parameter,
    to: Parameter,
    spacing_mm: f64,
) -> impl Iterator<Item = Parameter> {
    let steps = (surface.point(from).distance_mm(surface.point(to)) / spacing_mm - 1e-9).ceil().max(1.0) as usize;
    (1..steps).map(move |step| mix(from, to, step as f64 / steps as f64))
}

fn mix(from: Parameter, to: Parameter, share: f64) -> Parameter {
    Parameter { u: from.u + (to.u - from.u) * share, v: from.v + (to.v - from.v) * share }
}

struct Column {
    u: f64,
    width_mm: f64,
}

fn columns(surface: &BSplineSurface, patch: &Patch) -> Result<Vec<Column>, RasterError> {
    let middle = |step: usize| surface.point(patch.at(Parameter { u: step as f64 / 4.0, v: 0.5 }));
    let length_mm: f64 = (0..4).map(|step| middle(step).distance_mm(middle(step + 1))).sum();
    let pieces = (length_mm / COLUMN_SPACING_MM).ceil().max(2.0) as usize;
    let column = |index: usize| {
        let place = |v: f64| patch.at(Parameter { u: index as f64 / pieces as f64, v });
        let border = |piece: usize| place(piece as f64 / WIDTH_PIECES as f64);
        let mut width_mm = 0.0;
        for piece in 0..WIDTH_PIECES {
            width_mm += across_mm(surface, border(piece), border(piece + 1).v)?;
        }
        Ok(Column { u: place(0.0).u, width_mm })
    };
    (0..=pieces).map(column).collect()
}

/// The place on the column of `from` that lies this far across the feed, towards larger v.
fn across_from(surface: &BSplineSurface, from: Parameter, distance_mm: f64) -> Result<Parameter, RasterError> {
    let mut v = from.v + distance_mm / mm_per_v(surface, from)?; // Eq. 4.23, 4.24
    for _ in 0..MAX_NEWTON_STEPS {
        let missing_mm = distance_mm - across_mm(surface, from, v)?;
        if missing_mm.abs() < EXACT_MM {
            return Ok(Parameter { u: from.u, v });
        }
        v += missing_mm / mm_per_v(surface, Parameter { u: from.u, v })?;
    }
    Err(RasterError::NoRow { from, distance_mm })
}

/// ∫ |S_u × S_v| / |S_u| dv along a column, mm.
fn across_mm(surface: &BSplineSurface, from: Parameter, to_v: f64) -> Result<f64, RasterError> {
    let mut sum = 0.0;
    for (node, weight) in GAUSS {
        let at = Parameter { u: from.u, v: from.v + (to_v - from.v) * node };
        sum += weight * mm_per_v(surface, at)?;
    }
    Ok(sum * (to_v - from.v))
}

/// |S_v·D| of Eq. 4.23 with F along S_u, mm for a unit of v.
fn mm_per_v(surface: &BSplineSurface, at: Parameter) -> Result<f64, RasterError> {
    let tangents = surface.tangents(at);
    surface.normal_of(&tangents).ok_or(RasterError::Degenerate { at })?;
    Ok(tangents.area_mm2() / tangents.s_u.mm.norm())
}

/// Waypoints at equal distances along a row, from inset to inset.
fn resampled(surface: &BSplineSurface, row: &[Parameter], inset_mm: f64, spacing_mm: f64) -> Vec<Parameter> {
    let mut way_mm = vec![0.0];
    for pair in row.windows(2) {
        let step_mm = surface.point(pair[0]).distance_mm(surface.point(pair[1]));
        way_mm.push(way_mm[way_mm.len() - 1] + step_mm);
    }
    // The inset is a distance from the border; a row that meets it aslant goes farther for it.
    let along = |end: Parameter| inset_mm / sine(&surface.tangents(end));
    let (first, last) = (along(row[0]), way_mm[row.len() - 1] - along(row[row.len() - 1]));
    let place = |at_mm: f64| {
        let after = way_mm.partition_point(|way| *way < at_mm).clamp(1, row.len() - 1);
        let share = (at_mm - way_mm[after - 1]) / (way_mm[after] - way_mm[after - 1]);
        mix(row[after - 1], row[after], share)
    };
    if first >= last {
        return vec![place((first + last) / 2.0)];
    }
    let steps = ((last - first) / spacing_mm - 1e-9).ceil().max(1.0) as usize;
    (0..=steps).map(|step| place(first + (last - first) * step as f64 / steps as f64)).collect()
}

/// Sine of the angle between S_u and S_v.
fn sine(tangents: &Tangents) -> f64 {
    tangents.area_mm2() / (tangents.s_u.mm.norm() * tangents.s_v.mm.norm())
}
