//! Finds breaks: the connected pieces of the broken film, each with its contour (thesis Fig. 4.17).

use super::film::NOT_BROKEN;
use super::footprint::Footprint;
use panelprep_base::geometry::{Mask, Pixel};
use panelprep_cell::imaging::{self, ImagingError, outer_contours};
use panelprep_cell::panel::GridId;

/// One connected piece of broken film.
#[derive(Debug, Clone)]
pub struct Break {
    /// Its surface, mm².
    pub area_mm2: f64,
    /// Time at which the first pixel of the break broke, s after the first fully wet picture.
    pub first_seen_s: f64,
    /// The fraction of the break over which the film had closed again at the end, 0…1.
    pub closed_share: f64,
    /// The grids in which the break lies, row by row.
    pub grids: Vec<GridId>,
    /// The outer contour of the break in the picture, px.
    pub contour_px: Vec<Pixel>,
}

/// A break counts as closed again if at least this fraction of its area is closed.
const CLOSED_SHARE: f64 = 0.8;

impl Break {
    /// Returns whether the film had closed over the break again at the end.
    pub fn has_closed_again(&self) -> bool {
        self.closed_share >= CLOSED_SHARE
    }
}

/// Returns the breaks of a window, largest first. A piece without any surface is not a break.
pub fn breaks(
    footprint: &Footprint,
    since_wet_s: &[f32],
    is_closed: impl Fn(usize) -> bool,
) -> Result<Vec<Break>, ImagingError> {
    let window = footprint.window();
    let inside = since_wet_s.iter().map(|&time| time < NOT_BROKEN).collect();
    let pieces = imaging::connected_pieces(&Mask { width: window.width, height: window.height, inside }, true)?;
    let mut breaks = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let mut area_mm2 = vec![0.0; footprint.grids().len()];
        piece.iter().for_each(|&index| footprint.add_area(index, &mut area_mm2));
        let touched = footprint.grids().iter().zip(&area_mm2).filter(|(_, area)| **area > 0.0);
        breaks.push(Break {
            area_mm2: area_mm2.iter().sum(),
            first_seen_s: piece.iter().map(|&index| since_wet_s[index]).fold(NOT_BROKEN, f32::min).into(),
            closed_share: piece.iter().filter(|&&index| is_closed(index)).count() as f64 / piece.len() as f64,
            grids: touched.map(|(grid, _)| grid.id).collect(),
            contour_px: contour(footprint, piece)?,
        });
    }
    breaks.retain(|found| found.area_mm2 > 0.0);
    breaks.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    Ok(breaks)
}

/// Returns the outer contour of a single piece. If all pieces were traced together, a piece in the hole of another
/// piece would have no outer contour.
fn contour(footprint: &Footprint, piece: &[usize]) -> Result<Vec<Pixel>, ImagingError> {
    let places = || piece.iter().map(|&index| footprint.pixel_position(index));
    let (left, right) = min_and_max(places().map(|(column, _)| column));
    let (top, bottom) = min_and_max(places().map(|(_, row)| row));
    let mut mask = Mask::all_outside(right - left + 1, bottom - top + 1);
    for (column, row) in places() {
        mask.inside[(row - top) * mask.width + column - left] = true;
    }
    let outer = outer_contours(&mask)?.into_iter().next().unwrap_or_default();
    Ok(outer.into_iter().map(|pixel| Pixel::at(pixel.u + left as f64, pixel.v + top as f64)).collect())
}

fn min_and_max(values: impl Iterator<Item = usize>) -> (usize, usize) {
    values.fold((usize::MAX, 0), |(low, high), value| (low.min(value), high.max(value)))
}
