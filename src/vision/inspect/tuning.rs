//! Acceptance checks of a clip that is recorded to set up lamp, camera and recipe. They show whether the light and the
//! settings of the method are suitable for the test. The findings are texts for a person.

use super::advice::{Advice, GridContrast};
use super::gate::{MIN_CHANGE_TO_NOISE, coarse_resolution_reason, name};
use super::observed::Demands;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Reason, Severity};
use panelprep_cell::panel::GridId;

/// Minimum contrast-to-noise ratio: below it, wet and dry cannot be distinguished.
pub const MIN_CONTRAST_TO_NOISE: f64 = 5.0;
/// Maximum percentage of a grid that may have the same appearance under a film and dry, as greasy places do.
const MAX_LOW_CONTRAST_PERCENT: f64 = 10.0;
/// Minimum brightness of the dry panel, grey levels; a darker panel needs more light.
const MIN_DRY_BRIGHTNESS_LEVELS: f64 = 40.0;
/// Minimum uniformity of the light: with less uniform light, a part of the panel becomes too dark or overexposed before
/// the rest.
const MIN_UNIFORMITY: f64 = 0.6;
/// Maximum fraction of the dry region that may be overexposed.
const MAX_OVEREXPOSED_FRACTION: f64 = 0.001;

/// The results of a clip for the film method.
#[derive(Debug, Clone)]
pub struct Tuning {
    /// The recommended settings for light and channels.
    pub advice: Advice,
    /// Contrast of each grid in the brightness that the method evaluates.
    pub grids: Vec<GridContrast>,
    /// Longest time for which a place appears dry before it appears wet again, s.
    pub flash_s: f64,
    /// Area of the smallest break that is reliably detected, mm².
    pub detection_limit_mm2: f64,
    /// The grids that would be treated as not seen if they were completely sanded after the dry picture, because the
    /// water of this film moves too little there.
    pub unseen_if_sanded: Vec<GridId>,
    /// The reason why the panel is not at the pose at which the grids are evaluated.
    pub displaced_reason: Option<Reason>,
}

impl Tuning {
    /// Returns the time for which a break must be seen so that no flash is treated as a break, s.
    pub fn needed_persist_s(&self, demands: &Demands) -> f64 {
        let interval_s = 1.0 / demands.frames_per_second;
        round_up_to_tenth((self.flash_s + interval_s).max(2.0 * interval_s))
    }

    /// Returns the checks of all judged values.
    pub fn checks(&self, demands: &Demands) -> Vec<Check> {
        let worst =
            self.grids.iter().min_by(|a, b| a.best_contrast_to_noise().total_cmp(&b.best_contrast_to_noise()));
        let of_grid = worst.map(|grid| contrast(&format!("grid {}", grid.id), grid.best_contrast_to_noise()));
        let coarse = coarse_resolution_reason(self.detection_limit_mm2, demands.min_break_mm2);
        let detection = Check::new(name::SMALLEST_BREAK, "mm²", self.detection_limit_mm2)
            .with_max(demands.min_break_mm2, demands.min_break_set_by())
            .with_reason(coarse, Severity::Review);
        let needed_s = self.needed_persist_s(demands);
        let persist = Check::new("persist_s of the recipe", "s", demands.persist_s)
            .with_min(needed_s, LimitSource::Program)
            .or_review("persist", || {
                let [persist, longer] = distinguishable_texts(demands.persist_s, needed_s, 1);
                format!(
                    "places appear dry for up to {} s and then wet again, but persist_s is {persist} s (at least \
                     {longer} s are needed): raise persist_s or remove reflections",
                    fixed_decimals(self.flash_s, 1)
                )
            });
        let place = check_panel_position(self.displaced_reason.clone());
        [place]
            .into_iter()
            .chain(of_grid)
            .chain(check_low_contrast_grids(&self.grids))
            .chain(check_light(&self.advice))
            .chain([detection, persist])
            .collect()
    }
}

