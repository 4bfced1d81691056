//! Classifies each pixel of each picture as film, bare or neither, and measures for how long.
//!
//! Let s be the brightness of a pixel, w the brightness of its film and d its dry brightness in the present light. β is
//! the minimum brightness of a broken pixel as a fraction of its dry brightness, and σ is the noise of the clip. A
//! broken pixel then has a brightness from about β d to d. The gap g lies between this range and the film brightness. A
//! pixel is classified as bare in the range from β d to d, and in the adjacent half of the gap up to 6 σ from this
//! range:
//!     bare    β d − min(g/2, 6 σ) ≤ s ≤ 9/8 d        if the film is darker,                                     (1)
//!             7/8 β d ≤ s ≤ d + min(g/2, 6 σ)        if it is brighter.
//! A pixel is classified as film on the film's side of the middle of the gap: a surface that is not bare, and was not
//! sanded since its dry picture, has water on it. A brightness between the middle of the gap and (1) is neither: it
//! contains no information, and the counter below does not change. A pixel without a dry reference is film while |s −
//! w| ≤ a, where a is half of the change that a break would cause. Outside of this range the pixel is bare, up to the
//! maximum brightness of a bare surface under such a film.
//!
//! Reflections and waves move, and a bare surface does not. A bare brightness is therefore used only while
//!     |s − s'| ≤ 4 σ + d/32,    s' the brightness in the previous picture.                                      (2)
//! A counter adds the time of bare pictures, subtracts the time of film pictures and is limited to 0…H (a CUSUM, Page,
//! Biometrika 41, 1954). H is the minimum time for which a broken pixel appears bare, minus the time between two
//! pictures. When the counter reaches H the film is open, and when it is back at 0 the film is closed. While the pixel
//! is overexposed or unsteady, the counter does not change. Until the film is open, the counter starts again at 0 if
//! the brightness differs from its mean over the last second by more than the limit of (2). All times are differences
//! of the timestamps of the pictures.
//!
//! A moving film changes its brightness now and then. If the film at a pixel was calm so far, its brightness may step
//! within a moment to another steady value that is neither that of the film nor bare. This model does not know the
//! cause of the step, so the pixel is marked and does not pass. The same is true for a pixel whose brightness stays on
//! the bare side of the middle of the gap for three seconds without a break. This brightness is never learnt as the
//! brightness of the film.
//!
//! Most of a panel is film and stays film: a block that contains only such pixels is skipped.
//!
//! A pixel that is as bright as the dry panel must also have the colour of the dry panel. A film that reflects a white
//! object adds the same amount to each channel. On a coloured panel, such a pixel may be as bright as the dry panel but
//! has another colour. With the levels s of the channels, the dry levels d, the tint t of the lamp and the light r at
//! the pixel,
//!     e = s − r t d,  r = Σ s / Σ t d,        of the dry colour:  max e − min e ≤ 6 levels + max d / 16.       (3)
//! The limit is four times the noise of a camera. On a grey panel (3) is always met: its colour contains no
//! information.

#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use super::kernel::{
    BLOCK_PX, BRIGHTNESS_MASK, BROKE_FLAG, BUSY_FLAG, Block, CELL_PX, EVER_WET_FLAG, INSIDE_FLAG, LEVEL,
    MOVED_FLAG, NEW_BREAK_FLAG, NO_DRY_FLAG, OPEN_FLAG, OVEREXPOSED_FLAG, STEPPED_FLAG, apply_gain, choose, mask,
    multiply_high,
};
use super::light::TileLight;
use multiversion::multiversion;
use std::ops::Range;

