//! Lays rows over a patch with a step-over that is measured on the surface (thesis 4.8).
//!
//! With rows along u, F = S_u / |S_u| and D = N × F across, a step r along D has
//!     Q − P ≈ S_u Δu + S_v Δv,   [[S_u·D, S_v·D], [S_u·F, S_v·F]] (Δu, Δv)ᵀ = (r, 0)ᵀ,          (4.20–4.23)
//! and with this F  Δv = r / (S_v·D),  |S_v·D| = |S_u × S_v| / |S_u|. Each row is computed from the points of the row
//! before it, on columns of constant u: moving Q back along F to its column does not change v. This gives the start
//! value. Then v is corrected until the distance across the rows, measured on the surface,
//!     a(v) = ∫ |S_u × S_v| / |S_u| dv,
//! equals the required distance. Rows along v are computed in the same way with u and v exchanged. Rows have the equal
//! distance r' = w / ceil(w / r) ≤ r, where w is the patch's width between the first and the last row. If a patch is
//! narrower on one side, each column divides its own width by the number of rows, so that the last row follows the far
//! border.
//!
//! Rows and their ends are inset from the patch's border by 0.2 of the disc's radius R, or more if the panel's outline
//! requires this. So the disc overlaps adjacent grids by 0.8 R; with a larger inset the dwell time at the border would
//! be too short. A patch narrower than two insets has one row in its middle; a patch shorter than two insets has rows
//! of one point.

use crate::surface::{BSplineSurface, Parameter, ParameterPatch, PointTangents};
use nalgebra::Vector3;
use panelprep_cell::recipe;

/// Distance of the outer rows and of the rows' ends from the patch's border, in disc radii.
const INSET_RADII: f64 = 0.2;
/// Distance between the columns on which points of rows are calculated, mm; between them rows are straight in (u, v).
const COLUMN_SPACING_MM: f64 = 5.0;
/// Tolerance of a distance across the rows, mm.
const TOLERANCE_MM: f64 = 1e-6;
/// Maximum number of Newton steps for a point of a row; a smooth patch needs two or three.
const MAX_NEWTON_STEPS: usize = 20;
/// Number of intervals over which the width of a patch is integrated, with three nodes each.
const WIDTH_PIECES: usize = 4;
/// Gauss–Legendre nodes and weights on the interval 0…1.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Rows in the order and direction of motion; successive rows run in opposite directions.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// The waypoints of each row.
    pub rows: Vec<Vec<Parameter>>,
}

/// The reasons why rows cannot be laid over a patch.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RasterError {
    /// The surface is degenerate at this point.
    #[error("the surface is degenerate at (u, v) = ({:.4}, {:.4}): S_u and S_v are parallel there; scan the \
        panel again", at.u, at.v)]
    Degenerate {
        /// The parameters of the degenerate point.
        at: Parameter,
    },
    /// The Newton iteration for a point of a row did not converge.
    #[error("no row could be computed at a distance of {distance_mm:.3} mm from (u, v) = ({:.4}, {:.4}); scan \
        the panel again", from.u, from.v)]
    NoRow {
        /// The point of the previous row, or of the border, from which the iteration started.
        from: Parameter,
        /// Required distance between the rows, mm.
        distance_mm: f64,
    },
}

/// The parameter along which rows run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RowDirection {
    U,
    V,
}

impl RowDirection {
    /// Returns the point at the parameter `a` along the rows and `b` across them.
    pub fn point(self, a: f64, b: f64) -> Parameter {
        match self {
            RowDirection::U => Parameter { u: a, v: b },
            RowDirection::V => Parameter { u: b, v: a },
        }
    }

    pub fn row_coordinate(self, at: Parameter) -> f64 {
        if self == RowDirection::U { at.u } else { at.v }
    }

    pub fn cross_coordinate(self, at: Parameter) -> f64 {
        if self == RowDirection::U { at.v } else { at.u }
    }
}

/// Returns the distance of rows and their ends from a patch's border, mm.
pub(super) fn border_inset_mm(settings: &recipe::Path) -> f64 {
    INSET_RADII * settings.disc_diameter_mm() / 2.0
}

