//! The taught panel as the search and the fit use it: points with normals, an outline in space, and its own grid.
//!
//! The outline is found in the taught scan's colours and depths (`taught_outline`).

use super::LocateError;
use super::grid::{Grid, Motion, camera_point};
use super::taught_outline::{OutlinePoint, OutlineSeen, TaughtOutline};
use crate::geometry::{Camera, OrganizedCloud, Panel, Pixel, Point, Rigid, Vector};
use crate::panel::TaughtPanel;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use rayon::prelude::*;

/// Half the width of the neighbourhood that gives a normal, blocks.
const NORMAL_REACH: usize = 2;
/// The surface at an edge is read from blocks no farther than this, of which there must be so many and one near, blocks.
const EDGE_REACH: isize = 7;
const MIN_BESIDE: usize = 25;
const MAX_BESIDE: f64 = 4.0;
/// A panel of which so much gave points is whole.
const WHOLE: f64 = 0.9;
/// Fewer points hold no panel.
const MIN_SURFACE: usize = 200;
pub(super) const MIN_OUTLINE: usize = 60;

/// The taught panel.
pub(super) struct Model {
    /// Points of the surface, in the panel's frame, mm.
    pub points: Vec<Vector3<f64>>,
    /// Their normals, towards the camera that took them.
    pub normals: Vec<Vector3<f64>>,
    /// The outline, in order.
    pub outline: Vec<OutlinePoint>,
    /// The middle of the surface.
    pub centre: Vector3<f64>,
    /// The direction in which the surface scatters least, towards the camera.
    pub normal: Vector3<f64>,
    /// Area of the surface, mm².
    pub area_mm2: f64,
    /// The panel's own depths and where its camera stood.
    pub grid: Grid,
    /// Where that camera stood.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// How many pixels a step of brightness at the outline took, median.
    pub edge_width_px: f64,
    /// Share of the panel that gave points at teaching, 0…1, where a person drew its outline; else 1.
    pub given: f64,
    /// What shows the outline, and what does not.
    pub outline_seen: OutlineSeen,
    /// Where something holds the panel, in the taught picture.
    pub held_px: Vec<[Pixel; 4]>,
}

impl Model {
    /// Derives the model of a taught panel.
    pub fn of(panel: &TaughtPanel) -> Result<Model, LocateError> {
        let camera_from_panel = panel.panel_from_camera.inverse();
        let motion = Motion::of(&camera_from_panel);
        let depth_row = motion.turn.row(2).into_owned();
        let raw = panel.scan.raw_points_mm();
        let depth = |index: usize| {
            let [x, y, z] = raw[index];
            let depth = (depth_row * Vector3::new(f64::from(x), f64::from(y), f64::from(z)))[0] + motion.shift.z;
            (panel.mask.inside[index] && depth > 0.0).then_some(depth as f32)
        };
        let grid = Grid::of_depths((panel.scan.width(), panel.scan.height()), &panel.camera, depth);
        let surface = Surface::of(&grid);
        let TaughtOutline { points: outline, edge_width_px, seen: outline_seen } =
            TaughtOutline::of(panel, &grid, &surface);
        let few = LocateError::Degenerate { surface: surface.samples.len(), outline: outline.len() };
        if surface.samples.len() < MIN_SURFACE || outline.len() < MIN_OUTLINE {
            return Err(few);
        }
        let turn = panel.panel_from_camera.rotation();
        let points: Vec<Vector3<f64>> = surface
            .samples
            .iter()
            .map(|sample| (panel.panel_from_camera * camera_point(&sample.point)).mm.coords)
            .collect();
        let normals = surface.samples.iter().map(|sample| turn * sample.normal).collect();
        let (centre, axis) = middle_and_thinnest(&points).ok_or(few)?;
        let towards = panel.panel_from_camera.origin().mm.coords - centre;
        Ok(Model {
            normals,
            outline,
            centre,
            normal: if axis.dot(&towards) < 0.0 { -axis } else { axis },
            area_mm2: surface.samples.iter().map(|sample| sample.area_mm2).sum(),
            points,
            grid,
            camera_from_panel,
            edge_width_px,
            given: panel.given(),
            outline_seen,
            held_px: panel.held_px.clone(),
        })
    }

    /// Did large parts of the panel give no points at teaching, so that they may be missing now as well, others perhaps?
    pub fn is_patchy(&self) -> bool {
        self.given < WHOLE
    }

    /// The middle as a point of the panel.
    pub fn centre_point(&self) -> Point<Panel> {
        Point::new(self.centre.into())
    }

    /// The mean normal as a direction of the panel.
    pub fn normal_direction(&self) -> Vector<Panel> {
        Vector::new(self.normal)
    }

    /// The sine of the angle between the taught view of the panel and the one at a placement.
    pub fn view_change(&self, placed: &Motion) -> f64 {
        let taught = Motion::of(&self.camera_from_panel);
        let view = |motion: &Motion| (motion.turn.transpose() * -motion.point(&self.centre)).normalize();
        view(&taught).cross(&view(placed)).norm()
    }

