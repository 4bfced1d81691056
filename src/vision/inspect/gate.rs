//! The acceptance checks of the test: convert the observation of the film to the verdict pass, fail or invalid.
//!
//! The test is invalid if it cannot be judged: it has no dry picture, is too short, has too few pictures, or has a gap
//! between two of them. It is also invalid if its pictures are unusable, the panel is not at its pose, or the
//! resolution is too coarse for the smallest break to detect. Further reasons are that too little of the region ever
//! became wet, that places were already wet in the dry picture, and that a grid is out of view. Invalid outranks fail,
//! since a verdict from an incomplete test would name only some of the grids. The test fails if the film broke on a
//! grid. Grids that the recipe masks are not part of the test: they do not pass, but a break elsewhere is still
//! reported. Every break is listed in the reasons.
//!
//! Two checks are made before the film runs: whether the panel is at its pose, and whether the resolution is
//! sufficient.

#[cfg(test)]
mod tests;

use super::observed::{ComparisonReference, Demands, GridInspection, Observation};
use super::quality::{Flaw, FlawedPictures, MIN_FIRST_SHARPNESS, MIN_SHARPNESS, Quality};
use super::steady::MIN_OUTLINE_SEEN_PERCENT;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Check, Judgement, Limit, LimitSource, Reason, Severity, Verdict};
use panelprep_cell::recipe;

/// Minimum change of brightness by the film, as a multiple of the noise of the clip. The limit between wet and dry is
/// half of the change, three times the noise from both.
pub const MIN_CHANGE_TO_NOISE: f64 = 6.0;

/// Names of the checks of the test. The checks with a name defined here do not belong to a single measured value of a
/// film.
pub mod name {
    pub use panelprep_cell::record::name::{
        FILM_CHANGE, LIGHT_MIN, MAX_LIGHT_NAME, SMALLEST_BREAK, WATCHED_TIME_NAME, break_time_name, broken_film,
    };

    /// Whether there is a picture of the dry panel.
    pub const DRY_PICTURE: &str = "a picture of the dry panel";
    /// Sharpness of the first picture, without comparison with the dry picture.
    pub const FIRST_SHARPNESS: &str = "sharpness of the first picture";
    /// Grids with places that were wet in the dry picture.
    pub const WET_GRIDS: &str = "grids that were wet in the dry picture";
    /// Grids with places at which a break would not be visible, because film and dry panel are equally bright.
    pub const LOW_CONTRAST_GRIDS: &str = "grids with places that look wet as they do dry";
    /// Grids of which a part was not seen.
    pub const UNSEEN_GRIDS: &str = "grids that were not wholly seen";
    /// Grids that the recipe masks.
    pub const MASKED_GRIDS: &str = "grids that the recipe masks";
}

/// The result of a test: all checks and the judgement.
pub struct JudgedFilm {
    /// The checks, in the order in which they are judged.
    pub checks: Vec<Check>,
    /// The verdict, with its reasons.
    pub judgement: Judgement,
}

/// Judges a test. A check that makes the test invalid has the verdict reject. A grid that failed, or was not inspected,
/// has the verdict review: an otherwise valid test then has the verdict fail, or is incomplete.
pub fn judge(
    observation: &Observation,
    grids: &[GridInspection],
    demands: &Demands,
    settings: &recipe::Inspect,
) -> JudgedFilm {
    let film = WatchedFilm { observation, grids, demands, settings };
    let checks = [
        film.check_watched(),
        film.check_panel_position(),
        film.check_pictures(),
        film.check_wetting(),
        film.check_grids(),
    ]
    .concat();
    let judgement = Judgement::from_checks(&checks);
    let verdict = match judgement.verdict {
        Verdict::Accept => Verdict::Pass,
        Verdict::Review if grids.iter().any(|grid| grid.failed) => Verdict::Fail,
        // A grid that was not inspected may be broken, so it does not pass.
        _ => Verdict::Invalid,
    };
    JudgedFilm { checks, judgement: Judgement { verdict, ..judgement } }
}

/// An observed film, with the requirements of its test.
struct WatchedFilm<'a> {
    observation: &'a Observation,
    grids: &'a [GridInspection],
    demands: &'a Demands,
    settings: &'a recipe::Inspect,
}

