//! Tests of the whole inspection on a plane panel; a pixel shows 2 × 2 mm.
//!
//! This file contains the tests of the thesis's method, and the tests that apply to both methods.

mod model;

use super::*;
use nalgebra::{Isometry3, Translation3};
use panelprep_base::geometry::{Camera, ColorPicture, Mask, OrganizedCloud, Panel, PinholeCamera, Pixel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Verdict;
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe;
use panelprep_cell::recipe::Recipe;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const WET: [u8; 3] = [60, 55, 50];
const DRY: [u8; 3] = [110, 105, 100];
/// Area of twelve pixels of 4 mm², which are reliably detected, with a small margin.
const MIN_BREAK_MM2: f64 = 50.0;

const CAMERA: PinholeCamera = PinholeCamera {
    width_px: WIDTH,
    height_px: HEIGHT,
    fx_px: 400.0,
    fy_px: 400.0,
    cx_px: 79.5,
    cy_px: 59.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

fn recipe(inspect: &str) -> Recipe {
    let text = format!(
        "panel = \"plane\"\n[locate]\nbox_min_mm = [-500, -500, 700]\nbox_max_mm = [500, 500, 900]\n\
         [region]\ncorners_px = [[19.5, 19.5], [139.5, 19.5], [139.5, 99.5], [19.5, 99.5]]\nrows = 2\ncolumns = 3\n\
         [inspect]\n{inspect}\n"
    );
    Recipe::check("test.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Parses and checks an `[inspect]` table.
pub fn inspect_table(text: &str) -> recipe::Inspect {
    recipe(text).inspect().clone()
}

/// Returns a picture of random noise; the same seed gives the same picture.
pub fn pseudo_random(width: usize, height: usize, seed: u32) -> ColorPicture {
    let byte = |i: u32| {
        let mixed = (i ^ (seed << 24)).wrapping_mul(0x9E37_79B1);
        let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85EB_CA6B);
        (mixed >> 20) as u8
    };
    let rgb = (0..(width * height) as u32).map(|i| [byte(3 * i), byte(3 * i + 1), byte(3 * i + 2)]).collect();
    ColorPicture { width, height, rgb }
}

/// Returns a taught panel: the wall in front of the camera, 800 mm away, with some missing points.
fn taught(recipe: &Recipe) -> TaughtPanel {
    let point = |i: usize| {
        let (column, row) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
        let x_mm = ((column - CAMERA.cx_px) * 2.0) as f32;
        if i % 997 == 5 { [f32::NAN; 3] } else { [x_mm, ((row - CAMERA.cy_px) * 2.0) as f32, 800.0] }
    };
    let points = (0..WIDTH * HEIGHT).map(point).collect();
    let scan =
        OrganizedCloud::<Camera>::new(WIDTH, HEIGHT, points, vec![DRY; WIDTH * HEIGHT]).expect("counts agree");
    TaughtPanel::learn(&scan, CAMERA, Rigid::from_isometry_unchecked(Isometry3::identity()), recipe)
        .expect("a panel")
}

fn shifted(x_mm: f64) -> Rigid<Camera, Panel> {
    moved([x_mm, 0.0, 0.0])
}

fn moved([x_mm, y_mm, z_mm]: [f64; 3]) -> Rigid<Camera, Panel> {
    Rigid::from_isometry_unchecked(Translation3::new(x_mm, y_mm, z_mm).into())
}

/// Settings of the thesis's method with a median of 3 × 3 px, which removes only the corners of a block.
const SHARP: &str = "method = \"thesis\"\nmedian_px = 3\nmedian_passes = 1\npersist_frames = 2";

/// Settings of the default method, which evaluates the film.
const FILM: &str = "method = \"film\"";

fn demands() -> Demands {
    Demands {
        observation_s: 5.0,
        frames_per_second: 1.0,
        min_break_mm2: MIN_BREAK_MM2,
        persist_s: 1.0,
        cell_demands: CellDemands::default(),
    }
}

fn view(taught: &TaughtPanel, camera_from_panel: Rigid<Camera, Panel>) -> FilmView<'_> {
    FilmView { taught, camera: &CAMERA, camera_from_panel, sanded: None }
}

fn watch(x_mm: f64, settings: &str) -> FilmWatch {
    let recipe = recipe(settings);
    FilmWatch::new(&view(&taught(&recipe), shifted(x_mm)), recipe.inspect(), demands()).expect("in view")
}

/// Returns a picture of a wet panel with dry blocks, each given by left, top, right and bottom (exclusive).
fn picture(blocks: &[[usize; 4]]) -> ColorPicture {
    let mut picture = ColorPicture::uniform(WIDTH, HEIGHT, WET);
    for &[left, top, right, bottom] in blocks {
        for row in top..bottom {
            picture.rgb[row * WIDTH + left..row * WIDTH + right].fill(DRY);
        }
    }
    picture
}

/// Returns the picture with the noise of one exposure, ±1 level: without this noise the camera would be treated as
/// frozen.
fn exposed(mut picture: ColorPicture, exposure: usize) -> ColorPicture {
    for (index, pixel) in picture.rgb.iter_mut().enumerate() {
        *pixel = pixel.map(|gray| gray + ((index * 7 + exposure * 13 + index / 160 * exposure) % 2) as u8);
    }
    picture
}

/// Inspects a dry picture and six wet ones, one second apart; the blocks that `dry_at` returns for a picture are dry in
/// it.
fn run(mut watch: FilmWatch, dry_at: impl Fn(usize) -> Vec<[usize; 4]>) -> Inspection {
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    watched(watch, dry_at)
}

fn watched(mut watch: FilmWatch, dry_at: impl Fn(usize) -> Vec<[usize; 4]>) -> Inspection {
    for second in 0..6 {
        let picture = exposed(picture(&dry_at(second)), second);
        watch.push(&picture, 10.0 + second as f64, Phase::Wet).expect("in order");
    }
    watch.finish().expect("wet pictures")
}

fn codes(inspection: &Inspection) -> Vec<&str> {
    inspection.judgement.reasons.iter().map(|reason| &*reason.code).collect()
}

/// Expected values, calculated by hand: a block of 20 × 15 px without its corners has 296 px of 4 mm². The block lies
/// in grid r1c2, which begins at column 60, and is dry from 2 s on.
#[test]
fn a_break_has_its_area_time_and_grid() {
    let inspection = run(watch(0.0, SHARP), |second| if second < 2 { vec![] } else { vec![[70, 30, 90, 45]] });
    assert_eq!(inspection.judgement.verdict, Verdict::Fail, "{:?}", inspection.judgement);
    let [found] = inspection.breaks.as_slice() else { panic!("{:?}", inspection.breaks) };
    assert!((found.area_mm2 - 1184.0).abs() < 0.1, "{found:?}");
    assert_eq!(found.first_seen_s, 2.0);
    assert_eq!(found.grids.iter().map(ToString::to_string).collect::<Vec<_>>(), ["r1c2"]);
    assert_eq!(found.contour_px.len(), 62, "2·(20 + 15) − 4 less one at each missing corner");
    let failed: Vec<bool> = inspection.grids.iter().map(|grid| grid.failed).collect();
    assert_eq!(failed, [false, true, false, false, false, false]);
    assert_eq!(inspection.grids[1].time_to_break_s, Some(2.0));
    assert_eq!((inspection.break_time_s(75, 35), inspection.break_time_s(75, 50)), (Some(2.0), None));
    assert_eq!((inspection.mask().count(), inspection.mask_at(1.9).count()), (296, 0));
    assert!(inspection.judgement.reasons[0].message.contains("r1c2 (1184.0 mm² from 2.0 s)"));
}

/// Expected values, calculated by hand: the region has 120 × 80 px of 4 mm² in six grids; 40 mm are 20 px, and the edge
/// begins at 19.5 px.
#[test]
fn the_grids_move_with_a_displaced_panel() {
    let inspection = run(watch(40.0, SHARP), |second| if second < 3 { vec![] } else { vec![[90, 30, 110, 45]] });
    assert!((inspection.breaks[0].area_mm2 - 1184.0).abs() < 0.1, "{:?}", inspection.breaks[0]);
    assert!(inspection.grids[1].failed);
    for grid in inspection.footprint.grids() {
        assert!((grid.area_mm2 - 6400.0).abs() < 0.5 && grid.is_inspected(), "{grid:?}");
    }
    let corner = inspection.footprint.grids()[0].edge_px[0];
    assert!(corner.distance_px(Pixel::at(39.5, 19.5)) < 1e-3, "{corner:?}");
    assert_eq!(inspection.footprint.region().count(), 120 * 80);
}

/// Expected values, calculated by hand: at 640 mm instead of 800 mm the region is 1.25 times as large, 150 × 100 px,
/// and a pixel shows 1.6 × 1.6 mm. The projected pixels then leave gaps, which belong to the region. A break of 24 × 20
/// px without corners has 476·2.56 mm².
#[test]
fn a_nearer_panel_keeps_its_areas() {
    let recipe = recipe(SHARP);
    let nearer = moved([0.0, 0.0, -160.0]);
    let watch = FilmWatch::new(&view(&taught(&recipe), nearer), recipe.inspect(), demands()).expect("in view");
    let inspection = run(watch, |second| if second < 2 { vec![] } else { vec![[70, 20, 94, 40]] });
    assert!(inspection.footprint.region().count().abs_diff(15_000) < 300);
    let found_mm2 = inspection.breaks.iter().map(|found| found.area_mm2).sum::<f64>();
    assert!((found_mm2 / (476.0 * 2.56) - 1.0).abs() < 0.05, "{found_mm2}");
    assert_eq!(inspection.breaks.len(), 1, "one piece, no gaps");
}

#[test]
fn a_flash_or_a_place_beside_the_region_is_no_break() {
    let flash = |second| match second {
        0..3 => vec![],
        3 => vec![[70, 30, 90, 45]],
        _ => vec![[10, 10, 150, 20]], // just above the region, in the window's margin
    };
    let inspection = run(watch(0.0, SHARP), flash);
    assert_eq!(inspection.judgement.verdict, Verdict::Pass, "{:?}", inspection.judgement);
    assert!(inspection.breaks.is_empty() && inspection.mask().count() == 0);
}

#[test]
fn a_break_stays_broken_when_water_runs_over_it() {
    let inspection =
        run(watch(0.0, SHARP), |second| if (1..3).contains(&second) { vec![[70, 30, 90, 45]] } else { vec![] });
    assert_eq!((inspection.judgement.verdict, inspection.breaks[0].first_seen_s), (Verdict::Fail, 1.0));
}

/// Expected values, calculated by hand: a median of 3 × 3 removes a block of 1 × 3 px of 4 mm², and also a block of 2 ×
/// 2 px. Of a plus sign of 5 px it keeps only the centre: 4 mm², below 50 mm².
#[test]
fn a_break_below_the_least_area_is_reported_and_passes() {
    let inspection =
        run(watch(0.0, SHARP), |second| if second < 1 { vec![] } else { vec![[70, 31, 73, 32], [71, 30, 72, 33]] });
    assert_eq!(inspection.judgement.verdict, Verdict::Pass);
    assert!((inspection.breaks[0].area_mm2 - 4.0).abs() < 1e-3, "{:?}", inspection.breaks);
    assert!((inspection.grids[1].broken_mm2 - 4.0).abs() < 1e-3 && !inspection.grids[1].failed);
}

#[test]
fn with_a_dry_picture_a_place_that_is_never_wet_broke_at_0_s() {
    let never = |_| vec![[90, 60, 110, 80]];
    let without = watched(watch(0.0, SHARP), never);
    assert_eq!((without.judgement.verdict, without.breaks.len()), (Verdict::Invalid, 0), "it never differs");
    let mut watch = watch(0.0, SHARP);
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    watch.push(&pseudo_random(WIDTH, HEIGHT, 3), 2.0, Phase::Spray).expect("second");
    let inspection = watched(watch, never);
    assert_eq!((inspection.judgement.verdict, inspection.breaks.len()), (Verdict::Fail, 1));
    assert_eq!(inspection.breaks[0].first_seen_s, 0.0);
    assert_eq!(inspection.breaks[0].grids.len(), 2, "columns 90 to 110 lie in two grids");
}

#[test]
fn colour_can_exclude_a_change() {
    let settings = format!("{SHARP}\nhsv_min = [0, 0, 120]");
    let mut watch = watch(0.0, &settings);
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    let inspection = watched(watch, |second| if second < 2 { vec![] } else { vec![[70, 30, 90, 45]] });
    assert_eq!(inspection.judgement.verdict, Verdict::Pass, "a value of {} is below 120", DRY[0]);
    assert!(inspection.breaks.is_empty());
}

/// The colour shows that a place is not a break; it does not show that the place was ever wet.
#[test]
fn a_change_excluded_by_colour_does_not_pass_if_it_was_never_wet() {
    let mut watch = watch(0.0, &format!("{SHARP}\nhsv_min = [0, 0, 120]"));
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
    let inspection = watched(watch, |_| vec![[100, 60, 120, 80]]);
    assert_eq!((inspection.judgement.verdict, codes(&inspection)), (Verdict::Invalid, vec!["not_seen"]));
    assert!(inspection.breaks.is_empty());
}

#[test]
fn every_picture_is_reported_at_once() {
    let mut watch = watch(0.0, SHARP);
    let dry = |exposure| exposed(picture(&[[50, 30, 70, 45]]), exposure);
    watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), -1.0, Phase::Dry).expect("dry");
    assert_eq!(watch.push(&picture(&[]), 0.0, Phase::Wet).expect("first").since_wet_s, Some(0.0));
    assert_eq!(watch.push(&dry(1), 1.0, Phase::Wet).expect("second").newly_failed, []);
    let step = watch.push(&dry(2), 2.0, Phase::Wet).expect("third");
    assert_eq!(step.newly_failed.iter().map(ToString::to_string).collect::<Vec<_>>(), ["r1c1", "r1c2"]);
    assert!((step.broken_mm2 - 1184.0).abs() < 0.1, "{step:?}");
    assert_eq!(watch.mask().count(), 296);
    assert_eq!(watch.push(&dry(3), 3.0, Phase::Wet).expect("fourth").newly_failed, []);
}

