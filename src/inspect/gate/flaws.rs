//! What is wrong with the pictures of a film that cannot be judged by, in words.

use super::super::observed::Observation;
use super::super::quality::{Flaw, Flawed, MIN_SHARPNESS, Quality};
use super::super::steady::MIN_OUTLINE_SEEN_PERCENT;
use crate::recipe;
use crate::words::apart;

/// The flaw of the most pictures; of several the first.
pub(super) fn worst_flaw(quality: &Quality) -> (Flaw, Flawed) {
    Flaw::ALL.iter().copied().zip(quality.flawed).fold((Flaw::Darker, Flawed::default()), |most, found| {
        if found.1.pictures > most.1.pictures { found } else { most }
    })
}

/// What is wrong with pictures of this flaw: the worst that was measured, and what is allowed.
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
                "the light is up to {worst} % less than the dry picture's (allowed {limit} %); keep the lamp steady"
            )
        }
        Flaw::Brighter => format!(
            "the light is up to {worst} % more than the dry picture's (allowed {limit} %, beyond which it could be a film that \
             broke all over); keep the lamp steady and other light away"
        ),
        Flaw::Flicker => format!(
            "the light goes up and down by {worst} % from picture to picture while what lies around the panel became much \
             darker or brighter, so that nobody knows which of lamp and water made it so; set the exposure to a multiple of 10 ms where the \
             mains have 50 Hz and of 8.33 ms at 60 Hz, or use a lamp that does not flicker"
        ),
        Flaw::Bright => format!("up to {worst} % of the region is overexposed (limit {limit} %)"),
        Flaw::Moved => {
            format!("the panel lies up to {worst} px from where the first picture has it (allowed {limit} px)")
        }
        Flaw::Focus => format!("the panel's edge has as little as {worst} of its first sharpness (needed {limit})"),
        Flaw::Outline => format!(
            "as little as {worst} % of the panel's outline can be seen (needed {limit} %), so that nobody knows whether it moved; \
             give it contrast to what lies beside it, in any colour"
        ),
        Flaw::OutlineDisagrees => {
            "what can be seen of the panel's outline does not agree on where it lies, so that nobody \
                                   knows whether it moved; give it contrast to what lies beside it, in any colour"
                .to_owned()
        }
        Flaw::Frozen => "they are bit for bit the picture before; the camera stands still".to_owned(),
    }
}
