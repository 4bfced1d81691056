//! Checks whether the camera has moved since teaching, by comparing the static fixture in both scans.
//!
//! Outside of the search box both scans show the same objects at the same pixels as long as the camera has not moved. A
//! small rotation or shift of the camera (a twist) changes the depths of the fixture's faces and shifts its edges in
//! the picture. Both are constraints of one robust least-squares fit (`solve`). Objects that were added or removed are
//! outliers. A direction that the fixture does not constrain is reported as not observed, never as not moved.

use super::covariance::worst_mm;
use super::grid::{ColoredCloud, DepthReading, Grid, MatrixTransform, camera_point, spread_indices};
use super::model::{Model, TaughtModel};
use super::solve::{Constraint, ResidualSums, ResidualWeighting, apply_twist, spread};
use super::{edges, grid};
use nalgebra::{Matrix6, Vector2};
use panelprep_base::geometry::statistics::PANEL_MAX_95;
use panelprep_base::geometry::{Camera, Frame, OrganizedCloud, Panel, Pixel, Rigid};
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe;
use rayon::prelude::*;

/// Maximum numbers of faces (`MAX_FACES`) and edges (`MAX_EDGES`) that are compared.
const MAX_FACES: usize = 3_000;
const MAX_EDGES: usize = 700;
/// Minimum number of faces for a result.
const MIN_FACES: usize = 150;
/// For a face: standard deviation of its distance, number of neighbouring faces with a common error, lower limit of the
/// outlier cutoff, and maximum change of distance of an unmoved face. The corresponding constants of an edge follow.
const FACE_NOISE_MM: f64 = 0.06;
const FACE_CORRELATED_COUNT: f64 = 60.0;
const MIN_FACE_CUTOFF_MM: f64 = 0.5;
const MAX_FACE_CHANGE_MM: f64 = 1.0;
const EDGE_NOISE_PX: f64 = 0.15;
const EDGE_CORRELATED_COUNT: f64 = 8.0;
const MIN_EDGE_CUTOFF_PX: f64 = 0.6;
/// Minimum change of brightness from block to block at an edge, grey levels.
const MIN_EDGE_CONTRAST: f64 = 16.0;
/// Minimum number of edges for which the found fraction is evaluated.
const MIN_EDGES: usize = 40;
/// Maximum change of the depth at a taught face, mm; with a larger change another object hides the face.
const MAX_DEPTH_CHANGE_MM: f64 = 15.0;
/// Standard deviations of the prior for the motion of the camera: shift (`PRIOR_SIGMA_MM`) and rotation
/// (`PRIOR_SIGMA_RAD`). The prior constrains the directions that the fixture does not constrain.
const PRIOR_SIGMA_MM: f64 = 3.0;
const PRIOR_SIGMA_RAD: f64 = 0.004;
const ITERATIONS: usize = 4;

/// The result of the comparison of the camera pose with the fixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraCheck {
    /// Maximum displacement of the panel that is caused by the motion of the camera since teaching, mm.
    pub moved_mm: f64,
    /// Uncertainty of `moved_mm`, 95 %, mm.
    pub uncertainty_mm: f64,
    /// Fraction of the fixture that is still at its taught position, 0…1.
    pub unmoved_share: f64,
}

/// Compares the fixture in both scans; `None` if too little of the fixture is visible.
pub(super) fn check_camera(
    panel: &TaughtPanel,
    taught: &TaughtModel,
    (grid, scan): (&Grid, &ColoredCloud),
    inside: &[bool],
    placed: &Rigid<Camera, Panel>,
) -> Option<CameraCheck> {
    // With another camera or picture size, the pixels do not correspond.
    if (panel.scan.width(), panel.scan.height()) != (scan.width(), scan.height()) || panel.camera != grid.camera {
        return None;
    }
    compare_fixture(panel, &taught.model, (&taught.fixture, grid, scan), inside, placed)
}

/// Returns the uncertainty of the pose of a camera that has not moved, determined with the fixture in the taught scan,
/// as the 95 % displacement at the taught panel, mm. `None` if too little of the fixture is visible.
pub(super) fn teaching_uncertainty_mm(
    panel: &TaughtPanel,
    taught: &TaughtModel,
    settings: &recipe::Locate,
) -> Option<f64> {
    let TaughtModel { model, fixture } = taught;
    let inside = box_blocks_at_teaching(panel, fixture, settings);
    let placed = model.camera_from_panel;
    compare_fixture(panel, model, (fixture, fixture, &panel.scan), &inside, &placed).map(|it| it.uncertainty_mm)
}

