//! The lines of one area, which are laid again until the disc stays within the outline and reaches the whole area, and
//! no two lines are farther apart than the recipe's step-over.

use super::areas::Area;
use super::coverage::{GridCoverage, MIN_COVERAGE, coverage, step_overs_mm, strokes};
use super::edge::Outline;
use super::lines::{Lines, lines};
use super::planned::PlanError;
use super::raster::Insets;
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;

/// A function that returns whether there is panel at a place.
pub(super) type IsPanelAt<'a> = &'a (dyn Fn(Parameter) -> bool + Sync);

/// The lines of one area and their results, before paths are joined.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub area: Area,
    pub track: Vec<Parameter>,
    /// Whether each place of the track has panel below it.
    pub contact: Vec<bool>,
    pub spacing_mm: f64,
    pub coverage: Vec<GridCoverage>,
    pub step_overs_mm: Vec<f64>,
    pub overhangs_mm: Vec<f64>,
}

/// Largest number of times that lines are laid again because the disc reaches too far beyond the outline, or lines
/// are too far apart.
const MAX_RELAY_ROUNDS: usize = 16;
/// Additional distance by which lines are moved inwards beyond the excess of the disc, mm: the excess that remains
/// after a round is less than this.
const OUTLINE_CLEAR_MM: f64 = 0.01;
/// Additional factor by which lines are laid closer when they are too far apart.
const SPACING_REDUCTION: f64 = 0.999;
/// Number of places on each side of a patch at which its curvature is checked.
const BEND_STEPS: usize = 6;
/// If one place would be enough for a whole patch, the disc moves over it by this fraction of its radius, so that it
/// does not come down and leave at the same place.
const STROKE_RADII: f64 = 0.5;
/// Number of times that this motion is halved if the disc would reach beyond the outline.
const STROKE_HALVES: usize = 3;

pub(super) fn first_grid(area: &Area) -> GridId {
    area.grids.first().copied().unwrap_or(GridId { row: 1, column: 1 })
}

pub(super) fn make_piece(
    surface: &BSplineSurface,
    region: &Region,
    area: Area,
    (outline, there): (&Outline, IsPanelAt<'_>),
    settings: &recipe::Path,
) -> Result<Piece, PlanError> {
    let radius_mm = settings.disc_diameter_mm() / 2.0;
    let spacing_mm = spacing_mm(surface, &area.patch, settings);
    let on_surface = |places: &[Parameter]| places.iter().map(|at| surface.point(*at)).collect::<Vec<_>>();
    let parts = area.parts(region);
    let covered = |track: &[Point<Panel>], contact: &[bool]| -> Vec<GridCoverage> {
        let strokes = strokes(track, |index| contact[index]);
        parts.iter().map(|(id, part)| coverage(surface, (*id, part), &strokes, radius_mm)).collect()
    };
    let mut insets = Insets::for_disc(settings);
    let mut step_over_mm = settings.step_over_mm();
    let mut round = 0;
    loop {
        let laid = lines(surface, &area.patch, insets, settings, [step_over_mm, spacing_mm])
            .map_err(|cause| PlanError::Raster { grid: first_grid(&area), cause })?;
        let Lines { mut track, neighbours } = laid;
        if let [only] = track[..] {
            track = short_motion(surface, only, (outline, settings));
        }
        let on_track = on_surface(&track);
        let overhangs_mm: Vec<f64> =
            on_track.iter().map(|contact| outline.overhang_mm(*contact, radius_mm)).collect();
        round += 1;
        if round < MAX_RELAY_ROUNDS && outline.is_present() {
            let allowed_mm = settings.edge_overhang_mm();
            let mut beyond = false;
            for ((at, point), mm) in track.iter().zip(&on_track).zip(&overhangs_mm) {
                if let Some(outward) = outline.outward_direction(*point).filter(|_| *mm > allowed_mm) {
                    insets.require_distance(&surface.tangents(*at), outward, mm - allowed_mm + OUTLINE_CLEAR_MM);
                    beyond = true;
                }
            }
            if beyond {
                insets.apply_distances();
                continue;
            }
        }
        let beside = |[line, next]: &[Vec<Parameter>; 2]| step_overs_mm(&on_surface(line), &on_surface(next));
        let step_overs_mm: Vec<f64> = neighbours.iter().flat_map(beside).collect();
        let widest_mm = step_overs_mm.iter().copied().fold(0.0, f64::max);
        if round < MAX_RELAY_ROUNDS && widest_mm > settings.step_over_mm() {
            step_over_mm *= SPACING_REDUCTION * settings.step_over_mm() / widest_mm;
            continue;
        }
        let contact: Vec<bool> = track.iter().map(|at| there(*at)).collect();
        let coverage = covered(&on_track, &contact);
        let short = coverage.iter().any(|grid| grid.share() < MIN_COVERAGE);
        if !(round < MAX_RELAY_ROUNDS && short && insets.release_sides()) {
            return Ok(Piece { area, track, contact, spacing_mm, coverage, step_overs_mm, overhangs_mm });
        }
    }
}

/// Returns a short motion over one place, along u or v: the direction that keeps more of the disc on the panel.
fn short_motion(
    surface: &BSplineSurface,
    at: Parameter,
    (outline, settings): (&Outline, &recipe::Path),
) -> Vec<Parameter> {
    let (radius_mm, tangents) = (settings.disc_diameter_mm() / 2.0, surface.tangents(at));
    let (per_u, per_v) = (tangents.s_u.mm.norm(), tangents.s_v.mm.norm());
    let ends = |half_mm: f64, along_u: bool| {
        let (du, dv) = if along_u { (half_mm / per_u, 0.0) } else { (0.0, half_mm / per_v) };
        [Parameter { u: at.u - du, v: at.v - dv }, Parameter { u: at.u + du, v: at.v + dv }]
    };
    let overhang_mm = |ends: &[Parameter; 2]| {
        ends.iter().map(|end| outline.overhang_mm(surface.point(*end), radius_mm)).fold(0.0, f64::max)
    };
    let mut best = ends(STROKE_RADII * radius_mm / 2.0, true);
    for half in 0..=STROKE_HALVES {
        let half_mm = STROKE_RADII * radius_mm / 2.0 / f64::powi(2.0, half as i32);
        for along_u in [true, false] {
            let ends = ends(half_mm, along_u);
            if overhang_mm(&ends) < overhang_mm(&best) {
                best = ends;
            }
        }
        if overhang_mm(&best) <= settings.edge_overhang_mm() {
            break;
        }
    }
    best.to_vec()
}

/// Returns the recipe's spacing, or less if a chord of this length would leave the surface by more than the recipe
/// allows: a chord of length s deviates from a curvature κ by κ s² / 8.
fn spacing_mm(surface: &BSplineSurface, patch: &ParameterPatch, settings: &recipe::Path) -> f64 {
    let mut bend: f64 = 0.0;
    for n in 0..=BEND_STEPS * BEND_STEPS {
        let share = |index: usize| index as f64 / BEND_STEPS as f64;
        let at = patch
            .parameter_at(Parameter { u: share(n % (BEND_STEPS + 1)).min(1.0), v: share(n / (BEND_STEPS + 1)) });
        if let Some(bends) = surface.principal_curvatures(&surface.derivatives(at)) {
            bend = bends.iter().fold(bend, |most, one| most.max(one.abs()));
        }
    }
    let chord_mm = if bend > 0.0 { (8.0 * settings.chord_error_mm() / bend).sqrt() } else { f64::INFINITY };
    settings.waypoint_spacing_mm().min(chord_mm)
}