/// Number of ticks per second, the unit of time in this model.
pub const TICKS_PER_SECOND: f64 = 64.0;
/// Maximum time for which a reflection stays at a pixel, s; a break stays longer.
pub const REFLECTION_TIME_S: f64 = 3.0;
/// Maximum distance of a bare brightness from the range between β d and d, as a multiple of σ.
const BARE_TOLERANCE_SIGMA: u16 = 6;
/// Maximum difference of two brightness values that are treated as equal, as a multiple of σ.
const EQUALITY_TOLERANCE_SIGMA: u16 = 4;
/// Minimum distance from the range of bare brightness at which a pixel certainly shows water, as a multiple of σ.
const WATER_SIGMA: u16 = 8;
/// Divisor for the minimum change of a step: a step changes the brightness by more than the brightness divided by this
/// number. At the edge of a shadow the light is not known more exactly; a film removes 40 % of the brightness.
const STEP_DIVISOR: u16 = 6;
/// Maximum duration of a step, ticks: a quarter of a second, or two pictures.
const MAX_STEP_TICKS: u16 = 16;
/// Minimum time for which the pixel was calm before a step, ticks: one second.
const MIN_CALM_TICKS: u16 = 64;
/// Minimum time, ticks, after which a pixel with a brightness nearer to bare than to film does not pass.
const MIN_INTERMEDIATE_TICKS: u16 = (REFLECTION_TIME_S * TICKS_PER_SECOND) as u16;
/// Rounding error that is added to a limit, 1/64 grey level.
const ROUNDING_MARGIN: u16 = 3 * LEVEL / 2;

/// The observation of one block of pixels in one picture.
#[derive(Debug, Clone, Copy)]
pub struct BlockObservation<'a> {
    pub current: &'a Block,
    /// The brightness in the previous picture.
    pub previous: &'a Block,
    pub dry: &'a Block,
    /// Ratio of the film's light to the light in which its brightness was learnt, 1/4096.
    pub gain_q12: &'a Block,
    /// Ratio of the light on a bare surface to the light of the dry picture, 1/4096.
    pub light_q12: &'a Block,
}

/// The history of a block's pixels from picture to picture, in addition to the states of the pixels.
#[derive(Debug, Clone, Copy)]
pub struct BlockHistory {
    /// Time for which the pixel has appeared bare, ticks.
    pub bare_time: Block,
    /// Number of the picture since which the pixel has appeared bare.
    pub bare_since: Block,
    /// Number of the picture in which the film closed again at the pixel, if it broke before.
    pub closed_at: Block,
    /// Mean difference from the dry brightness while the pixel appeared bare; for a pixel without a dry reference, from
    /// the film brightness. An exponential moving average, 1/64 level, signed.
    pub bare_difference: Block,
    /// Time for which the pixel showed neither film nor a bare surface, ticks.
    pub unseen_time: Block,
    /// Number of the picture in which the pixel last showed film or a bare surface.
    pub last_seen_at: Block,
    /// Time for which the pixel has had a steady brightness that is neither film nor bare, ticks.
    pub away_time: Block,
    /// Time at which the pixel last had the brightness of its film, ticks; known while the pixel is busy.
    pub left_wet_at: Block,
    /// Time since which the present wet brightness has been the brightness of the film, ticks.
    pub wet_look_since: Block,
}

impl BlockHistory {
    pub const EMPTY: BlockHistory = BlockHistory {
        bare_time: [0; BLOCK_PX],
        bare_since: [0; BLOCK_PX],
        closed_at: [0; BLOCK_PX],
        bare_difference: [0; BLOCK_PX],
        unseen_time: [0; BLOCK_PX],
        last_seen_at: [0; BLOCK_PX],
        away_time: [0; BLOCK_PX],
        left_wet_at: [0; BLOCK_PX],
        wet_look_since: [0; BLOCK_PX],
    };
}

/// The parameters for the classification of pixels.
#[derive(Debug, Clone, Copy)]
pub struct ClassifyParameters {
    /// β, minimum brightness of a broken pixel as a fraction of its dry brightness, 1/65536.
    pub damp_q16: u16,
    /// a: limit of |s − w| for a pixel without a dry reference, as a fraction of its film brightness, 1/65536.
    pub away_q16: u16,
    /// Maximum brightness of a bare pixel without a dry reference, as a multiple of its film brightness, 1/4096, below
    /// 4. A brighter pixel shows a reflection on its film.
    pub bright_q12: u16,
    /// σ, the noise of the clip, 1/64 level.
    pub noise: u16,
    /// H, the maximum of the counter, ticks; at least one tick.
    pub persist: u16,
    /// Time since the previous picture, ticks.
    pub step: u16,
    /// Time of this picture, ticks.
    pub ticks: u16,
    /// Number of the previous picture and of this picture.
    pub previous: u16,
    pub now: u16,
    /// Ratio of the present light to the light of the previous picture, 1/4096.
    pub brighter_q12: u16,
    /// Power of 2 by which the weight of each picture in the mean bare brightness is divided: the mean covers the last
    /// second.
    pub mean: u32,
    /// Power of 2 by which the weight of a new brightness is divided while the film brightness is being learnt; `None`
    /// afterwards.
    pub learn: Option<u32>,
}

