//! The surface of the taught panel (a point, a normal and an area for each block of its grid), and its outline.
//!
//! The edge in the taught picture is located to a fraction of a pixel. The taught outline in space consists of the
//! points at which rays through this edge meet the surface beside it.
//!
//! The contour of the scanned points is close to the edge. The colour picture gives the exact edge; if colour shows no
//! edge, the border of the points is used instead. Beside an outline that a person drew, the edge is searched as in a
//! scan that is being located (`edges`). A point at which neither colour nor depth shows the edge is not measured and
//! not used. Points at which the panel is held are not used either.

use super::edges;
use super::edges::EdgeReading;
use super::grid::{ColoredCloud, Grid, MatrixTransform};
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};
use panelprep_base::geometry::{Camera, Pixel, median, polygon};
use panelprep_cell::panel::{OutlineFrom, TaughtPanel};
use rayon::prelude::*;

/// Half width of the neighbourhood that determines a normal, blocks.
const NORMAL_REACH_BLOCKS: usize = 2;
/// Maximum distance of the blocks to which the surface at an edge is fitted, blocks. `MIN_FIT_BLOCKS` is the minimum
/// number of these blocks, and `MAX_NEAREST_DISTANCE_BLOCKS` the maximum distance of the nearest one.
const MAX_FIT_DISTANCE_BLOCKS: isize = 7;
const MIN_FIT_BLOCKS: usize = 25;
const MAX_NEAREST_DISTANCE_BLOCKS: f64 = 4.0;

#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The point in the camera frame, mm.
    pub point: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub area_mm2: f64,
}

/// The samples of the surface, block by block.
pub(super) struct Surface {
    pub samples: Vec<Sample>,
    /// For each block, the index of its sample.
    of_block: Vec<Option<u32>>,
}

