//! Tool paths over chosen grids, with the evidence that the gate judges (thesis Fig. 4.29).
//!
//! Neighbouring grids are one area, and each area has one path (`contact`): through the air to a place above its
//! lines, down, along the lines in contact, up. The areas are ordered so that the path between them is short. Between
//! areas the tool moves through the air along the surface at the approach height: a straight motion could cut through
//! a bulge. If the disc would reach too far beyond the panel's outline, lines keep more distance from that side of
//! their area; the coverage shows the part that is then not reached. The feed is lower at places that would be under
//! the disc for less time (`evenness`). Poses are the tool's in the panel's frame. The result is in `planned`.

use super::areas::{Area, areas_of, visit_order};
use super::contact::tool_path;
use super::coverage::{GridCoverage, reached_share, strokes};
use super::edge::{DiscOverhang, Outline};
use super::evenness::{EvenFeeds, even_out_feeds};
use super::piece::{IsPanelAt, Piece, first_grid, make_piece};
use super::planned::{PathExtent, Plan, PlanError, StepOver, ToolPath, extent};
use super::raster::border_inset_mm;
use crate::surface::{BSplineSurface, HoleMap, Parameter, ParameterPatch, Treated};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;
use rayon::prelude::*;

/// Plans paths over these grids. `outline` is the panel's, closed.
///
/// # Errors
/// If a grid is unknown or named twice, or the surface allows no rows or poses there.
///
/// # Panics
/// If a number of the plan is not finite: that is a fault of this program, and a person at the cell cannot correct
/// it.
pub fn plan(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    outline: &[Point<Panel>],
    settings: &recipe::Path,
) -> Result<Plan, PlanError> {
    plan_paths(surface, region, &Treated::from_grids(grids), (outline, &|_| true), (settings, 0.0))
}

/// Plans paths as [`plan`] does, with the tool lifted over holes of the panel.
///
/// # Errors
/// As [`plan`].
///
/// # Panics
/// As [`plan`].
pub fn plan_over_holes(
    surface: &BSplineSurface,
    region: &Region,
    grids: &[GridId],
    (outline, holes): (&[Point<Panel>], &HoleMap),
    settings: &recipe::Path,
) -> Result<Plan, PlanError> {
    let treated = Treated::from_grids(grids);
    plan_paths(surface, region, &treated, (outline, &|at| !holes.is_hole(at)), (settings, 0.0))
}

/// Plans paths over these places as [`plan_over_holes`] does, with the lines laid this far beyond the border of the
/// treated area, mm: for an even removal up to the border, the disc must move beyond it.
///
/// # Errors
/// As [`plan`].
///
/// # Panics
/// As [`plan`].
pub fn plan_beyond_borders(
    surface: &BSplineSurface,
    region: &Region,
    treated: &Treated,
    (outline, holes): (&[Point<Panel>], &HoleMap),
    (settings, beyond_mm): (&recipe::Path, f64),
) -> Result<Plan, PlanError> {
    plan_paths(surface, region, treated, (outline, &|at| !holes.is_hole(at)), (settings, beyond_mm))
}

