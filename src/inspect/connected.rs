//! Neighbouring pixels of a window, and the connected pieces of what holds there.

use super::footprint::Window;
use crate::geometry::Mask;

/// The connected pieces of a mask, as indices of its pixels.
pub fn pieces_of(mask: &Mask) -> Vec<Vec<usize>> {
    let window = Window { left: 0, top: 0, width: mask.width, height: mask.height };
    components(&window, |index| mask.inside[index], &AROUND)
}

/// The four next ones …
pub const BESIDE: [(isize, isize); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
/// … and the eight.
pub const AROUND: [(isize, isize); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

/// A pixel's neighbours within the window.
pub fn neighbours<'a>(
    window: &Window,
    index: usize,
    steps: &'a [(isize, isize)],
) -> impl Iterator<Item = usize> + use<'a> {
    let (width, height) = (window.width, window.height);
    let (column, row) = (index % width, index / width);
    steps.iter().filter_map(move |&(right, down)| {
        let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(down)?);
        (column < width && row < height).then_some(row * width + column)
    })
}

/// Whether it lies at the window's edge.
pub fn at_rim(window: &Window, index: usize) -> bool {
    neighbours(window, index, &BESIDE).count() < 4
}

/// The connected pieces of what holds, as indices, by their first pixels.
pub fn components(window: &Window, holds: impl Fn(usize) -> bool, steps: &[(isize, isize)]) -> Vec<Vec<usize>> {
    let mut seen = vec![false; window.width * window.height];
    let mut found = Vec::new();
    for first in 0..seen.len() {
        if seen[first] || !holds(first) {
            continue;
        }
        seen[first] = true;
        let mut piece = vec![first];
        let mut at = 0;
        while let Some(&index) = piece.get(at) {
            at += 1;
            for next in neighbours(window, index, steps) {
                if !seen[next] && holds(next) {
                    seen[next] = true;
                    piece.push(next);
                }
            }
        }
        found.push(piece);
    }
    found
}
