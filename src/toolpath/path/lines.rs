//! The lines over one patch, by the recipe's pattern, as one continuous track from the first place in contact to the
//! last.

use super::raster::{Insets, RasterError, RasterSettings, RowDirection, join_lines, resampled, rows};
use super::rings::PatchRings;
use super::slanted;
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use panelprep_base::geometry::{Degrees, Panel, Point};
use panelprep_cell::recipe::{self, Pattern};

/// Angles within this distance of 0 and 90° count as along u and v.
const AXIS_ANGLE_TOLERANCE_DEG: f64 = 0.01;

/// Neighbouring turns of a spiral with corners are not parallel: near its middle their distance exceeds the difference
/// of their depths by up to 15 %.
const WINDING: f64 = 0.85;

/// A line shorter than this, mm, or than [`MIN_SPACING_SHARE`] of the spacing, is left out: it is merged with the next
/// line. Such a short line would be travelled slowly, because the controller needs time to plan each line.
const MIN_LINE_MM: f64 = 1.0;
const MIN_SPACING_SHARE: f64 = 0.25;

/// Lines over a patch.
#[derive(Debug, Clone)]
pub(super) struct Lines {
    /// All places in contact, in order.
    pub track: Vec<Parameter>,
    /// Neighbouring lines, for measuring their distance.
    pub neighbours: Vec<[Vec<Parameter>; 2]>,
}

/// Lays the lines, at most `step_over_mm` apart; waypoints are at most `spacing_mm` apart.
pub(super) fn lines(
    surface: &BSplineSurface,
    patch: &ParameterPatch,
    insets: Insets,
    settings: &recipe::Path,
    [step_over_mm, spacing_mm]: [f64; 2],
) -> Result<Lines, RasterError> {
    let laid = lay_lines(surface, patch, insets, settings, [step_over_mm, spacing_mm])?;
    Ok(Lines {
        track: drop_short_steps(surface, &laid.track, MIN_LINE_MM.min(MIN_SPACING_SHARE * spacing_mm)),
        ..laid
    })
}

/// Removes places from the track that are nearer to the previous place than this distance; the ends of the track
/// stay.
fn drop_short_steps(surface: &BSplineSurface, track: &[Parameter], least_mm: f64) -> Vec<Parameter> {
    let mut kept: Vec<(Parameter, Point<Panel>)> = Vec::with_capacity(track.len());
    for (index, at) in track.iter().enumerate() {
        let point = surface.point(*at);
        let is_near = |kept: &[(Parameter, Point<Panel>)]| {
            kept.last().is_some_and(|(_, last)| last.distance_mm(point) < least_mm)
        };
        if index + 1 == track.len() {
            // The end of the track stays and earlier places give way: the last line must reach the border.
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
            // Kept within ±90°, the range that the recipe accepts.
            let other_deg = if angle_deg > 0.0 { angle_deg - 90.0 } else { angle_deg + 90.0 };
            let first = alternate_rows(surface, lay_rows(surface, patch, &laying, angle_deg)?, spacing_mm);
            let second = alternate_rows(surface, lay_rows(surface, patch, &laying, other_deg)?, spacing_mm);
            join_row_sets(surface, first, second, spacing_mm)
        }
        Pattern::Offset => around(rings(1.0).innermost_sides(), rings(1.0).closed()?),
        Pattern::OffsetSpiral => around(rings(1.0).innermost_sides(), rings(1.0).stepped_rings()?),
        Pattern::Spiral => around(rings(WINDING).innermost_sides(), rings(WINDING).winding_rings()?),
    };
    let in_rows = matches!(settings.pattern(), Pattern::Raster | Pattern::CrossHatch);
    if !(in_rows && is_slanted_angle(settings.feed_angle_deg())) {
        return Ok(laid);
    }
    // Rows that meet the border at an angle leave a jagged edge there, so a contour is abraded first.
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
        slanted::rows(surface, patch, (laying, Degrees(angle_deg)))
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

/// Joins two sets of rows; the second set begins at the end that is nearer.
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