fn plan_paths(
    surface: &BSplineSurface,
    region: &Region,
    treated: &Treated,
    (outline, there): (&[Point<Panel>], IsPanelAt<'_>),
    (settings, beyond_mm): (&recipe::Path, f64),
) -> Result<Plan, PlanError> {
    refuse_unknown(region, treated.grids())?;
    let outline = Outline::new(outline);
    let areas = areas_of(region, treated, settings.join_grids());
    let areas = match beyond_mm > 0.0 {
        true => {
            // The inset at the border, which comes later, takes its part back.
            areas.into_iter().map(|area| widen_area(surface, area, beyond_mm + border_inset_mm(settings))).collect()
        }
        false => areas,
    };
    let pieces: Vec<Result<Piece, PlanError>> =
        areas.into_par_iter().map(|area| make_piece(surface, region, area, (&outline, there), settings)).collect();
    let pieces: Vec<Piece> = pieces.into_iter().collect::<Result<_, _>>()?;
    // Ordered after they are laid: the way between two pieces depends on where their tracks begin and end.
    let pieces = order_pieces(surface, pieces);
    // Over all pieces together, because the disc at the border of one also treats its neighbour.
    let even = even_out_feeds(surface, region, &pieces, settings);
    let mut before = None;
    let mut paths = Vec::with_capacity(pieces.len());
    for (piece, feeds_mm_s) in pieces.iter().zip(&even.feeds_mm_s) {
        let path = tool_path(surface, (piece, feeds_mm_s), before, settings)
            .map_err(|cause| PlanError::Orientation { grid: first_grid(&piece.area), cause })?;
        // The next path begins above the end of this one, so that the tool crosses the gap in air.
        before = path.1;
        paths.push(path.0);
    }
    let breaks_reached = breaks_reached(surface, treated, &pieces, settings);
    let plan = Plan { breaks_reached, treated: treated.clone(), ..assemble_plan(paths, &pieces, even, settings) };
    assert!(plan.is_finite(), "a number of the path over {:?} is not finite", treated.grids());
    Ok(plan)
}

/// Returns the fraction of the broken places that the disc reaches if they lie anywhere within their uncertainty, 0…1;
/// `None` if no place is known. The coverage of an area allows a part of it to be missed, and this part must not be the
/// break.
fn breaks_reached(
    surface: &BSplineSurface,
    treated: &Treated,
    pieces: &[Piece],
    settings: &recipe::Path,
) -> Option<f64> {
    let broken: Vec<Point<Panel>> = treated.broken()?.iter().map(|at| surface.point(*at)).collect();
    let of_piece = |piece: &Piece| {
        let track: Vec<Point<Panel>> = piece.track.iter().map(|at| surface.point(*at)).collect();
        strokes(&track, |index| piece.contact[index])
    };
    let all: Vec<_> = pieces.iter().flat_map(of_piece).collect();
    let surely_mm = (settings.disc_diameter_mm() / 2.0 - treated.uncertainty_mm()).max(0.0);
    reached_share(&broken, &all, surely_mm)
}

/// Returns an area that is larger by this length on each side, mm, for laying its lines.
fn widen_area(surface: &BSplineSurface, area: Area, by_mm: f64) -> Area {
    let middle = surface.tangents(area.patch.parameter_at(Parameter { u: 0.5, v: 0.5 }));
    let (by_u, by_v) = (by_mm / middle.s_u.mm.norm(), by_mm / middle.s_v.mm.norm());
    let ParameterPatch { low, high } = area.patch;
    let low = Parameter { u: low.u - by_u, v: low.v - by_v };
    let high = Parameter { u: high.u + by_u, v: high.v + by_v };
    Area { patch: ParameterPatch { low, high }, ..area }
}

fn refuse_unknown(region: &Region, grids: &[GridId]) -> Result<(), PlanError> {
    if grids.is_empty() {
        return Err(PlanError::NoGrids);
    }
    for (index, id) in grids.iter().enumerate() {
        if grids[..index].contains(id) {
            return Err(PlanError::Repeated { grid: *id });
        }
        if ParameterPatch::for_grid(region, *id).is_none() {
            return Err(PlanError::UnknownGrid { grid: *id, rows: region.rows, columns: region.columns });
        }
    }
    Ok(())
}

/// Returns the pieces in the order of travel, each in its direction.
fn order_pieces(surface: &BSplineSurface, pieces: Vec<Piece>) -> Vec<Piece> {
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
    visit_order(&ends).into_iter().map(turned).collect()
}

fn assemble_plan(paths: Vec<ToolPath>, pieces: &[Piece], even: EvenFeeds, settings: &recipe::Path) -> Plan {
    let PathExtent { length_mm, contact_mm, duration_s } = extent(&paths, settings);
    let grids = of_grids(pieces.iter().flat_map(|piece| piece.coverage.iter().copied()).collect());
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
        contact_mm,
        duration_s,
        coverage: covered_mm2 / area_mm2,
        grids,
        dwell: even.all,
        grid_dwell: even.grids,
        step_over_mm: pieces.iter().flat_map(|piece| piece.step_overs_mm.iter().copied()).fold(None, step_over),
        treated: Treated::default(),
        breaks_reached: None,
        costs: None,
        overhang: DiscOverhang {
            largest_mm: overhangs_mm().fold(0.0, f64::max),
            share_beyond: beyond as f64 / overhangs_mm().count().max(1) as f64,
        },
    }
}

/// Returns the coverage of each grid from that of its parts, row by row: two areas may lie in one grid.
fn of_grids(mut parts: Vec<GridCoverage>) -> Vec<GridCoverage> {
    parts.sort_by_key(|part| part.id);
    let sum = |parts: &[GridCoverage]| {
        let add = |all: GridCoverage, part: &GridCoverage| GridCoverage {
            area_mm2: all.area_mm2 + part.area_mm2,
            covered_mm2: all.covered_mm2 + part.covered_mm2,
            ..all
        };
        parts[1..].iter().fold(parts[0], add)
    };
    parts.chunk_by(|a, b| a.id == b.id).map(sum).collect()
}
