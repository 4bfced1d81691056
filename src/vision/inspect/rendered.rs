//! Tests of the inspection on rendered films of a displaced panel: at a quarter of the camera's resolution, and once at
//! full resolution.

use super::*;
use nalgebra::Translation3;
use panelprep_base::geometry::{Camera, Mask, Panel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_sim::{
    self as sim, Cell, Film, FilmSpec, Grease, GreasySpot, SEARCH_BOX_MM, Scene, SpotKind, WET_FROM_S,
};

const FRAMES_PER_SECOND: f64 = 5.0;

struct RenderedTest {
    cell: Cell,
    taught: TaughtPanel,
    camera_from_panel: Rigid<Camera, Panel>,
    watch: FilmWatch,
    recipe: Recipe,
    demands: Demands,
    truth_s: f64,
}

impl RenderedTest {
    fn new(seed: u64, reduction: usize, observation_s: f64) -> Self {
        let cell = Cell::new(seed, Scene::Good, reduction);
        let region = cell.region();
        let [low, high] = SEARCH_BOX_MM;
        let text = format!(
            "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
             [region]\ncorners_px = {:?}\nrows = {}\ncolumns = {}\n",
            region.corners_px.map(|pixel| [pixel.u, pixel.v]),
            region.rows,
            region.columns
        );
        let recipe = Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let truth = cell.truth();
        let taught = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), truth.base_from_camera, &recipe)
            .expect("a panel to learn");
        let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
        // The area is at least the area that pixels of this size detect reliably, also on a displaced panel.
        let limit_mm2 = Footprint::taught_detection_limit_mm2(&taught, recipe.inspect()).expect("in view");
        let min_break_mm2 = (1.2 * limit_mm2).max(5.0);
        let demands = Demands {
            observation_s,
            frames_per_second: FRAMES_PER_SECOND,
            min_break_mm2,
            persist_s: 1.0,
            cell_demands: CellDemands::default(),
        };
        let watch =
            FilmWatch::new(&view(&taught, &cell, camera_from_panel), recipe.inspect(), demands).expect("in view");
        RenderedTest {
            cell,
            taught,
            camera_from_panel,
            watch,
            recipe,
            demands,
            truth_s: WET_FROM_S + observation_s,
        }
    }

    fn inspect(self, film: &Film) -> (Inspection, Mask) {
        self.run_film(film, film)
    }

    /// Inspects a panel that was sanded at the `touched` pixels after the dry pictures. The dry pictures come from
    /// another film.
    fn inspect_sanded(mut self, film: &Film, dry: &Film, touched: &Mask) -> (Inspection, Mask) {
        let view = FilmView { sanded: Some(touched), ..view(&self.taught, &self.cell, self.camera_from_panel) };
        self.watch = FilmWatch::new(&view, self.recipe.inspect(), self.demands).expect("in view");
        self.run_film(film, dry)
    }

    fn run_film(mut self, film: &Film, dry: &Film) -> (Inspection, Mask) {
        let frames = ((WET_FROM_S + self.demands.filmed_s()) * FRAMES_PER_SECOND).round() as u32;
        for time_s in (0..=frames).map(|frame| f64::from(frame) / FRAMES_PER_SECOND) {
            let (shown, phase) = match film.phase(time_s) {
                sim::Phase::Dry => (dry, Phase::Dry),
                sim::Phase::Spray => (film, Phase::Spray),
                sim::Phase::Wet => (film, Phase::Wet),
            };
            self.watch.push(&shown.picture(time_s), time_s, phase).expect("in order");
        }
        (self.watch.finish().expect("wet pictures"), film.broken_pixels(self.truth_s))
    }
}

fn view<'a>(taught: &'a TaughtPanel, cell: &'a Cell, camera_from_panel: Rigid<Camera, Panel>) -> FilmView<'a> {
    FilmView { taught, camera: cell.scanner(), camera_from_panel, sanded: None }
}

/// Asserts that the results of the grids agree with the ground truth, and that the broken pixels agree except at the
/// rims of breaks.
fn assert_true_result(inspection: &Inspection, truth: &Mask, least: f64) {
    let agreement = score_within(&inspection.mask(), truth, &inspection.footprint.region()).expect("one size");
    assert!(agreement.iou > least, "{agreement:?}");
    let confusion = inspection.compare_with_truth(truth).expect("one size");
    assert_eq!((confusion.false_fail, confusion.false_pass), (0, 0), "{confusion:?}");
}

