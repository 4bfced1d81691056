//! Describes the flaws of the pictures that cannot be used for the judgement.

use super::super::observed::Observation;
use super::super::quality::{Flaw, Flawed, MIN_SHARPNESS, Quality};
use super::super::steady::MIN_OUTLINE_SEEN_PERCENT;
use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::recipe;

/// Returns the flaw that most pictures have; if several have the same number, the first of them.
pub(super) fn worst_flaw(quality: &Quality) -> (Flaw, Flawed) {
    Flaw::ALL.iter().copied().zip(quality.flawed).fold((Flaw::Darker, Flawed::default()), |most, found| {
        if found.1.pictures > most.1.pictures { found } else { most }
    })
}

/// Describes a flaw: the worst measured value and the limit.
pub(super) fn describe_flaw(
    flaw: Flaw,
    worst: f64,
    observation: &Observation,
    settings: &recipe::Inspect,
) -> String {
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
        Flaw::Bright => format!("up to {worst} % of the region is overexposed (limit {limit} %)"),
        Flaw::Moved => {
            format!("the panel is up to {worst} px from its position in the first picture (limit {limit} px)")
        }
        Flaw::Focus => format!(
            "the sharpness of the panel's edge falls to {worst} of its first value (at least {limit} is needed)"
        ),
        Flaw::Outline => format!(
            "only {worst} % of the panel's outline is visible (at least {limit} % are needed), so a movement of \
             the panel cannot be detected; use surroundings with more contrast to the panel, in any colour"
        ),
        Flaw::OutlineDisagrees => {
            "the visible parts of the panel's outline do not agree on its position, so a movement of the panel \
             cannot be detected; use surroundings with more contrast to the panel, in any colour"
                .to_owned()
        }
        Flaw::Frozen => {
            "the picture is bit-identical to the picture before; the camera's image stream is frozen".to_owned()
        }
    }
}
