//! Describes in words the flaws of the pictures that cannot be used for the judgement.

use super::super::observed::Observation;
use super::super::quality::{Flaw, Flawed, MIN_SHARPNESS, Quality};
use super::super::steady::MIN_OUTLINE_SEEN_PERCENT;
use crate::number_text::apart;
use crate::recipe;

/// Returns the flaw that most pictures have; if several have the same number, the first of them.
pub(super) fn worst_flaw(quality: &Quality) -> (Flaw, Flawed) {
    Flaw::ALL.iter().copied().zip(quality.flawed).fold((Flaw::Darker, Flawed::default()), |most, found| {
        if found.1.pictures > most.1.pictures { found } else { most }
    })
}

/// Describes a flaw: the worst measured value and the limit.
pub(super) fn shown(flaw: Flaw, worst: f64, observation: &Observation, settings: &recipe::Inspect) -> String {
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
    let [worst, limit] = apart(worst, limit, decimals);
    match flaw {
        Flaw::Darker => {
            format!(
                "the light is up to {worst} % less than the dry picture's (limit {limit} %); keep the lamp steady"
            )
        }
        Flaw::Brighter => format!(
            "the light is up to {worst} % more than the dry picture's (limit {limit} %, beyond which it could be a \
             film that broke all over); keep the lamp steady and other light away"
        ),
        Flaw::Flicker => format!(
            "the light goes up and down by {worst} % from picture to picture while the surroundings of the panel \
             became much darker or brighter; it is not known whether lamp or water caused this; set the exposure \
             to a multiple of 10 ms if the mains have 50 Hz and of 8.33 ms at 60 Hz, or use a lamp that does not \
             flicker"
        ),
        Flaw::Bright => format!("up to {worst} % of the region is overexposed (limit {limit} %)"),
        Flaw::Moved => {
            format!("the panel lies up to {worst} px from its place in the first picture (limit {limit} px)")
        }
        Flaw::Focus => format!("the panel's edge has as little as {worst} of its first sharpness (needed {limit})"),
        Flaw::Outline => format!(
            "as little as {worst} % of the panel's outline can be seen (at least {limit} % are needed), so it is \
             not known whether it moved; give it contrast to its surroundings, in any colour"
        ),
        Flaw::OutlineDisagrees => {
            "the visible parts of the panel's outline do not agree on its place, so it is not known whether it \
             moved; give it contrast to its surroundings, in any colour"
                .to_owned()
        }
        Flaw::Frozen => "they are bit for bit the picture before; the camera is frozen".to_owned(),
    }
}
