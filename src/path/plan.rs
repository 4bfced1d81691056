//! Tool paths over chosen grids, with the evidence that the gate judges (thesis Fig. 4.29).
//!
//! Neighbouring grids are one area, and each area has one path (`contact`): through the air to a place above its
//! lines, down, along the lines in contact, up. Areas follow one another on a short way; between them the tool flies
//! over the surface at the height of its approach: a straight way could cut through a bulge. Where the disc would reach
//! too far beyond the panel's outline, lines keep more distance from that side of their area; what is then not reached
//! shows in the coverage. Poses are the tool's in the panel's frame.

use super::areas::{Area, areas, order};
use super::contact::tool_path;
use super::coverage::{GridCoverage, MIN_COVERAGE, coverage, step_overs_mm, strokes};
use super::edge::{Outline, Overhang};
use super::lines::{Lines, lines};
use super::orientation::OrientationError;
use super::raster::{Insets, RasterError};
use crate::geometry::{KukaPose, Panel, Point};
use crate::panel::{GridId, Region};
use crate::recipe;
use crate::surface::{BSplineSurface, Holes, Parameter, Patch};
use rayon::prelude::*;

/// One pose to move to in a straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// The tool in the panel's frame.
    pub pose: KukaPose,
    /// Is the disc on the panel here? A move is one in contact where both its ends are.
    pub contact: bool,
    /// Speed of the tool's point on the way here, mm/s.
    pub feed_mm_s: f64,
    /// Rounding of the corner here, mm; 0 stops.
    pub blend_mm: f64,
}

/// The waypoints over one or more grids, from the air to the air.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolPath {
    /// What it abrades.
    pub grids: Vec<GridId>,
    /// Where the tool goes.
    pub waypoints: Vec<Waypoint>,
}

/// Smallest and largest distance between neighbouring rows, on the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOver {
    /// Smallest, mm.
    pub min_mm: f64,
    /// Largest, mm.
    pub max_mm: f64,
}

/// Paths and what they reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// One path for each area of neighbouring grids, in the order of travel.
    pub paths: Vec<ToolPath>,
    /// Length of all moves, mm.
    pub length_mm: f64,
    /// Length of the moves in contact, mm.
    pub contact_mm: f64,
    /// Time for all moves, s, with starting and stopping where the path stops.
    pub duration_s: f64,
    /// Covered share of all grids together, 0…1.
    pub coverage: f64,
    /// The same for each grid.
    pub grids: Vec<GridCoverage>,
    /// Distance between neighbouring rows, turns apart; `None` where no path has two rows.
    pub step_over_mm: Option<StepOver>,
    /// How far the disc leaves the panel.
    pub overhang: Overhang,
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Nothing to plan.
    #[error("no grid was asked for")]
    NoGrids,
    /// The region has no such grid.
    #[error("the region has no grid {grid}; its grids are r1c1 to r{rows}c{columns}")]
    UnknownGrid {
        /// The grid asked for.
        grid: GridId,
        /// Rows of the region.
        rows: usize,
        /// Columns of the region.
        columns: usize,
    },
    /// A grid would be abraded twice.
    #[error("grid {grid} was asked for twice")]
    Repeated {
        /// The grid.
        grid: GridId,
    },
    /// No rows.
    #[error("grid {grid}: {cause}")]
    Raster {
        /// The grid.
        grid: GridId,
        /// Why.
        cause: RasterError,
    },
    /// No pose.
    #[error("grid {grid}: {cause}")]
    Orientation {
        /// The grid.
        grid: GridId,
        /// Why.
        cause: OrientationError,
    },
}

/// One area's share of the work, before paths are joined.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub area: Area,
    pub track: Vec<Parameter>,
    /// Is there a panel below each place of the track?
    pub contact: Vec<bool>,
    pub spacing_mm: f64,
    coverage: Vec<GridCoverage>,
    step_overs_mm: Vec<f64>,
    overhangs_mm: Vec<f64>,
}

/// Times that lines are laid again because the disc reaches too far beyond the outline.
const OUTLINE_ROUNDS: usize = 16;
/// A disc that reaches this much farther than allowed is right, mm.
const OUTLINE_EXACT_MM: f64 = 0.01;
/// Places on each side of a patch at which its bend is looked at.
const BEND_STEPS: usize = 6;

/// Paths over these grids. `outline` is the panel's, closed.
///
/// # Errors
/// Where a grid is unknown or named twice, or the surface allows no rows or poses there.
pub fn plan(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    outline: &[Point<Panel>],
    settings: &recipe::Path,
) -> Result<Plan, PlanError> {
    planned(surface, region, grids, (outline, &|_| true), settings)
}

