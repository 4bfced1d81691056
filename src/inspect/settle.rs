//! From broken pixels to broken places, once the film is over.
//!
//! Pixels that looked dry at the end, though not long enough, or long enough beside a glint, belong to the break that they touch.
//! Isolated small groups are noise. A place no larger than a glint must have the dry brightness all over, as a break has: a glint that
//! does not move has a bell-shaped brightness, which equals the dry brightness on a ring alone. A larger place that is uneven and lies
//! along a reflection that does not move is the edge of that reflection, or a break that it covers: it is reported as not seen, and so
//! is one that is more uneven than any break, wherever it lies. A small wet place within a break is a bead of water on grease and not a
//! film; it belongs to the break.

use super::film::NEVER;
use super::footprint::Window;
use crate::geometry::{AROUND, BESIDE};
use std::collections::{BTreeSet, VecDeque};

/// Fewer connected pixels are noise.
const MIN_PIECE_PX: usize = 4;
/// Of what the film takes, so much may be left of it at the brightest tenth of a dry place …
const NEAR_DRY: f32 = 0.2;
/// … and so much may its inner part vary from tenth to tenth; renderings: 0.12 at most, glints and edges of reflections from 0.29 on.
const MAX_UNEVEN: f32 = 0.22;
/// A place that varies by so much is none, wherever it lies; the largest of 131 films in which film darkens was 0.25, of a break, and 0.54
/// and 0.64 at the edges of reflections.
const VERY_UNEVEN: f32 = 0.4;
/// A place lies along a reflection where at least this share of the pixels around it was hidden. Measured on nine rendered films: at most
/// 0.12 around breaks, whose rims mirror lamps, and 0.36 around the one edge of a reflection among them.
const ALONG_REFLECTION: f64 = 0.25;
/// A smaller inner part carries no information by its evenness. Where such a place closed soon it must be nearer to dry.
const MIN_CORE_PX: usize = 9;
const SOON_S: f32 = 5.0;
const NEARER_DRY: f32 = 0.12;

/// The observed history of the window's pixels besides the times at which they broke.
pub struct FilmObservation<'a> {
    /// Since when a pixel that did not break has looked dry, s.
    pub looks_dry_since_s: &'a dyn Fn(usize) -> Option<f32>,
    /// How long a pixel that broke was open, s, where it closed again.
    pub was_open_s: &'a dyn Fn(usize) -> Option<f32>,
    /// How far from its dry brightness it was while it looked dry, as a share of what the film takes.
    pub off_dry: &'a dyn Fn(usize) -> f32,
    /// Whether a pixel of the region was not seen for most of the time, or at the end.
    pub was_hidden: &'a dyn Fn(usize) -> bool,
    /// The region.
    pub inside: &'a [bool],
    /// The largest glint, px.
    pub glint_px: usize,
    /// The largest bead, px.
    pub bead_px: usize,
}

/// When each pixel of the window broke, s, [`NEVER`] where its film holds; and the pixels, also [`NEVER`], of which it cannot be said
/// whether they broke.
pub fn settled(window: &Window, broke_s: Vec<f32>, seen: &FilmObservation<'_>) -> (Vec<f32>, Vec<usize>) {
    let mut broke_s = broke_s;
    grow(window, &mut broke_s, seen.looks_dry_since_s);
    let is_noise = |piece: &Vec<usize>| {
        piece.len() < MIN_PIECE_PX || (piece.len() <= seen.glint_px && !is_level(window, &broke_s, piece, seen))
    };
    let noise: Vec<Vec<usize>> =
        window.raster().pieces(&AROUND, |i| broke_s[i] < NEVER).into_iter().filter(is_noise).collect();
    noise.iter().flatten().for_each(|&i| broke_s[i] = NEVER);
    let is_unsure = |piece: &Vec<usize>| {
        let uneven = uneven(&core_of(window, &broke_s, piece, seen)).unwrap_or(0.0);
        let is_along = || hidden_around(window, &broke_s, piece, seen) >= ALONG_REFLECTION;
        (uneven >= VERY_UNEVEN && seen.glint_px > 0) || (uneven >= MAX_UNEVEN && is_along())
    };
    let pieces = window.raster().pieces(&AROUND, |i| broke_s[i] < NEVER);
    let unsure: Vec<usize> = pieces.into_iter().filter(is_unsure).flatten().collect();
    unsure.iter().for_each(|&i| broke_s[i] = NEVER);
    for wet in window.raster().pieces(&BESIDE, |i| broke_s[i] == NEVER) {
        let enclosed = wet.len() <= seen.bead_px && wet.iter().all(|&i| seen.inside[i] && !at_rim(window, i));
        if enclosed {
            let rim = wet.iter().flat_map(|&i| window.raster().neighbours(i, &BESIDE)).map(|i| broke_s[i]);
            let closed_in_s = rim.filter(|time_s| *time_s < NEVER).fold(0.0, f32::max);
            wet.iter().for_each(|&i| broke_s[i] = closed_in_s);
        }
    }
    (broke_s, unsure)
}