impl WatchedFilm<'_> {
    /// Checks whether the film was observed for long enough, with a dry picture and without a gap.
    fn check_watched(&self) -> Vec<Check> {
        let Observation { observed_s, frames, longest_gap_s, has_dry, .. } = *self.observation;
        let demands = self.demands;
        let allowed_gap_s = demands.max_gap_s();
        vec![
            Check::new(name::DRY_PICTURE, "", f64::from(u8::from(has_dry)))
                .with_min(1.0, LimitSource::Program)
                .or_reject("no_dry_picture", || {
                    "there is no picture of the dry panel; without it, a place that never became wet looks like a \
                     place with intact film: take a dry picture before the spray and repeat the test"
                        .to_owned()
                }),
            Check::new(name::WATCHED_TIME_NAME, "s", observed_s)
                .with_min(demands.min_observed_s(), demands.observation_time_set_by())
                .or_reject("too_short", || {
                    let [observed, window] = distinguishable_texts(observed_s, demands.observation_s, 1);
                    format!(
                        "the film was watched for {observed} s, at least {window} s are needed (the recipe's \
                         observation_s): repeat the test"
                    )
                }),
            Check::new("wet pictures", "", frames as f64),
            Check::new("longest time between two of them", "s", longest_gap_s)
                .with_max(allowed_gap_s, LimitSource::recipe("process.frames_per_second"))
                .or_reject("gap", || {
                    let [gap, allowed] = distinguishable_texts(longest_gap_s, allowed_gap_s, 2);
                    format!("two wet pictures are {gap} s apart (limit {allowed} s): repeat the test")
                }),
        ]
    }

    /// Checks whether the panel is at the pose at which the grids are evaluated, and whether the resolution is
    /// sufficient.
    fn check_panel_position(&self) -> Vec<Check> {
        let Observation { has_dry, is_place_assumed, detection_limit_mm2, .. } = *self.observation;
        let off_px = self.observation.quality.off_px;
        let (off, coarse) = (
            displaced_panel_reason(off_px, (is_place_assumed, has_dry)),
            coarse_resolution_reason(detection_limit_mm2, self.demands.min_break_mm2),
        );
        vec![
            Check::new("outline from where the panel was found, in the dry picture", "px", off_px)
                .with_max(MAX_OUTLINE_OFFSET_PX, LimitSource::Program)
                .with_reason(off, Severity::Reject),
            Check::new(name::SMALLEST_BREAK, "mm²", detection_limit_mm2)
                .with_max(self.demands.min_break_mm2, self.demands.min_break_set_by())
                .with_reason(coarse, Severity::Reject),
        ]
    }

    /// Checks whether the pictures are usable.
    fn check_pictures(&self) -> Vec<Check> {
        let (observation, quality) = (self.observation, &self.observation.quality);
        let (change, min_change) = (observation.change_levels, MIN_CHANGE_TO_NOISE * observation.noise_levels);
        let sharpness = quality.first_sharpness;
        let (usable_s, allowed_s) = (self.demands.min_usable_s(observation.observed_s), self.demands.max_gap_s());
        let is_enough = quality.usable_s >= usable_s && quality.usable > 1;
        let is_unseen = quality.longest_unseen_s > allowed_s && quality.usable != observation.frames;
        let (flaw, flawed) = most_frequent_flaw(quality);
        let words = || self.flaw_message((flaw, flawed), allowed_s);
        let [darker, brighter] = observation.light_limits_percent(self.settings);
        let percent = |share: f64| Some(100.0 * (share - 1.0)).filter(|percent| percent.is_finite());
        let light = || LimitSource::recipe("inspect.max_light_change_percent");
        let pictures = || LimitSource::recipe("process.frames_per_second");
        vec![
            Check::new(name::FILM_CHANGE, "grey levels", change)
                .with_min(min_change, LimitSource::Program)
                .or_reject("dark", || {
                    let [change, needed] = distinguishable_texts(change.unwrap_or(f64::NAN), min_change, 1);
                    format!(
                        "the film changes the panel by {change} grey levels, at least {needed} (six times the \
                         clip's noise) are needed: use more light or a longer exposure, then repeat the test"
                    )
                }),
            Check::new("noise of a pixel of the film", "grey levels", observation.noise_levels),
            Check::new(name::FIRST_SHARPNESS, "", sharpness)
                .with_min(MIN_FIRST_SHARPNESS, LimitSource::Program)
                .or_reject("focus", || {
                    let [sharpness, needed] =
                        distinguishable_texts(sharpness.unwrap_or(f64::NAN), MIN_FIRST_SHARPNESS, 2);
                    format!(
                        "the panel's edge in the first picture is not sharp: {sharpness} of its contrast lies \
                         between two neighbouring pixels, at least {needed} is needed; focus the camera and repeat \
                         the test"
                    )
                }),
            Check::new("pictures that could be judged by", "", quality.usable as f64),
            Check::new("time that they cover", "s", quality.usable_s)
                .with_min(usable_s, LimitSource::Program)
                .with_consequence_if(!is_enough, Severity::Reject, flaw.keyword(), words),
            Check::new("longest time without one", "s", quality.longest_unseen_s)
                .with_max(allowed_s, pictures())
                .with_consequence_if(is_unseen, Severity::Reject, flaw.keyword(), words),
            Check::new(name::LIGHT_MIN, "%", percent(quality.light[0])).with_min(-darker, light()),
            Check::new(name::MAX_LIGHT_NAME, "%", percent(quality.light[1])).with_max(brighter, light()),
            Check::new("panel moved in the picture", "px", quality.moved_px),
            Check::new("least sharpness against the dry picture", "", quality.sharpness),
            Check::new("the film leaves of the dry brightness", "", observation.film_left),
        ]
    }

    fn flaw_message(&self, (flaw, flawed): (Flaw, FlawedPictures), allowed_s: f64) -> String {
        let Observation { frames, quality, .. } = self.observation;
        let what = describe_flaw(flaw, flawed.worst, self.observation, self.settings);
        let [unseen, allowed] = distinguishable_texts(quality.longest_unseen_s, allowed_s, 1);
        format!(
            "{} of {frames} wet pictures cannot be used, and the longest time without a usable picture is {unseen} \
             s (limit {allowed} s); in {} of them {what}: repeat the test",
            frames - quality.usable,
            flawed.pictures
        )
    }

    /// Checks whether the panel was dry before the spray, and completely wet after it.
    fn check_wetting(&self) -> Vec<Check> {
        let (observation, allowed_percent) = (self.observation, self.settings.max_never_wet_percent());
        let is_dry_somewhere = observation.has_dry && observation.never_wet_percent > allowed_percent;
        let wet = names(self.grids, |grid| grid.wet_when_dry);
        vec![
            Check::new("region that was wet in no picture", "%", observation.never_wet_percent)
                .with_max(allowed_percent, LimitSource::recipe("inspect.max_never_wet_percent"))
                .with_consequence_if(is_dry_somewhere, Severity::Reject, "never_wet", || {
                    let [found, allowed] = distinguishable_texts(observation.never_wet_percent, allowed_percent, 1);
                    format!(
                        "{found} % of the region was wet in no picture (limit {allowed} %): check that the water \
                         is on and that the spray reaches all of the panel, then repeat the test"
                    )
                }),
            Check::new(name::WET_GRIDS, "", wet.len() as f64).with_max(0.0, LimitSource::Program).or_reject(
                "wet_when_dry",
                || {
                    format!(
                        "in the dry picture, places on {} were already wet, so the test cannot judge them: dry the \
                         panel and repeat the test",
                        wet.join(", ")
                    )
                },
            ),
        ]
    }

    /// Checks how much of each grid was seen, and on which grids the film broke.
    fn check_grids(&self) -> Vec<Check> {
        let (grids, min_break_mm2) = (self.grids, self.demands.min_break_mm2);
        // A failed grid stays failed even if another part of it was not seen: it is sanded and tested again.
        let faint = names(grids, |grid| !grid.failed && grid.no_contrast);
        let unseen = names(grids, |grid| {
            !grid.failed && !grid.seen && !grid.only_masked && !grid.wet_when_dry && !grid.no_contrast
        });
        let masked = names(grids, |grid| !grid.seen && grid.only_masked);
        let broken = grids.iter().flat_map(|grid| {
            let (id, when_s) = (grid.id, grid.time_to_break_s);
            let limit = (Limit::Below(min_break_mm2), self.demands.min_break_set_by());
            let area = Check::new(name::broken_film(id), "mm²", grid.seen.then_some(grid.broken_mm2));
            let area = area.with_limit(limit.0, limit.1).with_consequence_if(
                grid.failed,
                Severity::Review,
                "broken",
                || describe_broken(min_break_mm2, grids),
            );
            let failed = when_s.map(|time_s| Check::new(name::break_time_name(id), "s", time_s));
            std::iter::once(area).chain(failed)
        });
        let faint = Check::new(name::LOW_CONTRAST_GRIDS, "", faint.len() as f64)
            .with_max(0.0, LimitSource::Program)
            .or_reject("no_contrast", || {
                format!(
                    "on {} there are places where a break would not be visible, because the film looks like the \
                     dry panel in every channel, or water never wetted them: move the lamp or the diffuser so that \
                     these places reflect something darker or brighter (`panelprep tune` names the grids), and \
                     repeat the test",
                    faint.join(", ")
                )
            });
        let unseen = Check::new(name::UNSEEN_GRIDS, "", unseen.len() as f64)
            .with_max(0.0, LimitSource::Program)
            .or_reject("not_seen", || {
                let is_sanded = |grid: &&GridInspection| {
                    grid.reference != ComparisonReference::DryAndWet && unseen.contains(&grid.id.to_string())
                };
                let still = match grids.iter().any(|grid| is_sanded(&grid)) {
                    true => {
                        "; on a place that was sanded since the dry picture, no moving water was seen, or the \
                         state of its film stayed uncertain: use more water or light, or more pictures per second"
                    }
                    false => "",
                };
                format!(
                    "grids not completely seen: {}; move the panel into view, lower the exposure if it is too \
                     bright, or move the lamp if a reflection does not move{still}",
                    unseen.join(", ")
                )
            });
        let masked = Check::new(name::MASKED_GRIDS, "", masked.len() as f64)
            .with_max(0.0, LimitSource::recipe("inspect.masked_px"))
            .or_review("masked", || {
                format!(
                    "the recipe masks a part of {}, so these grids did not pass; inspect the masked parts by \
                     eye during the film",
                    masked.join(", ")
                )
            });
        [faint, unseen].into_iter().chain(broken).chain([masked]).collect()
    }
}

