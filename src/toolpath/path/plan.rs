//! Plans tool paths over chosen grids, with the results that are checked (thesis Fig. 4.29).
//!
//! Adjacent grids form one area, and each area has one path: through the air to a point above its lines, down, along
//! the lines in contact, and up. The areas are ordered so that the motions between them are short. Between areas the
//! tool moves through the air along the surface at the approach height, because a straight motion could pass through a
//! bulge. If the disc would reach too far beyond the panel's outline, the lines keep a larger distance from that side
//! of their area; the coverage then shows the part that is not reached. The feed is lower where the dwell time would be
//! too short (`dwell`). Poses are the tool's in the panel's frame. The result is in `planned`.
//!
//! The tool moves through the air to a point beside the first contact point and down to the landing height. Then it
//! moves along the surface to the first contact point while it descends the last millimetres, so that the disc is
//! already moving when it touches. The retraction is the same in reverse. The landing runs over the middle of the area,
//! so that no part outside of the area is touched. Over a hole the path continues at the landing height. In contact the
//! commanded tool point lies below the surface by the press-in, which the pad absorbs. In contact the feed is chosen
//! for a uniform dwell time; in the air it is the recipe's feed. The feed is lower if the controller could not plan
//! such short lines in time (`eki` 4.2). Corners are rounded by a fraction of the shorter adjacent line, and never by
//! more than half of this line. A path stops only at its ends, and on the panel if the tool lands vertically.

use super::areas::{Area, IsPanelAt, Piece, first_grid, make_piece, treated_areas, visit_order};
use super::coverage::{DiscOverhang, GridCoverage, Outline, reached_fraction, strokes};
use super::dwell::{UniformFeeds, compute_uniform_feeds};
use super::orientation::{OrientationError, ToolOrientation, panel_from_tool};
use super::planned::{PathExtent, Plan, PlanError, StepOver, ToolPath, Waypoint, extent};
use super::raster::{border_inset_mm, intermediate_points, interpolate};
use crate::surface::{BSplineSurface, HoleMap, Parameter, ParameterPatch, Treated};
use panelprep_base::geometry::{Panel, Point, Rigid, Tool};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;
use rayon::prelude::*;

/// Plans paths over these grids. `outline` is the panel's closed outline.
///
/// # Errors
/// If a grid is unknown or named twice, or the surface permits no rows or poses on a grid.
///
/// # Panics
/// If a number of the plan is not finite: this is a fault of the program, which a person at the cell cannot correct.
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
/// The errors of [`plan`].
///
/// # Panics
/// If a number of the plan is not finite.
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

/// Plans paths over these areas as [`plan_over_holes`] does, with lines that extend beyond the border of the treated
/// area by this length, mm. For a uniform removal up to the border, the disc must move beyond the border.
///
/// # Errors
/// The errors of [`plan`].
///
/// # Panics
/// If a number of the plan is not finite.
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
    let areas = treated_areas(region, treated, settings.join_grids());
    let areas = match beyond_mm > 0.0 {
        true => {
            // The border inset is added here because it is subtracted again when the lines are laid.
            areas.into_iter().map(|area| widen_area(surface, area, beyond_mm + border_inset_mm(settings))).collect()
        }
        false => areas,
    };
    let pieces: Vec<Result<Piece, PlanError>> =
        areas.into_par_iter().map(|area| make_piece(surface, region, area, (&outline, there), settings)).collect();
    let pieces: Vec<Piece> = pieces.into_iter().collect::<Result<_, _>>()?;
    // The pieces are ordered after their lines are laid, because the motion between two pieces depends on the ends of
    // their tracks.
    let pieces = order_pieces(surface, pieces);
    // The feeds of all pieces are calculated together, because the disc at the border of one piece also sands the
    // adjacent piece.
    let even = compute_uniform_feeds(surface, region, &pieces, settings);
    let mut before = None;
    let mut paths = Vec::with_capacity(pieces.len());
    for (piece, feeds_mm_s) in pieces.iter().zip(&even.feeds_mm_s) {
        let path = tool_path(surface, (piece, feeds_mm_s), before, settings)
            .map_err(|cause| PlanError::Orientation { grid: first_grid(&piece.area), cause })?;
        // The next path begins above the end of this path, so that the tool moves through the air between them.
        before = path.1;
        paths.push(path.0);
    }
    let breaks_reached = breaks_reached(surface, treated, &pieces, settings);
    let plan = Plan { breaks_reached, treated: treated.clone(), ..assemble_plan(paths, &pieces, even, settings) };
    assert!(plan.is_finite(), "the path over {:?} contains a number that is not finite", treated.grids());
    Ok(plan)
}

/// Returns the fraction of the break points that the disc reaches for any position of the point within its uncertainty,
/// 0…1; `None` without break points. This is checked in addition to the coverage, because the coverage permits a small
/// part of an area to be missed, and this part must not contain a break.
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
    reached_fraction(&broken, &all, surely_mm)
}

/// Returns the area with the patch of its lines enlarged by this length on each side, mm.
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

/// Returns the pieces in the order in which they are sanded, each with its direction.
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

