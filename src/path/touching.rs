//! From which waypoint on the disc reaches each grid: what bounds where a path that was cut short may have been.

use super::planned::Plan;
use crate::geometry::{Panel, Point, Vector};
use crate::panel::{GridId, Region};
use crate::surface::{BSplineSurface, Parameter, Patch};

/// Samples along each side of a grid, its edges among them.
const SAMPLES: usize = 16;
/// The disc is taken this much larger: what it barely reaches counts as reached, mm.
const MARGIN_MM: f64 = 1.0;

/// Each planned grid with the first waypoint on whose way the disc reaches it, counted from the plan's first, which is
/// 0. A grid that the path does not reach is left out.
pub fn first_reached(
    plan: &Plan,
    surface: &BSplineSurface,
    region: &Region,
    radius_mm: f64,
) -> Vec<(GridId, usize)> {
    let all: Vec<_> = plan.paths.iter().flat_map(|path| &path.waypoints).collect();
    let place = |index: usize| all[index].panel_from_tool.origin();
    let near_mm = radius_mm + MARGIN_MM;
    let reaches = |index: usize, points: &[Point<Panel>]| {
        // From the air it comes down on its waypoint alone.
        let from = if index > 0 && all[index - 1].contact { place(index - 1) } else { place(index) };
        all[index].contact && points.iter().any(|point| distance_mm(*point, from, place(index)) <= near_mm)
    };
    let first = |id: GridId| {
        let points = samples(surface, &Patch::of_grid(region, id)?);
        (0..all.len()).find(|index| reaches(*index, &points)).map(|index| (id, index))
    };
    plan.grids.iter().filter_map(|grid| first(grid.id)).collect()
}

fn samples(surface: &BSplineSurface, patch: &Patch) -> Vec<Point<Panel>> {
    let share = |index: usize| index as f64 / (SAMPLES - 1) as f64;
    let at = |index: usize| Parameter { u: share(index % SAMPLES), v: share(index / SAMPLES) };
    (0..SAMPLES * SAMPLES).map(|index| surface.point(patch.at(at(index)))).collect()
}

/// Distance of a point from the line between two others, mm.
fn distance_mm(point: Point<Panel>, from: Point<Panel>, to: Point<Panel>) -> f64 {
    let (way, off) = ((to - from).mm, (point - from).mm);
    let along = (off.dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (from + Vector::new(way * along)).distance_mm(point)
}