fn names(grids: &[GridInspection], which: impl Fn(&GridInspection) -> bool) -> Vec<String> {
    grids.iter().filter(|grid| which(grid)).map(|grid| grid.id.to_string()).collect()
}

fn describe_broken(min_break_mm2: f64, grids: &[GridInspection]) -> String {
    let failed: Vec<String> = grids
        .iter()
        .filter(|grid| grid.failed)
        .map(|grid| {
            let when = grid.time_to_break_s.map(|time| format!(" from {time:.1} s")).unwrap_or_default();
            format!("{} ({:.1} mm²{when})", grid.id, grid.broken_mm2)
        })
        .collect();
    format!("the film broke on {}; a grid fails from {min_break_mm2:.1} mm²", failed.join(", "))
}

/// Maximum distance between the panel's outline in the dry picture and the outline calculated from the pose, px. If the
/// panel is in place, errors of pose and calibration cause a distance of a few tenths of a pixel.
pub const MAX_OUTLINE_OFFSET_PX: f64 = 1.5;

/// Returns a reason if breaks that must fail a grid may be missed, because the smallest reliably detected break is
/// larger than the smallest break that fails a grid.
pub fn coarse_resolution_reason(detection_limit_mm2: f64, min_break_mm2: f64) -> Option<Reason> {
    // A NaN does not meet the limit.
    let is_fine = detection_limit_mm2 <= min_break_mm2;
    (!is_fine).then(|| {
        let message = format!(
            "the smallest break that is reliably detected is {detection_limit_mm2:.1} mm², but a grid fails from \
             {min_break_mm2:.1} mm² of broken film, so smaller breaks may be missed: bring the camera nearer, use \
             all of its pixels, or, if the process allows it, state a larger min_break_mm2 in the recipe's \
             [inspect]"
        );
        Reason::new("detection_limit", message)
    })
}

