//! The results of many clips of one renderer, grid by grid.

use crate::goal::Figure;
use panelprep::geometry::Mask;
use panelprep::geometry::statistics::{QuantileRank, quantile};
use panelprep::inspect::{GridInspection, Inspection, score_within};
use panelprep::panel::GridId;
use std::collections::BTreeMap;
use std::time::Duration;

/// Minimum difference between film and break at which a point has contrast, as a multiple of the noise, for breaks with
/// the recipe's maximum dampness.
pub const CONTRAST_TO_NOISE: f64 = 10.0;
/// Minimum brightness of a damp break according to the recipes, as a fraction of the dry brightness.
const DAMP_BRIGHTNESS: f64 = 0.8;
/// Minimum fraction of a grid's points with contrast at which the grid has contrast.
const MIN_CONTRAST_FRACTION: f64 = 0.95;

/// The ground truth of a clip; masks and values have the pixels of its pictures.
pub struct Truth<'a> {
    /// The pixels at which the film is broken at the end of the observation.
    pub broken: &'a Mask,
    /// The pixels at which the film is broken in the last picture.
    pub later: &'a Mask,
    /// The difference between film and break at each pixel, as a multiple of the noise: see [`contrast_to_noise`].
    pub contrast: &'a [f64],
}

/// Returns the difference between a film and the most similar break, as a multiple of the noise: that of the channel
/// with the largest difference, or that of the channels' mean if it is larger. `noise` returns the noise of one
/// channel at its level.
pub fn contrast_to_noise([dry, wet]: [[f64; 3]; 2], noise: impl Fn(f64) -> f64) -> f64 {
    let gap = |dry: f64, wet: f64| (DAMP_BRIGHTNESS * dry - wet).max(wet - dry);
    let mean = |rgb: [f64; 3]| rgb.iter().sum::<f64>() / 3.0;
    let of_mean = gap(mean(dry), mean(wet)) / (noise(mean(dry)) / 3.0_f64.sqrt());
    (0..3).map(|i| gap(dry[i], wet[i]) / noise(dry[i])).fold(of_mean, f64::max)
}

/// One clip, with the values that are printed for the clip.
pub struct Clip<'a> {
    pub renderer: &'static str,
    pub seed: u64,
    pub kind: &'a str,
    pub frames_per_second: f64,
    /// Number of grids that were sanded before the film.
    pub sanded: usize,
}

/// The result of a grid: judged, or not seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Found {
    Passed,
    Failed,
    NotSeen,
}

/// The figures that are reported for the clips of one renderer.
pub struct Figures {
    /// Number of grids with a true break that passed.
    pub passed: Figure,
    /// Fraction of clean grids that failed.
    pub failed: Figure,
    pub not_seen: Option<Figure>,
    pub iou: Option<Figure>,
    pub time: Option<Figure>,
}

/// Maximum fraction of clean grids that fail.
const MAX_CLEAN_FAILED_FRACTION: f64 = 0.005;
/// Maximum fraction of clean grids that are not seen.
const MAX_CLEAN_NOT_SEEN_FRACTION: f64 = 0.03;
/// Minimum intersection over union of the found and the true breaks.
const MIN_IOU: f64 = 0.95;
/// Minimum fraction of breaks whose time is correct.
const MIN_TIMELY_FRACTION: f64 = 0.95;

/// Statistics of all clips of one renderer.
#[derive(Debug, Default)]
pub struct Tally {
    clips: usize,
    invalid: BTreeMap<String, usize>,
    /// Results of grids with a true break.
    broken: BTreeMap<Found, usize>,
    /// Results of clean grids with contrast.
    clean: BTreeMap<Found, usize>,
    /// Results of the other clean grids.
    faint: BTreeMap<Found, usize>,
    /// Results of sanded grids with a true break.
    sanded_broken: BTreeMap<Found, usize>,
    /// Results of sanded clean grids.
    sanded_clean: BTreeMap<Found, usize>,
    iou: Vec<f64>,
    judging: Vec<Duration>,
    time_errors_s: Vec<f64>,
}

/// Returns whether no grid of a clip was judged, for a reason that concerns all of its pictures.
fn is_unjudged(inspection: &Inspection) -> bool {
    const OF_GRIDS: [&str; 5] = ["not_seen", "no_contrast", "wet_when_dry", "broken", "masked"];
    inspection.judgement.reasons.iter().any(|reason| !OF_GRIDS.contains(&&*reason.code))
}

impl Tally {
    pub fn judged_in(&mut self, duration: Duration) {
        self.judging.push(duration);
    }

