//! From pixels that broke to places that broke, once the film is over.
//!
//! What looked dry at the end, though not long enough, belongs to the break that it touches. A few pixels alone are noise;
//! a place no larger than a glint's rim that was open for some seconds alone was one that lingered. A small wet place
//! within a break is a bead of water on grease, no film: it belongs to the break.

use super::film::NEVER;
use super::footprint::Window;
use crate::geometry::Mask;
use std::collections::VecDeque;

/// Fewer connected pixels are noise.
const MIN_PIECE_PX: usize = 4;
/// A glint that lingers at one place is gone after this time, s, the time to notice it included.
const GLINT_S: f32 = 5.0;

/// What is known of the window's pixels besides when they broke.
pub struct Seen<'a> {
    /// Since when a pixel that did not break has looked dry, s.
    pub looks_dry_since_s: &'a dyn Fn(usize) -> Option<f32>,
    /// How long a pixel that broke was open, s, where it closed again.
    pub was_open_s: &'a dyn Fn(usize) -> Option<f32>,
    /// The region.
    pub inside: &'a [bool],
    /// The largest glint and the largest bead, px.
    pub small_px: usize,
}

/// When each pixel of the window broke, s; [`NEVER`] where its film holds.
pub fn settled(window: &Window, broke_s: Vec<f32>, seen: &Seen<'_>) -> Vec<f32> {
    let Seen { inside, small_px, .. } = *seen;
    let mut broke_s = broke_s;
    grow(window, &mut broke_s, seen.looks_dry_since_s);
    let pieces = components(window, |i| broke_s[i] < NEVER, &AROUND);
    let was_glint = |piece: &Vec<usize>| {
        let gone = |&i: &usize| (seen.was_open_s)(i).is_some_and(|open_s| open_s < GLINT_S);
        piece.len() <= small_px && piece.iter().all(gone)
    };
    for noise in pieces.iter().filter(|piece| piece.len() < MIN_PIECE_PX || was_glint(piece)) {
        noise.iter().for_each(|&i| broke_s[i] = NEVER);
    }
    for wet in components(window, |i| broke_s[i] == NEVER, &BESIDE) {
        let enclosed = wet.len() <= small_px && wet.iter().all(|&i| inside[i] && !at_rim(window, i));
        if enclosed {
            let rim = wet.iter().flat_map(|&i| neighbours(window, i, &BESIDE)).map(|i| broke_s[i]);
            let closed_in_s = rim.filter(|time_s| *time_s < NEVER).fold(0.0, f32::max);
            wet.iter().for_each(|&i| broke_s[i] = closed_in_s);
        }
    }
    broke_s
}

/// The connected pieces of a mask, as indices of its pixels.
pub fn pieces_of(mask: &Mask) -> Vec<Vec<usize>> {
    let window = Window { left: 0, top: 0, width: mask.width, height: mask.height };
    components(&window, |index| mask.inside[index], &AROUND)
}

fn grow(window: &Window, broke_s: &mut [f32], looks_dry_since_s: impl Fn(usize) -> Option<f32>) {
    let mut rim: VecDeque<usize> = (0..broke_s.len()).filter(|&i| broke_s[i] < NEVER).collect();
    while let Some(index) = rim.pop_front() {
        for next in neighbours(window, index, &AROUND) {
            if broke_s[next] == NEVER
                && let Some(since_s) = looks_dry_since_s(next)
            {
                broke_s[next] = since_s;
                rim.push_back(next);
            }
        }
    }
}

const BESIDE: [(isize, isize); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
const AROUND: [(isize, isize); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];

fn neighbours<'a>(
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

fn at_rim(window: &Window, index: usize) -> bool {
    neighbours(window, index, &BESIDE).count() < 4
}

fn components(window: &Window, holds: impl Fn(usize) -> bool, steps: &[(isize, isize)]) -> Vec<Vec<usize>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window { left: 0, top: 0, width: 8, height: 6 };

    fn times(rows: [&str; 6]) -> Vec<f32> {
        rows.iter()
            .flat_map(|row| row.bytes())
            .map(|b| if b == b'.' { NEVER } else { f32::from(b - b'0') })
            .collect()
    }

    #[test]
    fn noise_goes_a_bead_is_filled_and_the_rim_joins() {
        let broke = times(["........", ".1111..7", ".1.21...", ".1111...", "........", "77......"]);
        let late = |i: usize| (i == 8 + 5).then_some(9.0);
        let expected = times(["........", ".11119..", ".1221...", ".1111...", "........", "........"]);
        let seen = |late, open, small_px| Seen {
            looks_dry_since_s: late,
            was_open_s: open,
            inside: &[true; 48],
            small_px,
        };
        assert_eq!(settled(&WINDOW, broke.clone(), &seen(&late, &|_| None, 1)), expected);
        let without_filling = settled(&WINDOW, broke.clone(), &seen(&|_| None, &|_| None, 0));
        assert_eq!(without_filling[2 * 8 + 2], NEVER);
        // Eleven pixels that were open for 4 s: a glint where it may be as large as that, a break where not.
        for (small_px, left) in [(11, 0), (10, 12)] {
            let found = settled(&WINDOW, broke.clone(), &seen(&|_| None, &|_| Some(4.0), small_px));
            assert_eq!(found.iter().filter(|time_s| **time_s < NEVER).count(), left, "{small_px}");
        }
        let long = settled(&WINDOW, broke, &seen(&|_| None, &|_| Some(6.0), 11));
        assert_eq!(long.iter().filter(|time_s| **time_s < NEVER).count(), 12);
    }
}