fn assemble_plan(paths: Vec<ToolPath>, pieces: &[Piece], even: UniformFeeds, settings: &recipe::Path) -> Plan {
    let PathExtent { length_mm, contact_mm, duration_s } = extent(&paths, settings);
    let grids = sum_coverage_by_grid(pieces.iter().flat_map(|piece| piece.coverage.iter().copied()).collect());
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

/// Returns the coverage of each grid, row by row, as the sum of its parts, because a grid may contain parts of two
/// areas.
fn sum_coverage_by_grid(mut parts: Vec<GridCoverage>) -> Vec<GridCoverage> {
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

/// A point of the tool's path, with its height and feed.
#[derive(Clone, Copy)]
struct Station {
    at: Parameter,
    height_mm: f64,
    contact: bool,
    /// Maximum feed of the motion to this point, mm/s.
    feed_mm_s: f64,
}

/// Returns the path over the lines of one area, and its end. The path begins above the end of the previous path. Each
/// feed applies to the motion to one point of the track.
fn tool_path(
    surface: &BSplineSurface,
    (piece, feeds_mm_s): (&Piece, &[f64]),
    before: Option<Parameter>,
    settings: &recipe::Path,
) -> Result<(ToolPath, Option<Parameter>), OrientationError> {
    let grids = piece.area.grids.clone();
    let (Some(first), Some(last)) = (piece.track.first().copied(), piece.track.last().copied()) else {
        return Ok((ToolPath { grids, waypoints: Vec::new() }, before));
    };
    let (down, up) =
        (landing_point(surface, piece, first, settings), landing_point(surface, piece, last, settings));
    let lifted =
        |at: Parameter, height_mm: f64| Station { at, height_mm, contact: false, feed_mm_s: settings.feed_mm_s() };
    let air = |at: Parameter| lifted(at, settings.approach_mm());
    let low = |at: Parameter| lifted(at, settings.landing_height_mm());
    let on = |((at, contact), feed_mm_s): ((&Parameter, &bool), &f64)| match contact {
        true => Station { at: *at, height_mm: -settings.press_in_mm(), contact: true, feed_mm_s: *feed_mm_s },
        false => low(*at),
    };
    let mut stations: Vec<Station> = Vec::with_capacity(piece.track.len() + 8);
    let flown = before
        .into_iter()
        .flat_map(|from| intermediate_points(surface, from, down.unwrap_or(first), piece.spacing_mm));
    stations.extend(flown.map(air));
    // The first station is in the air, because the tool is started there.
    stations.push(air(down.unwrap_or(first)));
    stations.extend(down.map(low));
    stations.extend(piece.track.iter().zip(&piece.contact).zip(feeds_mm_s).map(on));
    stations.extend(up.map(low));
    stations.push(air(up.unwrap_or(last)));
    Ok((ToolPath { grids, waypoints: waypoints(surface, &stations, settings)? }, Some(up.unwrap_or(last))))
}

/// Returns the point at which the landing begins: at the landing's length from an end of the track, towards the middle
/// of the area. If the end lies in the middle, towards the farthest corner. `None` if the tool lands vertically.
fn landing_point(
    surface: &BSplineSurface,
    piece: &Piece,
    end: Parameter,
    settings: &recipe::Path,
) -> Option<Parameter> {
    let landing_mm = settings.landing_mm();
    let from = surface.point(end);
    let corners = [(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    let places = corners.map(|(u, v)| piece.area.patch.parameter_at(Parameter { u, v }));
    let away = |at: &Parameter| surface.point(*at).distance_mm(from);
    let middle = places.first().filter(|middle| away(middle) >= landing_mm);
    let farthest = || places.iter().max_by(|a, b| away(a).total_cmp(&away(b)));
    let target = *middle.or_else(farthest)?;
    let share = (landing_mm / away(&target).max(1e-9)).min(1.0);
    (landing_mm > 0.0).then(|| interpolate(end, target, share))
}

fn waypoints(
    surface: &BSplineSurface,
    stations: &[Station],
    settings: &recipe::Path,
) -> Result<Vec<Waypoint>, OrientationError> {
    let stance = ToolOrientation::from_settings(settings);
    let pose = |station: &Station| panel_from_tool(surface, station.at, station.height_mm, stance);
    let poses = stations.iter().map(pose).collect::<Result<Vec<Rigid<Panel, Tool>>, _>>()?;
    let lengths_mm: Vec<f64> =
        poses.windows(2).map(|pair| pair[0].origin().distance_mm(pair[1].origin())).collect();
    let planning_s = settings.planning_time_ms() / 1_000.0;
    let waypoint = |(index, station): (usize, &Station)| {
        let before_mm = index.checked_sub(1).and_then(|before| lengths_mm.get(before)).copied();
        let after_mm = lengths_mm.get(index).copied();
        // The controller plans one line at a time. If a line took less time than its planning, the tool would stop on
        // the panel.
        let feed_mm_s = before_mm.map_or(station.feed_mm_s, |mm| station.feed_mm_s.min(mm / planning_s));
        let touches_down = |other: Option<&Station>| other.is_some_and(|other| other.contact != station.contact);
        // If the tool lands vertically, the corner at the panel is not rounded: with a rounding the pad would touch too
        // early, during a sideways motion.
        let straight_down = settings.landing_mm() == 0.0
            && station.contact
            && (touches_down(index.checked_sub(1).and_then(|n| stations.get(n)))
                || touches_down(stations.get(index + 1)));
        let blend_mm = match (before_mm, after_mm) {
            (Some(before), Some(after)) if !straight_down => settings.blend_share() * before.min(after),
            _ => 0.0,
        };
        Waypoint { panel_from_tool: poses[index], contact: station.contact, feed_mm_s, blend_mm }
    };
    Ok(stations.iter().enumerate().map(waypoint).collect())
}