/// The limits of the bare brightness of a pixel, and the permitted variation of its film brightness.
#[derive(Debug, Clone, Copy)]
struct BareBounds {
    bare: [u16; 2],
    /// Minimum and maximum of the bare range with the adjacent half of the gap.
    half: [u16; 2],
    near: u16,
    gap: u16,
}

#[inline(always)]
fn bounds(wet: u16, dry: u16, has_dry: u16, rule: &ClassifyParameters) -> BareBounds {
    let least = multiply_high(dry, rule.damp_q16);
    let (darker, brighter) = (mask(wet < least), mask(wet > dry));
    let gap = least.saturating_sub(wet) | wet.saturating_sub(dry);
    let reach = (gap / 2).min(BARE_TOLERANCE_SIGMA * rule.noise);
    let low = choose(
        darker,
        least.saturating_sub(reach),
        choose(brighter, (least - least / 8).saturating_sub(ROUNDING_MARGIN), least),
    );
    let high_end = choose(brighter, dry + reach, dry + dry / 8 + ROUNDING_MARGIN);
    let away = multiply_high(wet, rule.away_q16).max(EQUALITY_TOLERANCE_SIGMA * rule.noise);
    let near = choose(has_dry, reach.max(EQUALITY_TOLERANCE_SIGMA * rule.noise), away);
    let half = [
        choose(darker, low.min(least.saturating_sub(gap / 2)), low),
        choose(brighter, high_end.max(dry + gap / 2), high_end),
    ];
    BareBounds { bare: [low, high_end], half, near, gap }
}

/// Appends the blocks of a row that must be judged; `first` is the index of the row's first block. A block is skipped
/// only if each of its pixels in the region is film and has the brightness of its film, in this and in the previous
/// picture.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn append_disturbed_blocks(
    first: usize,
    rows: BlockRow<'_>,
    rule: &ClassifyParameters,
    found: &mut Vec<usize>,
) {
    for index in 0..rows.current.len() {
        let (look, dry, state) = (&rows.current[index], &rows.dry[index], &rows.state[index]);
        let (wet, gain_q12, light_q12) = (&rows.wet[index], &rows.gain_q12[index], &rows.light_q12[index]);
        let mut stirred = 0;
        for i in 0..BLOCK_PX {
            let s = look[i] & BRIGHTNESS_MASK;
            let has_dry = mask(state[i] & NO_DRY_FLAG == 0);
            let wet = apply_gain(wet[i], gain_q12[i]);
            let BareBounds { bare, near, .. } = bounds(wet, apply_gain(dry[i], light_q12[i]), has_dry, rule);
            let is_bare = mask(s >= bare[0]) & mask(s <= bare[1]) & has_dry;
            let calm = mask(s.abs_diff(wet) <= near) & !is_bare & mask(look[i] & OVEREXPOSED_FLAG == 0);
            let still =
                calm & mask(state[i] & (BUSY_FLAG | OPEN_FLAG | NEW_BREAK_FLAG | EVER_WET_FLAG) == EVER_WET_FLAG);
            stirred |= !still & state[i] & INSIDE_FLAG;
        }
        if stirred > 0 {
            found.push(first + index);
        }
    }
}

/// The blocks of a row in one picture.
#[derive(Debug, Clone, Copy)]
pub struct BlockRow<'a> {
    pub current: &'a [Block],
    pub dry: &'a [Block],
    pub state: &'a [Block],
    pub wet: &'a [Block],
    pub gain_q12: &'a [Block],
    pub light_q12: &'a [Block],
}

