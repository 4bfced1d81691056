//! Tests the verification before contact: two taught corners in the flange camera's pictures of the wet panel, which
//! was moved in its plane.

use super::goal::Figure;
use panelprep::geometry::{Base, Flange, FlangeCamera, Panel, Rigid, Vector};
use panelprep::locate::corner;
use panelprep::locate::refine::{CornerView, RefinedPose, refine};
use panelprep::panel::{CornerTeaching, TaughtCorner, TaughtPanel, panel_from_base_at_teaching};
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, PanelPosition, SEARCH_BOX_MM, Scene};
use std::ops::RangeInclusive;

/// Minimum shift that must be reported, mm.
const MIN_FOUND_SHIFT_MM: f64 = 0.3;
/// Maximum shift that must not be reported, mm.
const MAX_UNREPORTED_SHIFT_MM: f64 = 0.1;

struct Corner {
    taught: TaughtCorner,
    which: usize,
    base_from_flange: Rigid<Base, Flange>,
}

/// Runs the verifications and prints the results.
pub fn verifications(seeds: RangeInclusive<u64>) -> usize {
    let (mut found, mut moved, mut alarms, mut quiet, mut errors) = (0, 0, 0, 0, Vec::new());
    for seed in seeds {
        let cell = Cell::new(seed, Scene::Good, super::reduction());
        let recipe = recipe(&cell);
        let base_from_camera = cell.calibrated_base_from_camera();
        let panel =
            TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), base_from_camera, &recipe).expect("a panel");
        let place = cell.truth().base_from_panel;
        let corners = corners(&cell, &panel, &recipe);
        // The pose is refined on the dry panel, with the camera at the pose that follows from a rough localization.
        let refined = look(&cell, &recipe, &corners, place, place, false);
        // Distance by which the panel is moved in its plane before the wet pictures; zero for one seed in ten.
        let length_mm = if seed % 10 == 0 { 0.0 } else { 2.0 * ((seed * 37 % 101) as f64 / 100.0) };
        let angle = seed as f64 * 2.399_963;
        let normal = cell.truth().normal(panelprep::geometry::Point::at(560.0, 0.0, 360.0));
        let across = normal.mm.cross(&nalgebra::Vector3::z()).normalize();
        let up = normal.mm.cross(&across);
        let step = place * Vector::<Panel>::new((across * angle.cos() + up * angle.sin()) * length_mm);
        let seen =
            look(&cell, &recipe, &corners, refined.base_from_panel, place.followed_by_displacement(step), true);
        let off_mm =
            seen.corners.iter().map(|corner| corner.shift_mm[0].hypot(corner.shift_mm[1])).fold(0.0, f64::max);
        let alarm = off_mm > recipe.corner().verify_mm();
        errors.push((off_mm - length_mm).abs());
        println!("{seed:4}  moved {length_mm:.2} mm, seen {off_mm:.3} mm{}", if alarm { ", alarm" } else { "" });
        if length_mm >= MIN_FOUND_SHIFT_MM {
            (moved, found) = (moved + 1, found + usize::from(alarm));
        } else if length_mm < MAX_UNREPORTED_SHIFT_MM {
            (quiet, alarms) = (quiet + 1, alarms + usize::from(alarm));
        }
    }
    println!("error of the measured shift, 95 %: {:.3} mm", super::quantile(&mut errors, 0.95));
    Figure("locate: wet verifications: moves from 0.3 mm on found").report(
        "all",
        &format!("{found} of {moved}"),
        found == moved && moved > 0,
    );
    let of_quiet = format!("{alarms} of {quiet}");
    Figure("locate: alarms below 0.1 mm").report("0", &of_quiet, alarms == 0 && quiet > 0);
    super::row(
        found == moved,
        &format!("{found} of {moved} moves of {MIN_FOUND_SHIFT_MM} mm or more are found on the wet panel"),
    ) + super::row(
        alarms == 0,
        &format!(
            "{alarms} alarms in {quiet} verifications of a panel moved by less than {MAX_UNREPORTED_SHIFT_MM} mm"
        ),
    )
}

fn recipe(cell: &Cell) -> Recipe {
    let corners = cell.region().corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
         [region]\ncorners_px = {corners:?}\nrows = 4\ncolumns = 6\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\n"
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}

fn corners(cell: &Cell, panel: &TaughtPanel, recipe: &Recipe) -> Vec<Corner> {
    let teach = |(index, view): (usize, panelprep::sim::CornerView)| {
        let picture = cell.flange_picture(&view.base_from_flange, PanelPosition::Nominal).to_gray();
        let px_per_mm = cell.flange_camera().px_per_mm_at(235.0).0;
        let settings = recipe.corner();
        let found =
            corner::find(&picture, settings, settings.which().for_picture(index), px_per_mm).expect("a corner");
        let base_from_camera = view.base_from_flange * cell.calibrated_flange_from_camera();
        let panel_from_camera = panel_from_base_at_teaching() * base_from_camera;
        let teaching = CornerTeaching { reference_px: found.corner_px, panel_from_camera };
        let taught = panel.corner(teaching, cell.flange_camera()).expect("on the panel");
        Corner { taught, which: index, base_from_flange: cell.displaced_corner_pose(&view) }
    };
    cell.corner_views().into_iter().enumerate().map(teach).collect()
}

/// Returns the refinement from both corners of the panel. `place` is the assumed pose, `stands` the true pose of the
/// panel.
fn look(
    cell: &Cell,
    recipe: &Recipe,
    corners: &[Corner],
    place: Rigid<Base, Panel>,
    stands: Rigid<Base, Panel>,
    wet: bool,
) -> RefinedPose {
    let sightings: Vec<(Rigid<Base, FlangeCamera>, _)> = corners
        .iter()
        .map(|corner| {
            let picture = if wet {
                cell.wet_flange_picture_at(&corner.base_from_flange, &stands)
            } else {
                cell.flange_picture_at(&corner.base_from_flange, &stands)
            };
            let settings = recipe.corner();
            let px_per_mm = cell.flange_camera().px_per_mm_at(235.0).0;
            let found =
                corner::find(&picture.to_gray(), settings, settings.which().for_picture(corner.which), px_per_mm);
            let base_from_camera = corner.base_from_flange * cell.calibrated_flange_from_camera();
            (base_from_camera, found.expect("a corner").corner_px)
        })
        .collect();
    let views: Vec<CornerView<'_>> = corners
        .iter()
        .zip(&sightings)
        .map(|(corner, &(base_from_camera, found_px))| CornerView {
            corner: corner.which,
            taught: &corner.taught,
            base_from_camera,
            found_px,
        })
        .collect();
    refine(place, cell.flange_camera(), &views).expect("in view")
}
