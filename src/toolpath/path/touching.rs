//! The parts of the panel that a path touches: for each grid, the first waypoint at which the disc reaches the grid;
//! and the taught pixels that the disc may touch. The waypoints show which grids an interrupted path may have touched.

use super::planned::Plan;
use crate::surface::{BSplineSurface, Parameter, ParameterPatch};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use panelprep_base::geometry::{Mask, Panel, Pixel, Point, Vector};
use panelprep_cell::panel::{GridId, Region, TaughtPanel};
use panelprep_cell::recipe;
use rayon::prelude::*;

/// Number of sample points along each side of a grid, including its edges.
const SAMPLES_PER_SIDE: usize = 16;
/// Distance that is added to the disc's radius, mm: a point that the disc barely reaches is treated as reached.
const REACH_MARGIN_MM: f64 = 1.0;

/// Maximum distance of a point beyond the disc's edge at which the point is treated as touched, mm; the errors of the
/// panel's pose and of the tool's motion are smaller.
const TOUCH_MARGIN_MM: f64 = 1.5;
/// Maximum distance between the sampled points of the line between two waypoints, mm; a point is farther from the
/// nearest sampled point than from the line by at most half of this.
const MAX_SAMPLE_STEP_MM: f64 = 0.5;

/// Returns the taught pixels that the disc may touch on a plan's path, whatever part of the plan is executed. A pixel
/// of the panel without a scanned point is treated as touched if the plan touches the panel at all.
pub fn taught_pixels(plan: &Plan, panel: &TaughtPanel, settings: &recipe::Path) -> Mask {
    let all: Vec<_> = plan.paths.iter().flat_map(|path| &path.waypoints).collect();
    let mut way: Vec<[f64; 3]> = Vec::new();
    for (index, waypoint) in all.iter().enumerate().filter(|(_, waypoint)| waypoint.contact) {
        let to = waypoint.panel_from_tool.origin();
        let before = index.checked_sub(1).map(|before| all[before]).filter(|before| before.contact);
        let from = before.map_or(to, |before| before.panel_from_tool.origin());
        let steps = (from.distance_mm(to) / MAX_SAMPLE_STEP_MM).ceil().max(1.0);
        let points = (0..=steps as usize).map(|step| from + Vector::new((to - from).mm * (step as f64 / steps)));
        // The disc is checked along the line and not only at the waypoints: between two waypoints it passes over points
        // that it reaches at neither of them.
        way.extend(points.map(|point| <[f64; 3]>::from(point.mm)));
    }
    pixels_near(&way, settings.disc_diameter_mm() / 2.0 + TOUCH_MARGIN_MM + MAX_SAMPLE_STEP_MM / 2.0, panel)
}

/// Returns the taught pixels that a disc may have touched when it sanded these grids. The disc's centre stays on the
/// grid or at most a radius beside it, so its edge leaves the grid by at most its diameter.
pub fn touched_pixels(grids: &[GridId], panel: &TaughtPanel, settings: &recipe::Path) -> Mask {
    let Mask { width, height, .. } = panel.mask;
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let of_grids = pixels.filter(|&(column, row)| {
        let grid = panel.region.grid_at(Pixel::at(column as f64, row as f64));
        grid.is_some_and(|grid| grids.contains(&grid))
    });
    let points = of_grids.filter_map(|(column, row)| panel.scan.point(column, row));
    let points: Vec<[f64; 3]> = points.map(|point| point.mm.into()).collect();
    pixels_near(&points, settings.disc_diameter_mm() + TOUCH_MARGIN_MM, panel)
}

/// Returns the taught pixels within this distance of any of these points.
fn pixels_near(points: &[[f64; 3]], reach_mm: f64, panel: &TaughtPanel) -> Mask {
    let mut near = Mask { inside: vec![false; panel.mask.inside.len()], ..panel.mask };
    if points.is_empty() {
        return near;
    }
    // If the search tree cannot be built, every pixel of the panel is treated as near.
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(points) else { return panel.mask.clone() };
    near.inside.par_iter_mut().enumerate().filter(|(index, _)| panel.mask.inside[*index]).for_each(
        |(index, near)| {
            let point = panel.scan.point(index % panel.mask.width, index / panel.mask.width);
            *near = point.is_none_or(|point| {
                let found = tree.query(&point.mm.into()).nearest_one::<SquaredEuclidean<f64>>().execute();
                found.distance <= reach_mm * reach_mm
            });
        },
    );
    near
}

/// Returns for each planned grid the first waypoint at whose motion the disc reaches the grid; the plan's first
/// waypoint has the number 0. Grids that the path does not reach are omitted.
pub fn first_waypoints(
    plan: &Plan,
    surface: &BSplineSurface,
    region: &Region,
    radius_mm: f64,
) -> Vec<(GridId, usize)> {
    let all: Vec<_> = plan.paths.iter().flat_map(|path| &path.waypoints).collect();
    let place = |index: usize| all[index].panel_from_tool.origin();
    let near_mm = radius_mm + REACH_MARGIN_MM;
    let reaches = |index: usize, points: &[Point<Panel>]| {
        // If the tool comes from the air, it touches the panel only at the end of the motion.
        let from = if index > 0 && all[index - 1].contact { place(index - 1) } else { place(index) };
        all[index].contact && points.iter().any(|point| distance_mm(*point, from, place(index)) <= near_mm)
    };
    let first = |id: GridId| {
        let points = samples(surface, &ParameterPatch::for_grid(region, id)?);
        // The first waypoint is relevant, because the grid may be partly sanded if the path is interrupted after it.
        (0..all.len()).find(|index| reaches(*index, &points)).map(|index| (id, index))
    };
    plan.grids.iter().filter_map(|grid| first(grid.id)).collect()
}

fn samples(surface: &BSplineSurface, patch: &ParameterPatch) -> Vec<Point<Panel>> {
    let share = |index: usize| index as f64 / (SAMPLES_PER_SIDE - 1) as f64;
    let at = |index: usize| Parameter { u: share(index % SAMPLES_PER_SIDE), v: share(index / SAMPLES_PER_SIDE) };
    (0..SAMPLES_PER_SIDE * SAMPLES_PER_SIDE).map(|index| surface.point(patch.parameter_at(at(index)))).collect()
}

/// Returns the distance of a point from the segment between two points, mm.
fn distance_mm(point: Point<Panel>, from: Point<Panel>, to: Point<Panel>) -> f64 {
    let (way, off) = ((to - from).mm, (point - from).mm);
    let along = (off.dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (from + Vector::new(way * along)).distance_mm(point)
}