/// Distances of rows and their ends from the patch's four borders, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Insets {
    /// Distances from the borders at minimum and maximum u.
    pub u: [f64; 2],
    /// Distances from the borders at minimum and maximum v.
    pub v: [f64; 2],
    /// Additional distance that is required from each side: minimum u, maximum u, minimum v, maximum v.
    pub extra_mm: [f64; 4],
    /// Whether each side was already moved inwards because of the outline.
    pub is_pushed: [bool; 4],
}

impl Insets {
    /// Returns the insets without a panel outline: only the disc's radius determines them.
    pub fn for_disc(settings: &recipe::Path) -> Self {
        let inset_mm = border_inset_mm(settings);
        Insets { u: [inset_mm; 2], v: [inset_mm; 2], extra_mm: [0.0; 4], is_pushed: [false; 4] }
    }

    /// Records that the disc reaches too far beyond the outline at a point: the rows must keep a larger distance from
    /// the side in the direction `outward`.
    pub fn require_distance(&mut self, tangents: &PointTangents, outward: Vector3<f64>, excess_mm: f64) {
        let (along_u, along_v) =
            (outward.dot(&tangents.s_u.mm.normalize()), outward.dot(&tangents.s_v.mm.normalize()));
        let towards = [-along_u, along_u, -along_v, along_v];
        let side = (0..4).fold(0, |most, side| if towards[side] > towards[most] { side } else { most });
        self.extra_mm[side] = self.extra_mm[side].max(excess_mm);
    }

    /// Adds the recorded distances to the insets.
    pub fn apply_distances(&mut self) {
        for (side, more) in std::mem::take(&mut self.extra_mm).into_iter().enumerate() {
            let insets = if side < 2 { &mut self.u } else { &mut self.v };
            insets[side % 2] += more;
            self.is_pushed[side] |= more > 0.0;
        }
    }

    /// Sets the insets of the sides that were not moved inwards to 0, so that the disc overlaps the adjacent grids by
    /// its full radius there. Returns false if this changed no inset.
    pub fn release_sides(&mut self) -> bool {
        let free: Vec<usize> = (0..4).filter(|side| !self.is_pushed[*side]).collect();
        let mut gave = false;
        for side in free.into_iter().filter(|_| self.is_pushed.contains(&true)) {
            let insets = if side < 2 { &mut self.u } else { &mut self.v };
            gave |= insets[side % 2] > 0.0;
            insets[side % 2] = 0.0;
        }
        gave
    }

    pub fn end_insets(&self, along: RowDirection) -> [f64; 2] {
        if along == RowDirection::U { self.u } else { self.v }
    }

    pub fn side_insets(&self, along: RowDirection) -> [f64; 2] {
        if along == RowDirection::U { self.v } else { self.u }
    }
}

/// The settings with which rows are laid.
#[derive(Debug, Clone, Copy)]
pub(super) struct RasterSettings {
    pub along: RowDirection,
    pub insets: Insets,
    pub step_over_mm: f64,
    pub spacing_mm: f64,
}

/// Returns rows along u over one patch.
///
/// # Errors
/// If the surface of the patch is degenerate.
pub fn raster(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    settings: &recipe::Path,
) -> Result<Raster, RasterError> {
    let laying = RasterSettings {
        along: RowDirection::U,
        insets: Insets::for_disc(settings),
        step_over_mm: settings.step_over_mm(),
        spacing_mm: settings.waypoint_spacing_mm(),
    };
    Ok(Raster { rows: rows(surface, patch, &laying)? })
}

/// Returns rows over one patch along one of the parameters.
pub(super) fn rows(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    laying: &RasterSettings,
) -> Result<Vec<Vec<Parameter>>, RasterError> {
    let columns = columns(surface, patch, laying)?;
    let widest_mm = columns.iter().map(|column| column.left_mm).fold(0.0, f64::max);
    let steps = (widest_mm / laying.step_over_mm - 1e-9).ceil().max(0.0) as usize;

    let border = laying.along.cross_coordinate(patch.low);
    let mut row: Vec<Parameter> = Vec::with_capacity(columns.len());
    for column in &columns {
        let from = laying.along.point(column.at, border);
        row.push(point_across(surface, laying.along, from, column.first_mm)?);
    }
    let mut rows = vec![row];
    for _ in 0..steps {
        let previous = &rows[rows.len() - 1];
        let next = previous.iter().zip(&columns).map(|(from, column)| {
            point_across(surface, laying.along, *from, column.left_mm / steps as f64) // r' of this column
        });
        rows.push(next.collect::<Result<_, _>>()?);
    }
    let ended = |(index, row): (usize, Vec<Parameter>)| {
        let mut row = trim_row(surface, &row, laying);
        if index % 2 == 1 {
            row.reverse();
        }
        row
    };
    Ok(rows.into_iter().enumerate().map(ended).collect())
}

