//! The marks of the panel: printed, painted or bright areas inside its outline, found by the brightness steps at their
//! borders.
//!
//! A flat panel can slide along its surface. If its outline is held, hidden or without points, only the marks printed
//! on the panel constrain it sideways. The taught picture is searched cell by cell for the steepest change of
//! brightness. If this change is a step between two uniform levels, its position is measured to a fraction of a pixel
//! (`edges`) and projected onto the surface. The weave of a composite has too little contrast for a mark.
//!
//! For the search in a scan, [`MarkSteps`] contains the steps of brightness that may be borders of marks. It returns
//! the vector from any position of a scan to the nearest step.

use super::edges;
use super::edges::{HALF_LENGTH_PX, POSITION_COUNT, pixel_gray};
use super::grid::{ColoredCloud, Grid, MatrixTransform};
use super::pieces::{Border, Piece};
use super::taught_outline::Surface;
use nalgebra::{Vector2, Vector3};
use panelprep_base::geometry::{Camera, Frame, OrganizedCloud, Pixel, polygon};
use panelprep_cell::panel::{OutlineFrom, TaughtPanel};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Side of a search cell, px; at most one mark point is found per cell.
const CELL_PX: usize = 8;
/// Minimum difference between the two sides of a mark's border, grey levels: three times the value for an edge of the
/// outline, and far above that of a weave.
const MIN_CONTRAST: f64 = 40.0;
/// Minimum fraction of a step's contrast that lies between the two pixels that [`steepest_change`] compares.
const MIN_STEP_FRACTION: f64 = 0.35;
/// Minimum change of brightness at the border of a mark, grey levels.
pub(super) const MIN_STEP_LEVELS: f64 = MIN_STEP_FRACTION * MIN_CONTRAST;
/// Minimum distance between a mark and a holder, px: a nearer mark gives no information about the panel.
const MIN_HELD_DISTANCE_PX: f64 = POSITION_COUNT as f64;

/// A point on the border of a mark.
#[derive(Debug, Clone, Copy)]
pub(super) struct MarkPoint {
    /// Position of the point in the panel frame, mm.
    pub point: Vector3<f64>,
    /// Unit vector along the border.
    pub border_direction: Vector3<f64>,
    /// Unit vector in the surface towards the brighter side.
    pub brighter_direction: Vector3<f64>,
    /// Normal of the surface at the point.
    pub normal: Vector3<f64>,
    /// Length of border that this point represents, mm.
    pub length_mm: f64,
}

/// All marks of a panel.
#[derive(Debug, Clone, Default)]
pub(super) struct TaughtMarks {
    pub points: Vec<MarkPoint>,
    /// Mean number of mark points with a common error.
    pub correlated_count: f64,
}

impl TaughtMarks {
    /// Detects the marks of a taught panel with these depths and this surface. `alike_mm` is the correlation length of
    /// the errors, mm; the largest error of a mark is that of its depth in the taught scan.
    pub fn detect(panel: &TaughtPanel, (grid, surface): (&Grid, &Surface), alike_mm: f64) -> TaughtMarks {
        let (columns, rows) = (panel.scan.width() / CELL_PX, panel.scan.height() / CELL_PX);
        let search = MarkSearch {
            panel,
            grid,
            surface,
            panel_from_camera: MatrixTransform::from_rigid(&panel.panel_from_camera),
        };
        let points: Vec<MarkPoint> = (0..columns * rows)
            .into_par_iter()
            .with_min_len(512)
            .filter_map(|cell| search.find_mark([cell % columns * CELL_PX, cell / columns * CELL_PX]))
            .collect();
        let cube = |mark: &MarkPoint| [0, 1, 2].map(|axis| (mark.point[axis] / alike_mm).floor() as i64);
        let cubes: BTreeSet<[i64; 3]> = points.iter().map(cube).collect();
        let correlated_count = (points.len() as f64 / cubes.len().max(1) as f64).max(1.0);
        TaughtMarks { points, correlated_count }
    }
}

struct MarkSearch<'a> {
    panel: &'a TaughtPanel,
    grid: &'a Grid,
    surface: &'a Surface,
    panel_from_camera: MatrixTransform,
}

