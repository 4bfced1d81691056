//! Wet, dry or hidden: each pixel of each picture, and for how long.
//!
//! With brightness s, light g, the dry brightness d and what the film leaves τ, as [`super::kernel`] has them,
//!     dry    g d (1 + τ)/2 ≤ s ≤ 9/8 G d + 1.5 levels,    wet    s below that,    hidden by a glint    s above it,  (1)
//! where G ≥ g is the brightest that the light may be there ([`super::light`]).
//! The rim of a glint may be as bright as a dry place; but it moves, and a dry place keeps its brightness. So dry counts
//! only with
//!     |s − s' g/g'| ≤ g d/16 + 2.5 levels,    s', g' those of the picture before.                             (2)
//! A run counts pictures for dry against pictures for wet and stays within 0…H (a CUSUM, Page, Biometrika 41, 1954):
//! at H the film is open, back at 0 it is closed. Hidden or unsteady, it stays as it is.
//!
//! Beside a glint what looks dry may be its rim, and counts for nothing here. But the film's own rim about a break mirrors lamps as
//! well, and that glint stays as long as the break: since when a pixel has looked dry beside a glint is kept for the end of
//! the test, when it belongs to a break that reaches it ([`crate::inspect`]'s `settle`).
//!
//! Most of a panel is wet and stays so: a block of pixels of which that is true is left as it is.

#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use super::kernel::{
    BLOCK_PX, BRIGHTNESS, BROKE, Block, EVER_WET, HIDDEN, INSIDE, LEVEL, NEW, OPEN, RUN, UNTOLD, choose, high,
    is_hidden, lit, where_,
};
use multiversion::multiversion;

/// What noise adds to the bound of (2).
const STEADY_MARGIN: u16 = 5 * LEVEL / 2;

/// The observation of one block of pixels in a picture.
#[derive(Debug, Clone, Copy)]
pub struct BlockObservation<'a> {
    pub light: &'a Block,
    /// The picture before.
    pub before: &'a Block,
    pub dry: &'a Block,
    /// The lamp's light, 1/4096.
    pub gain_q12: &'a Block,
    /// The brightest that it may be there, 1/4096.
    pub ceiling_q12: &'a Block,
    /// A glint's neighbourhood, not 0: what looks dry there may be its rim.
    pub doubtful: &'a Block,
}

/// What is kept of a block's pixels from picture to picture besides their states.
#[derive(Debug, Clone, Copy)]
pub struct Past {
    /// The picture since which it looks dry.
    pub since: Block,
    /// The picture in which its film closed again, where it broke before.
    pub until: Block,
    /// How far it was from its dry brightness while it looked dry: a mean that forgets, 1/64 level; signed.
    pub off: Block,
    /// In how many pictures it showed neither that it is wet nor that it is dry …
    pub unseen: Block,
    /// … and in how many without a break until now.
    pub unseen_now: Block,
    /// The second picture in a row in which it looked dry beside a glint, without having been seen wet since; 0 of none.
    pub beside_glint: Block,
}

impl Past {
    pub const NONE: Past = Past {
        since: [0; BLOCK_PX],
        until: [0; BLOCK_PX],
        off: [0; BLOCK_PX],
        unseen: [0; BLOCK_PX],
        unseen_now: [0; BLOCK_PX],
        beside_glint: [0; BLOCK_PX],
    };
}

/// How pixels are judged.
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

/// What is darker than this is wet, by (1).
#[inline(always)]
fn wet_below(dry_lit: u16, film_q16: u16) -> u16 {
    dry_lit / 2 + high(dry_lit, film_q16) / 2
}

/// Adds those of a row's blocks, the first of them `first`, of which not every pixel of the region is wet and was so
/// before. A hidden pixel is not wet, so no glint lies in another.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn stirred(first: usize, [light, dry, kept, gain_q12]: [&[Block]; 4], film_q16: u16, found: &mut Vec<usize>) {
    for (index, (((light, dry), kept), gain_q12)) in light.iter().zip(dry).zip(kept).zip(gain_q12).enumerate() {
        let mut stirred = 0;
        for i in 0..BLOCK_PX {
            let wet = light[i] & BRIGHTNESS < wet_below(lit(dry[i], gain_q12[i]), film_q16);
            let still =
                wet & (light[i] & HIDDEN == 0) & (kept[i] & (RUN | OPEN | NEW | UNTOLD | EVER_WET) == EVER_WET);
            stirred |= if still { 0 } else { kept[i] & INSIDE };
        }
        if stirred > 0 {
            found.push(first + index);
        }
    }
}