/// Returns for each block of the taught scan whether it is in the search box.
fn box_blocks_at_teaching(panel: &TaughtPanel, fixture: &Grid, settings: &recipe::Locate) -> Vec<bool> {
    let base_from_camera = panel.nominal_pose * panel.panel_from_camera;
    grid::blocks_in_box(fixture, &base_from_camera, settings.box_min_mm(), settings.box_max_mm())
}

fn compare_fixture<F: Frame>(
    panel: &TaughtPanel,
    model: &Model,
    (taught, grid, scan): (&Grid, &Grid, &OrganizedCloud<F>),
    inside: &[bool],
    placed: &Rigid<Camera, Panel>,
) -> Option<CameraCheck> {
    let still = StaticScene::new(taught, grid, inside);
    let faces = still.faces(grid);
    if faces.len() < MIN_FACES {
        return None;
    }
    let same_faces =
        faces.iter().filter(|face| face.residual.abs() <= MAX_FACE_CHANGE_MM).count() as f64 / faces.len() as f64;
    let (edges, same_edges) = still.edges(panel, (grid, scan));
    // The smaller fraction is used: the edges or the faces alone can show that the fixture has changed.
    let same = same_edges.map_or(same_faces, |same_edges| same_edges.min(same_faces));
    let centre = MatrixTransform::from_rigid(placed).point(&model.centre);
    let identity: Rigid<Camera, Panel> = *placed;
    let (mut moved, mut information) = (identity, Matrix6::zeros());
    let mut twist = nalgebra::Vector6::zeros();
    for _ in 0..ITERATIONS {
        let at = |constraint: &Constraint| Constraint {
            residual: constraint.residual + constraint.jacobian(&centre).dot(&twist),
            ..*constraint
        };
        let (faces, edges): (Vec<_>, Vec<_>) = (faces.iter().map(at).collect(), edges.iter().map(at).collect());
        let of_faces = ResidualWeighting {
            sigma: FACE_NOISE_MM,
            correlated_count: FACE_CORRELATED_COUNT,
            cutoff: (4.7 * spread(&faces)).max(MIN_FACE_CUTOFF_MM),
        };
        let of_edges = ResidualWeighting {
            sigma: EDGE_NOISE_PX,
            correlated_count: EDGE_CORRELATED_COUNT,
            cutoff: (4.7 * spread(&edges)).max(MIN_EDGE_CUTOFF_PX),
        };
        let mut sums = ResidualSums::from_constraints(&faces, &of_faces, &centre)
            .add(ResidualSums::from_constraints(&edges, &of_edges, &centre));
        // A direction that the fixture does not constrain gets the uncertainty of the prior, instead of an infinite
        // one.
        for axis in 0..6 {
            let sigma = if axis < 3 { PRIOR_SIGMA_RAD } else { PRIOR_SIGMA_MM };
            sums.information[(axis, axis)] += 1.0 / (sigma * sigma);
            sums.gradient[axis] += twist[axis] / (sigma * sigma);
        }
        twist += sums.twist()?;
        moved = apply_twist(&identity, &centre, &twist);
        information = sums.information;
    }
    let covariance = information.try_inverse()?;
    Some(CameraCheck {
        moved_mm: model.largest_distance_mm(&identity, &moved),
        uncertainty_mm: PANEL_MAX_95 * worst_mm(&covariance, model, &MatrixTransform::from_rigid(placed)),
        unmoved_share: same,
    })
}

/// The blocks that are outside of the search box in both scans.
struct StaticScene<'a> {
    taught: &'a Grid,
    blocks: Vec<usize>,
    is_still: Vec<bool>,
}