impl MarkSearch<'_> {
    /// Finds the mark point of the cell that begins at this pixel.
    fn find_mark(&self, [left, top]: [usize; 2]) -> Option<MarkPoint> {
        let (width, height) = (self.panel.scan.width(), self.panel.scan.height());
        let margin = HALF_LENGTH_PX + 1;
        if left < margin || top < margin || left + CELL_PX + margin > width || top + CELL_PX + margin > height {
            return None;
        }
        if !self.is_inside(left + CELL_PX / 2, top + CELL_PX / 2) {
            return None;
        }
        let step = steepest_change(&self.panel.scan, [left, top], CELL_PX)
            .filter(|steepest| steepest.levels >= MIN_STEP_LEVELS)?;
        let [column, row] = step.position;
        self.find_step(Pixel::at(column as f64, row as f64), step.brighter_direction)
    }

    /// Finds the brightness step beside a pixel, in the direction of the brighter side.
    fn find_step(&self, pixel: Pixel, brighter: Vector2<f64>) -> Option<MarkPoint> {
        if !self.is_on_panel(pixel, brighter) || self.panel.is_held_near(pixel, MIN_HELD_DISTANCE_PX) {
            return None;
        }
        let line = edges::line(&self.panel.scan, pixel, [brighter.x, brighter.y])?;
        let step = edges::step(&line, 0.0).filter(|step| step.contrast >= MIN_CONTRAST)?;
        let pixel = Pixel::at(pixel.u + step.offset_px * brighter.x, pixel.v + step.offset_px * brighter.y);
        let ray = |pixel: Pixel| Some(self.panel.camera.unproject::<Camera>(pixel)?.mm);
        let (depth_mm, normal) = self.surface.extrapolate(self.grid, pixel)?;
        let here = ray(pixel)? * depth_mm;
        // Returns the direction from this point to a neighbouring pixel, in the plane of the surface.
        let beside = |du: f64, dv: f64| {
            let ray = ray(Pixel::at(pixel.u + du, pixel.v + dv))?;
            (ray * (normal.dot(&here) / normal.dot(&ray)) - here).try_normalize(1e-12)
        };
        let along = beside(-brighter.y, brighter.x)?;
        let towards = beside(brighter.x, brighter.y)?;
        let brighter = (towards - along * along.dot(&towards)).try_normalize(1e-9)?;
        let (px_per_mm, _) = self.panel.camera.px_per_mm_at(here.z);
        let turn = &self.panel_from_camera.turn;
        Some(MarkPoint {
            point: self.panel_from_camera.point(&here),
            border_direction: turn * along,
            brighter_direction: turn * brighter,
            normal: turn * normal,
            length_mm: CELL_PX as f64 / px_per_mm,
        })
    }

    /// Returns whether both ends of the line are on the panel; otherwise the edge of the panel could be mistaken for a
    /// mark.
    fn is_on_panel(&self, pixel: Pixel, across: Vector2<f64>) -> bool {
        let (width, height) = (self.panel.scan.width(), self.panel.scan.height());
        (-(HALF_LENGTH_PX as i32)..=HALF_LENGTH_PX as i32).step_by(4).all(|way| {
            let way = f64::from(way);
            let end = Pixel::at(pixel.u + way * across.x, pixel.v + way * across.y);
            end.nearest_whole(width, height).is_some_and(|(column, row)| self.is_inside(column, row))
        })
    }

    /// Returns whether the pixel is on the panel. If a person drew the outline, points inside of it may be missing, for
    /// example between bright marks on a dark panel. Otherwise a pixel without a point may be a window through which
    /// the background is visible.
    fn is_inside(&self, column: usize, row: usize) -> bool {
        let panel = self.panel;
        panel.mask.contains(column, row)
            || panel.outline_from == OutlineFrom::Recipe
                && panel.scan.point(column, row).is_none()
                && polygon::contains(&panel.outline_px, Pixel::at(column as f64, row as f64))
    }
}

/// Distance to both sides over which brightness is compared to find the steepest change, px. `STEP_PX` is the distance
/// between the examined pixels.
const COMPARISON_DISTANCE_PX: usize = 2;
const STEP_PX: usize = 2;
/// Minimum cosine of the angle between two directions of one border; with a larger angle they belong to two borders.
const MIN_DIRECTION_COSINE: f64 = 0.7;

/// The steepest change of brightness in a cell.
#[derive(Debug, Clone, Copy)]
struct SteepestChange {
    /// Column and row of the steepest change, px.
    pub position: [usize; 2],
    /// Change of brightness at this position over twice [`COMPARISON_DISTANCE_PX`], grey levels.
    pub levels: f64,
    /// Unit vector towards the brighter side.
    pub brighter_direction: Vector2<f64>,
}

