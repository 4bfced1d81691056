//! Tests of rasters, poses and plans, on surfaces whose results can be calculated by hand and on fitted surfaces.

mod breaks;
mod plans;
mod rows;

use super::*;
use crate::surface::scene::{self, SHAPES, ScanDefects, Shape, taught};
use crate::surface::{BSplineSurface, Fit, KnotVector, Parameter, ParameterPatch, fit};
use nalgebra::Vector3;
use panelprep_base::geometry::{Degrees, KukaPose, Panel, Point, Rigid, Tool};
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::{GridId, Region};
use panelprep_cell::recipe;

const WHOLE: ParameterPatch =
    ParameterPatch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 1.0, v: 1.0 } };

/// Returns the bilinear surface between four corners in the plane z = 0, from the first to the second corner along u,
/// seen from +z.
fn quad(corners_mm: [[f64; 2]; 4]) -> BSplineSurface {
    let knots = || KnotVector::uniform(1, 1, 0.0..=1.0).expect("open");
    let [a, b, c, d] = corners_mm.map(|[x, y]| Point::at(x, y, 0.0));
    BSplineSurface::new([knots(), knots()], vec![a, d, b, c], Point::at(0.0, 0.0, 500.0)).expect("a surface")
}

fn rectangle(width_mm: f64, height_mm: f64) -> BSplineSurface {
    quad([[0.0, 0.0], [width_mm, 0.0], [width_mm, height_mm], [0.0, height_mm]])
}

fn settings(more: &str) -> recipe::Path {
    scene::recipe(Shape::Plane, &format!("[path]\n{more}\n")).path().clone()
}

fn region() -> Region {
    Region::new(scene::recipe(Shape::Plane, "").region()).expect("convex")
}

fn one_grid() -> Region {
    let mut region = region();
    (region.rows, region.columns) = (1, 1);
    region
}

fn points(surface: &BSplineSurface, places: &[Parameter]) -> Vec<Point<Panel>> {
    places.iter().map(|at| surface.point(*at)).collect()
}

fn tool(waypoint: &Waypoint) -> Rigid<Panel, Tool> {
    waypoint.panel_from_tool
}

fn fitted(shape: Shape, spoil: ScanDefects, more: &str) -> (Fit, Region, Vec<Point<Panel>>, recipe::Path) {
    let recipe = scene::recipe(shape, more);
    let panel = taught(shape, spoil, &recipe);
    let fit = fit(&panel, recipe.surface()).unwrap_or_else(|e| panic!("{e}"));
    (fit, panel.region, panel.outline, recipe.path().clone())
}