/// Whether a place has the dry brightness all over: some of it reaches that, and what does not lie at its rim is even.
fn is_level(window: &Window, broke_s: &[f32], piece: &[usize], seen: &FilmObservation<'_>) -> bool {
    let reached = high(&sorted(piece.iter().copied(), seen));
    if let Some(uneven) = uneven(&core_of(window, broke_s, piece, seen)) {
        return reached > -NEAR_DRY && uneven < MAX_UNEVEN;
    }
    let closed_soon = piece.iter().all(|&i| (seen.was_open_s)(i).is_some_and(|open_s| open_s < SOON_S));
    reached > if closed_soon { -NEARER_DRY } else { -NEAR_DRY }
}

/// The share of the pixels around a place that were hidden.
fn hidden_around(window: &Window, broke_s: &[f32], piece: &[usize], seen: &FilmObservation<'_>) -> f64 {
    let next = |&i: &usize| window.raster().neighbours(i, &AROUND).filter(|&next| broke_s[next] == NEVER);
    let around: BTreeSet<usize> = piece.iter().flat_map(next).collect();
    let hidden = around.iter().filter(|&&i| (seen.was_hidden)(i)).count();
    hidden as f64 / around.len().max(1) as f64
}

/// How far from dry the pixels of a place are that do not lie at its rim, in order.
fn core_of(window: &Window, broke_s: &[f32], piece: &[usize], seen: &FilmObservation<'_>) -> Vec<f32> {
    let inner = |&i: &usize| window.raster().neighbours(i, &BESIDE).all(|next| broke_s[next] < NEVER);
    sorted(piece.iter().copied().filter(inner), seen)
}

/// How much they vary from tenth to tenth; of few nothing is said.
fn uneven(core: &[f32]) -> Option<f32> {
    (core.len() >= MIN_CORE_PX).then(|| high(core) - core[core.len() / 10])
}

fn high(sorted: &[f32]) -> f32 {
    sorted[sorted.len() - 1 - sorted.len() / 10]
}

fn sorted(pixels: impl Iterator<Item = usize>, seen: &FilmObservation<'_>) -> Vec<f32> {
    let mut off: Vec<f32> = pixels.map(seen.off_dry).collect();
    off.sort_by(f32::total_cmp);
    off
}

/// Whether it lies at the window's edge.
fn at_rim(window: &Window, index: usize) -> bool {
    window.raster().neighbours(index, &BESIDE).count() < 4
}

