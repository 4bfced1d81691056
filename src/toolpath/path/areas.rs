//! Combines grids that are sanded together into areas, orders the areas, and lays the lines of each area.
//!
//! Adjacent grids in one row become a strip; strips of the same columns in adjacent rows become a rectangle. A
//! rectangle is one patch of the surface, with one path. An L-shape becomes two rectangles. The order keeps the path
//! through the air short. For each possible first area, the area with the nearest end always comes next; then parts of
//! the order are reversed as long as this shortens the path. An area may be sanded from either end.
//!
//! The lines of an area are laid again until the disc stays inside of the outline and reaches the whole area, and no
//! two adjacent lines are farther apart than the recipe's step-over.

use super::coverage::{GridCoverage, MIN_COVERAGE, Outline, coverage, step_overs_mm, strokes};
use super::lines::{Lines, lines};
use super::planned::PlanError;
use super::raster::Insets;
use crate::surface::{BSplineSurface, Parameter, ParameterPatch, Treated};
use panelprep_base::geometry::{Panel, Point};
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;

/// Maximum number of times that the lines of an area are laid again because the disc reaches too far beyond the
/// outline, or because lines are too far apart.
const MAX_LAYING_ROUNDS: usize = 16;
/// Distance by which lines are moved inwards in addition to the disc's overhang beyond its limit, mm. The overhang that
/// remains after a round must be less than this.
const ADDITIONAL_INSET_MM: f64 = 0.01;
/// Additional factor on the calculated distance between lines if they are too far apart.
const SPACING_REDUCTION: f64 = 0.999;
/// Number of points along each side of a patch at which its curvature is evaluated.
const CURVATURE_STEPS_PER_SIDE: usize = 6;
/// Length of the motion over a patch that the disc covers from one point, in disc radii. The disc moves, so that it
/// does not land and lift off at the same point.
const SHORT_MOTION_RADII: f64 = 0.5;
/// Maximum number of times that the length of this motion is halved because the disc would reach too far beyond the
/// outline.
const MAX_SHORT_MOTION_HALVINGS: usize = 3;

/// A patch of the surface that is sanded with one path.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Area {
    /// The grids that the area covers completely or in part.
    pub grids: Vec<GridId>,
    /// The patch on which the lines are laid.
    pub patch: ParameterPatch,
    /// The patch that is treated; the lines may extend beyond this patch.
    pub treated: ParameterPatch,
}

impl Area {
    /// Returns for each of the area's grids the part that is treated.
    pub fn parts(&self, region: &Region) -> Vec<(GridId, ParameterPatch)> {
        self.grids.iter().filter_map(|id| Some((*id, self.treated.part_in(region, *id)?))).collect()
    }
}

/// Returns the areas that are treated. Areas around breaks are returned unchanged; whole grids are combined into
/// rectangles.
pub(super) fn treated_areas(region: &Region, treated: &Treated, join: bool) -> Vec<Area> {
    let Some(patches) = treated.areas() else { return areas(region, treated.grids(), join) };
    let area = |patch: &ParameterPatch| {
        let grids = treated.grids().iter().copied().filter(|id| patch.part_in(region, *id).is_some());
        Area { grids: grids.collect(), patch: *patch, treated: *patch }
    };
    patches.iter().map(area).collect()
}

/// Combines grids of the region into rectangles. Without `join`, each grid is its own rectangle.
pub(super) fn areas(region: &Region, grids: &[GridId], join: bool) -> Vec<Area> {
    let area = |[rows, columns]: [[usize; 2]; 2]| {
        let grids: Vec<GridId> = (rows[0]..=rows[1])
            .flat_map(|row| (columns[0]..=columns[1]).map(move |column| GridId { row, column }))
            .collect();
        let low = region.grid_bounds(GridId { row: rows[0], column: columns[0] })[0];
        let high = region.grid_bounds(GridId { row: rows[1], column: columns[1] })[1];
        let place = |at: nalgebra::Point2<f64>| Parameter { u: at.x, v: at.y };
        let patch = ParameterPatch { low: place(low), high: place(high) };
        Area { grids, patch, treated: patch }
    };
    if !join {
        return grids.iter().map(|id| area([[id.row; 2], [id.column; 2]])).collect();
    }
    let mut sorted = grids.to_vec();
    sorted.sort();
    let mut strips: Vec<[[usize; 2]; 2]> = Vec::new();
    for id in sorted {
        match strips.last_mut() {
            Some([rows, columns]) if rows[0] == id.row && columns[1] + 1 == id.column => columns[1] = id.column,
            _ => strips.push([[id.row; 2], [id.column; 2]]),
        }
    }
    let mut rectangles: Vec<[[usize; 2]; 2]> = Vec::new();
    for [rows, columns] in strips {
        let above = rectangles.iter_mut().find(|[r, c]| *c == columns && r[1] + 1 == rows[0]);
        match above {
            Some([r, _]) => r[1] = rows[1],
            None => rectangles.push([rows, columns]),
        }
    }
    rectangles.into_iter().map(area).collect()
}

