//! What is done to every pixel of every picture, in whole numbers of 16 bits: compiled for each kind of processor and
//! chosen when it runs.
//!
//! A pixel's brightness is a weighted sum of its channels in 1/64 grey level. Over light g it is s = g d where it is dry
//! and s = g τ d where it is wet, d its dry brightness and τ what the film leaves of it. So
//!     dry    g d (1 + τ)/2 ≤ s ≤ 9/8 g d + 1.5 levels,    wet    s below that,    hidden by a glint    s above it.  (1)
//! The rim of a glint may be as bright as a dry place; but it moves, and a dry place keeps its brightness. So dry counts
//! only with
//!     |s − s' g/g'| ≤ g d/16 + 2.5 levels,    s', g' those of the picture before.                             (2)
//! A run counts pictures for dry against pictures for wet and stays within 0…H (a CUSUM, Page, Biometrika 41, 1954):
//! at H the film is open, back at 0 it is closed. Hidden or unsteady, it stays as it is.
//!
//! Most of a panel is wet and stays so: a block of pixels of which that is true is left as it is.

// The dispatcher that the attribute writes calls functions compiled for the processor that was found.
#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use multiversion::multiversion;

/// Brightness is in 1/64 grey level, 14 bits; the 16th says that a channel is overexposed.
pub const LEVEL: u16 = 64;
pub const HIDDEN: u16 = 0x8000;
const BRIGHTNESS: u16 = 0x3fff;
/// From this value on a channel may be overexposed.
const OVEREXPOSED: u8 = 250;
/// What noise adds to the bounds of (1) and (2).
const GLINT_MARGIN: u16 = 3 * LEVEL / 2;
const STEADY_MARGIN: u16 = 5 * LEVEL / 2;

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
fn high(a: u16, b: u16) -> u16 {
    ((u32::from(a) * u32::from(b)) >> 16) as u16
}

/// Brightness over light of a gain in 1/4096, below 4; in 1/64 level.
#[inline(always)]
fn lit(brightness: u16, gain_q12: u16) -> u16 {
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

/// One row of pixels as the model has them.
pub struct Line<'a> {
    pub light: &'a [u16],
    /// The picture before.
    pub before: &'a [u16],
    pub dry: &'a [u16],
    /// The lamp's light, 1/4096.
    pub gain_q12: &'a [u16],
    /// A glint's neighbourhood, not 0: what looks dry there may be its rim.
    pub doubtful: &'a [u16],
    pub over_time: OverTime<'a>,
}

/// What is kept of a row's pixels from picture to picture.
pub struct OverTime<'a> {
    /// State and run.
    pub kept: &'a mut [u16],
    /// The picture since which it looks dry.
    pub since: &'a mut [u16],
    /// The picture in which its film closed again, where it broke before.
    pub until: &'a mut [u16],
    /// How far it was from its dry brightness while it looked dry: a mean that forgets, 1/64 level.
    pub off: &'a mut [i16],
    /// In how many pictures a glint or overexposure hid it.
    pub unseen: &'a mut [u16],
}

/// How a row is judged.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    /// τ in 1/65536.
    pub film_q16: u16,
    /// Pictures that must show a break.
    pub persist: u16,
    /// The picture before: what is steady was so then.
    pub before: u16,
    /// This picture.
    pub now: u16,
    /// How much brighter the light is than before, 1/4096.
    pub brighter_q12: u16,
    /// [`BROKE`] | [`NEW`] while the film is watched, else 0.
    pub notes: u16,
}

