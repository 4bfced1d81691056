//! What a verdict's reasons look like in the scan's picture: for people, who then know where to look.
//!
//! Everything is looked at once more at the place found, sample by sample, as `evidence` counted it. Decides nothing.

use super::camera_check::{self, FixtureEdge};
use super::edges::Edge;
use super::evidence::Fit;
use super::fit::{Residuals, Samples, Seen};
use super::grid::{Grid, Motion, camera_point};
use super::model::Model;
use super::search::{Sight, sight};
use super::shares::EDGE_FOUND_PX;
use super::solve::twisted;
use super::{LocateError, View, grid, pieces};
use crate::geometry::{Camera, Panel, Pixel, Rigid};
use crate::panel::TaughtPanel;
use crate::recipe;
use nalgebra::{Matrix6, Vector6};

/// The stated error is drawn so many times larger.
pub const ENLARGED: f64 = 50.0;

/// What the scan shows where a taught point should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SurfaceMark {
    /// The taught surface, so far before it, mm.
    On(f64),
    /// Something farther.
    Through,
    /// Something nearer.
    Hidden,
    /// No point.
    Missing,
}

/// What the picture shows where the taught outline should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutlineMark {
    /// The edge.
    Found,
    /// The edge elsewhere, or none.
    Elsewhere,
    /// Something before it, or it is out of view.
    Hidden,
}

/// The evidence, pixel by pixel.
#[derive(Debug, Clone, Default)]
pub struct Explained {
    /// Side of the square that a place of the surface or of a thing stands for, px.
    pub block_px: usize,
    /// The taught surface.
    pub surface: Vec<(Pixel, SurfaceMark)>,
    /// The taught outline, in order.
    pub outline: Vec<(Pixel, OutlineMark)>,
    /// The outline's places with the stated error along the weakest direction added, [`ENLARGED`].
    pub weakest: Vec<(Pixel, Pixel)>,
    /// Where the step of brightness at the outline is widest.
    pub widest: Option<Pixel>,
    /// Edges of the fixture, and whether they stand where they stood.
    pub fixture: Vec<(Pixel, bool)>,
    /// Things in the search box: area, mm², and places; largest first.
    pub things: Vec<(f64, Vec<Pixel>)>,
}

/// An edge of the fixture farther from its taught place has moved, px.
const MOVED_PX: f64 = 0.5;

/// Looks at everything again; `fit` is what was found, if anything was.
///
/// # Errors
/// Where the taught panel has too little surface or outline.
pub fn explain(
    taught: &TaughtPanel,
    view: &View<'_>,
    settings: &recipe::Locate,
    fit: Option<&Fit>,
) -> Result<Explained, LocateError> {
    let (model, grid) = (Model::of(taught)?, Grid::of(view.scan, view.camera));
    let inside = grid::in_box(&grid, &view.base_from_camera, settings.box_min_mm(), settings.box_max_mm());
    let of_block = |&block: &u32| grid.pixel(block as usize % grid.columns, block as usize / grid.columns);
    let thing = |piece: pieces::Piece| (piece.area_mm2, piece.blocks.iter().map(of_block).collect());
    let mut explained = Explained {
        block_px: grid.factor,
        things: pieces::pieces(&grid, &inside).into_iter().map(thing).collect(),
        ..Explained::default()
    };
    let Some(fit) = fit else { return Ok(explained) };
    let placed: Rigid<Camera, Panel> = view.base_from_camera.inverse() * fit.base_from_panel;
    let seen = Seen { model: &model, grid: &grid, scan: view.scan };
    explained.surface = surface(&placed, seen);
    (explained.outline, explained.widest) = outline(&placed, seen);
    explained.weakest = weakest(&placed, seen, fit);
    let still = |edge: FixtureEdge| (edge.pixel, edge.moved_px.is_some_and(|px| px.abs() <= MOVED_PX));
    let edges = camera_check::fixture(taught, &model, (&grid, view.scan), &inside);
    explained.fixture = edges.into_iter().map(still).collect();
    Ok(explained)
}

fn surface(placed: &Rigid<Camera, Panel>, seen: Seen<'_>) -> Vec<(Pixel, SurfaceMark)> {
    let motion = Motion::of(placed);
    let mark = |i: usize| {
        let pixel = seen.grid.camera.project(camera_point(&motion.point(&seen.model.points[i])))?;
        let mark = match sight(&motion, seen.model, seen.grid, i) {
            Sight::On(residual_mm) => SurfaceMark::On(residual_mm),
            Sight::Near => SurfaceMark::On(0.0),
            Sight::Through => SurfaceMark::Through,
            Sight::Hidden => SurfaceMark::Hidden,
            Sight::Unknown => SurfaceMark::Missing,
        };
        Some((pixel, mark))
    };
    (0..seen.model.points.len()).filter_map(mark).collect()
}

fn outline(placed: &Rigid<Camera, Panel>, seen: Seen<'_>) -> (Vec<(Pixel, OutlineMark)>, Option<Pixel>) {
    let motion = Motion::of(placed);
    let residuals = Residuals::at(placed, seen, &Samples::all(seen.model));
    let pixel = |k: usize| seen.grid.camera.project(camera_point(&motion.point(&seen.model.outline[k].point)));
    let mark = |(k, edge): &(usize, Edge)| {
        let mark = match edge {
            Edge::Colour { offset_px, .. } | Edge::Depth { offset_px } if offset_px.abs() <= EDGE_FOUND_PX => {
                OutlineMark::Found
            }
            Edge::Colour { .. } | Edge::Depth { .. } | Edge::Absent => OutlineMark::Elsewhere,
            Edge::Hidden | Edge::OutOfView => OutlineMark::Hidden,
        };
        Some((pixel(*k)?, mark))
    };
    let width = |(k, edge): &(usize, Edge)| match edge {
        Edge::Colour { width_px, .. } => Some((*k, *width_px)),
        _ => None,
    };
    let widest = residuals.edges.iter().filter_map(width).max_by(|a, b| a.1.total_cmp(&b.1));
    (residuals.edges.iter().filter_map(mark).collect(), widest.and_then(|(k, _)| pixel(k)))
}

/// Where the stated error along its largest direction would put the outline.
fn weakest(placed: &Rigid<Camera, Panel>, seen: Seen<'_>, fit: &Fit) -> Vec<(Pixel, Pixel)> {
    let motion = Motion::of(placed);
    let centre = motion.point(&seen.model.centre);
    let reach_mm = super::search::reach_mm(seen.model).max(1.0);
    // Turns and shifts compare by what they move at the panel's rim.
    let scale = Vector6::new(reach_mm, reach_mm, reach_mm, 1.0, 1.0, 1.0);
    let diagonal = Matrix6::from_diagonal(&scale);
    let eigen = (diagonal * fit.covariance * diagonal).symmetric_eigen();
    let largest = eigen.eigenvectors.column(eigen.eigenvalues.imax()) * eigen.eigenvalues.max().max(0.0).sqrt();
    let twist = largest.component_div(&scale) * (1.96 * ENLARGED);
    let moved = Motion::of(&twisted(placed, &centre, &twist));
    let project = |motion: &Motion, k: usize| {
        seen.grid.camera.project(camera_point(&motion.point(&seen.model.outline[k].point)))
    };
    (0..seen.model.outline.len()).filter_map(|k| Some((project(&motion, k)?, project(&moved, k)?))).collect()
}
