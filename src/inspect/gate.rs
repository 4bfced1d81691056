//! The gate: what was seen of the film becomes pass, fail or invalid.
//!
//! Invalid where the test does not say enough to judge by: no dry picture, too short, too few pictures, a gap between
//! them, pictures that cannot be judged by, a panel that stands elsewhere, pixels too coarse for the break that must not be
//! missed, too little ever wet, or a grid out of sight. That outranks fail, since a
//! verdict from part of a test would name part of the grids; or where a place was wet already in the dry picture. Fail
//! where film broke on a grid. What the recipe masks is no part of the test: it hides no break elsewhere, and its grids
//! do not pass. A break always stays in the reasons.

use super::model::FILM_ASSUMED;
use super::place::{elsewhere, too_coarse};
use super::quality::{Flaw, Flawed, MIN_FIRST_SHARPNESS, MIN_SHARPNESS, MIN_TOLD, Quality, most_brighter_percent};
use super::steady::LEAST_SEEN_PERCENT;
use crate::cell::Limits;
use crate::panel::GridId;
use crate::recipe::{self, Recipe};
use crate::verdict::{Judgement, Reason, Verdict};
use crate::words::apart;

/// Fewer pictures than this share of what the recipe asks for are too few.
const MIN_FRAME_SHARE: f64 = 0.8;
/// Pictures farther apart than this many of the recipe's intervals leave a gap in which a film can break and close.
const MAX_GAP_INTERVALS: f64 = 5.0;
/// A film must change the panel by this many grey levels at least: six times the noise of a common camera's pixel.
pub const MIN_CHANGE_LEVELS: f64 = 6.0;

/// What is asked of a test: the recipe's values, or the cell's where the recipe has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// How long the film is watched, s.
    pub observation_s: f64,
    /// Pictures a second.
    pub frames_per_second: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
    /// How long a place must be seen dry to count as broken, s.
    pub persist_s: f64,
}

impl Demands {
    /// What a recipe asks for in a cell with these limits.
    pub fn of(recipe: &Recipe, limits: &Limits) -> Self {
        Demands {
            observation_s: recipe.process().observation_s().unwrap_or(limits.observation_s()),
            frames_per_second: recipe.process().frames_per_second(),
            min_break_mm2: recipe.inspect().min_break_mm2().unwrap_or(limits.min_break_mm2()),
            persist_s: recipe.inspect().persist_s(),
        }
    }

    /// How long to film, s: what breaks at the end of the window must be seen dry long enough to count.
    pub fn filmed_s(&self) -> f64 {
        self.observation_s + self.persist_s
    }

    /// Pictures that must show a place dry.
    pub fn persist_frames(&self) -> u8 {
        // Of so many pictures the first is what the second is held against.
        (self.persist_s * self.frames_per_second).round().clamp(2.0, 250.0) as u8
    }

    /// The shortest time from the first to the last wet picture, s: the last one of a window may come one interval
    /// before its end.
    pub fn min_observed_s(&self) -> f64 {
        self.observation_s - 1.001 / self.frames_per_second
    }

    /// The fewest wet pictures.
    pub fn min_frames(&self) -> f64 {
        (MIN_FRAME_SHARE * self.observation_s * self.frames_per_second).ceil()
    }

    /// The fewest of so many wet pictures that must be fit to judge by.
    pub fn min_usable(&self, frames: usize) -> f64 {
        (MIN_FRAME_SHARE * frames as f64).ceil()
    }

    /// The longest time between two wet pictures, s.
    pub fn max_gap_s(&self) -> f64 {
        MAX_GAP_INTERVALS / self.frames_per_second
    }
}

