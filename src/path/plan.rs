//! Tool paths over chosen grids, with the evidence that the gate judges (thesis Fig. 4.29).
//!
//! Each grid has one path: in the air to a point above its raster, down along the normal, along the raster in
//! contact, up along the normal. Between grids the tool flies over the surface at the height of its approach: a
//! straight way could cut through a bulge. Poses are the tool's in the panel's frame.

use super::coverage::{GridCoverage, coverage, step_overs_mm};
use super::edge::{Outline, Overhang};
use super::orientation::{OrientationError, Reference, panel_from_tool};
use super::raster::{RasterError, between, raster};
use crate::geometry::{KukaPose, Panel, Point};
use crate::panel::{GridId, Region};
use crate::recipe;
use crate::surface::{BSplineSurface, Parameter, Patch};
use rayon::prelude::*;

/// One pose to move to in a straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// The tool in the panel's frame.
    pub pose: KukaPose,
    /// Is the disc on the panel here? A move is one in contact where both its ends are.
    pub contact: bool,
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
    /// One path for each grid, in the order asked for.
    pub paths: Vec<ToolPath>,
    /// Length of all moves, mm.
    pub length_mm: f64,
    /// Time for them at the recipe's feed, s, without starting and stopping.
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

/// One grid's share of the work, before paths are joined.
struct Piece {
    id: GridId,
    track: Vec<Parameter>,
    coverage: GridCoverage,
    step_overs_mm: Vec<f64>,
    overhangs_mm: Vec<f64>,
}

/// Paths over these grids, one each, in this order. `outline` is the panel's, closed.
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
    let patches = patches(region, grids)?;
    let outline = Outline::new(outline);
    let pieces: Vec<Result<Piece, PlanError>> =
        patches.par_iter().map(|(id, patch)| piece(surface, (*id, patch), &outline, settings)).collect();
    let pieces: Vec<Piece> = pieces.into_iter().collect::<Result<_, _>>()?;
    let mut before = None;
    let mut paths = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let path = tool_path(surface, piece, before, settings)
            .map_err(|cause| PlanError::Orientation { grid: piece.id, cause })?;
        before = piece.track.last().copied();
        paths.push(path);
    }
    Ok(with_evidence(paths, &pieces, settings))
}

fn patches(region: &Region, grids: &[GridId]) -> Result<Vec<(GridId, Patch)>, PlanError> {
    if grids.is_empty() {
        return Err(PlanError::NoGrids);
    }
    let patch = |(index, id): (usize, &GridId)| {
        if grids[..index].contains(id) {
            return Err(PlanError::Repeated { grid: *id });
        }
        let unknown = PlanError::UnknownGrid { grid: *id, rows: region.rows, columns: region.columns };
        Ok((*id, Patch::of_grid(region, *id).ok_or(unknown)?))
    };
    grids.iter().enumerate().map(patch).collect()
}

fn piece(
    surface: &BSplineSurface,
    (id, patch): (GridId, &Patch),
    outline: &Outline,
    settings: &recipe::Path,
) -> Result<Piece, PlanError> {
    let raster = raster(surface, patch, settings).map_err(|cause| PlanError::Raster { grid: id, cause })?;
    let track = raster.track(surface, settings.waypoint_spacing_mm());
    let on_surface = |places: &[Parameter]| places.iter().map(|at| surface.point(*at)).collect::<Vec<_>>();
    let rows: Vec<Vec<Point<Panel>>> = raster.rows.iter().map(|row| on_surface(row)).collect();
    let radius_mm = settings.disc_diameter_mm() / 2.0;
    let on_track = on_surface(&track);
    Ok(Piece {
        id,
        coverage: coverage(surface, (id, patch), &on_track, radius_mm),
        step_overs_mm: rows.windows(2).flat_map(|pair| step_overs_mm(&pair[0], &pair[1])).collect(),
        overhangs_mm: on_track.iter().map(|contact| outline.overhang_mm(*contact, radius_mm)).collect(),
        track,
    })
}

fn tool_path(
    surface: &BSplineSurface,
    piece: &Piece,
    before: Option<Parameter>,
    settings: &recipe::Path,
) -> Result<ToolPath, OrientationError> {
    let (reference, approach_mm) = (Reference::of(settings), settings.approach_mm());
    let (Some(first), Some(last)) = (piece.track.first().copied(), piece.track.last().copied()) else {
        return Ok(ToolPath { grids: vec![piece.id], waypoints: Vec::new() });
    };
    let flown: Vec<Parameter> =
        before.into_iter().flat_map(|from| between(surface, from, first, settings.waypoint_spacing_mm())).collect();
    let air = |at: Parameter| (at, approach_mm);
    let stations = flown
        .into_iter()
        .map(air)
        .chain([air(first)])
        .chain(piece.track.iter().map(|at| (*at, 0.0)))
        .chain([air(last)]);
    let waypoint = |(at, height_mm): (Parameter, f64)| {
        let panel_from_tool = panel_from_tool(surface, at, height_mm, reference)?;
        Ok(Waypoint { pose: KukaPose::from_rigid(&panel_from_tool), contact: height_mm == 0.0 })
    };
    Ok(ToolPath { grids: vec![piece.id], waypoints: stations.map(waypoint).collect::<Result<_, _>>()? })
}

fn with_evidence(paths: Vec<ToolPath>, pieces: &[Piece], settings: &recipe::Path) -> Plan {
    let points: Vec<Point<Panel>> = paths
        .iter()
        .flat_map(|path| &path.waypoints)
        .map(|waypoint| Point::at(waypoint.pose.x_mm, waypoint.pose.y_mm, waypoint.pose.z_mm))
        .collect();
    let length_mm: f64 = points.windows(2).map(|pair| pair[0].distance_mm(pair[1])).sum();
    let grids: Vec<GridCoverage> = pieces.iter().map(|piece| piece.coverage).collect();
    let covered_mm2: f64 = grids.iter().map(|grid| grid.covered_mm2).sum();
    let area_mm2: f64 = grids.iter().map(|grid| grid.area_mm2).sum();
    let overhangs_mm = || pieces.iter().flat_map(|piece| piece.overhangs_mm.iter().copied());
    let beyond = overhangs_mm().filter(|mm| *mm > settings.edge_overhang_mm()).count();
    let step_over = |all: Option<StepOver>, mm: f64| {
        let all = all.unwrap_or(StepOver { min_mm: mm, max_mm: mm });
        Some(StepOver { min_mm: all.min_mm.min(mm), max_mm: all.max_mm.max(mm) })
    };
    Plan {
        paths,
        length_mm,
        duration_s: length_mm / settings.feed_mm_s(),
        coverage: covered_mm2 / area_mm2,
        grids,
        step_over_mm: pieces.iter().flat_map(|piece| piece.step_overs_mm.iter().copied()).fold(None, step_over),
        overhang: Overhang {
            largest_mm: overhangs_mm().fold(0.0, f64::max),
            share_beyond: beyond as f64 / overhangs_mm().count().max(1) as f64,
        },
    }
}