/// Returns the checks for the thesis's method, which has no grids and no flashes.
pub fn thesis_checks(advice: &Advice, elsewhere: Option<Reason>) -> Vec<Check> {
    let best = advice.channels.iter().map(|channel| channel.contrast_to_noise()).fold(0.0, f64::max);
    [check_panel_position(elsewhere), contrast("the best channel", best)]
        .into_iter()
        .chain(check_light(advice))
        .collect()
}

fn check_panel_position(elsewhere: Option<Reason>) -> Check {
    Check::new("the panel stands where the grids are looked for", "", None).with_reason(elsewhere, Severity::Review)
}

/// Checks the light, independently of the method.
fn check_light(advice: &Advice) -> [Check; 2] {
    let darkest = advice.evenness[0];
    [
        Check::new("the darkest twentieth of the region, of its mean light", "", darkest)
            .with_min(MIN_UNIFORMITY, LimitSource::Program)
            .with_consequence_if(darkest < MIN_UNIFORMITY, Severity::Review, "uneven", || {
                let [darkest, needed] = distinguishable_texts(darkest, MIN_UNIFORMITY, 2);
                format!(
                    "the darkest 5 % of the region has only {darkest} of the region's mean brightness, at least \
                     {needed} is needed: use a diffuser, or move the lamp farther away"
                )
            }),
        Check::new("dry region that is overexposed", "", advice.overexposed)
            .with_max(MAX_OVEREXPOSED_FRACTION, LimitSource::Program)
            .or_review("overexposed", || {
                format!("{:.1} % of the dry region is overexposed: lower the exposure", 100.0 * advice.overexposed)
            }),
    ]
}

fn contrast(what: &str, contrast_to_noise: f64) -> Check {
    Check::new(format!("change of {what} by the film, times the noise"), "", contrast_to_noise)
        .with_min(MIN_CONTRAST_TO_NOISE, LimitSource::Program)
        .or_review("contrast", || {
            let [found, needed] = distinguishable_texts(contrast_to_noise, MIN_CONTRAST_TO_NOISE, 1);
            format!(
                "the film changes {what} by {found} times the noise, at least {needed} times are needed: use more \
                 light, or a longer exposure"
            )
        })
}

/// Returns a check for the grids with places at which a break would not be visible, with a remedy.
fn check_low_contrast_grids(grids: &[GridContrast]) -> Option<Check> {
    let most = grids.iter().map(|grid| grid.faint_percent).max_by(f64::total_cmp)?;
    let check = Check::new("part of a grid that looks wet as it does dry, at most", "%", most);
    Some(check.with_max(MAX_LOW_CONTRAST_PERCENT, LimitSource::Program).or_review("no_contrast", || {
        let faint: Vec<&GridContrast> =
            grids.iter().filter(|grid| grid.faint_percent > MAX_LOW_CONTRAST_PERCENT).collect();
        let mean_dry = faint.iter().map(|grid| grid.dry).sum::<f64>() / faint.len().max(1) as f64;
        let named: Vec<String> =
            faint.iter().map(|grid| format!("{} ({:.0} %)", grid.id, grid.faint_percent)).collect();
        let remedy = if mean_dry < MIN_DRY_BRIGHTNESS_LEVELS {
            "use more light or a longer exposure"
        } else {
            "the film there reflects an object that makes it as bright as the dry panel: move the lamp or the \
             diffuser aside, so that the panel reflects something dark there, or use a diffuser so large that the \
             panel reflects nothing else"
        };
        format!(
            "the film changes a part of {} by less than {MIN_CHANGE_TO_NOISE:.0} times the noise in every channel, \
             so a break there would not be visible: {remedy}",
            named.join(", ")
        )
    }))
}

fn round_up_to_tenth(seconds: f64) -> f64 {
    (10.0 * seconds - 1e-6).ceil() / 10.0
}