/// What the test says of one grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridInspection {
    /// Its name.
    pub id: GridId,
    /// Did at least `min_break_mm2` of film break on it?
    pub failed: bool,
    /// Was it wholly seen? A grid that was not is not passed.
    pub seen: bool,
    /// Is all of it that was not seen what the recipe masks?
    pub only_masked: bool,
    /// Do film and dry panel look so alike on so much of it that a break there would fail the grid?
    pub no_contrast: bool,
    /// Was so much of it wet already in the dry picture that a break in it would fail the grid?
    pub wet_when_dry: bool,
    /// Broken film, mm².
    pub broken_mm2: f64,
    /// When `min_break_mm2` were broken, s after the first fully wet picture.
    pub time_to_break_s: Option<f64>,
}

/// How the film was watched.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// From the first to the last wet picture, s.
    pub observed_s: f64,
    /// Wet pictures, the reference among them.
    pub frames: usize,
    /// The longest time between two of them, s.
    pub longest_gap_s: f64,
    /// Broken film from which a grid fails, mm².
    pub min_break_mm2: f64,
    /// Was a dry picture taken?
    pub has_dry: bool,
    /// Share of the region's surface that was wet in no picture, percent.
    pub never_wet_percent: f64,
    /// What the film leaves of the panel's dry brightness, 0…1, where the clip told it.
    pub film_left: Option<f64>,
    /// The region's mean brightness when dry, grey levels.
    pub dry_levels: f64,
    /// The smallest break that is surely found, mm².
    pub detection_limit_mm2: f64,
    /// Did nobody say where the panel stands?
    pub is_place_assumed: bool,
    /// Which pictures could be judged by.
    pub quality: Quality,
}

impl Observation {
    /// By how much the film changes the panel, grey levels.
    pub fn change_levels(&self) -> f64 {
        self.dry_levels * (1.0 - self.film_left.unwrap_or(FILM_ASSUMED))
    }

    /// How much less light and how much more than the dry picture's is made up for, percent.
    pub fn light_limits_percent(&self, settings: &recipe::Inspect) -> [f64; 2] {
        let brighter = most_brighter_percent(self.film_left.unwrap_or(FILM_ASSUMED), settings);
        [settings.max_light_change_percent(), brighter]
    }
}

/// Judges a test.
pub fn judge(
    observation: &Observation,
    grids: &[GridInspection],
    demands: &Demands,
    settings: &recipe::Inspect,
) -> Judgement {
    let mut reasons = invalid(observation, grids, demands, settings);
    let invalid = !reasons.is_empty();
    let (broken, masked) = (broken(demands.min_break_mm2, grids), masked(grids));
    let verdict = match (invalid, &broken, &masked) {
        (true, ..) => Verdict::Invalid,
        (false, Some(_), _) => Verdict::Fail,
        // What was not looked at may be broken: nobody passes it.
        (false, None, Some(_)) => Verdict::Invalid,
        (false, None, None) => Verdict::Pass,
    };
    reasons.extend(broken.into_iter().chain(masked));
    Judgement { verdict, reasons }
}