    /// Adds a clip. `sanded` contains the grids that were sanded before the film.
    pub fn add(
        &mut self,
        clip: &Clip<'_>,
        inspection: &Inspection,
        truth: &Truth<'_>,
        sanded: impl Fn(GridId) -> bool,
    ) {
        let footprint = &inspection.footprint;
        let region = footprint.region();
        let unjudged = is_unjudged(inspection);
        let [real_mm2, later_mm2] = [truth.broken, truth.later].map(|mask| footprint.broken_mm2(mask));
        let clear = Mask {
            inside: (0..truth.contrast.len()).map(|i| truth.contrast[i] >= CONTRAST_TO_NOISE).collect(),
            ..region
        };
        let (clear_mm2, all_mm2) = (footprint.broken_mm2(&clear), footprint.broken_mm2(&region));
        let min_mm2 = inspection.observation.min_break_mm2;
        let mut row: BTreeMap<(&str, Found), usize> = BTreeMap::new();
        let mut wrong = Vec::new();
        for (index, grid) in inspection.grids.iter().enumerate() {
            let found = if unjudged { Found::NotSeen } else { found(grid) };
            let is_clear = clear_mm2[index] >= MIN_CONTRAST_FRACTION * all_mm2[index];
            let (kind, counts) = match (real_mm2[index] >= min_mm2, later_mm2[index] >= min_mm2) {
                (true, _) => ("broken", &mut self.broken),
                // A break that begins after the observation is excluded, whether it was found or not.
                (false, true) => continue,
                _ if is_clear => ("clean", &mut self.clean),
                _ => ("faint", &mut self.faint),
            };
            if !unjudged {
                *counts.entry(found).or_default() += 1;
                let of_sanded = match kind {
                    "broken" => Some(&mut self.sanded_broken),
                    "clean" => Some(&mut self.sanded_clean),
                    _ => None,
                };
                if let Some(of_sanded) = of_sanded.filter(|_| sanded(grid.id)) {
                    *of_sanded.entry(found).or_default() += 1;
                }
            }
            *row.entry((kind, found)).or_default() += 1;
            let is_wrong = matches!((kind, found), ("broken", Found::Passed) | ("clean" | "faint", Found::Failed));
            if is_wrong && !unjudged {
                wrong.push(format!(
                    "{}: {found:?}, {:.1} mm² found, {:.1} mm² broken ({:.1} at the end); a grid fails from {min_mm2:.1} mm²{}",
                    grid.id, grid.broken_mm2, real_mm2[index], later_mm2[index],
                    if sanded(grid.id) { ", sanded" } else { "" },
                ));
            }
        }
        // Pixels that were not seen are counted above; they are neither found nor missed.
        let not_seen = inspection.unseen_pixels();
        let within = Mask {
            inside: (0..region.inside.len())
                .map(|i| region.inside[i] && clear.inside[i] && !not_seen.inside[i])
                .collect(),
            ..region
        };
        let has_break = truth.broken.inside.iter().zip(&within.inside).any(|(open, within)| *open && *within);
        let observed_s = inspection.observation.observed_s;
        let iou = (has_break && !unjudged)
            .then(|| score_within(&inspection.mask_at(observed_s), truth.broken, &within).expect("one size").iou);
        self.iou.extend(iou);
        self.clips += 1;
        let codes: Vec<&str> = inspection.judgement.reasons.iter().map(|reason| &*reason.code).collect();
        if unjudged {
            codes.first().into_iter().for_each(|code| *self.invalid.entry((*code).to_owned()).or_default() += 1);
        }
        let count = |kind, found| row.get(&(kind, found)).copied().unwrap_or_default();
        let counts = |kind| [Found::Failed, Found::Passed, Found::NotSeen].map(|found| count(kind, found));
        let ([bf, bp, bn], [cf, cp, cn], [ff, fp, fnot]) = (counts("broken"), counts("clean"), counts("faint"));
        println!(
            "{} {:5} {:6} {:4.0} {:3} {:8} {} | broken {bf:3}{bp:3}{bn:3} | clean {cf:3}{cp:3}{cn:3} | faint {ff:3}{fp:3}{fnot:3} | {}{}",
            clip.renderer,
            clip.seed,
            clip.kind,
            clip.frames_per_second,
            clip.sanded,
            inspection.judgement.verdict.keyword(),
            iou.map_or_else(|| "  –  ".to_owned(), |iou| format!("{iou:.3}")),
            codes.join(" "),
            if wrong.is_empty() { "" } else { "  <-" },
        );
        wrong.iter().for_each(|line| println!("      {line}"));
        if std::env::var("REASONS").is_ok() {
            let reasons = &inspection.judgement.reasons;
            reasons.iter().for_each(|reason| println!("      {}: {}", reason.code, reason.message));
        }
    }

    /// Adds, for each break, the error of the time at which its area reached 10 mm². `true_s` returns the true time
    /// after the first fully wet picture.
    pub fn times(&mut self, inspection: &Inspection, truth: &Mask, true_s: impl Fn(usize) -> f64) {
        let (footprint, region) = (&inspection.footprint, inspection.footprint.region());
        let inside = truth.inside.iter().zip(&region.inside).map(|(truly, inside)| *truly && *inside).collect();
        for piece in (Mask { inside, ..*truth }).connected_components() {
            let mut mask = Mask::all_outside(truth.width, truth.height);
            piece.iter().for_each(|&index| mask.inside[index] = true);
            let area_mm2: f64 = footprint.broken_mm2(&mask).iter().sum();
            let mut real: Vec<f64> = piece.iter().map(|&i| true_s(i).max(0.0)).collect();
            let mut found: Vec<f64> =
                piece.iter().filter_map(|&i| inspection.break_time_s(i % truth.width, i / truth.width)).collect();
            let tenth = (10.0 / area_mm2 * piece.len() as f64).ceil() as usize;
            real.sort_by(f64::total_cmp);
            found.sort_by(f64::total_cmp);
            if let (Some(real_s), Some(found_s)) = (real.get(tenth), found.get(tenth)) {
                self.time_errors_s.push(found_s - real_s);
            }
        }
    }

