//! The steps of brightness in a picture that may be borders of marks. Returns the steepest step of a cell, and the
//! vector from any position of a scan to the nearest step.

use super::grid::{ColoredCloud, Grid};
use super::pieces::{Border, Piece};
use super::profile::pixel_gray;
use nalgebra::Vector2;
use panelprep_base::geometry::{Frame, OrganizedCloud};

/// The brightness at this distance to both sides is compared to find the steepest change, px. Only pixels spaced by
/// the second constant are examined.
const COMPARISON_DISTANCE_PX: usize = 2;
const STEP_PX: usize = 2;
/// Directions that differ by more than this angle belong to two different borders: cosine.
const MIN_DIRECTION_COSINE: f64 = 0.7;

/// The steepest change of brightness of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steepest {
    /// Column and row of the steepest change, px.
    pub position: [usize; 2],
    /// The change of brightness there over twice [`COMPARISON_DISTANCE_PX`], grey levels.
    pub levels: f64,
    /// The direction towards the brighter side, of length 1.
    pub brighter_direction: Vector2<f64>,
}

/// Returns the steepest change of a cell with this corner and side, px; `None` if nothing changes, or the cell lies at
/// the picture's rim.
pub(super) fn steepest_change<F: Frame>(
    scan: &OrganizedCloud<F>,
    [left, top]: [usize; 2],
    side_px: usize,
) -> Option<Steepest> {
    let is_within = |from: usize, length: usize| {
        from >= COMPARISON_DISTANCE_PX && from + side_px + COMPARISON_DISTANCE_PX <= length
    };
    if !(is_within(left, scan.width()) && is_within(top, scan.height())) {
        return None;
    }
    let mut steepest: Option<Steepest> = None;
    for row in (top..top + side_px).step_by(STEP_PX) {
        for column in (left..left + side_px).step_by(STEP_PX) {
            let across = pixel_gray(scan, column + COMPARISON_DISTANCE_PX, row)
                - pixel_gray(scan, column - COMPARISON_DISTANCE_PX, row);
            let down = pixel_gray(scan, column, row + COMPARISON_DISTANCE_PX)
                - pixel_gray(scan, column, row - COMPARISON_DISTANCE_PX);
            let levels = across.hypot(down);
            if levels > steepest.map_or(0.0, |steepest| steepest.levels) {
                steepest = Some(Steepest {
                    position: [column, row],
                    levels,
                    brighter_direction: Vector2::new(across, down) / levels,
                });
            }
        }
    }
    steepest
}

/// The nearest step of brightness for each block of a scan.
pub(super) struct MarkSteps {
    nearest: Border,
    brighter_direction: Vec<Option<Vector2<f64>>>,
}

impl MarkSteps {
    /// Finds the steps of at least this many grey levels in the rectangle that these pieces span.
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

    /// Returns the vector from a position of the grid to the nearest step, blocks, if this step becomes brighter in
    /// this direction; otherwise `None`.
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

    /// By hand: dark up to and including column 31, bright beyond it. Brightness is compared over two pixels to each
    /// side, so that columns 30 to 33 have the step. A position in column 20 is ten blocks from the step; it is found
    /// only for the direction towards the brighter side.
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
