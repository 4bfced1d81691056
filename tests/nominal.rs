//! Tests a panel that is taught from its drawing, on the simulated cell, whose ground truth is known; compared with the
//! same panel taught by a scan.

use super::commands::{json, panelprep};
use panelprep::files::{read_mesh, write_stl};
use panelprep::geometry::{Base, Camera, Drawing, KukaPose, OrganizedCloud, Panel, Point, Rigid};
use panelprep::locate::{self, Fit, RangeErrors, ScanView, gate};
use panelprep::nominal::{Part, PartEdges, PartRays, PartView};
use panelprep::panel::{TaughtPanel, TaughtSource};
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, SEARCH_BOX_MM, Scene};
use panelprep::verdict::Verdict;

/// Returns the recipe of the simulated panel, with the place of its drawing if it is taught from the drawing.
fn recipe(cell: &Cell, is_drawn: bool) -> Recipe {
    let region = cell.region();
    let corners: Vec<String> = region.corners_px.iter().map(|p| format!("[{:.2}, {:.2}]", p.u, p.v)).collect();
    let [low, high] = SEARCH_BOX_MM;
    let KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } = KukaPose::from_rigid(&cell.drawing().1);
    let place = format!(
        "[nominal.base_from_drawing]\nx_mm = {x_mm:?}\ny_mm = {y_mm:?}\nz_mm = {z_mm:?}\na_deg = {a_deg:?}\nb_deg = {b_deg:?}\n\
         c_deg = {c_deg:?}\n"
    );
    let text = format!(
        "panel = \"simulated\"\n[region]\ncorners_px = [{}]\nrows = {}\ncolumns = {}\n\
         [locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n{}",
        corners.join(", "),
        region.rows,
        region.columns,
        if is_drawn { place.as_str() } else { "" }
    );
    Recipe::check("recipe.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Returns a scan of the exported drawing by the cell's 3D camera.
fn scan_of_drawing(cell: &Cell) -> OrganizedCloud<Camera> {
    let (mesh, base_from_drawing) = cell.drawing();
    let mesh = read_mesh(&write_stl(&mesh)).unwrap_or_else(|error| panic!("{error}"));
    let part = Part::choose(mesh, None, None).unwrap_or_else(|error| panic!("{error}"));
    let edges = PartEdges::find(&part).unwrap_or_else(|error| panic!("{error}"));
    assert!(!edges.borders.is_empty() && edges.facet_error_mm < 0.002, "{} mm", edges.facet_error_mm);
    let camera_from_drawing = cell.calibrated_base_from_camera().inverse() * base_from_drawing;
    let rays = PartRays::new(part, &camera_from_drawing);
    rays.check_crossings(&edges, &camera_from_drawing).unwrap_or_else(|error| panic!("{error}"));
    let seen = PartView::view_part(&rays, cell.scanner()).unwrap_or_else(|error| panic!("{error}"));
    seen.and_then(|seen| seen.cloud()).expect("the drawing is seen")
}

/// A taught panel, the recipe with which it was taught, and the cell.
struct Taught<'a> {
    cell: &'a Cell,
    recipe: Recipe,
    panel: TaughtPanel,
}

impl<'a> Taught<'a> {
    fn new(cell: &'a Cell, scan: &OrganizedCloud<Camera>, is_drawn: bool) -> Self {
        let recipe = recipe(cell, is_drawn);
        let panel = TaughtPanel::learn(scan, *cell.scanner(), cell.calibrated_base_from_camera(), &recipe)
            .unwrap_or_else(|error| panic!("{error}"));
        Taught { cell, recipe, panel }
    }