/// Returns the order in which pieces with these two ends are sanded, and for each piece whether it begins at its second
/// end.
pub(super) fn visit_order(ends: &[[Point<Panel>; 2]]) -> Vec<(usize, bool)> {
    let best = (0..ends.len())
        .flat_map(|start| [false, true].map(|turned| nearest_neighbour_order(ends, (start, turned))))
        .min_by(|a, b| travel_length_mm(ends, a).total_cmp(&travel_length_mm(ends, b)));
    let mut order = best.unwrap_or_default();
    while let Some(shorter) = shorten_order(ends, &order) {
        order = shorter;
    }
    order
}

fn exit_point(ends: &[[Point<Panel>; 2]], (piece, turned): (usize, bool)) -> Point<Panel> {
    ends[piece][usize::from(!turned)]
}

fn entry_point(ends: &[[Point<Panel>; 2]], (piece, turned): (usize, bool)) -> Point<Panel> {
    ends[piece][usize::from(turned)]
}

fn travel_length_mm(ends: &[[Point<Panel>; 2]], order: &[(usize, bool)]) -> f64 {
    order.windows(2).map(|pair| exit_point(ends, pair[0]).distance_mm(entry_point(ends, pair[1]))).sum()
}

fn nearest_neighbour_order(ends: &[[Point<Panel>; 2]], start: (usize, bool)) -> Vec<(usize, bool)> {
    let mut order = vec![start];
    let mut left: Vec<usize> = (0..ends.len()).filter(|piece| *piece != start.0).collect();
    while let Some(last) = order.last().copied().filter(|_| !left.is_empty()) {
        let from = exit_point(ends, last);
        let away = |next: &(usize, bool)| from.distance_mm(entry_point(ends, *next));
        let choices = left.iter().flat_map(|piece| [(*piece, false), (*piece, true)]);
        let Some(next) = choices.min_by(|a, b| away(a).total_cmp(&away(b))) else { break };
        left.retain(|piece| *piece != next.0);
        order.push(next);
    }
    order
}

/// Returns the order with one part reversed if this makes the path shorter.
fn shorten_order(ends: &[[Point<Panel>; 2]], order: &[(usize, bool)]) -> Option<Vec<(usize, bool)>> {
    let now_mm = travel_length_mm(ends, order);
    for from in 0..order.len() {
        for to in from..order.len() {
            let mut turned = order.to_vec();
            turned[from..=to].reverse();
            turned[from..=to].iter_mut().for_each(|(_, turned)| *turned = !*turned);
            if travel_length_mm(ends, &turned) < now_mm - 1e-6 {
                return Some(turned);
            }
        }
    }
    None
}

/// A function that returns whether there is panel material at a point.
pub(super) type IsPanelAt<'a> = &'a (dyn Fn(Parameter) -> bool + Sync);

