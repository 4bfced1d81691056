//! The steps of brightness in a picture that may be borders of marks: the steepest of a cell, and from any place of a scan the way to
//! the nearest.

use super::grid::{Grid, Scan};
use super::pieces::{Border, Piece};
use super::profile::gray;
use crate::geometry::{Frame, OrganizedCloud};
use nalgebra::Vector2;

/// Brightness is compared over this distance to find the steepest change, px, and only that pixels apart.
const APART_PX: usize = 2;
const EVERY_PX: usize = 2;
/// Directions that differ by more than this are two borders: cosine.
const SAME_DIRECTION: f64 = 0.7;

/// The steepest change of brightness of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steepest {
    /// Column and row, px.
    pub at: [usize; 2],
    /// By how much brightness changes there over twice [`APART_PX`], grey levels.
    pub levels: f64,
    /// The direction towards what is brighter, of length 1.
    pub brighter: Vector2<f64>,
}

/// That of a cell with this corner and side, px; `None` where nothing changes, or the cell lies at the picture's rim.
pub(super) fn steepest<F: Frame>(
    scan: &OrganizedCloud<F>,
    [left, top]: [usize; 2],
    side_px: usize,
) -> Option<Steepest> {
    let is_within = |from: usize, length: usize| from >= APART_PX && from + side_px + APART_PX <= length;
    if !(is_within(left, scan.width()) && is_within(top, scan.height())) {
        return None;
    }
    let mut steepest: Option<Steepest> = None;
    for row in (top..top + side_px).step_by(EVERY_PX) {
        for column in (left..left + side_px).step_by(EVERY_PX) {
            let across = gray(scan, column + APART_PX, row) - gray(scan, column - APART_PX, row);
            let down = gray(scan, column, row + APART_PX) - gray(scan, column, row - APART_PX);
            let levels = across.hypot(down);
            if levels > steepest.map_or(0.0, |steepest| steepest.levels) {
                steepest =
                    Some(Steepest { at: [column, row], levels, brighter: Vector2::new(across, down) / levels });
            }
        }
    }
    steepest
}

/// From each block of a scan the nearest step of brightness.
pub(super) struct MarkSteps {
    nearest: Border,
    brighter: Vec<Option<Vector2<f64>>>,
}

impl MarkSteps {
    /// Those of at least so many grey levels in the rectangle that a piece spans.
    pub fn of(scan: &Scan, grid: &Grid, piece: &Piece, least_levels: f64) -> MarkSteps {
        let place = |block: &u32| [*block as usize % grid.columns, *block as usize / grid.columns];
        let spans = |axis: usize| {
            let along = || piece.blocks.iter().map(|block| place(block)[axis]);
            along().min().zip(along().max())
        };
        let mut brighter = vec![None; grid.columns * grid.rows];
        if let Some(((left, right), (top, bottom))) = spans(0).zip(spans(1)) {
            for (row, column) in (top..=bottom).flat_map(|row| (left..=right).map(move |column| (row, column))) {
                brighter[row * grid.columns + column] =
                    steepest(scan, [column * grid.factor, row * grid.factor], grid.factor)
                        .filter(|steepest| steepest.levels >= least_levels)
                        .map(|steepest| steepest.brighter);
            }
        }
        let steps = (0..brighter.len()).filter(|&block| brighter[block].is_some());
        MarkSteps { nearest: Border::to_blocks(grid, steps), brighter }
    }

    /// From a place of the grid to the nearest of them, blocks, where it becomes brighter in this direction; `None` where it does not.
    pub fn way(&self, place: [f64; 2], brighter: &Vector2<f64>) -> Option<[f64; 2]> {
        let (block, way) = self.nearest.nearest(place)?;
        self.brighter[block]?.dot(brighter).ge(&SAME_DIRECTION).then_some(way)
    }
}
