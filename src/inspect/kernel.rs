//! What is done to every pixel of every picture, in whole numbers: compiled for each kind of processor and chosen when
//! it runs.
//!
//! A pixel's brightness is a weighted sum of its channels in 1/64 grey level. Over light g it is s = g d where it is dry
//! and s = g τ d where it is wet, d its dry brightness and τ what the film leaves of it. So
//!     dry    g d (1 + τ)/2 ≤ s ≤ 9/8 g d + 1.5 levels,    wet    s below that,    hidden by a glint    s above it.  (1)
//! The rim of a glint may be as bright as a dry place; but it moves, and a dry place keeps its brightness. So dry counts
//! only with
//!     |s − s' g/g'| ≤ g d/16 + 2.5 levels,    s', g' those of the picture before.                             (2)
//! A run counts pictures for dry against pictures for wet and stays within 0…H (a CUSUM, Page, Biometrika 41, 1954):
//! at H the film is open, back at 0 it is closed. Hidden or unsteady, it stays as it is.

// The dispatcher that the attribute writes calls functions compiled for the processor that was found.
#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use multiversion::multiversion;

/// Brightness is in 1/64 grey level, 14 bits; the 16th says that a channel is overexposed.
pub const LEVEL: u32 = 64;
pub const HIDDEN: u16 = 0x8000;
const BRIGHTNESS: u16 = 0x3fff;
/// From this value on a channel may be overexposed.
const OVEREXPOSED: u8 = 250;
/// What noise adds to the bounds of (1) and (2).
const GLINT_MARGIN: u32 = 3 * LEVEL / 2;
const STEADY_MARGIN: u32 = 5 * LEVEL / 2;

/// Bits of a pixel's state.
pub const INSIDE: u8 = 1;
/// Its film is open now, as far as is known; before the spray everything is.
pub const OPEN: u8 = 2;
/// It was seen wet once.
pub const EVER_WET: u8 = 4;
/// It broke.
pub const BROKE: u8 = 8;
/// It broke in this picture.
pub const NEW: u8 = 16;

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

/// Brightness found and expected over the pixels of a tile's row that are within a band about what is expected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sum {
    pub found: u32,
    pub expected: u32,
    pub pixels: u32,
}

/// Adds up one row of a tile. The band is in 1/1024 of the expected brightness, `film_q15` is τ.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn add_up(light: &[u16], dry: &[u16], state: &[u8], film_q15: u32, band_q10: [u32; 2]) -> Sum {
    let (mut found, mut expected, mut pixels) = (0_u32, 0_u32, 0_u32);
    for ((&light, &dry), &state) in light.iter().zip(dry).zip(state) {
        let (s, d) = (u32::from(light & BRIGHTNESS), u32::from(dry));
        let m = if state & OPEN > 0 { d } else { (d * film_q15) >> 15 };
        let within = (s << 10 >= band_q10[0] * m) & (s << 10 <= band_q10[1] * m);
        let counts = u32::from(within & (state & INSIDE > 0) & (light & HIDDEN == 0));
        found += counts * s;
        expected += counts * m;
        pixels += counts;
    }
    Sum { found, expected, pixels }
}

/// How many of the region's pixels a glint or overexposure hides under light of this gain.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn hidden(light: &[u16], dry: &[u16], state: &[u8], gain_q12: u32) -> u32 {
    let mut hidden = 0_u32;
    for ((&light, &dry), &state) in light.iter().zip(dry).zip(state) {
        let dl = (u32::from(dry) * gain_q12) >> 12;
        let glint = u32::from(light & BRIGHTNESS) > dl + dl / 8 + GLINT_MARGIN;
        hidden += u32::from((glint | (light & HIDDEN > 0)) & (state & INSIDE > 0));
    }
    hidden
}

/// One row of pixels as the model has them.
pub struct Line<'a> {
    pub light: &'a [u16],
    /// The picture before.
    pub before: &'a [u16],
    pub dry: &'a [u16],
    /// The lamp's light, 1/4096.
    pub gain_q12: &'a [u16],
    /// A glint's neighbourhood: what looks dry there may be its rim.
    pub doubtful: &'a [u8],
    pub state: &'a mut [u8],
    pub run: &'a mut [u8],
    pub since_s: &'a mut [f32],
    /// When its film closed again, where it broke before.
    pub until_s: &'a mut [f32],
}

/// How a row is judged.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    /// τ in 1/32768.
    pub film_q15: u32,
    /// Pictures that must show a break.
    pub persist: u8,
    /// The time of the picture before: what is steady was so then.
    pub before_s: f32,
    /// The time of this picture.
    pub now_s: f32,
    /// How much brighter the light is than before, 1/4096.
    pub brighter_q12: u32,
    /// [`BROKE`] | [`NEW`] while the film is watched, else 0.
    pub notes: u8,
}

