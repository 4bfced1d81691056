//! Tests of the acceptance checks at their limits.

use super::super::observed::CellDemands;
use super::super::quality::Quality;
use super::super::tests::inspect_table;
use super::*;

const DEMANDS: Demands = Demands {
    observation_s: 10.0,
    frames_per_second: 1.0,
    min_break_mm2: 5.0,
    persist_s: 1.0,
    cell_demands: CellDemands { observation: false, min_break: false },
};

fn good() -> Observation {
    let mut observation = Observation {
        observed_s: 10.0,
        frames: 10,
        longest_gap_s: 1.0,
        min_break_mm2: 5.0,
        has_dry: true,
        never_wet_percent: 0.0,
        film_left: Some(0.6),
        change_levels: Some(20.0),
        noise_levels: 1.0,
        detection_limit_mm2: 3.0,
        is_place_assumed: false,
        quality: Quality::default(),
    };
    (observation.quality.usable, observation.quality.usable_s) = (10, 10.0);
    observation
}

fn codes(observation: &Observation) -> Vec<String> {
    let judgement = judge(observation, &[], &DEMANDS, &inspect_table("")).judgement;
    judgement.reasons.into_iter().map(|reason| reason.code.to_string()).collect()
}

/// Values that are just sufficient, calculated by hand: 8 of 10 seconds, 5 intervals, a film that changes the
/// brightness by six times the noise, and 20 % of the outline.
#[test]
fn each_demand_is_met_at_its_limit_but_not_beyond() {
    let usable = |usable_s: f64, longest_unseen_s: f64| {
        let mut observation = good();
        (observation.quality.usable, observation.quality.usable_s) = (8, usable_s);
        observation.quality.longest_unseen_s = longest_unseen_s;
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
        (Observation { longest_gap_s: 5.0, ..good() }, Observation { longest_gap_s: 5.1, ..good() }, "gap"),
        (
            Observation { change_levels: Some(6.1), ..good() },
            Observation { change_levels: Some(5.9), ..good() },
            "dark",
        ),
        (
            Observation { change_levels: Some(12.1), noise_levels: 2.0, ..good() },
            Observation { change_levels: Some(11.9), noise_levels: 2.0, ..good() },
            "dark",
        ),
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
        (usable(8.0, 5.0), usable(7.9, 5.0), "light"),
        (usable(8.0, 5.0), usable(8.0, 5.1), "light"),
    ];
    for (kept, missed, code) in pairs {
        assert_eq!((codes(&kept), codes(&missed)), (vec![], vec![code.to_owned()]), "{missed:?}");
    }
}

/// Two pictures are too bright and one is out of focus: the reason names the light, with its worst value and its limit.
#[test]
fn the_exceeded_limit_is_named() {
    let mut quality = good().quality;
    (quality.usable, quality.usable_s, quality.longest_unseen_s) = (7, 7.0, 6.0);
    quality.flawed[Flaw::Brighter as usize] = FlawedPictures { pictures: 2, worst: 36.4 };
    quality.flawed[Flaw::Focus as usize] = FlawedPictures { pictures: 1, worst: 0.4 };
    let judgement = judge(&Observation { quality, ..good() }, &[], &DEMANDS, &inspect_table("")).judgement;
    let message = &judgement.reasons[0].message;
    let told = "3 of 10 wet pictures cannot be used, and the longest time without a usable picture is 6.0 s (limit 5 s); \
                in 2 of them the light is up to 36.4 % stronger than in the dry picture (limit 33.3 %";
    assert!(message.starts_with(told), "{message}");
}

/// Enough of the outline is visible, but its parts do not agree on one position: the reason must not state that too
/// little is visible.
#[test]
fn an_outline_that_does_not_agree_is_distinguished_from_one_that_is_not_seen() {
    let told = |flaw: Flaw, worst: f64| {
        let mut observation = good();
        (observation.quality.usable, observation.quality.usable_s) = (7, 7.0);
        observation.quality.longest_unseen_s = 6.0;
        observation.quality.flawed[flaw as usize] = FlawedPictures { pictures: 3, worst };
        let judgement = judge(&observation, &[], &DEMANDS, &inspect_table("")).judgement;
        judgement.reasons[0].message.clone()
    };
    assert!(
        told(Flaw::Outline, 24.0)
            .contains("only 24 % of the panel's outline is visible (at least 25 % are needed)")
    );
    let disagrees = told(Flaw::OutlineDisagrees, 0.0);
    assert!(disagrees.contains("the visible parts of the panel's outline do not agree on its position"));
}