/// Judges one row of whole blocks; says whether a pixel of it broke now.
pub fn judge(line: &mut Line<'_>, rule: Rule) -> bool {
    let Line { light, before, dry, gain_q12, doubtful, over_time } = line;
    let OverTime { kept, since, until, off, unseen } = over_time;
    judge_slices((light, before, dry, gain_q12, doubtful), (kept, since, until, off, unseen), rule) & NEW > 0
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
fn judge_slices(
    given: (&[u16], &[u16], &[u16], &[u16], &[u16]),
    over_time: (&mut [u16], &mut [u16], &mut [u16], &mut [i16], &mut [u16]),
    rule: Rule,
) -> u16 {
    let (light, before, dry, gain_q12, doubtful) = given;
    let (kept, since, until, off, unseen) = over_time;
    let mut any = 0_u16;
    for from in (0..light.len()).step_by(BLOCK_PX) {
        let block = from..from + BLOCK_PX;
        // One length for all, so that no bound is checked within the loops.
        let (light, before, dry) = (&light[block.clone()], &before[block.clone()], &dry[block.clone()]);
        let (gain_q12, doubtful) = (&gain_q12[block.clone()], &doubtful[block.clone()]);
        let (kept, off) = (&mut kept[block.clone()], &mut off[block.clone()]);
        let (since, until, unseen) = (&mut since[block.clone()], &mut until[block.clone()], &mut unseen[block]);
        let mut stirred = 0_u16;
        for i in 0..BLOCK_PX {
            let s = light[i] & BRIGHTNESS;
            let dl = lit(dry[i], gain_q12[i]);
            let wet = (s < dl / 2 + high(dl, rule.film_q16) / 2) & (light[i] & HIDDEN == 0);
            let still = wet & (kept[i] & (RUN | OPEN | NEW | EVER_WET) == EVER_WET);
            stirred |= u16::from(!still & (kept[i] & INSIDE > 0));
        }
        if stirred == 0 {
            continue;
        }
        for i in 0..BLOCK_PX {
            let s = light[i] & BRIGHTNESS;
            let dl = lit(dry[i], gain_q12[i]);
            let wl = high(dl, rule.film_q16);
            let glint = (s > glint_from(dl)) | (light[i] & HIDDEN > 0);
            let wet = (s < dl / 2 + wl / 2) & !glint;
            let steady = s.abs_diff(lit(before[i] & BRIGHTNESS, rule.brighter_q12)) <= dl / 16 + STEADY_MARGIN;
            let looks_dry = !wet & !glint & steady & (doubtful[i] == 0);
            let was = kept[i] & RUN;
            let up = u16::from(looks_dry & (was < rule.persist));
            let down = u16::from(wet & (was > 0));
            let run = was + up - down;
            let away = s.wrapping_sub(dl) as i16;
            let mean = if was == 0 { away } else { off[i].wrapping_add(away.wrapping_sub(off[i]) >> 2) };
            off[i] = if looks_dry { mean } else { off[i] };
            since[i] = if (was == 0) & (up == 1) & (kept[i] & BROKE == 0) { rule.before } else { since[i] };
            until[i] = if (was == 1) & (down == 1) { rule.now } else { until[i] };
            unseen[i] += u16::from(glint & (rule.notes > 0));
            // A third of the way from wet to dry: beyond doubt it is wet.
            let surely_wet = (s < wl + high(dl - wl, 21_845)) & !glint;
            let opens = (run >= rule.persist) & (kept[i] & INSIDE > 0);
            let mut next = kept[i] & !(NEW | RUN) | if surely_wet { EVER_WET } else { 0 };
            let new = if opens & (next & BROKE == 0) { rule.notes } else { 0 };
            next = if run == 0 { next & !OPEN } else { next };
            next |= if opens { OPEN | new } else { 0 };
            kept[i] = next | run;
            any |= next;
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRY: u16 = 100 * 64;
    const RULE: Rule = Rule {
        film_q16: (65_536.0 * 0.6) as u16,
        persist: 3,
        before: 0,
        now: 0,
        brighter_q12: 4096,
        notes: BROKE | NEW,
    };

    /// One pixel; the rest of its block lies outside.
    struct One {
        kept: [u16; BLOCK_PX],
        since: [u16; BLOCK_PX],
        until: [u16; BLOCK_PX],
        off: [i16; BLOCK_PX],
        unseen: [u16; BLOCK_PX],
    }

    impl One {
        fn new(run: u16) -> Self {
            let mut kept = [0; BLOCK_PX];
            kept[0] = INSIDE | run;
            let none = [0; BLOCK_PX];
            One { kept, since: none, until: none, off: [0; BLOCK_PX], unseen: none }
        }

        fn judge(&mut self, [before, level]: [u16; 2], gain_q12: u16, rule: Rule) -> bool {
            let One { kept, since, until, off, unseen } = self;
            let mut line = Line {
                light: &[level * 64; BLOCK_PX],
                before: &[before * 64; BLOCK_PX],
                dry: &[DRY; BLOCK_PX],
                gain_q12: &[gain_q12; BLOCK_PX],
                doubtful: &[0; BLOCK_PX],
                over_time: OverTime { kept, since, until, off, unseen },
            };
            judge(&mut line, rule)
        }

        fn run(&self) -> u16 {
            self.kept[0] & RUN
        }
    }

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
        let run_after = |levels: [u16; 2], gain_q12: u16, run: u16| {
            let mut one = One::new(run);
            one.judge(levels, gain_q12, RULE);
            one.run()
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
        let mut one = One::new(0);
        let levels: [u16; 10] = [60, 100, 100, 200, 100, 100, 100, 60, 60, 60];
        let broke: Vec<bool> = levels
            .iter()
            .enumerate()
            .map(|(picture, level)| {
                let before = levels[picture.saturating_sub(1)];
                let now = picture as u16;
                one.judge([before, *level], 4096, Rule { before: now.saturating_sub(1), now, ..RULE })
            })
            .collect();
        assert_eq!(broke.iter().position(|broke| *broke), Some(6));
        assert_eq!((one.since[0], one.until[0], one.unseen[0]), (1, 9, 1));
        assert_eq!(one.kept[0] & (OPEN | BROKE | EVER_WET), BROKE | EVER_WET);
    }

    /// By hand, dry 100 levels: two pictures of 96 are 4 below it; a third of 88 moves the mean by a quarter of 8.
    #[test]
    fn how_far_from_dry_it_was_is_a_mean_that_forgets() {
        let mut one = One::new(0);
        for levels in [[96, 96], [96, 96], [96, 88]] {
            one.judge(levels, 4096, RULE);
        }
        assert_eq!(one.off[0], -6 * 64);
    }

    /// What is left alone is as it would be if it had been judged: wet, seen wet before, no run.
    #[test]
    fn a_wet_block_stays_as_it_is() {
        let mut one = One::new(0);
        one.judge([60, 60], 4096, RULE);
        let kept = one.kept;
        assert_eq!(kept[0], INSIDE | EVER_WET);
        assert!(!one.judge([60, 60], 4096, RULE) && one.kept == kept && one.unseen[0] == 0);
        one.judge([60, 200], 4096, RULE);
        assert_eq!(one.unseen[0], 1);
    }

    /// By hand: of 60, 100 and 30 levels the second is far from the 60 that are expected, the third too.
    #[test]
    fn only_what_is_near_what_is_expected_tells_the_light() {
        let mut light = [0; BLOCK_PX];
        (light[0], light[1], light[2]) = (60 * 64, 100 * 64, 30 * 64);
        let adding = Adding { stride: BLOCK_PX, every: 1, film_q16: RULE.film_q16, band_q10: [820, 1331] };
        let sum = add_up(&light, &[DRY; BLOCK_PX], &[INSIDE; BLOCK_PX], adding);
        assert_eq!((sum.pixels, sum.found), (1, 60 * 64));
        assert!(sum.expected.abs_diff(60 * 64) < 2);
    }
}