/// The state of a block so far: the states of its pixels, the brightness of their film, and their history.
pub struct BlockState<'a> {
    pub state: &'a mut Block,
    pub wet: &'a mut Block,
    pub past: &'a mut BlockHistory,
}

/// Judges one block; returns whether one of its pixels broke in this picture.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn judge(observed: BlockObservation<'_>, known: BlockState<'_>, rule: &ClassifyParameters) -> bool {
    let BlockState { state: states, wet: wets_as, past } = known;
    // These copies have no alias; with aliases the compiler does not vectorize the loop.
    let BlockObservation { current: look, previous: before, dry, gain_q12, light_q12 } = observed;
    let (look, before, dry, gain_q12, light_q12) = (*look, *before, *dry, *gain_q12, *light_q12);
    let mut wet = *wets_as;
    let BlockHistory {
        bare_time: mut run,
        bare_since: mut since,
        closed_at: mut until,
        bare_difference: mut off,
        ..
    } = *past;
    let BlockHistory {
        unseen_time: mut unseen,
        last_seen_at: mut seen_at,
        away_time: mut away,
        left_wet_at: mut left,
        wet_look_since: mut anchored,
        ..
    } = *past;
    let mut state = *states;
    let learns = mask(rule.learn.is_some());
    let shift = rule.learn.unwrap_or(0);
    let sure = WATER_SIGMA * rule.noise;
    let mut any = 0;
    for i in 0..BLOCK_PX {
        let s = look[i] & BRIGHTNESS_MASK;
        let own = state[i];
        let has_dry = mask(own & NO_DRY_FLAG == 0);
        let visible = mask(look[i] & OVEREXPOSED_FLAG == 0);
        let (w, d) = (apply_gain(wet[i], gain_q12[i]), apply_gain(dry[i], light_q12[i]));
        let BareBounds { bare, half, near, gap } = bounds(w, d, has_dry, rule);
        let change = s.abs_diff(apply_gain(before[i] & BRIGHTNESS_MASK, rule.brighter_q12));
        let steady = mask(change <= 4 * rule.noise + d / 32) & mask(before[i] & OVEREXPOSED_FLAG == 0);
        let is_near = mask(s.abs_diff(w) <= near);
        let is_bare = mask(s >= bare[0]) & mask(s <= bare[1]) & visible & has_dry; // (1)
        // The brightness is nearer to bare than to film. If the pixel is not bare, it is a break that is damper than
        // the recipe states, or a film that becomes thinner.
        let is_nearer = mask(s >= half[0]) & mask(s <= half[1]) & !is_near & has_dry & visible;
        let is_between = is_nearer & !is_bare;
        let is_bright = mask(s > apply_gain(w, rule.bright_q12));
        let looks_bare = choose(has_dry, is_bare, !is_near & !is_bright & visible) & steady; // (2)
        let looks_wet = choose(has_dry, !is_bare & !is_between, is_near | is_bright) & visible;

        let from = s.wrapping_sub(choose(has_dry, d, w));
        let drift = from.wrapping_sub(off[i]) as i16;
        let drifted =
            mask(drift.unsigned_abs() > 4 * rule.noise + d / 32) & looks_bare & mask(own & OPEN_FLAG == 0);
        let was = run[i] & !drifted;
        let grown = (was + (rule.step & !drifted)).min(rule.persist);
        run[i] = choose(looks_bare, grown, choose(looks_wet, was.saturating_sub(rule.step), was));
        since[i] = choose(mask(was == 0) & looks_bare & mask(own & BROKE_FLAG == 0), rule.previous, since[i]);
        let closes = mask(was > 0) & mask(run[i] == 0);
        until[i] = choose(closes, rule.now, until[i]);
        let nearer = (drift >> rule.mean) as u16;
        off[i] = choose(looks_bare, choose(mask(was == 0), from, off[i].wrapping_add(nearer)), off[i]);

        let seen = looks_bare | looks_wet;
        unseen[i] += rule.step & !seen;
        // A calm pixel is not judged; it showed its film up to the previous picture.
        let idle = mask(own & BUSY_FLAG == 0);
        seen_at[i] = choose(seen, rule.now, choose(idle, rule.previous, seen_at[i]));

        // The film brightness is learnt for one second. If a pixel is bare at the beginning, its film brightness is
        // learnt when the pixel first becomes wet.
        let ever_wet = mask(own & EVER_WET_FLAG > 0);
        let nearer = ((s.wrapping_sub(w) as i16) >> shift) as u16;
        let first = !ever_wet & looks_wet & has_dry & !is_near;
        let outside = multiply_high(d, rule.damp_q16).saturating_sub(s) | s.saturating_sub(d);
        let is_sure =
            looks_wet & (is_near & mask(gap >= EQUALITY_TOLERANCE_SIGMA * rule.noise) | mask(outside >= sure));
        let wets = choose(has_dry, is_sure, looks_wet);

        // A step: the brightness changes from that of the film to another steady value that is not bare.
        let begun = choose(idle, rule.ticks - rule.step, left[i]);
        // A film whose brightness changed and returned is moving.
        let moved = is_near & has_dry & !idle & mask(rule.ticks - begun > rule.step);
        left[i] = choose(is_near & visible, rule.ticks, begun);
        let is_far = mask(s.abs_diff(w) > w / STEP_DIVISOR);
        let is_away = (looks_wet | is_nearer) & has_dry & !is_near & is_far & steady & ever_wet;
        away[i] = (away[i].min(rule.persist.max(MIN_INTERMEDIATE_TICKS)) + rule.step) & is_away;
        let reached = is_away & mask(away[i] >= rule.persist);
        let took = rule.ticks.saturating_sub(away[i]).saturating_sub(left[i]);
        let calm = mask(left[i].saturating_sub(anchored[i]) >= MIN_CALM_TICKS);
        let quick = mask(took <= MAX_STEP_TICKS.max(2 * rule.step));
        let took_another = reached & quick & calm & mask(own & MOVED_FLAG == 0) & !is_nearer;
        // A pixel whose brightness stays nearer to bare than to film does not pass, whatever the cause. If the pixel is
        // bare all the time, it breaks.
        let stepped = took_another | is_between & mask(away[i] >= MIN_INTERMEDIATE_TICKS);
        let anchors = (reached & !stepped & !is_nearer) | first;
        wet[i] = choose(anchors, s, choose(learns & is_near & !is_bare, wet[i].wrapping_add(nearer), wet[i]));
        anchored[i] = choose(anchors, rule.ticks, anchored[i]);
        away[i] &= !anchors;

        let opens = mask(run[i] >= rule.persist) & mask(own & INSIDE_FLAG > 0);
        let closed = mask(run[i] == 0);
        let busy = mask(run[i] > 0) | mask(away[i] > 0) | !seen | (!is_near & has_dry) | learns;
        let new = opens & mask(own & BROKE_FLAG == 0) & (BROKE_FLAG | NEW_BREAK_FLAG);
        let kept = own & !(NEW_BREAK_FLAG | BUSY_FLAG) & !(closed & OPEN_FLAG);
        let next = kept
            | opens & OPEN_FLAG
            | new
            | wets & EVER_WET_FLAG
            | stepped & STEPPED_FLAG
            | moved & MOVED_FLAG
            | busy & BUSY_FLAG;
        state[i] = next;
        any |= next;
    }
    (*states, *wets_as) = (state, wet);
    *past = BlockHistory {
        bare_time: run,
        bare_since: since,
        closed_at: until,
        bare_difference: off,
        unseen_time: unseen,
        last_seen_at: seen_at,
        away_time: away,
        left_wet_at: left,
        wet_look_since: anchored,
    };
    any & NEW_BREAK_FLAG > 0
}