/// The same, the tool lifted where the panel has a hole.
///
/// # Errors
/// As [`plan`].
pub fn plan_around(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    (outline, holes): (&[Point<Panel>], &Holes),
    settings: &recipe::Path,
) -> Result<Plan, PlanError> {
    planned(surface, region, grids, (outline, &|at| !holes.holds(at)), settings)
}

/// Is there a panel at a place?
type There<'a> = &'a (dyn Fn(Parameter) -> bool + Sync);

fn planned(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    (outline, there): (&[Point<Panel>], There<'_>),
    settings: &recipe::Path,
) -> Result<Plan, PlanError> {
    refuse_unknown(region, grids)?;
    let outline = Outline::new(outline);
    let areas = areas(region, grids, settings.join_grids());
    let pieces: Vec<Result<Piece, PlanError>> =
        areas.into_par_iter().map(|area| piece(surface, region, area, (&outline, there), settings)).collect();
    let pieces: Vec<Piece> = pieces.into_iter().collect::<Result<_, _>>()?;
    let pieces = ordered(surface, pieces);
    let mut before = None;
    let mut paths = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let path = tool_path(surface, piece, before, settings)
            .map_err(|cause| PlanError::Orientation { grid: first_grid(&piece.area), cause })?;
        before = path.1;
        paths.push(path.0);
    }
    Ok(with_evidence(paths, &pieces, settings))
}

fn refuse_unknown(region: &Region, grids: &[GridId]) -> Result<(), PlanError> {
    if grids.is_empty() {
        return Err(PlanError::NoGrids);
    }
    for (index, id) in grids.iter().enumerate() {
        if grids[..index].contains(id) {
            return Err(PlanError::Repeated { grid: *id });
        }
        if Patch::of_grid(region, *id).is_none() {
            return Err(PlanError::UnknownGrid { grid: *id, rows: region.rows, columns: region.columns });
        }
    }
    Ok(())
}

fn first_grid(area: &Area) -> GridId {
    area.grids.first().copied().unwrap_or(GridId { row: 1, column: 1 })
}

/// The pieces in the order of travel, each in its direction.
fn ordered(surface: &BSplineSurface, pieces: Vec<Piece>) -> Vec<Piece> {
    let end = |at: Option<&Parameter>| at.map_or(Point::at(0.0, 0.0, 0.0), |at| surface.point(*at));
    let ends: Vec<[Point<Panel>; 2]> =
        pieces.iter().map(|piece| [end(piece.track.first()), end(piece.track.last())]).collect();
    let turned = |(index, turned): (usize, bool)| {
        let mut piece = pieces[index].clone();
        if turned {
            piece.track.reverse();
            piece.contact.reverse();
        }
        piece
    };
    order(&ends).into_iter().map(turned).collect()
}

