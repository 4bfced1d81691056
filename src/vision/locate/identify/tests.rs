//! Tests the comparison of scans with panels that differ little; `bench-locate -- identify` counts over many scenes.

use super::*;
use crate::locate::RangeErrors;
use panelprep_base::geometry::{Camera, OrganizedCloud, Pixel};
use panelprep_sim::{PanelVariant, TRIAL_BOX_MM, TrialScene};

/// Seconds for a test: the pictures are four times smaller than real ones.
const REDUCTION: usize = 4;
const FAMILY: u64 = 3;

fn range() -> RangeErrors {
    RangeErrors { scale: 0.0, ..RangeErrors::default() }
}

/// A taught panel.
struct Taught {
    panel: TaughtPanel,
    model: TaughtModel,
    recipe: Recipe,
}

impl Taught {
    /// Teaches a panel of a family under this name.
    fn new((family, variant): (u64, PanelVariant), name: &str) -> Taught {
        let trial = TrialScene::variant_scene((family, variant), 0, REDUCTION);
        let corners = trial.region_px().map(|pixel| [pixel.u, pixel.v]);
        let [low, high] = TRIAL_BOX_MM;
        let text = format!(
            "panel = \"{name}\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\nmax_shift_mm = 900.0\n\
             turn_limit_deg = 180.0\nmax_tilt_deg = 35.0\n\
             [region]\ncorners_px = {corners:?}\nrows = 2\ncolumns = 3\n"
        );
        let recipe = Recipe::check("trial.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let (camera, base_from_camera) = (trial.camera(), trial.base_from_camera());
        let panel = TaughtPanel::learn(&trial.taught_scan(), *camera, base_from_camera, &recipe);
        let panel = panel.unwrap_or_else(|error| panic!("{error}"));
        let model = TaughtModel::from_panel(&panel, range()).expect("a model");
        Taught { panel, model, recipe }
    }

    fn candidate(&self) -> Candidate<'_> {
        Candidate { panel: &self.panel, model: &self.model, recipe: &self.recipe }
    }
}

fn original() -> Taught {
    Taught::new((FAMILY, PanelVariant::Original), "original")
}

fn view<'a>(trial: &'a TrialScene, scan: &'a OrganizedCloud<Camera>) -> ScanView<'a> {
    ScanView { scan, camera: trial.camera(), base_from_camera: trial.base_from_camera(), range: range() }
}

fn codes(identification: &Identification) -> Vec<&str> {
    identification.judgement.reasons.iter().map(|reason| &*reason.code).collect()
}

/// Covers the pixels near these places with an object 60 mm before the panel.
fn cover(scan: &OrganizedCloud<Camera>, places: &[Pixel]) -> OrganizedCloud<Camera> {
    let is_covered = |index: usize| {
        let pixel = Pixel::at((index % scan.width()) as f64, (index / scan.width()) as f64);
        places.iter().any(|place| place.distance_px(pixel) < 18.0)
    };
    let mut colors = scan.picture().rgb;
    let points = scan.raw_points_mm().iter().enumerate().map(|(index, point)| {
        let nearer = if is_covered(index) { 0.9 } else { 1.0 };
        point.map(|mm| mm * nearer)
    });
    let points = points.collect();
    (0..scan.width() * scan.height()).filter(|&index| is_covered(index)).for_each(|index| colors[index] = [60; 3]);
    OrganizedCloud::new(scan.width(), scan.height(), points, colors).expect("organised")
}

/// The same scan twice: if the corner that distinguishes two panels is in view, the panel is known. If an object covers
/// it, a person decides, and both panels are named.
#[test]
fn a_difference_that_is_hidden_is_for_a_person() {
    let (original, cut) = (original(), Taught::new((FAMILY, PanelVariant::CornerCut), "cut"));
    let trial = TrialScene::variant_scene((FAMILY, PanelVariant::Original), 0, REDUCTION);
    let scan = trial.taught_scan();
    let candidates = [original.candidate(), cut.candidate()];
    let open = identify(&view(&trial, &scan), &candidates);
    assert_eq!((open.judgement.verdict, open.best()), (Verdict::Accept, Some("original")), "{open:?}");
    // By hand: two sides of 15 mm and the new side of 21 mm are 51 mm. At 0.57 px/mm, 2 px are 3.5 mm, so that 5 mm at
    // each of four ends are too near to the other outline, and the rounded corner saves 3 mm: 28 mm remain.
    let margin_mm = open.margin_mm().expect("both are located");
    assert!((16.0..40.0).contains(&margin_mm), "{margin_mm}");

    let seen = view(&trial, &scan);
    let [first, second] = candidates.map(|candidate| {
        let located = locate_one(&seen, candidate, candidate.recipe.locate());
        located.unwrap_or_else(|error| panic!("{error}")).placed
    });
    let covered = cover(&scan, &first.pixels_apart_from(&second));
    let hidden = identify(&view(&trial, &covered), &candidates);
    assert_eq!((hidden.judgement.verdict, codes(&hidden)), (Verdict::Review, vec!["panels_alike"]), "{hidden:?}");
    let message = &hidden.judgement.reasons[0].message;
    assert!(["original", "cut"].iter().all(|name| message.contains(&format!("\"{name}\""))), "{message}");
}

/// A panel that was taught twice under two names is never accepted as one of them, and teaching names the pair. A panel
/// with a corner cut is distinguished.
#[test]
fn equal_panels_are_named() {
    let (one, twin) = (original(), Taught::new((FAMILY, PanelVariant::Original), "twin"));
    let cut = Taught::new((FAMILY, PanelVariant::CornerCut), "cut");
    let trial = TrialScene::variant_scene((FAMILY, PanelVariant::Original), 0, REDUCTION);
    let scan = trial.taught_scan();
    let view = view(&trial, &scan);
    let found = identify(&view, &[one.candidate(), twin.candidate()]);
    assert_eq!((found.judgement.verdict, codes(&found)), (Verdict::Review, vec!["panels_alike"]), "{found:?}");
    let others = [twin.candidate(), cut.candidate()];
    let alike = find_indistinguishable(&view, one.candidate(), &others).expect("it is in its own scan");
    assert_eq!(alike.iter().map(|other| &*other.name).collect::<Vec<_>>(), ["twin"]);
}

/// A panel that an order does not name is for a person; a panel that was not taught is none of the taught ones.
#[test]
fn a_panel_that_is_not_expected_is_not_accepted() {
    let (original, mirrored) = (original(), Taught::new((FAMILY, PanelVariant::Mirrored), "mirrored"));
    let trial = TrialScene::variant_scene((FAMILY, PanelVariant::Mirrored), 0, REDUCTION);
    let scan = trial.taught_scan();
    let view = view(&trial, &scan);
    let found = identify(&view, &[original.candidate(), mirrored.candidate()]);
    assert_eq!((found.judgement.verdict, found.best()), (Verdict::Accept, Some("mirrored")), "{found:?}");
    let differs = found.clone().with_expected("the order", |name| name == "original");
    assert_eq!((differs.judgement.verdict, codes(&differs)), (Verdict::Review, vec!["other_panel"]));
    let agrees = found.with_expected("the order", |name| name == "mirrored");
    assert_eq!(agrees.judgement.verdict, Verdict::Accept);
    let found = identify(&view, &[original.candidate()]);
    assert_eq!((found.judgement.verdict, codes(&found)), (Verdict::Reject, vec!["no_known_panel"]), "{found:?}");
    assert!(found.best().is_none());
    assert_eq!(identify(&view, &[]).judgement.verdict, Verdict::Reject, "nothing was taught");
}
