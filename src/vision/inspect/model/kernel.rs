//! The operations on every pixel of every picture, in 16-bit integers; compiled for several processor types, one of
//! which is selected at run time.
//!
//! The brightness of a pixel is a weighted sum of its channels in 1/64 grey level, in the light of the dry picture: the
//! weights compensate the change of the lamp. The gain of a tile is the ratio of its present light to the light in
//! which the film brightness was learnt ([`super::light`]).

// The dispatcher that the attribute generates calls the function that was compiled for the detected processor.
#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use multiversion::multiversion;

/// One grey level in units of a brightness value. A brightness value is in 1/64 grey level and has 14 bits; the 16th
/// bit marks an overexposed channel.
pub const LEVEL: u16 = 64;
pub const OVEREXPOSED_FLAG: u16 = 0x8000;
pub const BRIGHTNESS_MASK: u16 = 0x3fff;
/// Minimum value of a channel that may be overexposed, grey levels.
const MIN_OVEREXPOSED_LEVEL: u8 = 250;

/// Number of consecutive pixels of a row that are judged or skipped together; a row consists of whole blocks.
pub const BLOCK_PX: usize = 32;
pub type Block = [u16; BLOCK_PX];
/// Side of a cell within which the light is constant, px.
pub const CELL_PX: usize = 8;
pub const CELLS_PER_BLOCK: usize = BLOCK_PX / CELL_PX;

/// State of a pixel: the pixel belongs to the region and can be evaluated.
pub const INSIDE_FLAG: u16 = 0x0001;
/// State of a pixel: the film is open in the present picture.
pub const OPEN_FLAG: u16 = 0x0002;
/// State of a pixel: the pixel was seen wet at least once.
pub const EVER_WET_FLAG: u16 = 0x0004;
/// State of a pixel: the film broke.
pub const BROKE_FLAG: u16 = 0x0008;
/// State of a pixel: the film broke in this picture.
pub const NEW_BREAK_FLAG: u16 = 0x0010;
/// State of a pixel: its brightness stepped within a moment from that of the film to another steady value that is not
/// bare.
pub const STEPPED_FLAG: u16 = 0x0020;
/// State of a pixel: the pixel no longer has a dry reference and is judged only by the brightness of its film.
pub const NO_DRY_FLAG: u16 = 0x0040;
/// State of a pixel: its brightness once differed from that of the film and returned to it, so water moves there.
pub const MOVED_FLAG: u16 = 0x0080;
/// State of a pixel: a change is in progress, so the pixel must be judged in the next picture.
pub const BUSY_FLAG: u16 = 0x0100;

/// Returns the product a b / 2¹⁶.
#[inline(always)]
pub fn multiply_high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Returns a mask with all bits set if `holds`, else 0: the compiler can vectorize loops with masks, but not with
/// branches.
#[inline(always)]
pub fn mask(holds: bool) -> u16 {
    u16::from(holds).wrapping_neg()
}

/// Returns `first` if the mask is set, else `second`.
#[inline(always)]
pub fn choose(mask: u16, first: u16, second: u16) -> u16 {
    (first & mask) | (second & !mask)
}

/// Multiplies a brightness value by a gain in 1/4096, below 4.
#[inline(always)]
pub fn apply_gain(look: u16, gain_q12: u16) -> u16 {
    multiply_high(look << 2, gain_q12 << 2)
}

/// Calculates the brightness of each pixel as a weighted sum of its channels; the sum of `weights` is about [`LEVEL`].
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn weighted_brightness(pixels: &[[u8; 3]], weights: [u16; 3], out: &mut [u16]) {
    let count = out.len().min(pixels.len());
    let (out, bytes) = (&mut out[..count], &pixels.as_flattened()[..3 * count]);
    // A loop over bytes, because compilers vectorize it; in a loop over pixels they would load the triples one by one.
    for i in 0..count {
        let [r, g, b] = [bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]].map(u16::from);
        let sum =
            (r * weights[0]).saturating_add(g * weights[1]).saturating_add(b * weights[2]).min(BRIGHTNESS_MASK);
        let brightest = r.max(g).max(b);
        out[i] = sum | if brightest >= u16::from(MIN_OVEREXPOSED_LEVEL) { OVEREXPOSED_FLAG } else { 0 };
    }
}

/// Sums of the measured and of the expected brightness over the pixels of a tile whose measured brightness lies within
/// a band around the expected brightness.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sum {
    pub found: u32,
    pub expected: u32,
    pub pixels: u32,
}

/// The rows of a tile that are summed, and the accepted band of brightness.
#[derive(Debug, Clone, Copy)]
pub struct RowSelection {
    /// Distance between the starts of two rows, blocks.
    pub stride: usize,
    /// Interval of the rows that are summed: 1 for every row.
    pub row_interval: usize,
    /// Lower and upper limit of the accepted band, in 1/1024 of the expected brightness, below 2.
    pub band_q10: [u16; 2],
}

/// Number of 14-bit brightness values that can be summed without exceeding 16 bits.
const MAX_SUMMED_VALUE_COUNT: usize = 4;

/// Sums the present and the expected brightness of the film in a tile. The tile is one block wide, and its first row is
/// at the beginning of the slices.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn sum_tile(look: &[Block], wet: &[Block], state: &[Block], adding: RowSelection) -> Sum {
    let RowSelection { stride, row_interval: every, band_q10 } = adding;
    let band_q15 = band_q10.map(|bound| bound << 5);
    let mut sum = Sum::default();
    let step = stride * every;
    let rows = look.len().div_ceil(step);
    for from in (0..rows).step_by(MAX_SUMMED_VALUE_COUNT) {
        let (mut found, mut expected, mut pixels) = ([0; BLOCK_PX], [0; BLOCK_PX], [0; BLOCK_PX]);
        for row in from..rows.min(from + MAX_SUMMED_VALUE_COUNT) {
            let (look, wet, state) = (&look[row * step], &wet[row * step], &state[row * step]);
            for i in 0..BLOCK_PX {
                let (s, w) = (look[i] & BRIGHTNESS_MASK, wet[i]);
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

    /// Expected value, calculated by hand for the weights 16, 32, 16: (16·10 + 32·20 + 16·30)/64 = 20 levels.
    #[test]
    fn brightness_is_a_weighted_mean_of_the_channels() {
        let mut out = [0; 2];
        weighted_brightness(&[[10, 20, 30], [255, 0, 0]], [16, 32, 16], &mut out);
        assert_eq!(out, [20 * 64, (16 * 255) | OVEREXPOSED_FLAG]);
    }

    /// Expected values, calculated by hand: of 60, 100 and 30 levels, the second and the third are far from the
    /// expected 60 levels; a fourth pixel is open.
    #[test]
    fn only_film_near_its_learnt_brightness_determines_the_light() {
        let (mut look, mut state) = ([0; BLOCK_PX], [INSIDE_FLAG; BLOCK_PX]);
        (look[0], look[1], look[2], look[3]) = (60 * 64, 100 * 64, 30 * 64, 60 * 64);
        state[3] |= OPEN_FLAG;
        let adding = RowSelection { stride: 1, row_interval: 1, band_q10: [820, 1331] };
        let sum = sum_tile(&[look], &[[60 * 64; BLOCK_PX]], &[state], adding);
        assert_eq!((sum.pixels, sum.found, sum.expected), (1, 60 * 64, 60 * 64));
    }
}