impl Raster {
    /// Returns all waypoints as one track in contact: the rows and the connections between them.
    pub fn to_track(&self, surface: &BSplineSurface, spacing_mm: f64) -> Vec<Parameter> {
        join_lines(surface, &self.rows, spacing_mm)
    }
}

/// Connects successive lines with straight lines; no step is longer than the given distance between waypoints.
pub(super) fn join_lines(surface: &BSplineSurface, lines: &[Vec<Parameter>], spacing_mm: f64) -> Vec<Parameter> {
    let mut track: Vec<Parameter> = Vec::new();
    for line in lines {
        let mut line = line.as_slice();
        if let (Some(from), Some(to)) = (track.last().copied(), line.first().copied()) {
            track.extend(intermediate_points(surface, from, to, spacing_mm));
            if from == to {
                line = &line[1..];
            }
        }
        track.extend(line);
    }
    track
}

/// Returns points between two points, without these two, so that no step exceeds the given distance between waypoints.
pub(super) fn intermediate_points(
    surface: &BSplineSurface,
    from: Parameter,
    to: Parameter,
    spacing_mm: f64,
) -> impl Iterator<Item = Parameter> {
    let at = move |step: usize, steps: usize| interpolate(from, to, step as f64 / steps as f64);
    let longest_mm = |steps: usize| {
        let points = (0..=steps).map(|step| surface.point(at(step, steps)));
        let ends = points.clone().skip(1);
        points.zip(ends).map(|(from, to)| from.distance_mm(to)).fold(0.0, f64::max)
    };
    let fewest = (surface.point(from).distance_mm(surface.point(to)) / spacing_mm - 1e-9).ceil().max(1.0) as usize;
    // The limit is doubled, because equal steps in the parameters give unequal steps on the surface.
    let most = 2 * fewest + 8;
    let steps = (fewest..most).find(|steps| longest_mm(*steps) <= spacing_mm * (1.0 + 1e-9)).unwrap_or(most);
    (1..steps).map(move |step| interpolate(from, to, step as f64 / steps as f64))
}

pub(super) fn interpolate(from: Parameter, to: Parameter, share: f64) -> Parameter {
    Parameter { u: from.u + (to.u - from.u) * share, v: from.v + (to.v - from.v) * share }
}

struct Column {
    at: f64,
    /// Distance from the low border to the first row, mm.
    first_mm: f64,
    /// Distance from the first to the last row, mm.
    left_mm: f64,
}

fn columns(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    laying: &RasterSettings,
) -> Result<Vec<Column>, RasterError> {
    let along = laying.along;
    let share = |a: f64, b: f64| patch.parameter_at(along.point(a, b));
    let middle = |step: usize| surface.point(share(step as f64 / 4.0, 0.5));
    let length_mm: f64 = (0..4).map(|step| middle(step).distance_mm(middle(step + 1))).sum();
    let pieces = (length_mm / COLUMN_SPACING_MM).ceil().max(2.0) as usize;
    let [low_mm, high_mm] = laying.insets.side_insets(along);
    let column = |index: usize| {
        let border = |piece: usize| share(index as f64 / pieces as f64, piece as f64 / WIDTH_PIECES as f64);
        let mut width_mm = 0.0;
        for piece in 0..WIDTH_PIECES {
            width_mm += column_length_mm(surface, along, border(piece), along.cross_coordinate(border(piece + 1)))?;
        }
        let left_mm = width_mm - low_mm - high_mm;
        // If the width is too small for both insets, there is one row at a position that violates both insets equally.
        let first_mm = if left_mm > 0.0 { low_mm } else { squeezed_position_mm(width_mm, [low_mm, high_mm]) };
        Ok(Column { at: along.row_coordinate(border(0)), first_mm, left_mm: left_mm.max(0.0) })
    };
    (0..=pieces).map(column).collect()
}

/// Returns the distance from the low border, mm, of a line in a width that is too small for both insets: the line
/// violates both insets equally.
pub(super) fn squeezed_position_mm(width_mm: f64, [low_mm, high_mm]: [f64; 2]) -> f64 {
    ((width_mm + low_mm - high_mm) / 2.0).clamp(0.0, width_mm)
}