/// The pixels of a row of tiles, with their state.
pub struct TileRow<'a> {
    /// Number of blocks in each row of the band.
    pub columns: usize,
    pub current: &'a [Block],
    /// The brightness in the previous picture.
    pub previous: &'a [Block],
    pub dry: &'a [Block],
    pub state: &'a mut [Block],
    pub wet: &'a mut [Block],
    pub past: &'a mut [BlockHistory],
    /// For each row of pixels, the range of blocks that contain pixels of the region.
    pub inside: &'a [Range<usize>],
}

impl TileRow<'_> {
    /// Judges the pixels of the band; `index` is the index of its row of tiles. Returns the pixels that broke in this
    /// picture, as indices within the band.
    pub fn judge(&mut self, light: &TileLight, index: usize, rule: &ClassifyParameters) -> Vec<usize> {
        let columns = self.columns;
        let gains = light.blocks_q12(index);
        let bare = light.bare_light_q12(&gains);
        // All rows of pixels in a row of cells share one row of gains.
        let cells = |at: usize| at / columns / CELL_PX * columns + at % columns;
        let mut found = Vec::new();
        for (row, inside) in self.inside.iter().enumerate() {
            let part = row * columns + inside.start..row * columns + inside.end;
            let lights = row / CELL_PX * columns + inside.start..row / CELL_PX * columns + inside.end;
            let blocks = BlockRow {
                current: &self.current[part.clone()],
                dry: &self.dry[part.clone()],
                state: &self.state[part.clone()],
                wet: &self.wet[part.clone()],
                gain_q12: &gains[lights.clone()],
                light_q12: &bare[lights],
            };
            append_disturbed_blocks(part.start, blocks, rule, &mut found);
        }
        let mut broke = Vec::new();
        for at in found {
            let observed = BlockObservation {
                current: &self.current[at],
                previous: &self.previous[at],
                dry: &self.dry[at],
                gain_q12: &gains[cells(at)],
                light_q12: &bare[cells(at)],
            };
            let known = BlockState { state: &mut self.state[at], wet: &mut self.wet[at], past: &mut self.past[at] };
            if judge(observed, known, rule) {
                let new = (0..BLOCK_PX).filter(|&i| self.state[at][i] & NEW_BREAK_FLAG > 0);
                broke.extend(new.map(|i| at * BLOCK_PX + i));
            }
        }
        broke
    }
}