/// Judges one block; says whether a pixel of it broke now.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma", "x86_64+sse4.1+ssse3"))]
pub fn judge(seen: BlockObservation<'_>, kept: &mut Block, past: &mut Past, rule: Rule) -> bool {
    // Copies, which nothing else can point at: else the loop is not turned into vectors.
    let BlockObservation { light, before, dry, gain_q12, ceiling_q12, doubtful } = seen;
    let (light, before, dry, doubtful) = (*light, *before, *dry, *doubtful);
    let (gain_q12, ceiling_q12) = (*gain_q12, *ceiling_q12);
    let Past { mut since, mut until, mut off, mut unseen, mut unseen_now, mut beside_glint } = *past;
    let mut state = *kept;
    let counts = u16::from(rule.notes > 0);
    let mut any = 0;
    for i in 0..BLOCK_PX {
        let s = light[i] & BRIGHTNESS;
        let dl = lit(dry[i], gain_q12[i]);
        let wl = high(dl, rule.film_q16);
        let seen = !where_(is_hidden(light[i], lit(dry[i], ceiling_q12[i])));
        let wet = where_(s < wet_below(dl, rule.film_q16)) & seen;
        let change = s.abs_diff(lit(before[i] & BRIGHTNESS, rule.brighter_q12));
        let steady = where_(change <= dl / 16 + STEADY_MARGIN);
        let as_dry = !wet & seen & steady;
        let looks_dry = as_dry & where_(doubtful[i] == 0);
        let was = state[i] & RUN;
        let up = looks_dry & where_(was < rule.persist);
        let down = wet & where_(was > 0);
        let run = was + (up & 1) - (down & 1);
        let begins = where_(was == 0);
        let away = s.wrapping_sub(dl);
        let change = ((away.wrapping_sub(off[i]) as i16) >> 2) as u16;
        let mean = choose(begins & where_(beside_glint[i] == 0), away, off[i].wrapping_add(change));
        off[i] = choose(looks_dry | as_dry & begins, mean, off[i]);
        let first = choose(where_(beside_glint[i] == 0), rule.before, beside_glint[i].wrapping_sub(1));
        since[i] = choose(begins & up & where_(state[i] & BROKE == 0), first, since[i]);
        until[i] = choose(where_(was == 1) & down, rule.now, until[i]);
        let untold = !wet & !looks_dry & counts;
        unseen[i] += untold;
        unseen_now[i] = (unseen_now[i] + untold) & untold.wrapping_neg();
        let beside = choose(as_dry & !looks_dry & where_(beside_glint[i] == 0), rule.now, beside_glint[i]);
        beside_glint[i] = beside & !wet;
        // A third of the way from wet to dry: beyond doubt it is wet.
        let surely_wet = where_(s < wl + high(dl - wl, 21_845)) & seen;
        let opens = where_(run >= rule.persist) & where_(state[i] & INSIDE > 0);
        let closed = where_(run == 0);
        let mut next = state[i] & !(NEW | UNTOLD | RUN) | surely_wet & EVER_WET | untold.wrapping_neg() & UNTOLD;
        let new = opens & where_(next & BROKE == 0) & rule.notes;
        next = next & !(closed & OPEN) | opens & OPEN | new;
        state[i] = next | run;
        any |= next;
    }
    *kept = state;
    *past = Past { since, until, off, unseen, unseen_now, beside_glint };
    any & NEW > 0
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
        kept: Block,
        past: Past,
        doubtful: u16,
    }

    impl One {
        fn new(run: u16) -> Self {
            let mut kept = [0; BLOCK_PX];
            kept[0] = INSIDE | run;
            One { kept, past: Past::NONE, doubtful: 0 }
        }

        /// Judged where it is stirred, as a band does it.
        fn judge(&mut self, levels: [u16; 2], gain_q12: u16, rule: Rule) -> bool {
            self.judge_below(levels, [gain_q12; 2], rule)
        }

        /// The same where the light may be brighter than it is.
        fn judge_below(
            &mut self,
            [before, level]: [u16; 2],
            [gain_q12, ceiling_q12]: [u16; 2],
            rule: Rule,
        ) -> bool {
            let [before, light, gain_q12, doubtful] =
                [before * 64, level * 64, gain_q12, self.doubtful].map(|n| [n; BLOCK_PX]);
            let mut found = Vec::new();
            let row = [&light, &[DRY; BLOCK_PX], &self.kept, &gain_q12].map(std::slice::from_ref);
            stirred(0, row, rule.film_q16, &mut found);
            let seen = BlockObservation {
                light: &light,
                before: &before,
                dry: &[DRY; BLOCK_PX],
                gain_q12: &gain_q12,
                ceiling_q12: &[ceiling_q12; BLOCK_PX],
                doubtful: &doubtful,
            };
            !found.is_empty() && judge(seen, &mut self.kept, &mut self.past, rule)
        }

        fn run(&self) -> u16 {
            self.kept[0] & RUN
        }
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

    /// By hand, dry 100 levels: where the light is a half and may be whole, dry is up to 112.5 + 1.5, and wet what is below 40.
    #[test]
    fn a_glint_is_brighter_than_the_brightest_light_lets_dry_be() {
        let run_after = |level: u16| {
            let mut one = One::new(1);
            one.judge_below([level; 2], [2048, 4096], RULE);
            one.run()
        };
        assert_eq!([39, 40, 58, 114, 115].map(run_after), [0, 2, 2, 2, 1]);
    }

    /// Hidden in three pictures, wet, hidden in two: two without a break at the end, and wet again none, though the block
    /// is left alone from then on.
    #[test]
    fn what_was_hidden_until_now_is_counted() {
        let mut one = One::new(0);
        let counts = [60_u16, 200, 200, 200, 60, 200, 200, 60, 60].map(|level| {
            one.judge([level; 2], 4096, RULE);
            one.past.unseen_now[0]
        });
        assert_eq!(counts, [0, 1, 2, 3, 0, 1, 2, 0, 0]);
        assert_eq!(one.past.unseen[0], 5);
    }

    /// By hand, dry 100 and wet 60 levels, beside a glint: dry since picture 1 with a hidden one within, never a break; wet it is
    /// none, and dry again it begins anew in picture 7. Once the glint is gone, in picture 9, it has been dry since then.
    #[test]
    fn since_when_it_looks_dry_beside_a_glint_is_kept() {
        let mut one = One { doubtful: 1, ..One::new(0) };
        let levels: [u16; 9] = [60, 100, 100, 100, 200, 100, 60, 100, 100];
        let since = [1, 2, 3, 4, 5, 6, 7, 8].map(|now: u16| {
            let pair = [levels[usize::from(now) - 1], levels[usize::from(now)]];
            assert!(!one.judge(pair, 4096, Rule { before: now - 1, now, ..RULE }), "picture {now}");
            one.past.beside_glint[0]
        });
        assert_eq!(since, [0, 2, 2, 2, 2, 0, 0, 8]);
        one.doubtful = 0;
        one.judge([100; 2], 4096, Rule { before: 8, now: 9, ..RULE });
        assert_eq!(one.past.since[0], 7);
    }

    /// By hand, dry 100 and wet 60 levels: up to 60 + 40/3 = 73.3 it is wet beyond doubt.
    #[test]
    fn a_third_of_the_way_to_dry_it_is_surely_wet() {
        let wet = |level: u16| {
            let mut one = One::new(0);
            one.judge([level; 2], 4096, RULE);
            one.kept[0] & EVER_WET > 0
        };
        assert_eq!([60, 73, 74, 79].map(wet), [true, true, false, false]);
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
        // Unseen in 1 and 4, where it was not steady, and in 3.
        assert_eq!((one.past.since[0], one.past.until[0], one.past.unseen[0]), (1, 9, 3));
        assert_eq!(one.kept[0] & (OPEN | BROKE | EVER_WET), BROKE | EVER_WET);
    }

    /// By hand, dry 100 levels: two pictures of 96 are 4 below it; a third of 88 moves the mean by a quarter of 8.
    #[test]
    fn how_far_from_dry_it_was_is_a_mean_that_forgets() {
        let mut one = One::new(0);
        for levels in [[96, 96], [96, 96], [96, 88]] {
            one.judge(levels, 4096, RULE);
        }
        assert_eq!(one.past.off[0] as i16, -6 * 64);
    }

    /// What is left alone is as it would be if it had been judged: wet, seen wet before, no run.
    #[test]
    fn a_wet_block_stays_as_it_is() {
        let mut one = One::new(0);
        one.judge([60, 60], 4096, RULE);
        let kept = one.kept;
        assert_eq!(kept[0], INSIDE | EVER_WET);
        assert!(!one.judge([60, 60], 4096, RULE) && one.kept == kept && one.past.unseen[0] == 0);
        one.judge([60, 200], 4096, RULE);
        assert_eq!(one.past.unseen[0], 1);
    }
}