/// Returns a reason if the panel is not at the pose at which the grids are evaluated.
pub fn displaced_panel_reason(off_px: Option<f64>, (assumed, has_dry): (bool, bool)) -> Option<Reason> {
    let message = match off_px {
        Some(off_px) if off_px <= MAX_OUTLINE_OFFSET_PX => return None,
        None if !assumed || !has_dry => return None,
        None => "the panel is assumed to be in its nominal pose, but the dry picture cannot confirm it, because \
                 the panel's outline has too little contrast"
            .to_owned(),
        Some(off_px) => {
            let taken = if assumed { "its assumed nominal position" } else { "its located position" };
            let [off, allowed] = distinguishable_texts(off_px, MAX_OUTLINE_OFFSET_PX, 1);
            format!(
                "in the dry picture the panel's outline lies {off} px or more from {taken} (limit {allowed} px), \
                 so the wrong areas would be judged"
            )
        }
    };
    let remedy =
        if assumed { "state --located with the output of `panelprep locate`" } else { "locate the panel again" };
    Some(Reason::new("elsewhere", format!("{message}: {remedy}")))
}

/// Returns the most frequent flaw of the unusable pictures; if several flaws are equally frequent, the first of them.
fn most_frequent_flaw(quality: &Quality) -> (Flaw, FlawedPictures) {
    Flaw::ALL.iter().copied().zip(quality.flawed).fold((Flaw::Darker, FlawedPictures::default()), |most, found| {
        if found.1.pictures > most.1.pictures { found } else { most }
    })
}