/// Maximum error in (3) that noise causes, grey levels; `MAX_RELATIVE_COLOUR_ERROR` adds a fraction of the brightest
/// channel.
const MAX_COLOUR_ERROR_LEVELS: f64 = 6.0;
const MAX_RELATIVE_COLOUR_ERROR: f64 = 1.0 / 16.0;

/// Returns whether (3) is met for the channels of a pixel now and in the dry picture.
pub(super) fn has_dry_colour_ratio(now: [u8; 3], dry: [u8; 3], tint: [f64; 3]) -> bool {
    let [now, dry] = [now, dry].map(|rgb| rgb.map(f64::from));
    let lit: [f64; 3] = std::array::from_fn(|i| tint[i] * dry[i]);
    let light = now.iter().sum::<f64>() / lit.iter().sum::<f64>().max(1.0);
    let off: [f64; 3] = std::array::from_fn(|i| now[i] - light * lit[i]);
    let [most, least] = [f64::max, f64::min].map(|of| off.into_iter().reduce(of).unwrap_or(0.0));
    most - least <= MAX_COLOUR_ERROR_LEVELS + MAX_RELATIVE_COLOUR_ERROR * dry.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: a film changes a red primer of (100, 35, 35) to (58, 13, 13). With a white
    /// reflection of 25 levels it is (83, 38, 38), r = 159/170, e = −10.5, 5.3, 5.3. The difference is 15.8 (limit
    /// 12.25). On a grey panel the same reflection does not change the colour.
    #[test]
    fn a_white_reflection_on_red_does_not_have_the_dry_colour() {
        let red = [100, 35, 35];
        let none = [1.0; 3];
        assert!(has_dry_colour_ratio([103, 34, 37], red, none) && has_dry_colour_ratio([80, 28, 28], red, none));
        assert!(!has_dry_colour_ratio([83, 38, 38], red, none));
        assert!(has_dry_colour_ratio([57; 3], [57; 3], none));
        // A lamp that is 20 % redder than before changes the dry red to (120, 35, 35).
        assert!(has_dry_colour_ratio([120, 35, 35], red, [1.2, 1.0, 1.0]));
    }
}
