//! The pieces of the scan in the search box, which are its connected smooth components, and the distance of each block
//! of pixels from their border.
//!
//! Neighbouring blocks belong to one piece if their depths do not jump. A border of a piece is a true border if the
//! scan shows a surface farther away, or no point, beyond it. It is not a true border if a nearer object occludes the
//! continuation, if the picture ends there, or if missing points divide a piece that may have holes. The nearest true
//! border of every block is computed by two sweeps over the picture (8SSED: Danielsson, Comput. Graph. Image Process.
//! 14, 1980).

use super::grid::{Grid, MatrixTransform};
use nalgebra::{Matrix3, Vector3};
use panelprep_base::geometry::{DIRECT_NEIGHBOURS, RasterSize};

/// Minimum number of blocks of a piece; a smaller one is a speck.
pub(super) const MIN_BLOCKS: usize = 40;
/// Distance beyond the border up to which depths are compared, blocks: pixels beside the border have no depth or are
/// flying pixels.
const DEPTH_COMPARISON_BLOCKS: isize = 3;
/// Maximum distance between an outline point and a border, and between a mark and a step of brightness, for the two to
/// match, blocks.
pub(super) const MAX_BORDER_DISTANCE_BLOCKS: f64 = 1.8;
/// Maximum width of a patch of missing points, blocks.
const MAX_HOLE_BLOCKS: isize = 80;
const NONE: u32 = u32::MAX;

/// A connected smooth component of the scan.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// Indices of the blocks of the piece.
    pub blocks: Vec<u32>,
    /// The centre of the piece in the camera frame, mm.
    pub centre: Vector3<f64>,
    /// The direction in which the points of the piece scatter least, towards the camera.
    pub normal: Vector3<f64>,
    /// Area of the piece, mm².
    pub area_mm2: f64,
    /// Half of the diagonal of the piece's extent, mm.
    pub reach_mm: f64,
}

/// Returns the pieces among these blocks, the largest first.
pub(super) fn find_pieces(grid: &Grid, inside: &[bool]) -> Vec<Piece> {
    let raster = RasterSize { width: grid.columns, height: grid.rows };
    let joined = |here: usize, there: usize| {
        let depths = grid.depth_mm(here).zip(grid.depth_mm(there));
        depths.is_some_and(|(here_mm, there_mm)| grid.are_joined(here_mm, there_mm))
    };
    let pieces = raster.joined_components(&DIRECT_NEIGHBOURS, |block| inside[block], joined);
    let large = pieces.into_iter().filter(|blocks| blocks.len() >= MIN_BLOCKS);
    let of = |blocks: Vec<usize>| Piece::from_blocks(grid, blocks.into_iter().map(|block| block as u32).collect());
    let mut found: Vec<Piece> = large.filter_map(of).collect();
    found.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    found
}

impl Piece {
    fn from_blocks(grid: &Grid, blocks: Vec<u32>) -> Option<Piece> {
        let stride = (blocks.len() / 600).max(1);
        let at = |&block: &u32| grid.point(block as usize % grid.columns, block as usize / grid.columns);
        let points: Vec<Vector3<f64>> = blocks.iter().step_by(stride).filter_map(at).collect();
        let (centre, axis) = centroid_and_normal(&points)?;
        let normal = if axis.dot(&centre) > 0.0 { -axis } else { axis };
        let block_rad2 = (grid.factor * grid.factor) as f64 / (grid.camera.fx_px * grid.camera.fy_px);
        let area = |point: &Vector3<f64>| {
            let slant = (-normal.dot(point) / point.norm()).max(0.15);
            point.z * point.z * block_rad2 / slant * (point.z / point.norm())
        };
        let area_mm2 = points.iter().map(area).sum::<f64>() / points.len() as f64 * blocks.len() as f64;
        let reach_mm = points.iter().map(|point| (point - centre).norm()).fold(0.0, f64::max);
        Some(Piece { blocks, centre, normal, area_mm2, reach_mm })
    }

    /// Joins several pieces into one.
    pub fn join(grid: &Grid, pieces: &[&Piece]) -> Option<Piece> {
        Piece::from_blocks(grid, pieces.iter().flat_map(|piece| piece.blocks.iter().copied()).collect())
    }
}

/// The nearest true border of a piece, for every block.
pub(super) struct Border {
    columns: usize,
    rows: usize,
    nearest: Vec<u32>,
}

impl Border {
    /// Finds the border of a piece, which may have holes where points are missing.
    pub fn from_piece(grid: &Grid, piece: &Piece, may_have_holes: bool) -> Border {
        let (columns, rows) = (grid.columns, grid.rows);
        let mut inside = vec![false; columns * rows];
        for &block in &piece.blocks {
            inside[block as usize] = true;
        }
        let blocks = piece.blocks.iter().map(|&block| block as usize);
        Border::to_blocks(grid, blocks.filter(|&block| is_true_border(grid, &inside, block, may_have_holes)))
    }

    /// Creates a map of the nearest of these blocks, which are used instead of the border of a piece.
    pub fn to_blocks(grid: &Grid, blocks: impl Iterator<Item = usize>) -> Border {
        let (columns, rows) = (grid.columns, grid.rows);
        let mut nearest = vec![NONE; columns * rows];
        blocks.for_each(|block| nearest[block] = block as u32);
        let mut border = Border { columns, rows, nearest };
        border.sweep_distances();
        border
    }

