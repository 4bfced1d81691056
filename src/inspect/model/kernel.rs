//! What is done to every pixel of every picture, in whole numbers of 16 bits: compiled for each kind of processor and
//! chosen when it runs.
//!
//! A pixel's brightness is a weighted sum of its channels in 1/64 grey level. Over light g it is s = g d where it is dry
//! and s = g τ d where it is wet, d its dry brightness and τ what the film leaves of it. Above 9/8 g d + 1.5 levels a
//! glint hides it. Whether it is wet or dry: see [`super::judging`].

// The dispatcher that the attribute writes calls functions compiled for the processor that was found.
#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use multiversion::multiversion;

/// Brightness is in 1/64 grey level, 14 bits; the 16th says that a channel is overexposed.
pub const LEVEL: u16 = 64;
pub const HIDDEN: u16 = 0x8000;
pub const BRIGHTNESS: u16 = 0x3fff;
/// From this value on a channel may be overexposed.
const OVEREXPOSED: u8 = 250;
/// What noise adds to a glint's bound.
const GLINT_MARGIN: u16 = 3 * LEVEL / 2;

/// Pixels that are judged, or left, together; rows are whole blocks.
pub const BLOCK_PX: usize = 32;

/// A pixel's run, in the low byte of what is kept of it …
pub const RUN: u16 = 0x00ff;
/// … and the bits of its state.
pub const INSIDE: u16 = 0x0100;
/// Its film is open now, as far as is known; before the spray everything is.
pub const OPEN: u16 = 0x0200;
/// It was seen wet once.
pub const EVER_WET: u16 = 0x0400;
/// It broke.
pub const BROKE: u16 = 0x0800;
/// It broke in this picture.
pub const NEW: u16 = 0x1000;

/// a b / 2¹⁶.
#[inline(always)]
pub fn high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Brightness over light of a gain in 1/4096, below 4; in 1/64 level.
#[inline(always)]
pub fn lit(brightness: u16, gain_q12: u16) -> u16 {
    high(brightness << 2, gain_q12 << 2)
}

/// The brightness from which a glint hides what is dry at `dry_lit`.
#[inline(always)]
pub fn glint_from(dry_lit: u16) -> u16 {
    dry_lit.saturating_add(dry_lit / 8 + GLINT_MARGIN)
}

/// Weighted sums of the channels; `weights` add up to [`LEVEL`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn brightness(pixels: &[[u8; 3]], weights: [u16; 3], out: &mut [u16]) {
    for (out, pixel) in out.iter_mut().zip(pixels) {
        let [r, g, b] = pixel.map(u16::from);
        let sum = r * weights[0] + g * weights[1] + b * weights[2];
        let brightest = r.max(g).max(b);
        *out = sum | if brightest >= u16::from(OVEREXPOSED) { HIDDEN } else { 0 };
    }
}

/// Brightness found and expected over the pixels of a tile that are within a band about what is expected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sum {
    pub found: u32,
    pub expected: u32,
    pub pixels: u32,
}

/// Which of a tile's rows are added up, and which brightness counts.
#[derive(Debug, Clone, Copy)]
pub struct Adding {
    /// From one row to the next, pixels.
    pub stride: usize,
    /// One row in so many.
    pub every: usize,
    /// τ in 1/65536.
    pub film_q16: u16,
    /// The band, in 1/1024 of the expected brightness, below 2.
    pub band_q10: [u16; 2],
}

/// Adds up a tile: its first row begins the slices, and its rows are [`BLOCK_PX`] long.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn add_up(light: &[u16], dry: &[u16], kept: &[u16], adding: Adding) -> Sum {
    let Adding { stride, every, film_q16, band_q10 } = adding;
    let band_q15 = band_q10.map(|bound| bound << 5);
    let (mut found, mut expected, mut pixels) = (0_u32, 0_u32, 0_u32);
    let step = stride * every;
    for ((light, dry), kept) in light.chunks(step).zip(dry.chunks(step)).zip(kept.chunks(step)) {
        let (light, dry, kept) = (&light[..BLOCK_PX], &dry[..BLOCK_PX], &kept[..BLOCK_PX]);
        for i in 0..BLOCK_PX {
            let s = light[i] & BRIGHTNESS;
            let m = if kept[i] & OPEN > 0 { dry[i] } else { high(dry[i], film_q16) };
            let within = (s >= high(m << 1, band_q15[0])) & (s <= high(m << 1, band_q15[1]));
            let counts = within & (kept[i] & INSIDE > 0) & (light[i] & HIDDEN == 0);
            found += u32::from(if counts { s } else { 0 });
            expected += u32::from(if counts { m } else { 0 });
            pixels += u32::from(counts);
        }
    }
    Sum { found, expected, pixels }
}

/// How many of a row's pixels in the region a glint or overexposure hides under light of this gain.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn hidden(light: &[u16], dry: &[u16], kept: &[u16], gain_q12: u16) -> u32 {
    let mut sum = 0_u32;
    for ((&light, &dry), &kept) in light.iter().zip(dry).zip(kept) {
        let glint = (light & BRIGHTNESS > glint_from(lit(dry, gain_q12))) | (light & HIDDEN > 0);
        sum += u32::from(glint & (kept & INSIDE > 0));
    }
    sum
}

/// How many of a row's pixels lie in the region.
pub fn inside(kept: &[u16]) -> u32 {
    kept.iter().map(|kept| u32::from(kept & INSIDE > 0)).sum()
}

/// Adds one to each column of a row that a glint or overexposure hides.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn count_hidden(light: &[u16], dry: &[u16], kept: &[u16], gain_q12: &[u16], columns: &mut [u16]) {
    let count = columns.len();
    let (light, dry, kept, gain_q12) = (&light[..count], &dry[..count], &kept[..count], &gain_q12[..count]);
    for i in 0..count {
        let glint = (light[i] & BRIGHTNESS > glint_from(lit(dry[i], gain_q12[i]))) | (light[i] & HIDDEN > 0);
        columns[i] += u16::from(glint & (kept[i] & INSIDE > 0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, weights 16, 32, 16: (16·10 + 32·20 + 16·30)/64 = 20 levels.
    #[test]
    fn brightness_is_a_weighted_mean() {
        let mut out = [0; 2];
        brightness(&[[10, 20, 30], [255, 0, 0]], [16, 32, 16], &mut out);
        assert_eq!(out, [20 * 64, (16 * 255) | HIDDEN]);
    }

    /// By hand: of 60, 100 and 30 levels the second is far from the 60 that are expected, the third too.
    #[test]
    fn only_what_is_near_what_is_expected_tells_the_light() {
        let mut light = [0; BLOCK_PX];
        (light[0], light[1], light[2]) = (60 * 64, 100 * 64, 30 * 64);
        let adding = Adding { stride: BLOCK_PX, every: 1, film_q16: 39_321, band_q10: [820, 1331] };
        let sum = add_up(&light, &[100 * 64; BLOCK_PX], &[INSIDE; BLOCK_PX], adding);
        assert_eq!((sum.pixels, sum.found), (1, 60 * 64));
        assert!(sum.expected.abs_diff(60 * 64) < 2);
    }
}