#[test]
fn an_incomplete_test_gives_no_result() {
    let broken = picture(&[[70, 30, 90, 45]]);
    let test = |x_mm: f64, times_s: &[f64]| {
        let mut watch = watch(x_mm, SHARP);
        watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), -1.0, Phase::Dry).expect("first");
        for (exposure, &time_s) in times_s.iter().enumerate() {
            let picture = if time_s > 0.0 { broken.clone() } else { picture(&[]) };
            watch.push(&exposed(picture, exposure), time_s, Phase::Wet).expect("in order");
        }
        watch.finish().expect("wet pictures")
    };
    let whole = test(0.0, &[0.0, 1.0, 2.0, 3.0, 4.0]);
    assert_eq!((whole.judgement.verdict, codes(&whole)), (Verdict::Fail, vec!["broken"]));
    let short = test(0.0, &[0.0, 1.0, 2.0, 3.0, 3.9]);
    assert_eq!((short.judgement.verdict, codes(&short)), (Verdict::Invalid, vec!["too_short", "broken"]));
    assert_eq!(codes(&test(0.0, &[0.0, 1.0, 2.0, 7.1, 8.0])), ["gap", "broken"]);
    let aside = test(100.0, &[0.0, 1.0, 2.0, 3.0, 4.0]);
    assert_eq!((aside.judgement.verdict, codes(&aside)[0]), (Verdict::Invalid, "not_seen"));
    assert_eq!(
        aside.grids.iter().map(|grid| grid.seen).collect::<Vec<_>>(),
        [true, true, false, true, true, false]
    );
    assert!((aside.footprint.grids()[2].seen_share - 0.25).abs() < 0.01, "10 of 40 columns are in the picture");
}

