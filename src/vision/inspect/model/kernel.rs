//! The operations on every pixel of every picture, in 16-bit integers: compiled for each kind of processor and chosen
//! at run time.
//!
//! A pixel's look is a weighted sum of its channels in 1/64 grey level, in the light of the dry picture: the weights
//! compensate the lamp's change. The ratio of the light on a tile to the light of the wet looks is its gain
//! ([`super::light`]).

// The dispatcher that the attribute generates calls functions compiled for the detected processor.
#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use multiversion::multiversion;

/// One grey level in the units of a look: a look is a number of 1/64 grey levels and has 14 bits. The 16th bit marks an
/// overexposed channel.
pub const LEVEL: u16 = 64;
pub const OVEREXPOSED_FLAG: u16 = 0x8000;
pub const LOOK_MASK: u16 = 0x3fff;
/// A channel with this value or more may be overexposed.
const OVEREXPOSED_FROM: u8 = 250;

/// The number of consecutive pixels of a row that are judged, or skipped, together; a row consists of whole blocks.
pub const BLOCK_PX: usize = 32;
pub type Block = [u16; BLOCK_PX];
/// Side of a cell, px, over which the light is constant. The next constant is the number of cells in a block.
pub const CELL_PX: usize = 8;
pub const CELLS_PER_BLOCK: usize = BLOCK_PX / CELL_PX;

/// State of a pixel: the pixel belongs to the region and can be evaluated.
pub const INSIDE_FLAG: u16 = 0x0001;
/// State of a pixel: its film is open now, according to the present data.
pub const OPEN_FLAG: u16 = 0x0002;
/// State of a pixel: it was seen wet at least once.
pub const EVER_WET_FLAG: u16 = 0x0004;
/// The place broke.
pub const BROKE_FLAG: u16 = 0x0008;
/// State of a pixel: it broke in this picture.
pub const NEW_BREAK_FLAG: u16 = 0x0010;
/// State of a pixel: within a moment its look changed from the wet look to another steady look that is not the dry one.
pub const STEPPED_FLAG: u16 = 0x0020;
/// State of a pixel: it no longer has a dry look of its own and is judged only by its wet look.
pub const NO_DRY_FLAG: u16 = 0x0040;
/// State of a pixel: its look once differed from its film's look and returned to it, so water moves there.
pub const MOVED_FLAG: u16 = 0x0080;
/// State of a pixel: a change is in progress, and the pixel must be judged in the next picture, whatever it shows.
pub const BUSY_FLAG: u16 = 0x0100;

/// Returns a b / 2¹⁶.
#[inline(always)]
pub fn multiply_high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Returns all bits set if `holds`, else 0: the compiler can vectorize loops with masks, but not with branches.
#[inline(always)]
pub fn mask(holds: bool) -> u16 {
    u16::from(holds).wrapping_neg()
}

/// Returns `first` if the mask is set, else `second`.
#[inline(always)]
pub fn choose(mask: u16, first: u16, second: u16) -> u16 {
    (first & mask) | (second & !mask)
}

/// Applies a gain in 1/4096, below 4, to a look.
#[inline(always)]
pub fn apply_gain(look: u16, gain_q12: u16) -> u16 {
    multiply_high(look << 2, gain_q12 << 2)
}

/// Calculates weighted sums of the channels; the sum of `weights` is about [`LEVEL`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn weighted_looks(pixels: &[[u8; 3]], weights: [u16; 3], out: &mut [u16]) {
    let count = out.len().min(pixels.len());
    let (out, bytes) = (&mut out[..count], &pixels.as_flattened()[..3 * count]);
    // This is a loop over bytes, because compilers vectorize it; in a loop over pixels they would load the triples one
    // by one.
    for i in 0..count {
        let [r, g, b] = [bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]].map(u16::from);
        let sum = (r * weights[0]).saturating_add(g * weights[1]).saturating_add(b * weights[2]).min(LOOK_MASK);
        let brightest = r.max(g).max(b);
        out[i] = sum | if brightest >= u16::from(OVEREXPOSED_FROM) { OVEREXPOSED_FLAG } else { 0 };
    }
}

