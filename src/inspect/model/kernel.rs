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

/// Pixels of a row that are judged, or left, together; rows are whole blocks.
pub const BLOCK_PX: usize = 32;
pub type Block = [u16; BLOCK_PX];
/// The light is constant over a cell of this side, px; the number of cells in a block.
pub const CELL_PX: usize = 8;
pub const CELLS: usize = BLOCK_PX / CELL_PX;

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
/// It showed in this picture neither that it is wet nor that it is dry.
pub const UNTOLD: u16 = 0x2000;

/// a b / 2¹⁶.
#[inline(always)]
pub fn high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Every bit where it holds: with masks in place of branches, loops become vectors.
#[inline(always)]
pub fn where_(holds: bool) -> u16 {
    u16::from(holds).wrapping_neg()
}

/// The first where the mask is set, else the second.
#[inline(always)]
pub fn choose(mask: u16, first: u16, second: u16) -> u16 {
    (first & mask) | (second & !mask)
}

/// Brightness over light of a gain in 1/4096, below 4; in 1/64 level.
#[inline(always)]
pub fn lit(brightness: u16, gain_q12: u16) -> u16 {
    high(brightness << 2, gain_q12 << 2)
}

/// The brightness from which a glint hides what is dry at `dry_lit`.
#[inline(always)]
fn glint_from(dry_lit: u16) -> u16 {
    dry_lit.saturating_add(dry_lit / 8 + GLINT_MARGIN)
}

/// Weighted sums of the channels; `weights` add up to [`LEVEL`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn brightness(pixels: &[[u8; 3]], weights: [u16; 3], out: &mut [u16]) {
    let count = out.len().min(pixels.len());
    let (out, bytes) = (&mut out[..count], &pixels.as_flattened()[..3 * count]);
    // By bytes, since compilers unravel those of a pixel in vectors, and load triples one by one.
    for i in 0..count {
        let [r, g, b] = [bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]].map(u16::from);
        let sum = r * weights[0] + g * weights[1] + b * weights[2];
        let brightest = r.max(g).max(b);
        out[i] = sum | if brightest >= u16::from(OVEREXPOSED) { HIDDEN } else { 0 };
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
    /// From one row to the next, blocks.
    pub stride: usize,
    /// One row in so many.
    pub every: usize,
    /// τ in 1/65536.
    pub film_q16: u16,
    /// The band, in 1/1024 of the expected brightness, below 2.
    pub band_q10: [u16; 2],
}

/// So many brightnesses of 14 bits add up within 16.
const WITHIN_16_BITS: usize = 4;

/// Adds up a tile, one block wide: its first row's begins the slices.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn add_up(light: &[Block], dry: &[Block], kept: &[Block], adding: Adding) -> Sum {
    let Adding { stride, every, film_q16, band_q10 } = adding;
    let band_q15 = band_q10.map(|bound| bound << 5);
    let mut sum = Sum::default();
    let step = stride * every;
    let rows = light.len().div_ceil(step);
    for from in (0..rows).step_by(WITHIN_16_BITS) {
        let (mut found, mut expected, mut pixels) = ([0; BLOCK_PX], [0; BLOCK_PX], [0; BLOCK_PX]);
        for row in from..rows.min(from + WITHIN_16_BITS) {
            let (light, dry, kept) = (&light[row * step], &dry[row * step], &kept[row * step]);
            for i in 0..BLOCK_PX {
                let s = light[i] & BRIGHTNESS;
                let m = choose(where_(kept[i] & OPEN > 0), dry[i], high(dry[i], film_q16));
                let within = where_(s >= high(m << 1, band_q15[0])) & where_(s <= high(m << 1, band_q15[1]));
                let counts = within & where_(kept[i] & INSIDE > 0) & where_(light[i] & HIDDEN == 0);
                found[i] += s & counts;
                expected[i] += m & counts;
                pixels[i] += 1 & counts;
            }
        }
        sum.found += total(&found);
        sum.expected += total(&expected);
        sum.pixels += total(&pixels);
    }
    sum
}

#[inline(always)]
fn total(lanes: &Block) -> u32 {
    lanes.iter().copied().map(u32::from).sum()
}

/// How much of its wet brightness a film may be off, as a part of it, and of its dry brightness a dry place.
const ODD_WET: u16 = 6;
const ODD_DRY: u16 = 16;
/// … and what noise adds.
const ODD_MARGIN: u16 = 3 * LEVEL;

/// How many of a block's pixels in the region look neither dry nor as the film makes them, in this light.
pub fn odd(light: &Block, dry: &Block, kept: &Block, gain_q12: &Block, film_q16: u16) -> u32 {
    let mut odd = 0;
    for i in 0..BLOCK_PX {
        let (s, d) = (light[i] & BRIGHTNESS, lit(dry[i], gain_q12[i]));
        let w = high(d, film_q16);
        let fits = (s.abs_diff(d) <= d / ODD_DRY + ODD_MARGIN) | (s.abs_diff(w) <= w / ODD_WET + ODD_MARGIN);
        odd += u32::from(!fits & (kept[i] & INSIDE > 0));
    }
    odd
}

/// How many of a row's pixels in the region a glint or overexposure hides under light of this gain.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn hidden(light: &[Block], dry: &[Block], kept: &[Block], gain_q12: u16) -> u32 {
    let mut lanes = [0; BLOCK_PX];
    for ((light, dry), kept) in light.iter().zip(dry).zip(kept) {
        for i in 0..BLOCK_PX {
            lanes[i] += u16::from(is_hidden(light[i], lit(dry[i], gain_q12)) & (kept[i] & INSIDE > 0));
        }
    }
    total(&lanes)
}

/// Whether a glint or overexposure hides a pixel that would be this bright when dry.
#[inline(always)]
pub fn is_hidden(light: u16, dry_lit: u16) -> bool {
    (light & BRIGHTNESS > glint_from(dry_lit)) | (light & HIDDEN > 0)
}

/// How many pixels of each of a block's cells a glint or overexposure hides.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn hidden_in_cells(light: &Block, dry: &Block, kept: &Block, gain_q12: &Block) -> [u16; CELLS] {
    let mut hidden = [0; BLOCK_PX];
    for i in 0..BLOCK_PX {
        hidden[i] = u16::from(is_hidden(light[i], lit(dry[i], gain_q12[i])) & (kept[i] & INSIDE > 0));
    }
    std::array::from_fn(|cell| hidden[cell * CELL_PX..(cell + 1) * CELL_PX].iter().sum())
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
        let adding = Adding { stride: 1, every: 1, film_q16: 39_321, band_q10: [820, 1331] };
        let sum = add_up(&[light], &[[100 * 64; BLOCK_PX]], &[[INSIDE; BLOCK_PX]], adding);
        assert_eq!((sum.pixels, sum.found), (1, 60 * 64));
        assert!(sum.expected.abs_diff(60 * 64) < 2);
    }
}
