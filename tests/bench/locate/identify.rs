//! Which panel is it? Twenty taught panels of four families, whose members differ little, each in twenty scenes: among
//! other objects, with up to a fifth hidden. Further scenes show panels that were not taught.

use super::goal::Figure;
use super::{named_recipe, range_errors, reduction, row};
use panelprep::locate::identify::{Candidate, Identification, identify};
use panelprep::locate::{ScanView, TaughtModel};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{PanelVariant, TrialScene};
use panelprep::verdict::Verdict;
use std::ops::RangeInclusive;
use std::time::Instant;

const FAMILIES: std::ops::Range<u64> = 1..5;
/// The first family of panels that were not taught; there are two of them for each scene of a panel.
const FIRST_OTHER_FAMILY: u64 = 100;
/// Target for the share of scenes that are decided.
const DECIDED: f64 = 0.8;

struct Taught {
    panel: TaughtPanel,
    model: TaughtModel,
    recipe: Recipe,
}

/// A panel of a family.
#[derive(Clone, Copy)]
struct Member {
    family: u64,
    variant: PanelVariant,
}

impl Member {
    fn all() -> impl Iterator<Item = Member> {
        FAMILIES.flat_map(|family| PanelVariant::ALL.iter().map(move |&variant| Member { family, variant }))
    }

    fn name(self) -> String {
        format!("{} {}", self.family, <&str>::from(self.variant))
    }

    fn scene(self, scene: u64) -> TrialScene {
        TrialScene::variant_scene((self.family, self.variant), scene, reduction())
    }

    fn taught(self) -> Taught {
        let trial = self.scene(0);
        let (recipe, scan) = (named_recipe(&trial, &self.name(), ""), trial.taught_scan());
        let panel = TaughtPanel::learn(&scan, *trial.camera(), trial.base_from_camera(), &recipe).expect("a panel");
        let model = TaughtModel::from_panel(&panel, range_errors()).expect("a model");
        Taught { panel, model, recipe }
    }
}

fn identified(trial: &TrialScene, candidates: &[Candidate<'_>]) -> Identification {
    let scan = trial.scan();
    let (camera, base_from_camera) = (trial.camera(), trial.base_from_camera());
    identify(&ScanView { scan: &scan, camera, base_from_camera, range: range_errors() }, candidates)
}

/// Counts right, undecided and wrong scenes; each undecided and each wrong one is printed.
pub fn panels(scenes: RangeInclusive<u64>) -> usize {
    let taught: Vec<Taught> = Member::all().map(Member::taught).collect();
    let candidates: Vec<Candidate<'_>> =
        taught.iter().map(|it| Candidate { panel: &it.panel, model: &it.model, recipe: &it.recipe }).collect();
    let (mut right, mut undecided, mut wrong, mut times) = (0, 0, 0, Vec::new());
    for member in Member::all() {
        for scene in scenes.clone() {
            let trial = member.scene(scene);
            let begun = Instant::now();
            let found = identified(&trial, &candidates);
            times.push(begun.elapsed().as_secs_f64() * 1e3);
            let best = found.best().unwrap_or("none");
            let is_accepted = found.judgement.verdict == Verdict::Accept;
            let state = match (is_accepted, best == member.name()) {
                (true, true) => {
                    right += 1;
                    continue;
                }
                (true, false) => {
                    wrong += 1;
                    "WRONG"
                }
                (false, _) => {
                    undecided += 1;
                    "undecided"
                }
            };
            let words = super::words(&found.judgement);
            println!("{}, scene {scene}: {state}, best {best}: {words}", member.name());
        }
    }
    let other_count = 2 * scenes.count();
    let accepted = (FIRST_OTHER_FAMILY..).take(other_count).filter(|&family| {
        let trial = TrialScene::variant_scene((family, PanelVariant::Original), 1, reduction());
        identified(&trial, &candidates).judgement.verdict == Verdict::Accept
    });
    report([right, undecided, wrong], [accepted.count(), other_count], super::quantile(&mut times, 0.5))
}

fn report([right, undecided, wrong]: [usize; 3], [accepted, others]: [usize; 2], median_ms: f64) -> usize {
    let count = right + undecided + wrong;
    let found = format!("{wrong} of {count}");
    Figure("locate: panels taken for another one").report("0", &found, wrong == 0 && count > 0);
    super::shared(Figure("locate: panels identified"), right, count, DECIDED);
    let found = format!("{accepted} of {others}");
    Figure("locate: panels accepted that were not taught").report("0", &found, accepted == 0);
    println!("{undecided} of {count} are undecided and reported; {median_ms:.0} ms for a scan, median");
    row(wrong == 0, &format!("{wrong} of {count} panels are taken for another one"))
        + row(accepted == 0, &format!("{accepted} of {others} panels that were not taught are accepted"))
        + row(super::share(right, count) >= DECIDED, &format!("{right} of {count} are decided"))
}
