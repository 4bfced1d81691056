//! The test on rendered films of a displaced panel, a quarter of the camera's size, one picture a second.

use super::*;
use crate::geometry::Mask;
use crate::panel::TaughtPanel;
use crate::phase::Phase;
use crate::recipe::Recipe;
use crate::sim::{self, Cell, Film, SEARCH_BOX_MM, Scene, WET_FROM_S};
use crate::verdict::Verdict;

const OBSERVED_S: usize = 20;

fn watch(cell: &Cell) -> Watch {
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
    let demands = Demands { observation_s: OBSERVED_S as f64, frames_per_second: 1.0, min_break_mm2: 5.0 };
    Watch::new(&taught, cell.scanner(), camera_from_panel, recipe.inspect(), demands).expect("in view")
}

fn inspect(cell: &Cell, film: &Film) -> Inspection {
    let mut watch = watch(cell);
    for second in 0..=WET_FROM_S as usize + OBSERVED_S {
        let time_s = second as f64;
        let phase = match film.phase(time_s) {
            sim::Phase::Dry => Phase::Dry,
            sim::Phase::Spray => Phase::Spray,
            sim::Phase::Wet => Phase::Wet,
        };
        watch.push(&film.picture(time_s), time_s, phase).expect("in order");
    }
    watch.finish().expect("wet pictures")
}

#[test]
fn greasy_grids_are_found_on_a_displaced_panel() {
    let cell = Cell::new(7, Scene::Good, 4);
    let film = cell.film();
    let inspection = inspect(&cell, &film);
    // A break counts one picture later than it is seen, so the truth is that of the last picture but one.
    let truth = film.broken(WET_FROM_S + OBSERVED_S as f64 - 1.0);
    let agreement = score(&inspection.mask(), &truth, &inspection.footprint.region()).expect("one size");
    assert!(agreement.iou > 0.85, "{agreement:?}");
    let confusion = inspection.confusion(&truth).expect("one size");
    assert_eq!((confusion.false_fail, confusion.false_pass), (0, 0), "{confusion:?}");
    assert!(confusion.true_fail > 0 && confusion.true_pass > 0, "{confusion:?}");
    assert_eq!(inspection.judgement.verdict, Verdict::Fail);
    let area_mm2 = |mask: &Mask| inspection.footprint.broken_mm2(mask).iter().sum::<f64>();
    let (found_mm2, real_mm2) = (area_mm2(&inspection.mask()), area_mm2(&truth));
    let error = found_mm2 / real_mm2 - 1.0;
    assert!(error.abs() < 0.1, "found {found_mm2:.1} mm², truly {real_mm2:.1} mm²");
}

#[test]
fn a_clean_panel_passes() {
    let cell = Cell::new(8, Scene::Clean, 4);
    let inspection = inspect(&cell, &cell.film());
    assert_eq!(inspection.judgement.verdict, Verdict::Pass, "{:?}", inspection.judgement);
    assert!(inspection.breaks.is_empty(), "{:?}", inspection.breaks);
}

/// Grease from which the water runs off under the spray: never seen against the first fully wet picture alone.
#[test]
fn grease_that_never_wets_is_a_break_at_0_s() {
    let cell = Cell::new(9, Scene::Good, 4);
    let mut spots = cell.spots().to_vec();
    for spot in &mut spots {
        (spot.breaks_at_s, spot.grows_s) = (0.0, 0.1);
    }
    let film = cell.film_of(&spots);
    let inspection = inspect(&cell, &film);
    let truth = film.broken(WET_FROM_S);
    let agreement = score(&inspection.mask_at(0.0), &truth, &inspection.footprint.region()).expect("one size");
    assert!(agreement.iou > 0.85, "{agreement:?}");
    assert_eq!(inspection.judgement.verdict, Verdict::Fail);
    assert_eq!(inspection.confusion(&truth).map(|found| found.false_pass + found.false_fail), Ok(0));
}