impl<'a> StaticScene<'a> {
    fn new(taught: &'a Grid, grid: &Grid, inside: &[bool]) -> StaticScene<'a> {
        let both =
            |block: usize| !inside[block] && taught.depth_mm(block).is_some() && grid.depth_mm(block).is_some();
        let is_still: Vec<bool> = (0..grid.columns * grid.rows).map(both).collect();
        let blocks = (0..is_still.len()).filter(|&block| is_still[block]).collect();
        StaticScene { taught, blocks, is_still }
    }

    /// Returns the distances of the taught faces in front of the scanned faces, along their normals.
    fn faces(&self, grid: &Grid) -> Vec<Constraint> {
        let chosen = spread_indices(self.blocks.len(), MAX_FACES);
        let face = |&k: &usize| {
            let block = self.blocks[k];
            let (column, row) = (block % grid.columns, block / grid.columns);
            let point = self.taught.point(column, row)?;
            let beside = |i: usize, j: usize| {
                let (x, y) = (column + i, row + j);
                let far = (x < grid.columns && y < grid.rows).then(|| self.taught.point(x, y)).flatten()?;
                self.taught.are_joined(point.z, point.z + (far.z - point.z) / 4.0).then(|| far - point)
            };
            let normal = beside(4, 0)?.cross(&beside(0, 4)?).try_normalize(1e-9)?;
            let DepthReading::Smooth(depth_mm) = grid.reading_at_pixel(grid.pixel(column, row)) else {
                return None;
            };
            let residual = normal.dot(&point) * (1.0 - depth_mm / point.z);
            Some(Constraint { point, gradient: normal, residual, sample: k })
        };
        let faces: Vec<Option<Constraint>> = chosen.par_iter().with_min_len(256).map(face).collect();
        faces.into_iter().flatten().collect()
    }

    /// Returns the distances between the taught and the scanned edges in the picture, and the fraction of the taught
    /// edges that were found.
    fn edges<F: Frame>(
        &self,
        panel: &TaughtPanel,
        now: (&Grid, &OrganizedCloud<F>),
    ) -> (Vec<Constraint>, Option<f64>) {
        let looked = self.match_edges(panel, now);
        let asked = looked.len();
        let edges: Vec<Constraint> = looked.into_iter().filter_map(|(_, edge)| edge).collect();
        let same = (asked >= MIN_EDGES).then(|| edges.len() as f64 / asked as f64);
        (edges, same)
    }

    /// Returns taught edges of the fixture, each with the corresponding edge of the scan.
    fn match_edges<F: Frame>(
        &self,
        panel: &TaughtPanel,
        (grid, scan): (&Grid, &OrganizedCloud<F>),
    ) -> Vec<(TaughtEdge, Option<Constraint>)> {
        let found: Vec<[Option<TaughtEdge>; 2]> = (0..self.is_still.len())
            .into_par_iter()
            .with_min_len(4_096)
            .map(|block| [(1, 0), (0, 1)].map(|step| self.find_edge(panel, grid, block, step)))
            .collect();
        let found: Vec<TaughtEdge> = found.into_iter().flatten().flatten().collect();
        let look = |k: &usize| {
            let TaughtEdge { block, pixel, across } = found[*k];
            let outward = [across.x, across.y];
            let taught = edges::step(&edges::line(&panel.scan, pixel, outward)?, 0.0)?;
            let point = self.taught.point(block % self.taught.columns, block / self.taught.columns)?;
            let (_, slope) = self.taught.camera.project_with_jacobian(camera_point(&point))?;
            let now = edges::line(scan, pixel, outward).and_then(|line| edges::step(&line, taught.offset_px));
            let now = now.filter(|now| taught.contrast * now.contrast > 0.0).map(|now| Constraint {
                point,
                gradient: slope.transpose() * across,
                residual: taught.offset_px - now.offset_px,
                sample: *k,
            });
            Some((found[*k], now))
        };
        let chosen = spread_indices(found.len(), MAX_EDGES);
        let looked: Vec<Option<(TaughtEdge, Option<Constraint>)>> =
            chosen.par_iter().with_min_len(64).map(look).collect();
        looked.into_iter().flatten().collect()
    }

    /// Returns the edge between a block and its neighbour, if the brightness differs enough between them. The edge
    /// belongs to the nearer of the two blocks, or to the only block that has a depth: behind a fixture there may be no
    /// points.
    fn find_edge(
        &self,
        panel: &TaughtPanel,
        grid: &Grid,
        block: usize,
        (right, down): (usize, usize),
    ) -> Option<TaughtEdge> {
        let (column, row) = (block % self.taught.columns, block / self.taught.columns);
        let inside = column + right < self.taught.columns && row + down < self.taught.rows;
        let beside = inside.then(|| block + right + down * self.taught.columns)?;
        let depth = |block: usize| self.is_still[block].then(|| self.taught.depth_mm(block)).flatten();
        let block = match (depth(block), depth(beside)) {
            (Some(here), Some(there)) => {
                if here <= there {
                    block
                } else {
                    beside
                }
            }
            (Some(_), None) => block,
            (None, Some(_)) => beside,
            (None, None) => return None,
        };
        // An object in front of the edge hides it.
        let moved_mm = grid.depth_mm(block)? - self.taught.depth_mm(block)?;
        if moved_mm.abs() > MAX_DEPTH_CHANGE_MM {
            return None;
        }
        let (here, there) = (self.taught.pixel(column, row), self.taught.pixel(column + right, row + down));
        let rise = brightness(panel, there)? - brightness(panel, here)?;
        if rise.abs() < MIN_EDGE_CONTRAST {
            return None;
        }
        let middle = Pixel::at((here.u + there.u) / 2.0, (here.v + there.v) / 2.0);
        let reach = self.taught.factor as f64;
        let at = |u: f64, v: f64| Pixel::at(middle.u + u * reach, middle.v + v * reach);
        let rise = |a: Pixel, b: Pixel| Some(brightness(panel, b)? - brightness(panel, a)?);
        let across = Vector2::new(rise(at(-1.0, 0.0), at(1.0, 0.0))?, rise(at(0.0, -1.0), at(0.0, 1.0))?);
        let around = (-2..=2).flat_map(|j| (-2..=2).map(move |i| at(f64::from(i), f64::from(j))));
        let of_panel = around.filter_map(|pixel| pixel.nearest_whole(panel.scan.width(), panel.scan.height()));
        let mut of_panel = of_panel.map(|(column, row)| panel.mask.inside[row * panel.scan.width() + column]);
        (!of_panel.any(|inside| inside)).then_some(())?;
        Some(TaughtEdge { block, pixel: middle, across: across.try_normalize(MIN_EDGE_CONTRAST / 2.0)? })
    }
}

/// Result of the search for an edge of the fixture at its taught position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum FixtureEdge {
    /// The edge is visible and has moved perpendicular to itself by this distance, px.
    Moved(f64),
    /// The fixture is visible, but the edge is missing.
    Gone,
    /// The fixture is not visible, or an object is in front of the edge.
    Unseen,
}