    /// How far two guesses put the same point of the outline apart, at most, mm.
    pub fn largest_distance_mm(&self, a: &Rigid<Camera, Panel>, b: &Rigid<Camera, Panel>) -> f64 {
        let (a, b) = (Motion::of(a), Motion::of(b));
        let apart = |sample: &OutlinePoint| (a.point(&sample.point) - b.point(&sample.point)).norm();
        self.outline.iter().step_by(4).map(apart).fold(0.0, f64::max)
    }
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    /// In the camera's frame.
    point: Vector3<f64>,
    normal: Vector3<f64>,
    area_mm2: f64,
}

/// The surface block by block.
pub(super) struct Surface {
    samples: Vec<Sample>,
    /// The sample of each block.
    of_block: Vec<Option<u32>>,
}

impl Surface {
    fn of(grid: &Grid) -> Surface {
        let count = grid.columns * grid.rows;
        let points: Vec<Option<Vector3<f64>>> = (0..count)
            .into_par_iter()
            .with_min_len(2_048)
            .map(|index| grid.point(index % grid.columns, index / grid.columns))
            .collect();
        let sampled: Vec<Option<Sample>> = (0..count)
            .into_par_iter()
            .with_min_len(2_048)
            .map(|index| points[index].and_then(|point| tangent(grid, &points, index, point)))
            .collect();
        let mut surface = Surface { samples: Vec::new(), of_block: vec![None; count] };
        for (index, sample) in sampled.into_iter().enumerate() {
            if let Some(sample) = sample {
                surface.of_block[index] = Some(surface.samples.len() as u32);
                surface.samples.push(sample);
            }
        }
        surface
    }

    /// Depth and normal of the surface at a place beside it: its inverse depth goes on as a polynomial of second order, for
    /// planes alone would leave a bent surface on one side of it.
    pub fn beside(&self, grid: &Grid, pixel: Pixel) -> Option<(f64, Vector3<f64>)> {
        let [x, y] = grid.place(pixel);
        let (column, row) = (x.round() as isize, y.round() as isize);
        let (mut squares, mut sums) = (Matrix6::zeros(), Vector6::zeros());
        let (mut nearest, mut count) = ((f64::INFINITY, 0), 0usize);
        for j in row - EDGE_REACH..=row + EDGE_REACH {
            for i in column - EDGE_REACH..=column + EDGE_REACH {
                let (dx, dy) = (i as f64 - x, j as f64 - y);
                let away = dx.hypot(dy);
                let inside = i >= 0 && j >= 0 && (i as usize) < grid.columns && (j as usize) < grid.rows;
                if !inside || away > EDGE_REACH as f64 {
                    continue;
                }
                let Some(sample) = self.of_block[j as usize * grid.columns + i as usize] else { continue };
                if away < nearest.0 {
                    nearest = (away, sample);
                }
                let terms = Vector6::new(1.0, dx, dy, dx * dx, dx * dy, dy * dy);
                squares += terms * terms.transpose();
                sums += terms / self.samples[sample as usize].point.z;
                count += 1;
            }
        }
        if count < MIN_BESIDE || nearest.0 > MAX_BESIDE {
            return None;
        }
        let depth_mm = 1.0 / (squares.try_inverse()? * sums)[0];
        (depth_mm.is_finite() && depth_mm > 0.0).then(|| (depth_mm, self.samples[nearest.1 as usize].normal))
    }
}

/// The plane through a block's neighbours: least squares of the points over columns and rows.
fn tangent(grid: &Grid, points: &[Option<Vector3<f64>>], index: usize, middle: Vector3<f64>) -> Option<Sample> {
    let (column, row) = (index % grid.columns, index / grid.columns);
    let mut squares = Matrix3::zeros();
    let mut sums = [Vector3::zeros(); 3];
    for j in row.saturating_sub(NORMAL_REACH)..=(row + NORMAL_REACH).min(grid.rows - 1) {
        for i in column.saturating_sub(NORMAL_REACH)..=(column + NORMAL_REACH).min(grid.columns - 1) {
            let Some(point) = points[j * grid.columns + i] else { continue };
            let far = (i as f64 - column as f64).hypot(j as f64 - row as f64).max(1.0);
            if !grid.joined(middle.z, middle.z + (point.z - middle.z) / far) {
                continue;
            }
            let terms = Vector3::new(1.0, i as f64 - column as f64, j as f64 - row as f64);
            squares += terms * terms.transpose();
            for axis in 0..3 {
                sums[axis] += terms * (point[axis] - middle[axis]);
            }
        }
    }
    if squares[(0, 0)] < 8.0 {
        return None;
    }
    let inverse = squares.try_inverse()?;
    let fitted = sums.map(|sum| inverse * sum);
    let along = |term: usize| Vector3::new(fitted[0][term], fitted[1][term], fitted[2][term]);
    let across = along(1).cross(&along(2));
    let normal = across.try_normalize(1e-9)?;
    let normal = if normal.dot(&middle) > 0.0 { -normal } else { normal };
    Some(Sample { point: middle, normal, area_mm2: across.norm() })
}

/// Centroid, and the direction in which the points scatter least; `None` for no points.
pub(super) fn middle_and_thinnest(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    if points.is_empty() {
        return None;
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    Some((mean, eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()))
}

/// A scan's colours are needed as they are: this keeps the type in one place.
pub(super) type Scan = OrganizedCloud<Camera>;
