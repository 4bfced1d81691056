//! Classifies each pixel of each picture as film, bare or neither, and counts for how long.
//!
//! Let s be a pixel's look, w its own wet look and d its own dry look in the present light. β is the smallest fraction
//! of its dry look to which a broken place returns, and σ is the clip's noise. A place that broke then has a look from
//! about β d to d. Between this range and the film's look lies the gap g. The half of the gap nearer to the bare look,
//! 6 σ at most, counts as bare:
//!     bare    β d − min(g/2, 6 σ) ≤ s ≤ 9/8 d        if the film is darker,                                     (1)
//!             7/8 β d ≤ s ≤ d + min(g/2, 6 σ)        if it is brighter,
//! and film is every other look on the film's side of the middle of the gap: a surface that is not bare, and was not
//! sanded since its dry picture, has water on it. A look between that middle and (1) is neither: it carries no
//! information, and the run does not change. A place without a dry look of its own is film while |s − w| ≤ a. Outside
//! of this range it is bare, up to the brightest look that a bare place of such a film can have; a is half of the
//! change that a break would cause.
//!
//! Reflections and waves move, and a bare place does not. So a bare look counts only while
//!     |s − s'| ≤ 4 σ + d/32,    s' the look in the picture before.                                              (2)
//! A run counts the time of bare looks against that of film and stays within 0…H (a CUSUM, Page, Biometrika 41, 1954).
//! H is the time for which a place must look bare, minus the step between two pictures: when the run reaches H the film
//! is open, and when it is back at 0 the film is closed. While the place is overexposed or unsteady, the run does not
//! change. Until the film is open, the run begins again if the look differs from the mean of its last second by more
//! than (2) permits. All times are those of the pictures' timestamps.
//!
//! A film that moves looks different from time to time. If the film of a place was calm so far, the place may change
//! within a moment to another steady look that is neither its film's nor a bare one. This model does not know the cause
//! of such a change: the place is marked and does not pass. The same is true for a place that keeps looks on the bare
//! side of the middle of the gap for three seconds and did not break; such a look is never learnt as the look of the
//! film.
//!
//! Most of a panel is film and stays film: a block that contains only such pixels is skipped.
//!
//! A place that is as bright as the dry panel must have the dry panel's colour, too. A film that mirrors something
//! white adds the same amount to each channel. On a coloured panel such a place may be as bright as the dry one without
//! its colour. With the channels' levels s, the dry ones d, the lamp's tint t and the place's own light r,
//!     e = s − r t d,  r = Σ s / Σ t d,        of the dry colour:  max e − min e ≤ 6 levels + max d / 16.       (3)
//! The limit is four times a camera's noise. On a grey panel (3) always holds: colour gives no information there.

#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use super::kernel::{
    BLOCK_PX, BROKE_FLAG, BUSY_FLAG, Block, CELL_PX, EVER_WET_FLAG, INSIDE_FLAG, LEVEL, LOOK_MASK, MOVED_FLAG,
    NEW_BREAK_FLAG, NO_DRY_FLAG, OPEN_FLAG, OVEREXPOSED_FLAG, STEPPED_FLAG, apply_gain, choose, mask,
    multiply_high,
};
use super::light::TileLight;
use multiversion::multiversion;
use std::ops::Range;

/// Number of ticks per second; times are counted in ticks.
pub const TICKS_PER_SECOND: f64 = 64.0;
/// A reflection moves on within this time, s, and a break stays.
pub const REFLECTION_TIME_S: f64 = 3.0;
/// A look may count as bare if it lies outside of the range of bare looks by at most this, in σ …
const BARE_TOLERANCE_SIGMA: u16 = 6;
/// … two looks count as equal if they differ by at most this, in σ …
const EQUALITY_SIGMA: u16 = 4;
/// … and a look is surely water if it lies outside of the range of bare looks by more than this, in σ.
const WATER_SIGMA: u16 = 8;
/// A step changes the look by more than its value divided by this number: at the edge of a shadow the light is not
/// known more exactly, and a film removes two fifths of the brightness.
const STEP_DIVISOR: u16 = 6;
/// A step lasts this long at most, ticks: a quarter of a second, or two pictures …
const MAX_STEP_TICKS: u16 = 16;
/// … and before the step the place was calm for at least this long, ticks: a second.
const MIN_CALM_TICKS: u16 = 64;
/// A place that has a look nearer to bare than to its film for this time, ticks, does not pass.
const MIN_INTERMEDIATE_TICKS: u16 = (REFLECTION_TIME_S * TICKS_PER_SECOND) as u16;
/// The rounding error that is added to a bound.
const ROUNDING_MARGIN: u16 = 3 * LEVEL / 2;

/// The observation of one block of pixels in a picture.
#[derive(Debug, Clone, Copy)]
pub struct BlockObservation<'a> {
    pub current: &'a Block,
    /// The picture before.
    pub previous: &'a Block,
    pub dry: &'a Block,
    /// The gain of the film relative to its wet look, 1/4096.
    pub gain_q12: &'a Block,
    /// The light on a bare place, 1/4096.
    pub light_q12: &'a Block,
}