    fn locate(&self, scan: &OrganizedCloud<Camera>) -> Fit {
        let range = RangeErrors { scale: 0.0, ..RangeErrors::default() };
        let base_from_camera = self.cell.calibrated_base_from_camera();
        let view = ScanView { scan, camera: self.cell.scanner(), base_from_camera, range };
        locate::locate(&self.panel, &view, self.recipe.locate()).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// Returns the maximum distance, mm, between the panel's points placed by `base_from_panel` and the same points
/// measured by the calibrated camera.
///
/// The calibrated mount of the camera has an error. The points of a panel that was taught by a scan have the same error
/// in its frame. The points of a drawing, whose frame is then the panel's frame, do not have it. The test compares the
/// positions at which the tool touches the points.
fn contact_error_mm(cell: &Cell, base_from_panel: Rigid<Base, Panel>, is_drawn: bool) -> f64 {
    let truth = cell.truth();
    let base_from_base = cell.calibrated_base_from_camera() * truth.base_from_camera.inverse();
    let panel_from_panel: Rigid<Panel, Panel> = match is_drawn {
        true => Rigid::from_isometry_unchecked(*cell.drawing().1.inverse().isometry()),
        false => Rigid::from_isometry_unchecked(*base_from_base.isometry()),
    };
    let off_mm = |point: Point<Panel>| {
        let expected = base_from_base * (truth.base_from_panel * point);
        (base_from_panel * (panel_from_panel * point)).distance_mm(expected)
    };
    truth.surface_points().into_iter().map(off_mm).fold(0.0, f64::max)
}

/// If a panel is taught from its drawing, the displaced panel is accepted. The error at the contact is at most 0.02 mm
/// larger than if the panel is taught by a scan; it may be smaller, because a drawing has no noise.
#[test]
fn a_panel_from_its_drawing_is_found_as_one_that_was_scanned() {
    for seed in [1, 2, 3] {
        let cell = Cell::new(seed, Scene::Good, 2);
        let scan = cell.scan();
        let by_scan = Taught::new(&cell, &cell.taught_scan(), false);
        let by_drawing = Taught::new(&cell, &scan_of_drawing(&cell), true);
        assert_eq!(by_scan.panel.reference, TaughtSource::Scan);
        assert!(matches!(by_drawing.panel.reference, TaughtSource::Drawing));
        let [scanned, located] = [by_scan.locate(&scan), by_drawing.locate(&scan)];
        let judgement = gate::judge(&located, &by_drawing.recipe);
        // The drawing contains no fixture, so a moved camera cannot be detected; this alone must not lead to a review.
        assert_eq!(judgement.verdict, Verdict::Accept, "seed {seed}: {judgement:?}");
        let scanned_mm = contact_error_mm(&cell, scanned.base_from_panel, false);
        let drawn_mm = contact_error_mm(&cell, located.base_from_panel, true);
        println!(
            "seed {seed}: taught by scan {scanned_mm:.3} mm, from the drawing {drawn_mm:.3} mm, stated {:.3} and {:.3} mm",
            scanned.uncertainty_mm, located.uncertainty_mm
        );
        assert!(drawn_mm < scanned_mm + 0.02, "seed {seed}: {drawn_mm} mm, by scan {scanned_mm} mm");
        assert!(drawn_mm < located.uncertainty_mm, "seed {seed}: {drawn_mm} mm of {located:?}");
    }
}

fn corners_px(recipe: &str) -> [[f64; 2]; 4] {
    Recipe::check("recipe.toml", recipe).unwrap_or_else(|problems| panic!("{problems}")).region().corners_px()
}

/// The corners of the region on the drawing, mm, as a person reads them in the CAD system.
fn region_mm() -> [[f64; 3]; 4] {
    let cell = Cell::new(1, Scene::Good, 4);
    let (mesh, base_from_drawing) = cell.drawing();
    let part = Part::choose(mesh, None, None).unwrap_or_else(|error| panic!("{error}"));
    let camera_from_drawing = cell.calibrated_base_from_camera().inverse() * base_from_drawing;
    let rays = PartRays::new(part, &camera_from_drawing);
    cell.region().corners_px.map(|pixel| {
        let direction = cell.scanner().unproject::<Camera>(pixel).expect("a ray").mm;
        let depth_mm = rays.nearest(&direction).expect("it meets the drawing").distance;
        (camera_from_drawing.inverse() * Point::new((direction * depth_mm).into())).mm.coords.into()
    })
}

/// Checks that the drawing's frame is at the panel's true pose, within the stated error plus the mount's error of 0.3
/// mm.
fn assert_base_from_drawing(located: &serde_json::Value) {
    let cell = Cell::new(1, Scene::Good, 4);
    assert_eq!(located["base_from_panel"], located["base_from_drawing"], "the panel's frame is the drawing's");
    let found: KukaPose = serde_json::from_value(located["base_from_panel"].clone()).expect("a pose");
    let found: Rigid<Base, Drawing> = found.to_rigid();
    let panel_from_drawing: Rigid<Panel, Drawing> = Rigid::from_isometry_unchecked(*cell.drawing().1.isometry());
    let expected = cell.truth().base_from_panel * panel_from_drawing;
    let off_mm = found.distance_at_mm(expected, Point::new(nalgebra::Point3::origin()));
    let stated_mm = located["uncertainty_mm"].as_f64().expect("a number");
    assert!(off_mm < stated_mm + 0.3, "{off_mm} mm, stated {stated_mm} mm");
    assert!(found.distance_at_mm(cell.drawing().1, Point::new(nalgebra::Point3::origin())) > 5.0, "it has moved");
}

/// The command refuses the drawing if its unit or its place is missing, and stores nothing. With both it teaches the
/// panel with its corners, and `locate` accepts the scan.
#[test]
fn teach_from_a_drawing_and_locate() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = panelprep(folder.path(), "render --seed 1 --reduction 4 --seconds 5 --drawing --out cell");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let teach = |recipe: &str, rest: &str| {
        json(folder.path(), &format!("teach --cell cell/cell.toml --recipe cell/{recipe} {rest}"))
    };
    let message = |(code, answer): (i32, serde_json::Value)| (code, answer.to_string());
    let view = "--flange cell/taught_flange.json";
    let (code, words) = message(teach("recipe_drawing.toml", "--scan cell/taught_scan.pcd"));
    assert!(code != 0 && words.contains("[nominal] states that the panel is taught from its drawing"), "{words}");
    let (code, words) = message(teach("recipe.toml", &format!("--nominal cell/drawing.stl {view}")));
    assert!(code != 0 && words.contains("[nominal] is missing"), "{words}");
    let file = folder.path().join("cell/drawing.stl");
    let stated = std::fs::read(&file).expect("the drawing");
    let mut silent = stated.clone();
    silent[..80].fill(b' ');
    std::fs::write(folder.path().join("cell/silent.stl"), silent).expect("written");
    let (code, words) = message(teach("recipe_drawing.toml", &format!("--nominal cell/silent.stl {view}")));
    assert!(code != 0 && words.contains("states no unit") && words.contains("with --unit in"), "{words}");
    let inches = format!("--nominal cell/silent.stl --unit in {view}");
    let (code, words) = message(teach("recipe_drawing.toml", &inches));
    assert!(code == 2 && words.contains("the search box in [locate]"), "a panel of 8 m: {words}");
    let recipe_file = folder.path().join("cell/recipe_drawing.toml");
    let rendered = std::fs::read_to_string(&recipe_file).expect("a recipe");
    let in_mm =
        rendered.replace("[nominal.base", &format!("[nominal]\nregion_mm = {:?}\n[nominal.base", region_mm()));
    let (before, after) = in_mm.split_once("corners_px = ").expect("a region");
    let rest = after.split_once('\n').expect("more lines").1;
    let elsewhere = "corners_px = [[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0]]";
    std::fs::write(&recipe_file, format!("{before}{elsewhere}\n{rest}")).expect("written");
    let (code, taught) =
        teach("recipe_drawing.toml", &format!("--nominal cell/drawing.stl {view} --pictures cell/pictures"));
    let [set, expected] =
        [std::fs::read_to_string(&recipe_file).expect("a recipe"), rendered].map(|text| corners_px(&text));
    for (set, expected) in set.iter().zip(&expected) {
        assert!((set[0] - expected[0]).hypot(set[1] - expected[1]) < 0.2, "{set:?}, expected {expected:?}");
    }
    assert!(code <= 1, "{code}: {taught}");
    assert_eq!(
        (taught["drawing"]["unit"].as_str(), taught["drawing"]["closed"].as_bool()),
        (Some("mm"), Some(false))
    );
    assert_eq!(taught["normal_seen"].as_array().map(Vec::len), Some(1), "{taught}");
    let (code, located) =
        json(folder.path(), "locate --cell cell/cell.toml --recipe cell/recipe_drawing.toml --scan cell/scan.pcd");
    assert_eq!((code, located["verdict"].as_str()), (0, Some("accept")), "{located}");
    assert_base_from_drawing(&located);
}