fn invalid(
    observation: &Observation,
    grids: &[GridInspection],
    demands: &Demands,
    settings: &recipe::Inspect,
) -> Vec<Reason> {
    let Observation { observed_s, frames, longest_gap_s, .. } = *observation;
    let window_s = demands.observation_s;
    let mut reasons = Vec::new();
    if !observation.has_dry {
        let message = "there is no picture of the dry panel; without one a place that never became wet cannot be told \
                       from one that holds its film: take one before the spray and repeat the test";
        reasons.push(Reason::new("no_dry_picture", message));
    }
    if observed_s < demands.min_observed_s() {
        let [observed, window] = apart(observed_s, window_s, 1);
        let message = format!(
            "the film was watched for {observed} s; the recipe's observation_s asks for {window} s: repeat the test"
        );
        reasons.push(Reason::new("too_short", message));
    }
    let needed = demands.min_frames();
    if (frames as f64) < needed {
        let message = format!("{frames} wet pictures were taken; needed are {needed}: repeat the test");
        reasons.push(Reason::new("too_few_frames", message));
    }
    let allowed_gap_s = demands.max_gap_s();
    if longest_gap_s > allowed_gap_s {
        let [gap, allowed] = apart(longest_gap_s, allowed_gap_s, 2);
        let message = format!("two wet pictures lie {gap} s apart; allowed are {allowed} s: repeat the test");
        reasons.push(Reason::new("gap", message));
    }
    let place = (observation.is_place_assumed, observation.has_dry);
    reasons.extend(elsewhere(observation.quality.off_px, place));
    reasons.extend(too_coarse(observation.detection_limit_mm2, demands.min_break_mm2));
    reasons.extend(unclear(observation, demands, settings));
    let allowed_percent = settings.max_never_wet_percent();
    if observation.has_dry && observation.never_wet_percent > allowed_percent {
        let [found, allowed] = apart(observation.never_wet_percent, allowed_percent, 1);
        let message = format!(
            "{found} % of the region was wet in no picture; allowed are {allowed} %: was the water on, does the spray reach all \
             of the panel? Repeat the test"
        );
        reasons.push(Reason::new("never_wet", message));
    }
    let wet = names(grids, |grid| grid.wet_when_dry);
    if !wet.is_empty() {
        let message = format!(
            "the dry picture shows places on {} that were wet already, and the test says nothing of them: dry the panel and \
             repeat the test",
            wet.join(", ")
        );
        reasons.push(Reason::new("wet_when_dry", message));
    }
    let faint = names(grids, |grid| grid.no_contrast);
    if !faint.is_empty() {
        let message = format!(
            "on {} there are places where the film looks as the dry panel does in every channel, so that a break would not show, or \
             that water never wetted: move the lamp or the diffuser so that they mirror something darker or brighter \
             (`panelprep tune` shows which), and repeat the test",
            faint.join(", ")
        );
        reasons.push(Reason::new("no_contrast", message));
    }
    let unseen = names(grids, |grid| !grid.seen && !grid.only_masked && !grid.wet_when_dry && !grid.no_contrast);
    if !unseen.is_empty() {
        let message = format!(
            "not wholly seen: {}; move the panel into view, lower the exposure where it is too bright, or move the lamp \
             where a reflection stands still",
            unseen.join(", ")
        );
        reasons.push(Reason::new("not_seen", message));
    }
    reasons
}

/// Why the pictures cannot be judged by.
fn unclear(observation: &Observation, demands: &Demands, settings: &recipe::Inspect) -> Vec<Reason> {
    let Observation { frames, quality, .. } = observation;
    let mut reasons = Vec::new();
    let change = observation.change_levels();
    if observation.has_dry && change < MIN_CHANGE_LEVELS {
        let [change, needed] = apart(change, MIN_CHANGE_LEVELS, 1);
        let message = format!(
            "the film changes the panel by {change} grey levels; needed are {needed}: give more light or a longer exposure, then \
             repeat the test"
        );
        reasons.push(Reason::new("dark", message));
    }
    if let Some(sharpness) = quality.first_sharpness.filter(|sharpness| *sharpness < MIN_FIRST_SHARPNESS) {
        let [sharpness, needed] = apart(sharpness, MIN_FIRST_SHARPNESS, 2);
        let message = format!(
            "the panel's edge has {sharpness} of its contrast from one pixel to the next in the first picture; needed are \
             {needed}: focus the camera and repeat the test"
        );
        reasons.push(Reason::new("focus", message));
    }
    let enough = quality.usable as f64 >= demands.min_usable(*frames);
    let (unseen_s, allowed_s) = (quality.longest_unseen_s, demands.max_gap_s());
    if enough && (unseen_s <= allowed_s || quality.usable == *frames) {
        return reasons;
    }
    let (flaw, flawed) =
        Flaw::ALL.into_iter().zip(quality.flawed).fold((Flaw::Darker, Flawed::default()), |most, found| {
            if found.1.pictures > most.1.pictures { found } else { most }
        });
    let what = shown(flaw, flawed.worst, observation, settings);
    let [unseen, allowed] = apart(unseen_s, allowed_s, 1);
    let message = format!(
        "{} of {frames} wet pictures cannot be judged by, {unseen} s of them without one that can (allowed {allowed} s); in {} \
         of them {what}: repeat the test",
        frames - quality.usable,
        flawed.pictures
    );
    reasons.push(Reason::new(flaw.word(), message));
    reasons
}

