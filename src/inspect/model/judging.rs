//! Wet, dry or hidden: each pixel of each picture, and for how long.
//!
//! With brightness s, light g, the dry brightness d and what the film leaves τ, as [`super::kernel`] has them,
//!     dry    g d (1 + τ)/2 ≤ s ≤ 9/8 g d + 1.5 levels,    wet    s below that,    hidden by a glint    s above it.  (1)
//! The rim of a glint may be as bright as a dry place; but it moves, and a dry place keeps its brightness. So dry counts
//! only with
//!     |s − s' g/g'| ≤ g d/16 + 2.5 levels,    s', g' those of the picture before.                             (2)
//! A run counts pictures for dry against pictures for wet and stays within 0…H (a CUSUM, Page, Biometrika 41, 1954):
//! at H the film is open, back at 0 it is closed. Hidden or unsteady, it stays as it is.
//!
//! Most of a panel is wet and stays so: a block of pixels of which that is true is left as it is.

#![allow(unsafe_code, reason = "multiversion's dispatch; nothing here is unsafe by itself")]

use super::kernel::{
    BLOCK_PX, BRIGHTNESS, BROKE, EVER_WET, HIDDEN, INSIDE, LEVEL, NEW, OPEN, RUN, glint_from, high, lit,
};
use multiversion::multiversion;

/// What noise adds to the bound of (2).
const STEADY_MARGIN: u16 = 5 * LEVEL / 2;

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
    /// In how many pictures it showed neither that it is wet nor that it is dry.
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
            unseen[i] += u16::from(!wet & !looks_dry & (rule.notes > 0));
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
        // Unseen in 1 and 4, where it was not steady, and in 3.
        assert_eq!((one.since[0], one.until[0], one.unseen[0]), (1, 9, 3));
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
}