/// Pictures that are missing before the first one, here at 10 s, are treated as a gap like others.
#[test]
fn a_film_that_begins_late_has_a_gap() {
    let begun = |begins_s: f64| {
        let mut watch = watch(0.0, SHARP);
        watch.push(&ColorPicture::uniform(WIDTH, HEIGHT, DRY), 1.0, Phase::Dry).expect("first");
        watch.set_start(begins_s);
        watched(watch, |_| vec![])
    };
    assert_eq!((codes(&begun(5.0)), codes(&begun(4.9))), (vec![], vec!["gap"]));
}

#[test]
fn truth_makes_grids_fail_by_the_same_rule() {
    let inspection = run(watch(0.0, SHARP), |second| if second < 2 { vec![] } else { vec![[70, 30, 90, 45]] });
    let mut truth = Mask::all_outside(WIDTH, HEIGHT);
    // Expected value, calculated by hand: 13 pixels of 4 mm² are 52 mm².
    truth.inside[70 * WIDTH + 30..70 * WIDTH + 43].fill(true);
    let confusion = inspection.compare_with_truth(&truth).expect("one size");
    assert_eq!(confusion, Confusion { true_fail: 0, false_fail: 1, false_pass: 1, true_pass: 4 });
}

#[test]
fn bad_pictures_are_refused_with_what_is_wrong() {
    let mut watch = watch(0.0, SHARP);
    let wrong = watch.push(&ColorPicture::uniform(80, 60, WET), 0.0, Phase::Wet).expect_err("half the size");
    assert!(wrong.to_string().contains("80×60 px, but the camera was calibrated for 160×120"), "{wrong}");
    watch.push(&picture(&[]), 1.0, Phase::Spray).expect("first");
    for (time_s, phase) in [(1.0, Phase::Wet), (f64::NAN, Phase::Wet), (2.0, Phase::Dry)] {
        assert!(watch.push(&picture(&[]), time_s, phase).is_err(), "{time_s} {phase}");
    }
    assert_eq!(watch.finish().map(|_| ()), Err(InspectError::NoWetPicture));
    let recipe = recipe("");
    let gone = FilmWatch::new(&view(&taught(&recipe), shifted(900.0)), recipe.inspect(), demands());
    assert_eq!(gone.map(|_| ()), Err(InspectError::RegionNotInPicture));
}

/// Pictures of an unbroken film in which no water moves. If its places were sanded after the dry picture, there is no
/// evidence that they were ever wet, and they pass with neither method.
#[test]
fn a_sanded_place_needs_evidence_of_water_by_either_method() {
    for method in [FILM, SHARP] {
        let (recipe, all) =
            (recipe(method), Mask { width: WIDTH, height: HEIGHT, inside: vec![true; WIDTH * HEIGHT] });
        let taught = taught(&recipe);
        let sanded = FilmView { sanded: Some(&all), ..view(&taught, shifted(0.0)) };
        let watch = FilmWatch::new(&sanded, recipe.inspect(), demands()).expect("in view");
        let inspection = run(watch, |_| vec![]);
        assert_eq!(inspection.judgement.verdict, Verdict::Invalid, "{method}: {:?}", inspection.judgement);
        assert!(
            inspection.grids.iter().all(|grid| !grid.seen && grid.reference == ComparisonReference::Wet),
            "{method}"
        );
    }
}