/// What is wrong with pictures of this flaw: the worst that was measured, and what is allowed.
fn shown(flaw: Flaw, worst: f64, observation: &Observation, settings: &recipe::Inspect) -> String {
    let [darker_percent, brighter_percent] = observation.light_limits_percent(settings);
    let (limit, decimals) = match flaw {
        Flaw::Darker => (darker_percent, 1),
        Flaw::Brighter => (brighter_percent, 1),
        Flaw::Untold => (100.0 * MIN_TOLD, 0),
        Flaw::Bright => (settings.max_bright_percent(), 1),
        Flaw::Moved => (settings.max_moved_px(), 1),
        Flaw::Focus => (MIN_SHARPNESS, 2),
        Flaw::Frozen => (0.0, 0),
        Flaw::Outline => (LEAST_SEEN_PERCENT, 0),
    };
    let [worst, limit] = apart(worst, limit, decimals);
    match flaw {
        Flaw::Darker => {
            format!(
                "the light is up to {worst} % less than the dry picture's (allowed {limit} %); keep the lamp steady"
            )
        }
        Flaw::Brighter => format!(
            "the light is up to {worst} % more than the dry picture's (allowed {limit} %, beyond which it could be a film that \
             broke all over); keep the lamp steady and other light away"
        ),
        Flaw::Untold => format!(
            "as little as {worst} % of the region is as bright as wet and dry places are in one light (needed {limit} %); keep \
             other light and shadows away"
        ),
        Flaw::Bright => format!("glints or overexposure hide up to {worst} % of the region (allowed {limit} %)"),
        Flaw::Moved => {
            format!("the panel lies up to {worst} px from where the first picture has it (allowed {limit} px)")
        }
        Flaw::Focus => format!("the panel's edge has as little as {worst} of its first sharpness (needed {limit})"),
        Flaw::Outline => format!(
            "as little as {worst} % of the panel's outline can be seen (needed {limit} %), so that nobody knows whether it moved; \
             give it contrast to what lies beside it, in any colour"
        ),
        Flaw::Frozen => "they are bit for bit the picture before; the camera stands still".to_owned(),
    }
}

fn names(grids: &[GridInspection], which: impl Fn(&GridInspection) -> bool) -> Vec<String> {
    grids.iter().filter(|grid| which(grid)).map(|grid| grid.id.to_string()).collect()
}

fn masked(grids: &[GridInspection]) -> Option<Reason> {
    let masked = names(grids, |grid| !grid.seen && grid.only_masked);
    let message = format!(
        "the recipe masks a part of {}, which therefore did not pass; look at it by eye while the film is watched",
        masked.join(", ")
    );
    (!masked.is_empty()).then(|| Reason::new("masked", message))
}

fn broken(min_break_mm2: f64, grids: &[GridInspection]) -> Option<Reason> {
    let failed: Vec<String> = grids
        .iter()
        .filter(|grid| grid.failed)
        .map(|grid| {
            let when = grid.time_to_break_s.map(|time| format!(" from {time:.1} s")).unwrap_or_default();
            format!("{} ({:.1} mm²{when})", grid.id, grid.broken_mm2)
        })
        .collect();
    let message = format!("the film broke on {}; a grid fails from {min_break_mm2:.1} mm²", failed.join(", "));
    (!failed.is_empty()).then(|| Reason::new("broken", message))
}

#[cfg(test)]
mod tests {
    use super::super::tests::inspect_table;
    use super::*;

    const DEMANDS: Demands =
        Demands { observation_s: 10.0, frames_per_second: 1.0, min_break_mm2: 5.0, persist_s: 1.0 };