impl Surface {
    pub fn from_grid(grid: &Grid) -> Surface {
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

    /// Returns depth and normal of the surface at a pixel beside the measured blocks. The inverse depth is extrapolated
    /// as a second-order polynomial, because a plane would deviate systematically from a bent surface.
    pub fn extrapolate(&self, grid: &Grid, pixel: Pixel) -> Option<(f64, Vector3<f64>)> {
        let [x, y] = grid.block_position(pixel);
        let (column, row) = (x.round() as isize, y.round() as isize);
        let (mut squares, mut sums) = (Matrix6::zeros(), Vector6::zeros());
        let (mut nearest, mut count) = ((f64::INFINITY, 0), 0usize);
        for j in row - MAX_FIT_DISTANCE_BLOCKS..=row + MAX_FIT_DISTANCE_BLOCKS {
            for i in column - MAX_FIT_DISTANCE_BLOCKS..=column + MAX_FIT_DISTANCE_BLOCKS {
                let (dx, dy) = (i as f64 - x, j as f64 - y);
                let away = dx.hypot(dy);
                let inside = i >= 0 && j >= 0 && (i as usize) < grid.columns && (j as usize) < grid.rows;
                if !inside || away > MAX_FIT_DISTANCE_BLOCKS as f64 {
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
        if count < MIN_FIT_BLOCKS || nearest.0 > MAX_NEAREST_DISTANCE_BLOCKS {
            return None;
        }
        let depth_mm = 1.0 / (squares.try_inverse()? * sums)[0];
        (depth_mm.is_finite() && depth_mm > 0.0).then(|| (depth_mm, self.samples[nearest.1 as usize].normal))
    }
}

/// Fits a plane to the neighbours of a block: least squares of the points over columns and rows.
fn tangent(grid: &Grid, points: &[Option<Vector3<f64>>], index: usize, middle: Vector3<f64>) -> Option<Sample> {
    let (column, row) = (index % grid.columns, index / grid.columns);
    let mut squares = Matrix3::zeros();
    let mut sums = [Vector3::zeros(); 3];
    for j in row.saturating_sub(NORMAL_REACH_BLOCKS)..=(row + NORMAL_REACH_BLOCKS).min(grid.rows - 1) {
        for i in column.saturating_sub(NORMAL_REACH_BLOCKS)..=(column + NORMAL_REACH_BLOCKS).min(grid.columns - 1) {
            let Some(point) = points[j * grid.columns + i] else { continue };
            let far = (i as f64 - column as f64).hypot(j as f64 - row as f64).max(1.0);
            if !grid.are_joined(middle.z, middle.z + (point.z - middle.z) / far) {
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

/// Half length of the contour over which its position and direction are averaged, px.
const CONTOUR_REACH_PX: usize = 5;
/// Distance between the points of the outline along the contour, px.
const CONTOUR_STEP_PX: usize = 2;
/// Distance of the mask's border from the edge inwards, px: pixels of which the panel covers only half have no point.
const MASK_INSET_PX: f64 = 1.0;
/// Minimum distance between a point of the contour and a holder, px: the mean position of a nearer point includes held
/// pixels.
const MIN_HELD_DISTANCE_PX: f64 = (CONTOUR_REACH_PX + 1) as f64;
/// Number of points to each side that determine the direction of the outline.
const DIRECTION_POINT_COUNT: usize = 3;
/// Minimum number of outline points that determine the pose of the panel.
pub(super) const MIN_OUTLINE_POINTS: usize = 60;

/// A point of the outline.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutlinePoint {
    /// Position of the point in the panel frame, mm.
    pub point: Vector3<f64>,
    /// Unit vector along the outline.
    pub outline_direction: Vector3<f64>,
    /// Normal of the surface beside the outline.
    pub normal: Vector3<f64>,
    /// Unit vector in the surface that points off the panel.
    pub outward_direction: Vector3<f64>,
    /// Length of outline that this point represents, mm.
    pub length_mm: f64,
    /// Whether the edge at this point was found by colour.
    pub by_colour: bool,
}

/// The evidence for the taught outline: fractions of its points, 0…1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlineEvidence {
    /// Fraction of the points whose edge is visible by colour.
    pub by_colour: f64,
    /// Fraction of the points whose edge is visible only by depth.
    pub by_depth: f64,
    /// Fraction of the points at which the panel is held.
    pub held: f64,
    /// Fraction of the points at which neither colour nor depth shows the edge, or no surface was measured beside it.
    pub unseen: f64,
}

/// The outline of a taught panel, with its evidence.
pub(super) struct TaughtOutline {
    pub points: Vec<OutlinePoint>,
    /// Median width of the steps of brightness at the outline, px.
    pub edge_width_px: f64,
    pub evidence: OutlineEvidence,
}

/// An edge beside a point of the contour.
#[derive(Clone, Copy)]
struct EdgePoint {
    /// The point in the camera frame, mm.
    point: Vector3<f64>,
    normal: Vector3<f64>,
    /// Width of the edge, px, if colour shows it.
    width_px: Option<f64>,
}

/// The data in which the edges are searched.
struct OutlineContext<'a> {
    panel: &'a TaughtPanel,
    grid: &'a Grid,
    surface: &'a Surface,
    /// The taught scan in its camera frame; `None` if no person drew the outline.
    scan: Option<ColoredCloud>,
    /// Positive if the contour is clockwise on a screen.
    side: f64,
}

impl TaughtOutline {
    /// Detects the outline of a taught panel with these depths and this surface.
    pub fn detect(panel: &TaughtPanel, grid: &Grid, surface: &Surface) -> TaughtOutline {
        let contour = &panel.outline_px;
        if contour.len() < 8 * CONTOUR_REACH_PX {
            return TaughtOutline::empty();
        }
        let is_drawn = panel.outline_from == OutlineFrom::Recipe;
        let scan = is_drawn.then(|| panel.scan.transformed::<Camera>(&panel.panel_from_camera.inverse()));
        let side = polygon::signed_area_px2(contour).signum();
        let looked = OutlineContext { panel, grid, surface, scan, side };
        let steps = contour.len().div_ceil(CONTOUR_STEP_PX);
        let is_held: Vec<bool> =
            (0..steps).map(|k| panel.is_held_near(contour[k * CONTOUR_STEP_PX], MIN_HELD_DISTANCE_PX)).collect();
        // Beside a held segment, the direction would be computed across this segment, so the points there are not used.
        let is_used = |k: usize| {
            (k + steps - DIRECTION_POINT_COUNT..=k + steps + DIRECTION_POINT_COUNT)
                .all(|near| !is_held[near % steps])
        };
        let found: Vec<Option<EdgePoint>> = (0..steps)
            .into_par_iter()
            .with_min_len(64)
            .map(|k| if is_used(k) { looked.edge(k * CONTOUR_STEP_PX) } else { None })
            .collect();
        let held = (0..steps).filter(|&k| !is_used(k)).count();
        let edges: Vec<EdgePoint> = found.into_iter().flatten().collect();
        let mut widths: Vec<f64> = edges.iter().filter_map(|edge| edge.width_px).collect();
        let share = |count: usize| count as f64 / steps as f64;
        let seen = OutlineEvidence {
            by_colour: share(widths.len()),
            by_depth: share(edges.len() - widths.len()),
            held: share(held),
            unseen: share(steps - held - edges.len()),
        };
        let edge_width_px = median(&mut widths).unwrap_or(0.0);
        if edges.len() < MIN_OUTLINE_POINTS {
            return TaughtOutline { edge_width_px, evidence: seen, ..TaughtOutline::empty() };
        }
        let points = (0..edges.len()).filter_map(|k| looked.point(&edges, k)).collect();
        TaughtOutline { points, edge_width_px, evidence: seen }
    }

    fn empty() -> TaughtOutline {
        let seen = OutlineEvidence { by_colour: 0.0, by_depth: 0.0, held: 0.0, unseen: 1.0 };
        TaughtOutline { points: Vec::new(), edge_width_px: 0.0, evidence: seen }
    }
}

impl OutlineContext<'_> {
    /// Returns the mean position of the contour around a point, and the unit vector in the picture that points off the
    /// panel there.
    fn contour_position_and_normal(&self, k: usize) -> Option<(Pixel, Vector2<f64>)> {
        let contour = &self.panel.outline_px;
        let count = contour.len();
        let mean = |from: usize, length: usize| {
            let sum =
                (from..from + length).map(|i| contour[i % count]).fold([0.0; 2], |s, p| [s[0] + p.u, s[1] + p.v]);
            sum.map(|sum| sum / length as f64)
        };
        let from = k + count - CONTOUR_REACH_PX;
        let [u, v] = mean(from, 2 * CONTOUR_REACH_PX + 1);
        let (before, after) = (mean(from, CONTOUR_REACH_PX), mean(k + 1, CONTOUR_REACH_PX));
        let (du, dv) = (after[0] - before[0], after[1] - before[1]);
        let length = du.hypot(dv);
        // On a screen, v increases downwards, and the inside of a clockwise contour is to the right: the outward
        // direction is (t_v, −t_u).
        let outward = || Vector2::new(self.side * dv / length, -self.side * du / length);
        (length > 1e-6).then(|| (Pixel::at(u, v), outward()))
    }

    /// Finds the edge beside a point of the contour, on the surface. `None` if no surface was measured there, or if
    /// neither colour nor depth shows an edge at a line that a person drew.
    fn edge(&self, k: usize) -> Option<EdgePoint> {
        let (middle, outward) = self.contour_position_and_normal(k)?;
        let (offset_px, width_px) = match &self.scan {
            None => self.border_edge_distance(middle, outward),
            Some(scan) => self.line_edge_distance(scan, middle, outward)?,
        };
        let pixel = Pixel::at(middle.u + offset_px * outward.x, middle.v + offset_px * outward.y);
        let (point, normal) = self.surface_point(pixel)?;
        Some(EdgePoint { point, normal, width_px })
    }

    fn surface_point(&self, pixel: Pixel) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let ray = self.panel.camera.unproject::<Camera>(pixel)?.mm;
        let (depth_mm, normal) = self.surface.extrapolate(self.grid, pixel)?;
        Some((ray * depth_mm, normal))
    }

    fn step(&self, middle: Pixel, outward: Vector2<f64>, expected_px: f64) -> Option<edges::BrightnessStep> {
        let line = edges::line(&self.panel.scan, middle, [outward.x, outward.y])?;
        edges::step(&line, expected_px)
    }

    /// Returns the distance from the border of the scanned points outwards to the edge, px, and the width of the edge
    /// if colour shows it.
    fn border_edge_distance(&self, middle: Pixel, outward: Vector2<f64>) -> (f64, Option<f64>) {
        let step = self.step(middle, outward, MASK_INSET_PX);
        (step.map_or(MASK_INSET_PX, |step| step.offset_px), step.map(|step| step.width_px))
    }

    /// Returns the distance from a line that a person drew outwards to the edge beside it in the scan, px, and the
    /// width of the edge if colour shows it.
    fn line_edge_distance(
        &self,
        scan: &ColoredCloud,
        middle: Pixel,
        outward: Vector2<f64>,
    ) -> Option<(f64, Option<f64>)> {
        let (point, normal) = self.surface_point(middle)?;
        match edges::find_edge(&self.panel.camera, scan, (middle, outward), (&point, &normal)) {
            EdgeReading::Colour { offset_px, width_px } => Some((offset_px, Some(width_px))),
            EdgeReading::Depth { offset_px } => Some((offset_px, None)),
            // If another object continues in the plane of the panel, depth shows no edge, but colour may show one.
            EdgeReading::Absent => {
                self.step(middle, outward, 0.0).map(|step| (step.offset_px, Some(step.width_px)))
            }
            EdgeReading::Hidden | EdgeReading::OutOfView => None,
        }
    }

    /// Returns the outline point at an edge, with its directions; `None` if the neighbours do not determine them.
    fn point(&self, edges: &[EdgePoint], k: usize) -> Option<OutlinePoint> {
        let count = edges.len();
        let EdgePoint { point: here, normal, width_px } = edges[k];
        let mean = |from: usize| {
            (from..from + DIRECTION_POINT_COUNT).map(|i| edges[i % count].point).sum::<Vector3<f64>>()
                / DIRECTION_POINT_COUNT as f64
        };
        let along = mean(k + 1) - mean(k + count - DIRECTION_POINT_COUNT);
        let (next, last) = (edges[(k + 1) % count].point, edges[(k + count - 1) % count].point);
        let apart_mm = ((next - here).norm() + (last - here).norm()) / 2.0;
        let along = (along - normal * normal.dot(&along)).try_normalize(1e-9)?;
        // In the camera frame, y also points down, so the side is the same.
        let outward = along.cross(&normal) * -self.side;
        let panel_from_camera = MatrixTransform::from_rigid(&self.panel.panel_from_camera);
        let turned = |direction: Vector3<f64>| panel_from_camera.turn * direction;
        Some(OutlinePoint {
            point: panel_from_camera.point(&here),
            outline_direction: turned(along),
            normal: turned(normal),
            outward_direction: turned(outward),
            length_mm: apart_mm.min(10.0),
            by_colour: width_px.is_some(),
        })
    }
}