/// Finds the point on the column through `from` at this distance across the rows, towards larger parameters.
pub(super) fn point_across(
    surface: &BSplineSurface,
    along: RowDirection,
    from: Parameter,
    distance_mm: f64,
) -> Result<Parameter, RasterError> {
    let place = |b: f64| along.point(along.row_coordinate(from), b);
    let mut b = along.cross_coordinate(from) + distance_mm / mm_per_unit(surface, along, from)?; // Eq. 4.23, 4.24
    for _ in 0..MAX_NEWTON_STEPS {
        let missing_mm = distance_mm - column_length_mm(surface, along, from, b)?;
        if missing_mm.abs() < TOLERANCE_MM {
            return Ok(place(b));
        }
        b += missing_mm / mm_per_unit(surface, along, place(b))?;
    }
    Err(RasterError::NoRow { from, distance_mm })
}

/// Calculates the length ∫ |S_u × S_v| / |S_u| dv along a column, mm.
fn column_length_mm(
    surface: &BSplineSurface,
    along: RowDirection,
    from: Parameter,
    to: f64,
) -> Result<f64, RasterError> {
    let (a, b) = (along.row_coordinate(from), along.cross_coordinate(from));
    let mut sum = 0.0;
    for (node, weight) in GAUSS {
        sum += weight * mm_per_unit(surface, along, along.point(a, b + (to - b) * node))?;
    }
    Ok(sum * (to - b))
}

/// Calculates |S_v·D| of Eq. 4.23 with F along S_u, mm per unit of v; for rows along v, u and v are exchanged.
fn mm_per_unit(surface: &BSplineSurface, along: RowDirection, at: Parameter) -> Result<f64, RasterError> {
    let tangents = surface.tangents(at);
    surface.unit_normal(&tangents).ok_or(RasterError::Degenerate { at })?;
    let feed = if along == RowDirection::U { tangents.s_u } else { tangents.s_v };
    Ok(tangents.area_mm2() / feed.mm.norm())
}

/// Returns waypoints at equal distances along a row, from one end inset to the other.
fn trim_row(surface: &BSplineSurface, row: &[Parameter], laying: &RasterSettings) -> Vec<Parameter> {
    // The inset is measured perpendicular to the border, so a row that meets the border at an angle is cut by a longer
    // distance.
    let [low_mm, high_mm] = laying.insets.end_insets(laying.along);
    let (start, end) = (surface.tangents(row[0]), surface.tangents(row[row.len() - 1]));
    resampled(surface, row, [low_mm / tangent_sine(&start), high_mm / tangent_sine(&end)], laying.spacing_mm)
}

/// Returns points at equal distances along a line after cutting these lengths off its two ends, mm; one point in the
/// middle if the line is too short for the cuts.
pub(super) fn resampled(
    surface: &BSplineSurface,
    line: &[Parameter],
    [before_mm, after_mm]: [f64; 2],
    spacing_mm: f64,
) -> Vec<Parameter> {
    if line.len() < 2 {
        return line.to_vec();
    }
    let mut way_mm = vec![0.0];
    for pair in line.windows(2) {
        let step_mm = surface.point(pair[0]).distance_mm(surface.point(pair[1]));
        way_mm.push(way_mm[way_mm.len() - 1] + step_mm);
    }
    let (first, last) = (before_mm, way_mm[line.len() - 1] - after_mm);
    let place = |at_mm: f64| {
        let after = way_mm.partition_point(|way| *way < at_mm).clamp(1, line.len() - 1);
        let gap_mm = way_mm[after] - way_mm[after - 1];
        let share = if gap_mm > 0.0 { (at_mm - way_mm[after - 1]) / gap_mm } else { 0.0 };
        interpolate(line[after - 1], line[after], share)
    };
    if first >= last {
        return vec![place((first + last) / 2.0)];
    }
    let steps = ((last - first) / spacing_mm - 1e-9).ceil().max(1.0) as usize;
    (0..=steps).map(|step| place(first + (last - first) * step as f64 / steps as f64)).collect()
}

/// Returns the sine of the angle between S_u and S_v.
fn tangent_sine(tangents: &PointTangents) -> f64 {
    tangents.area_mm2() / (tangents.s_u.mm.norm() * tangents.s_v.mm.norm())
}