/// Three seeds with drifting light, glints, drops and exposures from dark to bright; a pixel is 1.8 mm wide.
#[test]
fn greasy_grids_are_found_also_in_bad_light() {
    for seed in [1, 3, 7] {
        let test = RenderedTest::new(seed, 4, 16.0);
        let mut spots = test.cell.spots().to_vec();
        spots.iter_mut().zip([6.0, 8.0, 10.0, 11.0]).for_each(|(spot, breaks_s)| {
            (spot.breaks_at_s, spot.grows_s) = (breaks_s, 4.0);
        });
        let film = test.cell.film_with_spec(&spots, &FilmSpec::hardest(seed), 0);
        let (inspection, truth) = test.inspect(&film);
        // With a dark exposure some grids may be too dark: these grids are not judged, and none of them passes.
        assert!(
            inspection.judgement.reasons.iter().any(|reason| reason.code == "broken"),
            "{seed}: {:?}",
            inspection.judgement
        );
        let broken_mm2 = inspection.footprint.broken_mm2(&truth);
        for (grid, broken_mm2) in inspection.grids.iter().zip(broken_mm2) {
            let is_broken = broken_mm2 >= inspection.observation.min_break_mm2;
            assert!(!is_broken || grid.failed || !grid.seen, "{seed}: {grid:?}");
            // The rim of a break adds a margin of half a pixel around it; a pixel is 1.8 mm wide.
            let is_clean = broken_mm2 < 0.8 * inspection.observation.min_break_mm2;
            assert!(!is_clean || !grid.failed, "{seed}: {grid:?}");
        }
    }
}

/// The whole region was sanded after the dry picture and is 0.45 to 1.8 times as bright. No grid with a break or a
/// place that never becomes wet passes, although drops run over these places. With the usual brightness after sanding,
/// an unbroken film passes.
#[test]
fn no_brightness_of_a_sanded_place_hides_a_break() {
    let sanded = |seed: u64, albedo: [f64; 2], spots: &dyn Fn(&Cell) -> Vec<GreasySpot>| {
        let test = RenderedTest::new(seed, 2, 16.0);
        let (cell, spots) = (&test.cell, spots(&test.cell));
        let mut sanding = sim::Sanding::default();
        let areas: Vec<_> = test.taught.grids.iter().map(|grid| grid.corners).collect();
        cell.sand_areas(&mut sanding, &areas, sim::SandingStrength { albedo });
        let film = cell.sanded_film_with_spec((&spots, &spots), &sanding, &FilmSpec::TYPICAL_FILM, seed);
        let before = cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, seed);
        let touched = cell.sanded_taught_pixels(&sanding, 3.0);
        let (inspection, truth) = test.inspect_sanded(&film, &before, &touched);
        let broken_mm2 = inspection.footprint.broken_mm2(&truth);
        let is_broken = |mm2: f64| mm2 >= inspection.observation.min_break_mm2;
        let all = inspection.grids.iter().zip(broken_mm2);
        let passed = all.clone().filter(|(grid, mm2)| is_broken(*mm2) && grid.seen && !grid.failed).count();
        (all.filter(|(_, mm2)| is_broken(*mm2)).count(), passed, inspection.judgement)
    };
    for (seed, albedo) in [(2, 0.45), (2, 0.6), (3, 0.8), (3, 1.35), (2, 1.8)] {
        let spots = |cell: &Cell| {
            let never = Grease::Share { share: 0.02, kind: SpotKind::NeverWets };
            [cell.spots().to_vec(), cell.with_other_grease(&never, seed)].concat()
        };
        let (broken, passed, judgement) = sanded(seed, [albedo; 2], &spots);
        assert!(broken >= 3 && passed == 0, "{seed} {albedo}: {passed} of {broken}");
        assert_ne!(judgement.verdict, Verdict::Pass, "{seed} {albedo}");
    }
    let (_, _, judgement) = sanded(4, sim::SandingStrength::TYPICAL.albedo, &|_| Vec::new());
    assert_eq!(judgement.verdict, Verdict::Pass, "{judgement:?}");
}

#[test]
fn a_clean_panel_passes_in_bad_light() {
    for seed in [8, 9] {
        let test = RenderedTest::new(seed, 4, 12.0);
        let film = test.cell.film_with_spec(&[], &FilmSpec::hardest(seed), 0);
        let (inspection, _) = test.inspect(&film);
        assert_eq!(inspection.judgement.verdict, Verdict::Pass, "{seed}: {:?}", inspection.judgement);
    }
}

/// The lamp becomes 15 % brighter while the film becomes thinner, and it flickers.
#[test]
fn light_that_drifts_within_its_limit_neither_causes_nor_hides_breaks() {
    let places = Grease::Mixed { count: 4, until_s: WET_FROM_S + 25.0 };
    for (seed, grease, verdict) in [(15, None, Verdict::Pass), (9, Some(places), Verdict::Fail)] {
        let worst =
            FilmSpec { exposure: 1.0, drift: 0.15, flicker: 0.03, thinning: 0.15, ..FilmSpec::hardest(seed) };
        let test = RenderedTest::new(seed, 4, 30.0);
        let spots: Vec<GreasySpot> =
            grease.iter().flat_map(|grease| test.cell.with_other_grease(grease, seed)).collect();
        let film = test.cell.film_with_spec(&spots, &worst, seed);
        let (inspection, truth) = test.inspect(&film);
        assert_eq!(inspection.judgement.verdict, verdict, "{:?}", inspection.judgement);
        assert_true_result(&inspection, &truth, 0.93);
    }
}

