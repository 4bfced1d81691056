//! Panels as in real scans: held by an object in their own plane, with a third of their points missing in patches that
//! differ from scan to scan, bent or flat. They are tested with and without information by a person in the recipe.

use super::goal::Figure;
use super::{MAX_CORRECT_ERROR_MM, Tried, reduction, row, share, shared, tried_with, words};
use panelprep::sim::TrialScene;
use panelprep::verdict::Verdict;
use std::ops::RangeInclusive;

/// Fraction of the panel's points that are missing.
const MISSING_FRACTION: f64 = 0.33;
/// Minimum accepted fraction of the scenes with information by a person and without missing points.
const MIN_ACCEPTED_FRACTION: f64 = 0.9;
/// Minimum accepted fraction if a third of the points was missing at teaching and another third is missing now. In the
/// other scenes a person must decide.
const MIN_ACCEPTED_FRACTION_WITH_MISSING: f64 = 0.5;
/// Maximum fraction of scenes with missing points that cannot be taught, because a patch is as wide as a grid.
const MAX_UNTAUGHT_FRACTION: f64 = 0.05;
/// Minimum fraction of the accepted poses whose error is within the stated uncertainty.
const MIN_STATED_FRACTION: f64 = 0.9;

/// The information about the panel that a person writes into the recipe.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum PriorKnowledge {
    Nothing,
    Held,
    Outline,
    Both,
}

struct Kind {
    words: &'static str,
    trial: fn(u64, usize) -> TrialScene,
    said: PriorKnowledge,
    /// Minimum accepted fraction of this kind.
    floor: f64,
}

/// The kind whose results are in the table of figures.
const TABLE_KIND: &str = "flat, marks, held, points missing, outline drawn";

const KINDS: [Kind; 10] = [
    Kind {
        words: "flat",
        trial: TrialScene::flat_scene,
        said: PriorKnowledge::Nothing,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "flat, outline drawn",
        trial: TrialScene::flat_scene,
        said: PriorKnowledge::Outline,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "flat, held, nothing said",
        trial: |s, r| TrialScene::flat_scene(s, r).with_holder(),
        said: PriorKnowledge::Nothing,
        floor: 0.0,
    },
    Kind {
        words: "flat, held",
        trial: |s, r| TrialScene::flat_scene(s, r).with_holder(),
        said: PriorKnowledge::Held,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "flat, held, outline drawn",
        trial: |s, r| TrialScene::flat_scene(s, r).with_holder(),
        said: PriorKnowledge::Both,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "bent, held",
        trial: |s, r| TrialScene::good_scene(s, r).with_holder(),
        said: PriorKnowledge::Held,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "flat, held, points missing, outline drawn",
        trial: |s, r| TrialScene::flat_scene(s, r).with_holder().with_missing_patches(MISSING_FRACTION),
        said: PriorKnowledge::Both,
        floor: MIN_ACCEPTED_FRACTION_WITH_MISSING,
    },
    Kind {
        words: "flat, marks",
        trial: |s, r| TrialScene::flat_scene(s, r).with_marks(),
        said: PriorKnowledge::Nothing,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: "flat, marks, held, outline drawn",
        trial: |s, r| TrialScene::flat_scene(s, r).with_marks().with_holder(),
        said: PriorKnowledge::Both,
        floor: MIN_ACCEPTED_FRACTION,
    },
    Kind {
        words: TABLE_KIND,
        trial: |s, r| {
            TrialScene::flat_scene(s, r).with_marks().with_holder().with_missing_patches(MISSING_FRACTION)
        },
        said: PriorKnowledge::Both,
        floor: MIN_ACCEPTED_FRACTION,
    },
];

/// Returns the keys of the recipe's `[panel]` with this information.
pub(super) fn keys(trial: &TrialScene, said: PriorKnowledge) -> String {
    let mut keys = String::new();
    if matches!(said, PriorKnowledge::Outline | PriorKnowledge::Both) {
        let corners: Vec<[f64; 2]> = trial.outline_px().iter().map(|pixel| [pixel.u, pixel.v]).collect();
        keys += &format!(", outline_px = {corners:?}");
    }
    if matches!(said, PriorKnowledge::Held | PriorKnowledge::Both) {
        let held: Vec<[[f64; 2]; 4]> =
            trial.marked_holder_px().iter().map(|held| held.map(|pixel| [pixel.u, pixel.v])).collect();
        keys += &format!(", held_px = {held:?}");
    }
    keys
}

/// Runs each kind over these seeds, or only kinds whose text contains the value of the environment variable `HELD`.
/// Returns the number of missed targets.
pub fn scenes(seeds: RangeInclusive<u64>) -> usize {
    let mut missed = 0;
    let asked = std::env::var("HELD").unwrap_or_default();
    for kind in KINDS.iter().filter(|kind| kind.words.contains(&asked)) {
        let (mut accepted, mut wrong, mut stated, mut untaught) = (0, 0, 0, 0);
        let count = seeds.clone().count();
        for seed in seeds.clone() {
            let trial = (kind.trial)(seed, reduction());
            let Some(Tried { judgement, fit, error, .. }) = tried_with(&trial, &keys(&trial, kind.said)) else {
                untaught += 1;
                continue;
            };
            let (stated_mm, max_mm) = (fit.as_ref().map(|fit| fit.uncertainty_mm), error.map(|error| error.max_mm));
            println!(
                "{}: {seed:3} {:6} {max_mm:.3?} {stated_mm:.3?} {}",
                kind.words,
                judgement.verdict.keyword(),
                words(&judgement)
            );
            if judgement.verdict == Verdict::Accept {
                accepted += 1;
                wrong += usize::from(max_mm.is_none_or(|mm| mm > MAX_CORRECT_ERROR_MM));
                stated += usize::from(max_mm.zip(stated_mm).is_some_and(|(max, stated)| max <= stated));
            }
        }
        let reported = format!(
            "{}: {accepted} of {count} are accepted, {wrong} of them wrong by more than {MAX_CORRECT_ERROR_MM} mm, {stated} within what is \
             stated; {untaught} could not be taught",
            kind.words
        );
        let is_good = share(accepted, count) >= kind.floor
            && wrong == 0
            && share(stated, accepted) >= MIN_STATED_FRACTION
            && share(untaught, count) <= MAX_UNTAUGHT_FRACTION;
        if kind.words == TABLE_KIND {
            let figure = Figure("locate: held panels with marks, a third of the points missing, accepted");
            shared(figure, accepted, count, kind.floor);
        }
        missed += row(is_good, &reported);
    }
    missed
}