/// Describes a flaw with its worst measured value and its limit.
fn describe_flaw(flaw: Flaw, worst: f64, observation: &Observation, settings: &recipe::Inspect) -> String {
    let [darker_percent, brighter_percent] = observation.light_limits_percent(settings);
    let (limit, decimals) = match flaw {
        Flaw::Darker => (darker_percent, 1),
        Flaw::Brighter => (brighter_percent, 1),
        Flaw::Bright => (settings.max_bright_percent(), 1),
        Flaw::Moved => (settings.max_moved_px(), 1),
        Flaw::Focus => (MIN_SHARPNESS, 2),
        Flaw::Flicker => (0.0, 1),
        Flaw::Frozen | Flaw::OutlineDisagrees => (0.0, 0),
        Flaw::Outline => (MIN_OUTLINE_SEEN_PERCENT, 0),
    };
    let [worst, limit] = distinguishable_texts(worst, limit, decimals);
    match flaw {
        Flaw::Darker => {
            format!(
                "the light is up to {worst} % weaker than in the dry picture (limit {limit} %); keep the lamp \
                 steady"
            )
        }
        Flaw::Brighter => format!(
            "the light is up to {worst} % stronger than in the dry picture (limit {limit} %; beyond it, a film \
             that broke everywhere cannot be excluded); keep the lamp steady and shield other light"
        ),
        Flaw::Flicker => format!(
            "the light varies by {worst} % from picture to picture while the surroundings of the panel became much \
             darker or brighter; it is unknown whether lamp or water caused this; set the exposure to a multiple \
             of 10 ms for 50 Hz mains or of 8.33 ms for 60 Hz, or use a lamp that does not flicker"
        ),
        Flaw::Bright => format!(
            "up to {worst} % of the region is overexposed (limit {limit} %); move the lamp, use a diffuser, or lower \
             the exposure"
        ),
        Flaw::Moved => format!(
            "the panel is up to {worst} px from its position in the first picture (limit {limit} px); clamp the \
             panel, and check that the camera's stand is firm"
        ),
        Flaw::Focus => format!(
            "the sharpness of the panel's edge falls to {worst} of its first value (at least {limit} is needed); \
             keep the lens in focus and free of water"
        ),
        Flaw::Outline => format!(
            "only {worst} % of the panel's outline is visible (at least {limit} % are needed), so a motion of the panel cannot be detected; use surroundings with more contrast to the panel, in any colour"
        ),
        Flaw::OutlineDisagrees => {
            "the visible parts of the panel's outline do not agree on its position, so a motion of the panel cannot be detected; use surroundings with more contrast to the panel, in any colour"
                .to_owned()
        }
        Flaw::Frozen => {
            "the picture is bit-identical to the picture before; the camera's image stream is frozen".to_owned()
        }
    }
}