fn piece(
    surface: &BSplineSurface,
    region: &Region,
    area: Area,
    (outline, there): (&Outline, There<'_>),
    settings: &recipe::Path,
) -> Result<Piece, PlanError> {
    let radius_mm = settings.disc_diameter_mm() / 2.0;
    let spacing_mm = spacing_mm(surface, &area.patch, settings);
    let on_surface = |places: &[Parameter]| places.iter().map(|at| surface.point(*at)).collect::<Vec<_>>();
    let patch_of = |id: &GridId| Patch::of_grid(region, *id).unwrap_or(area.patch);
    let covered = |track: &[Point<Panel>], contact: &[bool]| -> Vec<GridCoverage> {
        let strokes = strokes(track, |index| contact[index]);
        area.grids.iter().map(|id| coverage(surface, (*id, &patch_of(id)), &strokes, radius_mm)).collect()
    };
    let mut insets = Insets::of_disc(settings);
    let mut round = 0;
    let (Lines { track, neighbours }, contact, overhangs_mm, coverage) = loop {
        let laid = lines(surface, &area.patch, insets, settings, spacing_mm)
            .map_err(|cause| PlanError::Raster { grid: first_grid(&area), cause })?;
        let on_track = on_surface(&laid.track);
        let overhangs_mm: Vec<f64> =
            on_track.iter().map(|contact| outline.overhang_mm(*contact, radius_mm)).collect();
        round += 1;
        if round < OUTLINE_ROUNDS && outline.is_known() {
            let allowed_mm = settings.edge_overhang_mm();
            let mut beyond = false;
            for ((at, point), mm) in laid.track.iter().zip(&on_track).zip(&overhangs_mm) {
                if let Some(outward) = outline.outward(*point).filter(|_| *mm > allowed_mm + OUTLINE_EXACT_MM) {
                    insets.keep_off(&surface.tangents(*at), outward, mm - allowed_mm);
                    beyond = true;
                }
            }
            if beyond {
                insets.settle();
                continue;
            }
        }
        let contact: Vec<bool> = laid.track.iter().map(|at| there(*at)).collect();
        let coverage = covered(&on_track, &contact);
        let short = coverage.iter().any(|grid| grid.share() < MIN_COVERAGE);
        if !(round < OUTLINE_ROUNDS && short && insets.give_way()) {
            break (laid, contact, overhangs_mm, coverage);
        }
    };
    let step_overs_mm =
        neighbours.iter().flat_map(|[line, next]| step_overs_mm(&on_surface(line), &on_surface(next))).collect();
    Ok(Piece { area, track, contact, spacing_mm, coverage, step_overs_mm, overhangs_mm })
}

/// The recipe's spacing, or less where a chord of it would leave the surface by more than the recipe allows: a chord of
/// length s over curvature κ lies κ s² / 8 off.
fn spacing_mm(surface: &BSplineSurface, patch: &Patch, settings: &recipe::Path) -> f64 {
    let mut bend: f64 = 0.0;
    for n in 0..=BEND_STEPS * BEND_STEPS {
        let share = |index: usize| index as f64 / BEND_STEPS as f64;
        let at = patch.at(Parameter { u: share(n % (BEND_STEPS + 1)).min(1.0), v: share(n / (BEND_STEPS + 1)) });
        if let Some(bends) = surface.principal_curvatures(&surface.derivatives(at)) {
            bend = bends.iter().fold(bend, |most, one| most.max(one.abs()));
        }
    }
    let chord_mm = if bend > 0.0 { (8.0 * settings.chord_error_mm() / bend).sqrt() } else { f64::INFINITY };
    settings.waypoint_spacing_mm().min(chord_mm)
}

fn with_evidence(paths: Vec<ToolPath>, pieces: &[Piece], settings: &recipe::Path) -> Plan {
    let all: Vec<&Waypoint> = paths.iter().flat_map(|path| &path.waypoints).collect();
    let point =
        |waypoint: &Waypoint| Point::<Panel>::at(waypoint.pose.x_mm, waypoint.pose.y_mm, waypoint.pose.z_mm);
    let (mut length_mm, mut contact_mm, mut duration_s) = (0.0, 0.0, 0.0);
    for pair in all.windows(2) {
        let step_mm = point(pair[0]).distance_mm(point(pair[1]));
        length_mm += step_mm;
        contact_mm += if pair[0].contact && pair[1].contact { step_mm } else { 0.0 };
        duration_s += step_mm / pair[1].feed_mm_s;
        // From or to a stop: half of feed / acceleration lost at either.
        let stops = [pair[0], pair[1]].iter().filter(|waypoint| waypoint.blend_mm == 0.0).count();
        duration_s += stops as f64 * pair[1].feed_mm_s / settings.acceleration_mm_s2() / 2.0;
    }
    let mut grids: Vec<GridCoverage> = pieces.iter().flat_map(|piece| piece.coverage.iter().copied()).collect();
    grids.sort_by_key(|grid| grid.id);
    let covered_mm2: f64 = grids.iter().map(|grid| grid.covered_mm2).sum();
    let area_mm2: f64 = grids.iter().map(|grid| grid.area_mm2).sum();
    let overhangs_mm = || pieces.iter().flat_map(|piece| piece.overhangs_mm.iter().copied());
    let beyond = overhangs_mm().filter(|mm| *mm > settings.edge_overhang_mm() + OUTLINE_EXACT_MM).count();
    let step_over = |all: Option<StepOver>, mm: f64| {
        let all = all.unwrap_or(StepOver { min_mm: mm, max_mm: mm });
        Some(StepOver { min_mm: all.min_mm.min(mm), max_mm: all.max_mm.max(mm) })
    };
    Plan {
        paths,
        length_mm,
        contact_mm,
        duration_s,
        coverage: covered_mm2 / area_mm2,
        grids,
        step_over_mm: pieces.iter().flat_map(|piece| piece.step_overs_mm.iter().copied()).fold(None, step_over),
        overhang: Overhang {
            largest_mm: overhangs_mm().fold(0.0, f64::max),
            share_beyond: beyond as f64 / overhangs_mm().count().max(1) as f64,
        },
    }
}