    fn sweep_distances(&mut self) {
        let (columns, rows) = (self.columns, self.rows);
        for row in 0..rows {
            for column in 0..columns {
                for (i, j) in [(-1, 0), (0, -1), (-1, -1), (1, -1)] {
                    self.relax_distance(column, row, i, j);
                }
            }
            for column in (0..columns).rev() {
                self.relax_distance(column, row, 1, 0);
            }
        }
        for row in (0..rows).rev() {
            for column in (0..columns).rev() {
                for (i, j) in [(1, 0), (0, 1), (1, 1), (-1, 1)] {
                    self.relax_distance(column, row, i, j);
                }
            }
            for column in 0..columns {
                self.relax_distance(column, row, -1, 0);
            }
        }
    }

    fn relax_distance(&mut self, column: usize, row: usize, i: isize, j: isize) {
        let (x, y) = (column as isize + i, row as isize + j);
        if x < 0 || y < 0 || x >= self.columns as isize || y >= self.rows as isize {
            return;
        }
        let candidate = self.nearest[y as usize * self.columns + x as usize];
        if candidate == NONE {
            return;
        }
        let here = row * self.columns + column;
        let square = |block: u32| {
            let (u, v) = (block as usize % self.columns, block as usize / self.columns);
            let (du, dv) = (u as i64 - column as i64, v as i64 - row as i64);
            du * du + dv * dv
        };
        if self.nearest[here] == NONE || square(candidate) < square(self.nearest[here]) {
            self.nearest[here] = candidate;
        }
    }

    /// Returns the vector from a position of the grid to the nearest true border, blocks; `None` outside of the
    /// picture, or without a border.
    pub fn vector_to_border(&self, place: [f64; 2]) -> Option<[f64; 2]> {
        Some(self.nearest(place)?.1)
    }

    /// Returns the block of the nearest true border, and the vector to this block.
    pub fn nearest(&self, [x, y]: [f64; 2]) -> Option<(usize, [f64; 2])> {
        let (column, row) = (x.round(), y.round());
        let inside = column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        let nearest = inside.then(|| self.nearest[row as usize * self.columns + column as usize])?;
        (nearest != NONE).then(|| {
            let nearest = nearest as usize;
            (nearest, [(nearest % self.columns) as f64 - x, (nearest / self.columns) as f64 - y])
        })
    }
}

/// Returns whether points are missing in this direction, with the same piece beyond them.
fn is_hole_boundary(
    grid: &Grid,
    inside: &[bool],
    at: &dyn Fn(isize, isize) -> Option<usize>,
    (i, j): (isize, isize),
) -> bool {
    let places = (1..=MAX_HOLE_BLOCKS).map_while(|far| at(i * far, j * far));
    places.into_iter().find(|&place| grid.depth_mm(place).is_some()).is_some_and(|met| inside[met])
}

/// Returns whether a block is on the border of the piece, with a farther object or no point beyond the border.
fn is_true_border(grid: &Grid, inside: &[bool], block: usize, may_have_holes: bool) -> bool {
    let (column, row) = ((block % grid.columns) as isize, (block / grid.columns) as isize);
    let Some(here_mm) = grid.depth_mm(block) else { return false };
    let at = |i: isize, j: isize| {
        let (x, y) = (column + i, row + j);
        let valid = x >= 0 && y >= 0 && x < grid.columns as isize && y < grid.rows as isize;
        valid.then(|| y as usize * grid.columns + x as usize)
    };
    let mut border = false;
    for (i, j) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
        match at(i, j) {
            Some(beside) if inside[beside] => continue,
            None => return false,
            Some(_) => {}
        }
        // A nearer object within this distance beyond the border hides the continuation of the surface.
        let nearer = (1..=DEPTH_COMPARISON_BLOCKS).filter_map(|far| at(i * far, j * far)).any(|beyond| {
            !inside[beyond] && grid.depth_mm(beyond).is_some_and(|z| z < here_mm && !grid.are_joined(here_mm, z))
        });
        if nearer {
            return false;
        }
        border |= !(may_have_holes && is_hole_boundary(grid, inside, &at, (i, j)));
    }
    border
}

/// Returns a selection of a piece's points.
pub(super) fn points<'a>(
    grid: &'a Grid,
    piece: &'a Piece,
    stride: usize,
) -> impl Iterator<Item = Vector3<f64>> + 'a {
    piece
        .blocks
        .iter()
        .step_by(stride.max(1))
        .filter_map(|&block| grid.point(block as usize % grid.columns, block as usize / grid.columns))
}

/// Returns the position of a point in the grid of another view; `None` if the point is behind that camera.
pub(super) fn grid_position_in(
    grid: &Grid,
    motion: &MatrixTransform,
    point: &Vector3<f64>,
) -> Option<(Vector3<f64>, [f64; 2])> {
    let there = motion.point(point);
    let pixel = grid.camera.project(super::grid::camera_point(&there))?;
    Some((there, grid.block_position(pixel)))
}

/// Returns the centroid of the points and the direction in which they scatter least; `None` without points.
pub(super) fn centroid_and_normal(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, Vector3<f64>)> {
    if points.is_empty() {
        return None;
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    Some((mean, eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()))
}