/// Returns the steepest change in a cell with this corner and side, px; `None` if the brightness does not change, or if
/// the cell is at the rim of the picture.
fn steepest_change<F: Frame>(
    scan: &OrganizedCloud<F>,
    [left, top]: [usize; 2],
    side_px: usize,
) -> Option<SteepestChange> {
    let is_within = |from: usize, length: usize| {
        from >= COMPARISON_DISTANCE_PX && from + side_px + COMPARISON_DISTANCE_PX <= length
    };
    if !(is_within(left, scan.width()) && is_within(top, scan.height())) {
        return None;
    }
    let mut steepest: Option<SteepestChange> = None;
    for row in (top..top + side_px).step_by(STEP_PX) {
        for column in (left..left + side_px).step_by(STEP_PX) {
            let across = pixel_gray(scan, column + COMPARISON_DISTANCE_PX, row)
                - pixel_gray(scan, column - COMPARISON_DISTANCE_PX, row);
            let down = pixel_gray(scan, column, row + COMPARISON_DISTANCE_PX)
                - pixel_gray(scan, column, row - COMPARISON_DISTANCE_PX);
            let levels = across.hypot(down);
            if levels > steepest.map_or(0.0, |steepest| steepest.levels) {
                steepest = Some(SteepestChange {
                    position: [column, row],
                    levels,
                    brighter_direction: Vector2::new(across, down) / levels,
                });
            }
        }
    }
    steepest
}

/// For each block of a scan, the nearest step of brightness.
pub(super) struct MarkSteps {
    nearest: Border,
    brighter_direction: Vec<Option<Vector2<f64>>>,
}

impl MarkSteps {
    /// Detects the steps of at least this many grey levels in the bounding rectangle of these pieces.
    pub fn detect(scan: &ColoredCloud, grid: &Grid, pieces: &[Piece], least_levels: f64) -> MarkSteps {
        let place = |block: &u32| [*block as usize % grid.columns, *block as usize / grid.columns];
        let spans = |axis: usize| {
            let along = || pieces.iter().flat_map(|piece| &piece.blocks).map(|block| place(block)[axis]);
            along().min().zip(along().max())
        };
        let mut brighter = vec![None; grid.columns * grid.rows];
        if let Some(((left, right), (top, bottom))) = spans(0).zip(spans(1)) {
            for (row, column) in (top..=bottom).flat_map(|row| (left..=right).map(move |column| (row, column))) {
                brighter[row * grid.columns + column] =
                    steepest_change(scan, [column * grid.factor, row * grid.factor], grid.factor)
                        .filter(|steepest| steepest.levels >= least_levels)
                        .map(|steepest| steepest.brighter_direction);
            }
        }
        let steps = (0..brighter.len()).filter(|&block| brighter[block].is_some());
        MarkSteps { nearest: Border::to_blocks(grid, steps), brighter_direction: brighter }
    }

    /// Returns the vector from a position of the grid to the nearest step, blocks; `None` if the brightness of this
    /// step does not increase in the given direction.
    pub fn vector_to_step(&self, place: [f64; 2], brighter: &Vector2<f64>) -> Option<[f64; 2]> {
        let (block, way) = self.nearest.nearest(place)?;
        self.brighter_direction[block]?.dot(brighter).ge(&MIN_DIRECTION_COSINE).then_some(way)
    }
}

#[cfg(test)]
mod tests {
    use super::super::pieces::find_pieces;
    use super::*;
    use panelprep_base::geometry::PinholeCamera;

    const SIDE: usize = 64;

    /// Expected values, calculated by hand: dark up to and including column 31, bright beyond it. Brightness is
    /// compared over two pixels to each side, so columns 30 to 33 contain the step. A position in column 20 is ten
    /// blocks from the step; it is found only for the direction towards the brighter side.
    #[test]
    fn the_nearest_step_is_found_where_it_becomes_brighter() {
        let [fx_px, fy_px, cx_px, cy_px] = [60.0, 60.0, 31.5, 31.5];
        let [k1, k2, p1, p2, k3] = [0.0; 5];
        let camera =
            PinholeCamera { width_px: SIDE, height_px: SIDE, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 };
        let point = |i: usize| {
            let [x, y] = [i % SIDE, i / SIDE].map(|at| (at as f32 - 31.5) / 60.0 * 700.0);
            [x, y, 700.0]
        };
        let color = |i: usize| if i % SIDE < 32 { [40; 3] } else { [200; 3] };
        let all = || 0..SIDE * SIDE;
        let scan =
            ColoredCloud::new(SIDE, SIDE, all().map(point).collect(), all().map(color).collect()).expect("counts");
        let grid = Grid::from_scan(&scan, &camera);
        let found = find_pieces(&grid, &[true; SIDE * SIDE]);
        let steps = MarkSteps::detect(&scan, &grid, &found, 14.0);
        assert_eq!(steps.vector_to_step([20.0, 30.0], &Vector2::new(1.0, 0.0)), Some([10.0, 0.0]));
        assert_eq!(steps.vector_to_step([20.0, 30.0], &Vector2::new(-1.0, 0.0)), None);
        assert_eq!(steps.vector_to_step([40.0, 30.0], &Vector2::new(1.0, 0.0)), Some([-7.0, 0.0]));
        assert_eq!(
            MarkSteps::detect(&scan, &grid, &found, 161.0).vector_to_step([20.0, 30.0], &Vector2::new(1.0, 0.0)),
            None
        );
    }
}