/// Greasy places from 1 % of the panel to the whole panel: wet for half a second, then dry before the film is observed.
#[test]
fn grease_that_dries_under_the_spray_fails() {
    for share in [0.01, 0.3, 1.0] {
        let test = RenderedTest::new(9, 4, 5.0);
        let spots = test.cell.with_other_grease(&Grease::Share { share, kind: SpotKind::UnderSpray }, 0);
        let film = test.cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, 0);
        let (inspection, truth) = test.inspect(&film);
        assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{share}: {:?}", inspection.judgement);
        assert_true_result(&inspection, &truth, 0.93);
        assert!(inspection.grids.iter().filter_map(|grid| grid.time_to_break_s).all(|time_s| time_s < 1.0));
    }
}

/// If no water stays on 60 % of the panel, the test is invalid and no grid passes.
#[test]
fn a_test_of_a_hardly_wet_panel_is_invalid() {
    let test = RenderedTest::new(9, 4, 5.0);
    let spots = test.cell.with_other_grease(&Grease::Share { share: 0.6, kind: SpotKind::NeverWets }, 0);
    let film = test.cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, 0);
    let (inspection, _) = test.inspect(&film);
    assert_eq!(inspection.judgement.verdict, Verdict::Invalid);
    assert!(inspection.judgement.reasons.iter().any(|reason| reason.code == "never_wet"));
}

/// The outline of a panel at its pose is measured within a fraction of a pixel, in any light. A panel that is assumed
/// at its nominal pose but is elsewhere is reported, and so is a pose with an error of a few millimetres.
#[test]
fn a_test_of_a_panel_that_lies_elsewhere_is_invalid() {
    for seed in [1, 3, 7] {
        let test = RenderedTest::new(seed, 4, 5.0);
        let film = test.cell.film_with_spec(&[], &FilmSpec::hardest(seed), 0);
        let off_px = test.inspect(&film).0.observation.quality.off_px;
        assert!(off_px.is_none_or(|off_px| off_px < 0.7), "{seed}: {off_px:?}");
    }
    for off_mm in [0.0, 5.0] {
        let mut test = RenderedTest::new(9, 4, 5.0);
        let film = test.cell.film_with_spec(&[], &FilmSpec::TYPICAL_FILM, 0);
        let nominal = test.taught.panel_from_camera.inverse();
        let placed =
            Rigid::from_isometry_unchecked(Translation3::new(off_mm, 0.0, 0.0) * test.camera_from_panel.isometry());
        let (assumed, place) = if off_mm > 0.0 { (false, placed) } else { (true, nominal) };
        let demands = Demands { observation_s: 5.0, ..test.watch.demands };
        let view = view(&test.taught, &test.cell, place);
        test.watch = FilmWatch::new(&view, &test.watch.settings.clone(), demands).expect("in view");
        if assumed {
            test.watch.assume_nominal_pose();
        }
        let (inspection, _) = test.inspect(&film);
        let reason = inspection.judgement.reasons.iter().find(|reason| reason.code == "elsewhere");
        let reason = reason.unwrap_or_else(|| panic!("{off_mm}: {:?}", inspection.judgement));
        assert_eq!(inspection.judgement.verdict, Verdict::Invalid);
        assert_eq!(reason.message.contains("state --located"), assumed, "{reason:?}");
    }
}

/// At full size for 5 s: small breaks of every kind are detected, and the broken area is measured.
#[test]
fn at_full_resolution_every_place_and_its_area_is_found() {
    let test = RenderedTest::new(5, 1, 5.0);
    let spots = test.cell.with_other_grease(&Grease::Mixed { count: 4, until_s: WET_FROM_S + 4.0 }, 0);
    let film = test.cell.film_with_spec(&spots, &FilmSpec::TYPICAL_FILM, 0);
    let (inspection, truth) = test.inspect(&film);
    assert_true_result(&inspection, &truth, 0.95);
    let area_mm2 = |mask: &Mask| inspection.footprint.broken_mm2(mask).iter().sum::<f64>();
    let (found_mm2, real_mm2) = (area_mm2(&inspection.mask()), area_mm2(&truth));
    assert!((found_mm2 / real_mm2 - 1.0).abs() < 0.05, "found {found_mm2:.1} mm², truly {real_mm2:.1} mm²");
    assert_eq!(inspection.breaks.len(), spots.len());
}