/// The lines of one area, with their coverage, distances and overhangs, before the areas are joined to a path.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub area: Area,
    pub track: Vec<Parameter>,
    /// Whether each point of the track has panel material below it.
    pub contact: Vec<bool>,
    pub spacing_mm: f64,
    pub coverage: Vec<GridCoverage>,
    pub step_overs_mm: Vec<f64>,
    pub overhangs_mm: Vec<f64>,
}

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
            track = plan_short_motion(surface, only, (outline, settings));
        }
        let on_track = on_surface(&track);
        let overhangs_mm: Vec<f64> =
            on_track.iter().map(|contact| outline.overhang_mm(*contact, radius_mm)).collect();
        round += 1;
        if round < MAX_LAYING_ROUNDS && outline.is_present() {
            let allowed_mm = settings.edge_overhang_mm();
            let mut beyond = false;
            for ((at, point), mm) in track.iter().zip(&on_track).zip(&overhangs_mm) {
                if let Some(outward) = outline.outward_direction(*point).filter(|_| *mm > allowed_mm) {
                    insets.require_distance(&surface.tangents(*at), outward, mm - allowed_mm + ADDITIONAL_INSET_MM);
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
        if round < MAX_LAYING_ROUNDS && widest_mm > settings.step_over_mm() {
            step_over_mm *= SPACING_REDUCTION * settings.step_over_mm() / widest_mm;
            continue;
        }
        let contact: Vec<bool> = track.iter().map(|at| there(*at)).collect();
        let coverage = covered(&on_track, &contact);
        let short = coverage.iter().any(|grid| grid.covered_fraction() < MIN_COVERAGE);
        if !(round < MAX_LAYING_ROUNDS && short && insets.release_sides()) {
            return Ok(Piece { area, track, contact, spacing_mm, coverage, step_overs_mm, overhangs_mm });
        }
    }
}

/// Returns a short motion over one point, along u or v: the direction in which less of the disc leaves the panel.
fn plan_short_motion(
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
    let mut best = ends(SHORT_MOTION_RADII * radius_mm / 2.0, true);
    for half in 0..=MAX_SHORT_MOTION_HALVINGS {
        let half_mm = SHORT_MOTION_RADII * radius_mm / 2.0 / f64::powi(2.0, half as i32);
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

/// Returns the recipe's distance between waypoints, or less if a chord of this length would deviate from the surface by
/// more than the recipe's limit. A chord of length s deviates from a curvature κ by κ s² / 8.
fn spacing_mm(surface: &BSplineSurface, patch: &ParameterPatch, settings: &recipe::Path) -> f64 {
    let mut bend: f64 = 0.0;
    for n in 0..=CURVATURE_STEPS_PER_SIDE * CURVATURE_STEPS_PER_SIDE {
        let share = |index: usize| index as f64 / CURVATURE_STEPS_PER_SIDE as f64;
        let at = patch.parameter_at(Parameter {
            u: share(n % (CURVATURE_STEPS_PER_SIDE + 1)).min(1.0),
            v: share(n / (CURVATURE_STEPS_PER_SIDE + 1)),
        });
        if let Some(bends) = surface.principal_curvatures(&surface.derivatives(at)) {
            bend = bends.iter().fold(bend, |most, one| most.max(one.abs()));
        }
    }
    let chord_mm = if bend > 0.0 { (8.0 * settings.chord_error_mm() / bend).sqrt() } else { f64::INFINITY };
    settings.waypoint_spacing_mm().min(chord_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::recipe::Recipe;

    fn region() -> Region {
        let text = "panel = \"p\"\nregion = { corners_px = [[0, 0], [500, 0], [500, 300], [0, 300]], rows = 3, \
                    columns = 5 }\nlocate.box_min_mm = [0, 0, 0]\nlocate.box_max_mm = [1, 1, 1]\n";
        Region::new(Recipe::check("f", text).unwrap_or_else(|e| panic!("{e}")).region()).expect("convex")
    }

    fn joined_grid_names(names: &[&str]) -> Vec<String> {
        let grids: Vec<GridId> = names.iter().map(|name| name.parse().expect("a grid")).collect();
        let words = |area: &Area| area.grids.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        areas(&region(), &grids, true).iter().map(words).collect()
    }

    #[test]
    fn a_block_is_one_area_and_an_l_is_two() {
        assert_eq!(joined_grid_names(&["r2c3", "r1c2", "r1c3", "r2c2"]), ["r1c2 r1c3 r2c2 r2c3"]);
        assert_eq!(joined_grid_names(&["r1c1", "r2c1", "r2c2", "r3c5"]), ["r1c1", "r2c1 r2c2", "r3c5"]);
        let block = areas(&region(), &[GridId { row: 2, column: 3 }, GridId { row: 2, column: 4 }], true);
        let (low, high) = (block[0].patch.low, block[0].patch.high);
        assert!((low.u - 0.4).abs() < 1e-12 && (high.u - 0.8).abs() < 1e-12 && (high.v - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(areas(&region(), &block[0].grids, false).len(), 2);
    }

    /// Expected value, calculated by hand: pieces from 0 to 10, 50 to 60 and 20 to 30 on a line are sanded from left to
    /// right or from right to left, with 10 + 20 mm between them.
    #[test]
    fn the_path_through_the_air_is_short() {
        let ends =
            [[0.0, 10.0], [60.0, 50.0], [20.0, 30.0]].map(|pair: [f64; 2]| pair.map(|x| Point::at(x, 0.0, 0.0)));
        let order = visit_order(&ends);
        assert!((travel_length_mm(&ends, &order) - 30.0).abs() < 1e-9, "{order:?}");
        assert_eq!(super::visit_order(&[]), []);
    }
}