    /// Reports the figures. A figure without any grid of its kind has no evidence and misses its goal.
    pub fn report(&self, figures: &Figures) {
        let share = |figure: Figure, counts: &BTreeMap<Found, usize>, found: Found, goal: &str, most: f64| {
            let (some, all) = (counts.get(&found).copied().unwrap_or_default(), counts.values().sum::<usize>());
            figure.report(goal, &format!("{some} of {all}"), all > 0 && some as f64 <= most * all as f64);
        };
        share(figures.passed, &self.broken, Found::Passed, "0", 0.0);
        share(figures.failed, &self.clean, Found::Failed, "0.5 %", MAX_CLEAN_FAILED_FRACTION);
        if let Some(figure) = figures.not_seen {
            share(figure, &self.clean, Found::NotSeen, "3 %", MAX_CLEAN_NOT_SEEN_FRACTION);
        }
        let above = |values: &[f64]| values.iter().filter(|value| **value >= MIN_IOU).count();
        if let Some(figure) = figures.iou {
            let (count, high) = (self.iou.len(), above(&self.iou));
            let mean = self.iou.iter().sum::<f64>() / count.max(1) as f64;
            let found = format!("mean {mean:.3}, {high} of {count} above {MIN_IOU}");
            figure.report(&MIN_IOU.to_string(), &found, count > 0 && high == count);
        }
        if let Some(figure) = figures.time {
            let near = self.time_errors_s.iter().filter(|error| error.abs() <= 0.5).count();
            let (count, goal) = (self.time_errors_s.len(), format!("{} %", 100.0 * MIN_TIMELY_FRACTION));
            figure.report(
                &goal,
                &format!("{near} of {count}"),
                count > 0 && near as f64 >= MIN_TIMELY_FRACTION * count as f64,
            );
        }
    }

    pub fn print(&mut self, name: &str) {
        let share = |counts: &BTreeMap<Found, usize>, found: Found| {
            let (some, all) = (counts.get(&found).copied().unwrap_or_default(), counts.values().sum::<usize>());
            format!("{some} of {all} ({:.2} %)", 100.0 * some as f64 / all.max(1) as f64)
        };
        let invalid: usize = self.invalid.values().sum();
        println!("\n{name}: {} clips, {invalid} of them not judged {:?}", self.clips, self.invalid);
        println!("  failed grids passed        {} (needed 0)", share(&self.broken, Found::Passed));
        println!("  failed grids not seen      {}", share(&self.broken, Found::NotSeen));
        println!("  clean grids failed         {} (needed 0.5 %)", share(&self.clean, Found::Failed));
        println!("  clean grids not seen       {} (needed 3 %)", share(&self.clean, Found::NotSeen));
        println!(
            "  of those that were sanded: failed passed {}, not seen {}; clean failed {}, not seen {}",
            share(&self.sanded_broken, Found::Passed),
            share(&self.sanded_broken, Found::NotSeen),
            share(&self.sanded_clean, Found::Failed),
            share(&self.sanded_clean, Found::NotSeen),
        );
        println!(
            "  clean grids with less than {CONTRAST_TO_NOISE} times the noise: failed {}, passed {}, not seen {}",
            share(&self.faint, Found::Failed),
            share(&self.faint, Found::Passed),
            share(&self.faint, Found::NotSeen),
        );
        let mean = self.iou.iter().sum::<f64>() / self.iou.len().max(1) as f64;
        let least = self.iou.iter().copied().fold(f64::INFINITY, f64::min);
        let low = self.iou.iter().filter(|iou| **iou < 0.95).count();
        println!(
            "  intersection over union, ±1 px, from {CONTRAST_TO_NOISE} times the noise on, {} clips: mean {mean:.4}, least {least:.4}, \
             {low} below 0.95 (needed 0.95)",
            self.iou.len()
        );
        if !self.time_errors_s.is_empty() {
            let near = self.time_errors_s.iter().filter(|error| error.abs() <= 0.5).count();
            let percent = 100.0 * near as f64 / self.time_errors_s.len() as f64;
            println!("  time to break, from 10 mm²: {percent:.1} % of {} within 0.5 s", self.time_errors_s.len());
        }
        let mut at = |share: f64| {
            quantile(&mut self.judging, share, QuantileRank::Lower)
                .map_or(f64::NAN, |time| time.as_secs_f64() * 1e3)
        };
        println!("  a picture: median {:.2} ms, 95 % {:.2} ms", at(0.5), at(0.95));
    }
}

fn found(grid: &GridInspection) -> Found {
    match grid.failed {
        true => Found::Failed,
        false if grid.seen && !grid.no_contrast && !grid.wet_when_dry => Found::Passed,
        false => Found::NotSeen,
    }
}