/// Data about a block's pixels that are stored from picture to picture, in addition to the pixels' states.
#[derive(Debug, Clone, Copy)]
pub struct BlockHistory {
    /// Time for which the pixel has looked bare, ticks.
    pub bare_time: Block,
    /// The picture since which the pixel has looked bare.
    pub bare_since: Block,
    /// The picture in which the pixel's film closed again, if the film broke before.
    pub closed_at: Block,
    /// The mean difference from the pixel's dry look while the pixel looked bare, or from its wet look if it has no dry
    /// look: an exponential moving average, 1/64 level, signed.
    pub bare_difference: Block,
    /// Time for which the pixel showed neither film nor a bare place, ticks …
    pub unseen_time: Block,
    /// … and the picture in which the pixel last showed film or a bare place.
    pub last_seen_at: Block,
    /// Time for which the pixel has had a steady look that is neither film nor bare, ticks.
    pub away_time: Block,
    /// Time at which the pixel last had its film's look, ticks; known while the pixel is busy.
    pub left_wet_at: Block,
    /// Time since which the present wet look has been the film's look, ticks.
    pub wet_look_since: Block,
}

impl BlockHistory {
    pub const NONE: BlockHistory = BlockHistory {
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

/// The parameters for judging pixels.
#[derive(Debug, Clone, Copy)]
pub struct ClassifyParameters {
    /// β in 1/65536.
    pub damp_q16: u16,
    /// a: the limit of |s − w| for a place without a dry look, as a fraction of its wet look, 1/65536.
    pub away_q16: u16,
    /// If a place without a dry look is brighter than this multiple of its wet look, it is not bare, but a reflection
    /// lies on its film. 1/4096, below 4.
    pub bright_q12: u16,
    /// σ, 1/64 level.
    pub noise: u16,
    /// H, ticks; at least one tick.
    pub persist: u16,
    /// The time since the previous picture, ticks.
    pub step: u16,
    /// The time of this picture, ticks.
    pub ticks: u16,
    /// The numbers of the previous picture and of this picture.
    pub previous: u16,
    pub now: u16,
    /// The ratio of the light to the previous light, 1/4096.
    pub brighter_q12: u16,
    /// Power of 2 by which the weight of each picture in the mean look of a bare place is divided: the mean is that of
    /// the last second.
    pub mean: u32,
    /// Power of 2 by which the weight of a new look is divided while the wet look is being learnt; `None` afterwards.
    pub learn: Option<u32>,
}

/// The bare looks of a place, and the permitted variation of its film's look.
#[derive(Debug, Clone, Copy)]
struct BareBounds {
    bare: [u16; 2],
    /// The bare looks together with the half of the gap that is nearer to them.
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
    let away = multiply_high(wet, rule.away_q16).max(EQUALITY_SIGMA * rule.noise);
    let near = choose(has_dry, reach.max(EQUALITY_SIGMA * rule.noise), away);
    let half = [
        choose(darker, low.min(least.saturating_sub(gap / 2)), low),
        choose(brighter, high_end.max(dry + gap / 2), high_end),
    ];
    BareBounds { bare: [low, high_end], half, near, gap }
}

/// Adds the blocks of a row that must be judged; `first` is the index of the row's first block. A block is skipped only
/// if each of its pixels in the region is film and has the look of its film, in this picture and before.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn disturbed_blocks(first: usize, rows: BlockRow<'_>, rule: &ClassifyParameters, found: &mut Vec<usize>) {
    for index in 0..rows.current.len() {
        let (look, dry, state) = (&rows.current[index], &rows.dry[index], &rows.state[index]);
        let (wet, gain_q12, light_q12) = (&rows.wet[index], &rows.gain_q12[index], &rows.light_q12[index]);
        let mut stirred = 0;
        for i in 0..BLOCK_PX {
            let s = look[i] & LOOK_MASK;
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

/// The blocks of a row in a picture.
#[derive(Debug, Clone, Copy)]
pub struct BlockRow<'a> {
    pub current: &'a [Block],
    pub dry: &'a [Block],
    pub state: &'a [Block],
    pub wet: &'a [Block],
    pub gain_q12: &'a [Block],
    pub light_q12: &'a [Block],
}

/// The data of a block's pixels so far: their states, the looks of their film, and their history.
pub struct BlockState<'a> {
    pub state: &'a mut Block,
    pub wet: &'a mut Block,
    pub past: &'a mut BlockHistory,
}

/// Judges one block; returns whether one of its pixels broke in this picture.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn judge(observed: BlockObservation<'_>, known: BlockState<'_>, rule: &ClassifyParameters) -> bool {
    let BlockState { state: states, wet: wets_as, past } = known;
    // These copies have no alias: otherwise the compiler does not vectorize the loop.
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
        let s = look[i] & LOOK_MASK;
        let own = state[i];
        let has_dry = mask(own & NO_DRY_FLAG == 0);
        let visible = mask(look[i] & OVEREXPOSED_FLAG == 0);
        let (w, d) = (apply_gain(wet[i], gain_q12[i]), apply_gain(dry[i], light_q12[i]));
        let BareBounds { bare, half, near, gap } = bounds(w, d, has_dry, rule);
        let change = s.abs_diff(apply_gain(before[i] & LOOK_MASK, rule.brighter_q12));
        let steady = mask(change <= 4 * rule.noise + d / 32) & mask(before[i] & OVEREXPOSED_FLAG == 0);
        let is_near = mask(s.abs_diff(w) <= near);
        let is_bare = mask(s >= bare[0]) & mask(s <= bare[1]) & visible & has_dry; // (1)
        // The look is nearer to bare than to the film. If the place is not bare, it is a break that is damper than the
        // recipe states, or a film that becomes thinner.
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
        // A calm place is not judged; it showed its film up to the previous picture.
        let idle = mask(own & BUSY_FLAG == 0);
        seen_at[i] = choose(seen, rule.now, choose(idle, rule.previous, seen_at[i]));

        // The film's look is learnt for a second, which is long enough. The look of a place that is bare at the
        // beginning is learnt when the place first becomes wet.
        let ever_wet = mask(own & EVER_WET_FLAG > 0);
        let nearer = ((s.wrapping_sub(w) as i16) >> shift) as u16;
        let first = !ever_wet & looks_wet & has_dry & !is_near;
        let outside = multiply_high(d, rule.damp_q16).saturating_sub(s) | s.saturating_sub(d);
        let is_sure = looks_wet & (is_near & mask(gap >= EQUALITY_SIGMA * rule.noise) | mask(outside >= sure));
        let wets = choose(has_dry, is_sure, looks_wet);

        // A step: the look changes from the film's look to another steady look that is not bare.
        let begun = choose(idle, rule.ticks - rule.step, left[i]);
        // A film whose look changed and returned is moving.
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
        // A place that keeps a look nearer to bare than to its film does not pass, whatever caused this look. If the
        // place is bare all the time, it breaks.
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

/// A row of tiles.
pub struct TileRow<'a> {
    /// The number of blocks in each row of the band.
    pub columns: usize,
    pub current: &'a [Block],
    /// The picture before.
    pub previous: &'a [Block],
    pub dry: &'a [Block],
    pub state: &'a mut [Block],
    pub wet: &'a mut [Block],
    pub past: &'a mut [BlockHistory],
    /// For each row, the blocks with pixels of the region.
    pub inside: &'a [Range<usize>],
}

impl TileRow<'_> {
    /// Judges the pixels of the band; `index` is the number of its row of tiles. Returns the pixels that broke in this
    /// picture, as indices of the band.
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
            disturbed_blocks(part.start, blocks, rule, &mut found);
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

/// The largest error in (3) that noise causes, in grey levels; the second constant adds a fraction of the brightest
/// channel.
const MAX_COLOUR_ERROR_LEVELS: f64 = 6.0;
const MAX_COLOUR_ERROR_SHARE: f64 = 1.0 / 16.0;

/// Returns whether (3) holds for a place's channels now and when it was dry.
pub(super) fn has_dry_colour_ratio(now: [u8; 3], dry: [u8; 3], tint: [f64; 3]) -> bool {
    let [now, dry] = [now, dry].map(|rgb| rgb.map(f64::from));
    let lit: [f64; 3] = std::array::from_fn(|i| tint[i] * dry[i]);
    let light = now.iter().sum::<f64>() / lit.iter().sum::<f64>().max(1.0);
    let off: [f64; 3] = std::array::from_fn(|i| now[i] - light * lit[i]);
    let [most, least] = [f64::max, f64::min].map(|of| off.into_iter().reduce(of).unwrap_or(0.0));
    most - least <= MAX_COLOUR_ERROR_LEVELS + MAX_COLOUR_ERROR_SHARE * dry.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a film changes a red primer of (100, 35, 35) to (58, 13, 13). With 25 levels of a white reflection it
    /// is (83, 38, 38), r = 159/170, e = −10.5, 5.3, 5.3. The difference is 15.8 (limit 12.25). On a grey panel the
    /// same reflection does not change the colour.
    #[test]
    fn a_white_reflection_on_red_does_not_have_the_dry_colour() {
        let red = [100, 35, 35];
        let none = [1.0; 3];
        assert!(has_dry_colour_ratio([103, 34, 37], red, none) && has_dry_colour_ratio([80, 28, 28], red, none));
        assert!(!has_dry_colour_ratio([83, 38, 38], red, none));
        assert!(has_dry_colour_ratio([57; 3], [57; 3], none));
        // A lamp that is now a fifth redder turns dry red into (120, 35, 35).
        assert!(has_dry_colour_ratio([120, 35, 35], red, [1.2, 1.0, 1.0]));
    }
}