    fn good() -> Observation {
        let mut observation = Observation {
            observed_s: 10.0,
            frames: 10,
            longest_gap_s: 1.0,
            min_break_mm2: 5.0,
            has_dry: true,
            never_wet_percent: 0.0,
            film_left: Some(0.6),
            dry_levels: 70.0,
            detection_limit_mm2: 3.0,
            is_place_assumed: false,
            quality: Quality::default(),
        };
        observation.quality.usable = 10;
        observation
    }

    fn codes(observation: &Observation) -> Vec<String> {
        let judgement = judge(observation, &[], &DEMANDS, &inspect_table(""));
        judgement.reasons.into_iter().map(|reason| reason.code.to_string()).collect()
    }

    /// By hand: 8 of 10 pictures, 5 intervals, 15 levels of which the film takes 0.4, and a fifth of the edge are enough.
    #[test]
    fn each_demand_is_kept_at_its_limit_and_not_beyond() {
        let usable = |usable: usize, longest_unseen_s: f64| {
            let mut observation = good();
            (observation.quality.usable, observation.quality.longest_unseen_s) = (usable, longest_unseen_s);
            observation
        };
        let first = |sharpness: f64| {
            let mut observation = good();
            observation.quality.first_sharpness = Some(sharpness);
            observation
        };
        let off = |is_place_assumed: bool, off_px: Option<f64>| {
            let mut observation = Observation { is_place_assumed, ..good() };
            observation.quality.off_px = off_px;
            observation
        };
        let pairs = [
            (good(), Observation { has_dry: false, ..good() }, "no_dry_picture"),
            (Observation { observed_s: 9.0, ..good() }, Observation { observed_s: 8.9, ..good() }, "too_short"),
            (Observation { frames: 8, ..good() }, Observation { frames: 7, ..good() }, "too_few_frames"),
            (Observation { longest_gap_s: 5.0, ..good() }, Observation { longest_gap_s: 5.1, ..good() }, "gap"),
            (Observation { dry_levels: 15.1, ..good() }, Observation { dry_levels: 14.9, ..good() }, "dark"),
            (
                Observation { never_wet_percent: 20.0, ..good() },
                Observation { never_wet_percent: 20.1, ..good() },
                "never_wet",
            ),
            (first(0.2), first(0.19), "focus"),
            (
                Observation { detection_limit_mm2: 5.0, ..good() },
                Observation { detection_limit_mm2: 5.1, ..good() },
                "detection_limit",
            ),
            (good(), Observation { detection_limit_mm2: f64::NAN, ..good() }, "detection_limit"),
            (off(false, Some(1.5)), off(false, Some(1.6)), "elsewhere"),
            (off(true, Some(1.5)), off(true, None), "elsewhere"),
            (off(false, None), off(true, Some(8.0)), "elsewhere"),
            (usable(8, 5.0), usable(7, 5.0), "light"),
            (usable(8, 5.0), usable(8, 5.1), "light"),
        ];
        for (kept, missed, code) in pairs {
            assert_eq!((codes(&kept), codes(&missed)), (vec![], vec![code.to_owned()]), "{missed:?}");
        }
    }

    /// Two brighter pictures and one that is out of focus: the light is named, by the worst and its own limit.
    #[test]
    fn the_limit_that_was_broken_is_named() {
        let mut quality = good().quality;
        (quality.usable, quality.longest_unseen_s) = (7, 6.0);
        quality.flawed[Flaw::Brighter as usize] = Flawed { pictures: 2, worst: 36.4 };
        quality.flawed[Flaw::Focus as usize] = Flawed { pictures: 1, worst: 0.4 };
        let judgement = judge(&Observation { quality, ..good() }, &[], &DEMANDS, &inspect_table(""));
        let message = &judgement.reasons[0].message;
        let told = "3 of 10 wet pictures cannot be judged by, 6.0 s of them without one that can (allowed 5 s); in 2 of \
                    them the light is up to 36.4 % more than the dry picture's (allowed 33.3 %";
        assert!(message.starts_with(told), "{message}");
    }
}