/// Returns the taught edges of the fixture with the result of the search for each; an empty list if the picture size or
/// the camera differs.
pub(super) fn fixture_edges(
    panel: &TaughtPanel,
    fixture: &Grid,
    (grid, scan): (&Grid, &ColoredCloud),
    (settings, inside): (&recipe::Locate, &[bool]),
) -> Vec<(Pixel, FixtureEdge)> {
    if (panel.scan.width(), panel.scan.height()) != (scan.width(), scan.height()) || panel.camera != grid.camera {
        return Vec::new();
    }
    let (taught, inside_taught) = (fixture, box_blocks_at_teaching(panel, fixture, settings));
    let looked = StaticScene::new(taught, grid, inside).match_edges(panel, (grid, scan));
    let shown = looked.into_iter().map(|(steep, now)| {
        (steep.pixel, now.map_or(FixtureEdge::Gone, |constraint| FixtureEdge::Moved(constraint.residual)))
    });
    let all = StaticScene::new(taught, taught, &inside_taught).match_edges(panel, (taught, &panel.scan));
    let is_unseen = |steep: &TaughtEdge| {
        let apart_mm =
            taught.depth_mm(steep.block).zip(grid.depth_mm(steep.block)).map(|(was, is)| (is - was).abs());
        apart_mm.is_none_or(|mm| mm > MAX_DEPTH_CHANGE_MM)
    };
    let unseen = all.into_iter().filter(|(steep, _)| is_unseen(steep));
    shown.chain(unseen.map(|(steep, _)| (steep.pixel, FixtureEdge::Unseen))).collect()
}

/// A taught edge of the fixture, at a block of the picture.
#[derive(Clone, Copy)]
struct TaughtEdge {
    block: usize,
    pixel: Pixel,
    across: Vector2<f64>,
}

fn brightness(panel: &TaughtPanel, pixel: Pixel) -> Option<f64> {
    edges::brightness(&panel.scan, pixel)
}