/// Judges one row; says whether a pixel of it broke now.
pub fn judge(line: &mut Line<'_>, rule: Rule) -> bool {
    let Line { light, before, dry, gain_q12, doubtful, state, run, since_s, until_s } = line;
    judge_slices((light, before, dry, gain_q12, doubtful), (state, run, since_s, until_s), rule) & NEW > 0
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
fn judge_slices(
    given: (&[u16], &[u16], &[u16], &[u16], &[u8]),
    kept: (&mut [u8], &mut [u8], &mut [f32], &mut [f32]),
    rule: Rule,
) -> u8 {
    let (light, before, dry, gain_q12, doubtful) = given;
    let (state, run, since_s, until_s) = kept;
    let count = light.len();
    // One length for all, so that no bound is checked within the loop.
    let (before, dry, gain_q12, doubtful) =
        (&before[..count], &dry[..count], &gain_q12[..count], &doubtful[..count]);
    let (state, run) = (&mut state[..count], &mut run[..count]);
    let (since_s, until_s) = (&mut since_s[..count], &mut until_s[..count]);
    let mut any = 0_u8;
    for i in 0..count {
        let s = u32::from(light[i] & BRIGHTNESS);
        let dl = (u32::from(dry[i]) * u32::from(gain_q12[i])) >> 12;
        let wl = (dl * rule.film_q15) >> 15;
        let wet = s < (dl + wl) / 2;
        let glint = (s > dl + dl / 8 + GLINT_MARGIN) | (light[i] & HIDDEN > 0);
        let expected = (u32::from(before[i] & BRIGHTNESS) * rule.brighter_q12) >> 12;
        let steady = s.abs_diff(expected) <= dl / 16 + STEADY_MARGIN;
        let looks_dry = !wet & !glint & steady & (doubtful[i] == 0);
        let was = run[i];
        let up = u8::from(looks_dry & (was < rule.persist));
        let down = u8::from(wet & !glint & (was > 0));
        let now = was + up - down;
        run[i] = now;
        since_s[i] = if (was == 0) & (up == 1) & (state[i] & BROKE == 0) { rule.before_s } else { since_s[i] };
        until_s[i] = if (was == 1) & (down == 1) { rule.now_s } else { until_s[i] };
        // A third of the way from wet to dry: beyond doubt it is wet.
        let surely_wet = (3 * s < 2 * wl + dl) & !glint;
        let inside = state[i] & INSIDE;
        let mut next = state[i] & !NEW;
        next |= if surely_wet { EVER_WET } else { 0 };
        let opens = (now >= rule.persist) & (inside > 0);
        let new = if opens & (next & BROKE == 0) { rule.notes } else { 0 };
        next = if now == 0 { next & !OPEN } else { next };
        next |= (if opens { OPEN } else { 0 }) | new;
        state[i] = next;
        any |= next;
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRY: u16 = 100 * 64;
    const RULE: Rule = Rule {
        film_q15: 32_768 * 6 / 10,
        persist: 3,
        before_s: 0.0,
        now_s: 0.0,
        brighter_q12: 4096,
        notes: BROKE | NEW,
    };

    /// By hand, weights 16, 32, 16: (16·10 + 32·20 + 16·30)/64 = 20 levels.
    #[test]
    fn brightness_is_a_weighted_mean() {
        let mut out = [0; 2];
        brightness(&[[10, 20, 30], [255, 0, 0]], [16, 32, 16], &mut out);
        assert_eq!(out, [20 * 64, (16 * 255) | HIDDEN]);
    }

    /// By hand, dry 100 and wet 60 levels: below 80 it is wet, up to 112.5 + 1.5 it is dry, above that a glint; with light
    /// of a half everything lies at half of that. From one picture to the next it may change by 6.25 + 2.5.
    #[test]
    fn what_is_wet_dry_or_hidden() {
        let run_after = |[before, level]: [u16; 2], gain_q12: u16, run: u8| {
            let (mut state, mut runs, mut since) = ([INSIDE], [run], [0.0]);
            let mut line = Line {
                light: &[level * 64],
                before: &[before * 64],
                dry: &[DRY],
                gain_q12: &[gain_q12],
                doubtful: &[0],
                state: &mut state,
                run: &mut runs,
                since_s: &mut since,
                until_s: &mut [0.0],
            };
            judge(&mut line, RULE);
            runs[0]
        };
        assert_eq!([79, 80, 114, 115].map(|level| run_after([level; 2], 4096, 1)), [0, 2, 2, 1]);
        assert_eq!([39, 40, 57, 58].map(|level| run_after([level; 2], 2048, 1)), [0, 2, 2, 1]);
        assert_eq!((run_after([50; 2], 4096, 0), run_after([100; 2], 4096, 3)), (0, 3), "it stays within 0 and H");
        assert_eq!(
            [[92, 100], [91, 100], [109, 101], [110, 101]].map(|levels| run_after(levels, 4096, 1)),
            [2, 1, 2, 1]
        );
    }

    /// Dry in pictures 1, 2, then hidden, then dry: steady in 2, 5 and 6, it breaks in picture 6 and broke at 1; wet for
    /// three pictures it closes.
    #[test]
    fn a_break_counts_from_its_first_picture_and_may_close() {
        let (mut state, mut run, mut since, mut until) = ([INSIDE], [0], [0.0], [0.0]);
        let levels = [60, 100, 100, 200, 100, 100, 100, 60, 60, 60];
        let broke: Vec<bool> = levels
            .iter()
            .enumerate()
            .map(|(time, level)| {
                let mut line = Line {
                    light: &[level * 64],
                    before: &[levels[time.saturating_sub(1)] * 64],
                    dry: &[DRY],
                    gain_q12: &[4096],
                    doubtful: &[0],
                    state: &mut state,
                    run: &mut run,
                    since_s: &mut since,
                    until_s: &mut until,
                };
                judge(&mut line, Rule { before_s: time as f32 - 1.0, now_s: time as f32, ..RULE })
            })
            .collect();
        assert_eq!(broke.iter().position(|broke| *broke), Some(6));
        assert_eq!((since[0], until[0], state[0] & (OPEN | BROKE)), (1.0, 9.0, BROKE));
    }

    /// By hand: of 60, 100 and 30 levels the second is far from the 60 that are expected, the third too.
    #[test]
    fn only_what_is_near_what_is_expected_tells_the_light() {
        let light = [60, 100, 30].map(|level: u16| level * 64);
        let sum = add_up(&light, &[DRY; 3], &[INSIDE; 3], RULE.film_q15, [820, 1331]);
        assert_eq!((sum.pixels, sum.found), (1, 60 * 64));
        assert!(sum.expected.abs_diff(60 * 64) < 2);
    }
}