/// Sums of the measured and of the expected brightness over those pixels of a tile whose measured brightness lies
/// within a band around the expected one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sum {
    pub found: u32,
    pub expected: u32,
    pub pixels: u32,
}

/// Selects the rows of a tile that are added up, and the range of the looks that count.
#[derive(Debug, Clone, Copy)]
pub struct RowSelection {
    /// Distance from one row to the next, blocks.
    pub stride: usize,
    /// Interval of the rows that are added up: 1 is every row.
    pub row_interval: usize,
    /// The band, in 1/1024 of the expected look, below 2.
    pub band_q10: [u16; 2],
}

/// The number of looks of 14 bits that can be added without exceeding 16 bits.
const MAX_SUMMED_LOOKS: usize = 4;

/// Adds up the present looks of a tile's film and its expected looks. The tile is one block wide, and its first row is
/// at the beginning of the slices.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn sum_tile(look: &[Block], wet: &[Block], state: &[Block], adding: RowSelection) -> Sum {
    let RowSelection { stride, row_interval: every, band_q10 } = adding;
    let band_q15 = band_q10.map(|bound| bound << 5);
    let mut sum = Sum::default();
    let step = stride * every;
    let rows = look.len().div_ceil(step);
    for from in (0..rows).step_by(MAX_SUMMED_LOOKS) {
        let (mut found, mut expected, mut pixels) = ([0; BLOCK_PX], [0; BLOCK_PX], [0; BLOCK_PX]);
        for row in from..rows.min(from + MAX_SUMMED_LOOKS) {
            let (look, wet, state) = (&look[row * step], &wet[row * step], &state[row * step]);
            for i in 0..BLOCK_PX {
                let (s, w) = (look[i] & LOOK_MASK, wet[i]);
                let within =
                    mask(s >= multiply_high(w << 1, band_q15[0])) & mask(s <= multiply_high(w << 1, band_q15[1]));
                let is_film = mask(state[i] & (INSIDE_FLAG | OPEN_FLAG | BROKE_FLAG | STEPPED_FLAG) == INSIDE_FLAG);
                let counts = within & is_film & mask(look[i] & OVEREXPOSED_FLAG == 0);
                found[i] += s & counts;
                expected[i] += w & counts;
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

/// Counts the overexposed pixels of the region in a row.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn count_overexposed(look: &[Block], state: &[Block]) -> u32 {
    let mut lanes = [0; BLOCK_PX];
    for (look, state) in look.iter().zip(state) {
        for i in 0..BLOCK_PX {
            lanes[i] += (look[i] >> 15) & state[i] & INSIDE_FLAG;
        }
    }
    total(&lanes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, with weights 16, 32, 16: (16·10 + 32·20 + 16·30)/64 = 20 levels.
    #[test]
    fn a_look_is_a_weighted_mean() {
        let mut out = [0; 2];
        weighted_looks(&[[10, 20, 30], [255, 0, 0]], [16, 32, 16], &mut out);
        assert_eq!(out, [20 * 64, (16 * 255) | OVEREXPOSED_FLAG]);
    }

    /// By hand: of 60, 100 and 30 levels, the second and the third are far from the expected 60; a fourth pixel is
    /// open.
    #[test]
    fn only_film_near_its_wet_look_determines_the_light() {
        let (mut look, mut state) = ([0; BLOCK_PX], [INSIDE_FLAG; BLOCK_PX]);
        (look[0], look[1], look[2], look[3]) = (60 * 64, 100 * 64, 30 * 64, 60 * 64);
        state[3] |= OPEN_FLAG;
        let adding = RowSelection { stride: 1, row_interval: 1, band_q10: [820, 1331] };
        let sum = sum_tile(&[look], &[[60 * 64; BLOCK_PX]], &[state], adding);
        assert_eq!((sum.pixels, sum.found, sum.expected), (1, 60 * 64, 60 * 64));
    }
}