fn grow(window: &Window, broke_s: &mut [f32], looks_dry_since_s: impl Fn(usize) -> Option<f32>) {
    let mut rim: VecDeque<usize> = (0..broke_s.len()).filter(|&i| broke_s[i] < NEVER).collect();
    while let Some(index) = rim.pop_front() {
        for next in window.raster().neighbours(index, &AROUND) {
            if broke_s[next] == NEVER
                && let Some(since_s) = looks_dry_since_s(next)
            {
                broke_s[next] = since_s;
                rim.push_back(next);
            }
        }
    }
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

    const DRY: FilmObservation<'_> = FilmObservation {
        looks_dry_since_s: &|_| None,
        was_open_s: &|_| None,
        off_dry: &|_| 0.0,
        was_hidden: &|_| false,
        inside: &[true; 48],
        glint_px: 0,
        bead_px: 0,
    };

    #[test]
    fn noise_goes_a_bead_is_filled_and_the_rim_joins() {
        let broke = times(["........", ".1111..7", ".1.21...", ".1111...", "........", "77......"]);
        let late = |i: usize| (i == 8 + 5).then_some(9.0);
        let expected = times(["........", ".11119..", ".1221...", ".1111...", "........", "........"]);
        let seen = FilmObservation { looks_dry_since_s: &late, bead_px: 1, ..DRY };
        assert_eq!(settled(&WINDOW, broke.clone(), &seen), (expected, vec![]));
        assert_eq!(settled(&WINDOW, broke, &DRY).0[2 * 8 + 2], NEVER, "without filling");
    }

    fn left(broke: &[f32], seen: &FilmObservation<'_>) -> usize {
        settled(&WINDOW, broke.to_vec(), seen).0.iter().filter(|time_s| **time_s < NEVER).count()
    }

    /// By hand: 5 × 6 px have an inner part of 3 × 4 px, which is even, or higher by 0.3 at one column.
    #[test]
    fn a_glint_is_a_bell_and_a_break_is_level() {
        let broke = times(["11111...", "11111...", "11111...", "11111...", "11111...", "11111..."]);
        let (bell, level, low) = (|i: usize| if i % 8 == 2 { 0.0 } else { -0.3_f32 }, |_| -0.15, |_| -0.21);
        for (off_dry, glint_px, expected) in
            [(&bell as &dyn Fn(usize) -> f32, 30, 0), (&level, 30, 30), (&low, 30, 0), (&low, 29, 30)]
        {
            assert_eq!(left(&broke, &FilmObservation { off_dry, glint_px, ..DRY }), expected, "{glint_px}");
        }
    }

    /// By hand: of 6 × 4 px in the window's corner 5 × 3 px are inner ones. Each column is so much brighter than the one before,
    /// from tenth to tenth 4 · 0.09 or 4 · 0.05: more than a break varies, or less; 4 · 0.11 is more than any. Around them lie 11 px, of
    /// which the four of the seventh column, 36 %, or two, 18 %, were hidden. The place is larger than a glint.
    #[test]
    fn an_uneven_place_along_a_reflection_is_not_told() {
        let broke = times(["111111..", "111111..", "111111..", "111111..", "........", "........"]);
        for (step, hidden_rows, unsure) in [(0.09, 4, 24), (0.05, 4, 0), (0.09, 2, 0), (0.11, 2, 24)] {
            let was_hidden = |i: usize| i % 8 == 6 && i / 8 < hidden_rows;
            let off_dry = |i: usize| step * (i % 8) as f32;
            let seen = FilmObservation { off_dry: &off_dry, was_hidden: &was_hidden, glint_px: 12, ..DRY };
            let (settled, found) = settled(&WINDOW, broke.clone(), &seen);
            let left = settled.iter().filter(|time_s| **time_s < NEVER).count();
            assert_eq!((found.len(), left), (unsure, 24 - unsure), "{step} {hidden_rows}");
        }
    }

    /// Eight pixels have no inner part: what closed soon must be nearer to dry than what stayed.
    #[test]
    fn a_tiny_place_that_closed_soon_must_be_dry() {
        let broke = times(["1111....", "1111....", "........", "........", "........", "........"]);
        for (open_s, off, expected) in [(4.0, -0.15, 0), (4.0, -0.1, 8), (6.0, -0.15, 8), (6.0, -0.25, 0)] {
            let seen = FilmObservation { was_open_s: &|_| Some(open_s), off_dry: &|_| off, glint_px: 8, ..DRY };
            assert_eq!(left(&broke, &seen), expected, "{open_s} s, {off}");
        }
    }
}
