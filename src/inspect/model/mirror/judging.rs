//! Wet or dry where a film mirrors: each pixel of each picture, and for how long.
//!
//! A place that looks dry keeps its brightness from picture to picture, as a mirrored edge that waves carry along does not. A run
//! counts pictures for dry against pictures for wet and stays within 0…H, as in [`super::super::judging`].

#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use super::super::kernel::{
    BLOCK_PX, BROKE, Block, EVER_WET, HIDDEN, INSIDE, LEVEL, NEW, OPEN, RUN, choose, where_,
};
use multiversion::multiversion;

/// Film and dry must differ by this much, 1/64 level: a little below the 6 levels that a place needs, for its own noise.
pub const MIN_CONTRAST: u16 = 11 * LEVEL / 2;
/// Within these bounds, 1/64 level, lies half of the contrast.
const BOUND: [u16; 2] = [3 * LEVEL, 10 * LEVEL];
/// From one picture to the next a dry place may change by this and a sixteenth of itself.
const STEADY_MARGIN: u16 = 5 * LEVEL / 2;
/// More contrast than this is not remembered, 1/64 level.
const MOST_CONTRAST: u16 = 60 * LEVEL;

/// What is kept of a block's pixels from picture to picture besides their states.
#[derive(Debug, Clone, Copy)]
pub struct Past {
    /// The picture since which it looks dry.
    pub since: Block,
    /// The picture in which its film closed again, where it broke before.
    pub until: Block,
    /// c of (1).
    pub contrast: Block,
    /// In how many pictures it showed neither that it is wet nor that it is dry …
    pub unseen: Block,
    /// … and in how many without a break until now.
    pub unseen_now: Block,
    /// How far from its dry brightness it was while it looked dry: a mean that forgets, 1/64 level; signed.
    pub off: Block,
}

impl Past {
    pub const NONE: Past = Past {
        since: [0; BLOCK_PX],
        until: [0; BLOCK_PX],
        contrast: [0; BLOCK_PX],
        unseen: [0; BLOCK_PX],
        unseen_now: [0; BLOCK_PX],
        off: [0; BLOCK_PX],
    };

    /// The contrast of the first wet picture.
    pub fn begin(&mut self, light: &Block, dry: &Block) {
        for i in 0..BLOCK_PX {
            self.contrast[i] = (light[i] & !HIDDEN).abs_diff(dry[i] & !HIDDEN).min(MOST_CONTRAST);
        }
    }
}

/// How pixels are judged.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    /// Pictures that must show a break.
    pub persist: u16,
    /// The picture before: what is steady was so then.
    pub before: u16,
    /// This picture.
    pub now: u16,
}

/// Judges one block, its brightness now, in the picture before and when dry; says whether a pixel of it broke now.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn judge([light, before, dry]: [&Block; 3], kept: &mut Block, past: &mut Past, rule: Rule) -> bool {
    // Copies, which nothing else can point at: else the loop is not turned into vectors.
    let (light, before, dry) = (*light, *before, *dry);
    let (mut state, Past { mut since, mut until, mut contrast, mut unseen, mut unseen_now, mut off }) =
        (*kept, *past);
    let mut any = 0;
    for i in 0..BLOCK_PX {
        let (s, d) = (light[i] & !HIDDEN, dry[i] & !HIDDEN);
        let away = s.abs_diff(d).min(MOST_CONTRAST);
        let bound = (contrast[i] / 2).max(BOUND[0]).min(BOUND[1]);
        let overexposed = where_(light[i] & HIDDEN > 0);
        let near = where_(away <= bound) & !overexposed; // (1)
        let steady = where_(s.abs_diff(before[i] & !HIDDEN) <= d / 16 + STEADY_MARGIN);
        let (looks_dry, wet) = (near & steady, !near);
        let was = state[i] & RUN;
        let up = looks_dry & where_(was < rule.persist);
        let down = wet & where_(was > 0);
        let run = was + (up & 1) - (down & 1);
        let change = ((away.wrapping_sub(contrast[i]) as i16) >> 3) as u16;
        contrast[i] = choose(wet, contrast[i].wrapping_add(change), contrast[i]);
        let signed = s.wrapping_sub(d);
        let nearer = ((signed.wrapping_sub(off[i]) as i16) >> 3) as u16;
        let mean = choose(where_(was == 0), signed, off[i].wrapping_add(nearer));
        off[i] = choose(looks_dry, mean, off[i]);
        let tells = where_(contrast[i] >= MIN_CONTRAST);
        since[i] = choose(where_(was == 0) & up & where_(state[i] & BROKE == 0), rule.before, since[i]);
        until[i] = choose(where_(was == 1) & down, rule.now, until[i]);
        let untold = !wet & !looks_dry & 1;
        unseen[i] += untold;
        unseen_now[i] = (unseen_now[i] + untold) & untold.wrapping_neg();
        let opens = where_(run >= rule.persist) & where_(state[i] & INSIDE > 0) & tells;
        let closed = where_(run == 0);
        let mut next = state[i] & !(NEW | RUN) | wet & tells & EVER_WET;
        let new = opens & where_(next & BROKE == 0) & (BROKE | NEW);
        next = next & !(closed & OPEN) | opens & OPEN | new;
        state[i] = next | run;
        any |= next;
    }
    *kept = state;
    *past = Past { since, until, contrast, unseen, unseen_now, off };
    any & NEW > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRY: u16 = 70;
    const RULE: Rule = Rule { persist: 3, before: 0, now: 1 };

    /// One pixel of the region through pictures of these levels, the first of them wet; in how many it had broken.
    fn broke_in(levels: &[u16]) -> usize {
        let block = |level: u16| [level * LEVEL; BLOCK_PX];
        let (mut kept, mut past) = ([0; BLOCK_PX], Past::NONE);
        kept[0] = INSIDE;
        past.begin(&block(levels[0]), &block(DRY));
        let pairs = levels.windows(2);
        let broke = |pair: &[u16]| {
            judge([&block(pair[1]), &block(pair[0]), &block(DRY)], &mut kept, &mut past, RULE);
            kept[0] & BROKE > 0
        };
        pairs.map(broke).filter(|broke| *broke).count()
    }

    /// By hand, dry 70 levels: a film of 55 or of 90 that becomes dry has broken in the third picture that shows it, the one
    /// in which it changes counting for nothing; a film of 74 levels is not told from dry.
    #[test]
    fn a_break_is_told_from_a_darker_and_from_a_brighter_film_and_not_without_contrast() {
        for film in [55, 90] {
            assert_eq!(broke_in(&[film, film, 70, 71, 70, 69]), 1, "{film}");
        }
        assert_eq!(broke_in(&[74, 74, 70, 71, 70, 69]), 0);
    }

    /// Waves carry a mirrored edge to and fro: dry for a picture, or as dry and unsteady, is no break.
    #[test]
    fn what_the_waves_carry_past_is_no_break() {
        assert_eq!(broke_in(&[90, 70, 50, 70, 90, 70, 50, 70, 90]), 0);
        assert_eq!(broke_in(&[90, 62, 78, 62, 78, 62, 78, 62]), 0, "each of them near, none steady");
    }
}
